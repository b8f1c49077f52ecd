"""The best set of all, with a proof: branch and bound over the convex relaxation."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from heapq import heapify, heappop, heappush
from time import monotonic

import numpy as np

from strainsight.errors import ConfigError, InfeasibleError, NumericalError
from strainsight.placement.certificate import certify
from strainsight.placement.cuts import Bound, Cut, cut_at, detects, lowest
from strainsight.placement.elimination import eliminate
from strainsight.placement.exchange import exchange
from strainsight.placement.scenario import Aggregate, Pool, aggregated
from strainsight.placement.score import score

ROUNDS = 12
"""Most cuts of one node; it branches sooner where they stop paying."""
PAYS = 0.1
"""A further cut pays where the last one closed this share of the distance to the incumbent."""
DULL = 100.0
"""No cut is taken where the relaxed cost is this many times the incumbent: its slope is too steep to be of use."""
TWIN = 1e-12
"""Rows h/√r that differ by less than this share of their length are one gauge twice."""


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


@dataclass(frozen=True)
class _Node:
    """The sets that hold every gauge of `inside` and none of `outside`, both (pool,) bool; cuts of its parent; centre
    (pool,): the best relaxed weights known so far."""

    inside: np.ndarray
    outside: np.ndarray
    cuts: tuple[Cut, ...]
    centre: np.ndarray


def branch_and_bound(
    pools: Sequence[Pool],
    keep: int,
    aggregate: Aggregate = "mean",
    *,
    fixed: Collection[int] = (),
    start: Sequence[int] | np.ndarray | None = None,
    time_limit: float = 60.0,
    gap: float = 1e-6,
) -> BranchAndBound:
    """The set of `keep` gauges of the least aggregate of tr(W P), or the best set and bound that `time_limit` [s] allows.

        f_s(v) ≥ f_s(w) + ∇f_s(w)·(v − w)  for all v ≥ 0:  a cut at any w bounds every node, and the node is the LP
        min agg(t_s) over cuts, 0 ≤ v ≤ 1, Σ v = keep, v = 1 on gauges taken, v = 0 on gauges left out

    The bound of a node is that of its LP multipliers, evaluated exactly; they also take or leave every gauge whose
    reduced cost alone reaches the incumbent. Best bound first; the most fractional gauge is branched on, twins together.
    A node ends where its bound reaches incumbent·(1 − gap). Sets that lose an unknown cost infinity.
    fixed: gauges that stay; start: a first set, swapped until no swap helps; without it the elimination's. The clock is
    looked at between nodes, after the first; what ends before its time does not depend on it.
    Raises ConfigError for an impossible `keep`, InfeasibleError where no such set detects every unknown.
    Source: Quesada and Grossmann, Comput. Chem. Eng. 16 (1992).
    """
    began = monotonic()
    count = len(pools[0].rows)
    if not max(1, len(set(fixed))) <= keep <= count:
        raise ConfigError(
            f"{keep} gauges are to be kept of a pool of {count} with {len(set(fixed))} fixed",
            remedy=f"keep between {max(1, len(set(fixed)))} and {count}",
        )
    search = _Search(pools, keep, aggregate, fixed, gap)
    first = _first_set(pools, keep, aggregate, fixed, start)
    if first is not None:
        search.offer(first)
    inside = np.isin(np.arange(count), list(fixed))
    heap: list[tuple[float, int, _Node]] = [(-np.inf, 0, search.root(inside))]
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
            f"no set of {keep} gauges of the pool detects every unknown",
            remedy="keep more gauges, or estimate fewer unknowns",
        )
    gauges = np.zeros(0, dtype=int) if search.best is None else search.best
    open_bound = min(search.unsolved, heap[0][0] if heap else np.inf)
    proven = open_bound >= search.target
    return BranchAndBound(
        gauges, search.cost, float(min(open_bound, search.target)), proven, nodes, monotonic() - began
    )


class _Search:
    """The incumbent, and what one node becomes."""

    def __init__(self, pools: Sequence[Pool], keep: int, aggregate: Aggregate, fixed: Collection[int], gap: float):
        self.pools, self.keep, self.aggregate, self.fixed, self.gap = pools, keep, aggregate, fixed, gap
        self.twins = _twins(pools)
        self.tried: set[tuple[int, ...]] = set()
        self.best: np.ndarray | None = None
        self.cost = np.inf
        self.unsolved = np.inf

    @property
    def target(self) -> float:
        """A set that costs at least this much is no improvement."""
        return self.cost * (1 - self.gap)

    def offer(self, gauges: np.ndarray, bound: float = np.inf) -> None:
        """Take a set as incumbent if it costs less, with the swaps that help it.

        Where its covariance cannot be solved to accuracy, `bound` is all that is known of it.
        """
        while tuple(gauges) not in self.tried:
            self.tried.add(tuple(gauges))
            try:
                cost = score(self.pools, gauges, self.aggregate)
            except NumericalError:
                self.tried.remove(tuple(gauges))
                self.unsolved = min(self.unsolved, bound)
                return
            if not cost < self.cost:
                return
            self.best, self.cost = gauges, cost
            with suppress(NumericalError):
                gauges = exchange(self.pools, gauges, self.aggregate, fixed=self.fixed).gauges

    def root(self, inside: np.ndarray) -> _Node:
        """Every set, from the weights of the certificate where there is an incumbent."""
        free = int((~inside).sum())
        w = np.where(inside, 1.0, (self.keep - inside.sum()) / max(free, 1))
        if self.best is not None and 0 < self.keep - inside.sum() < free:
            with suppress(NumericalError):
                w = certify(self.pools, self.best, self.cost, self.aggregate, fixed=self.fixed).weights
        cut = cut_at(self.pools, w, None)
        return _Node(inside, np.zeros_like(inside), () if cut is None else (cut,), w)

    def children(self, node: _Node, bound: float) -> list[tuple[float, _Node]]:
        """Cuts until they no longer pay, then the two halves of the node with their bounds; () where none is left.

        Empties, too, a node whose gauges lose an unknown all together, and scores one that holds a single set.
        """
        inside, outside, cuts = node.inside, node.outside, list(node.cuts)
        if self._loses(~outside):
            return []
        centre, level, low = node.centre, np.inf, None
        history = [bound]
        while True:
            free = ~(inside | outside)
            left = self.keep - int(inside.sum())
            if not 0 <= left <= free.sum():
                return []
            if left in (0, free.sum()):
                self.offer(np.flatnonzero(inside | free if left else inside), bound)
                return []
            centre = _within(centre, inside, free, left)
            if low is None and not cuts:
                cuts += self._cut(centre, inside, free, left, None)
                if not cuts:
                    break
            low = lowest(cuts, inside, free, self.keep, self.aggregate)
            cuts = [cut for cut, active in zip(cuts, low.active, strict=True) if active]
            bound = max(bound, low.value)
            history.append(bound)
            if bound >= self.target:
                return []
            decided = free & (low.value + low.reduced >= self.target)
            if decided.any():
                inside, outside = inside | (decided & low.taken), outside | (decided & ~low.taken)
                continue
            self._round(cuts, low.weights)
            if len(history) > ROUNDS or (len(history) > 4 and history[-1] - history[-4] < PAYS * (self.target - bound)):
                break
            between = 0.5 * (centre + low.weights)
            new = self._cut(between, inside, free, left, cuts[-1].P)
            if not new:
                break
            cuts += new
            cost = float(aggregated(new[0].cost, self.aggregate))
            if cost < level:
                centre, level = between, cost
        return self._halves(inside, outside, bound, low, _Node(inside, outside, tuple(cuts), centre))

    def _halves(
        self, inside: np.ndarray, outside: np.ndarray, bound: float, low: Bound | None, node: _Node
    ) -> list[tuple[float, _Node]]:
        """The sets with the most fractional gauge and those without it; of twins, the lowest index is taken first."""
        free = ~(inside | outside)
        most = int(np.argmin(np.where(free, np.abs(node.centre - 0.5), np.inf)))
        same = free & (self.twins == self.twins[most])
        gauge = int(np.flatnonzero(same)[0])
        with_it = inside.copy()
        with_it[gauge] = True
        bounds = [bound, bound]
        if low is not None:
            bounds[int(low.taken[gauge])] = max(bound, low.value + float(low.reduced[gauge]))
        halves = [replace(node, inside=with_it), replace(node, outside=outside | same)]
        return [(b, half) for b, half in zip(bounds, halves, strict=True) if b < self.target]

    def _cut(
        self, w: np.ndarray, inside: np.ndarray, free: np.ndarray, left: int, last: Sequence[np.ndarray] | None
    ) -> list[Cut]:
        """The cut at w, or halfway to equal weights where w loses an unknown or nearly does; () where that one does."""
        equal = np.where(inside, 1.0, np.where(free, left / max(int(free.sum()), 1), 0.0))
        for point in (w, 0.5 * (w + equal), equal):
            cut = cut_at(self.pools, point, last)
            if cut is not None and cut.cost.max() <= DULL * self.cost:
                return [cut]
        return []

    def _round(self, cuts: Sequence[Cut], weights: np.ndarray) -> None:
        """Offer the gauges of the largest weights, unless the cuts say that they cost too much."""
        chosen = np.sort(np.argsort(-weights, kind="stable")[: self.keep])
        planes = np.array([cut.offset + cut.slope[:, chosen].sum(axis=1) for cut in cuts])
        if aggregated(planes.max(axis=0), self.aggregate) < self.target:
            self.offer(chosen)

    def _loses(self, gauges: np.ndarray) -> bool:
        return not all(detects(pool, pool.rows[gauges]) for pool in self.pools)


def _first_set(
    pools: Sequence[Pool],
    keep: int,
    aggregate: Aggregate,
    fixed: Collection[int],
    start: Sequence[int] | np.ndarray | None,
) -> np.ndarray | None:
    """`start`, or what the elimination keeps; None where it ends before `keep`, which does not prove that no set does."""
    if start is not None:
        gauges = np.unique(np.asarray(start, dtype=int))
        if len(gauges) != keep or not set(fixed) <= set(gauges.tolist()):
            raise ValueError(f"the search starts from {keep} different gauges, the fixed ones among them")
        return gauges
    try:
        return eliminate([p.scenario for p in pools], keep, aggregate, fixed=fixed).kept
    except InfeasibleError:
        return None


def _within(w: np.ndarray, inside: np.ndarray, free: np.ndarray, left: int) -> np.ndarray:
    """w (pool,) moved to 1 inside, 0 outside and a sum of `left` on the free gauges, towards 0 or 1 in proportion."""
    moved = inside.astype(float)
    part = w[free]
    total, most = float(part.sum()), len(part)
    if total > left:
        moved[free] = part * (left / total)
    else:
        moved[free] = 1 - (1 - part) * ((most - left) / max(most - total, np.finfo(float).tiny))
    return moved


def _twins(pools: Sequence[Pool]) -> np.ndarray:
    """A label for every gauge, the same where the rows ±h/√r of all scenarios are: such gauges can stand for each other."""
    keys = []
    for pool in pools:
        length = np.linalg.norm(pool.rows, axis=1)
        unit = pool.rows / np.where(length > 0, length, 1.0)[:, None]
        sign = np.sign(unit[np.arange(len(unit)), np.argmax(np.abs(unit), axis=1)])
        keys += [unit * sign[:, None], np.log(np.where(length > 0, length, 1.0))[:, None]]
    return np.unique(np.round(np.hstack(keys) / TWIN) * TWIN, axis=0, return_inverse=True)[1].ravel()
