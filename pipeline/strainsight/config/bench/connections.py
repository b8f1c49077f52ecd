"""Joints and forces of a bench."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from strainsight.config.base import (
    MOMENT,
    STIFFNESS,
    TURN,
    VISCOUS,
    BearingName,
    DirectionVector,
    FrameName,
    NotNegative,
    Plausible,
    Positive,
    Section,
    Vector,
    expert,
    with_defaults,
)
from strainsight.config.bench.signals import Drive, Signal

Frames = tuple[FrameName, FrameName]
Axis = Literal["x", "y", "z"]


class Between(Section):
    """Keys shared by all joints and forces between two frames."""

    type: str = Field(description="Kind of joint or force.")
    frames: Frames = Field(
        description="Names of the two frames. Where the order matters, the first frame is the base and defines the axes; the "
        "second frame moves relative to the first frame."
    )


class Axial(Between):
    """Key shared by all joints and forces with an axis."""

    axis: Axis = Field(
        "x",
        description="Axis of the first frame that is the axis of the joint or force. For a joint or force with an axis "
        "common to both frames: also the axis of the second frame with the same name.",
    )


class Spherical(Between):
    """Ball joint: the origins of two frames coincide."""

    type: Literal["spherical"] = Field(description="Kind of joint: ball joint.")


class Revolute(Axial):
    """Hinge: the origins of two frames coincide, and the second frame rotates about an axis common to both frames."""

    type: Literal["revolute"] = Field(description="Kind of joint: hinge.")


class Prismatic(Axial):
    """The second frame slides along an axis of the first frame, without rotation."""

    type: Literal["prismatic"] = Field(description="Kind of joint: slider without rotation.")


class Cylindrical(Axial):
    """The second frame slides along an axis common to both frames and rotates about this axis."""

    type: Literal["cylindrical"] = Field(description="Kind of joint: slider with rotation.")


class Universal(Axial):
    """Cardan joint: the origins of two frames coincide at the centre of a cross with two perpendicular pins, one in each
    frame. `axis` is the direction of the shafts, and the pins are the next two axes in the order x, y, z, x. With `axis:
    x`, the pins are the y axis of the first frame and the z axis of the second frame."""

    type: Literal["universal"] = Field(description="Kind of joint: Cardan joint.")


class Pin(Axial):
    """The origin of the second frame stays on an axis of the first frame; the second frame slides along this axis and rotates
    freely."""

    type: Literal["pin"] = Field(description="Kind of joint: slider with free rotation.")


class Fixed(Between):
    """Rigid connection: the origins and axes of two frames coincide."""

    type: Literal["fixed"] = Field(description="Kind of joint: rigid connection.")


class Coincidence(Between):
    """Selected global coordinates of the origins of two frames are equal."""

    type: Literal["coincidence"] = Field(description="Kind of joint: equal coordinates.")
    components: Annotated[tuple[Axis, ...], Field(min_length=1, max_length=3)] = expert(
        description="Global coordinates that are equal for the origins of both frames."
    )


class Perpendicular(Between):
    """An axis of the first frame is perpendicular to an axis of the second frame, or to the line between the two origins."""

    type: Literal["perpendicular"] = Field(description="Kind of joint: two axes, one per frame, stay perpendicular.")
    axis: Axis = Field(description="Axis of the first frame that is perpendicular to `to`.")
    to: Literal["x", "y", "z", "offset"] = Field(
        description="Axis of the second frame that is perpendicular to `axis`. With `offset`: instead of an axis, the line from "
        "the origin of the first frame to the origin of the second frame."
    )


class Distance(Between):
    """Massless rod: the distance between the origins of two frames is constant."""

    type: Literal["distance"] = Field(description="Kind of joint: massless rod.")
    length: Annotated[Positive, Plausible(1e-6, 1e3, "m")] = expert(
        description="Distance between the origins of the two frames [m]."
    )


class Generic(Between):
    """Selected components of the relative motion of two frames are fixed, the other components are free."""

    type: Literal["generic"] = Field(description="Kind of joint: selected fixed components.")
    fixed: Annotated[
        tuple[Literal["x", "y", "z", "about_x", "about_y", "about_z"], ...], Field(min_length=1, max_length=6)
    ] = expert(
        description="Fixed components of the relative motion: displacements along the axes of the first frame, and rotations "
        "about these axes. One fixed rotation keeps two axes perpendicular, as in a Cardan joint. Two fixed rotations keep "
        "one axis of the first frame parallel to the axis of the same name of the second frame."
    )


class WithDrive(Section):
    """Key shared by all joints with a prescribed motion."""

    drive: Drive = Field(
        description="Prescribed motion of the joint: angle (any number of turns), displacement, or distance (positive)."
    )


class DrivenAngle(Axial, WithDrive):
    """The second frame rotates by a prescribed angle about an axis common to both frames. Another joint must keep the axis
    common, within 0.1 rad. The angle may change by at most 1 rad per time step."""

    type: Literal["driven_angle"] = Field(description="Kind of joint: prescribed angle.")


class DrivenDisplacement(Axial, WithDrive):
    """Prescribed displacement of the origin of the second frame relative to that of the first frame, along an axis of the first
    frame."""

    type: Literal["driven_displacement"] = Field(description="Kind of joint: prescribed displacement.")


class DrivenDistance(Between, WithDrive):
    """The distance between the origins of two frames is prescribed, as in a hydraulic cylinder."""

    type: Literal["driven_distance"] = Field(description="Kind of joint: prescribed distance.")


Driven = DrivenAngle | DrivenDisplacement | DrivenDistance
"""Joints with a prescribed motion."""

Joint = Annotated[
    Spherical
    | Revolute
    | Prismatic
    | Cylindrical
    | Universal
    | Pin
    | Fixed
    | Coincidence
    | Perpendicular
    | Distance
    | Generic
    | Driven,
    Field(discriminator="type"),
]


class Turns(Section):
    """Rotation of the direction of gravity over time."""

    axis: DirectionVector = expert(
        description="Axis of rotation in global axes [-]; the length of the vector is not used."
    )
    signal: Signal = expert(
        description="Time history of the angle of rotation [rad]. The angle may change by at most 1 rad per time step."
    )


class GravitySection(Section):
    """Gravity on every body."""

    type: Literal["gravity"] = Field(description="Kind of force: gravity.")
    acceleration: Annotated[Vector, Plausible(0.0, 1e3, "m/s²")] = Field(
        (0.0, 0.0, -9.81), description="Acceleration of gravity in global axes [m/s²]."
    )
    turns: Turns | None = expert(
        None,
        description="Rotation of the direction of gravity, for a bench that is rotated slowly; inertia forces of the "
        "rotation are neglected. Null: constant direction.",
    )


class SpringAndDamper(Section):
    """Linear spring and damper."""

    stiffness: Annotated[NotNegative, STIFFNESS] = expert(
        description="Stiffness [N/m; for a torsion spring, N m/rad]. The rotation of a torsion spring is limited to 3 rad."
    )
    damping: Annotated[NotNegative, VISCOUS] = expert(
        0.0, description="Damping coefficient [N s/m; for a torsion spring, N m s/rad]."
    )


class Spring(Between, SpringAndDamper):
    """A linear spring and damper between the origins of two frames."""

    type: Literal["spring"] = Field(description="Kind of force: spring and damper.")
    length: Annotated[NotNegative, Plausible(1e-6, 1e3, "m")] = expert(
        0.0, description="Length of the unloaded spring [m]."
    )


class Torsion(Axial, SpringAndDamper):
    """A torsion spring and damper about an axis common to two frames. A joint, such as a hinge, must keep this axis common."""

    type: Literal["torsion"] = Field(description="Kind of force: torsion spring and damper.")
    angle: Annotated[float, TURN] = expert(
        0.0,
        description="Rotation of the second frame relative to the first frame about the axis, at zero spring torque [rad].",
    )


Six = tuple[NotNegative, NotNegative, NotNegative, NotNegative, NotNegative, NotNegative]


class Bushing(Between):
    """Linear springs and dampers for the displacements and small rotations of the second frame relative to the first frame, in
    the axes of the first frame."""

    type: Literal["bushing"] = Field(description="Kind of force: springs and dampers for all six components.")
    stiffness: Annotated[Six, STIFFNESS] = expert(
        description="Six values: stiffness along the x, y and z axes of the first frame [N/m], then about these axes [N m/rad]."
    )
    damping: Annotated[Six, VISCOUS] = expert(
        (0.0,) * 6,
        description="Six values: damping coefficients along the x, y and z axes of the first frame [N s/m], then about these "
        "axes [N m s/rad].",
    )


class RegularisedFriction(Section):
    """Regularised friction: the friction is continuous at zero speed."""

    viscous: Annotated[NotNegative, VISCOUS] = expert(
        0.0, description="Coefficient of viscous friction [N m s/rad; for sliding, N s/m]."
    )
    speed: Annotated[Positive, Plausible(1e-9, 10.0, "rad/s or m/s")] = Field(
        1e-3,
        description="Speed for the regularisation of Coulomb friction [rad/s; for sliding, m/s]. Above three times this speed, "
        "Coulomb friction is accurate to 0.5 %. At lower speeds, the parts slide slowly instead of sticking. "
        "The value must be at least a tenth of the speed change in one time step. Otherwise, the equations of the time "
        "step have no solution.",
    )


class Input(Section):
    """Key shared by all forces and moments with a time history, which can be estimated."""

    signal: Signal = Field(
        description="Time history of the force [N] or moment [N m]. A positive force of an actuator pushes the origins of "
        "the two frames apart. A positive torque of a motor turns the second frame in the positive direction about the axis."
    )


class FrictionSection(Axial, RegularisedFriction):
    """Friction about or along an axis common to two frames: −T tanh(ω/ω₀) − cω, with the relative speed ω, T = `coulomb`,
    ω₀ = `speed` and c = `viscous`. The friction does not depend on the joint forces."""

    type: Literal["friction"] = Field(description="Kind of force: friction.")
    motion: Literal["turn", "slide"] = expert(
        "turn", description="Motion with friction: rotation about the axis, or sliding along it."
    )
    coulomb: Annotated[NotNegative, Plausible(1e-9, 1e9, "N m or N")] = expert(
        description="Coulomb friction: torque [N m], or force for sliding [N]."
    )


class Torque(Axial, Input):
    """A motor: a torque between two frames about an axis common to both. A joint, such as a hinge, must keep this axis common.
    The torque can be estimated."""

    type: Literal["torque"] = Field(description="Kind of force: motor.")


class ActuatorSection(Between, Input):
    """A cylinder: a force that pushes the origins of two frames apart. The force can be estimated."""

    type: Literal["actuator"] = Field(description="Kind of force: cylinder.")


Law = Spring | Torsion | Bushing | FrictionSection | Torque | ActuatorSection
"""Force laws between two frames."""


class AtFrame(Section):
    """Key shared by all forces and moments on a frame."""

    frame: FrameName = Field(description="Name of the frame on which the force or moment acts.")


class PointInput(AtFrame, Input):
    """A force or moment on a frame."""

    direction: DirectionVector = Field(
        description="Direction of the force or moment [-]; the length of the vector is not used."
    )
    axes: Literal["global", "frame"] = Field(
        "global",
        description="Axes of the vector `direction`. With `global`: global axes; the direction is constant. With `frame`: "
        "axes of the frame; the direction rotates with the frame.",
    )


class PointForceSection(PointInput):
    """A force on the origin of a frame, which can be estimated."""

    type: Literal["force"] = Field(description="Kind of force: a force.")


class PointMomentSection(PointInput):
    """A moment on a frame, which can be estimated."""

    type: Literal["moment"] = Field(description="Kind of force: a moment.")


class BearingDrag(RegularisedFriction):
    """Friction and damping of a bearing."""

    moment: Annotated[NotNegative, MOMENT] = Field(
        0.0, description="Friction moment of the unloaded bearing, from seals and preload [N m]."
    )
    coefficient: Annotated[NotNegative, Plausible(1e-4, 0.3)] = Field(
        0.0,
        description="Friction coefficient µ of the manufacturer, about 0.006 [-]. Friction moment from the ball loads: µ/2 "
        "(4.4 M + D F_a + 3.81 D F_r), with tilting moment M, pitch diameter D, axial force F_a and radial force F_r.",
    )
    axial: Annotated[NotNegative, VISCOUS] = expert(
        0.0, description="Damping coefficient of the axial displacement [N s/m]."
    )
    radial: Annotated[NotNegative, VISCOUS] = expert(
        0.0, description="Damping coefficient of the radial displacements [N s/m]."
    )
    tilt: Annotated[NotNegative, VISCOUS] = expert(0.0, description="Damping coefficient of the tilts [N m s/rad].")


class BearingForce(Section):
    """A bearing between two frames; the bearing axis is the x axis of the outer frame."""

    type: Literal["bearing"] = Field(description="Kind of force: bearing.")
    bearing: BearingName = Field(description="Name of the bearing.")
    outer: FrameName = Field(description="Frame of the outer ring, at the centre of the bearing.")
    inner: FrameName = Field(description="Frame of the inner ring, at the centre of the bearing.")
    drag: BearingDrag = with_defaults(BearingDrag, "Friction and damping of the bearing.")


Load = PointForceSection | PointMomentSection | Torque | ActuatorSection
"""Inputs of a bench: forces with a time history. Rotating gravity also has one, but is always known."""
Force = Annotated[
    GravitySection | Law | PointForceSection | PointMomentSection | BearingForce, Field(discriminator="type")
]
