"""Unknown loads of a bench from its sensors: how exactly they are found, and what is said where they are not."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest

from .conftest import DIAMETER, LOADS

EXACT = ("estimate.sensors={gauges: {noise: 0.0}}", "estimate.truth={model: own, noise: false}")
ALL_OF_THE_BEARING = "estimate.parameters={" + ", ".join(
    f"{name}: {{bearing: pitch-bearing, property: {name}, guess: {1.1 * value:.6g}}}"
    for name, value in (
        ("ball_diameter", 0.06), ("radius_inner_left", 0.0318), ("radius_inner_right", 0.0318),
        ("radius_outer_left", 0.0318), ("radius_outer_right", 0.0318),
    )
) + "}"  # fmt: skip


@pytest.mark.parametrize("h", [pytest.param(0.02, marks=pytest.mark.slow), 0.1])
def test_without_noise_on_its_own_step_the_iterated_filter_has_the_loads_to_1e_7(estimate, h):
    when = (f"estimate.time_step={h}", "estimate.duration=1.0", *EXACT)
    iterated = estimate(LOADS, *when)
    one_shot = estimate(LOADS, *when, "estimate.method.update=one_shot")
    for name in ("Fx", "Fy", "Fz"):
        assert iterated.summary[f"error.{name}"] < 1e-7
        assert iterated.summary[f"error.{name}"] < one_shot.summary[f"error.{name}"] < 1e-4
    assert iterated.summary["violation"] < 1e-14
    assert one_shot.summary["violation"] < 1e-14


def test_against_a_finely_integrated_truth_the_loads_are_right_to_2e_3_at_a_step_of_300_ms(estimate):
    found = estimate(
        LOADS, "simulate.duration=9.0", "estimate.time_step=0.3", "estimate.truth.noise=false",
        "estimate.sensors.gauges.noise=1.0e-9", *(f"estimate.inputs.F{k}.increment=1.0e+4" for k in "xyz"),
    )  # fmt: skip
    assert max(found.summary[f"error.F{k}"] for k in "xyz") < 2e-3


def test_a_wrong_bearing_leaves_the_loads_right_and_its_own_displacements_wrong(estimate):
    """Strains only feel the load that passes through: thesis figure 2.7."""
    found = estimate(
        DIAMETER, "estimate.time_step=0.1", "estimate.duration=3.0", "estimate.truth.noise=false", ALL_OF_THE_BEARING,
        "estimate.sensors={gauges: {noise: 1.0e-9}}",
    )  # fmt: skip
    for name in ("Fx", "Fy", "Fz"):
        assert found.summary[f"slope.{name}"] == pytest.approx(1.0, abs=0.005)
    assert found.summary["mismatch.relative"] > 0.02
    assert not found["/sensors/relative/used"]


def test_every_seed_has_a_history_of_its_own_by_another_integrator(estimate):
    """Radau's truth for three seeds: the first is the stated history, which the fine truth has to 1e-3; all begin alike."""
    when = ("estimate.time_step=0.05", "estimate.duration=0.5", "estimate.truth.noise=false")
    other = ("estimate.runs=3", "estimate.truth={model: other, step: 0.025, histories: 3, within: 40.0, noise: false}")
    found, fine = estimate(LOADS, *when, *other), estimate(LOADS, *when)
    truth = estimate(LOADS, *when, *other, stage="truth")
    assert truth["/begin"][0] == 0
    assert np.all(np.diff(np.sort(truth["/begin"])) > 0.1)
    for name in ("Fx", "Fy", "Fz"):
        loads = truth[f"/inputs/{name}"]
        np.testing.assert_array_equal(loads[0], np.full(3, loads[0, 0]))
        assert np.ptp(loads[-1]) > 1e3
        np.testing.assert_allclose(found[f"/inputs/{name}/true"], fine[f"/inputs/{name}/true"], rtol=1e-12)
        assert found[f"/runs/numbers/error.{name}"][0] == found.summary[f"error.{name}"]
        assert np.ptp(found[f"/runs/numbers/slope.{name}"]) > 0
    np.testing.assert_allclose(found["/sensors/relative/measured"], fine["/sensors/relative/measured"], rtol=1e-2, atol=1e-6)


def test_a_drawn_truth_is_estimated_as_well_as_claimed(estimate):
    """Six seeds of loads, start and disturbance from the filter's own model: innovations and errors of their claimed size."""
    found = estimate(
        LOADS, "estimate.truth.model=walk", "estimate.runs=6", "estimate.duration=2.0", "estimate.disturbance=1.0e-3"
    )
    assert found.summary["nis"] == pytest.approx(1.0, abs=0.2)
    for name in ("Fx", "Fy", "Fz"):
        assert 0.6 < found.summary[f"ratio.{name}"] < 1.5
        assert found.summary[f"claim.smoothed.{name}"] == "consistent"
        assert found.summary[f"smoothed_std.{name}"] < found.summary[f"std.{name}"]
        assert found[f"/inputs/{name}/smoothed"][-1] == found[f"/inputs/{name}/estimate"][-1]


def test_noise_and_update_of_the_thesis_find_the_loads_and_claim_no_less_than_an_increment(estimate):
    """Q* after the step, one update at the first guess: no better known than the 2000 N a step of the loads, whatever is read."""
    found = estimate(
        LOADS, "estimate.duration=1.0", "estimate.method={update: as_printed, noise: as_printed}", "estimate.disturbance=1.0e-3",
        "estimate.truth={model: own, noise: false}", "estimate.sensors.gauges.noise=1.0e-9",
    )  # fmt: skip
    assert found.summary["method"] == "one-shot as printed, on no constraints, Q* as printed"
    for name in ("Fx", "Fy", "Fz"):
        assert found.summary[f"error.{name}"] < 1e-3
        assert np.all(found[f"/inputs/{name}/std"][1:] > 0.999 * 2e3)


def test_a_truth_drawn_with_the_noise_of_the_thesis_is_estimated_as_well_as_claimed_with_it(estimate):
    """The loads change after the step that read them."""
    found = estimate(
        LOADS, "estimate.truth.model=walk", "estimate.runs=6", "estimate.duration=2.0", "estimate.method.noise=as_printed"
    )
    assert found.summary["nis"] == pytest.approx(1.0, abs=0.2)
    for name in ("Fx", "Fy", "Fz"):
        assert 0.6 < found.summary[f"ratio.{name}"] < 1.5


def test_an_increment_in_a_second_is_one_in_a_step_over_its_length(estimate):
    step = estimate(LOADS, "estimate.duration=0.5", "estimate.truth.model=own")
    inputs = ", ".join(f"F{k}: {{std: 1.0e+4, increment: 4.0e+4}}" for k in "xyz")
    second = estimate(
        LOADS, "estimate.duration=0.5", "estimate.truth.model=own", "estimate.increments=second",
        f"estimate.inputs={{{inputs}}}",
    )  # fmt: skip
    np.testing.assert_allclose(second["/inputs/Fz/estimate"], step["/inputs/Fz/estimate"], rtol=1e-9)


def test_gauges_zeroed_under_known_loads_serve_whatever_is_guessed_of_the_test(estimate):
    """The zero is of the history's first loads; a guess of zero beside it spoils nothing."""
    found = estimate(
        LOADS, "estimate.truth={model: own, noise: false}", "estimate.sensors.gauges.noise=1.0e-9", "estimate.duration=1.0",
        "sensors.gauges.zeroed=true", *(f"estimate.inputs.F{k}={{guess: 0.0, std: 3.0e+4, increment: 2.0e+3}}" for k in "xyz"),
    )  # fmt: skip
    assert max(found.summary[f"error.F{k}"] for k in "xyz") < 1e-3
    assert found.summary["mismatch.gauges"] < 1e-3


def test_loads_are_written_as_a_command_history(estimate):
    found = estimate(LOADS, "estimate.duration=0.2", *EXACT)
    rows = list(csv.reader(io.StringIO((found.path.parent / "loads.csv").read_text(encoding="utf-8"))))
    assert rows[0] == ["time", "Fx", "Fy", "Fz"]
    np.testing.assert_allclose(np.array(rows[1:], dtype=float)[:, 3], found["/inputs/Fz/smoothed"], rtol=1e-8)


def test_noise_of_zero_is_raised_and_reported(estimate):
    found = estimate(LOADS, "estimate.duration=0.2", "estimate.sensors.gauges.noise=0.0")
    assert "the noise of gauges is raised from 0" in str(found.tables)


def test_a_diverged_estimate_writes_no_command_history_and_says_so(estimate):
    found = estimate(
        DIAMETER, "bearings.pitch-bearing.groove_centres=fixed", "estimate.truth={model: own, noise: false}",
        "estimate.duration=2.0", "estimate.time_step=0.2", "estimate.method.update=undamped",
        "estimate.parameters.diameter.guess=0.0612", "estimate.parameters.diameter.std=1.2e-3",
    )  # fmt: skip
    assert not (found.path.parent / "loads.csv").exists()
    assert "/inputs/Fz/smoothed" not in found
    assert np.isnan(found["/inputs/Fx/std"][-1])
    assert "diverged" in str(found.tables)


@pytest.mark.parametrize("increment", [1.0e-3, 300.0])
def test_an_estimate_beyond_its_claim_is_called_overconfident(estimate, increment):
    """Fz off by 4000 times its σ, and by 2.7 times, which no record of half as many independent errors explains."""
    found = estimate(LOADS, "estimate.duration=2.0", *(f"estimate.inputs.F{k}.increment={increment}" for k in "xyz"))
    text = str(found.tables)
    assert "Fz is overconfident" in text
    assert "innovations are" in text
    assert increment < 1 or found.summary["error.Fz"] < 3 * found.summary["std.Fz"]
