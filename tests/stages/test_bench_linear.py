"""The linear bench of a placement: its steady filter against a textbook recursion, its motion against a linear system's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eig

from strainsight.cases.bench.layout.linear import LinearBench, expected_std, scenario_of, steady
from strainsight.errors import NumericalError

R_STATES, NU = 4, 2


@pytest.fixture(scope="module")
def chain():
    """Four coupled masses, two of them loaded, in skewed coordinates."""
    rng = np.random.default_rng(3)
    K = 1e4 * (2.2 * np.eye(R_STATES) - np.eye(R_STATES, k=1) - np.eye(R_STATES, k=-1))
    turn = np.linalg.qr(rng.standard_normal((R_STATES, R_STATES)))[0]
    M = turn.T @ np.diag([1.0, 2.0, 1.5, 0.5]) @ turn
    K = turn.T @ K @ turn
    B = turn.T @ np.eye(R_STATES)[:, [1, 3]]
    T = rng.standard_normal((6, R_STATES))
    return LinearBench(T, M, 0.01 * M + 1e-5 * K, K, B, np.array([3.0, 0.5]), rng.uniform(1, 2, 6), 0.02)


def kalman(bench, rows, noise, acceleration, steps):
    """x' = A x after (M/h + C + hK)v' = Mv/h − Ky + B(u + δ) + w, one step after the other, in plain textbook form."""
    h, r, nu = bench.h, len(bench.M), bench.B.shape[1]
    inverse = np.linalg.inv(bench.M / h + bench.C + h * bench.K)
    v = np.hstack([-inverse @ bench.K, inverse @ bench.M / h, inverse @ bench.B])
    y = h * v
    y[:, :r] += np.eye(r)
    A = np.vstack([y, v, np.hstack([np.zeros((nu, 2 * r)), np.eye(nu)])])
    G = np.vstack([h * inverse, inverse, np.zeros((nu, r))])
    W = acceleration**2 * bench.T.T @ np.diag(bench.force) @ bench.T
    U = np.zeros((len(A), len(A)))
    U[2 * r :, 2 * r :] = np.diag(bench.increment**2)
    H = np.hstack([rows @ bench.T, np.zeros((len(rows), r + nu))])
    P = 1e6 * U
    for _ in range(steps):
        P = A @ (P + U) @ A.T + G @ W @ G.T
        S = H @ P @ H.T + noise**2 * np.eye(len(rows))
        P = P - P @ H.T @ np.linalg.inv(S) @ H @ P
    return np.sqrt(np.diag(P)[2 * r :])


@pytest.mark.parametrize("acceleration", [0.0, 0.3])
def test_the_expected_std_is_that_of_a_filter_after_many_steps(chain, acceleration):
    rows = np.random.default_rng(0).standard_normal((3, 6))
    found = expected_std(chain, rows, 1e-4, acceleration)
    np.testing.assert_allclose(found, kalman(chain, rows, 1e-4, acceleration, 4000), rtol=1e-6)


def test_a_load_that_does_not_show_has_no_std(chain):
    """One gauge for two loads; two gauges that read alike."""
    rows = np.random.default_rng(0).standard_normal((1, 6))
    assert np.all(np.isinf(expected_std(chain, rows, 1e-4, 0.0)))
    assert np.all(np.isinf(expected_std(chain, np.vstack([rows, 2 * rows]), 1e-4, 0.0)))


def test_the_scenario_moves_as_the_bench_does(chain):
    """Rest under a load, eigenvalues of λ²M + λC + K, and noise as intensities of what happens in a step."""
    rows = np.random.default_rng(1).standard_normal((2, 6))
    s = scenario_of(chain, rows, 1e-4, 0.5)
    r = R_STATES
    rest = np.vstack([np.linalg.solve(chain.K, chain.B), np.zeros((r, NU)), np.eye(NU)])
    np.testing.assert_allclose(s.F @ rest, 0.0, atol=1e-9)
    np.testing.assert_allclose(s.H @ rest, rows @ chain.static, rtol=1e-12)
    zero, one = np.zeros((r, r)), np.eye(r)
    pencil = eig(np.block([[zero, one], [-chain.K, -chain.C]]), np.block([[one, zero], [zero, chain.M]]), right=False)
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(s.F[: 2 * r, : 2 * r])), np.sort_complex(pencil), rtol=1e-8
    )
    np.testing.assert_allclose(np.diag(s.Q)[2 * r :], chain.increment**2 / chain.h)
    np.testing.assert_allclose(s.r, 1e-8 * chain.h)
    force = chain.M @ s.Q[r : 2 * r, r : 2 * r] @ chain.M / chain.h
    np.testing.assert_allclose(force, 0.25 * (chain.T.T * chain.force) @ chain.T, rtol=1e-9)


def test_a_covariance_that_grows_for_ever_is_refused():
    with pytest.raises(NumericalError, match="settle"):
        steady(np.array([[1.0]]), np.array([[0.0]]), np.array([[1.0]]), np.array([1.0]))
