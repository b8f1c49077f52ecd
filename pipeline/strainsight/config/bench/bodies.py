"""Bodies of a bench and the frames on them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from strainsight.config.base import (
    DirectionVector,
    Frequency,
    Id,
    Name,
    Point,
    Positive,
    Section,
    Text,
    Vector,
    YoungsModulus,
    with_defaults,
)
from strainsight.config.mesh import MeshFile, NodeId
from strainsight.config.names import BodyName
from strainsight.config.placement import ModalDamping, RayleighDamping
from strainsight.config.plausible import INERTIA, SPIN, VELOCITY, Plausible


class Pose(Section):
    """Where a body or a frame stands."""

    origin: Point = Field((0.0, 0.0, 0.0), description="Origin [m].")
    x_axis: DirectionVector = Field(
        (1.0, 0.0, 0.0), description="Direction of the x axis [-]; its length does not matter."
    )
    y_axis: DirectionVector = Field(
        (0.0, 1.0, 0.0), description="Direction of the y axis [-]; its part along the x axis does not matter."
    )


class Inertia(Section):
    """Moments of inertia about the centre of mass, in body axes [kg m²]: xx = ∫ρ(y² + z²), xy = −∫ρxy."""

    xx: Annotated[Positive, INERTIA] = Field(description="About the x axis [kg m²].")
    yy: Annotated[Positive, INERTIA] = Field(description="About the y axis [kg m²].")
    zz: Annotated[Positive, INERTIA] = Field(description="About the z axis [kg m²].")
    xy: Annotated[float, INERTIA] = Field(0.0, description="−∫ρxy [kg m²].")
    xz: Annotated[float, INERTIA] = Field(0.0, description="−∫ρxz [kg m²].")
    yz: Annotated[float, INERTIA] = Field(0.0, description="−∫ρyz [kg m²].")


class RigidBody(Section):
    """A rigid body."""

    type: Literal["rigid"] = Field(description="Kind of body.")
    mass: Annotated[Positive, Plausible(1e-6, 1e8, "kg")] = Field(description="Mass [kg].")
    centre: Point = Field((0.0, 0.0, 0.0), description="Centre of mass in body axes [m].")
    inertia: Inertia = Field(description="Moments of inertia.")
    pose: Pose = with_defaults(Pose, "Where it stands at the start, in global coordinates.")
    velocity: Annotated[Vector, VELOCITY] = Field(
        (0.0, 0.0, 0.0), description="Velocity of its origin at the start [m/s]."
    )
    spin: Annotated[Vector, SPIN] = Field(
        (0.0, 0.0, 0.0), description="Angular velocity at the start, in global axes [rad/s]."
    )


class Modulus(Section):
    """A Young's modulus that stays free."""

    region: Id | Text | Annotated[tuple[Id | Text, ...], Field(min_length=1)] = Field(
        description="Region id (PSOLID id) or name, or a list of them."
    )
    value: YoungsModulus = Field(description="Its value in this bench [Pa].")


class FlexibleBody(Section):
    """A body reduced from a finite-element mesh after Craig and Bampton."""

    type: Literal["flexible"] = Field(description="Kind of body.")
    mesh: MeshFile = Field(description="The finite-element model, whose supports hold the body on the ground.")
    scale: Annotated[Positive, Plausible(1e-3, 1e3)] = Field(
        1.0, description="The body is so many times the size of its deck, of the same material [-]."
    )
    modes: Annotated[Annotated[int, Field(ge=0)] | None, Plausible(0, 500)] = Field(
        None, description="Modes with held interfaces to keep [-]; null: as many as `cutoff` asks for, or 10."
    )
    cutoff: Frequency | None = Field(None, description="Keep the body's frequencies below this to 0.5 % instead [Hz].")
    damping: Annotated[ModalDamping | RayleighDamping, Field(discriminator="type")] = Field(
        description="Structural damping."
    )
    moduli: dict[Name, Modulus] = Field({}, description="Young's moduli that stay free, by name.")
    pose: Pose = with_defaults(Pose, "Where a body without supports stands at the start, in global coordinates.")
    velocity: Annotated[Vector, VELOCITY] = Field(
        (0.0, 0.0, 0.0), description="Velocity of its origin at the start [m/s]."
    )
    spin: Annotated[Vector, SPIN] = Field(
        (0.0, 0.0, 0.0), description="Angular velocity at the start, in global axes [rad/s]."
    )


Body = Annotated[RigidBody | FlexibleBody, Field(discriminator="type")]


class Frame(Section):
    """A point with three axes on a body or on the ground."""

    body: BodyName = Field(description="Name of the body, or 'ground'.")
    node: NodeId | None = Field(
        None, description="Interface node of a flexible body: the reference node of a rigid element (RBE2)."
    )
    pose: Pose = with_defaults(
        Pose,
        "In body axes (ground: global ones); at a node its origin is the node's and is left out.",
    )
