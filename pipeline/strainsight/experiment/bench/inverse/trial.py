"""Set-up of a bench filter: model, initial state, and noise of its channels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from strainsight.config.bench.bench import AccelerationSensor, MotionSensor
from strainsight.config.bench.estimate import BenchEstimateSection
from strainsight.errors import ConfigError, NumericalError, UserError, blame
from strainsight.estimation.reduced import Biased, StepModel, bordered
from strainsight.experiment.bench.bench import start_of
from strainsight.experiment.bench.inverse.problem import (
    BenchProblem,
    corrects,
    free_zero,
    loads_at_rest,
    moved_at_rest,
    zero_of,
)
from strainsight.experiment.bench.sensors import Sensors, rows_of
from strainsight.multibody.inverse.model import AugmentedStep
from strainsight.multibody.inverse.parameters import start_covariance, white_force

OFFSET_STREAM = 4
"""Last word of the seed for sampled offsets."""


@dataclass(frozen=True)
class ChannelOffsets:
    """Estimated channel offsets: at (k,): channels; std (k,): σ at the start, walk (k,): σ of the change per step [unit of
    each]."""

    at: np.ndarray
    std: np.ndarray
    walk: np.ndarray

    def model(self, base: AugmentedStep) -> StepModel:
        """Model of [x, b] with offsets b."""
        return Biased(base, self.at, self.walk**2) if len(self.at) else base

    def behind(self, x: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Append zero offsets to x (…, size) and their covariance to P (…, size, size)."""
        whole = np.concatenate([x, np.zeros((*x.shape[:-1], len(self.at)))], axis=-1)
        return whole, bordered(P, np.diag(self.std**2)) if len(self.at) else P

    def projected(self, base: AugmentedStep) -> Callable[[np.ndarray, int], np.ndarray]:
        """Projection of the state onto the constraints, with unchanged offsets."""

        def project(x: np.ndarray, k: int) -> np.ndarray:
            return np.concatenate([base.projected(x[:, : base.size], k), x[:, base.size :]], axis=1)

        return project

    def sample(self, steps: int, runs: int, channels: int, seed: int) -> np.ndarray:
        """Sample the offsets (steps, runs, channels), independently for every run."""
        offsets = np.zeros((steps, runs, channels))
        for run in range(runs if len(self.at) else 0):
            draw = np.random.default_rng((seed, run, OFFSET_STREAM))
            first = self.std * draw.standard_normal(len(self.at))
            offsets[:, run, self.at] = first + np.cumsum(
                self.walk * draw.standard_normal((steps, len(self.at))), axis=0
            )
        return offsets


def offsets_of(problem: BenchProblem) -> ChannelOffsets:
    """Channel offsets of `estimate.sensors`."""
    std, rate = np.zeros((2, len(problem.used.zeroed)))
    for name, part in problem.used.channels.items():
        entry = problem.estimate.sensors[name]
        std[part], rate[part] = np.asarray(entry.bias, dtype=float), np.asarray(entry.drift, dtype=float)
    at = np.flatnonzero((std > 0) | (rate > 0))
    return ChannelOffsets(at, std[at], rate[at] * np.sqrt(problem.h))


FLOOR = 1e-8
"""Smallest noise relative to the largest reading of a sensor, ten times the rounding error of a step."""
SPAN = 1e-7
"""Smallest noise relative to the effect of one σ of an unknown, to limit the condition number."""
NOTHING = 1e-12
"""Smallest noise of a channel [its unit]."""
FAR = 100.0
"""Largest factor by which the configured noise may be raised; above, the unit is probably wrong."""
FELT = 1e-3
"""Smallest effect of one σ of an unknown on a reading, relative to the noise, for observability."""
STILL = 1e-9
"""Rate relative to the largest below which a drive is at rest."""


@dataclass(frozen=True)
class BenchTrial:
    """Filter of a bench, ready to run.

    available (m,): channels that are measured; start (B, size), covariance (B, size, size): of every run, seeds outer and starts
    inner, offsets appended to the states of the model; guess (width,): loads at the start; noise (m,): σ of the readings;
    installed: D, o of `rows_of`; notes: sentences."""

    problem: BenchProblem
    available: np.ndarray
    model: AugmentedStep
    start: np.ndarray
    covariance: np.ndarray
    guess: np.ndarray
    noise: np.ndarray
    offsets: ChannelOffsets
    installed: tuple[np.ndarray, np.ndarray]
    notes: tuple[str, ...]

    def begin(self, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Initial x and covariance for known parameters ξ (B, p), NaN if no equilibrium is found."""
        model = self.model
        x, P = np.full((len(xi), model.size), np.nan), np.zeros((len(xi), model.size, model.size))
        for i, values in enumerate(xi):
            try:
                theta = model.coordinates.theta(values)[0]
                x[i], P[i] = _start(self.problem, model, self.guess, theta, np.zeros(len(values)))
            except (NumericalError, UserError):
                continue
            x[i, model.xi] = values
        return self.offsets.behind(x, P)

    def of_runs(self, runs: slice) -> BenchTrial:
        """Select runs."""
        model = replace(self.model, offset=self.model.offset[runs])
        return replace(self, model=model, start=self.start[runs], covariance=self.covariance[runs])


def trial_of(problem: BenchProblem, largest: np.ndarray, first: np.ndarray | None, available: np.ndarray) -> BenchTrial:
    """Set up the filter of `estimate`.

    largest (m,): largest reading of every channel without noise; first (m,): first readings, for open guesses of loads at rest;
    available (m,): channels that are measured. Every start is that of the simulation with the filter's parameters and loads; at
    an equilibrium the covariance includes their uncertainty."""
    config, estimate, bench, unknowns = problem.config, problem.estimate, problem.bench, problem.unknowns
    used, errors, guess, runs = problem.used, problem.errors, problem.known[0].copy(), problem.estimate.runs
    rates = np.abs(problem.known[:, bench.system.drives.rates])
    # drives at rest at the start
    still = bool(np.all(rates[0] <= STILL * rates.max(axis=0, initial=0.0)))
    model = AugmentedStep(
        bench.system, used.readings, np.zeros(len(largest)), config.simulate.method,
        problem.known, unknowns.inputs, unknowns.loads, unknowns.coordinates,
        white_force(bench.system, estimate.disturbance),
        unknowns.coordinates.covariance(unknowns.starts[0], unknowns.increment), np.zeros(len(largest)),
        rest=config.simulate.start == "equilibrium" and still,
        corrected=corrects(config), printed=estimate.method.noise == "as_printed",
        second=problem.drives(problem.time)[:, 2].T,
    )  # fmt: skip
    raised_by = guess.copy()
    raised_by[unknowns.inputs] += unknowns.std_u
    moved, unsolved = moved_at_rest(problem, (guess, problem.heaviest, raised_by))
    noise, raised = _noise(estimate, used, largest, moved.max(axis=1, initial=0.0))
    notes = (*raised, *_felt(problem, available, moved / noise[:, None], unsolved))
    at_zero = np.zeros(bench.system.size)
    if errors:
        with blame("estimate"):
            at_zero = start_of(bench.at(unknowns.starts[0]), problem.zeroing)[0]
    offsets, installed = offsets_of(problem), rows_of(bench, used, errors, at_zero)
    if first is not None and config.simulate.start == "equilibrium":
        first = np.where(available, first, np.nan)
        first[offsets.at] = np.nan  # an offset would be taken for a load
        guess = loads_at_rest(problem, guess, first, noise)
    begins = [_start(problem, model, guess, theta, unknowns.std) for theta in unknowns.starts]
    states, covariances = zip(*begins, strict=True)
    zeros = [zero_of(problem, used, theta) for theta in unknowns.starts]
    zero = free_zero(problem, used)
    if zero is not None:
        model, zeros = replace(model, zero=zero), [np.zeros(len(largest))] * len(states)
    model = replace(model, offset=np.tile(zeros, (runs, 1)), R=noise**2)
    start, covariance = offsets.behind(np.tile(states, (runs, 1)), np.tile(covariances, (runs, 1, 1)))
    return BenchTrial(problem, available, model, start, covariance, guess, noise, offsets, installed, notes)


def _start(
    problem: BenchProblem, model: AugmentedStep, guess: np.ndarray, theta: np.ndarray, std: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Initial x (size,) and covariance for parameters θ (nθ,) with std (p,)."""
    unknowns = problem.unknowns
    with blame("estimate"):
        q, v = start_of(problem.bench.at(theta), guess)
        x, spread = model.pack(q, v, guess[unknowns.inputs], theta), unknowns.coordinates.covariance(theta, std)
        if problem.config.simulate.start == "equilibrium":
            known = unknowns.coordinates, unknowns.inputs, unknowns.std_u
            return x, model.spread(start_covariance(model.system, q, guess, theta, *known, spread))
    return x, model.spread(block_diag(np.zeros((model.v.stop,) * 2), np.diag(unknowns.std_u**2), spread))


def _noise(
    estimate: BenchEstimateSection, used: Sensors, largest: np.ndarray, moved: np.ndarray
) -> tuple[np.ndarray, tuple[str, ...]]:
    """σ of every channel (m,), and notes on raised ones; moved (m,): effect of one σ of an unknown."""
    noise, notes = np.empty(len(largest)), []
    least = np.maximum(np.maximum(FLOOR * largest, SPAN * moved), NOTHING)
    for name, part in used.channels.items():
        configured = np.broadcast_to(np.asarray(estimate.sensors[name].noise, dtype=float), part.stop - part.start)
        noise[part] = np.maximum(configured, least[part])
        if not (raised := configured < least[part]).any():
            continue
        low, high = float(configured[raised].min()), float(least[part][raised].max())
        if low > 0 and high > FAR * low:
            key, by_unknown, read = (
                f"estimate.sensors.{name}.noise",
                float(moved[part].max()),
                float(largest[part].max()),
            )
            raise _too_quiet(key, low, by_unknown, read)
        notes.append(
            f"the noise of {name} was increased from {low:.3g} to {high:.3g}, the rounding error of its predicted readings"
        )
    return noise, tuple(notes)


def _too_quiet(key: str, noise: float, moved: float, largest: float) -> ConfigError:
    """Error for a noise far below the rounding error of the readings or of the effect of unknowns."""
    what, remedy = (
        f"the noise of {noise:g} and all predicted readings are nearly zero; the smallest accepted noise is {NOTHING:g}",
        "Increase the loads and the noise of the sensor, or check their units.",
    )
    if max(SPAN * moved, FLOOR * largest) >= NOTHING:
        by_unknown = SPAN * moved >= FLOOR * largest
        what, reach = (
            ("largest change of a predicted reading if an unknown changes by its initial σ", moved)
            if by_unknown
            else ("largest predicted reading", largest)
        )
        ratio = f"{what}: {reach:.3g}, {reach / noise:.1e} times the noise"
        what = f"the noise of {noise:g} is smaller than the rounding errors of the predicted readings; {ratio}"
        reduced = (
            "`guess`, `std` and `increment` in estimate.inputs and estimate.parameters" if by_unknown else "the loads"
        )
        remedy = f"Reduce {reduced}, or check their units."
    return ConfigError(what, key=key, remedy=remedy)


def _felt(
    problem: BenchProblem, available: np.ndarray, moved: np.ndarray, unsolved: NumericalError | None
) -> tuple[str, ...]:
    """Refuse an unknown without effect on any sensor at rest, and return notes on sensors without any effect.
    moved (m, nu + p): effect in σ of the noise; available (m,): measured channels; unsolved: error raised instead, if no
    equilibrium was found under some loads. Not applicable without an initial equilibrium, with sensors of velocity or
    acceleration, or if drives or gravity change the pose; then `undistinguished` checks along the run."""
    config, estimate, unknowns, channels = problem.config, problem.estimate, problem.unknowns, problem.used.channels
    sensors = [config.sensors[name] for name, part in channels.items() if available[part].any()]
    moving = any(
        isinstance(sensor, AccelerationSensor) or (isinstance(sensor, MotionSensor) and sensor.quantity == "velocity")
        for sensor in sensors
    )
    turning = any(force.type == "gravity" and force.turns is not None for force in config.forces.values())
    if config.simulate.start != "equilibrium" or moving or config.driven or turning:
        return ()
    moved = np.where(available[:, None], moved, 0.0)
    names = [f"inputs.{name}" for name in estimate.inputs] + [f"parameters.{name}" for name in unknowns.free]
    for name, column, std in zip(names, moved.T, [*unknowns.std_u, *unknowns.std], strict=True):
        if column.max() < FELT and not estimate.allow_unobservable:
            if unsolved is not None:
                raise unsolved
            raise ConfigError(
                f"no sensor measures this unknown: a change by its initial σ ({std:.3g}) changes every reading by less than "
                f"{FELT:g} σ of the noise",
                key=f"estimate.{name}",
                remedy="Add a sensor on a body that the unknown deforms or moves, remove the unknown from `estimate` if it is "
                "known, or set estimate.allow_unobservable: true.",
            )
    return tuple(
        f"the sensor {name} measures no unknown: a change of any unknown by its initial σ changes the reading by less than "
        f"{FELT:g} σ of the noise"
        for name, part in channels.items()
        if moved[part].max(initial=0.0) < FELT and available[part].any()
    )
