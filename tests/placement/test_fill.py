"""The filling of a layout: what it holds while it looks for the next gauge."""

from __future__ import annotations

import weakref

import pytest

from strainsight.placement import fill as filling
from strainsight.placement.elimination import eliminate
from strainsight.placement.limits import as_limits


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
def test_the_loops_of_gauges_that_lose_are_let_go(beam_of, scenarios_of, monkeypatch, aggregate):
    """However many are evaluated: beside the present set's only those of the best, and of the one before."""
    result = eliminate(scenarios_of(beam_of(60, 4), ("Fz",), ("E",), instants=(55, 260)), 2)
    with_gauge, made, held = filling.with_gauge, [], []

    def watched(pools, loops, gauge):
        held.append(sum(loop() is not None for loop in made))
        grown = with_gauge(pools, loops, gauge)
        made.extend(weakref.ref(loop) for loop in grown)
        return grown

    monkeypatch.setattr(filling, "with_gauge", watched)
    filling.fill(result.pools, result.kept, as_limits(60, 3, ()), aggregate)
    assert len(held) > 10
    assert max(held) <= 2 * len(result.pools)
