"""After the swaps no single swap helps."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.placement.baselines import random_sets
from strainsight.placement.elimination import eliminate
from strainsight.placement.exchange import exchange
from strainsight.placement.limits import limits_of
from strainsight.placement.score import score


@pytest.mark.parametrize(("aggregate", "instants"), [("mean", (63,)), ("mean", (55, 871)), ("worst", (55, 871))])
def test_no_single_swap_helps_any_more(beam_of, scenarios_of, aggregate, instants):
    scenarios = scenarios_of(beam_of(16, 5), ("Fz",), ("E",), instants=instants)
    pools = eliminate(scenarios, 4, aggregate).pools
    start = random_sets(16, 4, 1, seed=8)[0]
    found = exchange(pools, start, aggregate)
    assert found.complete
    assert len(found.swaps) == len(found.trace) - 1 > 0
    assert all(b < a for a, b in zip(found.trace, found.trace[1:], strict=False))
    present = score(pools, found.gauges, aggregate)
    assert abs(present - found.trace[-1]) < 1e-8 * present
    for out in found.gauges:
        for into in set(range(16)) - set(found.gauges.tolist()):
            other = sorted({*found.gauges.tolist(), into} - {int(out)})
            assert score(pools, other, aggregate) >= present * (1 - 2e-9)


def test_glued_gauges_are_not_swapped_and_a_limit_is_kept(beam_of, scenarios_of):
    pools = eliminate(scenarios_of(beam_of(30), ("Fz",), ("E",)), 4).pools
    start = random_sets(30, 4, 1, seed=3)[0]
    glued = [int(start[0]), int(start[2])]
    assert set(glued) <= set(exchange(pools, start, fixed=glued).gauges.tolist())
    stopped = exchange(pools, start, limit=1)
    assert not stopped.complete
    assert stopped.trace[-1] <= stopped.trace[0]


@pytest.mark.parametrize("instants", [(63,), (55, 871)])
def test_the_limit_is_never_passed_and_never_passes_for_an_end(beam_of, scenarios_of, instants):
    pools = eliminate(scenarios_of(beam_of(16, 5), ("Fz",), ("E",), instants=instants), 4).pools
    start = random_sets(16, 4, 1, seed=8)[0]
    whole = exchange(pools, start)
    assert whole.complete
    assert len(whole.swaps) > 0
    for limit in range(0, whole.solves, 3):
        stopped = exchange(pools, start, limit=limit)
        assert stopped.solves <= limit
        assert not stopped.complete
        assert stopped.swaps == whole.swaps[: len(stopped.swaps)]
    exact = exchange(pools, start, limit=whole.solves)
    assert exact.complete
    assert exact.swaps == whole.swaps


def test_an_undetectable_start_is_a_mistake_of_the_caller(beam_of, scenarios_of):
    pools = eliminate(scenarios_of(beam_of(10), ("Fz",), ("E",)), 4).pools
    with pytest.raises(ValueError, match="detects every unknown"):
        exchange(pools, [3])


def test_beside_gauges_that_may_not_leave_room_is_filled(beam_of, scenarios_of):
    """Every gauge is glued and the budget has room for two: two are added, each lowers the cost, and no more is tried."""
    pools = eliminate(scenarios_of(beam_of(12), ("Fz",), ("E",)), 4).pools
    glued = [1, 5, 7]
    limits = limits_of(12, 6, fixed=glued, price=np.ones(12), budget=5.0)
    found = exchange(pools, glued, limits=limits)
    assert [out for out, _ in found.swaps] == [-1, -1]
    assert len(found.gauges) == 5
    assert set(glued) <= set(found.gauges.tolist())
    assert found.trace[0] > found.trace[1] > found.trace[2]
    assert found.complete
    full = exchange(pools, found.gauges, limits=limits, fixed=found.gauges.tolist())
    assert (full.swaps, full.solves, full.complete) == ((), 0, True)
