"""Variance budget of the filtered unknowns: shares of the sources, linearised along the motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from strainsight.estimation.claim import ClaimedStd, covariance_recursion, predict_grid_std
from strainsight.estimation.conditional import linear_models, none_considered
from strainsight.estimation.grid_filter import GridRun
from strainsight.estimation.model import FilterModel, inputs_of, theta_of
from strainsight.estimation.record import GridRecord, Settled, periodic_start
from strainsight.estimation.run import FilterRun
from strainsight.estimation.smoother import Smoothed
from strainsight.experiment.structure.considered import Tolerated, build_considered
from strainsight.experiment.structure.problem import SILENT, Problem
from strainsight.rom.modal_step import modal_step, simulate

Shares = Mapping[str, Mapping[str, float]]
"""Unknown → source → share of its variance; shares of an unknown sum to 1."""
HOLDS = 1.25
"""Largest ratio of σ of a linearised budget to the σ of the filter."""


def variances(problem: Problem, claim: ClaimedStd) -> tuple[np.ndarray, Shares]:
    """σ² (B, k) of every unknown in B layouts, and the budget of the first, of a claim since `first_instant`."""
    at = problem.unknowns.position(problem.model)
    whole = _mean_or_last(problem, claim.std[:, :, at] ** 2)
    part = {source: _mean_or_last(problem, values[:, at]) for source, values in claim.budget.items()}
    names = problem.unknowns.names
    return whole, {
        name: {source: float(v[i] / whole[0, i]) for source, v in part.items()} for i, name in enumerate(names)
    }


def budget_of(
    problem: Problem,
    tolerances: Tolerated,
    record: GridRecord,
    channels: np.ndarray,
    run: FilterRun,
    smoothed: Smoothed,
    grid_run: GridRun | None,
) -> tuple[Shares, tuple[str, ...]]:
    """Variance budget of the filtered unknowns, linearised along the smoothed motion and parameters; and a sentence for each
    unknown without a budget, because its σ differs by more than HOLDS.

    channels (m,): rows of train.h5; grid_run: None for other filters, without tolerances in the budget."""
    model = record.model
    x = smoothed.mean[:, 0, : model.size]
    if not np.isfinite(x).all():
        return {}, ("no variance budget: the smoothed motion has values that are not finite",)
    u = inputs_of(model, x[:-1], record.known)
    theta = {name: float(value) for name, value in theta_of(model, x[-1]).items()}
    smoothed_values = {name: theta[name] for name in problem.unknowns.parameters}
    at = replace(model, unknowns=replace(model.unknowns, guess={**model.unknowns.guess, **smoothed_values}))
    missing = np.zeros((len(u), 1, len(channels)))
    missing[model.every - 1 :: model.every, 0] = np.isnan(record.samples)
    at = replace(at, r=at.r * np.where(missing > 0, SILENT, 1.0) if missing.any() else at.r)
    by_grid, first = problem.method == "grid", first_instant(problem, len(u) + 1)
    start = np.diag(record.covariance)[model.motion]
    motion = _motion(at, theta, u, x[:, model.motion], start, record.settled if by_grid else None)
    if by_grid:
        considered = build_considered(tolerances, at, channels)
        claim = predict_grid_std(at, motion, u, record.covariance, considered, record.settled, first)
        if grid_run is not None and len(grid_run.by_mass):
            claim = claim.changed_by_mass(grid_run.by_mass)
    else:
        claim = covariance_recursion(at, motion, u, record.covariance, first=first)
    whole, shares = variances(problem, claim)
    claimed = _mean_or_last(problem, run.std[first:, 0, problem.unknowns.position(problem.model)] ** 2)
    ratio = dict(zip(problem.unknowns.names, np.sqrt(whole[0] / claimed).tolist(), strict=True))
    accurate = {name: share for name, share in shares.items() if 1 / HOLDS <= ratio[name] <= HOLDS}
    return accurate, tuple(
        f"no variance budget of {name}: its linearised σ is inaccurate ({ratio[name]:.2g} times the claimed σ)"
        for name in shares
        if name not in accurate
    )


def _motion(
    model: FilterModel,
    theta: Mapping[str, float],
    u: np.ndarray,
    smoothed: np.ndarray,
    start: np.ndarray,
    settled: Settled | None,
) -> np.ndarray:
    """Motion [q, q̇] (T + 1, 2n) of the model under the loads: periodic if settled, else with the initial state that fits the
    smoothed motion best.
    Least squares of the free motion Aᵏx₀ on smoothed − forced motion, coordinates over their RMS, with the start of the filter as
    prior. The smoothed motion itself is not a solution of the model. u (T, HOLD, n_u); start (2n,): variance of [q, q̇] at t = 0.
    """
    if settled is not None:
        one = linear_models(model, np.zeros((1, len(model.unknowns.parameters))), none_considered(model))
        return simulate(model.model, theta, u, model.h, periodic_start(model, one, settled)[0][0])
    forced, A = simulate(model.model, theta, u, model.h), modal_step(model.model, theta, model.h).transition
    size, std = np.sqrt(np.mean(smoothed**2, axis=0)), np.sqrt(start)
    size = np.where(size > 0, size, 1.0)
    free, normal, right = np.diag(std), np.eye(len(std)), np.zeros(len(std))
    for residual in (smoothed - forced) / size:
        scaled = free / size[:, None]
        normal, right = normal + scaled.T @ scaled, right + scaled.T @ residual
        free = A @ free
    return simulate(model.model, theta, u, model.h, std * np.linalg.solve(normal, right))


def first_instant(problem: Problem, instants: int) -> int:
    """First of the instants whose variances count: the last one for constant parameters alone, else half of them."""
    return instants // 2 if problem.unknowns.inputs or problem.drifting else instants - 1


def _mean_or_last(problem: Problem, variance: np.ndarray) -> np.ndarray:
    """Variances (..., k) from (T, ..., k): final values for constants, else the mean."""
    late = np.mean(variance, axis=0)
    if not problem.drifting:
        late[..., len(problem.unknowns.inputs) :] = variance[-1, ..., len(problem.unknowns.inputs) :]
    return np.asarray(late)
