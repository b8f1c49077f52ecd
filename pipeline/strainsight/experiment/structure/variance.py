"""What the variance of every unknown is made of: of a filter that is expected, and of one that has run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from strainsight.estimation.bank_claim import bank_claim
from strainsight.estimation.claim import Claim, covariance_recursion
from strainsight.estimation.conditional import linear_models, no_nuisances
from strainsight.estimation.model import FilterModel, inputs_of, theta_of
from strainsight.estimation.run import FilterRun
from strainsight.estimation.settled import Settled, periodic_start
from strainsight.estimation.smoothed import Smoothed
from strainsight.experiment.structure.nuisances import Tolerated, nuisances_of
from strainsight.experiment.structure.problem import SILENT, Problem
from strainsight.rom.modal_step import modal_step, simulate

Shares = Mapping[str, Mapping[str, float]]
"""Name of an unknown → source → share of its variance, of a name in sum 1."""
HOLDS = 1.25
"""Factor that the σ of a budget, linear about one motion, may be off from the one that is claimed."""


def variances(problem: Problem, claim: Claim) -> tuple[np.ndarray, Shares]:
    """σ² (B, k) of every unknown in B sets, and what that of the first is made of: of a constant parameter at the end, when all
    samples are in it, otherwise the mean of the last half."""
    at = problem.unknowns.position(problem.model)
    whole = _late(problem, claim.std[:, :, at] ** 2)
    part = {source: _late(problem, values[:, at]) for source, values in claim.budget.items()}
    names = problem.unknowns.names
    return whole, {
        name: {source: float(v[i] / whole[0, i]) for source, v in part.items()} for i, name in enumerate(names)
    }


def budget_of(
    problem: Problem,
    tolerances: Tolerated,
    model: FilterModel,
    channels: np.ndarray,
    covariance: np.ndarray,
    known: np.ndarray,
    measured: np.ndarray,
    run: FilterRun,
    smoothed: Smoothed,
    settled: Settled | None,
) -> tuple[Shares, tuple[str, ...]]:
    """Of the filtered unknowns by the filter of the config, linearised along the motion under the loads, and at the parameters,
    that the smoother has found; and a sentence for each unknown whose σ this does not give within HOLDS, which has none.

    channels (m,) rows of train.h5; covariance (n*, n*) at t = 0; known (T, HOLD, n_known) [N]; measured (T/every, m), NaN where
    missing. The extended and the sigma-point filter have no tolerances in their σ, and none here.
    """
    x = smoothed.mean[:, 0, : model.size]
    if not np.isfinite(x).all():
        return {}, ("no budget of the variance: the motion that was found is not finite",)
    u = inputs_of(model, x[:-1], known)
    theta = {name: float(value) for name, value in theta_of(model, x[-1]).items()}
    found = {name: theta[name] for name in problem.unknowns.parameters}
    at = replace(model, unknowns=replace(model.unknowns, guess={**model.unknowns.guess, **found}))
    missing = np.zeros((len(u), 1, len(channels)))
    missing[model.every - 1 :: model.every, 0] = np.isnan(measured)
    at = replace(at, r=at.r * np.where(missing > 0, SILENT, 1.0) if missing.any() else at.r)
    if problem.method == "bank":
        motion = _motion(at, theta, u, x[:, model.motion], np.diag(covariance)[model.motion], settled)
        claim = bank_claim(at, motion, u, covariance, nuisances_of(tolerances, at, channels), settled)
    else:
        motion = _motion(at, theta, u, x[:, model.motion], np.diag(covariance)[model.motion], None)
        claim = covariance_recursion(at, motion, u, covariance)
    whole, shares = variances(problem, claim)
    claimed = _late(problem, run.std[:, 0, problem.unknowns.position(problem.model)] ** 2)
    ratio = dict(zip(problem.unknowns.names, np.sqrt(whole[0] / claimed).tolist(), strict=True))
    kept = {name: own for name, own in shares.items() if 1 / HOLDS <= ratio[name] <= HOLDS}
    return kept, tuple(
        f"no budget of {name}: about one motion its σ would be {ratio[name]:.2g} times what the filter claims"
        for name in shares
        if name not in kept
    )


def _motion(
    model: FilterModel,
    theta: Mapping[str, float],
    u: np.ndarray,
    smoothed: np.ndarray,
    start: np.ndarray,
    settled: Settled | None,
) -> np.ndarray:
    """The motion [q, q̇] (T + 1, 2n) under the loads: periodic where it has settled, otherwise begun so that it is as near as can
    be to the smoothed one.

    That one is none of the model where gauges or loads are not as meant: its start would set off what no test has seen, and
    distinguish constants by it. u (T, HOLD, n_u); start (2n,): variance of [q, q̇] at t = 0. Least squares of the free motion Aᵏx₀
    on what the smoothed motion has beside the forced one, coordinates over their RMS, with the start of the filter as prior.
    """
    if settled is not None:
        one = linear_models(model, np.zeros((1, len(model.unknowns.parameters))), no_nuisances(model))
        return simulate(model.model, theta, u, model.h, periodic_start(model, one, settled)[0][0])
    forced, A = simulate(model.model, theta, u, model.h), modal_step(model.model, theta, model.h).transition
    size, std = np.sqrt(np.mean(smoothed**2, axis=0)), np.sqrt(start)
    size = np.where(size > 0, size, 1.0)
    free, normal, right = np.diag(std), np.eye(len(std)), np.zeros(len(std))
    for beside in (smoothed - forced) / size:
        scaled = free / size[:, None]
        normal, right = normal + scaled.T @ scaled, right + scaled.T @ beside
        free = A @ free
    return simulate(model.model, theta, u, model.h, std * np.linalg.solve(normal, right))


def _late(problem: Problem, variance: np.ndarray) -> np.ndarray:
    """Of variances (T, ..., k) of the unknowns: at the end of constants, else the mean of the last half (..., k)."""
    late = np.mean(variance[len(variance) // 2 :], axis=0)
    if not problem.drifting:
        late[..., len(problem.unknowns.inputs) :] = variance[-1, ..., len(problem.unknowns.inputs) :]
    return np.asarray(late)
