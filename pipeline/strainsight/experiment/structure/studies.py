"""Studies of many filter runs: noise levels, seeds, starting values and random layouts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from strainsight.config.tolerances import Studies, Sweeps, Validate
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
    """Filter runs: channels (B, k), −1 for none; noise_factor (B,); start (B, unknowns) of [ũ, p]; realisation (B,): number of
    the realisation of noise and truth, 0 for the layout."""

    channels: np.ndarray
    noise_factor: np.ndarray
    start: np.ndarray
    realisation: np.ndarray


CHOICES = 1 << 31
"""Stream of random numbers for starts and layouts, independent of the noise."""


def studies_of(
    trial: Trial,
    settings: Studies,
    initial_std: Mapping[str, float],
    screened: np.ndarray,
    allowed: np.ndarray,
    seed: int,
    sweep: Sweep = serial,
) -> tuple[dict[str, Any], int]:
    """Run the studies of `Validated`; returns its fields and the number of diverged runs:

    noise      other noise levels
    repeats    other noise, starting values and, with a sampled truth, installation errors
    screened   random layouts from the screened pool, with the noise of the layout
    all        random layouts from all candidates

    initial_std: of each unknown; screened: pool; allowed: all gauges that keep the clearance. Repeats start at the truth
    plus a sample of the initial σ, as the filter assumes."""
    rng = np.random.default_rng([seed, CHOICES])
    spread = np.array([initial_std[name] for name in trial.names])
    repeats, count = settings.repeats, settings.random_sets
    factors = np.array(settings.noise_factors, dtype=float)
    starts = scaled_truth(trial)[0] + spread * rng.standard_normal((repeats, len(spread)))
    home, others = np.zeros_like(spread), np.arange(1, repeats + 1)
    parts = {
        "noise": _runs(len(factors), trial.chosen, factors, home),
        "repeats": _runs(repeats, trial.chosen, 1.0, starts, others),
    }
    every = trial.problem.channels
    size = len(np.unique(every.gauge[trial.chosen]))
    for key, pool in (("screened", screened), ("all", allowed)):
        sets = [rng.choice(pool, size, replace=False) for _ in range(count)]
        channels = every.of(np.array(sets, dtype=int).reshape(count, size))
        parts[key] = _runs(count, channels.reshape(count, size * channels.shape[-1]), 1.0, home)
    each = _studied(trial, parts, seed, sweep)
    errors = {key: {"error": study.error, "std": study.std} for key, study in each.items()}
    random = {
        key: RandomSetErrors(**errors[key], candidate=parts[key].channels, estimate=each[key].estimate)
        for key in ("screened", "all")
    }
    start = {name: starts[:, i] for i, name in enumerate(trial.names)}
    noise, started = NoiseStudy(**errors["noise"], factor=factors), Starts(**errors["repeats"], start=start)
    lost = sum(int(np.isnan(study.error[trial.names[-1]]).sum()) for study in each.values())
    return {"noise": noise, "repeats": started, **random}, lost


FEWEST_SETS = 10
"""Fewest random layouts for a meaningful rank."""


@dataclass(frozen=True)
class Rank:
    """Rank of the layout among random layouts by real and by claimed error (1 is best), and Spearman's correlation of the two
    (thesis 6.3)."""

    real: int
    claimed: int
    correlation: float


def rank_of(random: RandomSetErrors, name: str, real: float, claimed: float) -> Rank | None:
    """Rank by the errors of one unknown; None with too few layouts."""
    errors = np.array([np.append(random.error[name], real), np.append(random.std[name], claimed)])
    known = np.isfinite(errors).all(axis=0)
    if known.sum() < FEWEST_SETS or not known[-1]:
        return None
    errors = errors[:, known]
    order = np.argsort(np.argsort(errors, axis=1), axis=1).astype(float)
    by_real, by_claimed = (int(1 + np.sum(each[:-1] < each[-1])) for each in errors)
    return Rank(by_real, by_claimed, float(np.corrcoef(order)[0, 1]))


def _runs(
    count: int,
    channels: np.ndarray,
    noise_factor: float | np.ndarray,
    start: np.ndarray,
    realisation: np.ndarray | None = None,
) -> Runs:
    """Broadcast common inputs to `count` runs."""
    return Runs(
        np.broadcast_to(channels, (count, channels.shape[-1])),
        np.broadcast_to(np.asarray(noise_factor, dtype=float), (count,)),
        np.broadcast_to(start, (count, start.shape[-1])),
        np.zeros(count, dtype=int) if realisation is None else realisation,
    )


BATCH = 8
"""Runs per task of a sweep; independent of the number of processes, as it may change the last bit of results."""


Batch = tuple[Runs, np.ndarray, int]
"""Runs, readings without noise (T, B, k), and the seed of the config."""


@dataclass(frozen=True)
class _Study:
    """Results by unknown: real and claimed error (B,), estimate (T + 1, B) [SI]; lost (B,): step of divergence, −1 for none."""

    error: dict[str, np.ndarray]
    std: dict[str, np.ndarray]
    estimate: dict[str, np.ndarray]
    lost: np.ndarray


def _studied(trial: Trial, parts: Mapping[str, Runs], seed: int, sweep: Sweep) -> dict[str, _Study]:
    channels = [part.channels for part in parts.values()]
    width = max(each.shape[1] for each in channels)
    runs = Runs(
        np.concatenate([np.pad(c, ((0, 0), (0, width - c.shape[1])), constant_values=-1) for c in channels]),
        *(
            np.concatenate([getattr(part, key) for part in parts.values()])
            for key in ("noise_factor", "start", "realisation")
        ),
    )
    batches = []
    for at in np.array_split(np.arange(len(runs.realisation)), -(-len(runs.realisation) // BATCH)):
        some = Runs(runs.channels[at], runs.noise_factor[at], runs.start[at], runs.realisation[at])
        batches.append((some, _true(trial, some), seed))
    answers: list[_Study] = sweep(_batch, batches, without_truth(trial))
    lost = np.concatenate([batch.lost for batch in answers])
    if np.all(lost >= 0):
        raise all_lost(DrivenModel(filter_model(trial.problem, runs.channels[:1], trial.h), trial.known), lost)
    ends = np.cumsum([len(part.realisation) for part in parts.values()])
    spans = {key: slice(end - len(part.realisation), end) for (key, part), end in zip(parts.items(), ends, strict=True)}

    def of(what: str, span: slice) -> dict[str, np.ndarray]:
        return {
            name: np.concatenate([getattr(batch, what)[name] for batch in answers], axis=-1)[..., span]
            for name in trial.names
        }

    return {
        key: _Study(of("error", span), of("std", span), of("estimate", span), lost[span]) for key, span in spans.items()
    }


def _true(trial: Trial, runs: Runs) -> np.ndarray:
    """Readings of the runs without noise (T, B, k)."""
    true = trial.reading(runs.channels)[1:]
    if trial.again is not None:
        for run in np.flatnonzero(runs.realisation):
            true[:, run, : len(trial.chosen)] = trial.again(int(runs.realisation[run]))[1:]
    return true


def _batch(trial: Trial, batch: Batch) -> _Study:
    """Add noise and filter: one task of a sweep."""
    runs, true, seed = batch
    model = filter_model(trial.problem, runs.channels, trial.h, runs.noise_factor)
    shape = (len(true), runs.channels.shape[1])
    noise = np.stack([sample_noise(seed, int(number), *shape) for number in runs.realisation], axis=1)
    measured = true + noise * sample_std(trial.problem, runs.channels, trial.h, runs.noise_factor)
    mean = np.zeros((len(runs.realisation), model.size))
    mean[:, model.position] = runs.start
    run = trial.filtered(model, runs.channels, measured, mean, refuse=False).run
    values = physical(model, run.mean, run.std)
    estimate = {name: values[name][0] for name in trial.names}
    return _Study(*real_and_claimed(trial, model, run.mean, run.std), estimate, run.lost)


SweepTask = tuple[str, float, Trial | None, np.ndarray]
"""One change: "time_step", "process_noise" or a parameter, and its value [s] or factor [-]; the trial at another time step, None
if unchanged; readings (T, k) of the layout."""


def sweeps_of(trial: Trial, settings: Validate, seed: int, sweep: Sweep = serial) -> SweepTable | None:
    """Run `validate.sweeps`, None without points; errors are NaN if the filter diverged.

    Measurements are simulated again for other time steps, with the same noise intensity. Raises ConfigError for a wrong parameter
    that is estimated or unknown."""
    points = _points(trial, settings.sweeps)
    if not points:
        return None
    as_placed = trial.measured(seed)[0]
    tasks: list[SweepTask] = []
    for key, value in points:
        if key == "time_step":
            other = at_step(trial, value, round(settings.duration / value) * value)
            tasks.append((key, value, without_truth(other), other.measured(seed)[0]))
        else:
            tasks.append((key, value, None, as_placed))
    answers = sweep(_swept, tasks, without_truth(trial))
    return SweepTable(
        key=tuple(key for key, _ in points),
        value=np.array([value for _, value in points]),
        error={name: np.array([real[name] for real, _ in answers]) for name in trial.names},
        std={name: np.array([claimed[name] for _, claimed in answers]) for name in trial.names},
    )


def _points(trial: Trial, sweeps: Sweeps) -> list[tuple[str, float]]:
    points = [("time_step", h) for h in sweeps.time_steps]
    points += [("process_noise", factor) for factor in sweeps.process_noise]
    for name, factors in sweeps.wrong_parameters.items():
        key = f"validate.sweeps.wrong_parameters.{name}"
        if name not in trial.problem.model.parameters:
            known = ", ".join(trial.problem.model.parameters) or "none"
            raise ConfigError(f"unknown parameter '{name}'", key=key, remedy=f"Choose one of the parameters: {known}.")
        if name in trial.problem.unknowns.parameters:
            raise ConfigError(
                f"'{name}' is estimated, so it cannot have a wrong value",
                key=key,
                remedy="Choose a parameter that is not estimated.",
            )
        points += [(name, factor) for factor in factors]
    return points


def _swept(as_placed: Trial, task: SweepTask) -> tuple[dict[str, float], dict[str, float]]:
    """Real and claimed error of every unknown for one task."""
    key, value, other, measured = task
    trial = other or as_placed
    model = filter_model(trial.problem, trial.chosen, trial.h)
    if key == "process_noise":
        model = replace(model, Q=value * model.Q)
    if key in model.fixed:
        model = replace(model, fixed={**model.fixed, key: value * trial.truth.theta[key]})
    try:
        run = trial.filtered(model, trial.chosen, measured).run
    except NumericalError:
        diverged = dict.fromkeys(trial.names, float("nan"))
        return diverged, diverged
    real, claimed = real_and_claimed(trial, model, run.mean, run.std)
    return {n: float(v[0]) for n, v in real.items()}, {n: float(v[0]) for n, v in claimed.items()}


def sweep_table(swept: SweepTable) -> Table:
    """Table of real and claimed errors at every point."""
    words = {"time_step": "time step {:g} s", "process_noise": "process noise × {:g}"}
    rows = tuple(
        (
            words.get(key, f"{key} set to {{:g}} × its true value").format(value),
            *(f"{100 * swept.error[n][i]:.3g} % (σ {100 * swept.std[n][i]:.2g} %)" for n in swept.error),
        )
        for i, (key, value) in enumerate(zip(swept.key, swept.value, strict=True))
    )
    columns = ("change", *(f"error of {name}" for name in swept.error))
    return Table("estimation error after one change of the filter settings", columns, rows)
