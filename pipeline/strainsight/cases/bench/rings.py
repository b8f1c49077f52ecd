"""What the bearings of a bench do in a simulation."""

from __future__ import annotations

from typing import Any

import numpy as np

from strainsight.cases.bench.bench import Bench
from strainsight.errors import ConfigError
from strainsight.multibody.bearing.element import ball_loads
from strainsight.multibody.sensors import RelationSensor, readings
from strainsight.multibody.simulate import Trajectory
from strainsight.workflow.output import Dataset, Scalar, Table


def rings_in_time(
    config: Any, bench: Bench, found: Trajectory
) -> tuple[dict[str, Dataset], dict[str, Scalar], tuple[Table, ...]]:
    """Displacement and load of every bearing in time, and its balls at the instant of the highest pressure."""
    datasets: dict[str, Dataset] = {}
    summary: dict[str, Scalar] = {}
    rows = []
    for element in bench.system.elements:
        force = element.force
        if config.forces[force.name].type != "bearing":
            continue
        name = force.name
        bearing = bench.bearings[config.forces[name].bearing]
        own = readings(bench.system, [RelationSensor(name, force.relations)])
        q = np.array([own.read(a, b)[0] for a, b in zip(found.q, found.v, strict=True)])
        balls = [ball_loads(bearing, each) for each in q]
        pressure = np.array([ball.pressure.max() for ball in balls])
        worst = int(np.argmax(pressure))
        ellipse = max(float(ball.semi_axes.max()) for ball in balls)
        if ellipse > bearing.ball_diameter / 2:
            raise ConfigError(
                f"a contact ellipse reaches {1e3 * ellipse:.4g} mm at t = {found.time[worst]:g} s, beyond the ball",
                key=f"forces.{name}",
                remedy="no such bearing carries these loads: check their size and the preload",
            )
        load = np.array([force.law.load(each, np.zeros(5), np.zeros(0)).F for each in q])
        place = f"/bearings/{name}"
        datasets |= {
            f"{place}/displacement": Dataset(
                q, "m or rad", "x, y, z, tilts about y, z of the inner ring (time × component)", ("/time", "")
            ),
            f"{place}/load": Dataset(load, "N or N m", "load on the inner ring (time × component)", ("/time", "")),
            f"{place}/pressure": Dataset(pressure, "Pa", "highest contact pressure at every instant", ("/time",)),
            f"{place}/worst/time": Dataset(np.array(found.time[worst]), "s", "instant of the highest pressure"),
            f"{place}/worst/force": Dataset(balls[worst].force, "N", "contact force then (ball × contact)"),
            f"{place}/worst/contact_angle": Dataset(
                balls[worst].contact_angle, "rad", "contact angle then (ball × contact)"
            ),
            f"{place}/worst/pressure": Dataset(balls[worst].pressure, "Pa", "contact pressure then (ball × contact)"),
        }
        summary[f"pressure.{name}"] = float(pressure.max())
        loaded = int((balls[worst].force > 0).any(axis=1).sum())
        rows.append(
            (name, f"{pressure.max() / 1e6:.5g} MPa", f"{found.time[worst]:.4g} s", f"{loaded} of {bearing.balls}")
        )
    table = Table("bearings at their highest pressure", ("bearing", "pressure", "at", "balls loaded"), tuple(rows))
    return datasets, summary, (table,) * bool(rows)
