"""The bench of a config as bodies, frames, joints, forces and sensors of the kernel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.config.bench import connections as stated
from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.bodies import Frame as StatedFrame
from strainsight.config.bench.bodies import Pose as StatedPose
from strainsight.config.bench.bodies import RigidBody as StatedRigidBody
from strainsight.errors import ConfigError, blame
from strainsight.experiment.bench.bearings import bearings_of
from strainsight.experiment.bench.reduction import flexible
from strainsight.mesh.additions import node_index
from strainsight.mesh.model import Mesh
from strainsight.multibody.bearing.geometry import PARAMETERS, Bearing
from strainsight.multibody.bearing.law import BearingLaw, Drag, ring_relations
from strainsight.multibody.bodies import Body, FlexibleBody, RigidBody
from strainsight.multibody.forces import Force, Gravity, PointForce, PointMoment, RelativeElement
from strainsight.multibody.frames import Frame
from strainsight.multibody.initial import Pose
from strainsight.multibody.joints import JOINTS
from strainsight.multibody.laws.actuators import follower_force, follower_moment
from strainsight.multibody.laws.kinds import LAWS
from strainsight.multibody.laws.turning import turning_gravity
from strainsight.multibody.relations import cosine
from strainsight.multibody.system import System, assemble
from strainsight.records.bodies import ReducedBody

Between = stated.Joint | stated.Law
"""What stands between two frames."""


@dataclass(frozen=True)
class Bench:
    """system; frames and bearings by name; poses of the bodies at the start; theta (nθ,) values of the system's parameters, a
    bearing's called BEARING.PROPERTY."""

    system: System
    frames: Mapping[str, Frame]
    bearings: Mapping[str, Bearing]
    poses: Mapping[str, Pose]
    theta: np.ndarray


def bench_of(
    config: BenchConfig,
    reduced: Mapping[str, ReducedBody],
    meshes: Mapping[str, Mesh],
    free: Mapping[str, Sequence[str]] | None = None,
) -> Bench:
    """The whole bench; reduced and meshes: of the flexible bodies, by name; free: bearing → its properties that are
    parameters of the system."""
    bodies: list[Body] = []
    poses: dict[str, Pose] = {}
    for name, entry in config.bodies.items():
        with blame(f"bodies.{name}"):
            bodies.append(_rigid(name, entry) if isinstance(entry, StatedRigidBody) else _flexible(name, reduced[name]))
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
    joints = [
        JOINTS[entry.type](name, *_between(entry, frames), **_keys(entry)) for name, entry in config.joints.items()
    ]
    forces = [_force(name, entry, frames, bearings, free or {}, bodies) for name, entry in config.forces.items()]
    with blame("joints"):
        system = assemble(bodies, joints, forces)
    values = {key: modulus.value for entry in flexible(config).values() for key, modulus in entry.moduli.items()}
    for name, bearing in bearings.items():
        values |= {f"{name}.{key}": value for key, value in zip(PARAMETERS, bearing.parameters, strict=True)}
    theta = np.array([float(values[name]) for name in system.parameters])
    return Bench(system, frames, bearings, poses, theta)


def axes_of(pose: StatedPose) -> np.ndarray:
    """Right-handed orthonormal axes (3, 3), columns x, y, z, from the x axis and the part of the y axis across it."""
    x = np.asarray(pose.x_axis, dtype=float)
    x = x / np.linalg.norm(x)
    y = np.asarray(pose.y_axis, dtype=float)
    y = y - (x @ y) * x
    y = y / np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])


def unit_vector(direction: Sequence[float]) -> np.ndarray:
    """A direction (3,) of any length, made of length 1."""
    vector = np.asarray(direction, dtype=float)
    return np.asarray(vector / np.linalg.norm(vector))


def _flexible(name: str, reduced: ReducedBody) -> FlexibleBody:
    return FlexibleBody(name, reduced.clamped, reduced.stiffness, reduced.mass, reduced.damping, reduced.inertia)


def _rigid(name: str, entry: StatedRigidBody) -> RigidBody:
    """The inertia of the config is about the centre of mass, that of the kernel about the origin."""
    I, c = entry.inertia, np.asarray(entry.centre, dtype=float)
    central = np.array([[I.xx, I.xy, I.xz], [I.xy, I.yy, I.yz], [I.xz, I.yz, I.zz]])
    return RigidBody(name, float(entry.mass), c, central + entry.mass * (c @ c * np.eye(3) - np.outer(c, c)))


def _frame(name: str, entry: StatedFrame, reduced: Mapping[str, ReducedBody], meshes: Mapping[str, Mesh]) -> Frame:
    axes = axes_of(entry.pose)
    if entry.body == "ground":
        return Frame(name, None, np.array(entry.pose.origin), axes)
    if entry.body not in reduced:
        return Frame(name, entry.body, np.array(entry.pose.origin), axes)
    assert entry.node is not None  # the config asks for one on a flexible body
    with blame(f"frames.{name}.node"):
        mesh = meshes[entry.body]
        origin = mesh.position[node_index(mesh, entry.node)]
        rows = reduced[entry.body].interface[str(entry.node)]
    return Frame(name, entry.body, origin, axes, rows[:3], rows[3:])


def _between(entry: Between, frames: Mapping[str, Frame]) -> tuple[Frame, Frame]:
    first, second = (frames[frame] for frame in entry.frames)
    return first, second


def _keys(entry: Between) -> dict[str, object]:
    """What the section of a joint or a force law says beside its kind, its frames and its history."""
    return {key: value for key, value in dict(entry).items() if key not in ("type", "frames", "drive", "signal")}


def _force(
    name: str,
    entry: stated.Force,
    frames: Mapping[str, Frame],
    bearings: Mapping[str, Bearing],
    free: Mapping[str, Sequence[str]],
    bodies: Sequence[Body],
) -> Force:
    match entry:
        case stated.Gravity():
            if entry.turns is None:
                return Gravity(np.array(entry.acceleration), name)
            return turning_gravity(name, bodies, np.array(entry.acceleration), unit_vector(entry.turns.axis))
        case stated.PointForce() | stated.PointMoment():
            direction = unit_vector(entry.direction)
            if entry.axes == "frame":
                follower = follower_force if entry.type == "force" else follower_moment
                return follower(name, frames[entry.frame], direction)
            kind = PointForce if entry.type == "force" else PointMoment
            return kind(name, frames[entry.frame], direction[:, None], (name,))
        case stated.BearingForce():
            outer, inner = frames[entry.outer], frames[entry.inner]
            own = tuple(free.get(entry.bearing, ()))
            names = tuple(f"{entry.bearing}.{key}" for key in own)
            d = entry.drag
            damping = np.array([d.axial, d.radial, d.radial, d.tilt, d.tilt], dtype=float)
            drag = Drag(d.moment, d.coefficient, d.viscous, d.speed, damping)
            law = BearingLaw(bearings[entry.bearing], own, drag)
            return RelativeElement(name, ring_relations(outer, inner, drag), law, names, (cosine(outer, 0, inner, 0),))
        case _:
            return LAWS[entry.type](name, *_between(entry, frames), **_keys(entry))
