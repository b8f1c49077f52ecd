"""A record that CalculiX made, with a finer mesh of another element, another modulus and another damping, through estimate."""

from __future__ import annotations

import hashlib
import shutil

import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.fem.model import build_model
from strainsight.fem.modes import modes
from strainsight.mesh.units import to_si

from ..shared import script
from .angle_bracket import EXACT, TRUE_E, Found, estimate
from .angle_record import GAUGES, GUESS, MESHES, MODES, POINTS, RATE, SHOCK, SOFTER, loads, spans, stored

pytestmark = pytest.mark.usefixtures("no_hot_spots")
STATED = EXACT.replace("}", ", model: 0.03}")
"""The modulus is known to 3 %."""


@pytest.fixture(scope="module")
def right() -> Found:
    """The load alone, where the modulus is that of the truth."""
    return estimate("alone", guess=TRUE_E)


def test_deck_and_record_are_what_the_scripts_say():
    listed, name = (MESHES / "angle.sha256").read_text().split()
    assert hashlib.sha256((MESHES / name).read_bytes()).hexdigest() == listed
    frequency, records = stored()
    assert len(frequency) == MODES
    samples = len(loads()["tip"]) - 1
    assert {own.shape for own in records.values()} == {(samples, len(GAUGES) + len(POINTS))}


def test_the_coarse_mesh_has_the_modes_of_calculix():
    """Within what its size costs; the truth is softer by 3 %."""
    model = build_model(to_si(read_mesh(MESHES / "angle.bdf.gz"), "mm", "t"))
    own = modes(model.stiffness.constant, model.mass.constant, 6)[0] * np.sqrt(SOFTER)
    np.testing.assert_allclose(own, stored()[0][:6], rtol=2.5e-3)


@pytest.mark.slow
def test_the_load_is_within_two_sigma_where_the_model_holds(right):
    assert 0.90 < right.share < 0.98
    tip = loads()["tip"][1:]
    assert np.sqrt(np.mean(right.error**2)) < 0.02 * tip.std()
    # the shock, to 2 % of its height
    peak = int(np.argmax(tip))
    assert abs(peak / RATE - SHOCK[0] - SHOCK[1] / 2) < 0.005
    assert abs(right.error[peak]) < 0.02 * tip[peak]


@pytest.mark.slow
def test_the_field_away_from_the_gauges_is_the_true_one(right):
    within = (right.field < 0.05) | (right.field_share > 0.9)
    assert within.all()
    assert np.median(right.field) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("tolerances", [EXACT, "{}"])
def test_gauges_are_predicted_by_the_others_within_two_sigma(tolerances):
    found = estimate("alone", guess=TRUE_E, tolerances=tolerances, held_out=True)
    assert 0.90 < np.mean(np.abs(found.held_out) < 2) < 0.98


@pytest.mark.slow
@pytest.mark.parametrize("tolerances", [EXACT, "{}"])
@pytest.mark.parametrize("gauge", [1, 3, 5])
def test_a_gauge_turned_by_15_degrees_is_the_one_that_the_others_contradict_most(gauge, tolerances):
    found = estimate("alone", guess=TRUE_E, tolerances=tolerances, held_out=True, turned={gauge: 15.0})
    off = np.sqrt(np.mean(found.held_out**2, axis=0))
    assert np.argmax(off) == gauge - 1
    assert off[gauge - 1] > 3
    assert f"the other gauges contradict A{gauge} (error" in found.said


@pytest.mark.slow
def test_a_modulus_three_per_cent_off_has_to_be_stated():
    """σ that does not know of it holds half of the samples; with tolerances.model it holds them."""
    silent = estimate("alone", guess=1e6 * GUESS)
    assert silent.share < 0.7
    stated = estimate("alone", guess=1e6 * GUESS, tolerances=STATED)
    assert stated.share > 0.90
    # the strain elsewhere follows the gauges, whatever the modulus
    for found in (silent, stated):
        assert ((found.field < 0.05) | (found.field_share > 0.9)).all()


@pytest.mark.slow
def test_the_modulus_is_found_beside_a_known_shaker():
    """Under the default tolerances, but of frequencies."""
    found = estimate("shaken", guess=1e6 * GUESS, tolerances="{frequency: 0}", also=("E",))
    assert abs(found.E - 1) < 3 * found.E_std
    assert abs(found.E - 1) < 0.005
    assert found.share > 0.90
    assert ((found.field < 0.05) | (found.field_share > 0.9)).all()


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX is not installed")
def test_calculix_writes_the_record_again(tmp_path):
    """Its first tenth of a second, here and now."""
    wanted = spans(GAUGES) + spans(POINTS)
    calculix = script("benchmarks/angle_by_calculix.py")
    frequency, strain = calculix.simulated({"tip": loads()["tip"][:101]}, wanted, tmp_path)
    kept, records = stored()
    np.testing.assert_allclose(frequency, kept, rtol=1e-5)
    expected = records["alone"][: len(strain)]
    assert len(strain) == 100
    np.testing.assert_allclose(strain, expected, rtol=0, atol=1e-4 * np.abs(expected).max())
