"""Where a bench starts: poses and velocities that its joints allow, or its static equilibrium."""

from __future__ import annotations

import math

import numpy as np

from strainsight.config.bench.bench import Simulate
from strainsight.errors import ConfigError, InfeasibleError, NumericalError, blame
from strainsight.experiment.bench.bench import Bench
from strainsight.multibody.coupled import coupled_modes, growth
from strainsight.multibody.initial import driven_slopes, project_position, project_velocity, state
from strainsight.multibody.products import relation_rows
from strainsight.multibody.sensors import RelationSensor, readings
from strainsight.multibody.static import static_equilibrium

SLIP = 0.01
"""Share of a velocity that the joints may take away."""
TURNED = 0.02
"""[rad] that the joints may turn a body."""


def start_of(bench: Bench, settings: Simulate, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses and velocities put onto the joints, where they are near them; or the static equilibrium from there."""
    given, rate = state(bench.system, bench.poses)
    with blame("joints"):
        q = project_position(bench.system, given, u)
    _refuse_opposite(bench, q, u)
    for name in bench.poses:
        own = bench.system.of[name]
        moved = float(np.linalg.norm((q - given)[own][:3]))
        turned = float(np.linalg.norm((q - given)[own][3:12])) / np.sqrt(2)
        if moved > settings.snap_tolerance or turned > TURNED:
            raise ConfigError(
                f"the joints move '{name}' by {moved:.4g} m and {turned:.3g} rad from its pose, beyond "
                f"{settings.snap_tolerance:g} m or {TURNED:g} rad",
                key=f"bodies.{name}.pose",
                remedy="correct the pose or the frames of its joints, or raise simulate.snap_tolerance",
            )
    _refuse_forceless(bench, q, u)
    if settings.start == "equilibrium":
        try:
            q, _ = static_equilibrium(bench.system, q, u, bench.theta)
        except (InfeasibleError, NumericalError) as error:
            remedy = f"{error.remedy}; or set simulate.start: as_given"
            raise type(error)(error.what, key="simulate.start", remedy=remedy) from error
        if not settings.allow_unstable:
            _refuse_unstable(bench, q, u)
        return q, project_velocity(bench.system, q, np.zeros_like(q), u)
    v = project_velocity(bench.system, q, rate, u)
    if bench.system.drives.names and not rate.any():
        return q, v  # the drives say how it moves
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


def _refuse_unstable(bench: Bench, q: np.ndarray, u: np.ndarray) -> None:
    """An equilibrium that nothing would stay in."""
    rate, body = growth(bench.system, coupled_modes(bench.system, q, np.zeros_like(q), u, bench.theta))
    if rate > 0:
        raise ConfigError(
            f"the equilibrium is unstable: '{body}' falls out of it, {math.e:.1f}-fold in {1 / rate:.3g} s",
            key="simulate.start",
            remedy="start from a pose that is nearer to a stable one, or set simulate.start: as_given or "
            "simulate.allow_unstable: true",
        )


def _refuse_opposite(bench: Bench, q: np.ndarray, u: np.ndarray) -> None:
    """Constraints hold axes parallel; that they point the same way only the pose can say. Nor do they tell a driven angle from
    the one half a turn on."""
    for name, slope in driven_slopes(bench.system, q, u):
        if slope > 0:
            raise ConfigError(
                "the second frame stands nearer to half a turn on from the driven angle than to it",
                key=f"joints.{name}",
                remedy="turn one of the frames or the body by half a turn, or add pi to the angle",
            )
    for joint in bench.system.joints:
        together = readings(bench.system, [RelationSensor(joint.name, joint.aligned)]).read(q, np.zeros_like(q))[0]
        for relation, cosine in zip(joint.aligned, together, strict=True):
            if cosine < 0:
                raise ConfigError(
                    f"{relation.name} point opposite ways",
                    key=f"joints.{joint.name}",
                    remedy="turn one of the frames by half a turn",
                )


def _refuse_forceless(bench: Bench, q: np.ndarray, u: np.ndarray) -> None:
    """A force that cannot be had where the bench starts."""
    rho = relation_rows(bench.system.products, q, np.zeros_like(q))[0]
    for element in bench.system.elements:
        try:
            own = np.concatenate([bench.theta[element.parameters], u[element.inputs]])
            element.force.law.load(rho[element.rows], np.zeros(len(rho[element.rows])), own)
        except NumericalError as error:
            raise ConfigError(
                f"at the start {error.what}", key=f"forces.{element.force.name}", remedy=error.remedy
            ) from error
