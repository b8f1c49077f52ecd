"""A parameter grid of extended filters over constants of a step: Bayes up to quadrature over them, normal densities in all else.

    p(ξ | y) ∝ p(ξ) Πₖ p(yₖ | y₁ … yₖ₋₁, ξ),     x̂ = Σ wᵢ x̂ᵢ,     P = Σ wᵢ (Pᵢ + (x̂ᵢ − x̂)(x̂ᵢ − x̂)ᵀ)

At a fixed ξ an extended filter follows motion and loads, and its innovations give the likelihood of ξ. One extended filter over
all of them linearises what ξ does to the motion, too. Where the step is linear at a fixed ξ this is the grid filter of
`grid_filter.py`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from strainsight.errors import InfeasibleError, NumericalError
from strainsight.estimation.mixture import PosteriorWeights, log_normal
from strainsight.estimation.parameter_grid import GridConstruction, ParameterGrid, build_first_grid, build_next_grid
from strainsight.estimation.run import FilterRun

MOST_POINTS = 1000
"""Most grid points: each is a filter with the full step."""
AHEAD = 2.5
"""A grid remains valid for about twice the number of steps after which it was built, as information grows with them."""
FARTHEST = 100.0
"""Largest distance of a constant from the guess in prior standard deviations."""


@dataclass(frozen=True)
class StepGridProblem:
    """What is known before: mean (n,) and covariance (n, n) of x at t = 0, constants ξ at `at` in it, `position` (q,) the states
    of which covariances are kept; begin: ξ (B, k) → x (B, n) and its covariance (B, n, n) given ξ, NaN where none is found;
    filters: x, covariance, samples (t, m) → a run of B filters on them."""

    mean: np.ndarray
    covariance: np.ndarray
    at: slice
    position: np.ndarray
    begin: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
    filters: Callable[[np.ndarray, np.ndarray, np.ndarray], FilterRun]

    @property
    def prior(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (k,) and covariance (k, k) of ξ."""
        return self.mean[self.at], self.covariance[self.at, self.at]


@dataclass(frozen=True)
class PointHistories:
    """Histories of B points through t steps: mean, variance (t + 1, B, n) of x, joint covariance (t + 1, B, q, q) of `position`,
    nis and fit (t, B) as in a FilterRun."""

    AXIS: ClassVar = 1
    """Axis of the points."""

    mean: np.ndarray
    variance: np.ndarray
    joint: np.ndarray
    nis: np.ndarray
    fit: np.ndarray


@dataclass(frozen=True)
class WeightedHistories(PosteriorWeights[ParameterGrid]):
    """Grid points with their histories, which extend past `step`."""

    histories: PointHistories


@dataclass(frozen=True)
class StepGridRun:
    """Result of the grid filter of a bench. mean, std (T + 1, n) of x; joint (T + 1, q, q); nis (T,), weighted over the
    points; point (B, k), weight (B,): posterior of ξ at the end; grid_count: number of grids built; without: points of the
    last grid without weight, whose filters diverged or did not start."""

    mean: np.ndarray
    std: np.ndarray
    joint: np.ndarray
    nis: np.ndarray
    point: np.ndarray
    weight: np.ndarray
    grid_count: int
    without: int


def filter_constants(
    problem: StepGridProblem, samples: np.ndarray, *, progress: Callable[[int], None] | None = None
) -> StepGridRun:
    """Posterior of ξ and of all states along samples (T, m), NaN if missing. The grid starts at the prior, and is rebuilt
    when the posterior has narrowed or reached its edge; its filters start at t = 0. progress: called with the steps done.
    Raises InfeasibleError for a constant without prior width; NumericalError if all points diverge, or a grid needs more than
    MOST_POINTS points or FARTHEST prior standard deviations."""
    _refuse_known(problem)
    construction = GridConstruction[WeightedHistories](
        problem.prior, lambda grid, step: _run_filters(problem, samples, grid, step),
        lambda point: _refuse_far(problem, point), MOST_POINTS,
    )  # fmt: skip
    now, grid_count, T, n = build_first_grid(construction), 1, len(samples), len(problem.mean)
    mean, variance, nis = np.zeros((T + 1, n)), np.zeros((T + 1, n)), np.zeros(T)
    joint = np.zeros((T + 1, len(problem.position), len(problem.position)))
    mean[0], variance[0] = problem.mean, np.diagonal(problem.covariance)
    joint[0] = problem.covariance[np.ix_(problem.position, problem.position)]

    def mix(span: slice, points: WeightedHistories, log_weight: np.ndarray) -> None:
        moments = _mix(problem, points, span, log_weight)
        mean[span], variance[span], joint[span], nis[span.start - 1 : span.stop - 1] = moments

    while now.step < T:
        if progress is not None:
            progress(now.step)
        first = now.step
        if first == len(now.histories.fit):
            now = _run_filters(problem, samples, now.cover, first)
        after = now.prior + np.cumsum(now.histories.fit, axis=0)[first:]
        alive = int(np.append(np.isfinite(after.max(axis=1)), False).argmin())
        if not alive:
            raise _none_left(first + 1)
        good = now.cover.holds(after[:alive])
        used = alive if good.all() else int(np.argmin(good)) + 1
        mix(slice(first + 1, first + used + 1), now, after[:used])
        now = replace(now, fit=now.histories.fit[: first + used].sum(axis=0), step=first + used)
        if used < len(after) or not good.all():
            now, grid_count = build_next_grid(construction, now), grid_count + 1
            # the last of these steps, which the points before are no longer good for
            mix(slice(now.step, now.step + 1), now, now.log_weight[None])
    w = now.weights.mean[-1]
    std, without = np.sqrt(np.maximum(variance, 0.0)), int(np.count_nonzero(np.isneginf(now.log_weight)))
    return StepGridRun(mean, std, joint, nis, now.cover.point, w, grid_count, without)


def _run_filters(problem: StepGridProblem, samples: np.ndarray, grid: ParameterGrid, step: int) -> WeightedHistories:
    """The filters at the grid points from the start through `step` steps, and AHEAD times as many for the next ones."""
    point = grid.point
    x, P = problem.begin(point)
    started = np.isfinite(x.sum(axis=1))
    prior = np.where(started, log_normal(point, *problem.prior), -np.inf)
    if not started.any():
        raise _none_left(0)
    instead = int(np.argmax(started))  # filtered in its place, without weight
    run = problem.filters(
        np.where(started[:, None], x, x[instead]),
        np.where(started[:, None, None], P, P[instead]),
        samples[: int(AHEAD * step) + 2],
    )
    assert run.fit is not None
    joint = np.broadcast_to(run.unknown_covariance, (*run.mean.shape[:2], *run.unknown_covariance.shape[2:]))
    now = WeightedHistories(
        grid, prior, run.fit[:step].sum(axis=0), step, PointHistories(run.mean, run.std**2, joint, run.nis, run.fit)
    )
    if np.isneginf(now.log_weight).all():
        raise _none_left(step)
    return now


def _mix(
    problem: StepGridProblem, now: WeightedHistories, span: slice, log_weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Mean and variance (L, n), joint covariance (L, q, q) and NIS (L,) at the instants of a span, with weights log_weight (L,
    B). Diverged points are NaN and have no weight."""
    w = now.cover.weights(log_weight).mean
    of = now.histories
    x, variance, joint = (np.nan_to_num(values[span]) for values in (of.mean, of.variance, of.joint))
    mean = np.einsum("tb,tbn->tn", w, x)
    off = x - mean[:, None]
    among = off[..., problem.position]
    return (
        mean,
        np.einsum("tb,tbn->tn", w, variance + off**2),
        np.einsum("tb,tbij->tij", w, joint) + np.einsum("tb,tbi,tbj->tij", w, among, among, optimize=True),
        np.einsum("tb,tb->t", w, np.nan_to_num(now.histories.nis[span.start - 1 : span.stop - 1])),
    )


def _refuse_known(problem: StepGridProblem) -> None:
    """Raise InfeasibleError for constants that are known or linearly dependent: a grid needs a width."""
    covariance = problem.prior[1]
    std = np.sqrt(np.diagonal(covariance))
    if not np.all(std > 0) or np.linalg.eigvalsh(covariance / np.outer(std, std)).min() < 1e-12:
        raise InfeasibleError(
            "an initial σ of the parameters is zero, or the parameters are linearly dependent",
            remedy="remove estimate.parameters.*.std of known parameters, and estimate only one of several identical parameters",
        )


def _refuse_far(problem: StepGridProblem, point: np.ndarray) -> None:
    mean, covariance = problem.prior
    if np.abs((point - mean) / np.sqrt(np.diagonal(covariance))).max() > FARTHEST:
        raise NumericalError(
            f"the measurements fit best with parameters more than {FARTHEST:g} initial σ away from their guess",
            remedy="check the channels (assignment, unit and sign) and the known loads, or increase estimate.parameters.*.std",
        )


def _none_left(step: int) -> NumericalError:
    when = f"by step {step}" if step else "at the start"
    return NumericalError(
        f"the filters at all points of the parameter grid diverged {when}",
        remedy="choose guesses of the parameters closer to the true values, a smaller initial σ or a smaller time step, or set "
        "estimate.method.parameters: extended",
    )
