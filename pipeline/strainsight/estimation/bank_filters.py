"""Filters of a bank at points of the parameters: how they begin, and how they are taken through the samples."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.conditional import Nuisances, considers, linear_models
from strainsight.estimation.judge import Judge, joined_judges, judge_of, judged, noise_alone
from strainsight.estimation.lattice import DEPTH, SPACING, one_point
from strainsight.estimation.mixture import C, Standing, log_normal
from strainsight.estimation.model import FilterModel
from strainsight.estimation.parallel_filters import (
    KEPT,
    Filters,
    LinearModels,
    Passage,
    States,
    advance,
    filters_of,
    joined,
    joined_models,
)
from strainsight.estimation.record import BankRecord
from strainsight.estimation.reduced import LOST
from strainsight.estimation.run import Keep

MOVED = 0.05
"""Of ln c of a mode: half its square is what a slope in it leaves out, a thousandth of the damping."""
FARTHEST = 4.0
"""Of ν, in σ: beyond it samples contradict the model."""
ABSURD, UNLIKELY = 3.0, 20.0
"""Of the logarithm of a parameter over its guess, and of the same over its σ before the samples: no measurements of the part."""
TURNS, NOTICED = 8, 0.1
"""Most ν about which readings are taken to be linear, one after the other; and the change of their log-likelihood below
which it is nothing to them."""


@dataclass(frozen=True)
class BankProblem:
    """What a bank has to solve: records that follow one another, with one mean and covariance at t = 0; spacing and depth of a
    lattice, keep and progress as of `filter_bank`.

    Parameters and ν are the same in all records. Motion, loads and offsets begin anew in each, as mean and covariance say.
    judged: whether parameters beside unknown loads are judged by what no load could cause, and not by how likely the readings
    are under the loads as stated. along: whether states along the samples are asked for, or the posterior of parameters and ν at
    the end alone. birge_ratio: RMS of the innovations over their claim; the log-likelihood by which parameters are weighed is
    divided by its square, so that σ of the parameters is as many times as large.
    """

    records: tuple[BankRecord, ...]
    spacing: float = SPACING
    depth: float = DEPTH
    keep: Keep = "all"
    progress: Callable[[float], None] | None = None
    judged: bool = False
    along: bool = True
    birge_ratio: float = 1.0

    @property
    def model(self) -> FilterModel:
        """Of the first record; unknowns and states are those of all."""
        return self.records[0].model

    @property
    def first(self) -> tuple[int, ...]:
        """Steps before each record, and those of all."""
        return tuple(int(count) for count in np.cumsum([0, *(record.steps for record in self.records)]))

    @property
    def prior(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (k,) and covariance (k, k) of the parameters at t = 0."""
        return self.records[0].prior

    @property
    def centre(self) -> np.ndarray | None:
        """That of the frequencies, as of `Nuisances`."""
        return self.records[0].nuisances.centre

    @property
    def beside_loads(self) -> bool:
        """Whether parameters are judged beside unknown loads that are free."""
        return self.judged and self.model.beside_free_loads

    @property
    def bilinear(self) -> bool:
        """Whether parameters are judged beside ν over which readings are far from linear: a damping or a frequency that is not
        exact, or anything beside unknown loads."""
        nuisances, unknowns = self.records[0].nuisances, self.model.unknowns
        of_modes = nuisances.of_modes(self.model.model.size)
        return bool(unknowns.parameters) and (of_modes > 0 or (self.beside_loads and len(nuisances.D) > 0))

    @cached_property
    def noise_alone(self) -> tuple[np.ndarray, ...]:
        """Of every record (T, d): what its judge takes off, the same at all points of all covers, so that these compare."""
        by_record = []
        for i, record in enumerate(self.records):
            _, _, judge = _begun(self, one_point(self.prior[0]), i)
            assert judge is not None
            noise = np.where(np.isnan(record.data.samples), np.inf, record.data.noise)
            by_record.append(noise_alone(judge.models, record.start[1], noise, record.model.every))
        return tuple(by_record)

    def with_nuisances(self, of: Callable[[Nuisances], Nuisances]) -> BankProblem:
        """The same with others in every record."""
        return replace(self, records=tuple(replace(each, nuisances=of(each.nuisances)) for each in self.records))

    def log_prior(self, point: np.ndarray) -> np.ndarray:
        """Of points (B, k), but for a constant."""
        return log_normal(point, *self.prior)


@dataclass(frozen=True)
class LinearStanding(Standing[C]):
    """Linear filters at all points of a cover after some steps, the last of which are of record number `record`; judge: filters
    by which the points are weighed, None where those are."""

    models: LinearModels
    filters: Filters
    record: int
    judge: Judge | None = None

    @property
    def states(self) -> States:
        """At one instant, of the loads as stated, and with a judge ν by that; on purpose: loads are followed as they are stated,
        and ν is judged as the parameters are."""
        return self.filters.states if self.judge is None else of_judge(self.filters.states, self.judge.filters.states)


def of_judge(states: States, judge: States) -> States:
    """With mean and covariance of ν by a judge."""
    return replace(states, nu=judge.nu, left=judge.left)


@dataclass(frozen=True)
class Passed:
    """passage: by loads as stated; fit (B, L): by which the points are weighed; states with ν by that."""

    passage: Passage
    fit: np.ndarray
    states: States


def filtered_at(problem: BankProblem, cover: C, step: int) -> LinearStanding[C]:
    """Filters at the points of a cover, from the start through `step` steps."""
    models, filters, judge = _begun(problem, cover, 0)
    B = models.count
    now = LinearStanding(cover, problem.log_prior(cover.point), np.zeros(B), 0, models, filters, 0, judge)
    while now.step < step:
        now = entered(problem, now)
        passage = passed(problem, now, min(step - now.step, max(1, KEPT // B)), keep=False)
        now = on(now, passage, passage.fit.shape[1])
    return now


def _begun(problem: BankProblem, cover: C, number: int) -> tuple[LinearModels, Filters, Judge | None]:
    """Filters at the beginning of a record, nothing known of ν, and who judges."""
    record = problem.records[number]
    models, judge = linear_models(record.model, cover.point, record.nuisances, record.biased), None
    if problem.beside_loads:
        judge = judge_of(record, models, cover.point)
        if not problem.along:  # nobody asks for loads as they are stated
            return judge.models, judge.filters, judge
    filters = filters_of(
        models, *record.begun(models), consider=problem.along and considers(record.model, record.nuisances)
    )
    return models, filters, judge


def entered(problem: BankProblem, now: LinearStanding[C]) -> LinearStanding[C]:
    """At the beginning of the next record, where a record has ended: states are as they are before any sample, independent of
    those before, and what the samples so far say of ν is kept."""
    if now.step < problem.first[now.record + 1]:
        return now
    models, filters, judge = _begun(problem, now.cover, now.record + 1)
    kept = replace(filters, nu=now.filters.nu, left=now.filters.left)
    if judge is not None and now.judge is not None:
        before = now.judge.filters
        judge = replace(judge, filters=replace(judge.filters, nu=before.nu, left=before.left))
    return replace(now, models=models, filters=kept, record=now.record + 1, judge=judge)


def about_samples(problem: BankProblem, point: np.ndarray, nu: np.ndarray) -> BankProblem:
    """Linear about the damping and the frequencies that all samples speak for, beside unknown loads about all of ν that act on
    motion and rows; the same where that is hardly MOVED from where it is linear.

    point (k,), nu (d,): parameters, and the mean of ν there. By Gauss and Newton to the most likely ν at these parameters, with
    Laplace's normal density about it.
    Source: Tierney and Kadane, J. American Statistical Association 81 (1986).
    """
    here, fit = one_point(point), np.inf
    for _ in range(TURNS):
        if not moved(problem, nu):
            break
        problem = problem.with_nuisances(partial(replace, about=_about(problem, nu)))
        now = filtered_at(problem, here, problem.first[-1])
        if abs(now.fit[0] - fit) <= NOTICED:
            break
        nu, fit = now.states.nu[0, 0] + now.models.about, float(now.fit[0])
    return problem


def moved(problem: BankProblem, nu: np.ndarray) -> bool:
    """Whether the mean of ν (d,) is MOVED from where readings are linear: by ln c in the damping, by σ in all else."""
    nuisances, about = problem.records[0].nuisances, _about(problem, nu)
    off = np.abs(about - np.pad(nuisances.about, (0, len(about) - len(nuisances.about))))
    modes = problem.model.model.size * (nuisances.damping > 0)
    return bool(nuisances.damping * off[:modes].max(initial=0.0) > MOVED or off[modes:].max(initial=0.0) > MOVED)


def _about(problem: BankProblem, nu: np.ndarray) -> np.ndarray:
    """ν about which readings are to be linear: of damping and frequency of every mode, beside unknown loads of all that acts on
    motion and rows; in what adds to readings whatever the motion is they are linear."""
    about = np.clip(nu, -FARTHEST, FARTHEST)
    if not problem.beside_loads:
        return np.asarray(about[: problem.records[0].nuisances.of_modes(problem.model.model.size)])
    # of several records, what adds to readings of one does nothing in the others
    offset = np.any([(record.nuisances.offset != 0).any(axis=1) for record in problem.records], axis=0)
    about[len(nu) - len(offset) :][offset] = 0.0
    return np.asarray(about)


def passed(problem: BankProblem, now: LinearStanding[C], steps: int, keep: bool) -> Passed:
    """The next steps, as far as the record goes."""
    before = problem.first[now.record]
    span = slice(now.step - before, now.step - before + steps)
    data, power = problem.records[now.record].data.of(span), problem.birge_ratio**-2
    if now.judge is None:
        passage = advance(now.models, now.filters, data, keep)
        return Passed(passage, power * passage.fit, passage.states)
    verdict = judged(now.judge, data, problem.noise_alone[now.record][span], keep)
    if not problem.along:
        return Passed(verdict, power * verdict.fit, verdict.states)
    passage = advance(now.models, now.filters, data, keep)
    return Passed(passage, power * verdict.fit, of_judge(passage.states, verdict.states))


def on(now: LinearStanding[C], passage: Passed, steps: int) -> LinearStanding[C]:
    """After the first steps of a passage."""
    return replace(now, fit=now.fit + passage.fit[:, :steps].sum(axis=1), step=now.step + steps)


def one_standing(cover: C, parts: Sequence[LinearStanding[C]]) -> LinearStanding[C]:
    """Parts of one cover, in the order of its points."""
    prior, fit = (np.concatenate([getattr(part, name) for part in parts]) for name in ("prior", "fit"))
    models, filters = joined_models([part.models for part in parts]), joined([part.filters for part in parts])
    judges = [part.judge for part in parts if part.judge is not None]
    judge = joined_judges(judges) if judges else None
    return LinearStanding(cover, prior, fit, parts[0].step, models, filters, parts[0].record, judge)


def refuse_lost(problem: BankProblem, point: np.ndarray) -> None:
    """Raises NumericalError where a parameter (k,) is further from its guess than anyone may be mistaken: by a factor of
    exp(LOST), or of exp(ABSURD) and by UNLIKELY σ of what it is known to before the samples."""
    centre, prior = problem.prior
    off = np.abs(point - centre)
    lost = (off > LOST) | ((off > ABSURD) & (off > UNLIKELY * np.sqrt(np.diag(prior))))
    if lost.any():
        worst = int(np.argmax(np.where(lost, off, 0.0)))
        raise NumericalError(
            f"the measurements ask for {np.exp(point[worst]):.3g} times the guess of {problem.model.unknowns.parameters[worst]}",
            remedy="check which channel is which gauge, their units and signs, and the loads",
        )
