"""Sensors of a bench in its estimate: what they tell apart, accelerometers, offsets, and gauges that are installed wrongly."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.experiment.bench.inverse.trial import ChannelOffsets

from ..models import ended
from ..robustness.small import BENCH
from .test_bench_records import ARM_BENCH as ARM

GAUGES = (
    "[{position: [0.1, 0.0, 0.01], direction: [1, 0, 0]}, {position: [0.1, 0.01, 0.0], direction: [1, 0, 0]}, "
    "{position: [0.6, 0.0, 0.01], direction: [1, 0, 0]}]"
)
AGAIN = "{type: force, frame: tip, direction: [0, 2, 0], signal: {type: sine, frequency: 1.0, amplitude: 10.0}}"
RIG = (
    BENCH[: BENCH.index("place:\n")]
    .replace("{type: strain, body: beam, layout: place}", f"{{type: strain, body: beam, gauges: {GAUGES}}}")
    .replace("sensors:", f"  again: {AGAIN}\nsensors:", 1)
)
BOTH = "estimate.inputs={side: {std: 100.0, increment: 20.0}, again: {std: 100.0, increment: 20.0}}"


def run(config, *changes):
    return ended("estimate", config, *changes)


def test_two_loads_on_one_line_of_action_may_be_allowed():
    end = run(RIG, BOTH, "estimate.allow_unobservable=true")
    assert end.code == 0
    assert "these estimates depend on the initial values and their σ" in end.text


def test_a_step_of_implicit_euler_that_its_loads_outrun_is_refused_unless_allowed_or_made_up_for():
    thesis = ["simulate.method=thesis", "forces.side.signal.frequency=20.0"]
    end = run(RIG, *thesis)
    assert end.code == 2
    assert "resolves loads up to" in end.text
    assert "estimate.allow_unresolved_steps: true" in end.text
    end = run(RIG, *thesis, "estimate.allow_unresolved_steps=true")
    assert end.code == 0
    assert "σ does not include this error" in end.text
    assert run(RIG, *thesis, "estimate.method.step_error=estimated").code == 0


SIDE = "side: {type: force, frame: end, direction: [0, 1, 0], signal: "
DOWN = "down: {type: force, frame: end, direction: [0, 0, 1], signal: "
STILL = "{type: constant, value: 0.0}}"
FELT = (
    ARM[: ARM.index("estimate:")]
    .replace(SIDE + STILL, SIDE + "{type: sine, frequency: 1.3, amplitude: 300.0}}")
    .replace(DOWN + STILL, DOWN + "{type: sine, frequency: 0.7, amplitude: 200.0}}")
    .replace("zeroed: true", "zeroed: false")
    .replace("  end: {type: motion, frame: end}", "  hinge: {type: reaction, joint: hinge}")
    .replace("sensors:", "sensors:\n  felt: {type: acceleration, frame: end}")
    .replace("duration: 0.8", "duration: 0.5")
) + """estimate:
  sensors: {gauges: {noise: 1.0e-6}, felt: {noise: 0.02}}
  truth: {model: independent, step: 0.005, histories: 4, within: 10.0}
  runs: 4
  inputs: {side: {std: 1.0, increment: 24.0}, down: {std: 1.0, increment: 9.0}}
"""  # fmt: skip


@pytest.mark.slow
def test_loads_from_gauges_and_an_accelerometer_keep_to_their_sigma_by_another_integrator():
    found = run(FELT).artefact("estimate").summary
    for name in ("side", "down"):
        assert 0.7 < found[f"ratio.{name}"] < 1.3
    assert found["mismatch.felt"] < 0.01


def test_an_accelerometer_with_gauges_estimates_the_load_across_the_spring_better():
    once = ("estimate.truth={model: filter_step}", "estimate.runs=1", "simulate.duration=0.3")
    found = run(FELT, *once).artefact("estimate").summary
    assert found["mismatch.felt"] < 0.01
    alone = run(FELT, "estimate.sensors={gauges: {noise: 1.0e-6}}", *once).artefact("estimate")
    assert alone.summary["std.down"] > 3 * found["std.down"]
    # by the estimate, beside what it is
    assert alone["/sensors/felt/expected"].shape == alone["/sensors/felt/measured"].shape
    assert not alone["/sensors/felt/used"]


BIAS = "estimate.sensors={gauges: {noise: 1.0e-6, bias: 2.0e-5}, felt: {noise: 0.02, bias: [0.05, 0.05, 0.5]}}"


@pytest.mark.slow
def test_loads_with_constant_offsets_keep_to_their_sigma_and_offsets_to_theirs():
    """Eight histories by Radau's method, offsets of twenty times the noise, which the loads at the start tell from loads."""
    truth = "estimate.truth={model: independent, step: 0.01, histories: 8, within: 10.0}"
    end = run(FELT, BIAS, truth, "estimate.runs=8", "simulate.duration=0.3")
    assert end.code == 0
    assert "final offsets sensor component offset σ unit gauges 1" in end.text
    found = end.artefact("estimate")
    for name in ("side", "down"):
        assert 0.6 < found.summary[f"ratio.{name}"] < 1.4
    # what the estimate says that channels read has their offsets in it
    assert found.summary["mismatch.gauges"] < 0.3
    drawn = ChannelOffsets(np.arange(6), np.array([2e-5] * 3 + [0.05, 0.05, 0.5]), np.zeros(6)).sample(1, 1, 6, 0)[0, 0]
    own = [found[f"/sensors/{sensor}/{what}"] for what in ("bias", "bias_std") for sensor in ("gauges", "felt")]
    score = (np.concatenate(own[:2]) - drawn) / np.concatenate(own[2:])
    assert np.abs(score).max() < 3.5
    assert np.all(own[2] < 0.5 * 2e-5)


@pytest.mark.slow
@pytest.mark.parametrize("update", ["iterated", "one_shot"])
def test_drifting_offsets_with_loads_that_walk_are_estimated_as_well_as_claimed(update):
    sensors = "estimate.sensors={gauges: {noise: 1.0e-6, bias: 1.0e-5, drift: 2.0e-5}, felt: {noise: 0.02}}"
    how = ("estimate.truth={model: sampled}", "estimate.runs=10", "simulate.duration=0.2", f"estimate.method.update={update}")
    found = run(FELT, sensors, *how).artefact("estimate").summary
    assert found["nis"] == pytest.approx(1.0, abs=0.15)
    for name in ("side", "down"):
        assert 0.65 < found[f"ratio.{name}"] < 1.4


KNOWN_AT_FIRST = RIG.replace("std: 1.0e+2", "std: 1.0")
LOOSE = "estimate.tolerances={position: 0.004, angle: 3.0, gain: 0.03, transverse: 0.01}"
ON_TOP = "sensors.gauges.gauges=[" + ", ".join(
    f"{{position: [{at}], direction: [1, 0, 0]}}" for at in ("0.1875, 0.025, 0.08", "0.1875, 0.1, 0.06", "0.5625, 0.025, 0.08")
) + "]"  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("zeroed", ["false", "true"])
def test_sigma_of_loads_covers_gauges_that_are_drawn_anew_for_every_seed(zeroed):
    """Read where they are drawn, without linearisation, on the filter's own step; exact gauges claim half of that σ or less."""
    noise, truth = "estimate.sensors={gauges: {noise: 1.0e-8}}", "estimate.truth={model: filter_step}"
    how = (ON_TOP, noise, truth, f"sensors.gauges.zeroed={zeroed}", "forces.side.signal.phase=1.0")
    found, exact = (run(KNOWN_AT_FIRST, *how, *more).artefact("estimate") for more in ((LOOSE, "estimate.runs=60"), ()))
    for name in ("side", "down"):
        assert 0.8 < found.summary[f"ratio.{name}"] < 1.2
        assert found.summary[f"std.{name}"] > 2 * exact.summary[f"std.{name}"]


def test_what_a_gain_leaves_of_a_load_is_its_share():
    """One gauge, one load, a factor of 3 %: σ² is (3 % of the estimate)² and σ² of an exact gauge, whatever the record."""
    one = "sensors.gauges.gauges=[{position: [0.1875, 0.025, 0.08], direction: [1, 0, 0]}]"
    none = [f"forces.{name}.signal={{type: constant, value: 0.0}}" for name in ("side", "again")]
    how = (
        one, *none, "estimate.inputs={down: {std: 1.0, increment: 10.0}}",
        "estimate.sensors={gauges: {noise: 1.0e-8}}", "estimate.truth={model: filter_step, noise: false}",
    )  # fmt: skip
    found = []
    for tolerances in ("{position: 0.0, angle: 0.0, gain: 0.03, transverse: 0.0}", "null"):
        own = run(KNOWN_AT_FIRST, *how, f"estimate.tolerances={tolerances}").artefact("estimate")
        found.append((own["/inputs/down/estimate"], own["/inputs/down/std"]))
    (load, std), (_, exact) = found
    np.testing.assert_allclose(np.sqrt(std**2 - exact**2), 0.03 * np.abs(load), atol=5e-4 * 0.03 * np.abs(load).max())


ONE_SMOOTH = "estimate.inputs={side: {std: 100.0, model: matern}, again: {std: 100.0, increment: 20.0}}"


@pytest.mark.parametrize(
    ("config", "change", "says"),
    [
        (RIG, BOTH, ("cannot determine side and again together", "remove one of these unknowns from `estimate` if it is known",
                     "estimate.allow_unobservable: true")),
        (RIG, ONE_SMOOTH, ("side and again together",)),
        (RIG, "estimate.inputs={side: {std: 100.0, model: matern, increment: 1.0}}",
         ("has no effect with model: matern",)),
        (FELT, "estimate.disturbance=1.0e-3",
         ("cannot be combined with accelerometer 'felt': readings of the white-noise acceleration",
          "and increase estimate.sensors.felt.noise to √(noise² + e²), "
          "where e [m/s²] is the standard deviation of the acceleration error of the bench model")),
        (FELT, "estimate.sensors={hinge: {noise: 1.0}}", ("the sensor is for the simulation only",)),
        (FELT, "estimate.sensors={gauges: {noise: 1.0e-6, bias: [1.0e-6, 2.0e-6]}}",
         ("estimate.sensors.gauges.bias: the list length is 2, but the number of sensor components is 3",)),
        (KNOWN_AT_FIRST, f"{LOOSE}|estimate.truth={{model: sampled}}", ("simulated gauges have no installation errors",)),
    ],
)  # fmt: skip
def test_what_a_filter_cannot_do_is_refused(config, change, says):
    end = run(config, *change.split("|"))
    assert end.code == 2
    assert all(words in end.text for words in says)
