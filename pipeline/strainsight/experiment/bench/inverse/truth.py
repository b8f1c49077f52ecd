"""What stands for reality in a bench's estimate: its own simulation, finer or not, or what another bench's sensors read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from strainsight.config.bench.bench import (
    AccelerationSensor,
    BenchConfig,
    MotionSensor,
    RelativeSensor,
    Sensor,
    Simulate,
)
from strainsight.config.bench.estimate import BenchTruth, FromRun
from strainsight.errors import ConfigError, NumericalError, blame, did_you_mean
from strainsight.estimation.update import covariance_factor, square_factor
from strainsight.experiment.bench.bench import Bench, bench_of, start_of
from strainsight.experiment.bench.loads import loads_of
from strainsight.experiment.bench.sensors import MOTION_UNITS, instants_of, read_in_time, unit_of
from strainsight.experiment.resources import Resources
from strainsight.mesh.model import Mesh
from strainsight.multibody.inverse.model import AugmentedStep
from strainsight.multibody.sensors import Readings
from strainsight.multibody.simulate import simulate, simulate_radau
from strainsight.records import record
from strainsight.records.bench import BenchTruths, ReducedBody, Simulated

NOISE = 1
"""Last word of the seed of every run's noise; a trailing zero would be no word at all."""
DRAWN = 2
"""Last word of the seed of every drawn truth."""
FEW = 1e-6
"""Share of a step by which two clocks may differ."""


@dataclass(frozen=True)
class Reality:
    """inputs (T + 1, r, nu) of the system, r = 1 or one a run [N, N m]; theta (r, nθ); readings (T, r, all channels) of every
    sensor at h, 2h, …, NaN where nothing was read."""

    inputs: np.ndarray
    theta: np.ndarray
    readings: np.ndarray


def simulated(
    bench: Bench,
    sensors: Readings,
    zeroed: np.ndarray,
    settings: Simulate,
    loads: Callable[[np.ndarray], np.ndarray],
    drives: Callable[[np.ndarray], np.ndarray],
    h: float,
    steps: int,
    substeps: int,
    progress: Callable[[float], None],
) -> Reality:
    """The bench with its own parameters, integrated with h/substeps; loads: time (k,) → (k, nu);
    drives: → p, ṗ, p̈ (nd, 3, k); zeroed (channels,)."""
    fine = h / substeps * np.arange(steps * substeps + 1)
    u = loads(fine)
    count = len(fine) - 1
    with blame("estimate.truth"):
        q0, v0 = start_of(bench, settings, u[0])
        found = simulate(
            bench.system, q0, v0, u, h / substeps, bench.theta, settings.method,
            lambda k: progress(k / count) if k % 50 == 0 else None,
        )  # fmt: skip
    at = found.q[::substeps], found.v[::substeps], u[::substeps]
    second = drives(fine[::substeps])[:, 2].T
    instants = instants_of(bench.system, *at, bench.theta, second) if sensors.accelerometers else []
    read = read_in_time(bench.system, sensors, *at, instants)
    read = read - np.where(zeroed, read[0], 0.0)
    return Reality(u[::substeps, None], bench.theta[None], read[1:, None])


def drawn(model: AugmentedStep, start: np.ndarray, P: np.ndarray, known: np.ndarray, runs: int, seed: int) -> Reality:
    """Truths of the filter's own model: the start from N(x̂, P), inputs, parameters and disturbance from its noise before a step
    and after it.

    start (B, size), P (B, size, size), known (T + 1, width). The drawn starts are put back on the constraints.
    Raises NumericalError where a drawn step cannot be solved.
    """
    steps = len(known) - 1
    x = np.empty((runs, model.size))
    draws = [np.random.default_rng((seed, run, DRAWN)) for run in range(runs)]
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
            x = model.projected(
                x + np.array([own @ draw.standard_normal(model.size) for own, draw in zip(within, draws, strict=True)]),
                k + 1,
            )
        if not np.all(np.isfinite(x)):
            raise NumericalError(
                f"a drawn truth cannot be stepped at {k * model.h:g} s",
                remedy="give smaller increments, or a smaller std at the start",
            )
        inputs[k + 1][:, model.inputs] = x[:, model.u]
        readings[k] = model.measure(x, k)[0]
    theta = np.array([model.coordinates.theta(own)[0] for own in x[:, model.xi]])
    return Reality(inputs, theta, readings)


def measurements(readings: np.ndarray, noise: np.ndarray, runs: int, starts: int, seed: int, noisy: bool) -> np.ndarray:
    """What the filter is given (T, runs · starts, m): readings (T, 1 or runs, m), noise drawn anew for every run, the same for
    all starts of one."""
    steps, m = len(readings), len(noise)
    found = np.broadcast_to(readings, (steps, runs, m)).copy()
    if noisy:
        for run in range(runs):
            found[:, run] += noise * np.random.default_rng((seed, run, NOISE)).standard_normal((steps, m))
    return np.repeat(found, starts, axis=1)


def from_run(
    there: Simulated,
    settings: FromRun,
    own: Mapping[str, tuple[Sensor, int]],
    units: Mapping[str, str],
    h: float,
    steps: int,
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """What another bench's sensors read and its loads at 0, h, … (T + 1, components) and (T + 1,), by own names.

    own: sensors of the filter with their number of channels; units: of the unknown loads. Lengths are multiplied by
    `scale`: the displacements of a relative motion, positions, velocities and accelerations, not tilts, strains or axes.
    Raises ConfigError for a sensor or an instant that it lacks, and for one of another kind.
    """
    key, clock = "estimate.measured.from", there.time
    pace = clock[1] - clock[0]
    every = round(h / pace)
    if abs(every * pace - h) > FEW * pace or every < 1:
        raise ConfigError(
            f"its samples are {pace:g} s apart, which does not divide the filter's step of {h:g} s",
            key=key,
            remedy=f"set estimate.time_step to a multiple of {pace:g}",
        )
    if every * steps > len(clock) - 1:
        raise ConfigError(
            f"it ends after {clock[-1]:g} s, the estimate after {h * steps:g} s",
            key=key,
            remedy=f"set estimate.duration to at most {clock[-1]:g}",
        )
    rows = every * np.arange(steps + 1)
    read = {}
    for name, (entry, channels) in own.items():
        wanted = settings.sensors.get(name, name)
        values = _there(there.sensors, "sensor", wanted, f"estimate.measured.sensors.{name}")
        unit = record.unit_of(there, "sensors", wanted)
        if (unit, values.shape[1]) != (unit_of(entry), channels):
            raise ConfigError(
                f"'{name}' has {channels} channels in {unit_of(entry)}, sensors/{wanted} there {values.shape[1]} in {unit}",
                key="estimate.measured",
                remedy="name a sensor of the same kind and size under estimate.measured.sensors",
            )
        placed = isinstance(entry, MotionSensor) and entry.quantity in MOTION_UNITS
        lengths = slice(3) if isinstance(entry, RelativeSensor | AccelerationSensor) or placed else slice(0)
        read[name] = np.array(values[rows], dtype=float)
        read[name][:, lengths] *= settings.scale
    loads = {}
    for name, own_unit in units.items():
        wanted = settings.inputs.get(name, name)
        if name not in settings.inputs and wanted not in there.inputs:
            continue
        values = _there(there.inputs, "input", wanted, f"estimate.measured.inputs.{name}")
        if (unit := record.unit_of(there, "inputs", wanted)) != own_unit:
            raise ConfigError(
                f"'{name}' is in {own_unit}, '{wanted}' there in {unit}",
                key=f"estimate.measured.inputs.{name}",
                remedy="name a load of the same kind",
            )
        loads[name] = values[rows]
    return read, loads


def like_those(
    there: Simulated, settings: FromRun, others: Mapping[str, tuple[Sensor, int]]
) -> dict[str, tuple[Sensor, int]]:
    """Of sensors that the filter is not given, with their number of channels, those that the other bench has under the same
    name, or the one of `sensors`, and of the same kind and size: they are compared with its readings."""
    found = {}
    for name, (entry, channels) in others.items():
        wanted = settings.sensors.get(name, name)
        values = there.sensors.get(wanted)
        if values is None and name in settings.sensors:
            _there(there.sensors, "sensor", wanted, f"estimate.measured.sensors.{name}")
        size = None if values is None else values.shape[1]
        if size == channels and record.unit_of(there, "sensors", wanted) == unit_of(entry):
            found[name] = entry, channels
    return found


def _there(found: Mapping[str, np.ndarray], kind: str, name: str, key: str) -> np.ndarray:
    if name not in found:
        listed = list(found)
        raise ConfigError(
            f"that run has no {kind} '{name}'",
            key=key,
            remedy=did_you_mean(name, listed, f"it has {', '.join(listed)}"),
        )
    return found[name]


BEGIN = 3
"""Last word of the seed by which instants of the histories are drawn."""


def truths_of(
    config: BenchConfig,
    truth: BenchTruth,
    duration: float,
    reduced: dict[str, ReducedBody],
    meshes: dict[str, Mesh],
    using: Resources,
) -> BenchTruths:
    """Histories r = 0, 1, … of u_r(t) = u(τ_r + t) + u(0) − u(τ_r), τ₀ = 0 and τ_r drawn evenly from [0, `within`]: all begin in
    the same state under the same loads."""
    bench = bench_of(config, reduced, meshes)
    h, steps = truth.step, round(duration / truth.step)
    begin = np.zeros(truth.histories)
    begin[1:] = np.random.default_rng((config.seed, BEGIN)).uniform(0.0, truth.within, truth.histories - 1)
    # on the instants of the step, so that what is straight between samples is so in every step
    begin = h * np.round(begin / h)
    time, loads = h * np.arange(steps + 1), loads_of(config, bench, using.files)
    q, v = np.empty((2, steps + 1, truth.histories, bench.system.size))
    u = np.empty((steps + 1, truth.histories, bench.system.drives.width))
    first = loads(time[:1])[0]
    with blame("estimate.truth"):
        q0, v0 = start_of(bench, config.simulate, first)
        for r, instant in enumerate(begin):
            own = loads(instant + time)
            u[:, r] = own + (first - own[0])

            def tell(k: int, r: int = r) -> None:
                if k % 50 == 0:
                    using.progress("truth", (r + k / steps) / len(begin))

            found = simulate_radau(bench.system, q0, v0, u[:, r], h, bench.theta, tell)
            q[:, r], v[:, r] = found.q, found.v
    inputs = {name: u[:, :, i] for i, name in enumerate(bench.system.inputs)}
    return BenchTruths(time=time, begin=begin, q=q, v=v, inputs=inputs)


def reality_of(
    there: BenchTruths, bench: Bench, sensors: Readings, zeroed: np.ndarray, h: float, steps: int, runs: int
) -> Reality:
    """The first histories, one a run where there are several, at 0, h, … of the filter; zeroed (channels,)."""
    every = round(h / (there.time[1] - there.time[0]))
    rows, count = slice(0, every * steps + 1, every), min(there.q.shape[1], runs)
    q, v = there.q[rows, :count], there.v[rows, :count]
    inputs = np.stack([there.inputs[name][rows, :count] for name in bench.system.inputs], axis=2)
    second, runs_read = np.zeros((len(q), 0)), []  # no joint is driven
    for r in range(count):
        at = q[:, r], v[:, r], inputs[:, r]
        instants = instants_of(bench.system, *at, bench.theta, second) if sensors.accelerometers else []
        runs_read.append(read_in_time(bench.system, sensors, *at, instants))
    read = np.stack(runs_read, axis=1)
    read = read - np.where(zeroed, read[0], 0.0)
    return Reality(inputs, np.tile(bench.theta, (count, 1)), read[1:])
