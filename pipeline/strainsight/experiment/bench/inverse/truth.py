"""Truth and measurements of a bench estimate: simulation, another bench, or a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from strainsight.config.bench.bench import units_of
from strainsight.config.bench.estimate import BenchTruth, FromFile, FromRun
from strainsight.config.estimate import Channel
from strainsight.errors import ConfigError, NumericalError, blame, did_you_mean
from strainsight.estimation.update import covariance_factor, square_factor
from strainsight.experiment.bench.bench import Bench, start_of
from strainsight.experiment.bench.inverse.problem import BenchProblem
from strainsight.experiment.bench.inverse.trial import BenchTrial
from strainsight.experiment.bench.loads import load_units, loads_of
from strainsight.experiment.bench.sensors import instants_of, read_in_time, unit_of
from strainsight.experiment.recorded import signals_of
from strainsight.experiment.system import Resources, of_steps
from strainsight.multibody.inverse.model import AugmentedStep
from strainsight.multibody.simulate import simulate, simulate_radau
from strainsight.records import record
from strainsight.records.bench import BenchTruths, Simulated

SECTION = "estimate.measured"
QUANTITY = {
    "m": "displacement",
    "m/s": "velocity",
    "m/s²": "acceleration",
    "rad": "angle",
    "strain": "strain",
    "1": "ratio",
}
"""Unit of a component → required quantity of a channel of a file."""
TRUTH_STREAM = 2
"""Last word of the seed for sampled truths."""
FEW = 1e-6
"""Largest difference of two time steps, relative to a step."""


@dataclass(frozen=True)
class Reality:
    """Truth and readings of an estimate.

    inputs (T + 1, r, nu): of the system, r = 1 or per run [N, N m]; theta (r, nθ); readings (T, r, all channels): at h, 2h, …,
    NaN if missing; q (T + 1, r, n): if simulated; first (m,): readings at 0, if measured; elsewhere: loads of the other bench (T
    + 1,) by input; done: notes on measurements from a file."""

    inputs: np.ndarray
    theta: np.ndarray
    readings: np.ndarray
    q: np.ndarray | None = None
    first: np.ndarray | None = None
    elsewhere: Mapping[str, np.ndarray] = field(default_factory=dict)
    done: tuple[str, ...] = ()


def reality_of(
    problem: BenchProblem, other: Simulated | None, truths: BenchTruths | None, using: Resources
) -> Reality | None:
    """Build the truth of `estimate`: from a file, another bench, another integrator (truths), or a simulation; None for a truth
    sampled from the filter's own model (`sample_reality`)."""
    truth, measured = problem.estimate.truth, problem.estimate.measured
    if isinstance(measured, FromFile):
        read, done = from_file(problem, measured, using.files["estimate.measured.file"])
        return _measured(problem, read, done=done)
    if measured is not None:
        assert other is not None
        read, elsewhere = from_run(problem, measured, other)
        return _measured(problem, read, elsewhere=elsewhere)
    if truths is not None:
        return _by_integrator(problem, truths)
    return (
        None if truth.model == "sampled" else _simulated(problem, truth.substeps if truth.model == "fine" else 1, using)
    )


def _measured(problem: BenchProblem, read: Mapping[str, np.ndarray], **more: Any) -> Reality:
    """Measurements at 0, h, … (T + 1, components), without known loads and parameters."""
    sensors, system = problem.sensors, problem.bench.system
    readings = np.full((problem.steps, 1, len(sensors.zeroed)), np.nan)
    for name, values in read.items():
        readings[:, 0, sensors.channels[name]] = values[1:]
    first = np.concatenate([read[name][0] for name in problem.used.channels])
    inputs = np.full((problem.steps + 1, 1, len(system.inputs)), np.nan)
    return Reality(inputs, np.full((1, len(system.parameters)), np.nan), readings, first=first, **more)


def _simulated(problem: BenchProblem, substeps: int, using: Resources) -> Reality:
    """Simulate the bench with time step h/substeps."""
    bench, h, count = problem.bench, problem.h / substeps, problem.steps * substeps
    fine = h * np.arange(count + 1)
    u = problem.loads(fine)
    with blame("estimate.truth"):
        progress = of_steps(using.progress, "simulated test", count, share=0.3)
        run = simulate(
            bench.system, *start_of(bench, u[0]), u, h, bench.theta, problem.config.simulate.method, progress
        )
    at = slice(None, None, substeps)
    return _as_read(problem, [(run.q[at], run.v[at], u[at])], problem.drives(fine[at])[:, 2].T)


def _by_integrator(problem: BenchProblem, truths: BenchTruths) -> Reality:
    """Sample the first histories, one per run if there are several, at 0, h, … of the filter."""
    every = round(problem.h / (truths.time[1] - truths.time[0]))
    rows = slice(0, every * problem.steps + 1, every)
    inputs = np.stack([truths.inputs[name][rows] for name in problem.bench.system.inputs], axis=2)
    count = min(truths.q.shape[1], problem.estimate.runs)
    motions = [(truths.q[rows, r], truths.v[rows, r], inputs[:, r]) for r in range(count)]
    return _as_read(problem, motions, np.zeros((problem.steps + 1, 0)))  # no joint is driven


def _as_read(
    problem: BenchProblem, motions: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], second: np.ndarray
) -> Reality:
    """Read all sensors in motions q, v, u (T + 1, ...); second (T + 1, nd): p̈ of driven joints."""
    bench, sensors = problem.bench, problem.sensors
    readings = []
    for motion in motions:
        instants = instants_of(bench, *motion, second) if sensors.readings.accelerometers else []
        readings.append(read_in_time(bench, sensors.readings, *motion, instants))
    read = np.stack(readings, axis=1)
    read = read - np.where(sensors.zeroed, read[0], 0.0)
    q, _, inputs = (np.stack(each, axis=1) for each in zip(*motions, strict=True))
    return Reality(inputs, np.tile(bench.theta, (len(motions), 1)), read[1:], q)


def sample_reality(trial: BenchTrial) -> Reality:
    """Sample truths from the filter's own model; only its sensors are read."""
    problem, runs = trial.problem, trial.problem.estimate.runs
    states = slice(trial.model.size)
    start, P = trial.start[:runs, states], trial.covariance[:runs, states, states]
    truths = sample(trial.model, start, P, problem.known, runs, problem.config.seed)
    readings = np.full((problem.steps, runs, len(problem.sensors.zeroed)), np.nan)
    readings[:, :, problem.among] = truths.readings
    return replace(truths, readings=readings)


def sample(model: AugmentedStep, start: np.ndarray, P: np.ndarray, known: np.ndarray, runs: int, seed: int) -> Reality:
    """Sample truths of the filter's own model: start from N(x̂, P), then process noise in every step.

    start (B, size), P (B, size, size), known (T + 1, width). Starts are projected onto the constraints. Raises NumericalError if
    a step cannot be solved."""
    steps = len(known) - 1
    x = np.empty((runs, model.size))
    draws = [np.random.default_rng((seed, run, TRUTH_STREAM)) for run in range(runs)]
    for run, draw in enumerate(draws):
        which = run % len(start)
        spread = covariance_factor(P[which])
        x[run] = start[which] + spread @ draw.standard_normal(spread.shape[1])
    x = model.projected(x, 0)
    inputs = np.repeat(known[:, None], runs, axis=1)
    inputs[0][:, model.inputs] = x[:, model.u]
    readings = np.empty((steps, runs, model.channels))
    factor = covariance_factor(model.before(0))
    for k in range(steps):
        model.begin(x, k)
        noise = np.array([draw.standard_normal(factor.shape[1]) for draw in draws])
        x = model.step(x + noise @ factor.T, k)[0]
        if model.corrected or model.printed:
            process = model.process(k)
            within = square_factor(np.broadcast_to(process, (runs, *process.shape[-2:])))
            moved = [root @ draw.standard_normal(model.size) for root, draw in zip(within, draws, strict=True)]
            x = model.projected(x + np.array(moved), k + 1)
        if not np.all(np.isfinite(x)):
            raise NumericalError(
                f"the simulation of the test with the model of the filter failed at t = {k * model.h:g} s",
                remedy="Reduce `increment` or `std` of the unknowns in estimate.inputs and estimate.parameters.",
            )
        inputs[k + 1][:, model.inputs] = x[:, model.u]
        readings[k] = model.measure(x, k)[0]
    theta = np.array([model.coordinates.theta(xi)[0] for xi in x[:, model.xi]])
    return Reality(inputs, theta, readings)


def from_run(
    problem: BenchProblem, settings: FromRun, other: Simulated
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Readings (T + 1, components) and loads (T + 1,) of another bench at 0, h, …, by the names of this bench; sensors not used
    by the filter are read for comparison if they match.

    Lengths, velocities and accelerations are multiplied by `scale`. Raises ConfigError for a missing sensor or instant, and for a
    sensor of another kind."""
    key, clock, h, steps = "estimate.measured.from", other.time, problem.h, problem.steps
    pace = clock[1] - clock[0]
    every = round(h / pace)
    if abs(every * pace - h) > FEW * pace or every < 1:
        raise ConfigError(
            f"the time step of the measured run, {pace:g} s, does not divide the time step of the filter, {h:g} s",
            key=key,
            remedy=f"Set estimate.time_step to a multiple of {pace:g} s.",
        )
    if every * steps > len(clock) - 1:
        raise ConfigError(
            f"the measured run ends after {clock[-1]:g} s, the estimate after {h * steps:g} s",
            key=key,
            remedy=f"Set estimate.duration to at most {clock[-1]:g} s.",
        )
    rows = every * np.arange(steps + 1)
    read = {}
    for name in dict.fromkeys((*problem.used.channels, *problem.sensors.channels)):
        entry, channels, used = problem.config.sensors[name], problem.sensors.count(name), name in problem.used.channels
        wanted = settings.sensors.get(name, name)
        if not used and name not in settings.sensors and wanted not in other.sensors:
            continue
        values = _entry_of(other.sensors, "sensor", wanted, f"estimate.measured.sensors.{name}")
        unit = record.unit_of(other, "sensors", wanted)
        if (unit, values.shape[1]) == (unit_of(entry), channels):
            read[name] = np.array(values[rows], dtype=float)
            read[name][:, : 3 if units_of(entry)[0].startswith("m") else 0] *= settings.scale
        elif used:
            raise ConfigError(
                f"the sensor '{name}' has components in {unit_of(entry)} ({channels} in total), but the sensor '{wanted}' of the "
                f"measured run has components in {unit} ({values.shape[1]} in total)",
                key="estimate.measured",
                remedy="In estimate.measured.sensors, assign a sensor with the same units and number of components.",
            )
    loads = {}
    for name, load_unit in load_units(problem.config, problem.estimate.inputs).items():
        wanted = settings.inputs.get(name, name)
        if name not in settings.inputs and wanted not in other.inputs:
            continue
        loads[name] = _entry_of(other.inputs, "load", wanted, f"estimate.measured.inputs.{name}")[rows]
        if (unit := record.unit_of(other, "inputs", wanted)) != load_unit:
            raise ConfigError(
                f"the load '{name}' has the unit {load_unit}, but the load '{wanted}' of the measured run has the unit {unit}",
                key=f"estimate.measured.inputs.{name}",
                remedy=f"Assign a load with the unit {load_unit}.",
            )
    return read, loads


def _entry_of(entries: Mapping[str, np.ndarray], kind: str, name: str, key: str) -> np.ndarray:
    if name not in entries:
        remedy = did_you_mean(name, list(entries), f"The measured run has: {', '.join(entries)}.")
        raise ConfigError(f"the measured run has no {kind} '{name}'", key=key, remedy=remedy)
    return entries[name]


def from_file(problem: BenchProblem, settings: FromFile, path: Path) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Readings at 0, h, … (T + 1, components) of every sensor from a file, NaN if not measured, and notes.

    The first sample of the file is the start. Raises ConfigError for a channel of another quantity, a wrong number of components,
    and a file that is too short."""
    wanted: dict[str, Channel] = {}
    steps, counts = problem.steps, {name: problem.used.count(name) for name in problem.used.channels}
    for name, count in counts.items():
        entries, key = settings.channels[name], f"{SECTION}.channels.{name}"
        if len(entries) != count:  # the size of a placed layout is not known to the config
            raise ConfigError(
                f"the sensor needs one channel for each of its {count} components (channels in the list: {len(entries)})",
                key=key,
                remedy="List the channels in the order of the components, with null for a component that was not measured.",
            )
        wanted |= {f"{key}.{i}": entry for i, entry in enumerate(entries) if entry is not None}
    signals = signals_of(settings, SECTION, path, wanted, step=problem.h)
    if len(signals.time) <= steps:
        end = signals.time[-1] - signals.time[0]
        raise ConfigError(
            f"the measurement file ends after {end:.6g} s, the estimate after {problem.h * steps:.6g} s",
            key=f"{SECTION}.file",
            remedy=f"Set estimate.duration to at most {end:.6g} s.",
        )
    read = {name: np.full((steps + 1, count), np.nan) for name, count in counts.items()}
    for (key, entry), quantity, values in zip(wanted.items(), signals.quantities, signals.values.T, strict=True):
        name, component = key.removeprefix(f"{SECTION}.channels.").rsplit(".", 1)
        units = units_of(problem.config.sensors[name])
        kind = QUANTITY[units[int(component) % len(units)]]
        if quantity != kind:
            raise ConfigError(
                f"the channel has the unit {entry.unit} ({quantity}), but component {int(component) + 1} of the sensor {name} "
                f"measures {kind}",
                key=f"{key}.unit",
                remedy="Check the unit and the order of the channels.",
            )
        read[name][:, int(component)] = values[: steps + 1]
    more = len(signals.time) - 1 - steps
    notes = [f"samples of the file that were ignored after the end of the estimate: {more}"] if more else []
    return read, (*signals.notes, *notes)


BEGIN = 3
"""Last word of the seed for sampled start times of the histories."""


def truths_of(bench: Bench, truth: BenchTruth, duration: float, using: Resources) -> BenchTruths:
    """Histories r = 0, 1, … of u_r(t) = u(τ_r + t) + u(0) − u(τ_r), τ₀ = 0 and τ_r uniform in [0, `within`]; all start in the
    same state under the same loads."""
    h, steps, system = truth.step, round(duration / truth.step), bench.system
    begin = np.zeros(truth.histories)
    begin[1:] = np.random.default_rng((bench.config.seed, BEGIN)).uniform(0.0, truth.within, truth.histories - 1)
    # on the time steps, to keep piecewise-linear loads linear within steps
    begin = h * np.round(begin / h)
    time, loads, motions = h * np.arange(steps + 1), loads_of(bench, using.files), []
    first = loads(time[:1])[0]
    every = [history + (first - history[0]) for history in (loads(instant + time) for instant in begin)]
    with blame("estimate.truth"):
        start = start_of(bench, first)
        for r, u in enumerate(every):
            progress = of_steps(using.progress, "simulated test", steps * len(every), first=r * steps)
            run = simulate_radau(system, *start, u, h, bench.theta, progress)
            motions.append((run.q, run.v))
    return BenchTruths(
        time=time,
        begin=begin,
        q=np.stack([q for q, _ in motions], axis=1),
        v=np.stack([v for _, v in motions], axis=1),
        inputs={name: np.stack([u[:, i] for u in every], axis=1) for i, name in enumerate(system.inputs)},
    )
