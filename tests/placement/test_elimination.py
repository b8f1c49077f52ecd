"""The lazy elimination is algorithm 2, gauge by gauge, in fifty digits for all seven cases of tables 6.1 and 6.2."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, pairwise

import mpmath
import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from strainsight.errors import InfeasibleError
from strainsight.loads.input_models import Unknowns
from strainsight.loads.linearisation import linearise, process_intensity
from strainsight.placement import elimination
from strainsight.placement.branch_and_bound import branch_and_bound
from strainsight.placement.criteria import Criterion, WorstEigenvalue
from strainsight.placement.exchange import exchange
from strainsight.placement.increment import removals
from strainsight.placement.scenario import Scenario, refine, solve_pool, thesis_weight
from strainsight.placement.score import score

from .conftest import beam_of, covariance_in_digits, oracle, scenarios_of
from .whole_pools import augment_rows, eliminate, whole_pool_weight


def test_elimination_evaluates_few_bounds(monkeypatch):
    asked = []

    def counted(*arguments):
        asked.append(1)
        return removals(*arguments)

    monkeypatch.setattr(elimination, "removals", counted)
    found = eliminate(scenarios_of(beam_of(60), ("Fz",), ("E",)), 4)
    assert found.solves.sum() == len(asked)
    assert found.solves.min() >= 1
    assert found.cost.shape == (57,)
    assert found.blocks.shape == (57, 2)
    assert found.solves.mean() < 2
    assert np.all(found.rise > 0)


def test_elimination_is_lazy_with_flat_criterion(monkeypatch):
    H = np.random.default_rng(0).normal(size=(60, 3))
    scenario = Scenario(np.zeros((3, 3)), np.eye(3), H, np.ones(60), np.ones(3), WorstEigenvalue())
    found = eliminate([scenario], 6)
    assert found.solves.mean() < 2
    monkeypatch.setattr(WorstEigenvalue, "lifts", Criterion.lifts)
    slow = eliminate([scenario], 6)
    assert slow.solves.mean() > 5
    assert found.removed.tolist() == slow.removed.tolist()
    np.testing.assert_array_equal(found.rise, slow.rise)


def test_the_order_of_gauges_and_the_units_change_nothing():
    (scenario,) = scenarios_of(beam_of(40), ("Fz",), ("E",))
    found = eliminate([scenario], 5)
    rng = np.random.default_rng(3)
    shuffle = rng.permutation(40)
    moved = Scenario(scenario.F, scenario.Q, scenario.H[shuffle] * 1e6, scenario.r[shuffle] * 1e12, scenario.weight)
    again = eliminate([moved.scaled(10.0 ** rng.uniform(-4, 4, len(scenario.F)))], 5)
    assert shuffle[again.removed].tolist() == found.removed.tolist()
    np.testing.assert_allclose(again.cost, found.cost, rtol=1e-8)


def test_load_modulus_and_density_together_are_refused_in_words():
    beam = beam_of(20)
    # the side load is known and would tell the scale; at rest sideways it does not
    quiet = type(beam)(beam.model, beam.rows, beam.x * (np.abs(beam.x[63]) > 1e-9), beam.u * [1, 0], beam.theta)
    with pytest.raises(InfeasibleError, match="cannot observe all unknowns"):
        scenarios_of(quiet, ("Fz",), ("E", "rho"))
    unknowns = Unknowns(("Fz",), ("E", "rho"), {"Fz": 1e4}, beam.theta)
    F = linearise(beam.model, unknowns, beam.theta, quiet.x[[63]], quiet.u[[63]])[0]
    Q = process_intensity(beam.model.size, unknowns, {"Fz": 20.0}, {"E": 0.05, "rho": 0.05})
    H = augment_rows(beam.rows, unknowns)
    with pytest.raises(InfeasibleError, match="Fz, E and rho together: fix or measure one"):
        eliminate([Scenario(F, Q, H, np.full(len(H), 1e-15), np.ones(len(F)))], 4, names=unknowns.names)


def test_weights_start_every_unknown_at_one_and_the_thesis_keeps_physical_units():
    scenarios = scenarios_of(beam_of(20), ("Fz",), ("E",), instants=(55, 260))
    whole = eliminate(scenarios, 19)
    np.testing.assert_allclose(whole.blocks[0], [1.0, 1.0], rtol=1e-9)
    unknown = len(scenarios[0].F) - np.array([2, 1])
    weight = thesis_weight(len(scenarios[0].F), unknown, np.array([1e4, 2e11]))
    plain = [Scenario(s.F, s.Q, s.H, s.r, weight) for s in scenarios]
    normalised = whole_pool_weight(scenarios, unknown)
    np.testing.assert_allclose(eliminate(plain, 19).blocks[0], [1e8 / normalised[-2], 4e22 / normalised[-1]], rtol=1e-6)


def test_the_residual_is_the_largest_of_all_steps(monkeypatch):
    scenarios = scenarios_of(beam_of(8, 3), ("Fz",), ("E",))
    for residuals in ([1e-11, 3e-11, 2e-11], [1e-13, 1e-12, 4e-11], [5e-11, 1e-12, 1e-12]):
        values = iter(residuals)
        solved = lambda *given, values=values: (refine(*given), next(values))  # noqa: E731
        monkeypatch.setattr(elimination, "refine_with_residual", solved)
        found = eliminate(scenarios, 5)
        assert found.residual == max(residuals)
        assert found.residual > max(pool.residual for pool in found.pools)


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
def test_rounding_level_gauges_are_ties(aggregate):
    scenarios = scenarios_of(beam_of(20, 4), ("Fz",), ("E",), instants=(55, 260))
    silent = [3, 7, 8, 15]
    for seed in range(3):
        rng = np.random.default_rng(seed)
        shaken = []
        for own in scenarios:
            H = own.H.copy()
            H[silent] *= 1e-11 * rng.standard_normal(H[silent].shape)
            shaken.append(replace(own, H=H))
        found = eliminate(shaken, 4, aggregate)
        assert found.removed[:4].tolist() == silent
        assert found.rise[:4].tolist() == [0.0] * 4
        assert [bool(ties) for ties in found.ties[:4]] == [True, True, True, False]
        assert (found.rise[4:] > 0).all()


# on a foundation whose stiffness is known, without which the last case has a direction that no gauge sees
SEVEN = [
    ((), ("E",)),
    ((), ("rho",)),
    (("Fz",), ()),
    ((), ("E", "rho")),
    (("Fz",), ("E",)),
    (("Fz",), ("rho",)),
    (("Fz",), ("E", "rho")),
]
FOUNDATION = 1e5
"""Stiffness of every unknown displacement and rotation to the ground [N/m, N m]."""


def algorithm_2(cost, count, keep):
    """Order, traces, and how close the second candidate came, relative to the rise; every candidate evaluated."""
    left = list(range(count))
    order, trace, margin = [], [cost(left)], []
    while len(left) > keep:
        costs = sorted((cost([other for other in left if other != g]), g) for g in left)
        (best, out), (second, _) = costs[:2]
        margin.append(float((second - best) / (best - trace[-1])))
        left.remove(out)
        order.append(out)
        trace.append(best)
    return order, trace, margin


@pytest.mark.parametrize(("inputs", "parameters"), SEVEN)
def test_elimination_is_brute_force_in_fifty_digits(inputs, parameters):
    (scenario,) = scenarios_of(beam_of(7, 2, foundation=FOUNDATION), inputs, parameters)
    found = eliminate([scenario], 3)

    def cost(gauges):
        s = scenario
        P = covariance_in_digits(s.F, s.Q, s.H[gauges], s.r[gauges], oracle(s, gauges))
        return sum(mpmath.mpf(w) * P[i, i] for i, w in enumerate(s.weight) if w)

    with mpmath.workdps(55):
        order, trace, margin = algorithm_2(cost, 7, 3)
        rise = [float(after - before) for before, after in pairwise(trace)]
    assert min(margin) > 1e-6
    assert found.removed.tolist() == order
    np.testing.assert_allclose(found.cost, [float(t) for t in trace], rtol=1e-9)
    np.testing.assert_allclose(found.rise, rise, rtol=1e-7)
    np.testing.assert_allclose(found.blocks.sum(axis=1), found.cost, rtol=1e-12)
    np.testing.assert_allclose(found.cost[0], len(inputs) + len(parameters), rtol=1e-9)
    assert found.residual < 1e-10


def prior_trace(decay, h, sensors):
    """Steady tr P before the measurement, Ye, Roy and Sundaram (2018): x⁺ = diag(λ, 0, 0) x + w, W = I, y = C x."""
    A = mpmath.diag([decay, 0, 0])
    rows = [[1, h, h], [1, 0, h], [0, 1, 1]]
    C = mpmath.matrix([rows[i] for i in sensors])
    P = mpmath.eye(3)
    for _ in range(2000):
        new = A * (P - P * C.T * mpmath.inverse(C * P * C.T) * C * P) * A.T + mpmath.eye(3)
        if mpmath.mnorm(new - P) < mpmath.mpf("1e-40"):
            return new[0, 0] + new[1, 1] + new[2, 2]
        P = new
    raise AssertionError("the recursion did not settle")


def forward(cost, pool, keep):
    """The greedy selection of the paper: add, again and again, the gauge after which the cost is least."""
    chosen: list[int] = []
    while len(chosen) < keep:
        chosen.append(min((g for g in range(pool) if g not in chosen), key=lambda g: cost(sorted([*chosen, g]))))
    return sorted(chosen)


def as_printed(cost, pool, keep):
    """Algorithm 2 to the letter: of all gauges but the last, the one of the least tr P(all) − tr P(without it) leaves."""
    left = list(range(pool))
    while len(left) > keep:
        whole = cost(left)
        left.remove(min(left[:-1], key=lambda g, whole=whole: whole - cost([own for own in left if own != g])))
    return left


def best_of_all(cost, pool, keep):
    return min((list(gauges) for gauges in combinations(range(pool), keep)), key=cost)


def test_the_published_ratio_is_that_of_forward_selection():
    with mpmath.workdps(60):
        factor = mpmath.mpf("0.5")
        limit = mpmath.mpf(2) / 3 + 1 / (3 * (1 - factor**2))
        short = []
        for h in (10**4, 10**6):
            known = {}

            def cost(sensors, h=h, known=known):
                if tuple(sensors) not in known:
                    known[tuple(sensors)] = prior_trace(factor, h, sensors)
                return known[tuple(sensors)]

            picked, best = forward(cost, 3, 2), best_of_all(cost, 3, 2)
            assert 1 in picked
            assert best == [0, 2]
            assert abs(cost(best) - 3) < mpmath.mpf("1e-30")
            short.append(limit - cost(picked) / cost(best))
            assert abs(cost([0, 1, 2]) - 3) < mpmath.mpf("1e-30")
        assert 0 < short[1] < mpmath.mpf("1e-10")
        for coarse, fine in pairwise(short):
            assert abs(coarse / fine / 10**4 - 1) < mpmath.mpf("1e-2")


@pytest.fixture(scope="module")
def cost_of():
    """tr(W P) of a set by SciPy's Riccati solver."""

    def cost(scenario, gauges):
        P = solve_continuous_are(scenario.F.T, scenario.H[gauges].T, scenario.Q, np.diag(scenario.r[gauges]))
        return float(scenario.weight @ np.diag(P))

    return cost


@pytest.mark.parametrize("h", [10.0, 100.0])
def test_its_continuous_form_misleads_forward_selection_and_nothing_here(cost_of, h):
    """ẋ = diag(−a, −b, −b) x + w with stationary variances 1/2a, 1, 1: gauges 0 and 2 tell the slow state, no other pair does."""
    a, b = 0.05, 20.0
    scenario = Scenario(
        np.diag([-a, -b, -b]),
        np.diag([1.0, 2 * b, 2 * b]),
        np.array([[1, h, h], [1, 0, h], [0, 1, 1]]),
        np.full(3, 1e-4),
        np.ones(3),
    )

    def cost(gauges):
        return cost_of(scenario, gauges)

    misled, best = forward(cost, 3, 2), best_of_all(cost, 3, 2)
    assert misled == [1, 2]
    assert best == [0, 2]
    assert cost(misled) > {10.0: 1.8, 100.0: 4.4}[h] * cost(best)
    pools = [solve_pool(scenario)]
    np.testing.assert_allclose(score(pools, misled), cost(misled), rtol=1e-7)
    assert exchange(pools, misled).gauges.tolist() == best
    assert branch_and_bound(pools, 2, start=misled).gauges.tolist() == best
    assert eliminate([scenario], 2).selected.tolist() == best
    assert as_printed(cost, 3, 2) == misled


def three_states(decay, rows):
    rows = np.array(rows, dtype=float)
    return Scenario(-np.diag(np.array(decay, dtype=float)), np.eye(3), rows, np.full(len(rows), 0.01), np.ones(3))


def test_removing_one_by_one_is_not_optimal_and_a_swap_corrects_it(cost_of):
    scenario = three_states([1, 6, 3], [[-10, 10, 0], [-20, -30, 10], [-20, 0, 10], [30, -10, -30]])
    best = best_of_all(lambda gauges: cost_of(scenario, gauges), 4, 2)
    greedy = eliminate([scenario], 2)
    assert greedy.selected.tolist() == [0, 3]
    assert best == [2, 3]
    np.testing.assert_allclose(greedy.cost[-1] / cost_of(scenario, best), 1.2490867, rtol=1e-6)
    assert exchange(greedy.pools, greedy.selected).gauges.tolist() == best
    assert branch_and_bound(greedy.pools, 2).gauges.tolist() == best
    assert as_printed(lambda gauges: cost_of(scenario, gauges), 4, 2) == [0, 3]


def test_where_swaps_are_stuck_branch_and_bound_finds_the_optimum(cost_of):
    scenario = three_states(
        [9, 4, 1], [[-10, -30, 30], [0, 0, -10], [0, -10, 10], [20, 0, 0], [-30, -10, 10], [30, 10, 10]]
    )
    best = best_of_all(lambda gauges: cost_of(scenario, gauges), 6, 2)
    greedy = eliminate([scenario], 2)
    swapped = exchange(greedy.pools, greedy.selected)
    assert greedy.selected.tolist() == swapped.gauges.tolist() == [4, 5]
    assert best == [0, 1]
    np.testing.assert_allclose(swapped.cost[-1] / cost_of(scenario, best), 1.5840593, rtol=1e-6)
    found = branch_and_bound(greedy.pools, 2)
    assert found.proven
    assert found.gauges.tolist() == best
    np.testing.assert_allclose(found.cost, cost_of(scenario, best), rtol=1e-9)
    printed = as_printed(lambda gauges: cost_of(scenario, gauges), 6, 2)
    assert printed == [1, 5]
    np.testing.assert_allclose(cost_of(scenario, printed) / cost_of(scenario, best), 1.6395292, rtol=1e-6)


def test_on_a_pool_of_redundant_gauges_the_printed_algorithm_keeps_the_worst(cost_of):
    """A constant that twelve gauges of different noise read: ẋ = w, y = x + v."""
    noise = 1e-3 * np.arange(1.0, 13.0)
    scenario = Scenario(np.zeros((1, 1)), np.eye(1), np.ones((12, 1)), noise, np.ones(1))

    def cost(gauges):
        return cost_of(scenario, gauges)

    assert eliminate([scenario], 2).selected.tolist() == best_of_all(cost, 12, 2) == [0, 1]
    printed = as_printed(cost, 12, 2)
    assert printed == [10, 11]
    # tr P = √(q / Σ 1/r): the metric of twelve is that of both pairs times a root
    information = 1 / noise
    np.testing.assert_allclose(
        cost(printed) / cost([0, 1]), np.sqrt(information[:2].sum() / information[10:].sum()), rtol=1e-8
    )
