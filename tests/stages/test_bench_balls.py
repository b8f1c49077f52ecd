"""What every ball carries, from four gauges on the hub: its σ is that of drawn states, and of the truth."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.cases.bench.inverse.balls import spread
from strainsight.multibody.bearing.element import ball_loads
from strainsight.multibody.bearing.geometry import Bearing
from strainsight.records.bench_estimated import BenchEstimated
from strainsight.records.record import read

from .conftest import LOADS

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


def test_a_displacement_that_is_known_leaves_no_doubt_of_the_balls():
    force, pressure = spread(np.full(5, 1e-6), np.zeros((5, 5)), lambda d: ball_loads(BEARING, d))
    assert not np.any(force)
    assert not np.any(pressure)


@pytest.mark.slow
def test_displacements_and_pressure_are_within_their_sigma_of_the_truth(estimate):
    """Noise drawn anew: over three seeds and the later half of each run error is within σ, and σ of its size; loads that move
    more slowly than the walk they are taken for leave it below."""
    off, pressed = [], []
    fine, own = "simulate.time_step=0.002", "simulate.method=second_order"
    truth = estimate(LOADS, own, fine, stage="simulate")
    ring = "/bearings/bearing"
    for seed in (1, 2, 3):
        found = estimate(LOADS, own, f"seed={seed}", "estimate.time_step=0.02", "estimate.duration=1.0")
        at = np.searchsorted(truth["/time"], found["/time"] - 1e-9)
        z = (found[f"{ring}/displacement"] - truth[f"{ring}/displacement"][at]) / found[f"{ring}/std"]
        off.append(z[len(z) // 2 :])
        at = np.searchsorted(truth["/time"], found[f"{ring}/instants"] - 1e-9)
        z = (found[f"{ring}/pressure"] - truth[f"{ring}/pressure"][at]) / found[f"{ring}/pressure_std"]
        pressed.append(z[len(z) // 2 :])
    for z in (off, pressed):
        assert 0.3 < np.sqrt(np.mean(np.square(z))) < 1.2


@pytest.mark.slow
def test_a_bank_says_nothing_of_balls(estimate):
    found = estimate(
        LOADS,
        "estimate.duration=0.2",
        "estimate.time_step=0.05",
        "estimate.sensors.relative.noise=1.0e-6",
        "estimate.parameters.diameter={bearing: pitch-bearing, property: ball_diameter, guess: 0.0601, std: 1.0e-4}",
        "estimate.method.parameters=bank",
    )
    assert not read(BenchEstimated, found).bearings
