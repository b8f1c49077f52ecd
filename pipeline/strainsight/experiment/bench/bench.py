"""The bench of a config as bodies, frames, joints, forces and sensors of the kernel, and the state it starts from."""

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
from strainsight.records.bench import BenchPlaced, ReducedBody
from strainsight.sensors.surface import unit_vector

Between = stated.Joint | stated.Law
"""What stands between two frames."""
Made = TypeVar("Made", Joint, Force)


@dataclass(frozen=True)
class Bench:
    """config; reduced and meshes of its flexible bodies; placed: layouts, where sensors take one; system; frames and bearings by
    name; poses of the bodies at the start; theta (nθ,) values of the system's parameters, a bearing's called BEARING.PROPERTY."""

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
        """Body → its first coordinate and the one after its last (2,)."""
        return {name: np.array([part.start, part.stop]) for name, part in self.system.of.items()}

    @property
    def rings(self) -> dict[str, tuple[Element, Bearing]]:
        """Force of a bearing → its element in the system, and the bearing."""
        elements, forces = {element.force.name: element for element in self.system.elements}, self.config.forces
        bearings = {name: force.bearing for name, force in forces.items() if isinstance(force, stated.BearingForce)}
        return {name: (elements[name], self.bearings[bearing]) for name, bearing in bearings.items()}

    def at(self, theta: np.ndarray) -> Bench:
        """With these values of the parameters (nθ,)."""
        return replace(self, theta=theta)

    def simulated(self, **settings: object) -> Bench:
        """With other settings of `simulate`."""
        simulate = self.config.simulate.model_copy(update=settings)
        return replace(self, config=self.config.model_copy(update={"simulate": simulate}))


def bench_of(
    config: BenchConfig,
    reduced: Mapping[str, ReducedBody],
    meshes: Mapping[str, Mesh],
    placed: BenchPlaced | None = None,
    free: Mapping[str, Sequence[str]] | None = None,
) -> Bench:
    """The whole bench; free: bearing → its properties that are parameters of the system, others as of `Bench`."""
    bodies: list[Body] = []
    poses: dict[str, Pose] = {}
    for name, entry in config.bodies.items():
        with blame(f"bodies.{name}"):
            bodies.append(_body(name, entry, reduced))
        held = entry.type == "flexible" and reduced[name].clamped
        if held and (any(entry.velocity) or any(entry.spin) or entry.pose.origin != (0.0, 0.0, 0.0)):
            raise ConfigError(
                f"'{name}' is held on the ground by the supports of its deck",
                key=f"bodies.{name}",
                remedy="leave pose, velocity and spin out, or take the supports out of the deck",
            )
        if not held:
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
    """Right-handed orthonormal axes (3, 3), columns x, y, z, from the x axis and the part of the y axis across it."""
    x, y = unit_vector(pose.x_axis, "the x axis"), np.asarray(pose.y_axis, dtype=float)
    y = unit_vector((y - (x @ y) * x).tolist(), "the y axis")
    return np.column_stack([x, y, np.cross(x, y)])


def _body(name: str, entry: stated_bodies.Body, reduced: Mapping[str, ReducedBody]) -> Body:
    """The inertia of a rigid body is about the centre of mass in the config, in the kernel about the origin."""
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
    assert entry.node is not None  # the config asks for one on a flexible body
    with blame(f"frames.{name}.node"):
        mesh = meshes[entry.body]
        origin = mesh.position[mesh.node_index(entry.node)]
        rows = reduced[entry.body].interface[str(entry.node)]
    return Frame(name, entry.body, origin, axes, rows[:3], rows[3:])


def _between(kinds: Mapping[str, Callable[..., Made]], name: str, entry: Between, frames: Mapping[str, Frame]) -> Made:
    """A joint or a force law between two frames, by what its section says beside its kind, its frames and its history."""
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
"""Share of a velocity that the joints may take away."""
TURNED = 0.02
"""[rad] that the joints may turn a body."""


def start_of(bench: Bench, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses and velocities put onto the joints, where they are near them; or the static equilibrium from there."""
    settings = bench.config.simulate
    stated, rate = state(bench.system, bench.poses)
    with blame("joints"):
        q = project_position(bench.system, stated, u)
    _refuse_opposite(bench, q, u)
    for name in bench.poses:
        part = bench.system.of[name]
        moved = float(np.linalg.norm((q - stated)[part][:3]))
        turned = float(np.linalg.norm((q - stated)[part][3:12])) / np.sqrt(2)
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
            modes = coupled_modes(bench.system, q, np.zeros_like(q), u, bench.theta)
            rate_of_growth, body = growth(bench.system, modes)
            if rate_of_growth > 0:
                raise ConfigError(
                    unstable_in_words(rate_of_growth, body),
                    key="simulate.start",
                    remedy="start from a pose that is nearer to a stable one, or set simulate.start: as_given or "
                    "simulate.allow_unstable: true",
                )
        return q, project_velocity(bench.system, q, np.zeros_like(q), u)
    v = project_velocity(bench.system, q, rate, u)
    if bench.system.drives.names and not rate.any():
        return q, v  # the drives say how it moves
    d = bench.system.metric
    for name in bench.poses:
        part = bench.system.of[name]
        change, whole = (float(np.linalg.norm((d * x)[part])) for x in (v - rate, rate))
        if change > SLIP * max(whole, float(np.linalg.norm(d * rate)) * SLIP):
            raise ConfigError(
                f"the joints do not let '{name}' move as its velocity and spin say: {100 * change / max(whole, change):.3g} % of "
                "it is left out",
                key=f"bodies.{name}.velocity",
                remedy="give velocities that the joints allow: a body that turns about a pivot moves its origin too",
            )
    return q, v


def unstable_in_words(rate: float, body: str) -> str:
    """Of an equilibrium that a body leaves at a rate [1/s]."""
    return f"the equilibrium is unstable: '{body}' falls out of it, {math.e:.1f}-fold in {1 / rate:.3g} s"


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
        for relation, value in zip(joint.aligned, together, strict=True):
            if value < 0:
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
            values = np.concatenate([bench.theta[element.parameters], u[element.inputs]])
            element.force.law.load(rho[element.rows], np.zeros(len(rho[element.rows])), values)
        except NumericalError as error:
            raise ConfigError(
                f"at the start {error.what}", key=f"forces.{element.force.name}", remedy=error.remedy
            ) from error


LOCKED = 0.02
"""Share of what the start has of the independence of its constraints, below which they are near a dead centre."""


def explained(error: NumericalError, bench: Bench, q: np.ndarray, u: np.ndarray, h: float) -> StrainsightError:
    """Drives that lead where the joints do not let them, friction that is too sharp for its step, or the error as it is.

    q (n,) the start; u (T + 1, nu) at 0, h, 2h, …
    """
    return _out_of_reach(bench, q, u, h) or _sharp(error, bench) or error


def _out_of_reach(bench: Bench, q: np.ndarray, u: np.ndarray, h: float) -> StrainsightError | None:
    """φ(q, p(t)) = 0 from instant to instant, each from the last: does a configuration allow what the drives ask for, and is it
    further from one where the constraints depend on each other, a dead centre, than LOCKED of the start?"""
    drives = bench.system.drives
    if not drives.names:
        return None
    first = 0.0
    for k, inputs in enumerate(u):
        try:
            q = project_position(bench.system, q, inputs)
            share = _independence(bench, q, inputs)
            first = share if k == 0 else first
            why = "stand at a dead centre" if share < LOCKED * first else ""
        except InfeasibleError:
            why = "do not let the drives go on"
        if why:
            asked = ", ".join(f"{name} {inputs[drives.at + i]:.4g}" for i, name in enumerate(drives.names))
            return ConfigError(
                f"at t = {k * h:g} s the joints {why}, at {asked} [m or rad]",
                key=f"joints.{drives.names[0]}.drive" if len(drives.names) == 1 else "joints",
                remedy="let it go less far, or move its frames",
            )
    return None


def _independence(bench: Bench, q: np.ndarray, u: np.ndarray) -> float:
    """Smallest singular value of the gradients of all constraints, each of length 1 in the metric."""
    B = constraints_at(bench.system, q, u)[1] / bench.system.metric
    return float(np.linalg.svd(B / np.linalg.norm(B, axis=1)[:, None], compute_uv=False)[-1])


def _sharp(error: NumericalError, bench: Bench) -> StrainsightError | None:
    laws = {e.force.name: e.force.law for e in bench.system.elements}
    sharp = {name: law.speed for name, law in laws.items() if isinstance(law, Friction) and law.coulomb > 0}
    if not sharp or "was not solved" not in error.what:
        return None
    name = min(sharp, key=lambda force: sharp[force])
    return NumericalError(
        error.what,
        key=f"forces.{name}",
        remedy=f"its friction may be too sharp for the step: raise its speed of {sharp[name]:g}, or take a smaller "
        "simulate.time_step",
    )
