"""property: damping_factor: from a config to an estimate whose σ holds; what a config may not say of it."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import StrainsightError

from ..edges.beam import bricks, finished

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
@pytest.mark.parametrize("truth", ["rich", "full"])
def test_sigma_covers_the_errors_of_twenty_measurements(tmp_path, truth):
    """Everything exact but the noise: RMS error over σ of twenty draws lies within 0.69 and 1.31 at 95 %. `full` integrates the
    whole model, damped so much more, by a method of its own."""
    found = finished(tmp_path, "validate", BRICKS, {**FREE, "validate.repeats": 20, "validate.truth.model": truth})[
        "validate"
    ]
    error, std = found["/repeats/error/zeta"], found["/repeats/std/zeta"]
    assert len(error) == 20
    assert 0.69 < np.sqrt(np.mean((error / std) ** 2)) < 1.31
    assert float(found.summary["estimate.zeta"]) == pytest.approx(1.4, rel=4 * std[0])
    assert std.mean() < 0.002


def test_the_factor_moves_nothing_but_the_damping(tmp_path):
    """Rows, frequencies and stiffness are those of a model whose damping is known; at a guess of 2 the motion is that of
    twice the ratio."""
    free = finished(tmp_path / "free", "train", BRICKS, {**FREE, "parameters.zeta.guess": 2.0, "loads.tip.known": True})
    known = finished(
        tmp_path / "known",
        "train",
        BRICKS,
        {**FREE, "damping.ratio": 0.02, "parameters": {}, "loads.tip.known": False, "place.estimate": ["tip"],
         "validate.truth.parameters": {}, "validate.initial_std": {"tip": 1.0}},
    )  # fmt: skip
    for stage, name in (("rom", "/frequency"), ("rom", "/reduced/stiffness/constant"), ("train", "/gauges/row")):
        np.testing.assert_array_equal(free[stage][name], known[stage][name])
    np.testing.assert_allclose(free["train"]["/rms"], known["train"]["/rms"], rtol=1e-10)
    assert free["rom"]["/reduced/law/parameter"][()] in (b"zeta", "zeta")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"parameters.zeta.region": 1}, "it has no region"),
        ({"parameters.zeta.springs": ["CELAS2 *"]}, "springs have no damping_factor"),
        ({"parameters.zeta.material": "CARBON"}, "a damping_factor is not of one material of plies"),
        ({"damping": {"type": "rayleigh", "alpha": 0.0, "beta": 0.0}}, "of no damping"),
        ({"train.model": "static"}, "a structure without inertia does not feel"),
        ({"tolerances": {"damping": 1.5}}, "damped 1.5 times more or less"),
        (
            {"parameters.more": {"property": "damping_factor", "guess": 1.0, "range": [0.5, 2.0]}},
            "the damping is multiplied by more already",
        ),
    ],
)
def test_what_contradicts_it_is_named(tmp_path, change, words):
    with pytest.raises(StrainsightError, match=words):
        finished(tmp_path, "import", BRICKS, {**FREE, **change})
