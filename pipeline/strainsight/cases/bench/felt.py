"""What accelerometers read, and what joints and drives carry, in a run of a bench."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from strainsight.cases.bench.bench import Bench
from strainsight.config.bench.bench import AccelerationSensor, BenchConfig, ReactionSensor
from strainsight.multibody.accelerations import Instant, instant, reaction
from strainsight.multibody.forces import Gravity
from strainsight.multibody.laws.turning import TurningGravity
from strainsight.multibody.sensors import axis_sensor, position_sensor, readings
from strainsight.multibody.simulate import Trajectory
from strainsight.records.simulated import DriveMotion

Reading = Callable[[np.ndarray, np.ndarray, np.ndarray, Instant], np.ndarray]
"""q, v, u and what (1.3) says there → the components of a sensor."""


def felt(
    config: BenchConfig, bench: Bench, found: Trajectory, drives: Callable[[np.ndarray], np.ndarray]
) -> tuple[dict[str, np.ndarray], dict[str, DriveMotion]]:
    """Sensors of acceleration and reaction (T, components), and the driven joints; none where the config has neither."""
    sensors: dict[str, Reading] = {}
    for name, entry in config.sensors.items():
        if isinstance(entry, AccelerationSensor):
            sensors[name] = _acceleration(bench, entry)
        elif isinstance(entry, ReactionSensor):
            sensors[name] = _reaction(config, bench, entry)
    names = bench.system.drives.names
    if not sensors and not names:
        return {}, {}
    p = drives(found.time)
    read: dict[str, list[np.ndarray]] = {name: [] for name in sensors}
    force = np.empty((len(found.time), len(names)))
    for k, (q, v, u) in enumerate(zip(found.q, found.v, found.u, strict=True)):
        now = instant(bench.system, q, v, u, bench.theta, p[:, 2, k])
        force[k] = now.drive
        for name, own in sensors.items():
            read[name].append(own(q, v, u, now))
    return {name: np.array(values) for name, values in read.items()}, {
        name: DriveMotion(position=p[i, 0], rate=p[i, 1], force=force[:, i]) for i, name in enumerate(names)
    }


def _acceleration(bench: Bench, entry: AccelerationSensor) -> Reading:
    frame = bench.frames[entry.frame]
    own = [position_sensor(entry.frame, frame, rate=True), *(axis_sensor(entry.frame, frame, k) for k in range(3))]
    compiled = readings(bench.system, own)
    steady = sum((f.acceleration for f in bench.system.forces if isinstance(f, Gravity)), np.zeros(3))
    laws = [(e.force.law, e.inputs[0]) for e in bench.system.elements if len(e.inputs)]
    turning = [(law, k) for law, k in laws if isinstance(law, TurningGravity)]

    def at(q: np.ndarray, v: np.ndarray, u: np.ndarray, now: Instant) -> np.ndarray:
        y, by_q, by_v = compiled.read(q, v)
        a = (by_q @ v + by_v @ now.acceleration)[:3]
        if entry.gravity:
            a = a - steady - sum(law.at(u[k])[0] for law, k in turning)
        return np.asarray(y[3:].reshape(3, 3) @ a if entry.axes == "own" else a)

    return at


def _reaction(config: BenchConfig, bench: Bench, entry: ReactionSensor) -> Reading:
    joint = next(own for own in bench.system.joints if own.name == entry.joint)
    i, j = (bench.frames[frame] for frame in config.joints[entry.joint].frames)
    return lambda q, v, u, now: reaction(bench.system, joint, i, j, q, now.lam, u)
