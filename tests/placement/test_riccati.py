"""The steady covariance against sixty digits, closed forms and its own equation."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from strainsight.errors import InfeasibleError, NumericalError
from strainsight.placement import riccati
from strainsight.placement.riccati import (
    Information,
    balance,
    close_loop,
    factor_after,
    information,
    lyapunov,
    relative_residual,
    solve_anew,
    solve_care,
    steady_factor,
)
from strainsight.placement.scenario import Scenario, loop_of, solve_pool, subset_covariance

from .conftest import beam_of, residual, scenarios_of, with_accelerometers


def covariance_in_sixty_digits(F, Q, rows):
    """Stable eigenvectors of the Hamiltonian in multiple precision."""
    with mpmath.workdps(60):
        n = len(F)
        H = mpmath.matrix(rows.tolist())
        G, f, q = H.T * H, mpmath.matrix(F.tolist()), mpmath.matrix(Q.tolist())
        hamiltonian = mpmath.zeros(2 * n)
        for i in range(n):
            for j in range(n):
                hamiltonian[i, j], hamiltonian[i, n + j] = f[j, i], -G[i, j]
                hamiltonian[n + i, j], hamiltonian[n + i, n + j] = -q[i, j], -f[i, j]
        values, vectors = mpmath.eig(hamiltonian)
        stable = [k for k in range(2 * n) if mpmath.re(values[k]) < 0]
        assert len(stable) == n
        U1 = mpmath.matrix([[vectors[i, k] for k in stable] for i in range(n)])
        U2 = mpmath.matrix([[vectors[n + i, k] for k in stable] for i in range(n)])
        P = U2 * mpmath.inverse(U1)
        return np.array([[float(mpmath.re(P[i, j])) for j in range(n)] for i in range(n)])


PRECISE = [  # strain noise, share of the unknowns' acceleration that is noise
    (("Fz", "Fy"), ("E",), 1e-6, 1e-6),
    (("Fz",), ("E", "rho"), 1e-4, 1e-4),
    (("Fz",), ("E",), 1e-6, 1e-8),
]


@pytest.mark.parametrize(("inputs", "parameters", "noise", "precision"), PRECISE)
def test_precise_accelerometers_with_strain_match_sixty_digits(
    inputs, parameters, noise, precision
):
    # the sum HᵀR⁻¹H alone left errors of 3e-8 to 1e-3 here, or no solution within 1e-10
    (strain,) = scenarios_of(beam_of(12, 2), inputs, parameters, noise=noise)
    pool = solve_pool(with_accelerometers(strain, 2, precision))
    assert pool.residual < 2e-11
    assert residual(pool.scenario, pool.P) < 2e-11
    truth = covariance_in_sixty_digits(pool.scenario.F, pool.scenario.Q, pool.rows[:, 0])
    np.testing.assert_allclose(pool.P, truth, rtol=0, atol=2e-8)


def test_a_set_with_a_precise_accelerometer_agrees_with_sixty_digits():
    (strain,) = scenarios_of(beam_of(12, 2), ("Fz",), ("E",), noise=1e-4)
    pool = solve_pool(with_accelerometers(strain, 2, 1e-4))
    gauges = [1, 5, 8, 12]
    P = subset_covariance(pool, gauges)
    truth = covariance_in_sixty_digits(pool.scenario.F, pool.scenario.Q, pool.rows[gauges, 0])
    np.testing.assert_allclose(P, truth, rtol=0, atol=1e-9 * truth.max())
    h = pool.rows[gauges, 0]
    with mpmath.workdps(40):
        H, exact = mpmath.matrix(h.tolist()), mpmath.matrix(truth.tolist())
        A = mpmath.matrix(pool.scenario.F.tolist()) - (exact * H.T) * H
        slowest = max(float(mpmath.re(value)) for value in mpmath.eig(A, left=False, right=False))
    np.testing.assert_allclose(loop_of(pool, gauges, P).abscissa, slowest, rtol=1e-6)


@pytest.mark.parametrize("noise", [1e-9, 1e-6, 1e-4])
@pytest.mark.parametrize(("modes", "parameters", "inputs"), [(9, ("E",), ()), (10, ("E",), ("Fz",)), (14, (), ("Fz",))])
def test_residual_of_21_to_31_states_is_below_1e10(noise, modes, inputs, parameters):
    (scenario,) = scenarios_of(beam_of(60, modes), inputs, parameters, noise=noise)
    pool = solve_pool(scenario)
    assert residual(pool.scenario, pool.P) < 1e-10
    assert pool.residual < 1e-12
    assert np.linalg.eigvalsh(pool.P).min() > -1e-12 * len(pool.P)
    reached = np.diag(pool.P) > 1e-6
    np.testing.assert_allclose(np.diag(pool.P)[reached], 1.0, rtol=1e-5)
    np.testing.assert_allclose(pool.scenario.F * pool.scale[:, None] / pool.scale, scenario.F, rtol=1e-12)


def test_one_state_has_its_closed_form():
    for f, q, g in [(0.0, 1e-8, 1e12), (-3.0, 2.0, 5.0), (4.0, 1e-3, 1e3)]:
        P = solve_care(np.array([[f]]), np.array([[q]]), Information(np.array([[g]])))
        np.testing.assert_allclose(P[0, 0], (f + np.sqrt(f * f + q * g)) / g, rtol=1e-12)


def test_the_residual_is_a_share_of_what_is_added_up():
    """f = −3, q = 2, g = 5 and P = 1, where nothing cancels by chance: |2fP + q − gP²| / (2|fP| + q + gP²) = 9/13."""
    F, Q, G, P = (np.array([[value]]) for value in (-3.0, 2.0, 5.0, 1.0))
    assert relative_residual(F, Q, Information(G), P) == pytest.approx(9 / 13, rel=1e-14)


def test_without_any_gauge_what_decays_is_known_by_its_own_spread():
    """An oscillator under white noise of intensity q: var x = q/(4ζω³), var ẋ = q/(4ζω) (Crandall and Mark, 1963)."""
    omega, zeta, q = 7.0, 0.03, 2.5
    F, Q = np.array([[0, 1], [-(omega**2), -2 * zeta * omega]]), np.diag([0, q])
    spread = np.diag([q / (4 * zeta * omega**3), q / (4 * zeta * omega)])
    np.testing.assert_allclose(solve_care(F, Q, Information(np.zeros((2, 2)))), spread, atol=1e-12 * spread.max())
    pool = solve_pool(Scenario(F, Q, np.array([[1.0, 0]]), np.array([1e-3]), np.ones(2)))
    P = subset_covariance(pool, []) * np.outer(pool.scale, pool.scale)
    np.testing.assert_allclose(P, spread, atol=1e-9 * spread.max())
    with pytest.raises(NumericalError, match="unstable: errors grow at a rate of 1 1/s"):
        solve_care(np.array([[1.0]]), np.array([[1.0]]), Information(np.zeros((1, 1))))


def test_what_no_noise_reaches_keeps_a_share_of_the_largest_scale_whatever_that_is():
    """Two states that decay, of which noise of intensity q reaches the first: var x = q/2 without a gauge."""
    F = np.diag([-1.0, -1.0])
    for q in (1e-12, 1.0, 1e12):
        d, P = balance(F, np.diag([q, 0.0]), Information(np.zeros((2, 2))))
        np.testing.assert_allclose(d, np.sqrt(q / 2) * np.array([1, 1e-8]), rtol=1e-6)
        np.testing.assert_allclose(P, np.diag([1.0, 0.0]), atol=1e-6)


@pytest.mark.parametrize("fault", ["none", "not solved", "far off", "always far off"])
def test_where_the_coordinates_at_hand_fail_balanced_ones_are_taken(monkeypatch, fault):
    (scenario,) = scenarios_of(beam_of(9, 3), ("Fz",), ("E",))
    pool = solve_pool(scenario)
    unit = 10.0 ** np.random.default_rng(0).uniform(-2, 2, len(scenario.F))
    other, calls = scenario.scaled(unit), []

    def at_fault(F, Q, G):
        calls.append(1)
        if fault == "always far off" or (fault == "far off" and len(calls) == 1):
            return solve_care(F, Q, G) * 1.01
        if fault == "not solved" and len(calls) == 1:
            raise NumericalError("not solved")
        return solve_care(F, Q, G)

    monkeypatch.setattr(riccati, "solve_care", at_fault)
    arguments = (other.F, other.Q, information(other.rows[:, 0]))
    if fault == "always far off":
        with pytest.raises(NumericalError, match=r"a set of gauges is solved with a relative residual of .*; the tolerance is"):
            solve_anew(*arguments)
        return
    P = solve_anew(*arguments)
    assert (len(calls) > 1) == (fault != "none")
    np.testing.assert_allclose(P * np.outer(unit / pool.scale, unit / pool.scale), pool.P, atol=1e-9)


def test_coordinates_that_do_not_settle_still_belong_to_their_covariance(monkeypatch):
    (scenario,) = scenarios_of(beam_of(9, 3), ("Fz",), ("E",))
    d, P = balance(scenario.F, scenario.Q, information(scenario.rows[:, 0]))
    factor = []

    def unsettled(F, Q, G):
        factor.append(3.0 ** (-1) ** len(factor))
        return factor[-1] * solve_care(F, Q, G)

    monkeypatch.setattr(riccati, "solve_care", unsettled)
    other, Q = balance(scenario.F, scenario.Q, information(scenario.rows[:, 0]))
    np.testing.assert_allclose(Q * np.outer(other / d, other / d), factor[-1] * P, atol=1e-9)


def test_lyapunov_solutions_satisfy_their_equations_and_are_adjoint():
    rng = np.random.default_rng(4)
    A = rng.normal(size=(9, 9)) - 5 * np.eye(9)
    loop = close_loop(A, Information(np.zeros((9, 9))), np.zeros((9, 9)))
    S, W = (m @ m.T for m in rng.normal(size=(2, 9, 9)))
    Y, X = lyapunov(loop, S), lyapunov(loop, W, adjoint=True)
    np.testing.assert_allclose(A @ Y + Y @ A.T, -S, atol=1e-12)
    np.testing.assert_allclose(A.T @ X + X @ A, -W, atol=1e-12)
    np.testing.assert_allclose(np.trace(W @ Y), np.trace(X @ S), rtol=1e-12)
    assert loop.stable
    np.testing.assert_allclose(loop.abscissa, np.linalg.eigvals(A).real.max(), rtol=1e-10)


def test_a_filter_without_process_noise_is_refused():
    with pytest.raises(NumericalError, match="process noise is zero"):
        solve_care(np.array([[0.0]]), np.zeros((1, 1)), Information(np.eye(1)))


def test_an_undamped_motion_without_process_noise_has_no_steady_filter():
    with pytest.raises(InfeasibleError, match="has no process noise"):
        scenarios_of(beam_of(20, ratio=0.0), ("Fz",), ())
    (driven,) = scenarios_of(beam_of(20, ratio=0.0), ("Fz",), ("E",))
    assert solve_pool(driven).residual < 1e-10
    (damped,) = scenarios_of(beam_of(20, ratio=1e-4), ("Fz",), ())
    assert solve_pool(damped).residual < 1e-10


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
def test_steady_covariance_matches_recursion_limit(noise, damping, enough):
    A, H, N = system(1, damping, noise)
    before, after = stepped(A, H, N, enough, enough + 20)
    P = covariance(A, H, N)
    np.testing.assert_allclose(after, before, rtol=1e-12)  # it has come there
    std = np.sqrt(np.diag(after))
    assert np.abs((P - after) / np.outer(std, std)).max() < riccati.ACCEPTED_IN_STEPS


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
    A, H, N = system(2, 0.1, 0.1)
    more = np.zeros((7, 7))
    more[1:, 1:], more[0, 0], more[0, 1:], more[1:, 0] = A, 0.8, 1e-17, -1e-17
    P = covariance(more, np.hstack([np.ones((2, 1)), H]), np.vstack([[1e-17, -1e-17], N]))
    np.testing.assert_allclose(P[1:, 1:], covariance(A, H, N), rtol=1e-12)
    assert P[0, 0] < 1e-30


def test_undetected_states_are_found_by_test():
    walk = np.eye(2)
    assert steady_factor(walk, np.array([[1.0, 1.0]]), np.eye(2)) is None  # the sum of two walks
    assert steady_factor(np.diag([1.02, 0.5]), np.array([[0.0, 1.0]]), np.eye(2)) is None  # grows, unseen
    quarter = np.array([[0.0, 1.0], [-1.0, 0.0]])  # turns for ever, and is read in one direction: that is enough
    assert steady_factor(quarter, np.array([[1.0, 0.0]]), np.eye(2)) is not None
    with pytest.raises(InfeasibleError, match="has no process noise"):
        steady_factor(walk, np.eye(2), np.array([[1.0], [0.0]]))


def test_accuracy_that_is_not_reached_is_reported_with_its_size_and_is_no_advice(monkeypatch):
    A, H, N = system(3, 0.3, 1.0)
    monkeypatch.setattr(riccati, "MOST_DOUBLINGS", 3)
    with pytest.raises(NumericalError, match=r"solved with a relative error of \d\.\de-\d\d") as refused:
        steady_factor(A, H, N)
    assert refused.value.exit_code == 1
    assert "keep" not in refused.value.remedy
    monkeypatch.undo()
    assert steady_factor(A, H, N) is not None
    with pytest.raises(NumericalError, match="not finite: the filter is unstable"):
        steady_factor(*system(3, 0.02, 1e-18))


@pytest.mark.parametrize("steps", [1, 2, 7, 40])
def test_a_filter_after_so_many_steps_is_that_of_plain_steps(steps):
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
