"""Scenarios, their information matrix, the score of a set, the choice among ties, and refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import ConfigError, InfeasibleError, NumericalError
from strainsight.placement.branch_and_bound import branch_and_bound
from strainsight.placement.criteria import CRITERIA, Metric
from strainsight.placement.elimination import RemovedGauge, known_to_go, least_missed
from strainsight.placement.failure import robust_set
from strainsight.placement.limits import limits_of
from strainsight.placement.riccati import CANCELLED, Information, information
from strainsight.placement.scenario import (
    Scenario,
    fewest_gauges,
    in_reached_states,
    loop_of,
    refine,
    solve_pool,
    subset_covariance,
)
from strainsight.placement.score import score, scores
from strainsight.placement.witness import Remaining

from .conftest import COMBINED, beam_of, blind_sideways, costs_of, oracle, pools_of, scenarios_of
from .rules import PAIRS, POOL, PRICE, Rules, zone
from .variances import variance
from .whole_pools import eliminate


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
    few = solve_pool(Scenario(-np.eye(6), np.eye(6), np.ones((len(channels), 6)), np.ones(len(channels)), np.ones(6)))
    assert fewest_gauges([few]) == (0, 0)
    assert fewest_gauges([wandering(channels, 6), few]) == fewest_gauges([few, wandering(channels, 6)]) == (6, fewest)


def test_fewer_blocks_than_unknowns_are_enough_where_their_channels_are():
    (single,) = scenarios_of(beam_of(12, 3), ("Fz", "Fy"), ("E",))
    pairs = replace(single, H=single.H.reshape(6, 2, -1), r=single.r.reshape(6, 2))
    assert fewest_gauges([solve_pool(pairs)]) == (3, 2)
    assert eliminate([pairs], 2).selected.shape == (2,)
    with pytest.raises(InfeasibleError, match=r"1 gauges cannot observe 3 unknowns \(Fz, Fy, E\)\n    keep at least 2"):
        eliminate([pairs], 1, names=("Fz", "Fy", "E"))
    with pytest.raises(InfeasibleError, match="2 gauges for 3 unknowns: if any gauge fails"):
        robust_set([solve_pool(pairs)], 2)
    with pytest.raises(ConfigError, match="cannot keep 7 of the 6 candidate gauges"):
        eliminate([pairs], 7)


def test_a_start_far_from_the_solution_does_not_show():
    pool = wandering((1, 2, 3, 1, 2), 3)
    gauges = [1, 2, 4]
    rows = pool.stacked(np.array(gauges))
    # P G P = Q by the root of the symmetric Q^(1/2) G Q^(1/2)
    root = np.sqrt(pool.scenario.Q)
    lam, U = np.linalg.eigh(root @ rows.T @ rows @ root)
    exact = root @ (U / np.sqrt(lam)) @ U.T @ root
    for start in (None, exact, exact * (1 + 1e-6), 1e3 * np.diag([1.0, 5.0, 0.1]), 1e-3 * np.eye(3)):
        np.testing.assert_allclose(refine(pool, information(rows), start), exact, rtol=1e-9, atol=1e-12)


def test_missing_process_noise_is_named():
    H, weight = np.eye(3), np.array([0.0, 0.0, 1.0])
    F = np.array([[0.0, 1.0, 0.0], [-4.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    with pytest.raises(InfeasibleError, match="undamped motion"):
        solve_pool(Scenario(F, np.diag([0.0, 0.0, 1.0]), H, np.ones(3), weight), ["Fz"])
    F = np.array([[0.0, 1.0, 0.0], [-4.0, -0.1, 1.0], [0.0, 0.0, 0.0]])
    with pytest.raises(InfeasibleError, match="Fz has no or too little process noise"):
        solve_pool(Scenario(F, np.diag([0.0, 1.0, 0.0]), H, np.ones(3), weight), ["Fz"])


def test_undetecting_set_scores_infinity():
    pools = eliminate(scenarios_of(beam_of(10), ("Fz",), ("E",)), 4).pools
    unknown = np.arange(len(pools[0].P) - 2, len(pools[0].P))
    assert score(pools, [3]) == np.inf
    assert score(pools, []) == np.inf
    lost = scores(by_criteria(pools, unknown), [3], unknown, np.ones(2))
    assert lost.cost == dict.fromkeys([criterion.name for criterion in CRITERIA], np.inf)
    assert lost.std.tolist() == [np.inf] * 2


def by_criteria(pools, unknown):
    """The scenarios by every criterion of these states of x*."""
    weight = np.isin(np.arange(len(pools[0].P)), unknown).astype(float)
    return {c.name: [pool.under(Metric(weight, c)) for pool in pools] for c in CRITERIA}


def test_every_metric_comes_from_the_same_covariance():
    scenarios = scenarios_of(beam_of(12, 3), ("Fz", "Fy"), ("E",), instants=(55, 260))
    pools = eliminate(scenarios, 4).pools
    size = len(pools[0].P)
    gauges, unknown = [0, 2, 4, 6, 9], np.arange(size - 3, size)
    scale = np.array([1e4, 1e3, 2e11])
    P = [oracle(pool.scenario, gauges) * np.outer(pool.scale, pool.scale) for pool in pools]
    blocks = [p[np.ix_(unknown, unknown)] for p in P]
    by = by_criteria(pools, unknown) | {"as chosen by": [pool.under(scenarios[0].metric) for pool in pools]}
    for aggregate, combine in COMBINED.items():
        found = scores(by, gauges, unknown, scale, aggregate)
        for criterion in CRITERIA:
            expected = combine([variance(criterion.name, block) for block in blocks])
            np.testing.assert_allclose(found.cost[criterion.name], expected, rtol=1e-8)
        np.testing.assert_allclose(found.cost["as chosen by"], score(pools, gauges, aggregate), rtol=1e-12)
        spread = (np.diag(blocks[0]) + np.diag(blocks[1])) / 2
        np.testing.assert_allclose(found.std, np.sqrt(spread) * scale, rtol=1e-8)
    amplitudes, share = np.array([[1e4, 1e3, 2e11], [2e4, 5e2, 1e11]]), np.array([[0.25, 1.0, 0.5], [0.75, 0.0, 0.5]])
    variances = np.array([np.diag(block) for block in blocks])
    expected = np.sqrt((share * variances * amplitudes**2).sum(axis=0))
    np.testing.assert_allclose(scores(by, gauges, unknown, amplitudes, share=share).std, expected, rtol=1e-8)


def test_unsolved_set_is_distinguished_from_undetecting(monkeypatch):
    pools = eliminate(scenarios_of(beam_of(10), ("Fz",), ("E",)), 4).pools

    def refuse(*_):
        raise NumericalError("not solved")

    monkeypatch.setattr("strainsight.placement.scenario.subset_covariance", refuse)
    found = scores(by_criteria(pools, [0]), [1, 2, 3], np.array([0]), np.ones(1))
    assert np.isnan([*found.cost.values(), *found.std]).all()


@pytest.mark.parametrize("count", [1, 4, 5, 30])
def test_the_factor_is_no_larger_than_the_states_and_its_square_is_the_sum(count):
    rows = np.random.default_rng(count).normal(size=(count, 4))
    known = information(rows)
    assert known.factor.shape == (min(count, 4), 4)
    np.testing.assert_allclose(known.factor.T @ known.factor, sum(np.outer(h, h) for h in rows), atol=1e-13 * count)
    np.testing.assert_allclose(known.G, sum(np.outer(h, h) for h in rows), atol=1e-13 * count)
    d, block = np.array([1.0, 10, 0.1, 3]), np.array([[1.0, 2, 3, 4], [0, 0, 1, 0]])
    for changed, truth in ((known.scaled(d), rows * d), (known.with_rows(block), np.vstack([rows, block]))):
        np.testing.assert_allclose(changed.G, truth.T @ truth, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(changed.factor.T @ changed.factor, truth.T @ truth, rtol=1e-12, atol=1e-12)


def test_a_sum_alone_has_no_factor():
    alone = Information(np.eye(3))
    block = np.ones((1, 3))
    for known in (alone, alone.scaled(np.ones(3)), alone.with_rows(block)):
        assert known.factor is None
        assert known.needed(np.eye(3)) is None
    np.testing.assert_array_equal(alone.with_rows(block).G, np.eye(3) + 1)
    np.testing.assert_array_equal(alone.squared(2 * np.eye(3)), 4 * np.eye(3))


@pytest.mark.parametrize("beyond", [False, True])
def test_the_factor_is_needed_where_the_diagonals_are_so_many_times_the_trace(beyond):
    """One gauge that reads x + y, and what is known of the two is their sum: Σ PᵢᵢGᵢᵢ = 2 and tr(P G) = 2(1 − c)."""
    ratio = CANCELLED * (1.001 if beyond else 0.999)
    P = np.array([[1.0, 1 / ratio - 1], [1 / ratio - 1, 1.0]])
    known = information(np.ones((1, 2)))
    assert np.diag(P) @ np.diag(known.G) == pytest.approx(ratio * np.trace(P @ known.G))
    assert (known.needed(P) is not None) == beyond
    np.testing.assert_allclose(known.squared(P), P @ np.ones((2, 2)) @ P, rtol=1e-12)


def test_the_factor_keeps_digits_that_the_sum_has_lost():
    """A gauge of precision 1e-9 reads x + y: P h is 1e-9 of P, and P hhᵀ P of it 1e-18, beyond any sum of doubles."""
    rows, e = np.array([[1.0, 1.0], [1e-5, 0.0]]) * 1e9, 1e-9
    P = np.array([[1.0, -1 + e], [-1 + e, 1.0]])
    Ph = (P @ rows.T).T
    truth = sum(np.outer(v, v) for v in Ph)
    np.testing.assert_allclose(information(rows).squared(P), truth, rtol=1e-6)
    assert isinstance(information(rows), Information)


SIZE, LEVELS, WEIGHT = 12, (1.0, 9.0), np.array([1.0, 3.0, 0.5])


class Left:
    """What is left after some gauges have gone; two scenarios, H (2, pool, 3) at unit noise."""

    def __init__(self, H, aggregate, removed=(), fixed=()):
        self.H, self.aggregate = H, aggregate
        self.pools = pools_of(H, LEVELS, WEIGHT)
        self.left = Remaining(self.pools, fixed)
        for gauge in removed:
            self.left.remove(int(np.flatnonzero(self.left.index == gauge)[0]))
        self.gauges = self.left.gauges.tolist()
        P = [subset_covariance(pool, self.gauges) for pool in self.pools]
        self.loops = [loop_of(pool, self.gauges, p) for pool, p in zip(self.pools, P, strict=True)]
        self.costs = np.array([pool.metric.value(p) for pool, p in zip(self.pools, P, strict=True)])
        self.step = RemovedGauge(self.pools, self.loops, self.costs, self.left, aggregate)

    def each(self, gauges):
        """tr(W P) of every scenario."""
        return costs_of(self.H[:, gauges], LEVELS, WEIGHT, np.ones(len(gauges)))

    def rise(self, gauge):
        combine = COMBINED[self.aggregate]
        return combine(self.each([g for g in self.gauges if g != gauge])) - combine(self.each(self.gauges))

    def found(self, relief=None):
        at_places = None if relief is None else relief[self.left.index]
        return least_missed(self.step, at_places)


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
@pytest.mark.parametrize("seed", range(6))
def test_the_least_rise_per_relief_of_all_is_found(aggregate, seed):
    rng = np.random.default_rng(seed)
    H = rng.normal(size=(2, SIZE, 3))
    H[:, [4, 9]] = -H[:, [2, 6]]
    for removed, fixed in (((), ()), ((1, 7, 10), (0, 3)), ((0, 3, 5, 8, 10, 11, 7), (1,))):
        step = Left(H, aggregate, removed, fixed)
        for relief in (None, 10.0 ** rng.uniform(-2, 2, SIZE) * (rng.random(SIZE) < 0.7), np.full(SIZE, 100.0)):
            per = np.ones(SIZE) if relief is None else relief
            per[[4, 9]] = per[[2, 6]]
            rates = {g: step.rise(g) / per[g] for g in step.gauges if g not in fixed and per[g] > 0}
            least = min(rates.values())
            best = [g for g, rate in rates.items() if rate <= least * (1 + 1e-8)]
            choice, solves, worth = step.found(relief)
            assert (choice.gauge, choice.ties) == (best[0], tuple(best[1:]))
            assert step.left.index[choice.at] == choice.gauge
            np.testing.assert_allclose(choice.rise, step.rise(choice.gauge), rtol=1e-7)
            parts = [p.scenario.weight @ np.diag(D) for p, D in zip(step.pools, choice.increments, strict=True)]
            np.testing.assert_allclose(
                step.costs + parts, step.each([g for g in step.gauges if g != choice.gauge]), rtol=1e-9
            )
            assert 2 <= solves <= 2 * len(rates)
            for place, gauge in enumerate(step.left.index.tolist()):
                assert gauge not in step.gauges or worth[place] <= step.rise(gauge) + 1e-9


def test_where_every_removal_loses_an_unknown_none_is_found():
    H = np.random.default_rng(1).normal(size=(2, SIZE, 3))
    step = Left(H, "mean", range(3, SIZE))
    choice, solves, _ = step.found()
    assert choice is None
    assert solves == 3 * 2
    assert Left(H, "mean", range(5, SIZE), fixed=range(5)).found()[:2] == (None, 0)


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
def test_a_gauge_that_is_known_to_go_is_taken_at_what_it_costs(aggregate):
    step = Left(np.random.default_rng(2).normal(size=(2, SIZE, 3)), aggregate, (0, 4, 6))
    for gauge in (2, 11):
        choice = known_to_go(step.step, gauge)
        assert (choice.gauge, step.left.index[choice.at], choice.ties) == (gauge, gauge, ())
        np.testing.assert_allclose(choice.rise, step.rise(gauge), rtol=1e-8)
        parts = [p.scenario.weight @ np.diag(D) for p, D in zip(step.pools, choice.increments, strict=True)]
        np.testing.assert_allclose(step.costs + parts, step.each([g for g in step.gauges if g != gauge]), rtol=1e-9)


REFUSED = {
    "fixed in one zone": (
        {"keep": 4, "fixed": (0, 1), "zones": [zone("place.at_most.0", [0, 1, 2], 1)]},
        "place.at_most.0",
        r"bonded gauges \(gauges.fixed\) use 2 gauges of the 1 that place.at_most.0 allows",
    ),
    "fixed too near to its own mirror image": (
        {"keep": 5, "fixed": (3, 4), "near": [(3, 4), (4, 4), (6, 6)]},
        "place.minimum_spacing",
        "closer to candidate gauge 4",
    ),
    "too near to their own mirror images": (
        {"keep": 4, "near": [(g, g) for g in range(8)]},
        "place.minimum_spacing",
        "place.minimum_spacing allows only 3 of the 11 candidate gauges",
    ),
    "spacing of what is fixed": (
        {"keep": 3, "fixed": (0,), "near": [(0, i) for i in range(1, 10)]},
        "place.minimum_spacing",
        "place.minimum_spacing allows only 2 of the 11 candidate gauges",
    ),
    "budget of nothing": (
        {"keep": 4, "price": PRICE, "budget": 0.0},
        "place.budget",
        "the cheapest gauges that make every unknown observable cost 0.7, but place.budget is 0",
    ),
    "count": ({"keep": 1}, None, r"1 gauges cannot observe 2 unknowns \(Fz, E\)"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_leaves_no_layout_is_named(case):
    asked, key, words = REFUSED[case]
    (scenario,) = scenarios_of(beam_of(POOL, 2), ("Fz",), ("E",))
    limits = Rules(**asked).limits
    with pytest.raises(InfeasibleError, match=words) as refused:
        eliminate([scenario], limits, names=("Fz", "E"))
    assert refused.value.key == key
    assert refused.value.remedy
    with pytest.raises(InfeasibleError):
        branch_and_bound([solve_pool(scenario)], limits)


def test_a_zone_around_all_that_see_an_unknown_is_named_with_it():
    beam = beam_of(POOL, 3)
    (scenario,) = scenarios_of(beam, ("Fz", "Fy"), ())
    scenario = blind_sideways(beam, scenario, np.arange(POOL) != 7)
    closed = Rules(4, zones=[zone("place.at_most.0", [6, 7], 0)]).limits
    with pytest.raises(InfeasibleError, match=r"no layout within place.at_most.0 can observe Fy") as refused:
        eliminate([scenario], closed, names=("Fz", "Fy"))
    assert refused.value.key == "place.at_most.0"
    # gauge 7 is too dear for its neighbours: it stays, as every layout needs it
    price = np.where(np.arange(POOL) == 7, 9.0, 1.0)
    rules = Rules(4, price=price, budget=10.5, near=[(7, i) for i in (0, 1, 2, 3, 4)])
    kept = eliminate([scenario], rules.limits).selected
    assert 7 in kept
    assert rules.hold(kept)
    with pytest.raises(InfeasibleError, match=r"cost 10, but place.budget is 9"):
        eliminate([scenario], Rules(4, price=price, budget=9.0).limits)
    blind = Rules(3, fixed=(0, 1, 2), zones=[zone("place.at_most.0", range(POOL), 9)]).limits
    with pytest.raises(InfeasibleError, match=r"the smallest set .* within place.at_most.0 has 4") as refused:
        eliminate([scenario], blind)
    assert refused.value.key == "place.keep"


def test_impossible_counts_keep_their_words():
    with pytest.raises(ConfigError, match="cannot keep 12 of the 11 candidate gauges, of which 0 are bonded"):
        limits_of(11, 12)
    with pytest.raises(ConfigError, match="cannot keep 1 of the 11 candidate gauges, of which 2 are bonded"):
        limits_of(11, 1, fixed=(3, 4))
    with pytest.raises(ConfigError, match="cannot keep 18 of the 17 candidate gauges, of which 4 are bonded"):
        limits_of(11, 18, size=PAIRS, fixed=(0, 1))


@pytest.mark.parametrize("loads", [("Fz",), ("Fz", "Fy")])
def test_states_without_noise_change_no_covariance(loads):
    """Bending about the other axis, of which a load about one axis moves nothing, against SciPy with all states."""
    (scenario,) = scenarios_of(beam_of(12, 3), loads, ("E",))
    n, size = len(scenario.F) - len(loads) - 1, len(scenario.F)
    F, Q = np.zeros((size + 4, size + 4)), np.zeros((size + 4, size + 4))
    inner = np.ix_(np.r_[:n, n + 4 : size + 4], np.r_[:n, n + 4 : size + 4])
    F[inner], Q[inner] = scenario.F, scenario.Q
    F[n : n + 2, n + 2 : n + 4] = np.eye(2)
    F[n + 2 : n + 4, n : n + 2], F[n + 2 : n + 4, n + 2 : n + 4] = -np.diag([9e4, 4e5]), -np.diag([6.0, 13.0])
    F[n + 2, :n] = 1e-18 * np.abs(scenario.F).max()
    H, weight = np.zeros((12, size + 4)), np.zeros(size + 4)
    H[:, inner[0].ravel()], weight[inner[0].ravel()] = scenario.H, scenario.weight
    H[:, n : n + 2] = np.random.default_rng(1).normal(size=(12, 2)) * np.abs(scenario.H).max()
    whole = solve_pool(Scenario(F, Q, H, scenario.r, weight))
    few = in_reached_states(whole, len(loads) + 1)
    assert len(few.P) == size
    for gauges in (range(12), [1, 4, 7, 9, 11], [0, 3, 6, 10]):
        P = subset_covariance(few, gauges) * np.outer(few.scale, few.scale)
        every = oracle(whole.scenario, gauges) * np.outer(whole.scale, whole.scale)
        unit = np.outer(few.scale, few.scale) * np.abs(subset_covariance(few, gauges)).max()
        np.testing.assert_allclose(P / unit, every[inner] / unit, atol=1e-8)
        assert few.metric.value(subset_covariance(few, gauges)) == pytest.approx(
            whole.metric.value(subset_covariance(whole, gauges)), rel=1e-9
        )
    assert in_reached_states(few, 1) is few
