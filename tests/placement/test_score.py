"""Any set is scored by the covariance that ranks the elimination."""

from __future__ import annotations

import numpy as np

from strainsight.placement.elimination import eliminate
from strainsight.placement.score import frozen_std, score


def test_the_kept_set_scores_what_the_elimination_ended_with(beam_of, scenarios_of):
    for aggregate in ("mean", "worst"):
        found = eliminate(scenarios_of(beam_of(30), ("Fz",), ("E",), instants=(55, 260)), 4, aggregate)
        np.testing.assert_allclose(score(found.pools, found.kept, aggregate), found.trace[-1], rtol=1e-8)
        np.testing.assert_allclose(score(found.pools, range(30), aggregate), found.trace[0], rtol=1e-8)


def test_a_set_that_cannot_tell_scores_infinity(beam_of, scenarios_of):
    pools = eliminate(scenarios_of(beam_of(10), ("Fz",), ("E",)), 4).pools
    assert score(pools, [3]) == np.inf
    assert score(pools, []) == np.inf
    assert np.all(frozen_std(pools, [3], 2) == np.inf)


def test_standard_deviations_are_in_the_coordinates_that_were_given(oracle, beam_of, scenarios_of):
    (scenario,) = scenarios_of(beam_of(12, 3), ("Fz",), ("E",))
    pools = eliminate([scenario], 4).pools
    gauges = [1, 4, 6, 9]
    P = oracle(pools[0].scenario, gauges)
    expected = (np.sqrt(np.diag(P)) * pools[0].scale)[-2:]
    np.testing.assert_allclose(frozen_std(pools, gauges, 2)[0], expected, rtol=1e-8)
