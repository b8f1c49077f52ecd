"""What a set of gauges is worth after any one of them has failed, and the set for which that is worth most."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.augmentation.observability import least_gauges
from strainsight.errors import InfeasibleError, NumericalError
from strainsight.placement.elimination import eliminate
from strainsight.placement.exchange import exchange
from strainsight.placement.increment import gauge_gradients
from strainsight.placement.scenario import Aggregate, Pool, aggregated, loop_of, subset_covariance, weighted_trace

WORTH = 1e-9
"""A swap counts when it lowers the largest loss by more than this share of it."""


@dataclass(frozen=True)
class RobustSet:
    """gauges (keep,) ascending; loss (keep,): cost when each one fails; worst: the largest of them; cost: while all work;
    fatal: gauges whose failure loses an unknown, worst is then inf; swaps (out, in) that led from the start to this set;
    solves: exact Riccati solves of sets after a failure; complete: `limit` was enough to know that no swap helps."""

    gauges: np.ndarray
    loss: np.ndarray
    worst: float
    cost: float
    fatal: tuple[int, ...]
    swaps: tuple[tuple[int, int], ...]
    solves: int
    complete: bool


def loss_if_one_fails(
    pools: Sequence[Pool], gauges: Sequence[int] | np.ndarray, aggregate: Aggregate = "mean"
) -> np.ndarray:
    """Aggregate of tr(W P) of the set when each one of its gauges, in the order given, fails.

    inf where an unknown is lost, or so nearly that its covariance cannot be solved to accuracy. gauges (k,): different
    pool rows. Returns (k,).
    """
    chosen = [int(g) for g in gauges]
    return np.array([_after(pools, [other for other in chosen if other != g], aggregate) for g in chosen])


def robust_set(
    pools: Sequence[Pool],
    keep: int,
    aggregate: Aggregate = "mean",
    *,
    fixed: Collection[int] = (),
    start: Sequence[int] | np.ndarray | None = None,
    limit: int = 20_000,
) -> RobustSet:
    """The set of `keep` gauges whose cost after its worst single failure no single swap lowers.

        L(S) = max over g in S of f(S − g),     f = agg_s tr(W P_s)
        i out, j in:   L ≥ f(S − i),   L ≥ agg_s(f_s(S − g) + φᵍ_i − φᵍ_j) for every other g,   φᵍ_a = h_a P X P h_aᵀ/r_a

    with P and X of the set S − g: the first because j may fail, the second because f is convex in the gauge weights.
    Starts from `start` after the usual exchange; without it from two sets, the better end of which counts: what the
    elimination and the exchange keep, and twice as many gauges from which those that L misses least are removed. Swaps
    are tried in the order of that bound, the first that helps is made, and the failures of a tried set are solved, the
    likely worst first, until one costs too much. Where a failure loses an unknown, fewer such gauges come first, the
    largest loss of the others second; so does one after which the covariance cannot be solved to accuracy. A glued
    gauge (fixed) stays but fails like any other.
    Raises InfeasibleError where so few gauges are kept that each is needed to detect the unknowns; as `eliminate`.
    """
    least = max(least_gauges(p.modes) for p in pools)
    if keep <= least:
        raise InfeasibleError(
            f"{keep} gauges for {least} unknowns: whichever fails, an unknown is lost",
            remedy=f"keep at least {least + 1}, or estimate fewer unknowns",
        )
    search = _Search(pools, aggregate, fixed, limit)
    starts = []
    if start is None:
        scenarios = [p.scenario for p in pools]
        start = eliminate(scenarios, keep, aggregate, fixed=fixed).kept
        more = eliminate(scenarios, min(2 * keep, len(pools[0].rows)), aggregate, fixed=fixed).kept
        starts.append(search.reduced(more.tolist(), keep))
    starts.append(exchange(pools, start, aggregate, fixed=fixed, limit=limit).gauges.tolist())
    chosen, loss, swaps = min((search.swapped(s) for s in starts), key=lambda found: _measure(found[1]))
    values = np.array([loss[g] for g in chosen])
    return RobustSet(
        gauges=np.array(chosen),
        loss=values,
        worst=float(values.max()),
        cost=_cost(_covariances(pools, chosen), pools, aggregate),
        fatal=tuple(g for g in chosen if loss[g] == np.inf),
        swaps=swaps,
        solves=search.solves,
        complete=search.solves < limit,
    )


class _Search:
    """Losses of a set {gauge: cost when it fails} and the swap that lowers the largest, within a number of solves."""

    def __init__(self, pools: Sequence[Pool], aggregate: Aggregate, fixed: Collection[int], limit: int):
        self.pools, self.aggregate, self.fixed, self.limit, self.solves = pools, aggregate, fixed, limit, 0

    def reduced(self, chosen: list[int], keep: int) -> list[int]:
        """`keep` gauges of `chosen`: the one whose removal leaves the least measure goes first, the lower index on a tie."""
        while len(chosen) > keep:
            least, rest = (len(chosen), np.inf), chosen
            for out in (g for g in chosen if g not in self.fixed):
                others = [g for g in chosen if g != out]
                loss = self.losses(others, least)
                if loss:
                    least, rest = _measure(loss), others
            chosen = rest
        return chosen

    def swapped(self, chosen: list[int]) -> tuple[list[int], dict[int, float], tuple[tuple[int, int], ...]]:
        """The set after every swap that helped, its losses, and the swaps (out, in)."""
        swaps: list[tuple[int, int]] = []
        loss = self.losses(chosen, (len(chosen), np.inf))
        swap = self.first_gain(chosen, loss)
        while swap is not None:
            out, into, loss = swap
            chosen = sorted({*chosen, into} - {out})
            swaps.append((out, into))
            swap = self.first_gain(chosen, loss)
        return chosen, loss, tuple(swaps)

    def losses(
        self,
        chosen: Sequence[int],
        below: tuple[int, float],
        order: Sequence[int] | None = None,
        known: dict[int, float] | None = None,
    ) -> dict[int, float]:
        """All losses of a set, those of `order` first; {} as soon as they are seen not to be below (fatal, largest)."""
        loss = dict(known or {})
        for g in chosen if order is None else order:
            if g not in loss:
                rest = [other for other in chosen if other != g]
                try:
                    covariances = _covariances(self.pools, rest)
                except NumericalError:
                    covariances = None
                self.solves += len(self.pools)
                loss[g] = _cost(covariances, self.pools, self.aggregate)
            fatal, largest = _measure(loss)
            if fatal > below[0] or (fatal == below[0] and largest >= below[1]):
                return {}
        return loss

    def first_gain(self, chosen: list[int], loss: dict[int, float]) -> tuple[int, int, dict[int, float]] | None:
        """The swap (out, in) of the least bound that helps, with the losses after it; None where no swap does."""
        fatal, largest = _measure(loss)
        enough = largest * (1 - WORTH)
        others = [g for g in range(len(self.pools[0].rows)) if g not in set(chosen)]
        bounds = self._bounds(chosen, others, loss)
        movable = np.array([g not in self.fixed for g in chosen])
        least = np.where(movable[:, None], bounds.max(axis=0), np.inf)
        for at in np.argsort(least, axis=None, kind="stable"):
            i, j = divmod(int(at), len(others))
            if least[i, j] >= enough or self.solves >= self.limit:
                break
            out, into = chosen[i], others[j]
            swapped = sorted({*chosen, into} - {out})
            likely = [chosen[g] for g in np.argsort(-bounds[:, i, j], kind="stable") if g != i]
            new = self.losses(swapped, (fatal, enough), [into, *likely], {into: loss[out]})
            if new:
                return out, into, new
        return None

    def _bounds(self, chosen: list[int], others: list[int], loss: dict[int, float]) -> np.ndarray:
        """(k, k, others): the least cost when g fails after i was swapped for j; g = i stands for the failure of j."""
        k = len(chosen)
        bounds = np.full((k, k, len(others)), -np.inf)
        # where a failure is fatal, another gauge's may become so: no loss bounds the largest of the others
        if np.inf in loss.values():
            return bounds
        for g, failing in enumerate(chosen):
            rest = [other for other in chosen if other != failing]
            level, slope = [], []
            for pool, P in zip(self.pools, _covariances(self.pools, rest) or (), strict=True):
                loop = loop_of(pool, rest, P)
                level.append(weighted_trace(pool, P))
                slope.append(gauge_gradients(loop, pool.rows, pool.scenario.weight))
            self.solves += len(self.pools)
            f, phi = np.array(level), np.array(slope)
            bounds[g] = aggregated(f[:, None, None] + phi[:, chosen, None] - phi[:, None, others], self.aggregate)
            bounds[g, g] = loss[failing]
        return bounds


def _measure(loss: dict[int, float]) -> tuple[int, float]:
    """How many failures lose an unknown, and the largest loss of the others."""
    finite = [value for value in loss.values() if value < np.inf]
    return len(loss) - len(finite), max(finite, default=0.0)


def _covariances(pools: Sequence[Pool], gauges: Sequence[int]) -> list[np.ndarray] | None:
    """P of every scenario, or None where these gauges lose an unknown."""
    found = []
    for pool in pools:
        P = subset_covariance(pool, gauges)
        if P is None:
            return None
        found.append(P)
    return found


def _after(pools: Sequence[Pool], left: Sequence[int], aggregate: Aggregate) -> float:
    try:
        return _cost(_covariances(pools, left), pools, aggregate)
    except NumericalError:
        return float("inf")


def _cost(covariances: Sequence[np.ndarray] | None, pools: Sequence[Pool], aggregate: Aggregate) -> float:
    if covariances is None:
        return float("inf")
    return float(
        aggregated(np.array([weighted_trace(p, P) for p, P in zip(pools, covariances, strict=True)]), aggregate)
    )
