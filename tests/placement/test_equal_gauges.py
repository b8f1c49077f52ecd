"""Gauges that symmetry makes equal: rounding, which differs by the number of threads, does not choose between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.placement.baselines import d_optimal, effective_independence, qr_pivoting, random_sets
from strainsight.placement.branch_and_bound import branch_and_bound
from strainsight.placement.criteria.choices import CRITERIA
from strainsight.placement.elimination import eliminate, eliminate_from
from strainsight.placement.exchange import exchange
from strainsight.placement.failure import robust_set
from strainsight.placement.fill import fill
from strainsight.placement.limits import as_limits
from strainsight.placement.metric import Metric
from strainsight.placement.score import score

KEEP, ROUNDING = 4, 1e-13


@pytest.fixture(scope="module")
def mirrored(beam_of, scenarios_of):
    """Scenario and strain rows of 5 places with 4 gauges each: bending about y and about z, each with both signs."""
    beam = beam_of(5, 5, seed=3)
    vertical = (np.abs(beam.model.input_shape[:, 0]) > np.abs(beam.model.input_shape[:, 1]))[None]
    rows = [np.where(vertical, one * beam.rows, two * beam.rows) for one in (1, -1) for two in (1, -1)]
    beam = replace(beam, rows=np.stack(rows, axis=1).reshape(-1, beam.rows.shape[1]))
    return beam, scenarios_of(beam, ("Fz", "Fy"), ("E",))[0]


def found_by_all(scenario, rows, prior) -> dict[str, tuple[int, ...]]:
    """What every way to a layout finds."""
    pool, result = len(rows), eliminate([scenario], KEEP)
    pools = result.pools
    start = random_sets(pool, KEEP, 1, seed=2)[0]
    swapped = exchange(pools, start)
    proof = branch_and_bound(pools, KEEP, start=start, time_limit=60.0)
    # what the search starts from is not what it ends with, so that its nodes are distinguished, too
    assert proof.proven
    assert proof.cost < 0.99 * score(pools, swapped.gauges)
    found = {
        "elimination": result.removed,
        "exchange": swapped.gauges,
        "swaps": np.ravel(swapped.swaps),
        "fill": fill(pools, result.kept, as_limits(pool, KEEP + 3, ())),
        "robust": robust_set(pools, KEEP).gauges,
        "proof": proof.gauges,
        "d_optimal": d_optimal(rows, np.ones(pool), prior, KEEP),
    }
    for keep in (KEEP, rows.shape[1] + 3):
        found[f"effective_independence {keep}"] = effective_independence(rows, keep)
        found[f"qr_pivoting {keep}"] = qr_pivoting(rows, keep)
    for criterion in CRITERIA[1:]:
        own = [pool.under(Metric(scenario.weight, criterion)) for pool in pools]
        found[f"elimination by {criterion.name}"] = eliminate_from(own, KEEP).removed
        found[f"exchange by {criterion.name}"] = exchange(own, start).gauges
    return {name: tuple(np.asarray(gauges).tolist()) for name, gauges in found.items()}


def test_rounding_does_not_choose_between_equal_gauges(mirrored):
    beam, scenario = mirrored
    rng = np.random.default_rng(5)

    def shaken(X: np.ndarray) -> np.ndarray:
        return X * (1 + ROUNDING * rng.standard_normal(X.shape))

    rows = beam.rows / np.abs(beam.rows).max()
    prior = np.cov(beam.x[:, : beam.model.size], rowvar=False)
    first = found_by_all(scenario, rows, prior)
    assert any(eliminate([scenario], KEEP).ties)
    Q = shaken(scenario.Q)
    other = replace(scenario, F=shaken(scenario.F), H=shaken(scenario.H), Q=0.5 * (Q + Q.T))
    assert found_by_all(other, shaken(rows), prior) == first
