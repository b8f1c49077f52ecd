"""Sensors: functions of the state with their Jacobians."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from strainsight.errors import InfeasibleError
from strainsight.multibody.bodies import Frame, constant
from strainsight.multibody.relations import Products, Relation, compile_products, place, relation_bends, relation_rows
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


def axis_sensor(name: str, frame: Frame, k: int) -> RelationSensor:
    """Axis k of a frame in global axes [-]."""
    along = (
        Relation(f"direction of the {'xyz'[k]} axis of {frame.name}", (constant(e),), (frame.axis(k),))
        for e in np.eye(3)
    )
    return RelationSensor(name, tuple(along))


@dataclass(frozen=True)
class Accelerometer:
    """p̈ − g of a frame's origin [m/s²], along its own axes or global ones, with or without the acceleration g of gravity."""

    name: str
    frame: Frame
    local_axes: bool = True
    gravity: bool = True


class Felt(NamedTuple):
    """Additional inputs of an accelerometer: v̇ (n,), and the acceleration of gravity (3,) [m/s²]."""

    acceleration: np.ndarray
    gravity: np.ndarray


Sensor = StrainSensor | RelationSensor | Accelerometer


@dataclass(frozen=True, eq=False)
class CompiledSensors:
    """Sensors of one system, compiled by `readings`: call `read`. channels: the name of every row; accelerometers: of every one
    its origin, then its three axes, as relations."""

    sensors: tuple[Sensor, ...]
    channels: tuple[str, ...]
    products: Products
    rate: np.ndarray
    strain: np.ndarray
    accelerometers: tuple[Accelerometer, ...]
    carried: Products

    @property
    def accelerated(self) -> slice:
        """Rows of the accelerometers, which come last."""
        return slice(len(self.channels) - 3 * len(self.accelerometers), len(self.channels))

    def read(self, q: np.ndarray, v: np.ndarray, felt: Felt | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """y (k,), ∂y/∂q, ∂y/∂v (k, n): strains first, then relations, then accelerometers, each in the order given. felt: for the
        last, whose slopes are those with it as it is (`accelerations.measured` has what it depends on, too)."""
        first, last, moving = len(self.strain), self.accelerated.start, bool(self.rate.any())
        y, slopes = np.empty(len(self.channels)), np.empty((len(self.channels), len(q)))
        rates = np.zeros_like(slopes)
        y[:first], slopes[:first] = self.strain @ q, self.strain
        if len(self.rate):
            y[first:last], slopes[first:last], G_rate, *_ = relation_rows(self.products, q, v)
        if moving:
            rates[first:last][self.rate] = slopes[first:last][self.rate]
            y[first:last][self.rate] = rates[first:last][self.rate] @ v
            slopes[first:last][self.rate] = G_rate[self.rate]
        if self.accelerometers:
            assert felt is not None  # required with accelerometers
            y[last:], slopes[last:], rates[last:], *_ = self.accelerations(q, v, felt)
        return y, slopes, rates

    def accelerations(
        self, q: np.ndarray, v: np.ndarray, felt: Felt
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """y (k,), ∂y/∂q, ∂y/∂v, ∂y/∂v̇ (k, n), ∂y/∂g (k, 3) of the accelerometers, A the axes they read along: y = A (∇p v̇ +
        vᵀ∇²p v − g)"""
        count, n = 3 * len(self.accelerometers), len(q)
        y, by_g = np.empty(count), np.zeros((count, 3))
        by_q, by_v, by_a = np.empty((3, count, n))
        rho, G, G_rate, *_ = relation_rows(self.carried, q, v)
        bends = relation_bends(self.carried, q, v, felt.acceleration)
        for i, accelerometer in enumerate(self.accelerometers):
            at, p, axes = slice(3 * i, 3 * i + 3), slice(12 * i, 12 * i + 3), slice(12 * i + 3, 12 * i + 12)
            A = rho[axes].reshape(3, 3) if accelerometer.local_axes else np.eye(3)
            a = G[p] @ felt.acceleration + G_rate[p] @ v
            if accelerometer.gravity:
                a, by_g[at] = a - felt.gravity, -A
            y[at], by_q[at], by_v[at], by_a[at] = A @ a, A @ bends[p], 2 * A @ G_rate[p], A @ G[p]
            if accelerometer.local_axes:
                by_q[at] += np.einsum("kjn,j->kn", G[axes].reshape(3, 3, n), a)
        return y, by_q, by_v, by_a, by_g


def readings(system: System, sensors: Sequence[Sensor]) -> CompiledSensors:
    """The sensors compiled for a system. Raises InfeasibleError for strain rows that do not fit their body."""
    strain: list[np.ndarray] = []
    relations: list[Relation] = []
    rate: list[bool] = []
    channels: list[str] = []
    for sensor in sensors:
        if isinstance(sensor, StrainSensor):
            if sensor.body not in system.of:
                raise InfeasibleError(f"sensor {sensor.name}: body {sensor.body} not found")
            eta, rows = system.modal(sensor.body), np.atleast_2d(np.asarray(sensor.rows, dtype=float))
            if rows.shape[1] != eta.stop - eta.start:
                raise InfeasibleError(
                    f"sensor {sensor.name}: the strain operator has {rows.shape[1]} columns, "
                    f"but body {sensor.body} has {eta.stop - eta.start} modes"
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
    accelerometers = tuple(sensor for sensor in sensors if isinstance(sensor, Accelerometer))
    felt: list[Relation] = []
    for accelerometer in accelerometers:
        felt += position_sensor(accelerometer.name, accelerometer.frame).relations
        for k in range(3):
            felt += axis_sensor(accelerometer.name, accelerometer.frame, k).relations
        channels += [f"{accelerometer.name} {k + 1}" for k in range(3)]
    return CompiledSensors(
        tuple(sensors),
        tuple(channels),
        compile_products(relations, system.bodies),
        np.array(rate, dtype=bool),
        np.concatenate(strain) if strain else np.zeros((0, system.size)),
        accelerometers,
        compile_products(felt, system.bodies),
    )
