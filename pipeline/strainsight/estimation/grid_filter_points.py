"""Filters at the points of the parameter grid: their start, and their steps through the samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, TypeVar

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.conditional import ConsideredParameters, considers, linear_models
from strainsight.estimation.directions import distinguished_directions
from strainsight.estimation.free_loads import FreeLoadFilters, advance_free_loads, build_free_load_filters
from strainsight.estimation.mixture import C, PosteriorWeights, log_normal
from strainsight.estimation.model import FilterModel
from strainsight.estimation.parallel_filters import KEPT, Filters, LinearModels, Passage, States, advance, build_filters
from strainsight.estimation.parameter_grid import one_point
from strainsight.estimation.record import GridRecord
from strainsight.estimation.reduced import LOST
from strainsight.estimation.run import Keep

MOVED = 0.05
"""Change of ln c of a mode: a linear slope neglects half its square, a thousandth of the damping."""
FARTHEST = 4.0
"""Limit of ν in σ: beyond it the measurements are inconsistent with the model."""
ABSURD, UNLIKELY = 3.0, 20.0
"""Limits of the logarithm of a parameter over its guess, absolute and in prior σ: beyond both, the measurements are not of this
part."""
TURNS, NOTICED = 8, 0.1
"""Most relinearisations in ν, and the change of the log-likelihood below which they stop."""


@dataclass(frozen=True)
class GridProblem:
    """Records to be filtered one after the other, with a common mean and covariance at t = 0; keep and progress as in
    `filter_records`.

    Parameters and ν are common to all records; motion, loads and offsets start anew in each. use_free_loads: weight
    parameters by free loads instead of the likelihood under the configured loads. along: whether states along the samples are
    required, or only the posterior at the end, for which ν are reduced to `directions` (d, r) if not None. birge_ratio: RMS of
    the innovations over their claim; the log-likelihood of the parameters is divided by its square, which multiplies their σ
    by the ratio."""

    records: tuple[GridRecord, ...]
    keep: Keep = "all"
    progress: Callable[[float], None] | None = None
    use_free_loads: bool = False
    along: bool = True
    birge_ratio: float = 1.0
    directions: np.ndarray | None = None

    @property
    def model(self) -> FilterModel:
        """Model of the first record, with the unknowns and states of all records."""
        return self.records[0].model

    @property
    def first(self) -> tuple[int, ...]:
        """Steps before each record, and the total number."""
        return tuple(int(count) for count in np.cumsum([0, *(record.steps for record in self.records)]))

    @property
    def prior(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (k,) and covariance (k, k) of the parameters at t = 0."""
        return self.records[0].prior

    @property
    def centre(self) -> np.ndarray | None:
        """Centre of the frequencies, as in `ConsideredParameters`."""
        return self.records[0].considered.centre

    @property
    def has_free_loads(self) -> bool:
        """Whether parameters are weighted with free unknown loads."""
        return self.use_free_loads and self.model.has_free_loads

    @property
    def bilinear(self) -> bool:
        """Whether readings are far from linear in ν: considered damping or frequencies, or any ν together with unknown loads."""
        considered, unknowns = self.records[0].considered, self.model.unknowns
        of_modes = considered.of_modes(self.model.model.size)
        return bool(unknowns.parameters) and (of_modes > 0 or (self.has_free_loads and len(considered.D) > 0))

    def map_considered(self, of: Callable[[ConsideredParameters], ConsideredParameters]) -> GridProblem:
        """The same with transformed considered parameters in each record, and all ν."""
        records = tuple(replace(each, considered=of(each.considered)) for each in self.records)
        return replace(self, records=records, directions=None)

    def reduced_by(self, now: WeightedFilters[C]) -> GridProblem:
        """The same with ν reduced to the directions that the samples distinguish, by a filter with all ν after all samples."""
        considered, kept = self.records[0].considered, np.zeros(now.models.considered_count, dtype=bool)
        if not len(kept):
            return self
        of_modes = considered.of_modes(self.model.model.size)
        kept[of_modes - len(considered.frequency) : of_modes] = True  # their mean differs between points
        return replace(self, directions=distinguished_directions(now.models, now.states.left[0, 0], kept))

    def reduced_at(self, point: np.ndarray) -> GridProblem:
        """The same by a filter at a point (k,)."""
        return self.reduced_by(filter_points(replace(self, directions=None), one_point(point), self.first[-1]))

    def log_prior(self, point: np.ndarray) -> np.ndarray:
        """Log-prior of points (B, k), up to a constant."""
        return log_normal(point, *self.prior)


@dataclass(frozen=True)
class WeightedFilters(PosteriorWeights[C]):
    """Linear filters at all points after some steps, the last of them in record number `record`; free_load: filters by which the
    points are weighted, or None."""

    SHARED: ClassVar[tuple[str, ...]] = (*PosteriorWeights.SHARED, "record")

    models: LinearModels
    filters: Filters
    record: int
    free_load: FreeLoadFilters | None = None

    @property
    def states(self) -> States:
        """States with the configured loads; ν comes from the free-load filters if there are any, like the parameters."""
        states, directions = self.filters.states, self.models.directions
        if self.free_load is not None:
            states = with_nu(states, self.free_load.filters.states)
        return states if directions is None else states.of_all(directions)

    @property
    def about(self) -> np.ndarray:
        """Reference (d,) of ν."""
        about, directions = self.models.about, self.models.directions
        return about if directions is None else directions @ about

    @property
    def nu(self) -> np.ndarray:
        """Mean (B, d) of ν."""
        return np.asarray(self.states.nu[:, 0] + self.about)


F = TypeVar("F", States, Filters)


def with_nu(filters: F, others: F) -> F:
    """The filters with mean and covariance of ν taken from others."""
    return replace(filters, nu=others.nu, left=others.left)


@dataclass(frozen=True)
class Passed:
    """passage: with the configured loads; fit (B, L): weights of the points; states: with ν of the weighting filters."""

    passage: Passage
    fit: np.ndarray
    states: States


def filter_points(problem: GridProblem, cover: C, step: int) -> WeightedFilters[C]:
    """Filters at the given points, from the start through `step` steps."""
    models, filters, free_load = _start_filters(problem, cover, 0)
    B = models.count
    now = WeightedFilters(cover, problem.log_prior(cover.point), np.zeros(B), 0, models, filters, 0, free_load)
    most = max(1, KEPT // (B * (1 + models.considered_count if free_load else 1)))
    while now.step < step:
        now = enter_record(problem, now)
        passage = advance_points(problem, now, min(step - now.step, most), keep=False)
        now = apply_passage(now, passage, passage.fit.shape[1])
    return now


def _start_filters(problem: GridProblem, cover: C, number: int) -> tuple[LinearModels, Filters, FreeLoadFilters | None]:
    """Filters at the start of a record, with the prior of ν, and the free-load filters."""
    record = problem.records[number]
    models, free_load = linear_models(record.model, cover.point, record.considered, record.biased), None
    if problem.directions is not None and not problem.along:
        models = models.in_directions(problem.directions)
    if problem.has_free_loads:
        free_load = build_free_load_filters(record, models, cover.point)
        if not problem.along:  # nobody asks for loads as they are stated
            return free_load.models, free_load.filters, free_load
    filters = build_filters(
        models, *record.begun(models), consider=problem.along and considers(record.model, record.considered)
    )
    return models, filters, free_load


def enter_record(problem: GridProblem, now: WeightedFilters[C]) -> WeightedFilters[C]:
    """Enter the next record at the end of one: states restart from the prior, and the estimate of ν is kept."""
    if now.step < problem.first[now.record + 1]:
        return now
    models, filters, free_load = _start_filters(problem, now.cover, now.record + 1)
    if free_load is not None and now.free_load is not None:
        free_load = replace(free_load, filters=with_nu(free_load.filters, now.free_load.filters))
    return replace(
        now, models=models, filters=with_nu(filters, now.filters), record=now.record + 1, free_load=free_load
    )


def linearise_about_samples(problem: GridProblem, point: np.ndarray, nu: np.ndarray) -> GridProblem:
    """The problem linearised about the most likely damping and frequencies, with unknown loads about all ν that act on motion
    and rows.

    Unchanged if ν moves by less than MOVED. point (k,), nu (d,): parameters, and the mean of ν there. Gauss-Newton to the
    most likely ν at these parameters, with Laplace's normal density about it. Source: Tierney and Kadane, J. American
    Statistical Association 81 (1986)."""
    here, fit = one_point(point), np.inf
    for _ in range(TURNS):
        if not nu_has_moved(problem, nu):
            break
        problem = problem.map_considered(partial(replace, about=_linearisation_point(problem, nu)))
        now = filter_points(problem, here, problem.first[-1])
        problem = problem.reduced_by(now)
        if abs(now.fit[0] - fit) <= NOTICED:
            break
        nu, fit = now.nu[0], float(now.fit[0])
    return problem


def nu_has_moved(problem: GridProblem, nu: np.ndarray) -> bool:
    """Whether the mean of ν (d,) is MOVED from the linearisation: in ln c for damping, in σ otherwise."""
    considered, about = problem.records[0].considered, _linearisation_point(problem, nu)
    off = np.abs(about - np.pad(considered.about, (0, len(about) - len(considered.about))))
    modes = problem.model.model.size * (considered.damping > 0)
    return bool(considered.damping * off[:modes].max(initial=0.0) > MOVED or off[modes:].max(initial=0.0) > MOVED)


def _linearisation_point(problem: GridProblem, nu: np.ndarray) -> np.ndarray:
    """Linearisation point of ν: damping and frequencies of each mode, with unknown loads all ν that act on motion and rows.
    Additive ν are linear anyway."""
    about = np.clip(nu, -FARTHEST, FARTHEST)
    if not problem.has_free_loads:
        return np.asarray(about[: problem.records[0].considered.of_modes(problem.model.model.size)])
    # of several records, what adds to readings of one does nothing in the others
    offset = np.any([(record.considered.offset != 0).any(axis=1) for record in problem.records], axis=0)
    about[len(nu) - len(offset) :][offset] = 0.0
    return np.asarray(about)


def advance_points(problem: GridProblem, now: WeightedFilters[C], steps: int, keep: bool) -> Passed:
    """Advance by the next steps, as far as the record goes."""
    before = problem.first[now.record]
    span = slice(now.step - before, now.step - before + steps)
    data, power = problem.records[now.record].data.of(span), problem.birge_ratio**-2
    if now.free_load is None:
        passage = advance(now.models, now.filters, data, keep)
        return Passed(passage, power * passage.fit, passage.states)
    weighing = advance_free_loads(now.free_load, data, problem.records[now.record].noise_bias, span, keep)
    if not problem.along:
        return Passed(weighing, power * weighing.fit, weighing.states)
    passage = advance(now.models, now.filters, data, keep)
    return Passed(passage, power * weighing.fit, with_nu(passage.states, weighing.states))


def apply_passage(now: WeightedFilters[C], passage: Passed, steps: int) -> WeightedFilters[C]:
    """The state after the first steps of a passage."""
    return replace(now, fit=now.fit + passage.fit[:, :steps].sum(axis=1), step=now.step + steps)


def refuse_lost(problem: GridProblem, point: np.ndarray) -> None:
    """Raise NumericalError if a parameter (k,) is implausible: off its guess by a factor of exp(LOST), or of exp(ABSURD) and by
    UNLIKELY prior σ."""
    centre, prior = problem.prior
    off = np.abs(point - centre)
    lost = (off > LOST) | ((off > ABSURD) & (off > UNLIKELY * np.sqrt(np.diag(prior))))
    if lost.any():
        worst = int(np.argmax(np.where(lost, off, 0.0)))
        raise NumericalError(
            f"the measurements are fitted best by {np.exp(point[worst]):.3g} times the guess of "
            f"{problem.model.unknowns.parameters[worst]}, which is not plausible",
            remedy="check the channels (assignment, unit and sign) and the loads",
        )
