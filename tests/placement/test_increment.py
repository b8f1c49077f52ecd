"""What one gauge more or less changes, against sixty digits and against its own bounds."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from strainsight.placement import increment
from strainsight.placement.increment import (
    addition,
    gauge_gradients,
    least_increments,
    removal,
    sharper_bound,
    slopes,
)
from strainsight.placement.scenario import Scenario, loop_of, solve_pool, subset_covariance


def kleinman_in_fifty_digits(F, Q, rows, start):
    """Newton steps with the Lyapunov equation as one linear system, in multiple precision."""
    with mpmath.workdps(50):
        n = len(F)
        f, q, H, P = (mpmath.matrix(m.tolist()) for m in (F, Q, rows, start))
        G = H.T * H
        pairs = [(i, j) for i in range(n) for j in range(i, n)]
        at = {pair: k for k, pair in enumerate(pairs)}
        for _ in range(3):
            A, S = f - P * G, q + P * G * P
            system, right = mpmath.zeros(len(pairs)), mpmath.zeros(len(pairs), 1)
            for (i, j), k in at.items():
                right[k] = -S[i, j]
                for l in range(n):
                    system[k, at[min(l, j), max(l, j)]] += A[i, l]
                    system[k, at[min(i, l), max(i, l)]] += A[j, l]
            solution = mpmath.lu_solve(system, right)
            P = mpmath.matrix(n, n)
            for (i, j), k in at.items():
                P[i, j] = P[j, i] = solution[k]
        return P


def test_a_removal_keeps_its_digits_where_a_difference_of_traces_has_none(beam_of, scenarios_of):
    (scenario,) = scenarios_of(beam_of(7, 2), ("Fz",), ("E",))
    r = scenario.r.copy()
    r[3] *= 1e9
    pool = solve_pool(Scenario(scenario.F, scenario.Q, scenario.H, r, scenario.weight))
    s, gauges = pool.scenario, np.arange(7)
    loop = loop_of(pool, gauges, pool.P)
    D = removal(s.F, s.Q, loop, pool.rows[3], lambda: np.delete(pool.rows, 3, axis=0), pool.modes)
    with mpmath.workdps(50):
        whole = kleinman_in_fifty_digits(s.F, s.Q, pool.rows[:, 0], pool.P)
        without = kleinman_in_fifty_digits(s.F, s.Q, np.delete(pool.rows[:, 0], 3, axis=0), pool.P + D)
        truth = sum(mpmath.mpf(float(w)) * (without[i, i] - whole[i, i]) for i, w in enumerate(s.weight))
    np.testing.assert_allclose(s.weight @ np.diag(D), float(truth), rtol=1e-7)


@pytest.mark.parametrize(("inputs", "parameters"), [((), ("E",)), (("Fz",), ()), (("Fz", "Fy"), ("E",))])
@pytest.mark.parametrize("size", [40, 4])
def test_bounds_never_exceed_the_exact_rise_and_touch_it_in_the_limit(beam_of, scenarios_of, inputs, parameters, size):
    (scenario,) = scenarios_of(beam_of(40), inputs, parameters)
    pool = solve_pool(scenario)
    s, gauges = pool.scenario, np.arange(size)
    P = subset_covariance(pool, gauges)
    loop = loop_of(pool, gauges, P)
    bounds = gauge_gradients(loop, pool.rows[gauges], np.diag(s.weight))
    shared = slopes(loop, np.diag(s.weight))
    for g in gauges:
        D = removal(s.F, s.Q, loop, pool.rows[g], lambda g=g: pool.rows[np.delete(gauges, g)], pool.modes)
        fresh = subset_covariance(pool, np.delete(gauges, g))
        np.testing.assert_allclose(P + D, fresh, atol=1e-8 * np.abs(fresh).max())
        rise = s.weight @ np.diag(D)
        sharper = sharper_bound(shared, pool.rows[g])
        assert bounds[g] <= sharper * (1 + 1e-12)
        assert sharper <= rise * (1 + 1e-10)
        if rise < 1e-5:
            np.testing.assert_allclose(bounds[g], rise, rtol=1e-2)
            np.testing.assert_allclose(sharper, rise, rtol=1e-4)


def test_the_least_increments_are_slopes_of_the_covariance_and_no_direction_gets_less(beam_of, scenarios_of):
    """Oracle: whole pools, one gauge of which has a weight of 1 ± 1e-4, or of nothing."""
    (scenario,) = scenarios_of(beam_of(10), ("Fz", "Fy"), ("E",))
    pool = solve_pool(scenario)
    loop, at = loop_of(pool, np.arange(10), pool.P), pool.metric.states
    found, doubt = least_increments(loop, pool.rows @ loop.P @ loop.U, at)
    units = np.outer(pool.scale[at], pool.scale[at])

    def covariance(g, weight):
        r = scenario.r.copy()
        r[g] /= weight
        other = solve_pool(Scenario(scenario.F, scenario.Q, scenario.H, r, scenario.weight))
        return other.P[np.ix_(at, at)] * np.outer(other.scale[at], other.scale[at]) / units

    here = covariance(0, 1.0)
    for g in range(10):
        slope = (covariance(g, 1 - 1e-4) - covariance(g, 1 + 1e-4)) / 2e-4
        np.testing.assert_allclose(found[g], slope, rtol=1e-4, atol=1e-8)
        assert np.linalg.eigvalsh(covariance(g, 1e-12) - here - found[g]).min() > -1e-9
    assert doubt.max() < 1e-6 * np.abs(found).max()


@pytest.mark.parametrize("size", [3, 39])
def test_an_addition_is_undone_by_its_removal(beam_of, scenarios_of, size):
    (scenario,) = scenarios_of(beam_of(40), ("Fz",), ("E",))
    pool = solve_pool(scenario)
    s, gauges, new = pool.scenario, np.arange(size), 39
    P = subset_covariance(pool, gauges)
    D = addition(s.F, s.Q, loop_of(pool, gauges, P), pool.rows[new])
    grown = subset_covariance(pool, [*gauges, new])
    np.testing.assert_allclose(P + D, grown, atol=1e-9 * np.abs(P).max())
    back = removal(
        s.F, s.Q, loop_of(pool, [*gauges, new], grown), pool.rows[new], lambda: pool.rows[gauges], pool.modes
    )
    np.testing.assert_allclose(back, -D, atol=1e-7 * np.abs(D).max())
    assert np.linalg.eigvalsh(D).max() < 1e-9


def test_a_removal_that_loses_an_unknown_says_so_by_test(beam_of, scenarios_of):
    (scenario,) = scenarios_of(beam_of(30), ("Fz", "Fy"), ("E",))
    pool = solve_pool(scenario)
    gauges = np.arange(3)
    P = subset_covariance(pool, gauges)
    for g in gauges:
        rest = pool.rows[np.delete(gauges, g)]
        loop = loop_of(pool, gauges, P)
        assert removal(pool.scenario.F, pool.scenario.Q, loop, pool.rows[g], lambda rest=rest: rest, pool.modes) is None
    assert subset_covariance(pool, gauges[:2]) is None


def test_a_removal_that_costs_a_millionfold_is_still_finite_and_right(beam_of, scenarios_of):
    (scenario,) = scenarios_of(beam_of(12), ("Fz",), ("E",))
    r = scenario.r.copy()
    r[2:] *= 1e8
    pool = solve_pool(Scenario(scenario.F, scenario.Q, scenario.H, r, scenario.weight))
    s, gauges = pool.scenario, np.arange(12)
    D = removal(s.F, s.Q, loop_of(pool, gauges, pool.P), pool.rows[0], lambda: pool.rows[1:], pool.modes)
    rest = Scenario(scenario.F, scenario.Q, scenario.H[1:], r[1:], scenario.weight)
    own = solve_pool(rest)
    exact = own.scenario.weight @ np.diag(own.P)
    np.testing.assert_allclose(s.weight @ np.diag(pool.P + D), exact, rtol=1e-7)
    assert exact > 20 * (s.weight @ np.diag(pool.P))


@pytest.mark.parametrize("unit", [1e-12, 1e12])
def test_bounds_are_in_the_unit_of_the_weight(beam_of, scenarios_of, unit):
    (scenario,) = scenarios_of(beam_of(12), ("Fz",), ("E",))
    pool = solve_pool(scenario)
    loop, W = loop_of(pool, np.arange(12), pool.P), np.diag(pool.scenario.weight)
    np.testing.assert_allclose(
        gauge_gradients(loop, pool.rows, unit * W), unit * gauge_gradients(loop, pool.rows, W), rtol=1e-9
    )
    for block in pool.rows:
        np.testing.assert_allclose(
            sharper_bound(slopes(loop, unit * W), block),
            unit * sharper_bound(slopes(loop, W), block),
            rtol=1e-6,
        )


@pytest.mark.parametrize("share", [1e-6, 0.1, 0.9])
def test_both_bounds_of_a_walk_are_those_of_its_closed_form(share):
    """One walk: p(w) = √q / √(g₀ + w g₁); its slope and its curvature at w = 1 are p g₁/2g and 3p g₁²/8g², g = g₀ + g₁."""
    q, g = 3.0, 7.0
    s = Scenario(
        np.zeros((1, 1)), np.full((1, 1), q), np.sqrt([[g * (1 - share)], [g * share]]), np.ones(2), np.ones(1)
    )
    pool = solve_pool(s)
    loop, W = loop_of(pool, [0, 1], pool.P), np.diag(pool.scenario.weight)
    p = np.sqrt(q / g)
    a1, a2 = p * share / 2, 3 * p * share**2 / 8
    np.testing.assert_allclose(gauge_gradients(loop, pool.rows, W)[1], a1, rtol=1e-9)
    np.testing.assert_allclose(sharper_bound(slopes(loop, W), pool.rows[1]), a1**2 / (a1 - a2), rtol=1e-8)
    D = removal(pool.scenario.F, pool.scenario.Q, loop, pool.rows[1], lambda: pool.rows[:1], pool.modes)
    np.testing.assert_allclose(np.vdot(W, D), p * ((1 - share) ** -0.5 - 1), rtol=1e-9)


@pytest.mark.parametrize("way", ["rounding ends it", "Newton", "anew"])
@pytest.mark.parametrize("size", [3, 12])
def test_every_way_to_an_increment_ends_at_the_same_one(monkeypatch, beam_of, scenarios_of, size, way):
    (scenario,) = scenarios_of(beam_of(40), ("Fz",), ("E",))
    pool = solve_pool(scenario)
    s, few, many = pool.scenario, np.arange(size), np.append(np.arange(size), 39)
    without, grown = (subset_covariance(pool, gauges) for gauges in (few, many))
    if way == "rounding ends it":
        monkeypatch.setattr(increment, "CONVERGED", 0.0)
    else:
        monkeypatch.setattr(increment, "_fixed_point", lambda *_: None)
    if way == "anew":
        monkeypatch.setattr(increment, "_newton", lambda *_: None)
    D = addition(s.F, s.Q, loop_of(pool, few, without), pool.rows[39])
    back = removal(s.F, s.Q, loop_of(pool, many, grown), pool.rows[39], lambda: pool.rows[few], pool.modes)
    for found in (D, -back):
        np.testing.assert_allclose(found, grown - without, atol=1e-8 * np.abs(without).max())
