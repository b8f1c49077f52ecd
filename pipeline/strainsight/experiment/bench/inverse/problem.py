"""Estimation problem of a bench: unknowns, sensors, loads, and checks at rest before the filter runs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.connections import Load
from strainsight.config.bench.estimate import BenchEstimateSection
from strainsight.config.loads import SineSection
from strainsight.errors import NumericalError, UserError, blame
from strainsight.experiment.bench.bench import Bench, start_of
from strainsight.experiment.bench.loads import drives_of, loads_of, refuse_spun
from strainsight.experiment.bench.sensors import Sensors, Toleranced, sensors_of, some_of, toleranced
from strainsight.loads.input_models import WALK, input_model
from strainsight.multibody.accelerations import at_rest
from strainsight.multibody.bearing.geometry import PARAMETERS
from strainsight.multibody.inverse.loads import LoadProcess, load_process
from strainsight.multibody.inverse.parameters import (
    ParameterCoordinates,
    Zero,
    parameter_coordinates,
    static_response,
    zero_at_rest,
)
from strainsight.ordering import index_of_largest


@dataclass(frozen=True)
class BenchUnknowns:
    """Unknowns of a bench.

    inputs (nu,): indices of the unknown loads in `system.inputs`, std_u, increment_u: σ at the start and per step [N, N m];
    loads: random-walk models; parameters: name in the config → name in the system; free: estimated ones; starts (s, nθ): initial
    θ, one row per start; std, increment (p,): of estimated parameters [m, Pa]; coordinates: of these."""

    inputs: np.ndarray
    std_u: np.ndarray
    increment_u: np.ndarray
    loads: LoadProcess
    parameters: Mapping[str, str]
    free: tuple[str, ...]
    starts: np.ndarray
    std: np.ndarray
    increment: np.ndarray
    coordinates: ParameterCoordinates


def corrects(config: BenchConfig) -> bool:
    """Whether the filter estimates the step error: as in a test, unless the truth uses the same step."""
    estimate = config.estimator
    by_own_step = estimate.measured is None and estimate.truth.model == "filter_step"
    return corrects_in_a_test(config) and (estimate.method.step_error is not None or not by_own_step)


def corrects_in_a_test(config: BenchConfig) -> bool:
    """Whether the filter estimates the step error in a test: as configured, by default with second-order steps and without
    printed noise or driven joints."""
    step_error, printed = config.estimator.method.step_error, config.estimator.method.noise == "as_printed"
    if step_error is not None or printed:
        return step_error == "estimated"
    return config.simulate.method == "second_order" and not config.driven


def free_properties(estimate: BenchEstimateSection) -> dict[str, tuple[str, ...]]:
    """Bearing → estimated properties, in the order of PARAMETERS."""
    free: dict[str, list[str]] = {}
    for entry in estimate.parameters.values():
        if entry.bearing is not None and entry.property is not None:
            free.setdefault(entry.bearing, []).append(entry.property)
    return {bearing: tuple(sorted(properties, key=PARAMETERS.index)) for bearing, properties in free.items()}


def parameter_units(config: BenchConfig, names: Iterable[str]) -> dict[str, str]:
    """Units of parameters: Pa for moduli, m for bearing properties."""
    return {name: "Pa" if config.estimator.parameters[name].bearing is None else "m" for name in names}


def unknowns_of(bench: Bench, h: float) -> BenchUnknowns:
    """Unknowns of `estimate`; h [s]: filter step, multiplies increments given per second."""
    config, system, estimate = bench.config, bench.system, bench.config.estimator
    a_step = h if estimate.increments == "second" else 1.0
    places = {
        name: name if entry.bearing is None else f"{entry.bearing}.{entry.property}"
        for name, entry in estimate.parameters.items()
    }
    theta = bench.theta.copy()
    for name, entry in estimate.parameters.items():
        if entry.guess is not None:
            theta[system.parameters.index(places[name])] = entry.guess
    std = {name: entry.std for name, entry in estimate.parameters.items() if entry.std is not None}
    starts = [theta]
    for name in std:
        for value in estimate.parameters[name].starts:
            starts.append(theta.copy())
            starts[-1][system.parameters.index(places[name])] = value
    with blame("estimate.parameters"):
        sizes = {name: bearing.parameters for name, bearing in bench.bearings.items()}
        coordinates = parameter_coordinates(system.parameters, [places[name] for name in std], theta, sizes)
        for start in starts:
            coordinates.xi(start)
    increments = increments_of(config, h)
    return BenchUnknowns(
        np.array([system.inputs.index(name) for name in estimate.inputs], dtype=int),
        np.array([entry.std for entry in estimate.inputs.values()]),
        increments,
        load_process_of(config, increments, h),
        places,
        tuple(std),
        np.array(starts),
        np.array(list(std.values()), dtype=float),
        np.array([estimate.parameters[name].increment * a_step for name in std]),
        coordinates,
    )


def load_process_of(config: BenchConfig, increments: np.ndarray, h: float) -> LoadProcess:
    """Random-walk models of all unknown loads in steps of h [s]; increments: see `increments_of`."""
    models, amplitudes = [], []
    for name, entry in config.estimator.inputs.items():
        frequency, amplitude = (1.0, 1.0) if entry.model == "random_walk" else typical_of(config, name)
        models.append(input_model(entry.model, frequency, entry.kappa, entry.smoothness, entry.damping))
        amplitudes.append(amplitude)
    return load_process(models, np.array(amplitudes), increments, h)


def increments_of(config: BenchConfig, h: float) -> np.ndarray:
    """σ (nu,) of the change of every unknown load per step h [s] [N, N m]: configured, else a √(κωh) for a random walk and
    min(aωh, a) for other models."""
    estimate, increments = config.estimator, []
    for name, entry in estimate.inputs.items():
        if entry.increment is not None:
            increments.append(entry.increment * (h if estimate.increments == "second" else 1.0))
            continue
        frequency, amplitude = typical_of(config, name)
        turned = 2 * np.pi * frequency * h
        walked = float(np.sqrt((WALK if entry.kappa is None else entry.kappa) * turned))
        increments.append(amplitude * (walked if entry.model == "random_walk" else min(1.0, turned)))
    return np.array(increments)


def typical_of(config: BenchConfig, name: str) -> tuple[float, float]:
    """Frequency [Hz] and amplitude [N, N m] of an unknown load: configured, else of its sine signal."""
    entry, force = config.estimator.inputs[name], config.forces[name]
    assert isinstance(force, Load)
    sine = force.signal if isinstance(force.signal, SineSection) else None
    frequency = entry.frequency or (None if sine is None else sine.frequency)
    amplitude = entry.amplitude or (None if sine is None else sine.amplitude)
    assert frequency is not None  # checked with the config
    assert amplitude is not None
    return frequency, amplitude


InTime = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class BenchProblem:
    """Estimation problem of a bench.

    sensors: all, used: of the filter; errors: installation errors of its gauges; h [s]: filter step; loads, drives: configured
    histories; known (T + 1, width): all loads, guesses for unknown ones; heaviest (width,): loads for the observability check;
    zeroing (width,): loads at which gauges were zeroed."""

    bench: Bench
    sensors: Sensors
    used: Sensors
    errors: tuple[Toleranced, ...]
    unknowns: BenchUnknowns
    h: float
    loads: InTime
    drives: InTime
    known: np.ndarray
    heaviest: np.ndarray
    zeroing: np.ndarray

    @property
    def config(self) -> BenchConfig:
        return self.bench.config

    @property
    def estimate(self) -> BenchEstimateSection:
        return self.config.estimator

    @property
    def steps(self) -> int:
        return len(self.known) - 1

    @property
    def time(self) -> np.ndarray:
        """Instants (T + 1,) [s]."""
        return self.h * np.arange(len(self.known))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns, loads before parameters."""
        return (*self.estimate.inputs, *self.unknowns.free)

    @property
    def among(self) -> np.ndarray:
        """Indices of the filter's channels among those of all sensors (m,)."""
        every = np.arange(len(self.sensors.zeroed))
        return np.concatenate([every[self.sensors.channels[name]] for name in self.used.channels])


def problem_of(bench: Bench, files: Mapping[str, Path]) -> BenchProblem:
    """Set up the estimation problem of `estimate`; the bench has its estimated properties as parameters."""
    config, estimate, h = bench.config, bench.config.estimator, bench.config.filter_step
    sensors, unknowns = sensors_of(bench), unknowns_of(bench, h)
    used = some_of(bench, sensors, list(estimate.sensors))
    loads, drives = loads_of(bench, files), drives_of(bench, files)
    known = loads(h * np.arange(round(config.filter_duration / h) + 1))
    refuse_spun(bench, known, "estimate")
    zeroing = known[0].copy()
    heaviest = known[index_of_largest(np.linalg.norm(known / np.maximum(np.abs(known).max(axis=0), 1e-300), axis=1))]
    for column, name in zip(unknowns.inputs, estimate.inputs, strict=True):
        guess = estimate.inputs[name].guess
        known[:, column] = known[0, column] if guess is None else guess
    errors = toleranced(bench, used)
    return BenchProblem(bench, sensors, used, errors, unknowns, h, loads, drives, known, heaviest, zeroing)


FITS, SETTLED = 20, 1e-9
"""Most Gauss-Newton steps for loads at rest, and convergence tolerance relative to their σ."""
HALVINGS = 12
"""Most halvings of a step."""


def zero_of(problem: BenchProblem, sensors: Sensors, theta: np.ndarray) -> np.ndarray:
    """Readings (channels,) at zeroing with these parameters, 0 for channels that are not zeroed."""
    if not sensors.zeroed.any():
        return np.zeros(len(sensors.zeroed))
    with blame("estimate"):
        q, v = start_of(problem.bench.at(theta), problem.zeroing)
    rest = at_rest(problem.bench.system, problem.zeroing)
    return np.where(sensors.zeroed, sensors.readings.read(q, v, rest)[0], 0.0)


def free_zero(problem: BenchProblem, sensors: Sensors) -> Zero | None:
    """Readings at zeroing as a function of the parameters; None without estimated parameters, zeroed channels or equilibrium."""
    unknowns, bench = problem.unknowns, problem.bench
    if not (sensors.zeroed.any() and unknowns.free and problem.config.simulate.start == "equilibrium"):
        return None
    q, _ = start_of(bench.at(unknowns.starts[0]), problem.zeroing)
    return zero_at_rest(bench.system, sensors.readings, sensors.zeroed, q, problem.zeroing, unknowns.coordinates)


def loads_at_rest(problem: BenchProblem, guess: np.ndarray, first: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Loads (nu,) that explain the first readings at rest, by damped Gauss-Newton from the guess:

    min ‖(y₀ − h(q₀(u)))/σ‖² + ‖(u − û)/σ_u‖²     over the inputs without a configured guess

    first y₀ (m,), NaN if not measured."""
    bench, unknowns = problem.bench, problem.unknowns
    free = [i for i, entry in enumerate(problem.estimate.inputs.values()) if entry.guess is None]
    measured, columns = np.isfinite(first), unknowns.inputs[free]
    std, theta = unknowns.std_u[free], unknowns.starts[0]

    def misfit(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residual and its derivatives with respect to the loads."""
        q, v = start_of(bench.at(theta), u)
        by_u, _ = static_response(bench.system, q, u, theta)
        read, H, _ = problem.used.readings.read(q, v, at_rest(bench.system, u))
        r = np.append(((first - read) / noise)[measured], (guess - u)[columns] / std)
        return r, np.vstack([((H @ by_u[:, columns]) / noise[:, None])[measured], np.diag(1 / std)])

    u = guess.copy()
    if not free:
        return u
    with blame("estimate.measured"):
        r, slopes = misfit(u)
    for _ in range(FITS):
        du = np.linalg.lstsq(slopes, r, rcond=None)[0]
        if np.all(np.abs(du) < SETTLED * std):
            u[columns] += du
            break
        for halvings in range(HALVINGS):
            trial = u.copy()
            trial[columns] += 0.5**halvings * du
            try:
                tried = misfit(trial)
            except (NumericalError, UserError):
                continue  # no equilibrium under these loads
            if np.linalg.norm(tried[0]) < np.linalg.norm(r):
                u, (r, slopes) = trial, tried
                break
        else:
            break
    return u


def moved_at_rest(problem: BenchProblem, under: tuple[np.ndarray, ...]) -> tuple[np.ndarray, NumericalError | None]:
    """Effect (m, nu + p) of one σ of every unknown, or of its change per step, on every reading at rest, the largest under these
    loads, as a stiffness has an effect only under load. Zeros without an initial equilibrium. Also returns the error of loads
    after the first for which no equilibrium was found."""
    bench, unknowns, channels = problem.bench, problem.unknowns, problem.used.readings
    unsolved: NumericalError | None = None
    most = np.zeros((len(channels.channels), len(unknowns.std_u) + len(unknowns.std)))
    if problem.config.simulate.start != "equilibrium":
        return most, unsolved
    theta = unknowns.starts[0]
    std = np.maximum(np.append(unknowns.std_u, unknowns.std), np.append(unknowns.increment_u, unknowns.increment))
    for i, u in enumerate(under):
        try:
            with blame("estimate"):
                q, v = start_of(bench.at(theta), u)
                by_u, by_theta = static_response(bench.system, q, u, theta)
        except (UserError, NumericalError) as error:
            if i == 0:
                raise
            unsolved = error if isinstance(error, NumericalError) else unsolved
            continue  # no equilibrium under these loads
        response = np.concatenate([by_u[:, unknowns.inputs], by_theta[:, unknowns.coordinates.free]], axis=1)
        most = np.maximum(most, np.abs(channels.read(q, v, at_rest(bench.system, u))[1] @ response) * std)
    return most, unsolved
