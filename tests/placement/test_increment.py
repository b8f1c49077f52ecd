"""What one gauge more or less changes, against sixty digits and against its own bounds."""

from __future__ import annotations

from dataclasses import replace

import mpmath
import numpy as np
import pytest

from strainsight.placement import increment
from strainsight.placement.increment import Modes, additions, gauge_gradients, least_increments, removals
from strainsight.placement.scenario import Scenario, loop_of, solve_pool, subset_covariance

from .conftest import beam_of, covariance_in_digits, oracle, scenarios_of


def removal(pool, loop, block, rest):
    """D of one scenario where the gauge `block` leaves and `rest` remains, None where that cannot detect."""
    increments = removals([pool], Modes([loop]), [block], lambda _: rest)
    return None if increments is None else increments[0]


def addition(pool, loop, block):
    return additions([pool], Modes([loop]), [block])[0]


def sharper_bound(loop, block, W):
    modes = Modes([loop])
    return modes.sharper_bounds(modes.slopes([W])[1], modes.rows([block]))[0]


def test_a_removal_keeps_its_digits_where_a_difference_of_traces_has_none():
    (scenario,) = scenarios_of(beam_of(7, 2), ("Fz",), ("E",))
    r = scenario.r.copy()
    r[3] *= 1e9
    pool = solve_pool(Scenario(scenario.F, scenario.Q, scenario.H, r, scenario.weight))
    s, gauges = pool.scenario, np.arange(7)
    loop = loop_of(pool, gauges, pool.P)
    D = removal(pool, loop, pool.rows[3], np.delete(pool.rows, 3, axis=0))
    with mpmath.workdps(55):
        whole = covariance_in_digits(s.F, s.Q, pool.rows[:, 0], np.ones(7), pool.P)
        without = covariance_in_digits(s.F, s.Q, np.delete(pool.rows[:, 0], 3, axis=0), np.ones(6), pool.P + D)
        truth = sum(mpmath.mpf(float(w)) * (without[i, i] - whole[i, i]) for i, w in enumerate(s.weight))
    np.testing.assert_allclose(s.weight @ np.diag(D), float(truth), rtol=1e-7)


def in_blocks(scenario, channels, seed=0):
    """The single gauges of a scenario as blocks of 1 to `channels`, padded with zeros; noises differ within a block."""
    rng = np.random.default_rng(seed)
    m, n = scenario.H.shape
    count = m // channels
    size = rng.integers(1, channels + 1, count)
    size[0] = channels
    H = scenario.H[: count * channels].reshape(count, channels, n).copy()
    H[np.arange(channels) >= size[:, None]] = 0.0
    r = scenario.r[: count * channels].reshape(count, channels) * rng.uniform(0.3, 3.0, (count, channels))
    return replace(scenario, H=H, r=r)


@pytest.mark.parametrize("size", [12, 5, 3])
def test_a_block_leaves_and_comes_back_and_never_below_its_bounds(size):
    (single,) = scenarios_of(beam_of(36, 3), ("Fz",), ("E",))
    pool = solve_pool(in_blocks(single, 3))
    s, gauges = pool.scenario, np.arange(size)
    P = subset_covariance(pool, gauges)
    np.testing.assert_allclose(P, oracle(s, gauges), atol=1e-8 * np.abs(P).max())
    loop = loop_of(pool, gauges, P)
    for g in gauges:
        rest = np.delete(gauges, g)
        D = removal(pool, loop, pool.rows[g], pool.rows[rest])
        np.testing.assert_allclose(P + D, oracle(s, rest), atol=1e-7 * np.abs(P + D).max())
        rise = s.weight @ np.diag(D)
        bound = gauge_gradients([loop], [pool.rows[[g]]], [np.diag(s.weight)])[0, 0]
        sharper = sharper_bound(loop, pool.rows[g], np.diag(s.weight))
        assert bound <= sharper * (1 + 1e-12)
        assert sharper <= rise * (1 + 1e-10)
        back = addition(pool, loop_of(pool, rest, subset_covariance(pool, rest)), pool.rows[g])
        np.testing.assert_allclose(back, -D, atol=1e-7 * np.abs(D).max())


@pytest.mark.parametrize("size", [0.03, 1.0, 10.0])
def test_slope_bound_and_rise_of_walks_are_those_of_their_closed_form(size):
    """Gauges of two channels, one of them weak or strong: P = √q G^(−1/2); the bound is a₁²/(a₁ − a₂) of slope and curvature."""
    q, weight, H = 3.0, np.array([1.0, 4.0, 0.5]), np.random.default_rng(2).normal(size=(5, 2, 3))
    H[1] *= size
    pool = solve_pool(Scenario(np.zeros((3, 3)), q * np.eye(3), H, np.ones((5, 2)), weight))
    s, loop = pool.scenario, loop_of(pool, np.arange(5), pool.P)

    def cost(w):
        lam, U = np.linalg.eigh(np.tensordot(np.where(np.arange(5) == 1, w, 1.0), np.swapaxes(H, 1, 2) @ H, axes=1))
        return np.sqrt(q) * weight @ (U**2 / np.sqrt(lam)).sum(axis=1)

    h = 5e-3
    far, below, here, above, beyond = (cost(1 + k * h) for k in (-2, -1, 0, 1, 2))
    a1 = (8 * (below - above) - (far - beyond)) / (12 * h)
    a2 = (16 * (above + below) - (far + beyond) - 30 * here) / (24 * h**2)
    for unit in (1e-12, 1.0, 1e12):
        W = unit * np.diag(s.weight)
        np.testing.assert_allclose(gauge_gradients([loop], [pool.rows], [W])[0, 1], unit * a1, rtol=1e-7)
        np.testing.assert_allclose(sharper_bound(loop, pool.rows[1], W), unit * a1**2 / (a1 - a2), rtol=1e-6)
    D = removal(pool, loop, pool.rows[1], np.delete(pool.rows, 1, axis=0))
    np.testing.assert_allclose(s.weight @ np.diag(D), cost(0.0) - here, rtol=1e-8)


def test_the_least_increments_are_slopes_of_the_covariance_and_no_direction_gets_less():
    """Oracle: whole pools, one gauge of which has a weight of 1 ± 1e-4, or of nothing."""
    (scenario,) = scenarios_of(beam_of(10), ("Fz", "Fy"), ("E",))
    pool = solve_pool(scenario)
    loop, at = loop_of(pool, np.arange(10), pool.P), pool.metric.states
    found, doubt = least_increments(loop, pool.rows @ loop.P, at)
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


def test_removal_that_loses_unknown_is_detected():
    (scenario,) = scenarios_of(beam_of(30), ("Fz", "Fy"), ("E",))
    pool = solve_pool(scenario)
    gauges = np.arange(3)
    P = subset_covariance(pool, gauges)
    for g in gauges:
        rest = pool.rows[np.delete(gauges, g)]
        loop = loop_of(pool, gauges, P)
        assert removal(pool, loop, pool.rows[g], rest) is None
    assert subset_covariance(pool, gauges[:2]) is None


def test_a_removal_that_costs_a_millionfold_is_still_finite_and_right():
    (scenario,) = scenarios_of(beam_of(12), ("Fz",), ("E",))
    r = scenario.r.copy()
    r[2:] *= 1e8
    pool = solve_pool(Scenario(scenario.F, scenario.Q, scenario.H, r, scenario.weight))
    s, gauges = pool.scenario, np.arange(12)
    D = removal(pool, loop_of(pool, gauges, pool.P), pool.rows[0], pool.rows[1:])
    rest = Scenario(scenario.F, scenario.Q, scenario.H[1:], r[1:], scenario.weight)
    own = solve_pool(rest)
    exact = own.scenario.weight @ np.diag(own.P)
    np.testing.assert_allclose(s.weight @ np.diag(pool.P + D), exact, rtol=1e-7)
    assert exact > 20 * (s.weight @ np.diag(pool.P))


@pytest.mark.parametrize("way", ["rounding ends it", "Newton", "anew"])
@pytest.mark.parametrize("size", [3, 12])
def test_every_way_to_an_increment_ends_at_the_same_one(monkeypatch, size, way):
    (scenario,) = scenarios_of(beam_of(40), ("Fz",), ("E",))
    pool = solve_pool(scenario)
    few, many = np.arange(size), np.append(np.arange(size), 39)
    without, grown = (subset_covariance(pool, gauges) for gauges in (few, many))
    if way == "rounding ends it":
        monkeypatch.setattr(increment, "CONVERGED", 0.0)
    else:
        monkeypatch.setattr(increment, "CONDITION", 0.0)
    if way == "anew":
        monkeypatch.setattr(increment, "_newton", lambda *_: None)
    D = addition(pool, loop_of(pool, few, without), pool.rows[39])
    back = removal(pool, loop_of(pool, many, grown), pool.rows[39], pool.rows[few])
    for found in (D, -back):
        np.testing.assert_allclose(found, grown - without, atol=1e-8 * np.abs(without).max())


def test_scenarios_of_different_sizes_have_their_own_increments():
    """All at once, padded, as each alone: removals, additions, slopes and sharper bounds."""
    pools = [solve_pool(s) for modes in (1, 2, 3) for s in scenarios_of(beam_of(9, modes), ("Fz",), ("E",))]
    assert len({len(pool.P) for pool in pools}) == 3
    few, many = np.arange(4), np.arange(5)
    loops, grown = ([loop_of(p, g, subset_covariance(p, g)) for p in pools] for g in (few, many))
    W = [np.diag(pool.scenario.weight) for pool in pools]
    D = additions(pools, Modes(loops), [pool.rows[4] for pool in pools])
    back = removals(pools, Modes(grown), [pool.rows[4] for pool in pools], lambda i: pools[i].rows[few])
    modes = Modes(grown)
    blocks = modes.rows([pool.rows[many] for pool in pools]).swapaxes(0, 1)
    bounds, slope = modes.sharper_bounds(modes.slopes(W)[1], blocks), gauge_gradients(grown, [p.rows[many] for p in pools], W)
    for i, pool in enumerate(pools):
        with_and_without = [oracle(pool.scenario, gauges) for gauges in (many, few)]
        for found in (-D[i], back[i]):
            np.testing.assert_allclose(found, with_and_without[1] - with_and_without[0], atol=1e-7 * np.abs(D[i]).max())
        np.testing.assert_allclose(slope[i], gauge_gradients([grown[i]], [pool.rows[many]], [W[i]])[0], rtol=1e-9)
        for g in many:
            assert bounds[g, i] == pytest.approx(sharper_bound(grown[i], pool.rows[g], W[i]), rel=1e-7)
