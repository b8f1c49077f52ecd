"""The sensors of a bench, compiled for its system, and their readings as datasets."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from strainsight.cases.bench.bench import Bench, motion_sensor, strain_sensor
from strainsight.mesh.model import Mesh
from strainsight.multibody.sensors import Readings, StrainSensor, readings
from strainsight.records.bodies import ReducedBody
from strainsight.workflow.artefact import Artefact
from strainsight.workflow.output import Dataset, Table

MOTION_UNITS = {"position": "m", "velocity": "m/s"}


@dataclass(frozen=True)
class Sensors:
    """readings: all compiled, strains first; channels: sensor → its rows there; zeroed (k,): channels that are zeroed at the
    start; table: where gauges went."""

    readings: Readings
    channels: Mapping[str, slice]
    zeroed: np.ndarray
    table: tuple[Table, ...]


def sensors_of(
    config: Any,
    bench: Bench,
    reduced: Mapping[str, ReducedBody],
    meshes: Mapping[str, Mesh],
    placed: Artefact | None = None,
) -> Sensors:
    """All sensors of the config."""
    strains, others, zeroed, rows = [], [], [], []
    for name, entry in config.sensors.items():
        if entry.type != "strain":
            others.append(motion_sensor(name, entry, bench.frames))
            continue
        sensor, moved = strain_sensor(name, entry, reduced[entry.body], meshes[entry.body], placed)
        strains.append(sensor)
        zeroed += [bool(entry.zeroed)] * len(sensor.rows)
        rows += [(name, str(i), f"{1e3 * distance:.3g} mm") for i, distance in enumerate(moved, start=1)]
    compiled = readings(bench.system, [*strains, *others])
    still = np.zeros(len(compiled.channels), dtype=bool)
    still[: len(zeroed)] = zeroed
    table = Table("gauges, moved to the surface by", ("sensor", "gauge", "moved"), tuple(rows))
    return Sensors(compiled, _channels(compiled), still, (table,) * bool(rows))


def some_of(bench: Bench, sensors: Sensors, names: Collection[str]) -> Sensors:
    """Those of these names."""
    compiled = readings(bench.system, [own for own in sensors.readings.sensors if own.name in names])
    there = _channels(compiled)
    zeroed = np.concatenate([sensors.zeroed[sensors.channels[name]] for name in there])
    return Sensors(compiled, there, zeroed, ())


def _channels(compiled: Readings) -> dict[str, slice]:
    channels, at = {}, 0
    for own in compiled.sensors:
        count = len(own.rows) if isinstance(own, StrainSensor) else len(own.relations)
        channels[own.name] = slice(at, at + count)
        at += count
    return channels


def unit_of(entry: Any) -> tuple[str, str]:
    """Unit of a sensor's readings, and what they are."""
    if entry.type == "strain":
        return "strain", "strain of every gauge (time × gauge)"
    if entry.type == "relative":
        return "m or rad", "displacements x, y, z and tilts about y, z (time × component)"
    return MOTION_UNITS.get(entry.quantity, "1"), f"{entry.quantity} in global axes (time × xyz)"


def reading_datasets(config: Any, sensors: Sensors, measured: np.ndarray) -> dict[str, Dataset]:
    """/sensors/<name> of readings (time, all channels)."""
    datasets = {}
    for name, own in sensors.channels.items():
        unit, what = unit_of(config.sensors[name])
        datasets[f"/sensors/{name}"] = Dataset(measured[:, own], unit, what, ("/time", ""))
    return datasets
