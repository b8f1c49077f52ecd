"""Filters of a grid filter at points of the parameters: how they begin, and how they are taken through the samples.

An unknown load is modelled as a random walk, and a real one is none. The likelihood of the walk as stated depends on the size of
the readings, and speaks for parameters at which they are larger or smaller. So the walk is free enough to follow a line in the
spectrum, and what noise of the gauges alone adds to the likelihood on average is taken off: of the parameters by a filter of
loads alone (`judged`), of ν by `noise_alone`. Source: Francke, Koopman and de Vos, J. Time Series Analysis 31 (2010).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import ClassVar, TypeVar

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.conditional import ConsideredParameters, considers, linear_models, none_considered, tuned
from strainsight.estimation.mixture import C, PosteriorWeights, log_normal
from strainsight.estimation.model import FilterModel
from strainsight.estimation.parallel_filters import (
    KEPT,
    Data,
    Filters,
    LinearModels,
    Passage,
    States,
    advance,
    filters_of,
)
from strainsight.estimation.parameter_grid import one_point
from strainsight.estimation.record import GridRecord, beginning
from strainsight.estimation.reduced import LOST
from strainsight.estimation.run import Keep

SLIGHT = 1e-3
"""Change of ln R for slopes in it."""


@dataclass(frozen=True)
class Judge:
    """Filters of free loads at the points of a grid filter; and those of what these loads alone read, under noises that are
    SLIGHT more and less than the gauges'. `alone` knows neither ν nor offsets of channels."""

    models: LinearModels
    filters: Filters
    alone: LinearModels
    louder: Filters
    quieter: Filters


def judge_of(record: GridRecord, stated: LinearModels, point: np.ndarray) -> Judge:
    """At points (B, k) before any step of a record, where the filters of loads as stated have the models `stated`."""
    (free, alone), (mean, covariance) = record.free, record.start
    offsets, loads = len(record.biased), np.zeros(len(mean), dtype=bool)
    states, loads[free.input_states] = free.parameter_states.start, True
    Q = np.pad(free.process[:states, :states], (0, offsets))
    models = replace(stated, Q=np.broadcast_to(Q, stated.Q.shape))
    alone = tuned(alone, record.considered, point)[0]
    of_loads = linear_models(alone, point, none_considered(free), record.biased)
    start = np.zeros((len(point), len(mean))), np.where(np.outer(loads, loads), covariance, 0.0)
    return Judge(
        models,
        filters_of(models, *beginning(free, models, mean, covariance, None)),
        of_loads,
        *(filters_of(of_loads, *start, np.zeros((len(point), 0, len(mean)))) for _ in range(2)),
    )


def judged(judge: Judge, data: Data, less: np.ndarray, keep: bool) -> Passage:
    """Take it some steps on: what its filters found, with the fit by which points are weighed. Arguments as of `advance`.

    Of noise v alone, with S the covariance of all that loads alone read, E ln p(v) = −½ ln|S| − ½ tr(R S⁻¹) but for a constant,
    and tr(R S⁻¹) is the slope of ln|S| in ln R: of readings of zero at R e^{±δ}.
    """
    passage = advance(judge.models, judge.filters, data, keep, states=False, less=less)
    loads = np.zeros((len(data.known_end), judge.alone.F.shape[-1]))
    quiet = replace(data, known=0 * data.known, known_end=loads, samples=np.where(np.isnan(data.samples), np.nan, 0.0))

    def alone(filters: Filters, factor: float) -> np.ndarray:
        return advance(judge.alone, filters, replace(quiet, noise=factor * data.noise), False).fit

    louder, quieter = alone(judge.louder, np.exp(SLIGHT)), alone(judge.quieter, np.exp(-SLIGHT))
    return replace(passage, fit=passage.fit - 0.5 * (louder + quieter) - (louder - quieter) / (2 * SLIGHT))


SETTLED = 1e-9
"""Change of a covariance from sample to sample, beside its standard deviations, below which it stays."""


@dataclass(frozen=True)
class _NoiseStep:
    """Of one step of a filter on noise: P (n, n) as claimed and Π (n, n) by noise alone of its prediction; gain K (n, m),
    weight S⁻¹ (m, m) of the innovations, zero where none is; variance R (m,) of the samples, zero where there is none."""

    P: np.ndarray
    covariance: np.ndarray
    gain: np.ndarray
    weight: np.ndarray
    noise: np.ndarray


def noise_alone(models: LinearModels, covariance: np.ndarray, noise: np.ndarray, every: int = 1) -> np.ndarray:
    """β (T, d), of which the sum is the mean of Σₜ εₜᵀ Sₜ⁻¹ eₜ over records that are the noise of gauges alone.

    ε are the slopes of innovations e in ν (`parallel_filters.advance`). β = 0 where innovations are as the filter claims, and so
    independent of ε; readings that are quieter have others. Under noise alone, with Φ = A(1 − KH) from prediction to prediction,

        Π⁺ = ΦΠΦᵀ + AKRKᵀAᵀ = E x̂x̂ᵀ,   Y = ΦᵀY⁺Φ + HᵀS⁻¹H
        β_k = ⟨KᵀAᵀY⁺ΦΠ − S⁻¹HΠ, D_k⟩ − ⟨Y⁺(ΦΠ(1 − KH)ᵀ + AKRKᵀ), A_k⟩

    Π forward in time and Y backward, in place of E x̂V_kᵀ of every k.
    models: one; covariance (n, n) of its states at t = 0; noise (T, m) variances of the samples, infinite where there is none;
    every: steps from sample to sample. βₜ is what comes of the noise up to step t, in that step and later.
    """
    A, H, A_nu = models.A[0], models.H[0], models.A_nu[0]
    steps = _forward(A, H, models.Q[0], covariance, noise, every)
    Y, one, beta = (
        [np.zeros_like(A)] * (len(steps) + 1),
        np.eye(len(A)),
        np.zeros((len(noise), models.considered_count)),
    )
    for t in reversed(range(len(steps))):
        now, after, later = steps[t], Y[t + 1], t + every
        if later < len(steps) and now is steps[later] and _settled(after, Y[later + 1], after):
            Y[t], beta[t] = Y[later], beta[later]
            continue
        kept = one - now.gain @ H
        loop = A @ kept
        seen = loop @ now.covariance
        on_rows = (A @ now.gain).T @ after @ seen - now.weight @ H @ now.covariance
        on_motion = after @ (seen @ kept.T + A @ (now.gain * now.noise) @ now.gain.T)
        beta[t] = np.tensordot(models.D, on_rows)
        beta[t, : len(A_nu)] -= np.tensordot(A_nu, on_motion)
        Y[t] = loop.T @ after @ loop + H.T @ now.weight @ H
    return beta


def _forward(
    A: np.ndarray, H: np.ndarray, Q: np.ndarray, P: np.ndarray, noise: np.ndarray, every: int
) -> list[_NoiseStep]:
    """Every step of the filter, from rest; where nothing changes any more it is the one a sample before."""
    steps: list[_NoiseStep] = []
    one, by_noise = np.eye(len(A)), np.zeros_like(A)
    for t, variance in enumerate(noise):
        P, by_noise = A @ P @ A.T + Q, A @ by_noise @ A.T
        measured = np.isfinite(variance)
        R = np.where(measured, variance, 0.0)
        before = steps[t - every] if t >= every else None
        if (
            before is not None
            and np.array_equal(R, before.noise)
            and _settled(P, before.P, P)
            and _settled(by_noise, before.covariance, P)
        ):
            now = before
        else:
            weight, seen = np.zeros((len(H), len(H))), H[measured]
            weight[np.ix_(measured, measured)] = np.linalg.inv(seen @ P @ seen.T + np.diag(R[measured]))
            now = _NoiseStep(P, by_noise, P @ H.T @ weight, weight, R)
        steps.append(now)
        left, fed = one - now.gain @ H, (now.gain * now.noise) @ now.gain.T
        P, by_noise = left @ now.P @ left.T + fed, left @ now.covariance @ left.T + fed
    return steps


def _settled(X: np.ndarray, before: np.ndarray, P: np.ndarray) -> bool:
    """Whether X (n, n) has moved by less than SETTLED of the standard deviations of P."""
    std = np.sqrt(np.abs(np.diag(P)))
    return bool(np.all(np.abs(X - before) <= SETTLED * np.outer(std, std)))


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
class GridProblem:
    """What a grid filter has to solve: records that follow one another, with one mean and covariance at t = 0; keep and progress
    as of `filter_records`.

    Parameters and ν are the same in all records. Motion, loads and offsets begin anew in each, as mean and covariance say.
    judged: whether parameters beside unknown loads are judged by what no load could cause, and not by how likely the readings
    are under the loads as stated. along: whether states along the samples are asked for, or the posterior of parameters and ν at
    the end alone. birge_ratio: RMS of the innovations over their claim; the log-likelihood by which parameters are weighed is
    divided by its square, so that σ of the parameters is as many times as large.
    """

    records: tuple[GridRecord, ...]
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
        """That of the frequencies, as of `ConsideredParameters`."""
        return self.records[0].considered.centre

    @property
    def beside_loads(self) -> bool:
        """Whether parameters are judged beside unknown loads that are free."""
        return self.judged and self.model.beside_free_loads

    @property
    def bilinear(self) -> bool:
        """Whether parameters are judged beside ν over which readings are far from linear: a damping or a frequency that is not
        exact, or anything beside unknown loads."""
        considered, unknowns = self.records[0].considered, self.model.unknowns
        of_modes = considered.of_modes(self.model.model.size)
        return bool(unknowns.parameters) and (of_modes > 0 or (self.beside_loads and len(considered.D) > 0))

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

    def map_considered(self, of: Callable[[ConsideredParameters], ConsideredParameters]) -> GridProblem:
        """The same with others in every record."""
        return replace(self, records=tuple(replace(each, considered=of(each.considered)) for each in self.records))

    def log_prior(self, point: np.ndarray) -> np.ndarray:
        """Of points (B, k), but for a constant."""
        return log_normal(point, *self.prior)


@dataclass(frozen=True)
class WeightedFilters(PosteriorWeights[C]):
    """Linear filters at all points of a cover after some steps, the last of which are of record number `record`; judge: filters
    by which the points are weighed, None where those are."""

    SHARED: ClassVar[tuple[str, ...]] = (*PosteriorWeights.SHARED, "record")

    models: LinearModels
    filters: Filters
    record: int
    judge: Judge | None = None

    @property
    def states(self) -> States:
        """At one instant, of the loads as stated, and with a judge ν by that; on purpose: loads are followed as they are stated,
        and ν is judged as the parameters are."""
        return self.filters.states if self.judge is None else with_nu(self.filters.states, self.judge.filters.states)


F = TypeVar("F", States, Filters)


def with_nu(filters: F, others: F) -> F:
    """With mean and covariance of ν by others."""
    return replace(filters, nu=others.nu, left=others.left)


@dataclass(frozen=True)
class Passed:
    """passage: by loads as stated; fit (B, L): by which the points are weighed; states with ν by that."""

    passage: Passage
    fit: np.ndarray
    states: States


def filtered_at(problem: GridProblem, cover: C, step: int) -> WeightedFilters[C]:
    """Filters at the points of a cover, from the start through `step` steps."""
    models, filters, judge = _begun(problem, cover, 0)
    B = models.count
    now = WeightedFilters(cover, problem.log_prior(cover.point), np.zeros(B), 0, models, filters, 0, judge)
    while now.step < step:
        now = entered(problem, now)
        passage = passed(problem, now, min(step - now.step, max(1, KEPT // B)), keep=False)
        now = on(now, passage, passage.fit.shape[1])
    return now


def _begun(problem: GridProblem, cover: C, number: int) -> tuple[LinearModels, Filters, Judge | None]:
    """Filters at the beginning of a record, nothing known of ν, and who judges."""
    record = problem.records[number]
    models, judge = linear_models(record.model, cover.point, record.considered, record.biased), None
    if problem.beside_loads:
        judge = judge_of(record, models, cover.point)
        if not problem.along:  # nobody asks for loads as they are stated
            return judge.models, judge.filters, judge
    filters = filters_of(
        models, *record.begun(models), consider=problem.along and considers(record.model, record.considered)
    )
    return models, filters, judge


def entered(problem: GridProblem, now: WeightedFilters[C]) -> WeightedFilters[C]:
    """At the beginning of the next record, where a record has ended: states are as they are before any sample, independent of
    those before, and what the samples so far say of ν is kept."""
    if now.step < problem.first[now.record + 1]:
        return now
    models, filters, judge = _begun(problem, now.cover, now.record + 1)
    if judge is not None and now.judge is not None:
        judge = replace(judge, filters=with_nu(judge.filters, now.judge.filters))
    return replace(now, models=models, filters=with_nu(filters, now.filters), record=now.record + 1, judge=judge)


def about_samples(problem: GridProblem, point: np.ndarray, nu: np.ndarray) -> GridProblem:
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
        problem = problem.map_considered(partial(replace, about=_about(problem, nu)))
        now = filtered_at(problem, here, problem.first[-1])
        if abs(now.fit[0] - fit) <= NOTICED:
            break
        nu, fit = now.states.nu[0, 0] + now.models.about, float(now.fit[0])
    return problem


def moved(problem: GridProblem, nu: np.ndarray) -> bool:
    """Whether the mean of ν (d,) is MOVED from where readings are linear: by ln c in the damping, by σ in all else."""
    considered, about = problem.records[0].considered, _about(problem, nu)
    off = np.abs(about - np.pad(considered.about, (0, len(about) - len(considered.about))))
    modes = problem.model.model.size * (considered.damping > 0)
    return bool(considered.damping * off[:modes].max(initial=0.0) > MOVED or off[modes:].max(initial=0.0) > MOVED)


def _about(problem: GridProblem, nu: np.ndarray) -> np.ndarray:
    """ν about which readings are to be linear: of damping and frequency of every mode, beside unknown loads of all that acts on
    motion and rows; in what adds to readings whatever the motion is they are linear."""
    about = np.clip(nu, -FARTHEST, FARTHEST)
    if not problem.beside_loads:
        return np.asarray(about[: problem.records[0].considered.of_modes(problem.model.model.size)])
    # of several records, what adds to readings of one does nothing in the others
    offset = np.any([(record.considered.offset != 0).any(axis=1) for record in problem.records], axis=0)
    about[len(nu) - len(offset) :][offset] = 0.0
    return np.asarray(about)


def passed(problem: GridProblem, now: WeightedFilters[C], steps: int, keep: bool) -> Passed:
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
    return Passed(passage, power * verdict.fit, with_nu(passage.states, verdict.states))


def on(now: WeightedFilters[C], passage: Passed, steps: int) -> WeightedFilters[C]:
    """After the first steps of a passage."""
    return replace(now, fit=now.fit + passage.fit[:, :steps].sum(axis=1), step=now.step + steps)


def refuse_lost(problem: GridProblem, point: np.ndarray) -> None:
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
