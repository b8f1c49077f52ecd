"""The linear bench of a placement: its steady filter against a textbook recursion, its motion against a linear system's."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.linalg import block_diag, eig, solve_discrete_are

from strainsight.experiment.bench.layout.expectation import expected_std, scenario_of
from strainsight.multibody.inverse.linear import LinearBench, build_discrete_model, in_modes
from strainsight.multibody.step import Method

R_STATES, NU = 4, 2


@dataclass(frozen=True)
class Chain:
    """M ÿ + C ẏ + K y = B u in coordinates of its own, q = T y, and the bench made of it."""

    T: np.ndarray
    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    B: np.ndarray
    increment: np.ndarray
    force: np.ndarray
    h: float = 0.02
    method: Method = "second_order"

    @property
    def bench(self) -> LinearBench:
        return in_modes(self.T, self.M, self.C, self.K, self.B, self.increment, self.force, self.h, self.method)


@pytest.fixture(scope="module")
def chain() -> Chain:
    """Four coupled masses, two of them loaded, in skewed coordinates."""
    rng = np.random.default_rng(3)
    K = 1e4 * (2.2 * np.eye(R_STATES) - np.eye(R_STATES, k=1) - np.eye(R_STATES, k=-1))
    turn = np.linalg.qr(rng.standard_normal((R_STATES, R_STATES)))[0]
    M = turn.T @ np.diag([1.0, 2.0, 1.5, 0.5]) @ turn
    K = turn.T @ K @ turn
    B = turn.T @ np.eye(R_STATES)[:, [1, 3]]
    T = rng.standard_normal((6, R_STATES))
    return Chain(T, M, 0.01 * M + 1e-5 * K, K, B, np.array([3.0, 0.5]), rng.uniform(1, 2, 6))


def kalman(chain, rows, noise, acceleration, steps):
    """The Butcher tableau of the method on ż = F z + G(Bu + w), u straight in a step, one step after the other from a wide start,
    in plain textbook form, a gauge at a time, with 19 digits where the machine has them."""
    h, r, nu = chain.h, len(chain.M), chain.B.shape[1]
    inverse, none, g = np.linalg.inv(chain.M), np.zeros((r, r)), 1 - 0.5**0.5
    F, G = np.block([[none, np.eye(r)], [-inverse @ chain.K, -inverse @ chain.C]]), np.vstack([none, inverse])
    table = np.array([[1.0]]) if chain.method == "thesis" else np.array([[g, 0.0], [1 - g, g]])
    instants = table.sum(axis=1)
    # slopes of all stages: (1 − h a ⊗ F) k = 1 ⊗ F z + G B (u + c δ) + G w;  z' = z + h Σ bᵢkᵢ, b the last row
    k = np.linalg.inv(np.eye(2 * r * len(table)) - h * np.kron(table, F))
    weigh = h * np.kron(table[-1:], np.eye(2 * r)) @ k
    ones = np.ones((len(table), 1))
    by_z, by_f = np.eye(2 * r) + weigh @ np.kron(ones, F), weigh @ np.kron(ones, G)
    by_d = weigh @ np.kron(instants[:, None], G @ chain.B)
    zero = np.zeros((nu, 2 * r))
    A = np.block([[by_z, by_f @ chain.B], [zero, np.eye(nu)]]).astype(np.longdouble)
    D = np.vstack([by_d, np.eye(nu)]) * chain.increment
    W = np.zeros_like(A)
    W[: 2 * r, : 2 * r] = by_f @ (acceleration**2 * chain.T.T @ np.diag(chain.force) @ chain.T) @ by_f.T
    W += D @ D.T
    P = np.diag(np.concatenate([np.zeros(2 * r), 1e6 * chain.increment**2])).astype(np.longdouble)
    for _ in range(steps):
        P = A @ P @ A.T + W
        for row in rows @ chain.T:
            Ph = P[:, :r] @ row
            P = P - np.outer(Ph, Ph) / (row @ Ph[:r] + noise**2)
        P = 0.5 * (P + P.T)
    return np.sqrt(np.diag(P)[2 * r :])


@pytest.mark.parametrize("method", ["second_order", "thesis"])
@pytest.mark.parametrize("acceleration", [0.0, 0.3])
@pytest.mark.parametrize("noise", [1e-3, 1e-5, 1e-7])
def test_the_expected_std_is_that_of_a_filter_after_many_steps(chain, noise, acceleration, method):
    chain = replace(chain, method=method)
    rows = np.random.default_rng(0).standard_normal((3, 6))
    found = expected_std(chain.bench, chain.bench.readings(rows), noise, acceleration)
    np.testing.assert_allclose(found, kalman(chain, rows, noise, acceleration, 1000).astype(float), rtol=1e-9)


def test_a_mode_that_nothing_moves_but_rounding_changes_no_std(chain):

    def beside(X, own, coupling):
        return np.block([[X, np.full((R_STATES, 1), coupling)], [np.full((1, R_STATES), coupling), own]])

    rows, one = np.random.default_rng(0).standard_normal((2, 7)), np.ones((1, 1))
    more = Chain(
        block_diag(chain.T, one),
        beside(chain.M, one, 1e-17),
        beside(chain.C, one, 1e-16),
        beside(chain.K, 5e3 * one, 1e-13),
        np.vstack([chain.B, [1e-17, -1e-17]]),
        chain.increment,
        np.append(chain.force, 1.0),
    )
    found, alone = (
        expected_std(own.bench, own.bench.readings(H), 1e-4, 0.0) for own, H in ((more, rows), (chain, rows[:, :6]))
    )
    np.testing.assert_allclose(found, alone, rtol=1e-11)


@pytest.mark.parametrize("length", [1e-3, 1e3])
@pytest.mark.parametrize("mass", [1e-3, 1e3])
def test_units_are_in_no_std(chain, length, mass):
    rows, force = np.random.default_rng(0).standard_normal((3, 6)), mass * length
    other = replace(
        chain,
        M=mass * chain.M,
        C=mass * chain.C,
        K=mass * chain.K,
        increment=force * chain.increment,
        force=mass**2 * chain.force,
    )
    np.testing.assert_allclose(
        expected_std(other.bench, other.bench.readings(rows / length), 1e-4, 0.3 * length),
        force * expected_std(chain.bench, chain.bench.readings(rows), 1e-4, 0.3),
        rtol=1e-11,
    )


def test_a_load_that_does_not_show_has_no_std(chain):
    rows = np.random.default_rng(0).standard_normal((1, 6))
    assert np.all(np.isinf(expected_std(chain.bench, chain.bench.readings(rows), 1e-4, 0.0)))
    assert np.all(np.isinf(expected_std(chain.bench, chain.bench.readings(np.vstack([rows, 2 * rows])), 1e-4, 0.0)))


def test_modes_are_turned_and_signed_by_what_they_do(chain):
    """Two equal masses on equal springs: any combination is a mode; coordinates that begin in another place choose none."""
    turn = np.linalg.qr(np.random.default_rng(5).standard_normal((2, 2)))[0]
    T, one, C, B = np.array([[1.0, 0.3], [0.2, 1.0], [0.5, 0.5]]), np.eye(2), np.diag([0.1, 0.2]), np.eye(2)
    whole = (np.ones(2), np.ones(3), 0.02, "second_order")
    first = in_modes(T, one, C, 4.0 * one, B, *whole)
    second = in_modes(T @ turn, one, turn.T @ C @ turn, 4.0 * one, turn.T @ B, *whole)
    for name in ("T", "C", "stiffness", "B"):
        np.testing.assert_allclose(getattr(first, name), getattr(second, name), atol=1e-13)
    np.testing.assert_allclose(first.T @ first.T.T, T @ T.T, atol=1e-13)


def test_the_scenario_moves_as_the_bench_does(chain):
    """Rest under a load, eigenvalues of λ²M + λC + K, and noise as intensities of what happens in a step."""
    rows, bench = np.random.default_rng(1).standard_normal((2, 6)), chain.bench
    s = scenario_of(bench, bench.readings(rows), 1e-4, 0.5)
    r = R_STATES
    static = chain.T @ np.linalg.solve(chain.K, chain.B)
    np.testing.assert_allclose(bench.static, static, rtol=1e-9)
    rest = np.vstack([bench.B / bench.stiffness[:, None], np.zeros((r, NU)), np.eye(NU)])
    np.testing.assert_allclose(s.F @ rest, 0.0, atol=1e-9)
    np.testing.assert_allclose(s.H @ rest, rows @ static, rtol=1e-9)
    zero, one = np.zeros((r, r)), np.eye(r)
    pencil = eig(np.block([[zero, one], [-chain.K, -chain.C]]), np.block([[one, zero], [zero, chain.M]]), right=False)
    # ordered by their imaginary parts: the real ones of a conjugate pair are equal but for rounding
    own = np.linalg.eigvals(s.F[: 2 * r, : 2 * r])
    np.testing.assert_allclose(np.sort_complex(-1j * own), np.sort_complex(-1j * pencil), rtol=1e-8)
    np.testing.assert_allclose(np.diag(s.Q)[2 * r :], chain.increment**2 / chain.h)
    np.testing.assert_allclose(s.r, 1e-8 * chain.h)
    # of q, so in no coordinates of the bench's own
    shaken = chain.T @ np.linalg.solve(chain.M, chain.T.T * np.sqrt(chain.force))
    np.testing.assert_allclose(
        bench.T @ s.Q[r : 2 * r, r : 2 * r] @ bench.T.T, 0.25 * chain.h * shaken @ shaken.T, rtol=1e-9
    )


@pytest.mark.parametrize("method", ["second_order", "thesis"])
def test_constant_errors_of_gauges_add_what_a_filter_that_knows_nothing_of_them_leaves(chain, method):
    """scipy's Riccati equation, then errors of the readings as states that the gain does not touch, step after step."""
    chain, rows = replace(chain, method=method), np.random.default_rng(0).standard_normal((3, 6))
    off, noise = np.array([2e-4, 0.0, 5e-5]), 1e-4
    bench = chain.bench
    found = expected_std(bench, bench.readings(rows), noise, 0.3, off)
    A, N, scale = build_discrete_model(bench, 0.3)
    H = np.asarray(bench.readings(rows) * scale)
    before = solve_discrete_are(A.T, H.T, N @ N.T, noise**2 * np.eye(3))
    K = before @ H.T @ np.linalg.inv(H @ before @ H.T + noise**2 * np.eye(3))
    n = len(A)
    kept = np.block([[A, np.zeros((n, 3))], [np.zeros((3, n)), np.eye(3)]])
    seen = np.hstack([H, np.diag(off)])
    gain = np.vstack([K, np.zeros((3, 3))])
    P = np.diag(np.concatenate([np.zeros(n), np.ones(3)]))
    for _ in range(3000):
        P = kept @ P @ kept.T
        P[:n, :n] += N @ N.T
        P = (np.eye(n + 3) - gain @ seen) @ P @ (np.eye(n + 3) - gain @ seen).T + noise**2 * gain @ gain.T
    np.testing.assert_allclose(found, np.sqrt(np.diag(P)[n - NU : n]) * bench.increment, rtol=1e-7)
    exact = expected_std(bench, bench.readings(rows), noise, 0.3)
    assert np.all(found > exact)


def test_noise_as_printed_moves_nothing_in_its_step(chain):
    """Then σ of a load is at least its increment, whatever was measured: a textbook recursion with Q* after the step."""
    rows, noise = np.random.default_rng(0).standard_normal((3, 6)), 1e-6
    bench = replace(chain.bench, printed=True)
    A, _, scale = build_discrete_model(bench, 0.0)
    H, n = bench.readings(rows) * scale, len(A)
    Q = np.diag(np.concatenate([np.zeros(n - NU), np.ones(NU)]))
    P = Q.copy()
    for _ in range(2000):
        P = A @ P @ A.T + Q
        S = H @ P @ H.T + noise**2 * np.eye(3)
        P = P - P @ H.T @ np.linalg.solve(S, H @ P)
        P = 0.5 * (P + P.T)
    found = expected_std(bench, bench.readings(rows), noise, 0.0)
    np.testing.assert_allclose(found, np.sqrt(np.diag(P)[n - NU :]) * bench.increment, rtol=1e-6)
    assert np.all(found > bench.increment)
