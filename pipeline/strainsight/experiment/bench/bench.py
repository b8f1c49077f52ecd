"""Build the multibody system of a bench config, and its initial state."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from strainsight.config.bench import bodies as stated_bodies
from strainsight.config.bench import connections as stated
from strainsight.config.bench.bench import BenchConfig
from strainsight.errors import ConfigError, InfeasibleError, NumericalError, StrainsightError, blame
from strainsight.experiment.bench.bearings import bearings_of
from strainsight.mesh.model import Mesh
from strainsight.multibody.bearing.element import BearingLaw, Drag, ring_relations
from strainsight.multibody.bearing.geometry import PARAMETERS, Bearing
from strainsight.multibody.bodies import Body, FlexibleBody, Frame, RigidBody
from strainsight.multibody.coupled import coupled_modes, growth
from strainsight.multibody.forces import Force, Gravity, PointForce, PointMoment, RelativeElement
from strainsight.multibody.initial import (
    Pose,
    constraints_at,
    driven_slopes,
    project_position,
    project_velocity,
    state,
    static_equilibrium,
)
from strainsight.multibody.joints import JOINTS, Joint
from strainsight.multibody.laws import LAWS, Friction, follower_force, follower_moment, turning_gravity
from strainsight.multibody.relations import cosine, relation_rows
from strainsight.multibody.sensors import RelationSensor, readings
from strainsight.multibody.system import Element, System, assemble
from strainsight.records.bench import ReducedBody
from strainsight.records.bench_placed import BenchPlaced
from strainsight.sensors.surface import unit_vector

Between = stated.Joint | stated.Law
"""Connection between two frames."""
Connection = TypeVar("Connection", Joint, Force)


@dataclass(frozen=True)
class Bench:
    """Multibody model of a config.

    reduced, meshes: of flexible bodies; placed: layouts, None if no sensor uses one; frames, bearings: by name; poses: of the
    bodies at the start; theta (nθ,): values of the system parameters, those of a bearing named BEARING.PROPERTY."""

    config: BenchConfig
    reduced: Mapping[str, ReducedBody]
    meshes: Mapping[str, Mesh]
    placed: BenchPlaced | None
    system: System
    frames: Mapping[str, Frame]
    bearings: Mapping[str, Bearing]
    poses: Mapping[str, Pose]
    theta: np.ndarray

    @property
    def coordinates(self) -> dict[str, np.ndarray]:
        """Body → range of its coordinates (2,): first, and last plus one."""
        return {name: np.array([part.start, part.stop]) for name, part in self.system.of.items()}

    @property
    def rings(self) -> dict[str, tuple[Element, Bearing]]:
        """Bearing force → its element in the system, and the bearing."""
        elements, forces = {element.force.name: element for element in self.system.elements}, self.config.forces
        bearings = {name: force.bearing for name, force in forces.items() if isinstance(force, stated.BearingForce)}
        return {name: (elements[name], self.bearings[bearing]) for name, bearing in bearings.items()}

    def at(self, theta: np.ndarray) -> Bench:
        """Replace the parameters (nθ,)."""
        return replace(self, theta=theta)

    def simulated(self, **settings: object) -> Bench:
        """Replace settings of `simulate`."""
        simulate = self.config.simulate.model_copy(update=settings)
        return replace(self, config=self.config.model_copy(update={"simulate": simulate}))


def bench_of(
    config: BenchConfig,
    reduced: Mapping[str, ReducedBody],
    meshes: Mapping[str, Mesh],
    placed: BenchPlaced | None = None,
    free: Mapping[str, Sequence[str]] | None = None,
) -> Bench:
    """Build the bench; free: bearing → properties that are parameters of the system; others: see `Bench`."""
    bodies: list[Body] = []
    poses: dict[str, Pose] = {}
    for name, entry in config.bodies.items():
        with blame(f"bodies.{name}"):
            bodies.append(_body(name, entry, reduced))
        supported = entry.type == "flexible" and reduced[name].clamped
        if supported and (any(entry.velocity) or any(entry.spin) or entry.pose.origin != (0.0, 0.0, 0.0)):
            raise ConfigError(
                f"the body '{name}' has a pose, velocity or spin, but the supports of its deck fix it to the ground",
                key=f"bodies.{name}",
                remedy="Remove `pose`, `velocity` and `spin` of the body, or remove the supports from its deck.",
            )
        if not supported:
            poses[name] = Pose(
                np.array(entry.pose.origin), axes_of(entry.pose), np.array(entry.velocity), np.array(entry.spin)
            )
    frames = {name: _frame(name, entry, reduced, meshes) for name, entry in config.frames.items()}
    bearings = bearings_of(config.bearings)
    joints = [_between(JOINTS, name, entry, frames) for name, entry in config.joints.items()]
    forces = [_force(name, entry, frames, bearings, free or {}, bodies) for name, entry in config.forces.items()]
    with blame("joints"):
        system = assemble(bodies, joints, forces)
    values = {key: modulus.value for entry in config.flexible.values() for key, modulus in entry.moduli.items()}
    for name, bearing in bearings.items():
        values |= {f"{name}.{key}": value for key, value in zip(PARAMETERS, bearing.parameters, strict=True)}
    theta = np.array([float(values[name]) for name in system.parameters])
    return Bench(config, reduced, meshes, placed, system, frames, bearings, poses, theta)


def axes_of(pose: stated_bodies.PoseSection) -> np.ndarray:
    """Right-handed orthonormal axes (3, 3), columns x, y, z, from the x axis and the perpendicular part of the y axis."""
    x, y = unit_vector(pose.x_axis, "the x axis"), np.asarray(pose.y_axis, dtype=float)
    y = unit_vector((y - (x @ y) * x).tolist(), "the y axis")
    return np.column_stack([x, y, np.cross(x, y)])


def _body(name: str, entry: stated_bodies.Body, reduced: Mapping[str, ReducedBody]) -> Body:
    """Build a body; converts the inertia of a rigid body from the centre of mass to the origin."""
    if entry.type == "flexible":
        body = reduced[name]
        return FlexibleBody(name, body.clamped, body.stiffness, body.mass, body.damping, body.inertia)
    I, c = entry.inertia, np.asarray(entry.centre, dtype=float)
    central = np.array([[I.xx, I.xy, I.xz], [I.xy, I.yy, I.yz], [I.xz, I.yz, I.zz]])
    return RigidBody(name, float(entry.mass), c, central + entry.mass * (c @ c * np.eye(3) - np.outer(c, c)))


def _frame(
    name: str, entry: stated_bodies.FrameSection, reduced: Mapping[str, ReducedBody], meshes: Mapping[str, Mesh]
) -> Frame:
    axes = axes_of(entry.pose)
    if entry.body == "ground":
        return Frame(name, None, np.array(entry.pose.origin), axes)
    if entry.body not in reduced:
        return Frame(name, entry.body, np.array(entry.pose.origin), axes)
    assert entry.node is not None  # required by the config on a flexible body
    with blame(f"frames.{name}.node"):
        mesh = meshes[entry.body]
        origin = mesh.position[mesh.node_index(entry.node)]
        rows = reduced[entry.body].interface[str(entry.node)]
    return Frame(name, entry.body, origin, axes, rows[:3], rows[3:])


def _between(
    kinds: Mapping[str, Callable[..., Connection]], name: str, entry: Between, frames: Mapping[str, Frame]
) -> Connection:
    """Build a joint or force law between two frames from its config section."""
    keys = {key: value for key, value in dict(entry).items() if key not in ("type", "frames", "drive", "signal")}
    return kinds[entry.type](name, *(frames[frame] for frame in entry.frames), **keys)


def _force(
    name: str,
    entry: stated.Force,
    frames: Mapping[str, Frame],
    bearings: Mapping[str, Bearing],
    free: Mapping[str, Sequence[str]],
    bodies: Sequence[Body],
) -> Force:
    match entry:
        case stated.GravitySection():
            if entry.turns is None:
                return Gravity(np.array(entry.acceleration), name)
            return turning_gravity(
                name, bodies, np.array(entry.acceleration), unit_vector(entry.turns.axis, "the axis")
            )
        case stated.PointForceSection() | stated.PointMomentSection():
            direction = unit_vector(entry.direction, "the direction")
            if entry.axes == "frame":
                follower = follower_force if entry.type == "force" else follower_moment
                return follower(name, frames[entry.frame], direction)
            kind = PointForce if entry.type == "force" else PointMoment
            return kind(name, frames[entry.frame], direction[:, None], (name,))
        case stated.BearingForce():
            outer, inner = frames[entry.outer], frames[entry.inner]
            properties = tuple(free.get(entry.bearing, ()))
            names = tuple(f"{entry.bearing}.{key}" for key in properties)
            d = entry.drag
            damping = np.array([d.axial, d.radial, d.radial, d.tilt, d.tilt], dtype=float)
            drag = Drag(d.moment, d.coefficient, d.viscous, d.speed, damping)
            law = BearingLaw(bearings[entry.bearing], properties, drag)
            return RelativeElement(name, ring_relations(outer, inner, drag), law, names, (cosine(outer, 0, inner, 0),))
        case _:
            return _between(LAWS, name, entry, frames)


SLIP = 0.01
"""Largest share of a velocity that the joints may remove."""
TURNED = 0.02
"""Largest rotation of a body by the joints [rad]."""


def start_of(bench: Bench, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Initial state: poses and velocities projected onto the constraints, or the static equilibrium from there."""
    settings = bench.config.simulate
    configured, rate = state(bench.system, bench.poses)
    with blame("joints"):
        q = project_position(bench.system, configured, u)
    _refuse_opposite(bench, q, u)
    for name in bench.poses:
        part = bench.system.of[name]
        moved = float(np.linalg.norm((q - configured)[part][:3]))
        turned = float(np.linalg.norm((q - configured)[part][3:12])) / np.sqrt(2)
        if moved > settings.snap_tolerance or turned > TURNED:
            raise ConfigError(
                f"the joints move the body '{name}' by {moved:.4g} m and {turned:.3g} rad from its configured pose; the limits "
                f"are {settings.snap_tolerance:g} m and {TURNED:g} rad",
                key=f"bodies.{name}.pose",
                remedy="Correct the pose of the body or the frames of its joints, or increase simulate.snap_tolerance [m].",
            )
    _refuse_forceless(bench, q, u)
    if settings.start == "equilibrium":
        try:
            q, _ = static_equilibrium(bench.system, q, u, bench.theta)
        except (InfeasibleError, NumericalError) as error:
            remedy = f"{(error.remedy or 'Change bodies.*.pose').rstrip('.')}; or set simulate.start: as_given"
            raise type(error)(error.what, key="simulate.start", remedy=remedy) from error
        if not settings.allow_unstable:
            modes = coupled_modes(bench.system, q, np.zeros_like(q), u, bench.theta)
            rate_of_growth, body = growth(bench.system, modes)
            if rate_of_growth > 0:
                raise ConfigError(
                    unstable_in_words(rate_of_growth, body),
                    key="simulate.start",
                    remedy="Set bodies.*.pose near a stable equilibrium, or set simulate.start: as_given or "
                    "simulate.allow_unstable: true.",
                )
        return q, project_velocity(bench.system, q, np.zeros_like(q), u)
    v = project_velocity(bench.system, q, rate, u)
    if bench.system.drives.names and not rate.any():
        return q, v  # driven motion
    d = bench.system.metric
    for name in bench.poses:
        part = bench.system.of[name]
        change, whole = (float(np.linalg.norm((d * x)[part])) for x in (v - rate, rate))
        if change > SLIP * max(whole, float(np.linalg.norm(d * rate)) * SLIP):
            raise ConfigError(
                f"the joints of the body '{name}' prevent {100 * change / max(whole, change):.3g} % of its configured velocity "
                "and spin",
                key=f"bodies.{name}.velocity",
                remedy="Set a velocity and spin that the joints allow. For a rotation about a pivot, set velocity = spin × "
                "(origin of the body − pivot).",
            )
    return q, v


def unstable_in_words(rate: float, body: str) -> str:
    """Describe an unstable equilibrium with a growth rate [1/s]."""
    return (
        f"the equilibrium is unstable: a deviation of '{body}' from the equilibrium grows by a factor of {math.e:.1f} in "
        f"{1 / rate:.3g} s"
    )


def _refuse_opposite(bench: Bench, q: np.ndarray, u: np.ndarray) -> None:
    """Raises ConfigError for opposite axes or a driven angle off by half a turn, which constraints cannot distinguish."""
    for name, slope in driven_slopes(bench.system, q, u):
        if slope > 0:
            raise ConfigError(
                "the angle between the two frames of the joint differs from the driven angle by about half a turn",
                key=f"joints.{name}",
                remedy="Rotate one of the two frames or its body by half a turn, or add pi to the driven angle [rad].",
            )
    for joint in bench.system.joints:
        together = readings(bench.system, [RelationSensor(joint.name, joint.aligned)]).read(q, np.zeros_like(q))[0]
        for axes, value in zip((relation.name for relation in joint.aligned), together, strict=True):
            if value < 0:
                raise ConfigError(
                    f"{axes} point in opposite directions",
                    key=f"joints.{joint.name}",
                    remedy="Rotate one of the two frames of the joint by half a turn.",
                )


def _refuse_forceless(bench: Bench, q: np.ndarray, u: np.ndarray) -> None:
    """Raises ConfigError for a force that is not defined at the start."""
    rho = relation_rows(bench.system.products, q, np.zeros_like(q))[0]
    for element in bench.system.elements:
        try:
            values = np.concatenate([bench.theta[element.parameters], u[element.inputs]])
            element.force.law.load(rho[element.rows], np.zeros(len(rho[element.rows])), values)
        except NumericalError as error:
            raise ConfigError(
                f"at the start of the simulation, {error.what}", key=f"forces.{element.force.name}", remedy=error.remedy
            ) from error


LOCKED = 0.02
"""Independence of the constraints, relative to the start, below which the bench is near a dead centre."""


def explained(error: NumericalError, bench: Bench, q: np.ndarray, u: np.ndarray, h: float) -> StrainsightError:
    """Explain an error by drives that the joints block, or by steep friction; else return it unchanged.

    q (n,): start; u (T + 1, nu): at 0, h, 2h, …"""
    return _out_of_reach(bench, q, u, h) or _sharp(error, bench) or error


def _out_of_reach(bench: Bench, q: np.ndarray, u: np.ndarray, h: float) -> StrainsightError | None:
    """Solve φ(q, p(t)) = 0 along the driven motion; returns an error if there is no solution or a dead centre is near."""
    drives = bench.system.drives
    if not drives.names:
        return None
    first = 0.0
    for k, inputs in enumerate(u):
        try:
            q = project_position(bench.system, q, inputs)
            B = constraints_at(bench.system, q, inputs)[1] / bench.system.metric
            # smallest singular value of the constraint gradients, normalised in the metric
            share = float(np.linalg.svd(B / np.linalg.norm(B, axis=1)[:, None], compute_uv=False)[-1])
            first = share if k == 0 else first
            why = "the joints are at a dead centre" if share < LOCKED * first else ""
        except InfeasibleError:
            why = "the joints block the drives"
        if why:
            driven = ", ".join(f"{name} {inputs[drives.at + i]:.4g}" for i, name in enumerate(drives.names))
            return ConfigError(
                f"at t = {k * h:g} s {why}; the driven motion is {driven} [m or rad]",
                key=f"joints.{drives.names[0]}.drive" if len(drives.names) == 1 else "joints",
                remedy="Reduce the driven motion (joints.*.drive.signal), or move the frames of the driven joints.",
            )
    return None


def _sharp(error: NumericalError, bench: Bench) -> StrainsightError | None:
    laws = {e.force.name: e.force.law for e in bench.system.elements}
    sharp = {name: law.speed for name, law in laws.items() if isinstance(law, Friction) and law.coulomb > 0}
    if not sharp or "not solved" not in error.what:
        return None
    name = min(sharp, key=lambda force: sharp[force])
    return NumericalError(
        error.what,
        key=f"forces.{name}",
        remedy=f"The friction law may be too steep for the time step: increase forces.{name}.speed (now {sharp[name]:g}), or "
        "reduce simulate.time_step.",
    )
