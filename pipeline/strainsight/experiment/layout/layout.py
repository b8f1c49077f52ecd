"""Improve the result of the elimination by exchanges or for robustness, then prove or bound its optimality."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.layout import LayoutSettings
from strainsight.errors import blame
from strainsight.experiment.layout.task import Task
from strainsight.ordering import TIE
from strainsight.placement.branch_and_bound import BranchAndBound, branch_and_bound
from strainsight.placement.certificate import Certificate, certify
from strainsight.placement.exchange import Exchange, exchange, fill
from strainsight.placement.failure import robust_set
from strainsight.placement.limits import Limits
from strainsight.placement.scenario import Aggregate, Pool
from strainsight.placement.score import score


@dataclass(frozen=True)
class OptimisedLayout:
    """gauges (k,): pool rows, ascending; cost: aggregated metric; exchange, certificate, proof: None if not configured; better:
    number of candidates outside the pool that could be in a better layout, None if unknown or if the pool has all candidates."""

    gauges: np.ndarray
    cost: float
    exchange: Exchange | None = None
    certificate: Certificate | None = None
    proof: BranchAndBound | None = None
    better: int | None = None

    @property
    def proven(self) -> bool:
        """Whether the layout is proven optimal over all candidates."""
        return self.proof is not None and self.proof.proven and not self.better


def layout_of(
    pools: Sequence[Pool],
    greedy: np.ndarray,
    limits: Limits,
    settings: LayoutSettings,
    aggregate: Aggregate,
    progress: Callable[[str, float], None],
) -> OptimisedLayout:
    """Minimise the metric, or the loss after one failure, as set by `place` of the config.

    Raises InfeasibleError for a robust layout with so few gauges that any failure makes an unknown unobservable."""
    progress("exchange", 0.5)
    # with a budget, the elimination may not use all of it
    greedy = fill(pools, greedy, limits, aggregate)
    swapped = None
    if settings.optimise == "worst_failure":
        gauges = robust_set(pools, limits, aggregate)
    else:
        swapped = exchange(pools, greedy, aggregate, limits=limits) if settings.exchange else None
        gauges = swapped.gauges if swapped else greedy
    return OptimisedLayout(gauges, score(pools, gauges, aggregate), swapped)


@blame("place.keep")
def proved(
    task: Task, layout: OptimisedLayout, pools: Sequence[Pool], progress: Callable[[str, float], None]
) -> OptimisedLayout:
    """Search by branch and bound within `place.prove`, and compute the bound over all candidates.

    pools: scenarios of the task by its criterion. With a cheaper search model the bound starts at its relaxed optimum."""
    limits, settings, aggregate, whole = task.limits, task.settings, task.aggregate, task.whole
    gauges, cost, proof = layout.gauges, layout.cost, None
    if settings.prove > 0:  # not with worst_failure, refused by the config
        progress("proof", 0.6)
        proof = branch_and_bound(pools, limits, aggregate, start=gauges, time_limit=settings.prove)
        gauges = proof.gauges
        cost = score(pools, gauges, aggregate)
    progress("certificate", 0.7)
    if not settings.certificate and (proof is None or whole is None):
        return OptimisedLayout(gauges, cost, layout.exchange, None, proof)
    least, better = np.inf, None
    if whole is None:
        start = None
        if task.searched is not task.pools:
            searched = task.under(task.searched)
            start = certify(searched, gauges, score(searched, gauges, aggregate), aggregate, limits=limits).weights
        certificate = certify(pools, gauges, cost, aggregate, limits=limits, start=start)
    else:
        every = task.under(whole.pools)
        certificate = certify(every, whole.rows[gauges], cost, aggregate, limits=whole.limits)
        others = np.delete(certificate.including, whole.rows)
        least, better = float(others.min(initial=np.inf)), int(np.sum(others < cost * (1 - TIE)))
        certificate = replace(certificate, weights=certificate.weights[whole.rows])
    if proof and (lower := min(proof.lower_bound, least, cost)) > certificate.lower_bound:
        certificate = replace(certificate, lower_bound=lower, gap=(cost - lower) / cost)
    return OptimisedLayout(gauges, cost, layout.exchange, certificate if settings.certificate else None, proof, better)
