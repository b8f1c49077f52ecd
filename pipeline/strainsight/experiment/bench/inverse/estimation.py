"""Loads and parameters of a bench from its sensors, by Kalman filters on the implicit step (thesis 2-4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.config.bench.estimate import FromFile
from strainsight.experiment.bench.bench import Bench
from strainsight.experiment.bench.inverse.balls import ring_watch, rings_estimated
from strainsight.experiment.bench.inverse.filtering import Filtered, by_bank, by_extended
from strainsight.experiment.bench.inverse.hold_out import FilteredBench, undistinguished, unfollowed
from strainsight.experiment.bench.inverse.installed import misread
from strainsight.experiment.bench.inverse.problem import Problem, free_zero, problem_of, zero_of
from strainsight.experiment.bench.inverse.trial import Trial, trial_of
from strainsight.experiment.bench.inverse.truth import Reality, measurements, reality_of, walked
from strainsight.experiment.bench.inverse.unknowns import has_bank
from strainsight.experiment.bench.sensors import channel_labels
from strainsight.experiment.hold_out import Left, held_out, left_out
from strainsight.experiment.resources import Resources
from strainsight.records.bench import BenchTruths, Simulated
from strainsight.records.bench_estimated import RingEstimate
from strainsight.records.estimated import HoldOut


@dataclass(frozen=True)
class Estimated:
    """What a filter made of a reality.

    measured (T, B, m); filtered; reading (T + 1, seeds, all channels) of every sensor at the
    estimate of a seed's first start; rings: what every bearing does, by the first run of an extended filter; without: every
    channel by the others, where that was asked for; notes: doubts. Sentences.
    """

    trial: Trial
    reality: Reality
    measured: np.ndarray
    filtered: Filtered
    reading: np.ndarray
    rings: dict[str, RingEstimate]
    without: HoldOut | None
    notes: tuple[str, ...]

    @property
    def problem(self) -> Problem:
        return self.trial.problem

    @property
    def starts(self) -> int:
        """Runs of one seed."""
        return len(self.problem.unknowns.starts)

    @property
    def xi_covariance(self) -> np.ndarray:
        """Of the parameters (T + 1, b, p, p)."""
        loads = len(self.problem.unknowns.inputs)
        return self.filtered.joint[:, :, loads:, loads:]

    def true_load(self, name: str) -> np.ndarray:
        """Of every run (T + 1, B), NaN where it is not known: truths are one for all or one a seed, starts run within a seed."""
        inputs, runs = self.reality.inputs, self.measured.shape[1]
        true = inputs[:, :, self.problem.bench.system.inputs.index(name)]
        return np.repeat(true, runs // true.shape[1], axis=1)

    def place(self, name: str) -> int:
        """Of a parameter that is estimated, among those of the system."""
        return self.problem.bench.system.parameters.index(self.problem.unknowns.parameters[name])

    def true_parameter(self, name: str) -> np.ndarray:
        """Of every run (B,), NaN where it is not known."""
        true = self.reality.theta[:, self.place(name)]
        return np.repeat(true, self.measured.shape[1] // len(true))

    @property
    def held_out(self) -> tuple[Left, ...]:
        """What the others say of every channel, over all seeds; none where that was not asked for."""
        if self.without is None:
            return ()
        held, labels = self.without, channel_labels(self.problem.used)
        return left_out(held.predicted, held.std, held.left_in, labels, self.measured[:, :: self.starts])


def estimated(bench: Bench, other: Simulated | None, truths: BenchTruths | None, using: Resources) -> Estimated:
    """Simulate or take the measurements, run the filter on them; other: the bench of `estimate.measured`; truths: by another
    integrator, where these stand for reality."""
    problem = problem_of(bench, using.files)
    estimate, among = problem.estimate, problem.among
    reality = reality_of(problem, other, truths, using.files, lambda share: using.progress("truth", 0.3 * share))
    largest, first, given = np.zeros(len(among)), None, _given(problem)
    if reality is not None:
        read, first = reality.readings[:, :, among], reality.first
        largest = np.nan_to_num(np.abs(read)).max(axis=(0, 1))
        given &= np.isfinite(read).any(axis=(0, 1))

    def trial_with(channels: np.ndarray) -> Trial:
        return trial_of(problem, largest, first, channels)

    trial = trial_with(given)
    if reality is None:
        reality = walked(trial)
    y = _samples(trial, reality)
    until = 1.0 if estimate.hold_out is None else 1 / (1 + given.sum())

    def filtering(share: float) -> None:
        using.progress("filter", 0.3 + 0.7 * until * share)

    def leaving(what: str, share: float) -> None:
        using.progress(what, 0.3 + 0.7 * (until + (1 - until) * share))

    watch = ring_watch(bench, trial.model, problem.steps)
    bank = has_bank(problem.config)
    filtered = by_bank(trial, y, filtering) if bank else by_extended(trial, y, filtering, watch)
    mean = filtered.mean[:, 0]
    doubts = (*undistinguished(trial, mean), *unfollowed(trial, reality, mean, filtered.std[:, 0]))
    without = None
    if estimate.hold_out is not None:
        (without,) = held_out(FilteredBench(trial, y, trial_with, mean), leaving)
    reading = _expected(trial, filtered.mean)
    rings = rings_estimated(bench, watch)
    return Estimated(trial, reality, y, filtered, reading, rings, without, (*doubts, *trial.notes, *filtered.notes))


def _samples(trial: Trial, reality: Reality) -> np.ndarray:
    """What the filter is given (T, B, m), NaN of channels that it has not."""
    problem, estimate = trial.problem, trial.problem.estimate
    runs, starts, seed = estimate.runs, len(problem.unknowns.starts), problem.config.seed
    noisy = estimate.truth.noise and not isinstance(estimate.measured, FromFile)
    y = measurements(reality.readings[:, :, problem.among], trial.noise, runs, starts, seed, noisy)
    if noisy and estimate.measured is None:
        too_much = trial.offsets.drawn(problem.steps, runs, y.shape[2], seed)
        if problem.errors and reality.q is not None:
            too_much = too_much + misread(problem.bench, problem.used, problem.errors, reality.q, runs)
        y += np.repeat(too_much, starts, axis=1)
    y[:, :, ~trial.given] = np.nan
    return y


def _given(problem: Problem) -> np.ndarray:
    """Which channels (m,) of its sensors the filter has: of those that take a layout the components that are in it."""
    given = np.ones(len(problem.used.zeroed), dtype=bool)
    for name, entry in problem.estimate.sensors.items():
        if entry.layout is not None:
            assert problem.bench.placed is not None
            placed, part = problem.bench.placed.layout(entry.layout).sensor, problem.used.channels[name]
            given[part] = False
            given[part.start : part.start + 3] = [f"{name}.{axis}" in placed for axis in "xyz"]
    return given


def _expected(trial: Trial, mean: np.ndarray) -> np.ndarray:
    """What all sensors read by the estimate of the first start of every seed (T + 1, seeds, channels), zeroed ones less their
    zero by the parameters of that instant, those of the filter with their offsets; NaN where the run diverges."""
    problem, model, sensors = trial.problem, trial.model, trial.problem.sensors
    zero = free_zero(problem, sensors)
    constant = zero_of(problem, sensors, problem.unknowns.starts[0]) if zero is None else 0.0
    first = mean[:, :: len(problem.unknowns.starts)]
    reading = np.full((*first.shape[:2], len(sensors.zeroed)), np.nan)
    for at in np.ndindex(first.shape[:2]):
        if np.isfinite(x := first[at]).all():
            taken_off = constant if zero is None else zero(x[model.xi])[0]
            reading[at] = model.read(sensors.readings, x, at[0])[0] - taken_off
            reading[at][problem.among[trial.offsets.at]] += x[model.size :]
    return reading
