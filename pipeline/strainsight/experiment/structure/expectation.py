"""What a filter on a layout is expected to claim along the training run, with all gauges, without each; what that is made of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.bank_claim import bank_claim
from strainsight.estimation.claim import covariance_recursion
from strainsight.experiment.layout.expectation import Expectation
from strainsight.experiment.structure.nuisances import Tolerated, nuisances_of
from strainsight.experiment.structure.problem import SILENT, Problem, filter_model, initial_covariance, settled_under
from strainsight.experiment.structure.variance import variances
from strainsight.placement.recommendation import alike


def expectation(problem: Problem, gauges: np.ndarray, own: Tolerated) -> Expectation:
    """σ along the training run from a 100 % prior, tolerances included; its variance by source. Of a constant parameter that of
    the end, when all samples are in it; otherwise the RMS over the last half.

    gauges (k,) numbers; own: the tolerances of their channels at least. A gauge that is left out has its noise raised until it
    says nothing.
    """
    channels = problem.channels.of(gauges)
    there = channels >= 0
    flat, owner = channels[there], np.nonzero(there)[0]
    silent = np.where(owner == np.arange(-1, len(gauges))[:, None], SILENT, 1.0)
    model = filter_model(problem, flat, problem.h)
    model = replace(model, r=model.r * silent)
    start = initial_covariance(problem, dict.fromkeys(problem.unknowns.names, 1.0), problem.loading.moving)
    nuisances = nuisances_of(own, model, flat)
    if problem.method == "bank":
        settled = settled_under(problem, problem.loading)
        claim = bank_claim(model, problem.x, problem.u, start, nuisances, settled)
    else:
        claim = covariance_recursion(model, problem.x, problem.u, start, nuisances)
    if not np.isfinite(claim.std).all():
        raise NumericalError(
            "the σ that the filter is to claim along the training run is not finite",
            key="train.time_step",
            remedy="the noises lie too far apart, or an unknown load is modelled as faster than the step: check both",
        )
    names = problem.unknowns.names
    variance, budget = variances(problem, claim)
    level = np.sqrt(variance)
    return Expectation(
        {name: float(level[0, i]) for i, name in enumerate(names)},
        {name: level[1:, i] for i, name in enumerate(names)},
        budget,
    )


def alike_gauges(problem: Problem, gauges: np.ndarray, covariance: np.ndarray) -> list[tuple[int, ...]]:
    """Groups of gauges (k,), by their places in the list, that read the same quantity alike in the training run.

    Rows R L on coordinates that are uncorrelated and of unit size there, L Lᵀ = cov(q), the covariance (n, n).
    """
    values, V = np.linalg.eigh(covariance)
    L = V * np.sqrt(np.maximum(values, 0.0))
    channels = problem.channels.of(gauges)
    quantity = problem.channels.quantity[channels[:, 0]]
    groups = []
    for kind in np.unique(quantity):
        own = np.flatnonzero(quantity == kind)
        rows = np.where((channels[own] >= 0)[..., None], problem.channels.rows[channels[own]], 0.0)
        groups += [tuple(int(own[i]) for i in group) for group in alike(rows @ L)]
    return sorted(groups)
