"""Sensors: functions of the state with their Jacobians."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.errors import InfeasibleError
from strainsight.multibody.bodies import modes, moves
from strainsight.multibody.frames import Frame, constant
from strainsight.multibody.products import Products, compile_products, relation_rows
from strainsight.multibody.relations import Relation, place
from strainsight.multibody.system import System


@dataclass(frozen=True)
class StrainSensor:
    """ε = rows η of a flexible body; rows (k, n) [strain per unit of η]."""

    name: str
    body: str
    rows: np.ndarray


@dataclass(frozen=True)
class RelationSensor:
    """The values ρ(q) of relations between frames, or their rates ρ̇ = ∇ρ·v: displacements of a bearing, distances."""

    name: str
    relations: tuple[Relation, ...]
    rate: bool = False


def position_sensor(name: str, frame: Frame, rate: bool = False) -> RelationSensor:
    """x, y, z of a frame's origin in global axes [m], or its velocity [m/s]."""
    return RelationSensor(name, tuple(place(frame, e) for e in np.eye(3)), rate)


def axis_sensor(name: str, frame: Frame, k: int, rate: bool = False) -> RelationSensor:
    """Axis k of a frame in global axes [-], or its rate [1/s]."""
    along = (Relation(f"axis {k} of {frame.name}", (constant(e),), (frame.axis(k),)) for e in np.eye(3))
    return RelationSensor(name, tuple(along), rate)


Sensor = StrainSensor | RelationSensor


@dataclass(frozen=True, eq=False)
class Readings:
    """Sensors of one system, compiled by `readings`: call `read`. channels: the name of every row."""

    sensors: tuple[Sensor, ...]
    channels: tuple[str, ...]
    products: Products
    rate: np.ndarray
    strain: np.ndarray

    def read(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """y (k,), ∂y/∂q, ∂y/∂v (k, n): strains first, then relations, each in the order given."""
        first, moving = len(self.strain), bool(self.rate.any())
        y, slopes = np.empty(len(self.channels)), np.empty((len(self.channels), len(q)))
        rates = np.zeros_like(slopes)
        y[:first], slopes[:first] = self.strain @ q, self.strain
        if len(self.rate):
            y[first:], slopes[first:], G_rate, *_ = relation_rows(self.products, q, v)
        if moving:
            rates[first:][self.rate] = slopes[first:][self.rate]
            y[first:][self.rate] = rates[first:][self.rate] @ v
            slopes[first:][self.rate] = G_rate[self.rate]
        return y, slopes, rates


def readings(system: System, sensors: Sequence[Sensor]) -> Readings:
    """The sensors compiled for a system. Raises InfeasibleError for strain rows that do not fit their body."""
    strain: list[np.ndarray] = []
    relations: list[Relation] = []
    rate: list[bool] = []
    channels: list[str] = []
    for sensor in sensors:
        if isinstance(sensor, StrainSensor):
            if sensor.body not in system.of:
                raise InfeasibleError(f"{sensor.name}: there is no body {sensor.body}")
            eta, rows = system.modal(sensor.body), np.atleast_2d(np.asarray(sensor.rows, dtype=float))
            if rows.shape[1] != eta.stop - eta.start:
                raise InfeasibleError(
                    f"{sensor.name}: strain rows of {rows.shape[1]} coordinates "
                    f"on body {sensor.body}, which has {eta.stop - eta.start}"
                )
            whole = np.zeros((len(rows), system.size))
            whole[:, eta] = rows
            strain.append(whole)
            channels += [sensor.name] if len(rows) == 1 else [f"{sensor.name} {k + 1}" for k in range(len(rows))]
    for sensor in sensors:
        if isinstance(sensor, RelationSensor):
            relations += sensor.relations
            rate += [sensor.rate] * len(sensor.relations)
            channels += [f"{sensor.name}: {relation.name}" for relation in sensor.relations]
    places = {b.name: system.of[b.name].start for b in system.bodies if moves(b)}
    etas = {b.name: system.of[b.name].stop - modes(b) for b in system.bodies}
    return Readings(
        tuple(sensors),
        tuple(channels),
        compile_products(relations, places, etas),
        np.array(rate, dtype=bool),
        np.concatenate(strain) if strain else np.zeros((0, system.size)),
    )
