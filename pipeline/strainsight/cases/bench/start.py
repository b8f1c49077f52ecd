"""Where a bench starts: poses and velocities that its joints allow, or its static equilibrium."""

from __future__ import annotations

from typing import Any

import numpy as np

from strainsight.cases.bench.bench import Bench
from strainsight.errors import ConfigError, InfeasibleError, NumericalError, blame
from strainsight.multibody.forces import SpringDamper
from strainsight.multibody.initial import project_position, project_velocity, state
from strainsight.multibody.relations import distance_squared, dot
from strainsight.multibody.sensors import RelationSensor, readings
from strainsight.multibody.static import static_equilibrium

SLIP = 0.01
"""Share of a velocity that the joints may take away."""
TURNED = 0.02
"""[rad] that the joints may turn a body."""
SHORTEST = 1e-6
"""[m] between the ends of a spring below which its direction is rounding."""
PARALLEL = {"revolute": (2,), "prismatic": (0, 1, 2), "fixed": (0, 1, 2)}
"""Axes that a joint keeps parallel, of its frames as the kernel has them: z along the joint's own axis."""


def start_of(bench: Bench, settings: Any, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses and velocities put onto the joints, where they are near them; or the static equilibrium from there."""
    given, rate = state(bench.system, bench.poses)
    with blame("joints"):
        q = project_position(bench.system, given)
    _refuse_opposite(bench, q)
    for name in bench.poses:
        own = bench.system.of[name]
        moved = float(np.linalg.norm((q - given)[own][:3]))
        turned = float(np.linalg.norm((q - given)[own][3:12])) / np.sqrt(2)
        if moved > settings.snap_tolerance or turned > TURNED:
            raise ConfigError(
                f"the joints move '{name}' by {moved:.4g} m and {turned:.3g} rad from its pose, beyond "
                f"{settings.snap_tolerance:g} m or {TURNED:g} rad",
                key=f"bodies.{name}.pose",
                remedy="mend the pose or the frames of its joints, or raise simulate.snap_tolerance",
            )
    _refuse_coincident(bench, q)
    if settings.start == "equilibrium":
        try:
            q, _ = static_equilibrium(bench.system, q, u, bench.theta)
        except NumericalError as error:
            remedy = f"{error.remedy}; or set simulate.start: as_given"
            raise InfeasibleError(error.what, key="simulate.start", remedy=remedy) from error
        return q, np.zeros_like(q)
    v = project_velocity(bench.system, q, rate)
    d = bench.system.metric
    for name in bench.poses:
        own = bench.system.of[name]
        change, whole = (float(np.linalg.norm((d * x)[own])) for x in (v - rate, rate))
        if change > SLIP * max(whole, float(np.linalg.norm(d * rate)) * SLIP):
            raise ConfigError(
                f"the joints do not let '{name}' move as its velocity and spin say: {100 * change / max(whole, change):.3g} % of "
                "it is left out",
                key=f"bodies.{name}.velocity",
                remedy="give velocities that the joints allow: a body that turns about a pivot moves its origin too",
            )
    return q, v


def _refuse_opposite(bench: Bench, q: np.ndarray) -> None:
    """Constraints hold axes parallel; that they point the same way only the pose can say."""
    for joint in bench.system.joints:
        kind, i, j = bench.joined[joint.name]
        for k in PARALLEL.get(kind, ()):
            sensor = readings(bench.system, [RelationSensor(joint.name, (dot(i, k, j, k),))])
            if sensor.read(q, np.zeros_like(q))[0][0] < 0:
                raise ConfigError(
                    f"the axes of '{i.name}' and '{j.name}' point opposite ways",
                    key=f"joints.{joint.name}",
                    remedy="turn one of the frames by half a turn",
                )


def _refuse_coincident(bench: Bench, q: np.ndarray) -> None:
    for force in bench.system.forces:
        if isinstance(force, SpringDamper):
            sensor = readings(
                bench.system, [RelationSensor(force.name, (distance_squared(force.first, force.second),))]
            )
            apart = np.sqrt(max(float(sensor.read(q, np.zeros_like(q))[0][0]), 0.0))
            if apart < SHORTEST:
                raise ConfigError(
                    f"its end points '{force.first.name}' and '{force.second.name}' are {apart:.2g} m apart at the start, "
                    f"below {SHORTEST:g} m: the spring has no direction",
                    key=f"forces.{force.name}.frames",
                    remedy="name frames that are apart at the start",
                )
