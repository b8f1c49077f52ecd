"""The sensors of a bench, compiled for its system, and its gauges as they may be installed."""

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
    drawn_installation,
    installed_rows,
    sensitivity_rows,
)
from strainsight.sensors.rows import channel_rows


@dataclass(frozen=True)
class BondedGauges:
    """Gauges of a strain sensor on the nearest places of its body's surface: mesh and facets of that, basis (3 nodes, r); moved
    (gauges,) [m]: how far each was moved there."""

    body: str
    mesh: Mesh
    facets: Facets
    basis: np.ndarray
    gauges: Candidates
    moved: np.ndarray


@dataclass(frozen=True)
class Sensors:
    """readings: all compiled, strains first; channels: sensor → its rows there; zeroed (k,): channels that are zeroed at the
    start; bonded: the gauges of every strain sensor."""

    readings: CompiledSensors
    channels: Mapping[str, slice]
    zeroed: np.ndarray
    bonded: Mapping[str, BondedGauges]

    def count(self, name: str) -> int:
        """Channels of a sensor."""
        return self.channels[name].stop - self.channels[name].start


def sensors_of(bench: Bench) -> Sensors:
    """All sensors of the config that see the state."""
    strains, others, bonded_gauges = [], [], {}
    for name, entry in bench.config.sensors.items():
        if isinstance(entry, StrainSensorSection):
            on = bonded_gauges[name] = _bonded(bench, name, entry)
            with blame(f"sensors.{name}.{'gauges' if entry.layout is None else 'layout'}"):
                rows = channel_rows(on.mesh.position, on.gauges, on.basis, facets=on.facets)
                strains.append(StrainRows(name, on.body, rows))
        elif not isinstance(entry, ReactionSensor):
            others.append(motion_sensor(name, entry, bench.frames))
    # in the order of their rows
    others.sort(key=lambda sensor: isinstance(sensor, Accelerometer))
    return _compiled(bench, [*strains, *others], bonded_gauges)


def some_of(bench: Bench, sensors: Sensors, names: Collection[str]) -> Sensors:
    """Those of these names."""
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
    """Of every state in q, v (T, n) under u (T, width), p̈ of the drives second (T, nd)."""
    states = zip(q, v, u, strict=True)
    return [instant(bench.system, *now, bench.theta, p) for now, p in zip(states, second, strict=True)]


def read_in_time(
    bench: Bench, sensors: CompiledSensors, q: np.ndarray, v: np.ndarray, u: np.ndarray, instants: Sequence[Instant]
) -> np.ndarray:
    """What all sensors read (T, channels) in a run; instants: not read without accelerometers."""
    if not sensors.accelerometers:
        return np.array([sensors.read(*now)[0] for now in zip(q, v, strict=True)])
    felt = (Felt(now.acceleration, gravity_at(bench.system, at)) for now, at in zip(instants, u, strict=True))
    return np.array([sensors.read(*now)[0] for now in zip(q, v, felt, strict=True)])


def motion_sensor(name: str, entry: StatedSensor, frames: Mapping[str, Frame]) -> Sensor:
    """A sensor of relative or absolute motion."""
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
    """Place and axes of a frame (12,), and their slopes by q (12, n)."""
    sensors = [position_sensor(frame.name, frame), *(axis_sensor(frame.name, frame, k) for k in range(3))]
    y, by_q, _ = readings(bench.system, sensors).read(q, np.zeros_like(q))
    return y, by_q


def channel_labels(sensors: Sensors) -> tuple[str, ...]:
    """Sensor and component of every channel, as numbers of a summary name them."""
    return tuple(f"{name}.{i}" for name in sensors.channels for i in range(1, 1 + sensors.count(name)))


def channel_units(config: BenchConfig, sensors: Sensors) -> tuple[str, ...]:
    """Unit of every channel."""
    units: list[str] = []
    for name in sensors.channels:
        of_one = units_of(config.sensors[name])
        units += of_one * (sensors.count(name) // len(of_one))
    return tuple(units)


def unit_of(entry: StatedSensor) -> str:
    """Unit of a sensor's readings."""
    return " or ".join(dict.fromkeys(units_of(entry)))


def dataset_units(config: BenchConfig, loads: Iterable[str]) -> dict[str, str]:
    """What records of a bench ask the unit of: its sensors, and these loads."""
    units = {f"sensor {name}": unit_of(entry) for name, entry in config.sensors.items()}
    return units | {f"input {name}": unit for name, unit in load_units(config, loads).items()}


DRAWN = 5
"""Last word of the seed by which a seed's gauges are installed."""


@dataclass(frozen=True)
class Toleranced:
    """A strain sensor of the filter: where its gauges are; slope (channels, k, r): σ times what each of k errors adds to its
    rows; zeroed."""

    name: str
    on: BondedGauges
    slope: np.ndarray
    zeroed: bool


def tolerances_of_gauges(config: BenchConfig) -> InstallationStd:
    """By `estimate.tolerances`."""
    return installation_std(None if config.estimate is None else config.estimate.tolerances)


def linear_tolerances(config: BenchConfig) -> dict[str, float]:
    """Error of installation → its σ, of those that `estimate.tolerances` leaves open, to first order."""
    std = tolerances_of_gauges(config).by_name
    return {name: value for name, value in std.items() if value > 0 and name not in SECOND}


def toleranced(bench: Bench, used: Sensors) -> tuple[Toleranced, ...]:
    """Of every strain sensor of the filter its `linear_tolerances`: place and turn of a gauge, all grids of which move as one,
    gain and transverse sensitivity of each grid."""
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
    """D (m, k, n), o (m, k): what the k errors of all sensors add to every channel, in σ of them, (D q + o) ν; zero (n,): q where
    zeroed sensors were zeroed."""
    m, n = len(used.zeroed), bench.system.size
    D, o = [np.zeros((m, 0, n))], [np.zeros((m, 0))]
    for sensor in sensors:
        rows = np.zeros((m, sensor.slope.shape[1], n))
        rows[used.channels[sensor.name], :, bench.system.modal(sensor.on.body)] = sensor.slope
        D.append(rows)
        o.append(-rows @ zero * sensor.zeroed)
    return np.concatenate(D, axis=1), np.concatenate(o, axis=1)


def misread(bench: Bench, used: Sensors, errors: tuple[Toleranced, ...], q: np.ndarray, runs: int) -> np.ndarray:
    """What gauges as they are installed read beside what they are taken for (T, runs, m), drawn anew for every run; q
    (T + 1, 1 or runs, n): the true motion. Exact in the errors, to which the filter is linear."""
    std = tolerances_of_gauges(bench.config)
    added = np.zeros((len(q) - 1, runs, len(used.zeroed)))
    for run in range(runs):
        draw = np.random.default_rng((bench.config.seed, run, DRAWN))
        for error in errors:
            on, count = error.on, len(error.on.gauges)
            free = replace(on.gauges, bonded=np.zeros(count, dtype=bool))
            eta = q[:, min(run, q.shape[1] - 1), bench.system.modal(on.body)]
            as_drawn, plain = (drawn_installation(free, sigma, draw) for sigma in (std, InstallationStd()))
            rows, meant = (
                installed_rows(on.mesh.position, free, on.basis, installation, facets=on.facets)[0]
                for installation in (as_drawn, plain)
            )
            added[:, run, used.channels[error.name]] += (eta - eta[0] * error.zeroed)[1:] @ (rows - meant).T
    return added
