"""Damping factors and natural frequencies within their tolerance: estimates whose σ holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.config.load import load_config
from strainsight.errors import StrainsightError
from strainsight.experiment.structure.considered import exact_frequencies_in_words

from ..edges.beam import E, bricks, finished
from ..shared import ROOT
from .drawn_truths import NOTHING, beam_in, filtered, spread, trial

BRICKS = bricks((6, 2, 2))
FREE = {
    "parameters": {"zeta": {"property": "damping_factor", "guess": 1.0, "range": [0.3, 3.0]}},
    "place.estimate": ["zeta"],
    "place.keep": 3,
    "validate.truth.parameters": {"zeta": 1.4},
    "validate.initial_std": {"zeta": 0.3},
    "train": {"duration": 0.5, "time_step": 0.001},
    "validate.duration": 1.0,
    # between the first two modes, 68 and 85 Hz
    "loads.tip.signal": {"type": "sine", "frequency": 80.0, "amplitude": 1000.0},
    "tolerances": "none",
    "process_noise": {"model_error": 0.0},
}


@pytest.mark.slow
@pytest.mark.parametrize("truth", ["perturbed", "full"])
def test_sigma_covers_the_errors_of_twenty_measurements(tmp_path, truth):
    """Everything exact but the noise: RMS error over σ of twenty draws lies within 0.69 and 1.31 at 95 %."""
    found = finished(tmp_path, "validate", BRICKS, {**FREE, "validate.repeats": 20, "validate.truth.model": truth})[
        "validate"
    ]
    error, std = found["/repeats/error/zeta"], found["/repeats/std/zeta"]
    assert len(error) == 20
    assert 0.69 < np.sqrt(np.mean((error / std) ** 2)) < 1.31
    assert float(found.summary["estimate.zeta"]) == pytest.approx(1.4, rel=4 * std[0])
    assert std.mean() < 0.002


def test_the_factor_moves_nothing_but_the_damping(tmp_path):
    """All else is that of a model whose damping is known; at a guess of 2 the motion is that of twice the ratio."""
    beam = beam_in(tmp_path)
    free = beam({**FREE, "parameters.zeta.guess": 2.0, "loads.tip.known": True})
    known = beam(
        {**FREE, "damping.ratio": 0.02, "parameters": {}, "loads.tip.known": False, "place.estimate": ["tip"],
         "validate.truth.parameters": {}, "validate.initial_std": {"tip": 1.0}},
    )  # fmt: skip
    np.testing.assert_array_equal(free.reduced.frequency, known.reduced.frequency)
    np.testing.assert_array_equal(free.reduced.model.stiffness.constant, known.reduced.model.stiffness.constant)
    np.testing.assert_array_equal(free.training.rows, known.training.rows)
    np.testing.assert_allclose(free.training.rms, known.training.rms, rtol=1e-10)
    assert free.reduced.model.damping.parameter == "zeta"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"parameters.zeta.region": 1}, "of every mode, not of a region"),
        ({"damping": {"type": "rayleigh", "alpha": 0.0, "beta": 0.0}}, "since the damping in the key `damping` is zero"),
        ({"train.model": "static"}, "does not depend on the damping"),
        ({"tolerances": {"damping": 1.5}}, "tolerances.damping permits a separate factor of 1.5"),
        (
            {"parameters.more": {"property": "damping_factor", "guess": 1.0, "range": [0.5, 2.0]}},
            "parameter 'more' already has the property damping_factor",
        ),
    ],
)
def test_what_disagrees_with_it_is_named(tmp_path, change, words):
    with pytest.raises(StrainsightError, match=words):
        finished(tmp_path, "import", BRICKS, {**FREE, **change})


SHAKEN = {
    "train": {"duration": 0.25, "time_step": 0.001},
    "loads.tip.signal": {"type": "multisine", "amplitude": 1000.0, "lowest": 20.0, "highest": 110.0, "count": 10},
    "gauges.noise_std": {"relative_to_strongest": 0.003},
}
OF_E = SHAKEN | {"tolerances": NOTHING | {"load_gain": 0.02, "frequency": 0.01}}
EXACT = OF_E | {"tolerances": NOTHING | {"load_gain": 0.02}}
OF_A_LOAD = SHAKEN | {
    "tolerances": NOTHING | {"frequency": 0.01},
    "loads.tip.known": False,
    "loads.tip.process_noise": {"model": "integrated_random_walk", "frequency": 100.0},
    "parameters.E.guess": E,
    "place.estimate": ["tip"],
    "validate.initial_std": {"tip": 1.0},
}


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        ((), False),
        (("tolerances.frequency=0",), True),
        (("tolerances.frequency=0", "train.model=static"), False),
    ],
)
def test_an_estimate_says_that_its_sigma_takes_frequencies_for_exact(overrides, told):
    config = load_config(ROOT / "configs" / "cantilever-input.yaml", overrides).model
    assert ("tolerances.frequency: 0.01" in exact_frequencies_in_words(config)) == told


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    return beam_in(tmp_path_factory.mktemp("beam"))


def test_each_mode_that_gauges_read_has_a_tolerance_that_is_separate_with_that_of_all(beam):
    """The first two bend the beam, at 66 and 82 Hz by beam theory; the others are beyond 400 Hz."""
    n = beam(OF_E).reduced.model.size
    np.testing.assert_allclose(beam(OF_E).tolerated.frequency, 0.01 * np.vstack([np.ones(n), 0.5 * np.eye(n)[:2]]))
    assert len(beam(EXACT).tolerated.frequency) == 0


@pytest.mark.slow
def test_a_modulus_seen_through_resonances_is_within_its_sigma_and_was_far_beyond_it(beam):
    """Three draws, the last of which a lattice of exact frequencies takes to the resonance of the other mode."""
    own, exact = trial(beam(OF_E)), beam(EXACT)
    for realisation in (1, 2, 5):
        error, std = filtered(beam(OF_E), own, realisation)
        assert np.abs(error / std).max() < 3.0
        assert 0.01 < std[-1] < 0.03
    error, std = filtered(beam(OF_E), replace(own, tolerated=exact.tolerated), 3)
    assert np.abs(error / std).max() > 20.0


@pytest.mark.slow
@pytest.mark.parametrize("of", [OF_E, OF_A_LOAD])
def test_drawn_truths_are_within_their_sigma(beam, of):
    within, ratio, _ = spread(beam(of), 60)
    assert within > 0.9
    assert 0.7 < ratio < 1.25


@pytest.mark.slow
def test_sigma_is_no_smaller_than_the_error_where_frequencies_are_exact(beam):
    found = replace(trial(beam(EXACT)), tolerated=beam(OF_E).tolerated)
    error, std = (np.array(each) for each in zip(*(filtered(beam(EXACT), found, r) for r in range(1, 31)), strict=True))
    assert np.mean(np.abs(error) < 2 * std) > 0.9
