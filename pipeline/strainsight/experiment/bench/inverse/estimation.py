"""Estimate loads and parameters of a bench by Kalman filters on the implicit step (thesis 2-4), with hold-out test and
observability check."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from strainsight.config.bench.bench import StrainSensorSection
from strainsight.config.bench.estimate import FromFile
from strainsight.errors import ConfigError, NumericalError
from strainsight.estimation.decision import out_of_range, without_sigma
from strainsight.experiment.bench.bench import Bench
from strainsight.experiment.bench.inverse.filtering import (
    FilteredRuns,
    by_extended,
    by_grid,
    predicted,
    ring_watch,
    rings_estimated,
)
from strainsight.experiment.bench.inverse.problem import BenchProblem, corrects, free_zero, problem_of, zero_of
from strainsight.experiment.bench.inverse.trial import BenchTrial, trial_of
from strainsight.experiment.bench.inverse.truth import Reality, reality_of, sample_reality
from strainsight.experiment.bench.sensors import channel_labels, misread
from strainsight.experiment.bench.simulation import turns_in_a_step
from strainsight.experiment.hold_out import LeftOut, held_out, left_out
from strainsight.experiment.system import Resources
from strainsight.multibody.coupled import coupled_modes, load_error, resolved_frequency
from strainsight.multibody.inverse.linear import indistinct
from strainsight.records.bench import BenchTruths, RingEstimate, Simulated
from strainsight.records.estimated import HoldOut


@dataclass(frozen=True)
class FilteredBench:
    """Hold-out `System` of a bench, all seeds at their first starts.

    y (T, B, m): measurements of all runs; trial_with: filter with some channels (m,); mean (T + 1, size): of the first run, for
    the observability check.

        ŷ = h(x̂),     σ² = H P Hᵀ + R + Σₖ (H Sₖ − Dₖ x̂ − oₖ)²

    x̂, P: filtered from the other channels up to this sample, with the prior of its offset; R: of one sample; S: error of x̂ by
    installation of the others; D x̂ + o: error of the reading by its installation (`considered`)."""

    trial: BenchTrial
    y: np.ndarray
    trial_with: Callable[[np.ndarray], BenchTrial]
    mean: np.ndarray

    @property
    def labels(self) -> tuple[str, ...]:
        return channel_labels(self.trial.problem.used)

    @property
    def available(self) -> np.ndarray:
        return self.trial.available

    @cached_property
    def measured(self) -> Sequence[np.ndarray]:
        return (self.y[:, :: len(self.trial.problem.unknowns.starts)],)

    @property
    def parts(self) -> Sequence[np.ndarray]:
        """Channels of one gauge with all grids, or one component of another sensor."""
        parts: list[np.ndarray] = []
        for name, channels in self.trial.problem.used.channels.items():
            sensor = self.trial.problem.config.sensors[name]
            grids = np.ones(channels.stop - channels.start, dtype=int)
            if isinstance(sensor, StrainSensorSection) and sensor.gauges:
                grids = np.array([len(gauge.angles) if gauge.angles else 1 for gauge in sensor.gauges])
            parts += np.split(np.arange(channels.start, channels.stop), np.cumsum(grids)[:-1])
        return parts

    def by_others(self, part: np.ndarray) -> tuple[Sequence[tuple[np.ndarray, np.ndarray]], str]:
        """Predict from the other channels; empty if they cannot determine the unknowns, or the filter diverges."""
        omitted = ", ".join(self.labels[i] for i in part)
        others = self.available.copy()
        others[part] = False
        if not others.any():
            return (), f"no channel is available to predict {omitted}"
        try:
            trial = self.trial_with(others)
            list(undistinguished(trial, self.mean))
            seeds = slice(None, None, len(trial.problem.unknowns.starts))
            mean, std, lost = predicted(trial.of_runs(seeds), self.measured[0], part)
        except (ConfigError, NumericalError) as error:
            return (), f"the filter without {omitted} failed: {f'{error.key}: ' if error.key else ''}{error.what}"
        if lost.any():
            return (), f"without {omitted}, {lost.sum()} of {len(lost)} filter runs diverge"
        return ((mean, std),), ""


INSTANTS = 5
"""Number of instants of the observability check."""
MISSED = 0.05
"""Largest share of a load that the time step may not resolve."""
TURN = 0.1
"""Largest rotation of a body per step [rad]."""


def undistinguished(trial: BenchTrial, mean: np.ndarray) -> Iterator[str]:
    """Notes on combinations of unknowns that are unobservable along the first run, mean (T + 1, size). Raises ConfigError unless
    the config allows them."""
    model, estimate = replace(trial.model, R=np.where(trial.available, trial.model.R, np.inf)), trial.problem.estimate
    finite = np.flatnonzero(np.isfinite(mean).all(axis=1))
    if not len(finite):
        return
    combinations: list[list[str]] = []
    for k in np.unique(finite[np.linspace(0, len(finite) - 1, INSTANTS).round().astype(int)]):
        try:
            combinations.append(indistinct(model, mean[k], min(k, len(model.known) - 1), trial.problem.names))
        except NumericalError:
            return  # undecidable
        if not combinations[-1]:
            return
    words = "; ".join(combinations[0])
    if not estimate.allow_unobservable:
        raise ConfigError(
            f"the sensors cannot determine {words} at any of {len(combinations)} instants of the run",
            key="estimate.inputs" if estimate.inputs else "estimate.parameters",
            remedy="Add a sensor, remove one of these unknowns from `estimate` if it is known, or set "
            "estimate.allow_unobservable: true.",
        )
    yield f"the sensors cannot determine {words}: these estimates depend on the initial values and their σ"


def unfollowed(trial: BenchTrial, reality: Reality, mean: np.ndarray, std: np.ndarray) -> Iterator[str]:
    """Notes on loads that the time step does not resolve, and bodies that rotate too far per step; mean, std (T + 1, size) of the
    first run. Raises ConfigError unless the config allows them.

    Limits: MISSED for a known load; for an estimated load also its σ, as its spectrum includes errors."""
    config, h = trial.problem.config, trial.model.h
    doubts = [
        f"{name} rotates by {turn:.2g} rad in a time step of {h:g} s; the limit of the linearisation is {TURN:g} rad"
        for name, turn in turns_in_a_step(trial.problem.bench, mean[:, trial.model.v], h).items()
        if turn > TURN
    ]
    if not corrects(config):
        doubts = list(_missed(trial, reality, mean, std))
    if doubts and not trial.problem.estimate.allow_unresolved_steps:
        step_error = "" if corrects(config) or config.driven else "set estimate.method.step_error: estimated, "
        raise ConfigError(
            doubts[0],
            key="estimate.time_step",
            remedy=f"Reduce estimate.time_step, {step_error}or set estimate.allow_unresolved_steps: true.",
        )
    yield from (f"{text}; σ does not include this error" for text in doubts)


def _missed(trial: BenchTrial, reality: Reality, mean: np.ndarray, std: np.ndarray) -> Iterator[str]:
    estimate, model, bench = trial.problem.estimate, trial.model, trial.problem.bench
    if estimate.measured is None and estimate.truth.model not in ("fine", "independent"):
        return
    x = mean[0]
    u = np.array(model.known[0], dtype=float)
    u[model.inputs] = x[model.u]
    frequency = coupled_modes(bench.system, x[model.q], x[model.v], u, bench.theta).held_frequency
    h, method = model.h, bench.config.simulate.method
    if not len(frequency) or not np.isfinite(mean).all():
        return
    true = reality.inputs[:, 0]
    for column, name in enumerate(bench.system.inputs):
        known = bool(np.isfinite(true[:, column]).all())
        at = np.flatnonzero(model.inputs == column)
        load = true[:, column] if known else mean[:, model.u[at[0]]] if len(at) else model.known[:, column]
        share = float(load_error(load[:, None], frequency, h, method)[0])
        if share <= MISSED:
            continue
        size, claimed = float(np.std(load)), float(np.median(std[1:, model.u[at[0]]])) if len(at) else 0.0
        if known or not len(at) or share * size > claimed:
            yield (
                f"the time step of {h:g} s does not resolve {100 * share:.2g} % of the RMS of {name} "
                f"(loads up to {resolved_frequency(frequency, h, method):.3g} Hz are resolved)"
            )


@dataclass(frozen=True)
class BenchEstimation:
    """Result of an estimate.

    measured (T, B, m); reading (T + 1, seeds, all channels): predicted readings at the first start of each seed; rings: bearings
    in the first run of an extended filter; without: hold-out test, None if not configured; notes: sentences."""

    trial: BenchTrial
    reality: Reality
    measured: np.ndarray
    filtered: FilteredRuns
    reading: np.ndarray
    rings: dict[str, RingEstimate]
    without: HoldOut | None
    notes: tuple[str, ...]

    @property
    def problem(self) -> BenchProblem:
        return self.trial.problem

    @property
    def starts(self) -> int:
        """Number of runs of one seed."""
        return len(self.problem.unknowns.starts)

    @cached_property
    def values(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Unknown → estimate and σ in every run (T + 1, B), loads before parameters, NaN after divergence; σ of a parameter is
        √(s P_ξξ sᵀ), s = ∂θ/∂ξ."""
        unknowns, model, mean = self.problem.unknowns, self.trial.model, self.filtered.mean
        values = {}
        for name, at in zip(self.problem.estimate.inputs, model.u, strict=True):
            load = mean[:, :, at]
            values[name] = load, np.where(np.isfinite(load), self.filtered.std[:, :, at], np.nan)
        theta, std = np.full((2, len(unknowns.free), *mean.shape[:2]), np.nan)
        P = self.filtered.joint[:, :, len(unknowns.inputs) :, len(unknowns.inputs) :]
        for k, run in np.ndindex(mean.shape[:2]):
            if np.isfinite(xi := mean[k, run, model.xi]).all():
                of_xi = P[k, min(run, P.shape[1] - 1)]
                theta[:, k, run], std[:, k, run] = unknowns.coordinates.with_std(xi, of_xi)
        return values | dict(zip(unknowns.free, zip(theta, std, strict=True), strict=True))

    @cached_property
    def smoothed(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Load → smoothed estimate and σ in the first run (T + 1,), σ NaN if withheld; empty for the parameter grid filter."""
        loads = self.filtered.smoothed
        each = () if loads is None else zip(loads.mean.T, loads.std.T, strict=True)
        return dict(zip(self.problem.estimate.inputs, each, strict=False))

    @cached_property
    def truths(self) -> dict[str, np.ndarray]:
        """Unknown → true value in every run (T + 1, B), if known; truths are common or per seed."""
        unknowns, runs, inputs = self.problem.unknowns, self.measured.shape[1], self.reality.inputs
        true = {name: inputs[:, :, at] for name, at in zip(self.problem.estimate.inputs, unknowns.inputs, strict=True)}
        for name, at in zip(unknowns.free, unknowns.coordinates.free, strict=True):
            true[name] = np.tile(self.reality.theta[:, at], (len(inputs), 1))
        known = {name: values for name, values in true.items() if np.isfinite(values).all()}
        return {name: np.repeat(values, runs // values.shape[1], axis=1) for name, values in known.items()}

    @cached_property
    def errors(self) -> dict[str, np.ndarray]:
        """Unknown → error in every run (T + 1, B), if the truth is known."""
        return {name: self.values[name][0] - true for name, true in self.truths.items()}

    @cached_property
    def outside_range(self) -> dict[str, str]:
        """Modulus → sentence for estimates outside its `reach`, from the first such run. Bearing laws have no range."""
        unknowns, reduced = self.problem.unknowns, self.problem.bench.reduced.values()
        ranges = {name: ends for body in reduced for name, ends in body.reach.items()}
        outside: dict[str, str] = {}
        for name in unknowns.free:
            inner = unknowns.parameters[name]
            for value in self.values[name][0][-1] if inner in ranges else ():
                if np.isfinite(value) and name not in outside:
                    low, high = map(float, ranges[inner])
                    outside |= out_of_range({name: float(value)}, {name: (low, high)}, {name: "Pa"}, "reduce")
        return outside

    @property
    def without_sigma(self) -> BenchEstimation:
        """The same with NaN for every σ; the hold-out test keeps its σ, unless parameters are outside their ranges."""
        filtered, rings = without_sigma(self.filtered), without_sigma(self.rings)
        filtered = replace(filtered, joint=np.full_like(filtered.joint, np.nan), compared=None)
        without = without_sigma(self.without) if self.outside_range else self.without
        return replace(self, filtered=filtered, without=without, rings=rings)

    @property
    def held_out(self) -> tuple[LeftOut, ...]:
        """Hold-out results of every channel over all seeds, empty if not configured."""
        return left_out(self.without, channel_labels(self.problem.used), self.measured[:, :: self.starts])


def estimate_bench(
    bench: Bench, other: Simulated | None, truths: BenchTruths | None, using: Resources
) -> BenchEstimation:
    """Simulate or read the measurements and run the filter; other: bench of `estimate.measured`; truths: from another integrator,
    None otherwise."""
    problem = problem_of(bench, using.files)
    estimate, among = problem.estimate, problem.among
    reality = reality_of(problem, other, truths, using)
    largest, first, available = np.zeros(len(among)), None, _configured_channels(problem)
    if reality is not None:
        read, first = reality.readings[:, :, among], reality.first
        largest = np.nan_to_num(np.abs(read)).max(axis=(0, 1))
        available &= np.isfinite(read).any(axis=(0, 1))

    def trial_with(channels: np.ndarray) -> BenchTrial:
        return trial_of(problem, largest, first, channels)

    trial = trial_with(available)
    if reality is None:
        reality = sample_reality(trial)
    y = _samples(trial, reality)
    until = 1.0 if estimate.hold_out is None else 1 / (1 + available.sum())

    def filtering(share: float) -> None:
        using.progress("filter", 0.3 + 0.7 * until * share)

    def leaving(what: str, share: float) -> None:
        using.progress(what, 0.3 + 0.7 * (until + (1 - until) * share))

    watch = ring_watch(bench, trial.model, problem.steps)
    on_grid = estimate.method.parameters == "grid" and problem.unknowns.free
    filtered = by_grid(trial, y, filtering) if on_grid else by_extended(trial, y, filtering, watch)
    mean = filtered.mean[:, 0]
    doubts = (*undistinguished(trial, mean), *unfollowed(trial, reality, mean, filtered.std[:, 0]))
    without = None
    if estimate.hold_out is not None:
        (without,) = held_out(FilteredBench(trial, y, trial_with, mean), leaving)
    reading = _expected(trial, filtered.mean)
    rings = rings_estimated(bench, watch)
    return BenchEstimation(
        trial, reality, y, filtered, reading, rings, without, (*doubts, *trial.notes, *filtered.notes)
    )


NOISE = 1
"""Last word of the seed for noise, not zero because trailing zeros have no effect."""


def _samples(trial: BenchTrial, reality: Reality) -> np.ndarray:
    """Measurements (T, B, m) with noise sampled per seed, the same for all starts; NaN for channels not available."""
    problem, estimate, seed = trial.problem, trial.problem.estimate, trial.problem.config.seed
    read, runs = reality.readings[:, :, problem.among], estimate.runs
    shape = (problem.steps, runs, len(trial.noise))
    y = np.broadcast_to(read, shape).copy()
    if estimate.truth.noise and not isinstance(estimate.measured, FromFile):
        draws = [np.random.default_rng((seed, run, NOISE)).standard_normal(shape[::2]) for run in range(runs)]
        y += trial.noise * np.stack(draws, axis=1)
        if estimate.measured is None:
            y += trial.offsets.sample(*shape, seed)
            if problem.errors and reality.q is not None:
                y += misread(problem.bench, problem.used, problem.errors, reality.q, runs)
    y[:, :, ~trial.available] = np.nan
    return np.repeat(y, len(problem.unknowns.starts), axis=1)


def _configured_channels(problem: BenchProblem) -> np.ndarray:
    """Channels (m,) that the filter uses; for sensors with a layout only the components in it."""
    channels = np.ones(len(problem.used.zeroed), dtype=bool)
    for name, entry in problem.estimate.sensors.items():
        if entry.layout is not None:
            assert problem.bench.placed is not None
            placed, part = problem.bench.placed.layout(entry.layout).sensor, problem.used.channels[name]
            channels[part] = False
            channels[part.start : part.start + 3] = [f"{name}.{axis}" in placed for axis in "xyz"]
    return channels


def _expected(trial: BenchTrial, mean: np.ndarray) -> np.ndarray:
    """Predicted readings (T + 1, seeds, channels) of all sensors at the first start of every seed, with zeroing and offsets; NaN
    after divergence."""
    problem, model, sensors = trial.problem, trial.model, trial.problem.sensors
    zero = free_zero(problem, sensors)
    constant = zero_of(problem, sensors, problem.unknowns.starts[0]) if zero is None else 0.0
    first = mean[:, :: len(problem.unknowns.starts)]
    reading = np.full((*first.shape[:2], len(sensors.zeroed)), np.nan)
    for at in np.ndindex(first.shape[:2]):
        if np.isfinite(x := first[at]).all():
            zero_reading = constant if zero is None else zero(x[model.xi])[0]
            reading[at] = model.read(sensors.readings, x, at[0])[0] - zero_reading
            reading[at][problem.among[trial.offsets.at]] += x[model.size :]
    return reading
