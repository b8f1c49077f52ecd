"""The filter run many times at once: noise levels, seeds and starting values, random sets beside the chosen one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from strainsight.cases.structure.problem import filter_model, filter_options, sample_std
from strainsight.cases.structure.trial import Trial, real_and_claimed, without_truth
from strainsight.config.validation import Validate
from strainsight.estimation.consistency import not_identified
from strainsight.estimation.filter import all_lost, run_filter
from strainsight.estimation.model import physical
from strainsight.estimation.reduced import Driven
from strainsight.sweep.sweep import Sweep, serial
from strainsight.workflow.output import Dataset


@dataclass(frozen=True)
class Runs:
    """Filter runs: channels (B, k), −1 for none; noise_factor (B,), start (B, unknowns) of [ũ, p], seed (B,) of the noise."""

    channels: np.ndarray
    noise_factor: np.ndarray
    start: np.ndarray
    seed: np.ndarray


@dataclass(frozen=True)
class Study:
    """What some runs found, by name: real and claimed error (B,), estimate and its σ (T + 1, B) [SI]."""

    runs: Runs
    real: Mapping[str, np.ndarray]
    claimed: Mapping[str, np.ndarray]
    estimate: Mapping[str, np.ndarray]
    std: Mapping[str, np.ndarray]


CHOICES = 1 << 31
"""Stream of the random numbers that choose starts and sets, apart from those of the noise."""


def studies_of(
    trial: Trial, settings: Validate, kept: np.ndarray, seed: int, sweep: Sweep = serial
) -> dict[str, Study]:
    """All studies of a validation, filtered in batches of at most BATCH runs.

        noise      other noise levels
        repeats    other noise and other starting values
        starts     other starting values on one measurement, which must agree in the end
        screened   random sets of the screened pool `kept`, on the layout's own noise
        all        random sets of all candidates

    settings: the config's validate section.
    """
    rng = np.random.default_rng([seed, CHOICES])
    spread = np.array([float(settings.initial_std[name]) for name in trial.names])
    repeats, count = settings.repeats, settings.random_sets
    factors = np.array(settings.noise_factors, dtype=float)
    starts = spread * rng.standard_normal((repeats, len(spread)))
    home = np.zeros_like(spread)
    own = np.zeros(max(len(factors), repeats, count), dtype=int)
    parts = {
        "noise": _runs(trial.chosen, factors, home, own[: len(factors)]),
        "repeats": _runs(trial.chosen, 1.0, starts, np.arange(1, repeats + 1)),
        "starts": _runs(trial.chosen, 1.0, starts, own[:repeats]),
    }
    every = trial.problem.channels
    size = len(np.unique(every.gauge[trial.chosen]))
    for key, pool in (("screened", kept), ("all", np.arange(every.gauges))):
        sets = [rng.choice(pool, size, replace=False) for _ in range(count)]
        channels = every.of(np.array(sets, dtype=int).reshape(count, size))
        parts[key] = _runs(channels.reshape(count, size * channels.shape[-1]), 1.0, home, own[:count])
    return _filtered(trial, parts, seed, sweep)


def identified(trial: Trial, starts: Study) -> dict[str, bool]:
    """For every unknown, whether runs that differ only by their start end within 3 σ of each other.

    A parameter by its mean over the last half; an input by the RMS over the last half of (largest − smallest), beside its σ.
    Empty for fewer than two runs.
    """
    if len(starts.runs.seed) < 2:
        return {}
    late = slice(len(trial.time) // 2, None)
    found = {}
    for name in trial.names:
        value, std = starts.estimate[name][late], starts.std[name][late]
        if name in trial.problem.unknowns.parameters:
            found[name] = not bool(not_identified(value.mean(axis=0), std.mean(axis=0)))
        else:
            spread = np.sqrt(np.mean(np.ptp(value, axis=1) ** 2))
            found[name] = bool(spread <= 3 * np.sqrt(np.mean(std**2)))
    return found


def ranks(
    trial: Trial, random: Study, real: Mapping[str, np.ndarray], claimed: Mapping[str, np.ndarray]
) -> dict[str, float | int]:
    """The layout among the random sets of all candidates: its rank by real and by claimed error (1 is best), and Spearman's
    correlation of the two over all of them (thesis 6.3, as statistics)."""
    found: dict[str, float | int] = {}
    for name in trial.names:
        r, c = (
            np.append(values[name], own[name][0]) for values, own in ((random.real, real), (random.claimed, claimed))
        )
        known = np.isfinite(r) & np.isfinite(c)
        if known.sum() < FEWEST_SETS or not known[-1]:
            continue
        r, c = r[known], c[known]
        found[f"rank_real.{name}"] = int(1 + np.sum(r[:-1] < r[-1]))
        found[f"rank_claimed.{name}"] = int(1 + np.sum(c[:-1] < c[-1]))
        order = np.argsort(np.argsort([r, c], axis=1), axis=1).astype(float)
        found[f"rank_correlation.{name}"] = float(np.corrcoef(order)[0, 1])
    return found


FEWEST_SETS = 10
"""Sets below which a rank says nothing."""


def sample_noise(seed: int, realisation: int, samples: int, gauges: int) -> np.ndarray:
    """Unit white noise (samples, gauges); realisation 0 is that of the layout's own measurement."""
    return np.random.default_rng([seed, realisation]).standard_normal((samples, gauges))


def study_datasets(studies: Mapping[str, Study], trial: Trial) -> dict[str, Dataset]:
    """Every study's errors by name; random sets with their gauges and histories."""
    record = {"/noise/factor": Dataset(studies["noise"].runs.noise_factor, "1", "noise over the configured noise")}
    for key, what in LABELS.items():
        study = studies[key]
        random = key in ("screened", "all")
        group = f"/random_sets/{key}" if random else f"/{key}"
        for i, name in enumerate(trial.names):
            record[f"{group}/error/{name}"] = Dataset(study.real[name], "1", f"real error of {name} for every {what}")
            record[f"{group}/std/{name}"] = Dataset(
                study.claimed[name], "1", f"claimed error of {name} for every {what}"
            )
            if random:
                record[f"{group}/estimate/{name}"] = Dataset(
                    study.estimate[name],
                    trial.units[name],
                    f"estimate of {name} by every {what} (time × set)",
                    ("/time", ""),
                )
            elif key != "noise":
                record[f"{group}/start/{name}"] = Dataset(
                    study.runs.start[:, i],
                    "1",
                    f"start of {name} for every {what}, relative to its scale (parameters: logarithm)",
                )
        if random:
            record[f"{group}/candidate"] = Dataset(
                study.runs.channels, "1", f"rows of train.h5 of every {what}, −1 for none (set × channel)"
            )
    return record


LABELS = {
    "noise": "noise level",
    "repeats": "seed and start",
    "starts": "start on one measurement",
    "screened": "random set of the screened pool",
    "all": "random set of all candidates",
}


def _runs(channels: np.ndarray, noise_factor: float | np.ndarray, start: np.ndarray, seed: np.ndarray) -> Runs:
    """Runs with whatever is common repeated for each; seed (B,) sets their number."""
    B = len(seed)
    return Runs(
        np.broadcast_to(channels, (B, channels.shape[-1])),
        np.broadcast_to(np.asarray(noise_factor, dtype=float), (B,)),
        np.broadcast_to(start, (B, start.shape[-1])),
        seed,
    )


BATCH = 64
"""Runs that are filtered at once: a run more in a batch costs a fourteenth of what a batch costs by itself, so that many
share that cost well. Never the number of processes: a batch's size may change the last bit of its results."""


@dataclass(frozen=True)
class _Batch:
    """Runs and what their channels read without noise, true (T, B, k); seed of the config."""

    runs: Runs
    true: np.ndarray
    seed: int


def _filtered(trial: Trial, parts: Mapping[str, Runs], seed: int, sweep: Sweep) -> dict[str, Study]:
    width = max(part.channels.shape[1] for part in parts.values())
    channels = np.concatenate([_widened(part.channels, width) for part in parts.values()])
    factor, start, stream = (
        np.concatenate([getattr(part, name) for part in parts.values()]) for name in ("noise_factor", "start", "seed")
    )
    batches = []
    for own in np.array_split(np.arange(len(stream)), -(-len(stream) // BATCH)):
        runs = Runs(channels[own], factor[own], start[own], stream[own])
        batches.append(_Batch(runs, trial.reading(runs.channels)[1:], seed))
    found = sweep(_batch, batches, without_truth(trial))
    lost = np.concatenate([answer[-1] for answer in found])
    if np.all(lost >= 0):
        raise all_lost(Driven(filter_model(trial.problem, channels[:1], trial.h), trial.known), lost)
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
    options = filter_options(trial.problem)
    found = run_filter(model, mean, trial.covariance, trial.known, measured, refuse=False, **options)
    real, claimed = real_and_claimed(trial, model, found.mean, found.std)
    values = physical(model, found.mean, found.std)
    estimate, std = ({name: values[name][i] for name in trial.names} for i in (0, 1))
    return real, claimed, estimate, std, found.lost


def _widened(channels: np.ndarray, width: int) -> np.ndarray:
    """Channels (B, k) with columns of none added up to a width."""
    return np.pad(channels, ((0, 0), (0, width - channels.shape[1])), constant_values=-1)
