"""The filter run many times at once: noise levels, seeds and starting values, random sets beside the chosen one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.tolerances import Sweeps, Validate
from strainsight.errors import ConfigError, NumericalError
from strainsight.estimation.model import physical
from strainsight.estimation.reduced import DrivenModel
from strainsight.estimation.run import all_lost
from strainsight.experiment.structure.problem import filter_model, sample_std
from strainsight.experiment.structure.trial import (
    Trial,
    at_step,
    real_and_claimed,
    sample_noise,
    scaled_truth,
    without_truth,
)
from strainsight.parallel import Sweep, serial
from strainsight.records.validated import NoiseStudy, RandomSetErrors, Starts, SweepTable
from strainsight.runner.output import Table


@dataclass(frozen=True)
class Runs:
    """Filter runs: channels (B, k), −1 for none; noise_factor (B,), start (B, unknowns) of [ũ, p], seed (B,) of the noise;
    drawn (B,): number of the truth's realisation, 0 the layout's own."""

    channels: np.ndarray
    noise_factor: np.ndarray
    start: np.ndarray
    seed: np.ndarray
    drawn: np.ndarray


@dataclass(frozen=True)
class Study:
    """What some runs found, by name: real and claimed error (B,), estimate and its σ (T + 1, B) [SI]."""

    runs: Runs
    real: dict[str, np.ndarray]
    claimed: dict[str, np.ndarray]
    estimate: dict[str, np.ndarray]
    std: dict[str, np.ndarray]


@dataclass(frozen=True)
class Studies:
    """All studies of a validation.

    noise      other noise levels
    repeats    other noise and other starting values, and the layout installed anew where the truth is drawn
    screened   random sets of the screened pool, on the layout's own noise
    all        random sets of all candidates
    """

    noise: Study
    repeats: Study
    screened: Study
    all: Study


CHOICES = 1 << 31
"""Stream of the random numbers that choose starts and sets, apart from those of the noise."""


def studies_of(
    trial: Trial, settings: Validate, kept: np.ndarray, allowed: np.ndarray, seed: int, sweep: Sweep = serial
) -> Studies:
    """Filtered in batches of at most BATCH runs; settings: the config's validate section, kept: the screened pool, allowed: every
    gauge that keeps the clearance.

    Repeats begin at the truth plus a draw of the initial σ, so that the two differ as much as the filter takes them to: σ
    of what the samples say little of is that of its start, and about the guess it would be judged by how good that is."""
    rng = np.random.default_rng([seed, CHOICES])
    spread = np.array([settings.initial_std[name] for name in trial.names])
    repeats, count = settings.repeats, settings.random_sets
    factors = np.array(settings.noise_factors, dtype=float)
    starts = scaled_truth(trial)[0] + spread * rng.standard_normal((repeats, len(spread)))
    home, others = np.zeros_like(spread), np.arange(1, repeats + 1)
    own = np.zeros(max(len(factors), count), dtype=int)
    parts = {
        "noise": _runs(trial.chosen, factors, home, own[: len(factors)]),
        "repeats": replace(_runs(trial.chosen, 1.0, starts, others), drawn=others),
    }
    every = trial.problem.channels
    size = len(np.unique(every.gauge[trial.chosen]))
    for key, pool in (("screened", kept), ("all", allowed)):
        sets = [rng.choice(pool, size, replace=False) for _ in range(count)]
        channels = every.of(np.array(sets, dtype=int).reshape(count, size))
        parts[key] = _runs(channels.reshape(count, size * channels.shape[-1]), 1.0, home, own[:count])
    return Studies(**_studied(trial, parts, seed, sweep))


FEWEST_SETS = 10
"""Sets below which a rank says nothing."""


@dataclass(frozen=True)
class Rank:
    """Of the layout among random sets, by real and by claimed error (1 is best); Spearman's correlation of the two over all
    of them (thesis 6.3, as statistics)."""

    real: int
    claimed: int
    correlation: float


def rank_of(random: Study, name: str, real: float, claimed: float) -> Rank | None:
    """By the errors of one unknown; None among too few sets."""
    errors = np.array([np.append(random.real[name], real), np.append(random.claimed[name], claimed)])
    known = np.isfinite(errors).all(axis=0)
    if known.sum() < FEWEST_SETS or not known[-1]:
        return None
    errors = errors[:, known]
    order = np.argsort(np.argsort(errors, axis=1), axis=1).astype(float)
    by_real, by_claimed = (int(1 + np.sum(own[:-1] < own[-1])) for own in errors)
    return Rank(by_real, by_claimed, float(np.corrcoef(order)[0, 1]))


def noise_levels(study: Study) -> NoiseStudy:
    """As it is written."""
    return NoiseStudy(factor=study.runs.noise_factor, error=study.real, std=study.claimed)


def repeated(study: Study) -> Starts:
    """As it is written."""
    start = {name: study.runs.start[:, i] for i, name in enumerate(study.real)}
    return Starts(error=study.real, std=study.claimed, start=start)


def random_sets(study: Study) -> RandomSetErrors:
    """As it is written."""
    return RandomSetErrors(candidate=study.runs.channels, error=study.real, std=study.claimed, estimate=study.estimate)


def _runs(channels: np.ndarray, noise_factor: float | np.ndarray, start: np.ndarray, seed: np.ndarray) -> Runs:
    """Runs with whatever is common repeated for each; seed (B,) sets their number."""
    B = len(seed)
    return Runs(
        np.broadcast_to(channels, (B, channels.shape[-1])),
        np.broadcast_to(np.asarray(noise_factor, dtype=float), (B,)),
        np.broadcast_to(start, (B, start.shape[-1])),
        seed,
        np.zeros(B, dtype=int),
    )


BATCH = 8
"""Runs that are one task of a sweep. Never the number of processes: the size of a batch may change the last bit of results."""


@dataclass(frozen=True)
class _Batch:
    """Runs and what their channels read without noise, true (T, B, k); seed of the config."""

    runs: Runs
    true: np.ndarray
    seed: int


def _studied(trial: Trial, parts: Mapping[str, Runs], seed: int, sweep: Sweep) -> dict[str, Study]:
    width = max(part.channels.shape[1] for part in parts.values())
    channels = np.concatenate([_widened(part.channels, width) for part in parts.values()])
    factor, start, stream, drawn = (
        np.concatenate([getattr(part, name) for part in parts.values()])
        for name in ("noise_factor", "start", "seed", "drawn")
    )
    batches = []
    for own in np.array_split(np.arange(len(stream)), -(-len(stream) // BATCH)):
        runs = Runs(channels[own], factor[own], start[own], stream[own], drawn[own])
        batches.append(_Batch(runs, _true(trial, runs), seed))
    found = sweep(_batch, batches, without_truth(trial))
    lost = np.concatenate([answer[-1] for answer in found])
    if np.all(lost >= 0):
        raise all_lost(DrivenModel(filter_model(trial.problem, channels[:1], trial.h), trial.known), lost)
    real, claimed, estimate, std = (
        {name: np.concatenate([answer[i][name] for answer in found], axis=-1) for name in trial.names} for i in range(4)
    )
    studies, first = {}, 0
    for key, part in parts.items():
        span = slice(first, first + len(part.seed))
        first = span.stop
        studies[key] = Study(
            part,
            *({name: values[name][..., span] for name in trial.names} for values in (real, claimed, estimate, std)),
        )
    return studies


def _true(trial: Trial, runs: Runs) -> np.ndarray:
    """What the runs measure without noise (T, B, k)."""
    true = trial.reading(runs.channels)[1:]
    if trial.again is not None:
        for run in np.flatnonzero(runs.drawn):
            true[:, run, : len(trial.chosen)] = trial.again(int(runs.drawn[run]))[1:]
    return true


Answer = tuple[dict[str, np.ndarray], dict[str, np.ndarray], dict[str, np.ndarray], dict[str, np.ndarray], np.ndarray]
"""By name: real and claimed error (B,), estimate and its σ (T + 1, B); then the steps that lost the runs (B,)."""


def _batch(trial: Trial, batch: _Batch) -> Answer:
    """Measure with noise and filter: a task of a sweep."""
    runs = batch.runs
    model = filter_model(trial.problem, runs.channels, trial.h, runs.noise_factor)
    shape = (len(batch.true), runs.channels.shape[1])
    noise = np.stack([sample_noise(batch.seed, int(realisation), *shape) for realisation in runs.seed], axis=1)
    measured = batch.true + noise * sample_std(trial.problem, runs.channels, trial.h, runs.noise_factor)
    mean = np.zeros((len(runs.seed), model.size))
    mean[:, model.position] = runs.start
    found = trial.filtered(model, runs.channels, measured, mean, refuse=False).run
    real, claimed = real_and_claimed(trial, model, found.mean, found.std)
    values = physical(model, found.mean, found.std)
    estimate, std = ({name: values[name][i] for name in trial.names} for i in (0, 1))
    return real, claimed, estimate, std, found.lost


def _widened(channels: np.ndarray, width: int) -> np.ndarray:
    """Channels (B, k) with columns of none added up to a width."""
    return np.pad(channels, ((0, 0), (0, width - channels.shape[1])), constant_values=-1)


@dataclass(frozen=True)
class Point:
    """One change: key "time_step", "process_noise" or the name of a parameter; its value [s] or factor [-]."""

    key: str
    value: float


def sweeps_of(trial: Trial, settings: Validate, seed: int, sweep: Sweep = serial) -> SweepTable | None:
    """Every point of `validate.sweeps`, None without one; errors are NaN where the filter diverged.

    Other time steps have measurements of their own; the noise of a sample then is what its intensity makes of it.
    Raises ConfigError for a wrong parameter that is estimated or is none.
    """
    points = _points(trial, settings.sweeps)
    if not points:
        return None
    duration = settings.duration
    at = {p.value: at_step(trial, p.value, round(duration / p.value) * p.value) for p in points if p.key == "time_step"}
    own = _Task(None, trial.measured(seed)[0])
    tasks = [
        (
            point,
            _Task(without_truth(at[point.value]), at[point.value].measured(seed)[0])
            if point.key == "time_step"
            else own,
        )
        for point in points
    ]
    found = sweep(_swept, tasks, without_truth(trial))
    return SweepTable(
        key=tuple(point.key for point in points),
        value=np.array([point.value for point in points]),
        error={name: np.array([real[name] for real, _ in found]) for name in trial.names},
        std={name: np.array([claimed[name] for _, claimed in found]) for name in trial.names},
    )


def _points(trial: Trial, sweeps: Sweeps) -> list[Point]:
    points = [Point("time_step", h) for h in sweeps.time_steps]
    points += [Point("process_noise", factor) for factor in sweeps.process_noise]
    for name, factors in sweeps.wrong_parameters.items():
        key = f"validate.sweeps.wrong_parameters.{name}"
        if name not in trial.problem.model.parameters:
            known = ", ".join(trial.problem.model.parameters) or "none"
            raise ConfigError(f"no parameter is named '{name}'", key=key, remedy=f"parameters: {known}")
        if name in trial.problem.unknowns.parameters:
            raise ConfigError(
                f"'{name}' is estimated, so the filter takes no value of it for known",
                key=key,
                remedy="name a parameter that is not estimated",
            )
        points += [Point(name, factor) for factor in factors]
    return points


@dataclass(frozen=True)
class _Task:
    """The trial at another time step, None: the layout's own; measured (T, k) by the layout."""

    trial: Trial | None
    measured: np.ndarray


def _swept(own: Trial, changed: tuple[Point, _Task]) -> tuple[dict[str, float], dict[str, float]]:
    """Real and claimed error of every unknown."""
    point, task = changed
    trial, measured = task.trial or own, task.measured
    model = filter_model(trial.problem, trial.chosen, trial.h)
    if point.key == "process_noise":
        model = replace(model, Q=point.value * model.Q)
    if point.key in model.fixed:
        truth = trial.truth.theta[point.key]
        model = replace(model, fixed={**model.fixed, point.key: point.value * truth})
    try:
        run = trial.filtered(model, trial.chosen, measured).run
    except NumericalError:
        diverged = dict.fromkeys(trial.names, float("nan"))
        return diverged, diverged
    real, claimed = real_and_claimed(trial, model, run.mean, run.std)
    return {n: float(v[0]) for n, v in real.items()}, {n: float(v[0]) for n, v in claimed.items()}


def sweep_table(swept: SweepTable) -> Table:
    """Real beside claimed error at every point."""
    words = {"time_step": "time step {:g} s", "process_noise": "process noise × {:g}"}
    rows = tuple(
        (
            words.get(key, f"{key} taken {{:g}} of the truth").format(value),
            *(f"{100 * swept.error[n][i]:.3g} % (claims {100 * swept.std[n][i]:.2g} %)" for n in swept.error),
        )
        for i, (key, value) in enumerate(zip(swept.key, swept.value, strict=True))
    )
    columns = ("change", *(f"error of {name}" for name in swept.error))
    return Table("one change of the filter at a time", columns, rows)
