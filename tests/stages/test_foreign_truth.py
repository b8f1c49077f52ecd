"""Records of another finite-element code and integrator: a wrong model is covered by σ or named, and no sensor is blamed."""

from __future__ import annotations

from dataclasses import replace

import pytest

from strainsight.rom.model import modal_basis

from ..shared import script

foreign = script("benchmarks/foreign_truth.py")
pytestmark = pytest.mark.slow
OF_NAME = {kind.name: kind for kind in foreign.KINDS}


@pytest.fixture(scope="module")
def studies(tmp_path_factory):
    truth = foreign.Truth(foreign.shapes()["bracket"])
    return {load: foreign.Study(tmp_path_factory.mktemp("foreign"), "bracket", truth, load) for load in (False, True)}


@pytest.mark.parametrize(
    ("name", "outcome"),
    [
        ("E: nothing", "within 2σ"),
        ("E: density +1 %", "within 2σ"),
        ("E: density +5 %", "within 2σ"),
        ("E: mass of 4 % at the tip", "withheld, cause right"),
        ("E: all gauges 2 % low", "within 2σ"),
        ("load: nothing", "within 2σ"),
        ("load: warming, 20 µm/m on all gauges", "withheld, cause right"),
        ("load: hum, 5 µm/m on all gauges", "withheld, cause right"),
    ],
)
def test_a_wrong_model_is_covered_or_named(studies, name, outcome):
    kind = OF_NAME[name]
    study = studies[kind.load]
    assert foreign.record(study, replace(study.truth, kind=kind), 1).column(kind.cause) == outcome


def test_the_deck_has_the_frequencies_of_the_other_code(studies):
    """20-node bricks in both: the first frequency of the reduced model at the guess, E 2.0e11 in place of 2.1e11."""
    _, reduced, *_ = studies[False].prepared
    lam, _ = modal_basis(reduced.model, reduced.model.reference)
    expected = studies[False].truth.first(None) * (2.0 / 2.1) ** 0.5
    assert lam[0] ** 0.5 / 6.283185307179586 == pytest.approx(expected, rel=1e-6)
