"""The best set of all, with a proof: branch and bound over the convex relaxation."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from time import monotonic

import numpy as np

from strainsight.errors import InfeasibleError
from strainsight.ordering import TIE
from strainsight.placement.elimination import eliminate_from
from strainsight.placement.fill import fill
from strainsight.placement.limits import Limits, as_limits
from strainsight.placement.nodes import Node, Search
from strainsight.placement.scenario import Aggregate, Pool


@dataclass(frozen=True)
class BranchAndBound:
    """gauges (keep,) ascending and their cost; no set costs less than lower_bound; proven: cost ≤ lower_bound/(1 − gap),
    the search ended before its time; nodes solved; seconds. Where the time was too short for any set, gauges is empty and
    cost inf."""

    gauges: np.ndarray
    cost: float
    lower_bound: float
    proven: bool
    nodes: int
    seconds: float


def branch_and_bound(
    pools: Sequence[Pool],
    keep: int | Limits,
    aggregate: Aggregate = "mean",
    *,
    fixed: Collection[int] = (),
    start: Sequence[int] | np.ndarray | None = None,
    time_limit: float = 60.0,
    gap: float = TIE,
) -> BranchAndBound:
    """The set of `keep` gauges, or the layout within `Limits`, of the least aggregate of the metric, or the best one and the
    best bound that `time_limit` [s] allows.

        f_s(v) ≥ f_s(w) + ∇f_s(w)·(v − w)  for all v ≥ 0:  a cut at any w bounds every node, and the node is the LP
        min agg(t_s) over cuts, 0 ≤ v ≤ 1, Σ v = keep and the limits, v = 1 on gauges taken, v = 0 on gauges left out

    The bound of a node is that of its LP multipliers, evaluated exactly; they also take or leave every gauge whose
    reduced cost alone reaches the incumbent. Best bound first; the most fractional gauge is branched on, twins together.
    A node ends where its bound reaches incumbent·(1 − gap), where a gap below `TIE` counts as that: a set has to be better
    by so much to be taken. Sets that lose an unknown cost infinity.
    fixed: gauges that stay; start: a first set, swapped until no swap helps; without it the elimination's. The clock is
    looked at between nodes, after the first; what ends before its time does not depend on it.
    Raises ConfigError for an impossible `keep`, InfeasibleError where no such layout detects every unknown.
    Source: Quesada and Grossmann, Comput. Chem. Eng. 16 (1992).
    """
    began = monotonic()
    limits = as_limits(len(pools[0].rows), keep, fixed)
    search = Search(pools, limits, aggregate, gap)
    first = _first_set(pools, limits, aggregate, start)
    if first is not None:
        search.offer(first)
    inside = np.isin(np.arange(len(limits.size)), list(limits.fixed))
    heap: list[tuple[float, int, Node]] = [(-np.inf, 0, search.root(inside))]
    nodes, order = 0, 0
    while heap and heap[0][0] < search.target and (nodes == 0 or monotonic() - began < time_limit):
        bound, _, node = heappop(heap)
        nodes += 1
        before = search.target
        for child_bound, child in search.children(node, bound):
            order += 1
            heappush(heap, (child_bound, order, child))
        if search.target < before:
            heap = [entry for entry in heap if entry[0] < search.target]
            heapify(heap)
    if search.best is None and not heap and search.unsolved == np.inf:
        raise InfeasibleError(
            f"no set of {limits.keep} gauges of the pool{'' if limits.plain else ' within the limits'} detects every unknown",
            remedy=f"keep more gauges{'' if limits.plain else ', widen the limits'}, or estimate fewer unknowns",
        )
    gauges = np.zeros(0, dtype=int) if search.best is None else search.best
    open_bound = min(search.unsolved, heap[0][0] if heap else np.inf)
    proven = open_bound >= search.target
    return BranchAndBound(
        gauges, search.cost, float(min(open_bound, search.target)), proven, nodes, monotonic() - began
    )


def _first_set(
    pools: Sequence[Pool], limits: Limits, aggregate: Aggregate, start: Sequence[int] | np.ndarray | None
) -> np.ndarray | None:
    """`start`, or what the elimination keeps; None where it ends before that, which does not prove that no set does."""
    if start is not None:
        gauges = np.unique(np.asarray(start, dtype=int))
        if not limits.allows(gauges):
            what = f"{limits.keep} different gauges" if limits.plain else "a layout within the limits"
            raise ValueError(f"the search starts from {what}, the fixed ones among them")
        return gauges
    try:
        return fill(pools, eliminate_from(pools, limits, aggregate).kept, limits, aggregate)
    except InfeasibleError:
        return None
