"""Any set is scored by the covariance that ranks the elimination."""

from __future__ import annotations

import numpy as np

from strainsight.errors import NumericalError
from strainsight.placement.criteria.choices import CRITERIA
from strainsight.placement.elimination import eliminate
from strainsight.placement.metric import Metric
from strainsight.placement.score import score, scores

from .variances import variance
from .wandering import COMBINED


def test_the_kept_set_scores_what_the_elimination_ended_with(beam_of, scenarios_of):
    for aggregate in ("mean", "worst"):
        found = eliminate(scenarios_of(beam_of(30), ("Fz",), ("E",), instants=(55, 260)), 4, aggregate)
        np.testing.assert_allclose(score(found.pools, found.kept, aggregate), found.cost[-1], rtol=1e-8)
        np.testing.assert_allclose(score(found.pools, range(30), aggregate), found.cost[0], rtol=1e-8)


def test_a_set_that_cannot_tell_scores_infinity(beam_of, scenarios_of):
    pools = eliminate(scenarios_of(beam_of(10), ("Fz",), ("E",)), 4).pools
    unknown = np.arange(len(pools[0].P) - 2, len(pools[0].P))
    assert score(pools, [3]) == np.inf
    assert score(pools, []) == np.inf
    lost = scores(by_criteria(pools, unknown), [3], unknown, np.ones(2))
    assert lost.cost == dict.fromkeys([criterion.name for criterion in CRITERIA], np.inf)
    assert lost.std.tolist() == [np.inf] * 2


def test_standard_deviations_are_in_the_coordinates_that_were_given(oracle, beam_of, scenarios_of):
    (scenario,) = scenarios_of(beam_of(12, 3), ("Fz",), ("E",))
    pools = eliminate([scenario], 4).pools
    gauges, unknown = [1, 4, 6, 9], np.array([len(scenario.F) - 1, 0])
    P = oracle(pools[0].scenario, gauges)
    expected = (np.sqrt(np.diag(P)) * pools[0].scale)[unknown]
    found = scores(by_criteria(pools, unknown), gauges, unknown, np.ones(2))
    np.testing.assert_allclose(found.std, expected, rtol=1e-8)


def by_criteria(pools, unknown):
    """The scenarios by every criterion of these states of x*."""
    weight = np.isin(np.arange(len(pools[0].P)), unknown).astype(float)
    return {c.name: [pool.under(Metric(weight, c)) for pool in pools] for c in CRITERIA}


def test_every_metric_comes_from_the_same_covariance(oracle, beam_of, scenarios_of):
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


def test_a_set_that_is_not_solved_is_not_called_one_that_cannot_tell(beam_of, scenarios_of, monkeypatch):
    pools = eliminate(scenarios_of(beam_of(10), ("Fz",), ("E",)), 4).pools

    def refuse(*_):
        raise NumericalError("not solved")

    monkeypatch.setattr("strainsight.placement.score.subset_covariance", refuse)
    found = scores(by_criteria(pools, [0]), [1, 2, 3], np.array([0]), np.ones(1))
    assert np.isnan([*found.cost.values(), *found.std]).all()
