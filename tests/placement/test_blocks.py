"""Gauges of several channels: rosettes, triaxial accelerometers, mirrored pairs. One weight, one removal, one failure."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import mpmath
import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from strainsight.errors import ConfigError, InfeasibleError
from strainsight.placement.branch_and_bound import branch_and_bound
from strainsight.placement.certificate import certify
from strainsight.placement.elimination import eliminate
from strainsight.placement.exchange import exchange
from strainsight.placement.failure import loss_if_one_fails, robust_set
from strainsight.placement.increment import addition, gauge_gradients, removal, sharper_bound, slopes
from strainsight.placement.remaining import Remaining, twin_groups
from strainsight.placement.scenario import fewest_gauges, loop_of, solve_pool, subset_covariance
from strainsight.placement.score import score


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


@pytest.fixture(scope="module")
def blocks(beam_of, scenarios_of):
    """A scenario of 12 gauges of 1 to 3 channels."""
    (scenario,) = scenarios_of(beam_of(36, 3), ("Fz",), ("E",))
    return in_blocks(scenario, 3)


def cost_of(oracle, scenarios, gauges, aggregate="mean"):
    combine = {"mean": np.mean, "worst": np.max}[aggregate]
    return combine([s.weight @ np.diag(oracle(s, list(gauges))) for s in scenarios])


def in_digits(scenario, scale, start):
    """tr(W P) with 40 digits, by corrections in double precision: gauge g counts scale[g] times."""
    exact = np.vectorize(mpmath.mpf, otypes=[object])
    with mpmath.workdps(40):
        F, Q, P = exact(scenario.F), exact(scenario.Q), exact(start)
        rows = scenario.rows.reshape(-1, len(scenario.F))
        H = exact(rows)
        weight = exact(np.repeat(scale, scenario.rows.shape[1]))
        f, g = scenario.F, rows.T @ (rows * np.repeat(scale, scenario.rows.shape[1])[:, None])
        for _ in range(25):
            PH, FP = P.dot(H.T), F.dot(P)
            defect = FP + FP.T + Q - (PH * weight).dot(PH.T)
            size = np.abs(defect).max()
            step = solve_continuous_lyapunov(f - P.astype(float) @ g, -(defect / size).astype(float))
            P = P + exact(0.5 * (step + step.T)) * size
            if size < mpmath.mpf("1e-28"):
                break
        assert size < mpmath.mpf("1e-28")
        return sum(mpmath.mpf(float(w)) * P[i, i] for i, w in enumerate(scenario.weight))


def test_slope_and_curvature_of_a_common_weight_are_those_of_forty_digits(blocks):
    pool = solve_pool(blocks)
    s = pool.scenario
    loop = loop_of(pool, np.arange(12), pool.P)
    shared = slopes(loop, np.diag(s.weight))
    gradient = gauge_gradients(loop, pool.rows, np.diag(s.weight))
    step = mpmath.mpf(1) / 2**20
    for g in (0, 1, 5):
        values = [in_digits(s, np.where(np.arange(12) == g, float(1 + k * step), 1.0), pool.P) for k in (-1, 0, 1)]
        below, here, above = values
        with mpmath.workdps(40):
            a1, a2 = float((below - above) / (2 * step)), float((above - 2 * here + below) / step**2 / 2)
        np.testing.assert_allclose(gradient[g], a1, rtol=1e-7)
        # the bound of these two numbers, which is what their formulas were combined to
        np.testing.assert_allclose(sharper_bound(shared, pool.rows[g]), a1 * a1 / (a1 - a2), rtol=1e-6)


@pytest.mark.parametrize("size", [12, 5, 3])
def test_a_block_leaves_and_comes_back_and_never_below_its_bounds(oracle, blocks, size):
    pool = solve_pool(blocks)
    s, gauges = pool.scenario, np.arange(size)
    P = subset_covariance(pool, gauges)
    np.testing.assert_allclose(P, oracle(s, gauges), atol=1e-8 * np.abs(P).max())
    loop = loop_of(pool, gauges, P)
    shared = slopes(loop, np.diag(s.weight))
    for g in gauges:
        rest = np.delete(gauges, g)
        D = removal(s.F, s.Q, loop, pool.rows[g], lambda rest=rest: pool.rows[rest], pool.modes)
        np.testing.assert_allclose(P + D, oracle(s, rest), atol=1e-7 * np.abs(P + D).max())
        rise = s.weight @ np.diag(D)
        bound = gauge_gradients(loop, pool.rows[[g]], np.diag(s.weight))[0]
        sharper = sharper_bound(shared, pool.rows[g])
        assert bound <= sharper * (1 + 1e-12)
        assert sharper <= rise * (1 + 1e-10)
        back = addition(s.F, s.Q, loop_of(pool, rest, subset_covariance(pool, rest)), pool.rows[g])
        np.testing.assert_allclose(back, -D, atol=1e-7 * np.abs(D).max())


@pytest.mark.parametrize(("aggregate", "instants"), [("mean", (63,)), ("mean", (55, 260)), ("worst", (55, 260, 871))])
def test_blocks_leave_in_the_order_of_algorithm_2(oracle, beam_of, scenarios_of, aggregate, instants):
    scenarios = [in_blocks(s, 3) for s in scenarios_of(beam_of(36, 3), ("Fz", "Fy"), ("E",), instants=instants)]
    found = eliminate(scenarios, 3, aggregate)
    scaled = [p.scenario for p in found.pools]
    left = list(range(12))
    for out, after in zip(found.removed.tolist(), found.cost[1:], strict=True):
        costs = {g: cost_of(oracle, scaled, [o for o in left if o != g], aggregate) for g in left}
        np.testing.assert_allclose(costs[out], min(costs.values()), rtol=1e-8)
        np.testing.assert_allclose(after, costs[out], rtol=1e-6)
        left.remove(out)
    assert found.solves.mean() < 3 * len(instants)


def test_a_rosette_is_its_three_channels_as_three_gauges(beam_of, scenarios_of):
    (single,) = scenarios_of(beam_of(12, 3), ("Fz",), ("E",))
    rosettes = replace(single, H=single.H.reshape(4, 3, -1), r=single.r.reshape(4, 3))
    kept = eliminate([rosettes], 2)
    alone = [solve_pool(single)]
    np.testing.assert_allclose(kept.cost[0], score(alone, np.arange(12)), rtol=1e-10)
    channels = (3 * kept.kept[:, None] + np.arange(3)).ravel()
    np.testing.assert_allclose(kept.cost[-1], score(alone, channels), rtol=1e-9)
    # and what one failure loses are all three
    loss = loss_if_one_fails(kept.pools, kept.kept)
    np.testing.assert_allclose(loss, [score(alone, channels[3:]), score(alone, channels[:3])], rtol=1e-9)


def test_channels_of_nothing_and_one_noise_for_a_block_change_nothing(beam_of, scenarios_of):
    (single,) = scenarios_of(beam_of(14, 4), ("Fz",), ("E",))
    H = np.zeros((14, 3, single.H.shape[1]))
    H[np.arange(14), np.arange(14) % 3] = single.H
    for r in (single.r, np.repeat(single.r[:, None], 3, axis=1)):
        padded = eliminate([replace(single, H=H, r=r)], 4)
        plain = eliminate([single], 4)
        assert padded.removed.tolist() == plain.removed.tolist()
        np.testing.assert_allclose(padded.cost, plain.cost, rtol=1e-9)


@pytest.mark.parametrize(("aggregate", "instants"), [("mean", (63,)), ("worst", (55, 260))])
def test_the_search_over_blocks_is_exhaustive_search(oracle, beam_of, scenarios_of, aggregate, instants):
    scenarios = [in_blocks(s, 2, 3) for s in scenarios_of(beam_of(22, 2), ("Fz", "Fy"), ("E",), instants=instants)]
    pools = [solve_pool(s) for s in scenarios]
    scaled = [p.scenario for p in pools]
    costs = {}
    for gauges in combinations(range(11), 3):
        detected = all(subset_covariance(p, gauges) is not None for p in pools)
        costs[gauges] = cost_of(oracle, scaled, gauges, aggregate) if detected else np.inf
    best = min(costs.values())
    found = branch_and_bound(pools, 3, aggregate)
    assert found.proven
    np.testing.assert_allclose(costs[tuple(found.gauges.tolist())], best, rtol=1e-8)
    swapped = exchange(pools, eliminate(scenarios, 3, aggregate).kept, aggregate)
    assert costs[tuple(swapped.gauges.tolist())] >= best * (1 - 1e-9)
    certificate = certify(pools, swapped.gauges, swapped.cost[-1], aggregate)
    assert 0.3 * best < certificate.lower_bound <= best * (1 + 1e-8)
    robust = robust_set(pools, 4, aggregate)
    np.testing.assert_allclose(robust.loss, loss_if_one_fails(pools, robust.gauges, aggregate), rtol=1e-9)


def test_fewer_blocks_than_unknowns_are_enough_where_their_channels_are(beam_of, scenarios_of):
    (single,) = scenarios_of(beam_of(12, 3), ("Fz", "Fy"), ("E",))
    pairs = replace(single, H=single.H.reshape(6, 2, -1), r=single.r.reshape(6, 2))
    assert fewest_gauges([solve_pool(pairs)]) == (3, 2)
    assert eliminate([pairs], 2).kept.shape == (2,)
    with pytest.raises(InfeasibleError, match=r"1 gauges cannot observe 3 unknowns \(Fz, Fy, E\)\n    keep at least 2"):
        eliminate([pairs], 1, names=("Fz", "Fy", "E"))
    with pytest.raises(InfeasibleError, match="2 gauges for 3 unknowns: whichever fails"):
        robust_set([solve_pool(pairs)], 2)
    with pytest.raises(ConfigError, match="7 gauges are to be kept of a pool of 6"):
        eliminate([pairs], 7)


def test_what_is_no_number_is_refused_in_a_block_too(blocks):
    for field, value, words in (
        ("H", np.nan, "row of gauge 4 of the pool is not finite"),
        ("r", 0.0, "noise of gauge 4 of the pool is 0,"),
        ("r", np.nan, "noise of gauge 4 of the pool is nan"),
    ):
        broken = getattr(blocks, field).copy()
        broken[4, 1] = value
        with pytest.raises(ConfigError, match=words):
            eliminate([replace(blocks, **{field: broken})], 3)
    with pytest.raises(InfeasibleError, match="no gauge of the pool can tell"):
        eliminate([replace(blocks, H=0 * blocks.H)], 3)


def test_blocks_of_the_same_channels_in_another_order_are_twins(blocks):
    swapped = np.concatenate([blocks.H, -blocks.H[:, [2, 0, 1]]])
    r = np.concatenate([blocks.r, blocks.r[:, [2, 0, 1]]])
    found = eliminate([replace(blocks, H=swapped, r=r)], 4)
    first = int(found.removed[0])
    assert found.ties[0] == (first + 12,)
    a, b = np.array([1.0, -2.0]), np.array([0.0, 3.0])
    labels = twin_groups([np.array([[a, b], [b, -a], [a, a], [b, b], [0 * a, a], [a, -0.0 * a]])])
    assert labels[0] == labels[1]
    assert labels[4] == labels[5]
    assert len(set(labels.tolist())) == 4


def test_rows_that_depend_on_the_instant_are_followed(oracle, beam_of, scenarios_of):
    """Accelerometers: H is that of the linearisation. Twins in one scenario only are none."""
    scenarios = list(scenarios_of(beam_of(16, 3), ("Fz",), ("E",), instants=(55, 260)))
    rng = np.random.default_rng(1)
    H = scenarios[1].H * rng.uniform(0.5, 2.0, (16, 1))
    H[:, -2:] += 0.2 * np.abs(H).max() * rng.normal(size=(16, 2))
    scenarios[0] = replace(scenarios[0], H=np.concatenate([scenarios[0].H[:8], scenarios[0].H[:8]]))
    scenarios[1] = replace(scenarios[1], H=H)
    found = eliminate(scenarios, 3)
    scaled = [p.scenario for p in found.pools]
    left = list(range(16))
    for out in found.removed.tolist():
        costs = {g: cost_of(oracle, scaled, [o for o in left if o != g]) for g in left}
        np.testing.assert_allclose(costs[out], min(costs.values()), rtol=1e-8)
        left.remove(out)
    assert all(len(t) == 0 for t in found.ties)


def test_the_sum_follows_blocks_that_leave(blocks):
    pool = solve_pool(blocks)
    left = Remaining([pool], fixed=[3])
    for gauge in (5, 0, 11, 7, 2):
        left.remove(int(np.flatnonzero((left.index == gauge) & left.movable)[0]))
    there = np.array([1, 3, 4, 6, 8, 9, 10])
    rows = pool.rows[there].reshape(-1, len(pool.P))
    np.testing.assert_allclose(left.gram(0), rows.T @ rows, atol=1e-12)
    factor = np.random.default_rng(0).normal(size=(len(pool.P), 2))
    seen = np.isin(left.index, there)
    np.testing.assert_allclose(left.product(0, factor)[seen], pool.rows[left.index[seen]] @ factor)
