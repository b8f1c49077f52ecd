"""Parameter grid filter (multiple-model filter): exact Bayes for a model that is linear at fixed parameters.

    p(θ | y) ∝ p(θ) Πₖ p(yₖ | y₁ … yₖ₋₁, θ),     x̂ = Σ wᵢ x̂ᵢ,     P = Σ wᵢ (Pᵢ + (x̂ᵢ − x̂)(x̂ᵢ − x̂)ᵀ)

At fixed parameters the innovations of a Kalman filter give the likelihood, with errors of installation and damping integrated
out. The extended filter is overconfident because it linearises their product with the motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from strainsight.estimation.columns import build_columns, rebuild_columns
from strainsight.estimation.grid_filter_points import (
    GridProblem,
    Passed,
    WeightedFilters,
    advance_points,
    apply_passage,
    enter_record,
    filter_points,
    linearise_about_samples,
    refuse_lost,
)
from strainsight.estimation.mixture import C, Mixture, Weights
from strainsight.estimation.model import FilterModel
from strainsight.estimation.parallel_filters import KEPT
from strainsight.estimation.parameter_grid import (
    GridConstruction,
    ParameterGrid,
    build_first_grid,
    build_next_grid,
    one_point,
)
from strainsight.estimation.peak import density_of, find_hills, find_peaks
from strainsight.estimation.record import GridRecord
from strainsight.estimation.run import FilterRun, Keep

FEW = 3
"""Largest number of parameters with a full grid; more parameters use columns."""
SHORTEST, SHARE = 8, 8
"""Fewest steps between two checks of the grid, and their share 1/SHARE of the steps so far: the posterior narrows as the record
grows."""
FOLLOWED = 10
"""Number of grids for inconsistent measurements after which σ of the parameters is doubled."""
COARSE, REACH, TRIED, MOST_TRIED = 0.05, 3.0, 0.01, 80
"""Scan for resonances: assumed relative RMS error of the readings, range in σ of a parameter, step of its logarithm, most steps.
"""
AGAIN, STAY = 3, 0.2
"""Most repetitions of the filter with considered frequencies, and the change of a parameter, in σ, below which it has converged.
"""


@dataclass(frozen=True)
class GridRun:
    """Result of the grid filter: the posterior at the end, and the estimates along a record. point (B, k), weight (B,):
    posterior of the parameters; nu (B, d), left (B, d, d): mean and covariance of ν at each point, frequencies relative to
    those at the centre; about (d,): ν about which readings are linear; centre (k,): as in `ConsideredParameters`; grid_count:
    number of grids built; step (k,): grid step of each parameter, infinite for columns; run: filter run, with the considered
    parameters in its σ; by_mass (k,): change that `widened` the posterior, empty without."""

    point: np.ndarray
    weight: np.ndarray
    nu: np.ndarray
    left: np.ndarray
    about: np.ndarray
    centre: np.ndarray | None
    grid_count: int
    step: np.ndarray
    run: FilterRun
    by_mass: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def posterior(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (k,) and covariance (k, k) of the parameters."""
        mean = self.weight @ self.point
        off = self.point - mean
        return mean, (off * self.weight[:, None]).T @ off

    @property
    def nu_moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (d,) and covariance (d, d) of ν."""
        mean = self.weight @ self.nu
        off = self.nu - mean
        return mean, np.einsum("b,bdk->dk", self.weight, self.left) + (off * self.weight[:, None]).T @ off

    def widened(self, change: np.ndarray, model: FilterModel) -> GridRun:
        """The run with c cᵀ, of a change c (k,) of the parameters p, added to their covariance P, and to that of loads f by
        regression:

            P + c cᵀ,     Σ_f + g gᵀ,   g = Σ_fp P⁻¹ c

        The points move away from the mean by the ratio of the factors of both covariances."""
        (mean, covariance), run, k = self.posterior, self.run, len(change)
        wide, joint = covariance + np.outer(change, change), run.unknown_covariance
        stretch = np.linalg.cholesky(wide) @ np.linalg.inv(np.linalg.cholesky(covariance))
        by_change = (joint[..., -k:] @ np.linalg.solve(joint[..., -k:, -k:], change[:, None]))[..., 0]
        by_change[..., -k:] = change
        std = run.std.copy()
        std[..., model.position] = np.hypot(std[..., model.position], by_change)
        return replace(
            self,
            point=mean + (self.point - mean) @ stretch.T,
            step=self.step * np.sqrt(np.diag(wide) / np.diag(covariance)),
            run=replace(run, std=std, unknown_covariance=joint + by_change[..., :, None] * by_change[..., None, :]),
            by_mass=change,
        )


def filter_on_grid(record: GridRecord, keep: Keep = "all") -> GridRun:
    """Posterior of the constant parameters, and of all states along the samples. keep: "all" keeps the covariance at each
    instant, "parameters" only that of the parameters, in half the time. The grid starts at the prior. When the posterior has
    narrowed or reached the edge, a new grid is built and filtered again from the start. More than FEW parameters use
    `Columns`. With considered damping or frequencies, or free loads, readings are linear about the most likely ν at the most
    likely parameters, and at their mean (`linearise_about_samples`). Raises NumericalError if the grid needs more than
    MOST_POINTS points, if columns cannot follow the posterior, or if it deviates from the guess by a factor of exp(LOST)."""
    return filter_records([record], keep)[0]


def filter_records(
    records: Sequence[GridRecord],
    keep: Keep = "all",
    *,
    progress: Callable[[float], None] | None = None,
    birge_ratio: float = 1.0,
) -> tuple[GridRun, ...]:
    """Posterior of parameters shared by several records: one run per record, each with the posterior at the end of all records.

        p(θ, ν | y) ∝ p(θ) p(ν) Πᵣ p(yᵣ | θ, ν)

    Parameters and ν are common to all records; record-specific constants have separate columns (`each_its_own`). Motion,
    loads and offsets of each record start from mean and covariance of the first record, independently. Records may differ in
    step and noise, not in unknowns, channels and ν. progress: called with the fraction of steps done. birge_ratio: as in
    `GridProblem`, above 1 for inconsistent measurements. The ratio is doubled after every FOLLOWED grids, which bounds their
    number. Other arguments as in `filter_on_grid`.

    Masses that the model lacks at unknown loads bias the parameters that known loads determine. The posterior is widened by
    the change of its mean with one σ of them in the model, because a linear slope holds for a fraction of σ only."""
    runs = _filter_records(records, keep, progress, birge_ratio)
    if not feels_lacking_mass(records[0]):
        return runs
    heavier = [record.with_lacking_mass() for record in records]
    change = _filter_records(heavier, "parameters", None, birge_ratio)[0].posterior[0] - runs[0].posterior[0]
    return tuple(run.widened(change, records[0].model) for run in runs)


def feels_lacking_mass(record: GridRecord) -> bool:
    """Whether masses that the model lacks at unknown loads bias parameters: those that known loads determine."""
    return bool(record.considered.lacking.any() and record.model.unknowns.parameters and record.model.known_inputs)


def _filter_records(
    records: Sequence[GridRecord], keep: Keep, progress: Callable[[float], None] | None, birge_ratio: float
) -> tuple[GridRun, ...]:
    """As `filter_records`, with the masses of the model."""
    problem, runs = GridProblem(tuple(records), "parameters", None, True, False, birge_ratio), None
    if problem.bilinear:
        problem = _centre_frequencies(problem)
    peaks = find_peaks(problem) if problem.bilinear or 0 < len(problem.prior[0]) <= FEW else []
    peak_points = np.array([peak.point for peak in peaks])
    if problem.bilinear:
        before = max(peaks, key=lambda peak: peak.evidence).point
        here = filter_points(replace(problem, directions=None), one_point(before), problem.first[-1])
        problem = linearise_about_samples(problem.reduced_by(here), before, here.nu[0])
        # what slopes in a frequency leave out at first, the parameters take for theirs
        for _ in range(AGAIN if problem.centre is not None else 1):
            runs = _run_grid(problem, peak_points)
            mean, covariance = runs[0].posterior
            if problem.centre is not None and np.all(np.abs(mean - before) <= STAY * np.sqrt(np.diag(covariance))):
                break
            again = linearise_about_samples(problem, mean, runs[0].nu_moments[0])
            if again is problem:
                break
            problem, before, runs = again, mean, None
    if keep != "parameters":
        problem = replace(problem, keep=keep, along=True)
    elif runs is not None:
        return runs
    return _run_grid(replace(problem, progress=progress), peak_points)


def _centre_frequencies(problem: GridProblem) -> GridProblem:
    """The problem with frequencies about those at the most likely of the scanned parameters. Each scanned parameter has its
    own frequencies, which finds the measured resonances. Otherwise a narrowing grid may lock on to the resonance of another
    mode. Slopes in a frequency are no better than COARSE of the RMS reading, which is added as discrepancy."""
    if not problem.records[0].considered.frequency.any():
        return problem
    coarse = problem.map_considered(lambda each: replace(each, discrepancy=max(each.discrepancy, COARSE)))
    centre, covariance = problem.prior
    directions = problem.reduced_at(centre).directions
    density = density_of(replace(coarse, directions=directions))
    for axis, std in zip(np.eye(len(centre), dtype=int), np.sqrt(np.diag(covariance)), strict=True):
        count = int(np.clip(2 * REACH * std / TRIED, 2, MOST_TRIED))
        frame, nodes = 2 * REACH * std / count * np.eye(len(centre)), np.arange(count + 1)[:, None] * axis
        grid = ParameterGrid(centre - REACH * std * axis, frame, nodes)
        centre = grid.point[find_hills(grid, density, problem.first[-1])[0][0]]
    return replace(problem.map_considered(partial(replace, centre=centre)), directions=directions)


def _run_grid(problem: GridProblem, peak_points: np.ndarray) -> tuple[GridRun, ...]:
    """A run of each record: on a grid for few parameters, on columns for more. The posterior of few samples may have peaks
    far from those of the whole record. All grids but the first contain the peaks (q, k) of the whole record."""
    if len(problem.model.unknowns.parameters) > FEW:
        return _filter_all(problem, build_columns(problem, *problem.prior, 0), rebuild_columns, at_end=True)
    first = build_first_grid(_construction(problem, peak_points))
    return _filter_all(problem, first, lambda problem, now: build_next_grid(_construction(problem, peak_points), now))


def _construction(problem: GridProblem, peak_points: np.ndarray) -> GridConstruction[WeightedFilters[ParameterGrid]]:
    at, refuse = partial(filter_points, problem), partial(refuse_lost, problem)
    return GridConstruction(problem.prior, at, refuse, peak_points=peak_points)


def _filter_all(
    problem: GridProblem,
    now: WeightedFilters[C],
    following: Callable[[GridProblem, WeightedFilters[C]], WeightedFilters[C]],
    at_end: bool = False,
) -> tuple[GridRun, ...]:
    """Filter all samples, and build new points where necessary; at_end: also at the end, where closer points are more
    accurate."""
    steps, grid_count, mixtures = problem.first[-1], 1, [_begin_mixture(problem, now)]
    while now.step < steps:
        if now.step == problem.first[now.record + 1]:
            now = enter_record(problem, now)
            mixtures.append(_begin_mixture(problem, now))
        before = problem.first[now.record]
        rest = problem.first[now.record + 1] - now.step
        ahead = min(max(SHORTEST, now.step // SHARE), rest, max(1, KEPT // now.models.kept_a_step))
        constants = now.filters.nu[:, None].copy(), now.filters.left[:, None].copy()
        passage = advance_points(problem, now, ahead, keep=problem.along)
        after = (now.log_weight[:, None] + np.cumsum(passage.fit, axis=1)).T
        good = now.cover.holds(after)
        used = ahead if good.all() else int(np.argmin(good)) + 1
        span = slice(now.step - before, now.step - before + used)
        earlier = now.cover.weights(np.concatenate([now.log_weight[None], after[: used - 1]]))
        weights = now.cover.weights(after[:used])
        mixtures[-1].innovations(span, earlier, constants, passage.passage)
        mixtures[-1].log_likelihood += _log_likelihood(now, passage, earlier, weights, used)
        mixtures[-1].states(span, weights, passage.states.first(used), now.models)
        now = apply_passage(now, passage, used)
        if problem.progress is not None:
            problem.progress(now.step / steps)
        if not good.all() or (at_end and now.step == steps):
            if problem.birge_ratio > 1 and grid_count % FOLLOWED == 0:
                problem = replace(problem, birge_ratio=2 * problem.birge_ratio)
                now = replace(now, fit=now.fit / 4)
            now, grid_count = following(problem, now), grid_count + 1
            # the last of these steps, which the points before are no longer good for
            last = slice(now.step - before - 1, now.step - before)
            mixtures[-1].states(last, now.weights, now.states, now.models)
    point, weight, nu, left = now.weights.sampled(now.nu, now.states.left[:, 0])
    end = point, weight, nu, left, now.about, problem.centre, grid_count, now.cover.step
    return tuple(GridRun(*end, run=mixture.finished()) for mixture in mixtures)


def _log_likelihood(now: WeightedFilters[C], passage: Passed, before: Weights, after: Weights, steps: int) -> float:
    """ln p of these steps under the configured loads: from the loss of mass of the points. With free loads the weights are no
    such density, and ln p is Σₜ ln Σᵢ wᵢ p(yₜ | y₁ … yₜ₋₁, θᵢ)."""
    if now.free_load is None:
        return float(after.log_mass[-1] - before.log_mass[0])
    with np.errstate(divide="ignore"):
        each = passage.passage.fit[:, :steps].T + np.log(before.positive)
    return float(np.logaddexp.reduce(each, axis=1).sum())


def _begin_mixture(problem: GridProblem, now: WeightedFilters[C]) -> Mixture:
    """Mixture of a record that starts."""
    first, record = problem.records[0], problem.records[now.record]
    mixture = Mixture(replace(record, mean=first.mean, covariance=first.covariance), problem.keep)
    if now.record or record.settled is not None:
        mixture.begin(now.weights, now.states, now.models, informed=now.record > 0)
    return mixture
