"""Numbers that cannot be right, or that double precision cannot hold, are refused: which key, which value, what to do."""

from __future__ import annotations

import re
import warnings
from decimal import Decimal

import pytest
import yaml

from strainsight.errors import UserError, at_least, at_most
from strainsight.runner.runner import run

from ..shared import job_of, stages_of
from .beam import BENCH_CONFIG, PLACEMENT_CONFIG, RHO, bricks, config_of, finished, of_material

COUNTS = (3, 1, 1)
DAMPING = "damping"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where runs take the stages over that they share."""
    return tmp_path_factory.mktemp("refused")


PLACEMENTS = [
    # key, value in the message, changes
    ("gauges.noise_std", "the noise is below the rounding error", {"gauges.noise_std": {"value": 1e-30}}),
    ("gauges.noise_std", "the noise is too large", {"gauges.noise_std": {"value": 9e-3}, "loads.tip.signal.amplitude": 1e-6}),
    ("gauges.noise_std.value", "1e+06 m/m is 1e+08 %", {"gauges.noise_std": {"value": 1e6}}),
    ("validate.initial_std.E", "1e+06 times the guess", {"validate.initial_std.E": 1e6}),
    ("parameters.E.process_noise_scale", "3.16e+06 %", {"parameters.E.process_noise_scale": 1e6}),
    (
        "place.estimate",
        "E has no or too little process noise",
        {"parameters.E.process_noise_scale": 1e-30, "screen.keep": "all"},
    ),
    ("filter.drift", "parameters are constant in the grid filter", {"filter.drift": True}),
    ("process_noise.model_error", "at most 1e+06", {"process_noise.model_error": 1e30}),
    (DAMPING, "the smallest damping ratio", {DAMPING: {"type": "rayleigh", "alpha": 1e30, "beta": 0.0}}),
    ("rom.modes", "200 modes are requested, but the degrees of freedom with mass allow only 30", {"rom.modes": 200}),
    ("loads", "above the limit of 1e+50", {"loads.tip.signal.amplitude": 1e300}),
    ("train.time_step", "1 times the time step", {"train.duration": 1e-3}),
    ("place.keep", "8, but screen.keep limits the candidates to 4", {"place.keep": 8, "screen.keep": 4}),
]


@pytest.mark.parametrize(("key", "value", "changes"), PLACEMENTS)
def test_a_placement_is_refused(folder, key, value, changes):
    refused(folder, bricks(COUNTS), key, value, changes)


@pytest.mark.parametrize(
    ("modulus", "density", "key", "value"),
    [
        (1e-3, RHO, "train.duration", "periods of the highest mode"),
        (1e30, RHO, "train.time_step", "periods of the first mode"),
        (1e100, 1e93, "loads", "below the limit of 1e-50"),
    ],
)
def test_a_material_that_the_run_cannot_show_is_refused(tmp_path, modulus, density, key, value):
    """A modulus of 1e-3 Pa of a density of steel swings once in weeks, and one of 1e30 Pa 1e8 times a step."""
    refused(tmp_path, bricks(COUNTS, modulus=modulus, density=density), key, value, of_material(modulus))


BENCHES = [
    ("place.noise", "a change of down by its `increment`", {"place.noise": 1e-30}),
    ("place.noise", "a change of side by its `increment`", {"estimate.inputs.side.increment": 1e30}),
    (
        "estimate.sensors.gauges.noise",
        "the noise of 1e-30 and all predicted readings are nearly zero; the smallest accepted noise is 1e-12",
        {"estimate.sensors.gauges.noise": 1e-30},
    ),
    ("estimate.sensors.gauges.noise", "if an unknown changes by its initial σ", {"estimate.inputs.side.std": 1e30}),
    ("estimate.inputs.down", "no sensor measures this unknown", {"estimate.sensors.gauges.noise": 1e6}),
    ("forces.side.signal", "exceeds the limit of 1e+50", {"forces.side.signal.amplitude": 1e200}),
    ("bodies.beam", "500 modes are requested, but the body has only", {"bodies.beam.modes": 500}),
]


@pytest.mark.parametrize(("key", "value", "changes"), BENCHES)
def test_a_bench_is_refused(folder, key, value, changes):
    refused(folder, bricks(COUNTS), key, value, changes, BENCH_CONFIG)


DRIFT = "parameters.E.process_noise_scale"


@pytest.mark.parametrize(
    ("key", "value", "others"),
    [
        ("gauges.noise_std", {"value": 1e-30}, {}),
        (DRIFT, 1e9, {"process_noise.rule": "as_printed"}),
    ],
)
def test_what_a_refusal_advises_is_accepted(tmp_path, key, value, others):
    own = {"screen.keep": "all", "place.keep": 1, **others}
    with pytest.raises(UserError) as found:
        finished(tmp_path / "refused", "screen", bricks(COUNTS), {**own, key: value})
    advised = float(re.search(r"(?:[Tt]ake|[Uu]se|[Ss]et) at (?:least|most) ([-+.e\d]+\d)", str(found.value))[1])
    accepted = {"value": advised} if isinstance(value, dict) else advised
    finished(tmp_path / "accepted", "screen", bricks(COUNTS), {**own, key: accepted})


@pytest.mark.parametrize("limit", [0.1, 1e-16, 31.622776, 123456.0, 3.17e300])
def test_limits_are_rounded_to_the_side_that_is_accepted(limit):
    assert Decimal(at_most(limit)) <= Decimal(limit) <= Decimal(at_least(limit))
    assert Decimal(at_least(limit)) - Decimal(at_most(limit)) <= Decimal(limit) / 10


def refused(folder, text, key, value, changes, base=PLACEMENT_CONFIG):
    """UserError, so that the command line ends with 2; it names the key at its line and the value, and has a remedy."""
    place = folder / base["kind"]
    place.mkdir(exist_ok=True)
    (place / "beam.bdf").write_text(text, encoding="ascii")
    (place / "edge.yaml").write_text(yaml.safe_dump(config_of(base, changes)), encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        with pytest.raises(UserError) as found:
            run_all(place, "estimate" if base is BENCH_CONFIG else "validate")
    error = found.value
    assert error.exit_code == 2
    assert error.key == key
    assert error.where is not None
    assert "edge.yaml:" in error.where
    assert value in str(error)
    assert error.remedy


def run_all(folder, until):
    job = job_of(folder / "edge.yaml", folder / "results")
    for _ in run(stages_of(job, until), job):
        pass
