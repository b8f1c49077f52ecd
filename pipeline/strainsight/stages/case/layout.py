"""From the elimination's set to the layout: exchanges, a proof, failures, and a bound on what any layout could reach."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from strainsight.placement.branch_and_bound import BranchAndBound, branch_and_bound
from strainsight.placement.certificate import Certificate, certify
from strainsight.placement.exchange import Exchange, exchange
from strainsight.placement.failure import loss_if_one_fails, robust_set
from strainsight.placement.scenario import Pool
from strainsight.placement.score import score


@dataclass(frozen=True)
class Layout:
    """gauges (k,) pool rows, ascending; trace: their aggregate of tr(W P); loss (k,): the same when each one fails, inf
    where an unknown is lost; exchange, certificate and proof where they were asked for."""

    gauges: np.ndarray
    trace: float
    loss: np.ndarray
    exchange: Exchange | None
    certificate: Certificate | None
    proof: BranchAndBound | None


def layout_of(
    pools: Sequence[Pool], greedy: np.ndarray, settings: Any, progress: Callable[[str, float], None]
) -> Layout:
    """The set of least trace, or of least loss after one failure, as settings (`place` of a config) ask for.

    Raises InfeasibleError where a robust layout is asked for of so few gauges that every failure loses an unknown.
    """
    aggregate = settings.aggregate
    progress("exchange", 0.5)
    swapped, proof = None, None
    if settings.optimise == "worst_failure":
        gauges = robust_set(pools, settings.keep, aggregate).gauges
    else:
        swapped = exchange(pools, greedy, aggregate) if settings.exchange else None
        gauges = swapped.gauges if swapped else greedy
    if settings.prove > 0:  # never beside worst_failure: the config refuses that
        progress("proof", 0.6)
        proof = branch_and_bound(pools, settings.keep, aggregate, start=gauges, time_limit=settings.prove)
        gauges = proof.gauges
    trace = score(pools, gauges, aggregate)
    progress("certificate", 0.7)
    certificate = certify(pools, gauges, trace, aggregate) if settings.certificate else None
    if certificate and proof and proof.lower_bound > certificate.lower_bound:
        lower = min(proof.lower_bound, trace)
        certificate = replace(certificate, lower_bound=lower, gap=(trace - lower) / trace)
    return Layout(gauges, trace, loss_if_one_fails(pools, gauges, aggregate), swapped, certificate, proof)
