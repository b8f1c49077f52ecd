"""The steady covariance in steps: forty digits of plain steps from a wide start, closed forms, units, and what is refused."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from strainsight.errors import InfeasibleError, NumericalError
from strainsight.placement import doubling
from strainsight.placement.doubling import factor_after, steady_factor


def covariance(A, H, N):
    L = steady_factor(A, H, N)
    return L @ L.T


def system(seed, damping, noise):
    """Two oscillators in steps, pushed by two loads that wander, and two gauges; states of like size."""
    rng = np.random.default_rng(seed)
    A = np.eye(6)
    for i, angle in enumerate((0.7, 2.1)):
        c, s = (1 - damping) * np.cos(angle), (1 - damping) * np.sin(angle)
        A[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[c, s], [-s, c]]
    A[:4, 4:] = rng.standard_normal((4, 2))
    N = np.vstack([A[:4, 4:], np.eye(2)])
    return A, rng.standard_normal((2, 6)) * [1, 1, 1, 1, 0, 0] / noise, N


def stepped(A, H, N, *steps):
    """P after so many predictions and updates, one reading after the other, from 1e10 of each variance; forty digits."""
    with mpmath.workdps(40):
        A, H, Q = (mpmath.matrix(X.tolist()) for X in (A, H, N @ N.T))
        P = 10**10 * mpmath.eye(A.rows)
        found = []
        for k in range(1, max(steps) + 1):
            P = A * P * A.T + Q
            for i in range(H.rows):
                Ph = P * H[i, :].T
                P -= Ph * Ph.T / (1 + (H[i, :] * Ph)[0])
            if k in steps:
                found.append(np.array(P.tolist(), dtype=float))
        return found


@pytest.mark.parametrize(("noise", "damping", "enough"), [(1e-5, 0.3, 100), (1.0, 0.02, 300)])
def test_it_is_where_a_filter_comes_to_by_plain_steps(noise, damping, enough):
    A, H, N = system(1, damping, noise)
    before, after = stepped(A, H, N, enough, enough + 20)
    P = covariance(A, H, N)
    np.testing.assert_allclose(after, before, rtol=1e-12)  # it has come there
    std = np.sqrt(np.diag(after))
    assert np.abs((P - after) / np.outer(std, std)).max() < doubling.ACCEPTED


@pytest.mark.parametrize("ratio", [1e-6, 1e-3, 1.0, 1e3, 1e6])
def test_a_walk_that_is_read_has_its_closed_form(ratio):
    """p² + p = 1/h² of the covariance p + 1 before an update: p = (√(1 + 4/h²) − 1)/2 after it, h the reading of a step's σ."""
    P = covariance(np.eye(1), np.array([[ratio]]), np.eye(1))
    assert P[0, 0] == pytest.approx(2 / ratio**2 / (1 + np.sqrt(1 + 4 / ratio**2)), rel=1e-9)


def test_what_decays_and_is_not_read_has_the_variance_of_its_noise():
    """p = a²p + 1 of a state that no gauge reads, beside one that is read."""
    A, N = np.diag([0.9, 1.0]), np.eye(2)
    P = covariance(A, np.array([[0.0, 2.0]]), N)
    assert P[0, 0] == pytest.approx(1 / (1 - 0.81), rel=1e-12)
    assert P[0, 1] == pytest.approx(0.0, abs=1e-14)


@pytest.mark.parametrize("seed", range(4))
def test_units_of_states_and_gauges_change_nothing_but_units(seed):
    rng = np.random.default_rng(100 + seed)
    A, H, N = system(seed, 0.1, 0.1)
    d = 10.0 ** rng.uniform(-2, 2, len(A))
    turn = np.linalg.qr(rng.standard_normal((2, 2)))[0]  # of two readings of unit noise
    P, other = covariance(A, H, N), covariance(A / d[:, None] * d, turn @ H * d, N / d[:, None])
    std = np.sqrt(np.diag(P))
    assert np.abs((other * np.outer(d, d) - P) / np.outer(std, std)).max() < 1e-10


def test_a_state_of_rounding_size_changes_nothing():
    """What the noise reaches by 1e-17 only, and what rounding couples, is not blown up."""
    A, H, N = system(2, 0.1, 0.1)
    more = np.zeros((7, 7))
    more[1:, 1:], more[0, 0], more[0, 1:], more[1:, 0] = A, 0.8, 1e-17, -1e-17
    P = covariance(more, np.hstack([np.ones((2, 1)), H]), np.vstack([[1e-17, -1e-17], N]))
    np.testing.assert_allclose(P[1:, 1:], covariance(A, H, N), rtol=1e-12)
    assert P[0, 0] < 1e-30


def test_what_is_not_detected_or_not_reached_is_found_by_a_test_and_not_by_divergence():
    walk = np.eye(2)
    assert steady_factor(walk, np.array([[1.0, 1.0]]), np.eye(2)) is None  # the sum of two walks
    assert steady_factor(np.diag([1.02, 0.5]), np.array([[0.0, 1.0]]), np.eye(2)) is None  # grows, unseen
    quarter = np.array([[0.0, 1.0], [-1.0, 0.0]])  # turns for ever, and is read in one direction: that is enough
    assert steady_factor(quarter, np.array([[1.0, 0.0]]), np.eye(2)) is not None
    with pytest.raises(InfeasibleError, match="reached by no noise"):
        steady_factor(walk, np.eye(2), np.array([[1.0], [0.0]]))


def test_accuracy_that_is_not_reached_is_reported_with_its_size_and_is_no_advice(monkeypatch):
    A, H, N = system(3, 0.3, 1.0)
    monkeypatch.setattr(doubling, "MOST_DOUBLINGS", 3)
    with pytest.raises(NumericalError, match=r"solved to \d\.\de-\d\d only") as refused:
        steady_factor(A, H, N)
    assert refused.value.exit_code == 1
    assert "keep" not in refused.value.remedy
    monkeypatch.undo()
    assert steady_factor(A, H, N) is not None
    with pytest.raises(NumericalError, match="not solved: its filter is not stable"):
        steady_factor(*system(3, 0.02, 1e-18))


@pytest.mark.parametrize("steps", [1, 2, 7, 40])
def test_a_filter_after_so_many_steps_is_that_of_plain_steps(steps):
    """From a start that is known in part, with a load that does not change: it has no steady covariance but 0."""
    A, H, N = system(3, 0.02, 1e-3)
    N[:, 1] = 0.0
    start = np.random.default_rng(1).standard_normal((6, 3))
    P = start @ start.T
    for _ in range(steps):
        P = A @ P @ A.T + N @ N.T
        K = np.linalg.solve(H @ P @ H.T + np.eye(2), H @ P).T
        P = (np.eye(6) - K @ H) @ P @ (np.eye(6) - K @ H).T + K @ K.T
    L = factor_after(A, H, N, start, steps)
    np.testing.assert_allclose(L @ L.T, P, rtol=1e-7, atol=1e-9 * np.abs(P).max())
