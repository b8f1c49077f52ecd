"""Damage of a test: what estimate.h5 holds of it, against cycles counted by another program, and where σ is withheld."""

from __future__ import annotations

import numpy as np
import pytest
import pyvista
import rainflow

from strainsight.workflow.artefact import Artefact

from .tested_beam import ALONE, BLIND, changed, estimated

pytestmark = pytest.mark.usefixtures("no_hot_spots")

SLOPE, STRESS, POINTS, DRAWS, TIMES = 5.0, 1e7, 30, 40, 1000.0
SETTING = (
    f"estimate.damage={{curve: {{slope: {SLOPE}, stress: {STRESS}}}, draws: {DRAWS}, points: {POINTS}, "
    f"repetitions: {TIMES}, hot_spots: 4}}"
)
E = 1.89e11
"""Of the config, which is not estimated there."""


@pytest.fixture(scope="module")
def blind(tmp_path_factory):
    folder = tmp_path_factory.mktemp("damage")
    results = changed(folder, "blind", BLIND)
    code, said = estimated(folder, results / "measured.csv", SETTING, config="blind.yaml")
    assert code == 0, said
    return Artefact(results / "estimate.h5"), said, results


def test_damage_of_the_smoothed_strain_is_that_of_its_cycles(blind):
    """At the virtual gauge, whose smoothed strain is in the file: E ε, and the record a thousand times."""
    found, _, _ = blind
    cycles = rainflow.extract_cycles(E * found["/virtual/strain"][:, 0])
    moment = sum(count * (size / STRESS) ** SLOPE for size, _, count, _, _ in cycles)
    assert found["/damage/virtual/of_mean"][0] == pytest.approx(TIMES * moment / 2e6, rel=1e-6)
    expected = STRESS * (TIMES * moment / 1e6) ** (1 / SLOPE)
    assert found["/damage/virtual/range_of_mean"][0] == pytest.approx(expected, rel=1e-6)


def test_intervals_are_about_the_median_where_they_were_drawn_and_nowhere_else(blind):
    found, _, _ = blind
    low, middle, high, of_mean = (found[f"/damage/surface/{name}"] for name in ("low", "damage", "high", "of_mean"))
    drawn = np.isfinite(middle)
    assert drawn.sum() == POINTS
    assert (low[drawn] < middle[drawn]).all()
    assert (middle[drawn] < high[drawn]).all()
    assert of_mean[drawn].min() >= of_mean[~drawn].max() * (1 - 1e-6)
    ranges = found["/damage/surface/range"][drawn]
    np.testing.assert_allclose(ranges, STRESS * (middle[drawn] * 2e6 / 1e6) ** (1 / SLOPE), rtol=1e-2)


def test_hot_spots_are_the_most_damaged_and_apart(blind):
    found, said, _ = blind
    spots, position = found["/damage/hot_spot"], found["/damage/surface/position"]
    level = found["/damage/surface/damage"]
    assert level[spots[0]] >= np.nanmax(level) * (1 - 1e-5)
    assert (np.diff(level[spots]) <= 1e-5 * level[spots[0]]).all()
    apart = np.linalg.norm(position[spots][:, None] - position[spots], axis=2)
    assert apart[~np.eye(len(spots), dtype=bool)].min() > 0.05 * np.ptp(position, axis=0).max()
    # the root of the cantilever, at x = 0
    assert position[spots[0], 0] < 0.1 * np.ptp(position[:, 0])
    assert "hot spots" in said


def test_numbers_have_names(blind):
    found, _, _ = blind
    numbers = found.summary
    assert numbers["damage.low.surface"] < numbers["damage.surface"] < numbers["damage.high.surface"]
    assert numbers["life.surface"] == pytest.approx(found["/damage/hours"][()] / numbers["damage.surface"])
    assert found["/damage/hours"][()] == pytest.approx(TIMES * 0.299 / 3600, rel=0.01)


def test_a_place_of_next_to_no_stress_has_no_interval(blind):
    """Below a tenth of the largest equivalent range, where it was not looked at: damage of the smoothed history."""
    found, said, _ = blind
    largest = found["/damage/surface/range_of_mean"].max()
    assert found["/damage/virtual/range_of_mean"][0] < 0.1 * largest
    assert np.isnan(found["/damage/virtual/low"][0])
    assert "damage.low.V1" not in found.summary
    assert found.summary["life.V1"] == pytest.approx(found["/damage/hours"][()] / found.summary["damage.of_mean.V1"])
    assert "below 0.1 of the largest" in " ".join(said.split())
    assert "withheld" in said


def test_the_surface_opens_as_a_grid_with_damage_on_it(blind):
    found, _, results = blind
    grid = pyvista.read(results / "estimate.h5", force_ext=".vtkhdf")
    assert sorted(np.asarray(grid.cell_data["damage_of_mean"])) == sorted(found["/damage/surface/of_mean"])
    assert np.isfinite(np.asarray(grid.cell_data["damage"])).sum() == POINTS


@pytest.mark.slow
def test_where_sigma_is_withheld_the_interval_is_too(tmp_path):
    results = changed(tmp_path, "alone", ALONE)
    code, said = estimated(tmp_path, results / "measured.csv", SETTING, config="alone.yaml")
    assert code == 0, said
    found = Artefact(results / "estimate.h5")
    for place in ("surface", "virtual"):
        for name in ("damage", "low", "high", "range", "range_low", "range_high"):
            assert np.isnan(found[f"/damage/{place}/{name}"]).all()
        assert (found[f"/damage/{place}/of_mean"] > 0).all()
    words = " ".join(said.split())
    assert "damage of the smoothed history, interval withheld" in words
    assert "σ is withheld, and the interval of damage with it" in words
    assert not any(name.startswith(("damage.low", "damage.high", "damage.V1")) for name in found.summary)
