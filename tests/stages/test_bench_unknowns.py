"""Unknown loads and parameters of a bench from its sensors, and what every ball carries."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest

from strainsight.experiment.bench.inverse.filtering import spread
from strainsight.multibody.bearing.element import ball_loads
from strainsight.multibody.bearing.geometry import Bearing
from strainsight.records.bench import BenchEstimated
from strainsight.records.record import read

from .conftest import DIAMETER, GRID_FILTER, LOADS, MODULUS

EXACT = ("estimate.sensors={gauges: {noise: 0.0}}", "estimate.truth={model: filter_step, noise: false}")
ALL_OF_THE_BEARING = "estimate.parameters={" + ", ".join(
    f"{name}: {{bearing: pitch-bearing, property: {name}, guess: {1.1 * value:.6g}}}"
    for name, value in (
        ("ball_diameter", 0.06), ("radius_inner_left", 0.0318), ("radius_inner_right", 0.0318),
        ("radius_outer_left", 0.0318), ("radius_outer_right", 0.0318),
    )
) + "}"  # fmt: skip


def test_without_noise_alone_step_the_iterated_filter_has_the_loads_to_1e_7(estimate):
    when = ("estimate.time_step=0.1", "estimate.duration=1.0", *EXACT)
    iterated = estimate(LOADS, *when)
    one_shot = estimate(LOADS, *when, "estimate.method.update=one_shot")
    for name in ("Fx", "Fy", "Fz"):
        assert iterated.summary[f"error.{name}"] < 1e-7
        assert iterated.summary[f"error.{name}"] < one_shot.summary[f"error.{name}"] < 1e-4
    assert iterated.summary["violation"] < 1e-14
    assert one_shot.summary["violation"] < 1e-14


@pytest.mark.slow
def test_against_a_finely_integrated_truth_the_loads_are_right_to_2e_3_at_a_step_of_300_ms(hub_estimate):
    found = hub_estimate(
        LOADS, "simulate.duration=9.0", "estimate.time_step=0.3", "estimate.truth.noise=false",
        "estimate.sensors.gauges.noise=1.0e-9", *(f"estimate.inputs.F{k}.increment=1.0e+4" for k in "xyz"),
    )  # fmt: skip
    assert max(found.summary[f"error.F{k}"] for k in "xyz") < 2e-3


@pytest.mark.slow
def test_a_wrong_bearing_leaves_the_loads_right_and_its_own_displacements_wrong(hub_estimate):
    """Strains only feel the load that passes through: thesis figure 2.7."""
    found = hub_estimate(
        DIAMETER, "estimate.time_step=0.1", "estimate.duration=3.0", "estimate.truth.noise=false", ALL_OF_THE_BEARING,
        "estimate.sensors={gauges: {noise: 1.0e-9}}",
    )  # fmt: skip
    for name in ("Fx", "Fy", "Fz"):
        assert found.summary[f"slope.{name}"] == pytest.approx(1.0, abs=0.005)
    assert found.summary["mismatch.relative"] > 0.02
    assert not found["/sensors/relative/used"]


def test_every_seed_has_a_history_that_is_separate_by_another_integrator(estimate):
    """Radau's truth for two seeds: the first is the stated history, which the fine truth has to 1e-3; all begin alike."""
    when = ("estimate.time_step=0.05", "estimate.duration=0.25", "estimate.truth.noise=false")
    other = ("estimate.runs=2", "estimate.truth={model: independent, step: 0.025, histories: 2, within: 40.0, noise: false}")
    found, fine = estimate(LOADS, *when, *other), estimate(LOADS, *when)
    truth = estimate(LOADS, *when, *other, stage="truth")
    assert truth["/begin"][0] == 0
    assert np.all(np.diff(np.sort(truth["/begin"])) > 0.1)
    for name in ("Fx", "Fy", "Fz"):
        loads = truth[f"/inputs/{name}"]
        np.testing.assert_array_equal(loads[0], np.full(2, loads[0, 0]))
        assert np.ptp(loads[-1]) > 1e3
        np.testing.assert_allclose(found[f"/inputs/{name}/true"], fine[f"/inputs/{name}/true"], rtol=1e-12)
        assert found[f"/runs/numbers/error.{name}"][0] == found.summary[f"error.{name}"]
        assert np.ptp(found[f"/runs/numbers/slope.{name}"]) > 0
    np.testing.assert_allclose(found["/sensors/relative/measured"], fine["/sensors/relative/measured"], rtol=1e-2, atol=1e-6)


@pytest.mark.slow
def test_a_drawn_truth_is_estimated_as_well_as_claimed(hub_estimate):
    found = hub_estimate(
        LOADS, "estimate.truth.model=sampled", "estimate.runs=6", "estimate.duration=2.0", "estimate.disturbance=1.0e-3"
    )
    assert found.summary["nis"] == pytest.approx(1.0, abs=0.2)
    for name in ("Fx", "Fy", "Fz"):
        assert 0.6 < found.summary[f"ratio.{name}"] < 1.5
        assert found.summary[f"claim.smoothed.{name}"] == "consistent"
        assert found.summary[f"smoothed_std.{name}"] < found.summary[f"std.{name}"]
        assert found[f"/inputs/{name}/smoothed"][-1] == found[f"/inputs/{name}/estimate"][-1]


def test_an_increment_in_a_second_is_one_in_a_step_over_its_length(estimate):
    step = estimate(LOADS, "estimate.duration=0.2", "estimate.truth.model=filter_step")
    inputs = ", ".join(f"F{k}: {{std: 1.0e+4, increment: 4.0e+4}}" for k in "xyz")
    second = estimate(
        LOADS, "estimate.duration=0.2", "estimate.truth.model=filter_step", "estimate.increments=second",
        f"estimate.inputs={{{inputs}}}",
    )  # fmt: skip
    np.testing.assert_allclose(second["/inputs/Fz/estimate"], step["/inputs/Fz/estimate"], rtol=1e-9)


def test_gauges_zeroed_under_known_loads_serve_whatever_is_guessed_of_the_test(estimate):
    found = estimate(
        LOADS, "estimate.truth={model: filter_step, noise: false}", "estimate.sensors.gauges.noise=1.0e-9",
        "estimate.duration=0.3", "sensors.gauges.zeroed=true",
        *(f"estimate.inputs.F{k}={{guess: 0.0, std: 3.0e+4, increment: 2.0e+3}}" for k in "xyz"),
    )  # fmt: skip
    assert max(found.summary[f"error.F{k}"] for k in "xyz") < 1e-3
    assert found.summary["mismatch.gauges"] < 1e-3


def test_loads_are_written_as_a_command_history_and_a_noise_of_zero_is_raised(estimate):
    found = estimate(LOADS, "estimate.duration=0.2", *EXACT)
    rows = list(csv.reader(io.StringIO((found.path.parent / "loads.csv").read_text(encoding="utf-8"))))
    assert rows[0] == ["time", "Fx", "Fy", "Fz"]
    np.testing.assert_allclose(np.array(rows[1:], dtype=float)[:, 3], found["/inputs/Fz/smoothed"], rtol=1e-8)
    assert "the noise of gauges was increased from 0" in str(found.tables)


def test_a_diverged_estimate_writes_no_command_history_and_reports_it(estimate):
    found = estimate(
        DIAMETER, "bearings.pitch-bearing.groove_centres=fixed", "estimate.truth={model: filter_step, noise: false}",
        "estimate.duration=1.0", "estimate.time_step=0.2", "estimate.method.update=undamped",
        "estimate.parameters.diameter.guess=0.0624", "estimate.parameters.diameter.std=2.4e-3",
    )  # fmt: skip
    assert not (found.path.parent / "loads.csv").exists()
    assert "/inputs/Fz/smoothed" not in found
    assert np.isnan(found["/inputs/Fx/std"][-1])
    assert found.summary["lost"] == 1
    assert "diverged" in str(found.tables)


def test_an_estimate_beyond_its_claim_is_called_overconfident(estimate):
    found = estimate(LOADS, "estimate.duration=1.0", *(f"estimate.inputs.F{k}.increment=1.0e-3" for k in "xyz"))
    text = str(found.tables)
    assert "Fz is overconfident" in text
    assert "the RMS innovation is" in text


WEIGHT = 1.4e4 * 9.81


@pytest.mark.slow
@pytest.mark.parametrize("zeroed", [False, True])
def test_a_hub_ten_per_cent_too_stiff_scales_loads_and_adds_a_tenth_of_the_weight_unless_gauges_are_zeroed(
    hub_estimate, zeroed
):
    """û = 1.1 u + 0.1 G for loads at the blade's centre on a hub that weighs nothing itself; thesis figure 2.8."""
    found = hub_estimate(
        MODULUS, "estimate.duration=4.0", "estimate.truth.noise=false",
        "estimate.parameters={E: {guess: 1.87e+11}}", "estimate.sensors={gauges: {noise: 1.0e-7}}",
        "bodies.hub.mesh.materials={iron: {regions: all, youngs_modulus: 1.7e+11, poisson_ratio: 0.275, density: 7.1}}",
        "frames.station.pose.origin=[17.0, 0.0, 0.0]", f"sensors.gauges.zeroed={str(zeroed).lower()}",
        *(f"estimate.inputs.F{k}={{std: 1.0e+5, increment: 3.0e+4}}" for k in "xyz"),
    )  # fmt: skip
    assert found.summary["slope.Fz"] == pytest.approx(1.10, abs=0.01)
    if zeroed:
        assert abs(found.summary["offset.Fz"]) < 0.002 * WEIGHT
    else:
        assert found.summary["offset.Fz"] == pytest.approx(-0.1 * WEIGHT, rel=0.02)


@pytest.mark.slow
def test_strains_and_displacements_identify_the_modulus_and_zeroed_strains_alone_do_not(hub_estimate):
    common = ("estimate.duration=4.0", "sensors.gauges.zeroed=true")
    both = hub_estimate(MODULUS, *common)
    alone = hub_estimate(MODULUS, *common, "estimate.sensors={gauges: {noise: 1.0e-7}}")
    assert both.summary["identified.E"] is True
    assert both.summary["error.E"] < 4 * both.summary["std.E"] < 0.04
    assert alone.summary["identified.E"] is False
    assert alone.summary["std.E"] > 10 * both.summary["std.E"]


def test_where_a_parameter_is_well_seen_grid_filter_and_extended_filter_agree(estimate):
    """Two draws of noise: every history to a tenth of σ at the end, and the joints kept to rounding."""
    when = ("estimate.duration=0.45", "estimate.runs=2", "estimate.truth.model=filter_step")
    grid_run, extended = estimate(DIAMETER, *when, GRID_FILTER), estimate(DIAMETER, *when)
    for of in ("/parameters/diameter", "/inputs/Fy", "/inputs/Fz"):
        std = extended[f"{of}/std"][-1]
        assert abs(grid_run[f"{of}/estimate"][-1] - extended[f"{of}/estimate"][-1]) < 0.1 * std
        assert grid_run[f"{of}/std"][-1] == pytest.approx(std, rel=0.05)
    np.testing.assert_allclose(
        grid_run["/runs/parameters/diameter/std"], extended["/runs/parameters/diameter/std"], rtol=0.05
    )
    assert grid_run.summary["violation"] < 1e-14
    assert grid_run.summary["ratio.extended.diameter"] == pytest.approx(1.0, abs=0.05)
    assert "ratio.extended.diameter" not in extended.summary
    assert "comparison of filters" in str(grid_run.tables)
    assert read(BenchEstimated, extended).bearings
    assert not read(BenchEstimated, grid_run).bearings


BEARING = Bearing(
    balls=24, ball_diameter=0.03, pitch_diameter=0.5, contact_angle=np.pi / 4,
    radius_inner_left=0.0159, radius_inner_right=0.0159, radius_outer_left=0.0159, radius_outer_right=0.0159,
    preload=5e-6,
)  # fmt: skip


def test_sigma_of_a_ball_is_that_of_drawn_displacements():
    """4000 draws: to 8 % where a contact is loaded throughout, and where it opens in some of them."""
    mean = np.array([8e-6, 5e-6, -3e-6, 1e-5, 2e-5])
    L = np.random.default_rng(1).standard_normal((5, 5)) * 3e-7
    force, pressure = spread(mean, L @ L.T, lambda d: ball_loads(BEARING, d))
    drawn = [ball_loads(BEARING, mean + L @ z) for z in np.random.default_rng(2).standard_normal((4000, 5))]
    own = np.std([balls.force for balls in drawn], axis=0)
    loaded = own > 0.02 * own.max()
    assert loaded.sum() > 60
    np.testing.assert_allclose(force[loaded], own[loaded], rtol=0.08)
    firm = np.min([balls.force for balls in drawn], axis=0) > 0
    np.testing.assert_allclose(pressure[firm], np.std([balls.pressure for balls in drawn], axis=0)[firm], rtol=0.08)


@pytest.mark.slow
def test_displacements_and_pressure_are_within_their_sigma_of_the_truth(hub_estimate):
    """Over three seeds and the later half of each run; loads that move more slowly than their walk leave the ratio below 1."""
    off, pressed = [], []
    fine, own = "simulate.time_step=0.002", "simulate.method=second_order"
    truth = hub_estimate(LOADS, own, fine, stage="simulate")
    ring = "/bearings/bearing"
    for seed in (1, 2, 3):
        found = hub_estimate(LOADS, own, f"seed={seed}", "estimate.time_step=0.02", "estimate.duration=1.0")
        at = np.searchsorted(truth["/time"], found["/time"] - 1e-9)
        z = (found[f"{ring}/displacement"] - truth[f"{ring}/displacement"][at]) / found[f"{ring}/std"]
        off.append(z[len(z) // 2 :])
        at = np.searchsorted(truth["/time"], found[f"{ring}/instants"] - 1e-9)
        z = (found[f"{ring}/pressure"] - truth[f"{ring}/pressure"][at]) / found[f"{ring}/pressure_std"]
        pressed.append(z[len(z) // 2 :])
    for z in (off, pressed):
        assert 0.3 < np.sqrt(np.mean(np.square(z))) < 1.2
