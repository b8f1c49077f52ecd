"""Metric of a layout after the failure of any gauge, and robust layouts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from strainsight.errors import InfeasibleError, NumericalError
from strainsight.ordering import TIE, tied_order
from strainsight.placement.elimination import eliminate_from
from strainsight.placement.exchange import costs_of, exchange, fill, gradients_of
from strainsight.placement.limits import BUDGET, Limits, Swaps, as_limits
from strainsight.placement.scenario import Aggregate, Gauges, Pool, aggregated, fewest_gauges, loops_of
from strainsight.placement.score import score

SOLVES = 20_000
"""Exact Riccati solves after which the search for a robust layout ends."""


class LossSearch:
    """Losses of a set {gauge: cost after its failure, NaN if not solved} and swaps that reduce the largest, within a number of
    solves."""

    def __init__(self, pools: Sequence[Pool], aggregate: Aggregate, limits: Limits, limit: int):
        self.pools, self.aggregate, self.limits, self.limit, self.solves = pools, aggregate, limits, limit, 0

    def reduced(self, chosen: list[int]) -> list[int]:
        """A layout of gauges of `chosen`, which are too many or too expensive: the one whose removal leaves the least measure
        goes first, the lower index on a tie."""
        while (broken := self.limits.used(np.array(chosen)) > self.limits.most).any():
            part = self.limits.rows[broken].sum(axis=0)
            least, rest = (len(chosen), np.inf), chosen
            for out in (g for g in chosen if g not in self.limits.fixed and part[g] > 0):
                others = [g for g in chosen if g != out]
                if loss := self.losses(others, (least[0], least[1] * (1 - TIE))):
                    least, rest = measure(loss), others
            chosen = rest
        return chosen

    def swapped(self, chosen: list[int]) -> tuple[list[int], dict[int, float]]:
        """The set after all improving swaps, and its losses."""
        loss = self.losses(chosen, (len(chosen), np.inf))
        while (swap := self.first_gain(chosen, loss)) is not None:
            out, into, loss = swap
            chosen = sorted({*chosen, into} - {out})
        return chosen, loss

    def losses(
        self,
        chosen: Sequence[int],
        below: tuple[int, float],
        order: Sequence[int] | None = None,
        known: dict[int, float] | None = None,
    ) -> dict[int, float]:
        """All losses of a set, those of `order` first; {} as soon as they are not below (fatal, largest)."""
        loss = dict(known or {})
        for g in chosen if order is None else order:
            if g not in loss:
                loss[g] = _without(self.pools, chosen, g, self.aggregate)
                self.solves += len(self.pools)
            fatal, largest = measure(loss)
            if fatal > below[0] or (fatal == below[0] and largest >= below[1]):
                return {}
        return loss

    def first_gain(self, chosen: list[int], loss: dict[int, float]) -> tuple[int, int, dict[int, float]] | None:
        """The improving swap (out, in) with the least bound, and the losses after it; None if no swap helps."""
        fatal, largest = measure(loss)
        enough = largest * (1 - TIE)
        others = [g for g in range(len(self.pools[0].rows)) if g not in set(chosen)]
        swaps = Swaps(self.limits, np.array(chosen), np.array(chosen))
        added = self._first_addition(chosen, [g for g in others if swaps.room[g]], loss)
        if added is not None:
            return added
        bounds = self._bounds(chosen, others, loss)
        movable = np.array([g not in self.limits.fixed for g in chosen])
        may = np.array([swaps.out(g) for g in others], dtype=bool).reshape(len(others), len(chosen)).T
        least = np.where(movable[:, None] & may, bounds.max(axis=0), np.inf)
        for at in tied_order(least.ravel()):
            i, j = divmod(int(at), len(others))
            if least[i, j] >= enough or self.solves >= self.limit:
                break
            out, into = chosen[i], others[j]
            swapped = sorted({*chosen, into} - {out})
            likely = [chosen[g] for g in tied_order(-bounds[:, i, j]) if g != i]
            if new := self.losses(swapped, (fatal, enough), [into, *likely], {into: loss[out]}):
                return out, into, new
        return None

    def _first_addition(
        self, chosen: list[int], room: list[int], loss: dict[int, float]
    ) -> tuple[int, int, dict[int, float]] | None:
        """The gauge that fits in addition to the set and helps, as a swap for −1: L ≥ f(S − g + j) ≥ agg(f_s − φᵍ_j)."""
        if not room:
            return None
        fatal, largest = measure(loss)
        enough = largest * (1 - TIE)
        least = np.full(len(room), -np.inf)
        for f, phi in self._failed(chosen) if measure(loss)[0] == 0 else ():
            least = np.maximum(least, aggregated(f[:, None] - phi[:, room], self.aggregate))
        for at in tied_order(least):
            if least[at] >= enough or self.solves >= self.limit:
                break
            if new := self.losses(sorted([*chosen, room[at]]), (fatal, enough)):
                return -1, room[at], new
        return None

    def _bounds(self, chosen: list[int], others: list[int], loss: dict[int, float]) -> np.ndarray:
        """(k, k, others): least cost after the failure of g with i swapped for j; g = i denotes the failure of j."""
        k = len(chosen)
        bounds = np.full((k, k, len(others)), -np.inf)
        # where a failure is fatal, another gauge's may become so: no loss bounds the largest of the others
        if measure(loss)[0]:
            return bounds
        for g, (f, phi) in enumerate(self._failed(chosen)):
            bounds[g] = aggregated(f[:, None, None] + phi[:, chosen, None] - phi[:, None, others], self.aggregate)
            bounds[g, g] = loss[chosen[g]]
        return bounds

    def _failed(self, chosen: list[int]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """f (s,) and φ (s, pool) of the set without each of its gauges."""
        for failing in chosen:
            loops = loops_of(self.pools, [other for other in chosen if other != failing]) or ()
            self.solves += len(self.pools)
            yield costs_of(self.pools, loops), gradients_of(self.pools, loops)


def measure(loss: dict[int, float]) -> tuple[int, float]:
    """Number of failures that lose an unknown or are not solved, and the largest loss of the others."""
    finite = [value for value in loss.values() if value < np.inf]
    return len(loss) - len(finite), max(finite, default=0.0)


def loss_if_one_fails(pools: Sequence[Pool], gauges: Gauges, aggregate: Aggregate = "mean") -> np.ndarray:
    """Aggregate of the metric of the set when each one of its gauges, in the order given, fails. inf where an unknown is
    lost, NaN where the covariance is not solved to accuracy. gauges (k,): different pool rows. Returns (k,)."""
    chosen = [int(g) for g in gauges]
    return np.array([_without(pools, chosen, g, aggregate) for g in chosen])


def robust_set(pools: Sequence[Pool], keep: int | Limits, aggregate: Aggregate = "mean") -> np.ndarray:
    """The set of `keep` gauges, or the layout within `Limits`, whose cost after its worst single failure no swap lowers;
    ascending.

        L(S) = max over g in S of f(S − g),     f = agg_s c(P_s)
        i out, j in:   L ≥ f(S − i),   L ≥ agg_s(f_s(S − g) + φᵍ_i − φᵍ_j) for every other g,   φᵍ_a = tr(h_a P X P h_aᵀ)

    with P and X of the set S − g: the first because j may fail, the second because f is convex in the gauge weights.
    Starts from two sets, the better end of which counts: what the elimination and the exchange keep, and twice as
    many gauges from which those that L misses least are removed. Swaps are tried in the order of that bound, the
    first that helps is made, and the failures of a tried set are solved, the likely worst first, until one costs too
    much. Where a failure loses an unknown, fewer such gauges come first, the largest loss of the others second; so
    does one after which the covariance cannot be solved to accuracy. A bonded gauge stays but fails like any other, a
    pool row of several channels or gauges as a whole. Where the limits leave room, a gauge that lowers L is added.
    Raises InfeasibleError where so few gauges are kept that each is needed to detect the unknowns; as `eliminate`."""
    unknowns, least = fewest_gauges(pools)
    limits = as_limits(len(pools[0].rows), keep)
    if limits.keep <= least:
        raise InfeasibleError(
            f"a layout of {limits.keep} gauges for {unknowns} unknowns: if any gauge fails, an unknown becomes unobservable",
            remedy=f"keep at least {least + 1} gauges (place.keep), or estimate fewer unknowns",
        )
    search = LossSearch(pools, aggregate, limits, SOLVES)
    start = fill(pools, eliminate_from(pools, limits, aggregate).selected, limits, aggregate)
    more = eliminate_from(pools, _twice(limits), aggregate).selected
    chosen, loss = search.swapped(search.reduced(more.tolist()))
    fatal, largest = measure(loss)
    other, other_loss = search.swapped(exchange(pools, start, aggregate, limits=limits).gauges.tolist())
    return np.array(other if measure(other_loss) < (fatal, largest * (1 - TIE)) else chosen)


def _without(pools: Sequence[Pool], chosen: Sequence[int], failing: int, aggregate: Aggregate) -> float:
    """Cost of a set after the failure of one gauge, NaN if it is not solved."""
    try:
        return score(pools, [other for other in chosen if other != failing], aggregate)
    except NumericalError:
        return float("nan")


def _twice(limits: Limits) -> Limits:
    """Twice as many gauges at twice the budget, as far as the pool has them, and at least as many as before."""
    more = min(2 * limits.keep, int(limits.size.sum()))
    most = np.where([name == BUDGET for name in limits.names], 2 * limits.most, limits.most)
    most[0] = more
    return replace(limits, most=most, keep=more, least=more if limits.plain else limits.least)
