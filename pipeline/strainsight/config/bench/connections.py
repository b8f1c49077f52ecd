"""Joints and forces of a bench."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from strainsight.config.base import (
    DRIVEN,
    DURATION,
    MOMENT,
    STIFFNESS,
    TURN,
    VISCOUS,
    BearingName,
    DirectionVector,
    Duration,
    FrameName,
    NotNegative,
    Plausible,
    Positive,
    Problem,
    Section,
    Vector,
    expert,
    with_defaults,
)
from strainsight.config.loads import MultiSineSection, RecordedSection, SineSection, SweepSection

Frames = tuple[FrameName, FrameName]
Axis = Literal["x", "y", "z"]


class ConstantSection(Section):
    """u(t) = value, from the start."""

    type: Literal["constant"] = Field(description="Kind of signal.")
    value: Annotated[float, DRIVEN] = Field(description="Value [N or N m, of a drive its own unit].")


class RampSection(Section):
    """From one value to another without a jump in velocity or acceleration, u = a + (b − a)(10s³ − 15s⁴ + 6s⁵)."""

    type: Literal["ramp"] = Field(description="Kind of signal.")
    start: Annotated[float, DRIVEN] = Field(0.0, description="Value a before [N or N m, of a drive its own unit].")
    end: Annotated[float, DRIVEN] = Field(description="Value b after [N or N m, of a drive its own unit].")
    begin: Annotated[NotNegative, DURATION] = Field(0.0, description="When it begins [s].")
    duration: Duration = Field(description="How long it lasts [s].")


Signal = Annotated[
    ConstantSection | RampSection | SineSection | SweepSection | MultiSineSection | RecordedSection,
    Field(discriminator="type"),
]


class Between(Section):
    """Two frames."""

    type: str = Field(description="Kind of joint or force.")
    frames: Frames = Field(
        description="Names of the two frames; of a relation that is not mutual the first is the one whose axes count, or that "
        "holds, and the second the one that moves, or is held."
    )


class Axial(Between):
    """Two frames and an axis."""

    axis: Axis = Field("x", description="Axis of the first frame, where they share it of both.")


class Spherical(Between):
    """The origins of two frames coincide."""

    type: Literal["spherical"] = Field(description="Kind of joint.")


class Revolute(Axial):
    """The origins coincide and the second frame turns about an axis of both."""

    type: Literal["revolute"] = Field(description="Kind of joint.")


class Prismatic(Axial):
    """The second frame slides along an axis of the first, without turning."""

    type: Literal["prismatic"] = Field(description="Kind of joint.")


class Cylindrical(Axial):
    """The second frame slides along an axis of both and turns about it."""

    type: Literal["cylindrical"] = Field(description="Kind of joint.")


class Universal(Axial):
    """The origins coincide in a cross of two pins at right angles, one in each frame: a Cardan joint. The axis is that of the
    shafts; in the order x, y, z, x the axis after it is the pin of the first frame, the next one the pin of the second."""

    type: Literal["universal"] = Field(description="Kind of joint.")


class Pin(Axial):
    """The origin of the second frame stays on an axis of the first and slides and turns freely there."""

    type: Literal["pin"] = Field(description="Kind of joint.")


class Fixed(Between):
    """Origins and axes coincide."""

    type: Literal["fixed"] = Field(description="Kind of joint.")


class Coincidence(Between):
    """Some components of the origins coincide, in global axes."""

    type: Literal["coincidence"] = Field(description="Kind of joint.")
    components: Annotated[tuple[Axis, ...], Field(min_length=1, max_length=3)] = expert(
        description="Global components."
    )


class Perpendicular(Between):
    """An axis of the first frame stays perpendicular to an axis of the second, or to the line between the origins."""

    type: Literal["perpendicular"] = Field(description="Kind of joint.")
    axis: Axis = Field(description="Axis of the first frame.")
    to: Literal["x", "y", "z", "offset"] = Field(
        description="Axis of the second frame, or offset: the line from the first origin to the second."
    )


class Distance(Between):
    """The origins of two frames stay a length apart: a rod without mass."""

    type: Literal["distance"] = Field(description="Kind of joint.")
    length: Annotated[Positive, Plausible(1e-6, 1e3, "m")] = expert(description="Length [m].")


Held = Literal["x", "y", "z", "about_x", "about_y", "about_z"]


class Generic(Between):
    """Any of the six motions of the second frame in the first is held, the others are free."""

    type: Literal["generic"] = Field(description="Kind of joint.")
    held: Annotated[tuple[Held, ...], Field(min_length=1, max_length=6)] = expert(
        description="What is held: displacements along the axes of the first frame, and turns about them. A single turn that is "
        "held keeps two axes at right angles, as in a Cardan joint; two keep an axis of both parallel."
    )


class Drive(Section):
    """What a driven joint does in time."""

    signal: Signal = Field(description="Its history [rad or m, of a rate rad/s or m/s].")
    of: Literal["position", "rate"] = expert(
        "position", description="Whether the history is of the angle, displacement or length itself or of its rate."
    )
    start: Annotated[float, Plausible(0.0, 1e3, "rad or m")] = expert(
        0.0, description="Where it is at t = 0 if its rate is given [rad or m]."
    )

    def problems(self) -> Iterator[Problem]:
        if self.of == "position" and self.start:
            yield Problem("start", "the history says where it starts", "leave start out, or say of: rate")
        if self.of == "rate" and self.signal.type == "sweep":
            what = "a sweep of a rate has no position in closed form"
            yield Problem("signal", what, "give a sweep of the position, or the rate from a file")


class WithDrive(Section):
    """What follows a history."""

    drive: Drive = Field(description="Its angle, any number of turns, its displacement, or its length, above zero.")


class DrivenAngle(Axial, WithDrive):
    """The second frame is turned about an axis of both by what is given; a joint beside it has to hold the axis,
    to 0.1 rad. It follows up to 1 rad in a time step."""

    type: Literal["driven_angle"] = Field(description="Kind of joint.")


class DrivenDisplacement(Axial, WithDrive):
    """The second origin is displaced along an axis of the first frame by what is given."""

    type: Literal["driven_displacement"] = Field(description="Kind of joint.")


class DrivenDistance(Between, WithDrive):
    """The origins are as far apart as is given: a cylinder that extends."""

    type: Literal["driven_distance"] = Field(description="Kind of joint.")


Driven = DrivenAngle | DrivenDisplacement | DrivenDistance
"""The joints that follow a history."""

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
    """A turn of gravity in time."""

    axis: DirectionVector = expert(description="Axis in global axes [-]; its length does not matter.")
    signal: Signal = expert(description="Angle about it [rad], up to 1 rad in a time step.")


class GravitySection(Section):
    """Gravity on every body."""

    type: Literal["gravity"] = Field(description="Kind of force.")
    acceleration: Annotated[Vector, Plausible(0.0, 1e3, "m/s²")] = Field(
        (0.0, 0.0, -9.81), description="In global axes [m/s²]."
    )
    turns: Turns | None = expert(
        None,
        description="It turns, as for a bench that is itself turned slowly: nothing else is felt of that rotation. null: it does "
        "not.",
    )


class SpringAndDamper(Section):
    """Linear in displacement and velocity."""

    stiffness: Annotated[NotNegative, STIFFNESS] = expert(
        description="Stiffness [N/m, of a torsion N m/rad]; a torsion of one above zero turns by less than 3 rad."
    )
    damping: Annotated[NotNegative, VISCOUS] = expert(0.0, description="Damping [N s/m, of a torsion N m s/rad].")


class Spring(Between, SpringAndDamper):
    """A spring and damper between the origins of two frames."""

    type: Literal["spring"] = Field(description="Kind of force.")
    length: Annotated[NotNegative, Plausible(1e-6, 1e3, "m")] = expert(0.0, description="Length without force [m].")


class Torsion(Axial, SpringAndDamper):
    """A torsion spring and damper about an axis that a joint keeps common to two frames."""

    type: Literal["torsion"] = Field(description="Kind of force.")
    angle: Annotated[float, TURN] = expert(
        0.0, description="Angle of the second frame about the axis of the first without moment [rad]."
    )


Six = tuple[NotNegative, NotNegative, NotNegative, NotNegative, NotNegative, NotNegative]


class Bushing(Between):
    """Springs and dampers, linear in the displacements of one frame in the axes of another and in its small turns there."""

    type: Literal["bushing"] = Field(description="Kind of force.")
    stiffness: Annotated[Six, STIFFNESS] = expert(description="Along x, y, z [N/m], then about them [N m/rad].")
    damping: Annotated[Six, VISCOUS] = expert(
        (0.0,) * 6, description="Along x, y, z [N s/m], then about them [N m s/rad]."
    )


class RegularisedFriction(Section):
    """Friction that is continuous at rest."""

    viscous: Annotated[NotNegative, VISCOUS] = expert(
        0.0, description="Viscous friction c [N m s/rad, of a slide N s/m]."
    )
    speed: Annotated[Positive, Plausible(1e-9, 10.0, "rad/s or m/s")] = Field(
        1e-3,
        description="ω₀: from 3 ω₀ on it is Coulomb's to 0.5 %, below what should stick creeps; not less than a tenth of what it "
        "changes the speed by in a step, which is not solved otherwise [rad/s, of a slide m/s].",
    )


class Input(Section):
    """What has a history: an input of the bench."""

    signal: Signal = Field(
        description="Its history: of a force, or of an actuator that pushes the origins apart [N], of a moment, or of a torque "
        "on the second frame [N m]."
    )


class FrictionSection(Axial, RegularisedFriction):
    """Friction about an axis that a joint keeps common to two frames, or along an axis: −T tanh(ω/ω₀) − cω, whatever the joint
    carries."""

    type: Literal["friction"] = Field(description="Kind of force.")
    motion: Literal["turn", "slide"] = expert("turn", description="Against a turn about the axis, or a slide along it.")
    coulomb: Annotated[NotNegative, Plausible(1e-9, 1e9, "N m or N")] = expert(
        description="Coulomb friction T [N m, of a slide N]."
    )


class Torque(Axial, Input):
    """A motor: a torque between two frames about an axis that a joint keeps common to them; an input of the bench."""

    type: Literal["torque"] = Field(description="Kind of force.")


class ActuatorSection(Between, Input):
    """A cylinder: a force that pushes two origins apart; an input of the bench."""

    type: Literal["actuator"] = Field(description="Kind of force.")


Law = Spring | Torsion | Bushing | FrictionSection | Torque | ActuatorSection
"""The force laws between two frames."""


class AtFrame(Section):
    """What is at a frame."""

    frame: FrameName = Field(description="Name of the frame.")


class PointInput(AtFrame, Input):
    """A force or moment on a frame."""

    direction: DirectionVector = Field(description="Direction [-]; its length does not matter.")
    axes: Literal["global", "frame"] = Field(
        "global",
        description="global: it keeps its direction; frame: it turns with the frame, in whose axes the direction is.",
    )


class PointForceSection(PointInput):
    """A force on the origin of a frame: an input of the bench."""

    type: Literal["force"] = Field(description="Kind of force.")


class PointMomentSection(PointInput):
    """A moment on a frame: an input of the bench."""

    type: Literal["moment"] = Field(description="Kind of force.")


class BearingDrag(RegularisedFriction):
    """What a bearing takes from motion."""

    moment: Annotated[NotNegative, MOMENT] = Field(
        0.0, description="Friction moment without load, of seals and preload [N m]."
    )
    coefficient: Annotated[NotNegative, Plausible(1e-4, 0.3)] = Field(
        0.0,
        description="µ of µ/2 (4.4 M + D F_a + 3.81 D F_r) of what the balls carry, as makers state it [-]: 0.006 or so.",
    )
    axial: Annotated[NotNegative, VISCOUS] = expert(0.0, description="Damping of the axial displacement [N s/m].")
    radial: Annotated[NotNegative, VISCOUS] = expert(0.0, description="Damping of the radial displacements [N s/m].")
    tilt: Annotated[NotNegative, VISCOUS] = expert(0.0, description="Damping of the tilts [N m s/rad].")


class BearingForce(Section):
    """A bearing between two frames; its axis is the x axis of the outer one."""

    type: Literal["bearing"] = Field(description="Kind of force.")
    bearing: BearingName = Field(description="Name of the bearing.")
    outer: FrameName = Field(description="Frame of the outer ring, at the centre of the bearing.")
    inner: FrameName = Field(description="Frame of the inner ring, at the centre of the bearing.")
    drag: BearingDrag = with_defaults(BearingDrag, "Friction and damping.")


Load = PointForceSection | PointMomentSection | Torque | ActuatorSection
"""What has a history: the inputs of a bench. Gravity that turns has one, too, and is none of them: it is known."""
Force = Annotated[
    GravitySection | Law | PointForceSection | PointMomentSection | BearingForce, Field(discriminator="type")
]
