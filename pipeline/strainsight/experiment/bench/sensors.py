"""Sensors of a bench, compiled for its system, and installation errors of its gauges."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.bench.bench import (
    AccelerationSensor,
    BenchConfig,
    MotionSensor,
    ReactionSensor,
    RelativeSensor,
    StrainSensorSection,
    units_of,
)
from strainsight.config.bench.bench import Sensor as StatedSensor
from strainsight.errors import blame
from strainsight.experiment.bench.bench import Bench
from strainsight.experiment.bench.loads import load_units
from strainsight.experiment.system import installation_std
from strainsight.mesh.facets import Facets, exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.multibody.accelerations import Instant, gravity_at, instant
from strainsight.multibody.bodies import Frame
from strainsight.multibody.relations import bearing_displacements
from strainsight.multibody.sensors import (
    Accelerometer,
    CompiledSensors,
    Felt,
    RelationSensor,
    Sensor,
    axis_sensor,
    position_sensor,
    readings,
)
from strainsight.multibody.sensors import StrainSensor as StrainRows
from strainsight.sensors.bonded import BondedEntry, bonded
from strainsight.sensors.candidates import Candidates
from strainsight.sensors.installation import (
    COMMON,
    SECOND,
    InstallationStd,
    installed_rows,
    sample_installation,
    sensitivity_rows,
)
from strainsight.sensors.strain_operator import channel_rows


@dataclass(frozen=True)
class BondedGauges:
    """Gauges of a strain sensor at the nearest points of a body's surface; basis (3 nodes, r); moved (gauges,) [m]: distance to
    the surface."""

    body: str
    mesh: Mesh
    facets: Facets
    basis: np.ndarray
    gauges: Candidates
    moved: np.ndarray


@dataclass(frozen=True)
class Sensors:
    """Compiled sensors, strains first; channels: sensor → rows; zeroed (k,): channels zeroed at the start; bonded: gauges of
    every strain sensor."""

    readings: CompiledSensors
    channels: Mapping[str, slice]
    zeroed: np.ndarray
    bonded: Mapping[str, BondedGauges]

    def count(self, name: str) -> int:
        """Number of channels of a sensor."""
        return self.channels[name].stop - self.channels[name].start


def sensors_of(bench: Bench) -> Sensors:
    """Compile all sensors that measure the state."""
    strains, others, bonded_gauges = [], [], {}
    for name, entry in bench.config.sensors.items():
        if isinstance(entry, StrainSensorSection):
            on = bonded_gauges[name] = _bonded(bench, name, entry)
            with blame(f"sensors.{name}.{'gauges' if entry.layout is None else 'layout'}"):
                rows = channel_rows(on.mesh.position, on.gauges, on.basis, facets=on.facets)
                strains.append(StrainRows(name, on.body, rows))
        elif not isinstance(entry, ReactionSensor):
            others.append(motion_sensor(name, entry, bench.frames))
    # order of rows
    others.sort(key=lambda sensor: isinstance(sensor, Accelerometer))
    return _compiled(bench, [*strains, *others], bonded_gauges)


def some_of(bench: Bench, sensors: Sensors, names: Collection[str]) -> Sensors:
    """Select sensors by name."""
    some = [sensor for sensor in sensors.readings.sensors if sensor.name in names]
    return _compiled(bench, some, {name: on for name, on in sensors.bonded.items() if name in names})


def _compiled(bench: Bench, sensors: Sequence[Sensor], bonded_gauges: Mapping[str, BondedGauges]) -> Sensors:
    compiled, channels, at = readings(bench.system, sensors), {}, 0
    zeroed = np.zeros(len(compiled.channels), dtype=bool)
    for sensor in compiled.sensors:
        count = len(sensor.rows) if isinstance(sensor, StrainRows) else 3
        if isinstance(sensor, RelationSensor):
            count = len(sensor.relations)
        channels[sensor.name] = slice(at, at + count)
        zeroed[channels[sensor.name]] = getattr(bench.config.sensors[sensor.name], "zeroed", False)
        at += count
    return Sensors(compiled, channels, zeroed, bonded_gauges)


def _bonded(bench: Bench, name: str, entry: StrainSensorSection) -> BondedGauges:
    key, mesh = f"sensors.{name}.gauges", bench.meshes[entry.body]
    entries = [BondedEntry(g.position, g.direction, g.length or 0.0, g.angles) for g in entry.gauges]
    if entry.layout is not None:
        assert bench.placed is not None
        key, layout = f"sensors.{name}.layout", bench.placed.layout(entry.layout)
        columns = (getattr(layout, part)[layout.bonded] for part in ("position", "direction", "length"))
        entries = [BondedEntry(*gauge) for gauge in zip(*columns, strict=True)]
    facets = exterior_facets(mesh)
    with blame(key):
        gauges, moved = bonded(mesh, facets, entries, entry.snap_tolerance, key)
    return BondedGauges(entry.body, mesh, facets, bench.reduced[entry.body].basis, gauges, moved)


def instants_of(bench: Bench, q: np.ndarray, v: np.ndarray, u: np.ndarray, second: np.ndarray) -> list[Instant]:
    """Instants of states q, v (T, n) under u (T, width); second (T, nd): p̈ of the drives."""
    states = zip(q, v, u, strict=True)
    return [instant(bench.system, *now, bench.theta, p) for now, p in zip(states, second, strict=True)]


def read_in_time(
    bench: Bench, sensors: CompiledSensors, q: np.ndarray, v: np.ndarray, u: np.ndarray, instants: Sequence[Instant]
) -> np.ndarray:
    """Readings (T, channels) of all sensors in a run; instants: only used by accelerometers."""
    if not sensors.accelerometers:
        return np.array([sensors.read(*now)[0] for now in zip(q, v, strict=True)])
    felt = (Felt(now.acceleration, gravity_at(bench.system, at)) for now, at in zip(instants, u, strict=True))
    return np.array([sensors.read(*now)[0] for now in zip(q, v, felt, strict=True)])


def motion_sensor(name: str, entry: StatedSensor, frames: Mapping[str, Frame]) -> Sensor:
    """Build a sensor of relative or absolute motion."""
    if isinstance(entry, RelativeSensor):
        i, j = (frames[frame] for frame in entry.frames)
        return RelationSensor(name, bearing_displacements(i, j))
    assert isinstance(entry, MotionSensor | AccelerationSensor)
    frame = frames[entry.frame]
    if isinstance(entry, AccelerationSensor):
        return Accelerometer(name, frame, entry.axes == "own", entry.gravity)
    if entry.quantity in ("position", "velocity"):
        return position_sensor(name, frame, rate=entry.quantity == "velocity")
    return axis_sensor(name, frame, "xyz".index(entry.quantity[0]))


def frame_at(bench: Bench, frame: Frame, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and axes of a frame (12,), and their derivatives with respect to q (12, n)."""
    sensors = [position_sensor(frame.name, frame), *(axis_sensor(frame.name, frame, k) for k in range(3))]
    y, by_q, _ = readings(bench.system, sensors).read(q, np.zeros_like(q))
    return y, by_q


def channel_labels(sensors: Sensors) -> tuple[str, ...]:
    """Sensor and component of every channel, as in summary numbers."""
    return tuple(f"{name}.{i}" for name in sensors.channels for i in range(1, 1 + sensors.count(name)))


def channel_units(config: BenchConfig, sensors: Sensors) -> tuple[str, ...]:
    """Units of all channels."""
    units: list[str] = []
    for name in sensors.channels:
        of_one = units_of(config.sensors[name])
        units += of_one * (sensors.count(name) // len(of_one))
    return tuple(units)


def unit_of(entry: StatedSensor) -> str:
    """Unit, or units, of a sensor's readings."""
    return " or ".join(dict.fromkeys(units_of(entry)))


def dataset_units(config: BenchConfig, loads: Iterable[str]) -> dict[str, str]:
    """Units of datasets of sensors and of these loads."""
    units = {f"sensor {name}": unit_of(entry) for name, entry in config.sensors.items()}
    return units | {f"input {name}": unit for name, unit in load_units(config, loads).items()}


INSTALLATION_STREAM = 5
"""Last word of the seed for sampled installation errors."""


@dataclass(frozen=True)
class Toleranced:
    """A strain sensor of the filter with its gauges; slope (channels, k, r): σ times the change of its rows by each of k
    errors."""

    name: str
    on: BondedGauges
    slope: np.ndarray
    zeroed: bool


def tolerances_of_gauges(config: BenchConfig) -> InstallationStd:
    """σ of gauge installation from `estimate.tolerances`."""
    return installation_std(None if config.estimate is None else config.estimate.tolerances)


def linear_tolerances(config: BenchConfig) -> dict[str, float]:
    """First-order installation error → σ, for tolerances above zero."""
    std = tolerances_of_gauges(config).by_name
    return {name: value for name, value in std.items() if value > 0 and name not in SECOND}


def toleranced(bench: Bench, used: Sensors) -> tuple[Toleranced, ...]:
    """Installation errors of every strain sensor of the filter: position and angle per gauge, gain and transverse sensitivity per
    grid."""
    sigma, position = linear_tolerances(bench.config), tolerances_of_gauges(bench.config).position
    errors = []
    for name, on in used.bonded.items() if sigma else ():
        gauges = on.gauges
        with blame(f"sensors.{name}.gauges"):
            felt = sensitivity_rows(on.mesh.position, gauges, on.basis, position, facets=on.facets)
        slope = [np.zeros((0, len(gauges), on.basis.shape[1]))]
        for key, value in sigma.items():
            rows, owner = value * getattr(felt, key), gauges.gauge if key in COMMON else np.arange(len(gauges))
            every = np.array([np.where((owner == each)[:, None], rows, 0.0) for each in np.unique(owner)])
            slope.append(every[every.any(axis=(1, 2))])
        zeroed = bool(used.zeroed[used.channels[name]].any())
        errors.append(Toleranced(name, on, np.swapaxes(np.concatenate(slope), 0, 1), zeroed))
    return tuple(errors)


def rows_of(
    bench: Bench, used: Sensors, sensors: tuple[Toleranced, ...], zero: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """D (m, k, n), o (m, k): the k errors of all sensors add (D q + o) ν to every channel, ν in σ; zero (n,): q at zeroing."""
    m, n = len(used.zeroed), bench.system.size
    D, o = [np.zeros((m, 0, n))], [np.zeros((m, 0))]
    for sensor in sensors:
        rows = np.zeros((m, sensor.slope.shape[1], n))
        rows[used.channels[sensor.name], :, bench.system.modal(sensor.on.body)] = sensor.slope
        D.append(rows)
        o.append(-rows @ zero * sensor.zeroed)
    return np.concatenate(D, axis=1), np.concatenate(o, axis=1)


def misread(bench: Bench, used: Sensors, errors: tuple[Toleranced, ...], q: np.ndarray, runs: int) -> np.ndarray:
    """Sample installation errors per run and return the reading errors (T, runs, m), nonlinear in the errors; q (T + 1, 1 or
    runs, n): true motion."""
    std = tolerances_of_gauges(bench.config)
    added = np.zeros((len(q) - 1, runs, len(used.zeroed)))
    for run in range(runs):
        draw = np.random.default_rng((bench.config.seed, run, INSTALLATION_STREAM))
        for error in errors:
            on, count = error.on, len(error.on.gauges)
            free = replace(on.gauges, bonded=np.zeros(count, dtype=bool))
            eta = q[:, min(run, q.shape[1] - 1), bench.system.modal(on.body)]
            sampled, nominal = (sample_installation(free, sigma, draw) for sigma in (std, InstallationStd()))
            rows, meant = (
                installed_rows(on.mesh.position, free, on.basis, installation, facets=on.facets)[0]
                for installation in (sampled, nominal)
            )
            added[:, run, used.channels[error.name]] += (eta - eta[0] * error.zeroed)[1:] @ (rows - meant).T
    return added
