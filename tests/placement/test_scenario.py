"""What is asked of a pool before any gauge leaves."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import InfeasibleError
from strainsight.placement.information import information
from strainsight.placement.scenario import Scenario, fewest_gauges, refined, solve_pool


def wandering(channels, unknowns):
    """So many unknowns that wander, and units of so many channels."""
    H = np.zeros((len(channels), max(channels), unknowns))
    for block, number in zip(H, channels, strict=True):
        block[:number] = np.random.default_rng(len(H) + number).normal(size=(number, unknowns))
    H += 1e-3 * np.random.default_rng(1).normal(size=H.shape) * H.any(axis=2, keepdims=True)
    return solve_pool(
        Scenario(np.zeros((unknowns, unknowns)), np.eye(unknowns), H, np.ones(H.shape[:2]), np.ones(unknowns))
    )


@pytest.mark.parametrize(
    ("channels", "fewest"),
    [
        ((3, 3, 1, 1, 1), 2),
        ((1, 1, 3, 1, 3), 2),
        ((3, 2, 2, 2), 3),
        ((1, 1, 1, 1, 1, 1), 6),
        ((1, 6), 1),
        ((2, 3, 2), 3),
    ],
)
def test_as_many_channels_as_unknowns_are_had_from_the_largest_gauges(channels, fewest):
    assert fewest_gauges([wandering(channels, 6)]) == (6, fewest)
    # every scenario has to be told
    few = solve_pool(Scenario(-np.eye(6), np.eye(6), np.ones((len(channels), 6)), np.ones(len(channels)), np.ones(6)))
    assert fewest_gauges([few]) == (0, 0)
    assert fewest_gauges([wandering(channels, 6), few]) == fewest_gauges([few, wandering(channels, 6)]) == (6, fewest)


def test_a_start_far_from_the_solution_does_not_show():
    pool = wandering((1, 2, 3, 1, 2), 3)
    gauges = [1, 2, 4]
    rows = pool.stacked(np.array(gauges))
    # P G P = Q by the root of the symmetric Q^(1/2) G Q^(1/2)
    root = np.sqrt(pool.scenario.Q)
    lam, U = np.linalg.eigh(root @ rows.T @ rows @ root)
    exact = root @ (U / np.sqrt(lam)) @ U.T @ root
    for start in (None, exact, exact * (1 + 1e-6), 1e3 * np.diag([1.0, 5.0, 0.1]), 1e-3 * np.eye(3)):
        np.testing.assert_allclose(refined(pool, information(rows), start), exact, rtol=1e-9, atol=1e-12)


def test_what_no_process_noise_reaches_is_named():
    """A mass on a spring, which a load pushes: undamped with a load that is not unknown, or damped with one that is."""
    H, weight = np.eye(3), np.array([0.0, 0.0, 1.0])
    F = np.array([[0.0, 1.0, 0.0], [-4.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    with pytest.raises(InfeasibleError, match="undamped motion"):
        solve_pool(Scenario(F, np.diag([0.0, 0.0, 1.0]), H, np.ones(3), weight), ["Fz"])
    F = np.array([[0.0, 1.0, 0.0], [-4.0, -0.1, 1.0], [0.0, 0.0, 0.0]])
    with pytest.raises(InfeasibleError, match="Fz is reached by no process noise"):
        solve_pool(Scenario(F, np.diag([0.0, 1.0, 0.0]), H, np.ones(3), weight), ["Fz"])
