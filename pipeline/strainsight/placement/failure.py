"""What a set of gauges is worth after any one of them has failed, and the set for which that is worth most."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.errors import InfeasibleError, NumericalError
from strainsight.ordering import TIE
from strainsight.placement.elimination import eliminate_from
from strainsight.placement.exchange import exchange
from strainsight.placement.fill import fill
from strainsight.placement.limits import BUDGET, Limits, as_limits
from strainsight.placement.losses import LossSearch, measure
from strainsight.placement.scenario import Aggregate, Pool, fewest_gauges
from strainsight.placement.score import cost_of, covariances_of


@dataclass(frozen=True)
class RobustSet:
    """gauges (keep,) ascending; loss (keep,): cost when each one fails; worst: the largest of them, NaN where one is not
    solved; cost: while all work; fatal: gauges whose failure loses an unknown, worst is then inf; swaps (out, in) that led
    from the start to this set; solves: exact Riccati solves of sets after a failure; complete: `limit` was enough to know
    that no swap helps."""

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
    """Aggregate of the metric of the set when each one of its gauges, in the order given, fails.

    inf where an unknown is lost, NaN where the covariance is not solved to accuracy. gauges (k,): different pool rows.
    Returns (k,).
    """
    chosen = [int(g) for g in gauges]
    return np.array([_after(pools, [other for other in chosen if other != g], aggregate) for g in chosen])


def robust_set(
    pools: Sequence[Pool],
    keep: int | Limits,
    aggregate: Aggregate = "mean",
    *,
    fixed: Collection[int] = (),
    start: Sequence[int] | np.ndarray | None = None,
    limit: int = 20_000,
) -> RobustSet:
    """The set of `keep` gauges, or the layout within `Limits`, whose cost after its worst single failure no swap lowers.

        L(S) = max over g in S of f(S − g),     f = agg_s c(P_s)
        i out, j in:   L ≥ f(S − i),   L ≥ agg_s(f_s(S − g) + φᵍ_i − φᵍ_j) for every other g,   φᵍ_a = tr(h_a P X P h_aᵀ)

    with P and X of the set S − g: the first because j may fail, the second because f is convex in the gauge weights.
    Starts from `start` after the usual exchange; without it from two sets, the better end of which counts: what the
    elimination and the exchange keep, and twice as many gauges from which those that L misses least are removed. Swaps
    are tried in the order of that bound, the first that helps is made, and the failures of a tried set are solved, the
    likely worst first, until one costs too much. Where a failure loses an unknown, fewer such gauges come first, the
    largest loss of the others second; so does one after which the covariance cannot be solved to accuracy. A bonded
    gauge (fixed) stays but fails like any other, a pool row of several channels or gauges as a whole. Where the limits
    leave room, a gauge that lowers L is added.
    Raises InfeasibleError where so few gauges are kept that each is needed to detect the unknowns; as `eliminate`.
    """
    unknowns, least = fewest_gauges(pools)
    limits = as_limits(len(pools[0].rows), keep, fixed)
    if limits.keep <= least:
        raise InfeasibleError(
            f"{limits.keep} gauges for {unknowns} unknowns: whichever fails, an unknown is lost",
            remedy=f"keep at least {least + 1}, or estimate fewer unknowns",
        )
    search = LossSearch(pools, aggregate, limits, limit)
    starts = []
    if start is None:
        start = fill(pools, eliminate_from(pools, limits, aggregate).kept, limits, aggregate)
        more = eliminate_from(pools, _twice(limits), aggregate).kept
        starts.append(search.reduced(more.tolist()))
    starts.append(exchange(pools, start, aggregate, limits=limits, limit=limit).gauges.tolist())
    chosen, loss, swaps = search.swapped(starts[0])
    for other in starts[1:]:
        fatal, largest = measure(loss)
        found = search.swapped(other)
        if measure(found[1]) < (fatal, largest * (1 - TIE)):
            chosen, loss, swaps = found
    values = np.array([loss[g] for g in chosen])
    return RobustSet(
        gauges=np.array(chosen),
        loss=values,
        worst=float(values.max()),
        cost=cost_of(covariances_of(pools, chosen), pools, aggregate),
        fatal=tuple(g for g in chosen if loss[g] == np.inf),
        swaps=swaps,
        solves=search.solves,
        complete=search.solves < limit,
    )


def _after(pools: Sequence[Pool], left: Sequence[int], aggregate: Aggregate) -> float:
    try:
        return cost_of(covariances_of(pools, left), pools, aggregate)
    except NumericalError:
        return float("nan")


def _twice(limits: Limits) -> Limits:
    """Twice as many gauges, twice as dear, as far as the pool has them, and no fewer than before."""
    more = min(2 * limits.keep, int(limits.size.sum()))
    most = np.where([name == BUDGET for name in limits.names], 2 * limits.most, limits.most)
    most[0] = more
    return replace(limits, most=most, keep=more, least=more if limits.plain else limits.least)
