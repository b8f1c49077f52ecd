"""Optimal set with a proof: branch and bound over the convex relaxation."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from heapq import heapify, heappop, heappush
from time import monotonic

import numpy as np
from scipy.spatial import cKDTree

from strainsight.errors import InfeasibleError, NumericalError
from strainsight.mesh.coincident import component_labels
from strainsight.ordering import TIE, tied_order
from strainsight.placement.certificate import Bound, Cut, certify, cut_at, detects, lowest
from strainsight.placement.elimination import eliminate_from
from strainsight.placement.exchange import exchange, fill
from strainsight.placement.limits import Limits, as_limits
from strainsight.placement.scenario import Aggregate, Pool, aggregated
from strainsight.placement.score import score
from strainsight.placement.witness import twin_groups

ROUNDS = 12
"""Most cuts per node; a node branches earlier when cuts no longer pay."""
PAYS = 0.1
"""Share of the distance to the incumbent that a cut must close for the next one to pay."""
DULL = 100.0
"""Relaxed cost, relative to the incumbent, above which no cut is made: its slope would be too steep."""
LEVEL = 1e-5
"""Difference of weights, from 0 to 1, below which they tie: relaxed optima differ by up to 5e-7 between processors and BLAS."""
TWIN = 1e-9
"""Relative distance of rows h/√r below which gauges are twins; mirrored gauges differ by up to 3e-11."""


@dataclass(frozen=True)
class Node:
    """Sets that contain all gauges of `inside` and none of `outside`, both (pool,) bool; cuts of its parent; centre (pool,):
    best relaxed weights so far."""

    inside: np.ndarray
    outside: np.ndarray
    cuts: tuple[Cut, ...]
    centre: np.ndarray


class Search:
    """The incumbent, and the expansion of a node."""

    def __init__(self, pools: Sequence[Pool], limits: Limits, aggregate: Aggregate):
        self.pools, self.limits, self.aggregate = pools, limits, aggregate
        # gauges that the limits distinguish cannot stand for each other
        self.twins = np.unique(_twins(pools) * len(limits.size) + limits.labels, return_inverse=True)[1]
        self.tried: set[tuple[int, ...]] = set()
        self.best: np.ndarray | None = None
        self.cost = np.inf
        self.unsolved = np.inf

    @property
    def target(self) -> float:
        """Cost from which a set is no improvement: a set that is better by no more than a tie is not taken, so that nothing
        closer can be claimed."""
        return self.cost * (1 - TIE)

    def offer(self, gauges: np.ndarray, bound: float = np.inf) -> None:
        """Accept a set and its improving swaps as incumbent if it costs less. If its covariance cannot be solved accurately,
        only `bound` is known."""
        while tuple(gauges) not in self.tried:
            self.tried.add(tuple(gauges))
            try:
                cost = score(self.pools, gauges, self.aggregate)
            except NumericalError:
                self.tried.remove(tuple(gauges))
                self.unsolved = min(self.unsolved, bound)
                return
            if not cost < self.cost * (1 - TIE):
                return
            self.best, self.cost = gauges, cost
            with suppress(NumericalError):
                gauges = exchange(self.pools, gauges, self.aggregate, limits=self.limits).gauges

    def root(self, inside: np.ndarray) -> Node:
        """All sets, from the weights of the certificate if there is an incumbent."""
        size = self.limits.size
        free, left = int(size[~inside].sum()), self.limits.keep - int(size[inside].sum())
        w = np.where(inside, 1.0, left / max(free, 1))
        if self.best is not None and 0 < left < free:
            with suppress(NumericalError):
                w = certify(self.pools, self.best, self.cost, self.aggregate, limits=self.limits).weights
        cut = cut_at(self.pools, w, None)
        return Node(inside, np.zeros_like(inside), () if cut is None else (cut,), w)

    def children(self, node: Node, bound: float) -> list[tuple[float, Node]]:
        """Add cuts until they no longer pay, then split the node in two halves with their bounds; () if none remains. Nodes
        without an observable set are discarded, and single sets are scored."""
        inside, outside, cuts = node.inside, node.outside, list(node.cuts)
        if not all(detects(pool, pool.stacked(~outside)) for pool in self.pools):
            return []
        centre, level, low = node.centre, np.inf, None
        history = [bound]
        while True:
            used = self.limits.used(inside)
            if np.any(used > self.limits.most):
                return []
            outside = outside | (~inside & self.limits.too_large(used))
            free = ~(inside | outside)
            if self.limits.size[inside | free].sum() < self.limits.least:
                return []
            if np.all(self.limits.used(inside | free) <= self.limits.most):
                self.offer(np.flatnonzero(inside | free), bound)
                return []
            centre = _within(centre, inside, free, self.limits)
            if low is None and not cuts:
                cuts += self._cut(centre, inside, free, None)
                if not cuts:
                    break
            low = lowest(cuts, inside, free, self.limits, self.aggregate)
            cuts = [cut for cut, active in zip(cuts, low.active, strict=True) if active]
            bound = max(bound, low.value)
            history.append(bound)
            if bound >= self.target:
                return []
            if (decided := free & (low.value + low.reduced >= self.target)).any():
                inside, outside = inside | (decided & low.selected), outside | (decided & ~low.selected)
                continue
            self._round(cuts, low.weights, inside)
            if len(history) > ROUNDS or (len(history) > 4 and history[-1] - history[-4] < PAYS * (self.target - bound)):
                break
            between = 0.5 * (centre + low.weights)
            if not (new := self._cut(between, inside, free, cuts[-1].P)):
                break
            cuts += new
            cost = float(aggregated(new[0].cost, self.aggregate))
            if cost < level:
                centre, level = between, cost
        return self._halves(inside, outside, bound, low, Node(inside, outside, tuple(cuts), centre))

    def _halves(
        self, inside: np.ndarray, outside: np.ndarray, bound: float, low: Bound | None, node: Node
    ) -> list[tuple[float, Node]]:
        """Sets with and without the most fractional gauge; of twins, the lowest index."""
        free = ~(inside | outside)
        most = int(tied_order(np.where(free, np.abs(node.centre - 0.5), np.inf), LEVEL)[0])
        same = free & (self.twins == self.twins[most])
        gauge = int(np.flatnonzero(same)[0])
        with_it = inside.copy()
        with_it[gauge] = True
        bounds = [bound, bound]
        if low is not None:
            bounds[int(low.selected[gauge])] = max(bound, low.value + float(low.reduced[gauge]))
        halves = [replace(node, inside=with_it), replace(node, outside=outside | same)]
        return [(b, half) for b, half in zip(bounds, halves, strict=True) if b < self.target]

    def _cut(self, w: np.ndarray, inside: np.ndarray, free: np.ndarray, last: Sequence[np.ndarray] | None) -> list[Cut]:
        """The cut at w, or halfway to equal weights if w (nearly) loses an unknown; () if that one does."""
        size = self.limits.size
        share = (self.limits.keep - int(size[inside].sum())) / max(int(size[free].sum()), 1)
        equal = np.where(inside, 1.0, np.where(free, min(share, 1.0), 0.0))
        for point in (w, 0.5 * (w + equal), equal):
            cut = cut_at(self.pools, point, last)
            if cut is not None and cut.cost.max() <= DULL * self.cost:
                return [cut]
        return []

    def _round(self, cuts: Sequence[Cut], weights: np.ndarray, inside: np.ndarray) -> None:
        """Offer the gauges of the largest weights that fit, unless the cuts exclude them."""
        chosen = self.limits.packed(tied_order(-weights, LEVEL), inside)
        if not self.limits.allows(chosen):
            return
        planes = np.array([cut.offset + cut.slope[:, chosen].sum(axis=1) for cut in cuts])
        if aggregated(planes.max(axis=0), self.aggregate) < self.target:
            self.offer(chosen)


def _within(w: np.ndarray, inside: np.ndarray, free: np.ndarray, limits: Limits) -> np.ndarray:
    """w (pool,) with 1 inside, 0 outside and a permitted sum of gauges, moved proportionally towards 0 or 1."""
    moved = inside.astype(float)
    part, size, count = w[free], limits.size[free], int(limits.size[inside].sum())
    total, whole = float(size @ part), float(size.sum())
    most, least = limits.keep - count, limits.least - count
    if total > most:
        part = part * (most / total)
    elif total < least:
        part = 1 - (1 - part) * ((whole - least) / max(whole - total, np.finfo(float).tiny))
    moved[free] = part
    return moved


def _twins(pools: Sequence[Pool]) -> np.ndarray:
    """Label of each gauge, the same for equal channels ±h/√r in all scenarios."""
    keys = []
    for pool in pools:
        length = np.linalg.norm(pool.rows, axis=2, keepdims=True)
        size = np.where(length > 0, length, 1.0)
        unit = pool.rows / size
        # the sign of the first of the largest entries, which are ± equal for symmetric rows
        largest = np.abs(unit) >= (1 - TIE) * np.abs(unit).max(axis=2, keepdims=True)
        sign = np.sign(np.take_along_axis(unit, largest.argmax(axis=2)[:, :, None], axis=2))
        keys.append(_near(np.concatenate([unit * sign, np.log(size)], axis=2)))
    return twin_groups(keys)


def _near(points: np.ndarray) -> np.ndarray:
    """A number for each point (m, c, k), as (m, c, 1), the same for distances up to `TWIN`."""
    different, place = np.unique(points.reshape(-1, points.shape[2]), axis=0, return_inverse=True)
    pairs = cKDTree(different).query_pairs(TWIN, output_type="ndarray")
    label = component_labels(len(different), *pairs.T)
    return np.asarray(label[place.ravel()], dtype=float).reshape(*points.shape[:2], 1)


@dataclass(frozen=True)
class BranchAndBound:
    """gauges (keep,) ascending and their cost; lower_bound of all sets; proven: cost ≤ lower_bound/(1 − TIE), the search ended
    in time; nodes solved. Without any set in time, gauges is empty and cost inf."""

    gauges: np.ndarray
    cost: float
    lower_bound: float
    proven: bool
    nodes: int


def branch_and_bound(
    pools: Sequence[Pool],
    keep: int | Limits,
    aggregate: Aggregate = "mean",
    *,
    start: Sequence[int] | np.ndarray | None = None,
    time_limit: float = 60.0,
) -> BranchAndBound:
    """The set of `keep` gauges, or the layout within `Limits`, of the least aggregate of the metric, or the best one and the
    best bound that `time_limit` [s] allows.

        f_s(v) ≥ f_s(w) + ∇f_s(w)·(v − w)  for all v ≥ 0:  a cut at any w bounds every node, and the node is the LP
        min agg(t_s) over cuts, 0 ≤ v ≤ 1, Σ v = keep and the limits, v = 1 on gauges taken, v = 0 on gauges left out

    The bound of a node is that of its LP multipliers, evaluated exactly; they also take or leave every gauge whose
    reduced cost alone reaches the incumbent. Best bound first; the most fractional gauge is branched on, twins
    together. A node ends where its bound reaches incumbent·(1 − TIE): a set has to be better by so much to be taken.
    Sets that lose an unknown cost infinity.
    start: a first set, swapped until no swap helps; without it the elimination's. The clock is
    looked at between nodes, after the first; what ends before its time does not depend on it.
    Raises ConfigError for an impossible `keep`, InfeasibleError where no such layout detects every unknown.
    Source: Quesada and Grossmann, Comput. Chem. Eng. 16 (1992)."""
    began = monotonic()
    limits = as_limits(len(pools[0].rows), keep)
    search = Search(pools, limits, aggregate)
    if (first := _first_set(pools, limits, aggregate, start)) is not None:
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
            f"no layout of {limits.keep} candidate gauges{'' if limits.plain else ' within the limits'} makes every unknown "
            "observable",
            remedy=f"keep more gauges (place.keep){'' if limits.plain else ', widen the limits'}, or estimate fewer unknowns",
        )
    gauges = np.zeros(0, dtype=int) if search.best is None else search.best
    open_bound = min(search.unsolved, heap[0][0] if heap else np.inf)
    proven = open_bound >= search.target
    return BranchAndBound(gauges, search.cost, float(min(open_bound, search.target)), proven, nodes)


def _first_set(
    pools: Sequence[Pool], limits: Limits, aggregate: Aggregate, start: Sequence[int] | np.ndarray | None
) -> np.ndarray | None:
    """`start`, or the result of the elimination; None if it ends early, which proves nothing."""
    if start is not None:
        gauges = np.unique(np.asarray(start, dtype=int))
        if not limits.allows(gauges):
            what = (
                f"{limits.keep} different gauges that contain"
                if limits.plain
                else "a layout within the limits that contains"
            )
            raise ValueError(f"the search must start from {what} the fixed gauges")
        return gauges
    try:
        return fill(pools, eliminate_from(pools, limits, aggregate).selected, limits, aggregate)
    except InfeasibleError:
        return None
