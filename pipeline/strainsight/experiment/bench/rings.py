"""What the bearings of a bench do in a simulation."""

from __future__ import annotations

import numpy as np

from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.connections import BearingForce
from strainsight.errors import ConfigError
from strainsight.experiment.bench.bench import Bench
from strainsight.multibody.bearing.element import ball_loads, bearing_load
from strainsight.multibody.sensors import RelationSensor, readings
from strainsight.multibody.simulate import Trajectory
from strainsight.ordering import first_of_largest
from strainsight.records.bench import RingMotion, WorstInstant
from strainsight.records.record import record_from


def rings_in_time(config: BenchConfig, bench: Bench, found: Trajectory) -> dict[str, RingMotion]:
    """Displacement and load of every bearing in time, and its balls at the instant of the highest pressure."""
    rings = {}
    for element in bench.system.elements:
        force = element.force
        stated = config.forces[force.name]
        if not isinstance(stated, BearingForce):
            continue
        bearing = bench.bearings[stated.bearing]
        own = readings(bench.system, [RelationSensor(force.name, force.relations[:5])])
        q = np.array([own.read(a, b)[0] for a, b in zip(found.q, found.v, strict=True)])
        balls = [ball_loads(bearing, each) for each in q]
        pressure = np.array([ball.pressure.max() for ball in balls])
        worst = first_of_largest(pressure)
        ellipse = max(float(ball.semi_axes.max()) for ball in balls)
        if ellipse > bearing.ball_diameter / 2:
            raise ConfigError(
                f"a contact ellipse reaches {1e3 * ellipse:.4g} mm at t = {found.time[worst]:g} s, beyond the ball",
                key=f"forces.{force.name}",
                remedy="no such bearing carries these loads: check their size and the preload",
            )
        rings[force.name] = RingMotion(
            displacement=q,
            load=np.array([bearing_load(bearing, each, slopes=False).force for each in q]),
            pressure=pressure,
            worst=record_from(WorstInstant, balls[worst], time=float(found.time[worst])),
        )
    return rings
