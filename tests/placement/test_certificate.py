"""No set beats the bound: exhaustive search says so."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from strainsight.placement.certificate import certify
from strainsight.placement.elimination import eliminate
from strainsight.placement.exchange import exchange
from strainsight.placement.score import score

CASES = [((), ("E",)), (("Fz",), ("E",)), (("Fz", "Fy"), ("E",))]


def every_set(oracle, pools, keep, aggregate):
    combine = {"mean": np.mean, "worst": np.max}[aggregate]
    return min(
        combine([p.scenario.weight @ np.diag(oracle(p.scenario, list(gauges))) for p in pools])
        for gauges in combinations(range(len(pools[0].rows)), keep)
    )


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(("inputs", "parameters"), CASES)
def test_the_bound_lies_below_the_optimum(oracle, beam_of, scenarios_of, inputs, parameters, seed):
    scenarios = scenarios_of(beam_of(12, 3, seed=seed), inputs, parameters)
    greedy = eliminate(scenarios, 4)
    swapped = exchange(greedy.pools, greedy.kept)
    best = every_set(oracle, greedy.pools, 4, "mean")
    certificate = certify(greedy.pools, swapped.gauges, swapped.trace[-1])
    assert certificate.lower_bound <= best * (1 + 1e-7)
    assert certificate.lower_bound <= certificate.relaxed * (1 + 1e-12)
    assert certificate.relaxed - certificate.lower_bound < 2e-4 * certificate.relaxed
    np.testing.assert_allclose(certificate.gap, 1 - certificate.lower_bound / swapped.trace[-1], rtol=1e-9, atol=1e-12)
    assert best * (1 - 1e-7) <= swapped.trace[-1] <= greedy.trace[-1] * (1 + 1e-12)
    assert swapped.trace[-1] - best <= certificate.gap * swapped.trace[-1] + 1e-7
    np.testing.assert_allclose(certificate.weights.sum(), 4, rtol=1e-9)
    assert certificate.weights.min() >= 0
    assert certificate.weights.max() <= 1
    # of a set far from the best the bound is the same, and the gap says how far it is
    poor = greedy.removed[:4]
    cost = score(greedy.pools, poor)
    assert cost > 1.2 * best
    honest = certify(greedy.pools, poor, cost)
    assert honest.lower_bound <= best * (1 + 1e-7)
    np.testing.assert_allclose(honest.lower_bound, certificate.lower_bound, rtol=2e-4)
    np.testing.assert_allclose(honest.gap, 1 - honest.lower_bound / cost, rtol=1e-12)


def test_the_bound_on_the_worst_scenario_is_valid_and_close(oracle, beam_of, scenarios_of):
    scenarios = scenarios_of(beam_of(11, 2), ("Fz",), ("E",), instants=(55, 260, 871))
    greedy = eliminate(scenarios, 4, "worst")
    swapped = exchange(greedy.pools, greedy.kept, "worst")
    certificate = certify(greedy.pools, swapped.gauges, swapped.trace[-1], "worst")
    best = every_set(oracle, greedy.pools, 4, "worst")
    assert certificate.lower_bound <= best * (1 + 1e-7)
    assert best * (1 - 1e-7) <= swapped.trace[-1]
    assert certificate.relaxed - certificate.lower_bound < 5e-3 * certificate.relaxed
    # also where the budget ends amid the search along a line
    for budget in range(1, 13):
        stopped = certify(greedy.pools, swapped.gauges, swapped.trace[-1], "worst", budget=budget)
        assert stopped.iterations == max(budget, 3)  # one at each of three temperatures at least
        assert stopped.lower_bound <= best * (1 + 1e-7)


def test_a_stopped_search_still_gives_a_bound(beam_of, scenarios_of):
    scenarios = scenarios_of(beam_of(40), ("Fz",), ("E",), noise=1e-9)
    greedy = eliminate(scenarios, 4)
    found = [certify(greedy.pools, greedy.kept, greedy.trace[-1], budget=b) for b in (1, 3, 10, 300)]
    assert [each.iterations for each in found[:3]] == [1, 3, 10]
    assert 10 < found[3].iterations <= 300
    bounds = [each.lower_bound for each in found]
    assert bounds == sorted(bounds)
    assert bounds[-1] <= greedy.trace[-1]
    assert bounds[-1] > 0.9 * greedy.trace[-1]


def test_glued_gauges_keep_their_weight(beam_of, scenarios_of):
    scenarios = scenarios_of(beam_of(20), (), ("E",))
    free = eliminate(scenarios, 4)
    bad = int(free.removed[0])
    fixed = eliminate(scenarios, 4, fixed=[bad])
    certificate = certify(fixed.pools, fixed.kept, fixed.trace[-1], fixed=[bad])
    assert certificate.weights[bad] == 1.0
    assert certificate.lower_bound <= fixed.trace[-1]
    assert certificate.lower_bound >= certify(free.pools, free.kept, free.trace[-1]).lower_bound * (1 - 2e-4)
