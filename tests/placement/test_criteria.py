"""Every search and bound by every criterion, and over some of the unknowns, against all sets of small pools."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import combinations, repeat

import numpy as np
import pytest

from strainsight.errors import InfeasibleError
from strainsight.placement.branch_and_bound import branch_and_bound
from strainsight.placement.certificate import certify
from strainsight.placement.criteria import CRITERIA, Metric, criterion_of
from strainsight.placement.elimination import eliminate_from
from strainsight.placement.exchange import exchange, fill
from strainsight.placement.failure import loss_if_one_fails, robust_set
from strainsight.placement.increment import gauge_gradients
from strainsight.placement.limits import as_limits, limits_of
from strainsight.placement.scenario import Scenario, loop_of, solve_pool
from strainsight.placement.score import score

from .conftest import COMBINED, beam_of, oracle, scenarios_of
from .variances import metric_of
from .whole_pools import eliminate

NAMES = [criterion.name for criterion in CRITERIA]
EVERY = pytest.mark.parametrize("criterion", NAMES)
UNKNOWNS = ("Fz", "Fy", "E")


@pytest.fixture(scope="module")
def case_of():
    """Scenarios and pools of a beam by a criterion over some of its three unknowns, and what any set costs."""

    @cache
    def plain(size, instants, rosettes):
        beam = beam_of(size, 3, foundation=1e5, seed=3)
        scenarios = scenarios_of(beam, ("Fz", "Fy"), ("E",), instants=instants)
        return [in_pairs(s) if rosettes else s for s in scenarios]

    @cache
    def covariances(gauges, *case):
        return [oracle(s, list(gauges)) for s in plain(*case)]

    def made(name, over=UNKNOWNS, *, size=10, instants=(63, 260), rosettes=False, aggregate="mean"):
        case, scenarios = (size, instants, rosettes), []
        for s in plain(*case):
            weight = s.weight.copy()
            weight[[len(weight) - 3 + i for i, unknown in enumerate(UNKNOWNS) if unknown not in over]] = 0.0
            scenarios.append(replace(s, weight=weight, criterion=criterion_of(name)))

        def cost(gauges):
            found = covariances(tuple(sorted(gauges)), *case)
            return float(COMBINED[aggregate]([metric_of(name, s, P) for s, P in zip(scenarios, found, strict=True)]))

        return scenarios, [solve_pool(s) for s in scenarios], cost

    return made


def in_pairs(scenario):
    """The first two thirds of the gauges two by two, the others alone with a row of zeros."""
    count = len(scenario.H)
    pairs = count // 3
    H = np.zeros((count - pairs, 2, scenario.H.shape[1]))
    H[:pairs] = scenario.H[: 2 * pairs].reshape(pairs, 2, -1)
    H[pairs:, 0] = scenario.H[2 * pairs :]
    return Scenario(scenario.F, scenario.Q, H, np.full(H.shape[:2], scenario.r[0]), scenario.weight)


@EVERY
@pytest.mark.parametrize(("aggregate", "over"), [("mean", UNKNOWNS), ("worst", ("Fz", "E"))])
def test_bound_and_swaps_match_exhaustive_search(case_of, criterion, aggregate, over):
    _, pools, cost = case_of(criterion, over, size=8, aggregate=aggregate)
    every = {gauges: cost(gauges) for gauges in combinations(range(8), 3)}
    best = min(every.values())
    swapped = exchange(pools, [0, 1, 2], aggregate)
    chosen = tuple(swapped.gauges.tolist())
    assert swapped.complete
    assert swapped.cost[-1] == pytest.approx(every[chosen], rel=1e-8)
    for out in chosen:
        rest = [g for g in chosen if g != out]
        assert all(every[tuple(sorted([*rest, g]))] >= every[chosen] * (1 - 1e-8) for g in range(8) if g not in chosen)
    certificate = certify(pools, chosen, swapped.cost[-1], aggregate)
    assert certificate.lower_bound <= best * (1 + 1e-8)
    assert certificate.relaxed - certificate.lower_bound <= 2e-3 * certificate.relaxed
    for budget in (1, 5, 9):
        assert certify(pools, chosen, swapped.cost[-1], aggregate, budget=budget).lower_bound <= best * (1 + 1e-8)
    proof = branch_and_bound(pools, 3, aggregate, start=[0, 1, 2])
    assert proof.proven
    assert proof.cost == pytest.approx(best, rel=1e-6)
    assert proof.lower_bound <= best * (1 + 1e-8)


@EVERY
@pytest.mark.parametrize(
    ("aggregate", "over", "rosettes"),
    [("mean", ("Fz", "E"), True), ("mean", UNKNOWNS, False), ("worst", UNKNOWNS, False)],
)
def test_elimination_removes_least_rise(case_of, criterion, aggregate, over, rosettes):
    scenarios, _, cost = case_of(criterion, over, size=12, rosettes=rosettes, aggregate=aggregate)
    found = eliminate(scenarios, 4, aggregate)
    left = list(range(len(scenarios[0].H)))
    np.testing.assert_allclose(found.cost[0], cost(left), rtol=1e-8)
    for step, out in enumerate(found.removed.tolist()):
        costs = {g: cost([o for o in left if o != g]) for g in left}
        assert costs[out] == pytest.approx(min(costs.values()), rel=1e-8)
        np.testing.assert_allclose(found.rise[step], costs[out] - cost(left), rtol=1e-4, atol=1e-8 * costs[out])
        left.remove(out)
        np.testing.assert_allclose(found.cost[step + 1], cost(left), rtol=1e-8)


@EVERY
@pytest.mark.parametrize("over", [UNKNOWNS, ("Fy", "E")])
def test_its_slope_in_the_weight_of_a_gauge_is_that_of_differences_and_no_rise_is_less(case_of, criterion, over):
    """Oracle: whole pools, one gauge of which has a weight of 1 ± 1e-4, or of nothing."""
    (scenario,), (pool,), _ = case_of(criterion, over, instants=(63,))

    def cost(g, weight):
        r = scenario.r.copy()
        r[g] /= weight
        other = solve_pool(replace(scenario, r=r))
        return metric_of(criterion, other.scenario, other.P)

    (found,) = gauge_gradients([loop_of(pool, np.arange(10), pool.P)], [pool.rows], [pool.metric.gradient(pool.P)])
    for g in range(10):
        slope = -(cost(g, 1 + 1e-4) - cost(g, 1 - 1e-4)) / 2e-4
        np.testing.assert_allclose(found[g], slope, rtol=1e-4)
        assert found[g] <= (cost(g, 1e-12) - cost(g, 1.0)) * (1 + 1e-6)


@EVERY
def test_between_two_weightings_the_metric_lies_below_the_chord(case_of, criterion):
    """Convexity, from which every bound comes; and 1/c is concave, which is more."""
    (scenario,), _, _ = case_of(criterion, instants=(63,))
    rng = np.random.default_rng(0)
    ends = 10.0 ** rng.uniform(-3, 0, (2, 10))

    def cost(w):
        pool = solve_pool(replace(scenario, r=scenario.r / w))
        return metric_of(criterion, pool.scenario, pool.P)

    one, two = map(cost, ends)
    for share in (0.2, 0.5, 0.8):
        between = cost(share * ends[0] + (1 - share) * ends[1])
        assert between <= (share * one + (1 - share) * two) * (1 + 1e-9)
        assert 1 / between >= (share / one + (1 - share) / two) * (1 - 1e-9)


@pytest.mark.parametrize(("criterion", "aggregate"), [*zip(NAMES, repeat("worst"), strict=False), ("trace", "mean")])
def test_what_a_failure_costs_and_what_is_added_is_by_the_same_metric(case_of, criterion, aggregate):
    _, pools, cost = case_of(criterion, aggregate=aggregate)
    found = robust_set(pools, 5, aggregate)

    def losses(gauges):
        return [cost([g for g in gauges if g != out]) for out in gauges]

    gauges = found.tolist()
    worst = loss_if_one_fails(pools, gauges, aggregate).max()
    np.testing.assert_allclose(loss_if_one_fails(pools, gauges, aggregate), losses(gauges), rtol=1e-7)
    assert score(pools, gauges, aggregate) == pytest.approx(cost(gauges), rel=1e-7)
    for out in gauges:
        for into in (g for g in range(10) if g not in gauges):
            assert max(losses([*(g for g in gauges if g != out), into])) >= worst * (1 - 1e-7)
    start = [0, 1, 2, 3]
    (added,) = set(fill(pools, start, as_limits(10, 5), aggregate).tolist()) - set(start)
    assert cost([*start, added]) <= min(cost([*start, g]) for g in range(4, 10)) * (1 + 1e-8)


def test_the_determinant_does_not_know_the_units_of_the_unknowns_and_the_others_do(case_of):
    units = np.array([100.0, 1.0, 0.01])
    for name in NAMES:
        scenarios, _, _ = case_of(name, size=20)
        weight = scenarios[0].weight.copy()
        weight[-3:] *= units
        here, there = (eliminate([replace(s, weight=w) for s in scenarios], 4) for w in (scenarios[0].weight, weight))
        same = here.removed.tolist() == there.removed.tolist()
        assert same == (name == "log_determinant")
        if same:
            np.testing.assert_allclose(there.cost / here.cost, units.prod() ** (1 / 3), rtol=1e-9)


def two_walks(precision, criterion):
    """Two walks that know nothing of one another, gauge g reads walk g mod 2: P of each is √q / √Σ precision."""
    size = len(precision)
    H = np.eye(2)[np.arange(size) % 2]
    s = Scenario(np.zeros((2, 2)), np.diag([1.0, 4.0]), H, 1 / np.array(precision), np.ones(2), criterion_of(criterion))
    return solve_pool(s)


def test_where_both_walks_are_worst_the_bound_is_that_of_the_kink():
    """Four gauges on two walks of q = 1 and 4: weights in proportion to q make both √(5/4), and none make the worst less."""
    pool, least = two_walks(np.ones(8), "worst_eigenvalue"), np.sqrt(5 / 4)
    for budget in (3, 10, 300):
        found = certify([pool], [0, 2, 4, 1], 2.0, budget=budget)
        assert found.lower_bound <= least * (1 + 1e-9)
        assert found.relaxed >= least * (1 - 1e-9)
    assert found.lower_bound >= least * (1 - 2e-4)
    assert found.gap == pytest.approx(1 - found.lower_bound / 2.0)
    proof = branch_and_bound([pool], 4)
    assert (proof.gauges % 2).sum() == 3
    assert proof.cost == pytest.approx(2 / np.sqrt(3), rel=1e-9)


def test_a_gauge_that_the_worst_unknown_does_not_feel_leaves_first_and_of_these_the_lower_index():
    precision = [3.0, 1.0, 2.0, 0.5, 5.0, 2.0, 1.0, 0.25]
    rng = np.random.default_rng(0)
    for _ in range(5):
        pool = two_walks(np.array(precision) * (1 + 1e-14 * rng.normal(size=8)), "worst_eigenvalue")
        found = eliminate_from([pool], 5)
        assert found.removed.tolist() == [0, 2, 4]
        assert found.rise[:3].tolist() == [0.0, 0.0, 0.0]


def three_walks(channels, noise, criterion):
    """Three random walks that drive one state; every gauge has up to two channels."""
    F, Q = np.zeros((4, 4)), np.diag([0.1, 1.0, 1.0, 1.0])
    F[0] = [-1.0, 1.0, 1.0, 1.0]
    H = np.zeros((len(channels), 2, 4))
    for block, states in zip(H, channels, strict=True):
        for row, state in zip(block, states, strict=False):
            row[state] = 1.0
    r = np.array(noise)[:, None] * np.ones(2)
    return [solve_pool(Scenario(F, Q, H, r, np.r_[0.0, 1, 1, 1], criterion_of(criterion)))]


@EVERY
def test_no_unknown_is_lost_where_the_least_missed_gauge_is_the_one_that_sees_two(criterion):
    # gauge 0 sees two walks, badly: it is missed least, but without it no two gauges see three walks
    pools = three_walks([(1, 2), (1,), (2,), (3,)], [100.0, 1.0, 1.0, 1.0], criterion)
    assert eliminate_from(pools, 3).selected.tolist() == [1, 2, 3]
    assert eliminate_from(pools, 2).selected.tolist() == [0, 3]
    assert eliminate_from(pools, limits_of(4, 3, fixed=(0,))).selected.tolist() in ([0, 1, 3], [0, 2, 3])
    with pytest.raises(InfeasibleError):
        eliminate_from(pools, 1)


@pytest.mark.parametrize("states", [(1, 2), (0, 2)])
def test_a_metric_is_of_the_weighed_states_in_units_of_their_weights(states):
    rng = np.random.default_rng(1)
    B, weight = rng.normal(size=(3, 4)), np.zeros(3)
    P, weight[list(states)] = B @ B.T, [4.0, 0.25]
    for criterion in CRITERIA:
        metric = Metric(weight, criterion)
        M = np.array([[2.0], [0.5]]) * P[np.ix_(states, states)] * np.array([2.0, 0.5])
        np.testing.assert_allclose(metric.weighed(P), M, rtol=1e-14)
        assert metric.value(P) == pytest.approx(criterion.value(M), rel=1e-14)
        step = rng.normal(size=(3, 3))
        D = 1e-6 * step @ step.T
        assert np.vdot(metric.gradient(P), D) == pytest.approx(metric.rise(P, D), rel=1e-4)
        d = np.array([3.0, 0.1, 7.0])
        assert metric.scaled(d).value(P / np.outer(d, d)) == pytest.approx(metric.value(P), rel=1e-12)
