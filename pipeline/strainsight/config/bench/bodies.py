"""Bodies of a bench, the frames on them, and bearings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from strainsight.config.base import (
    ANGLE,
    DENSITY,
    FORCE,
    INERTIA,
    MOMENT,
    SPIN,
    VELOCITY,
    BearingName,
    BodyName,
    DirectionVector,
    Frequency,
    Id,
    Name,
    NamedRun,
    Plausible,
    Point,
    Positive,
    Problem,
    Section,
    Text,
    Vector,
    YoungsModulus,
    expert,
    with_defaults,
)
from strainsight.config.mesh import MeshFile, NodeId
from strainsight.config.placement import Damped

FARTHEST = 1e8
"""[m] from the origin, beyond which a place is known to less than 10 nm: to no more than a bearing moves."""
PARALLEL = 1e-6
"""Sine of the least angle between the two axes of a pose."""
GYRATION = (1e-7, 1e7)
"""[m] within which a radius of gyration is one: beyond, turning weighs nothing beside moving, or moving beside turning."""
LARGEST_PRELOAD = 0.02
"""Share of the ball diameter: as oversize several times what hard steel bears, as clearance a worn-out bearing."""


class PoseSection(Section):
    """Where a body or a frame stands."""

    origin: Point = Field((0.0, 0.0, 0.0), description="Origin [m].")
    x_axis: DirectionVector = expert(
        (1.0, 0.0, 0.0), description="Direction of the x axis [-]; its length does not matter."
    )
    y_axis: DirectionVector = expert(
        (0.0, 1.0, 0.0), description="Direction of the y axis [-]; its part along the x axis does not matter."
    )

    def problems(self) -> Iterator[Problem]:
        farthest = float(np.max(np.abs(self.origin)))
        if farthest > FARTHEST:
            what = f"{farthest:g} m from the origin, where a number has steps of {np.spacing(farthest):.1g} m"
            remedy = f"give places in metres, about an origin near the bench (within {FARTHEST:g} m)"
            yield Problem("origin", what, remedy)
        if any(self.x_axis) and any(self.y_axis):
            x, y = (np.array(v) / np.linalg.norm(v) for v in (self.x_axis, self.y_axis))
            if np.linalg.norm(np.cross(x, y)) < PARALLEL:
                yield Problem("y_axis", "is parallel to the x axis", "give another direction")


class InertiaSection(Section):
    """Moments of inertia about the centre of mass, in body axes [kg m²]: xx = ∫ρ(y² + z²), xy = −∫ρxy."""

    xx: Annotated[Positive, INERTIA] = Field(description="About the x axis [kg m²].")
    yy: Annotated[Positive, INERTIA] = Field(description="About the y axis [kg m²].")
    zz: Annotated[Positive, INERTIA] = Field(description="About the z axis [kg m²].")
    xy: Annotated[float, INERTIA] = expert(0.0, description="−∫ρxy [kg m²].")
    xz: Annotated[float, INERTIA] = expert(0.0, description="−∫ρxz [kg m²].")
    yz: Annotated[float, INERTIA] = expert(0.0, description="−∫ρyz [kg m²].")

    @property
    def trace(self) -> float:
        """Sum of the moments [kg m²]."""
        return self.xx + self.yy + self.zz

    def problems(self) -> Iterator[Problem]:
        tensor = np.array([[self.xx, self.xy, self.xz], [self.xy, self.yy, self.yz], [self.xz, self.yz, self.zz]])
        least = np.linalg.eigvalsh(0.5 * self.trace * np.eye(3) - tensor)[0]
        if least < -1e-9 * self.trace:
            what = "one principal moment is larger than the sum of the two others, which no body has"
            yield Problem("", what, "give the moments about the centre of mass, with xy = −∫ρxy")


class Moving(Section):
    """Where a body is at the start, and how it moves."""

    pose: PoseSection = with_defaults(
        PoseSection, "Where a body without supports stands at the start, in global coordinates."
    )
    velocity: Annotated[Vector, VELOCITY] = expert(
        (0.0, 0.0, 0.0), description="Velocity of its origin at the start [m/s]."
    )
    spin: Annotated[Vector, SPIN] = expert(
        (0.0, 0.0, 0.0), description="Angular velocity at the start, in global axes [rad/s]."
    )


class RigidBodySection(Moving):
    """A rigid body."""

    type: Literal["rigid"] = Field(description="Kind of body.")
    mass: Annotated[Positive, Plausible(1e-6, 1e8, "kg")] = Field(description="Mass [kg].")
    centre: Point = Field((0.0, 0.0, 0.0), description="Centre of mass in body axes [m].")
    inertia: InertiaSection = Field(description="Moments of inertia.")

    def problems(self) -> Iterator[Problem]:
        """√(½ tr I / m): the joints are distinguished in the metric of the mass, where a lever is one beside this radius."""
        radius = float(np.sqrt(self.inertia.trace / 2) / np.sqrt(self.mass))
        low, high = GYRATION
        if not low <= radius <= high:
            yield Problem(
                "mass",
                f"{self.mass:g} kg with moments of inertia of {self.inertia.trace:.3g} kg m² in sum is a radius of gyration of "
                f"{radius:.3g} m, not within {low:g} to {high:g} m",
                "give mass and moments of the same body, in kg and kg m²",
            )


class Modulus(Section):
    """A Young's modulus that stays free."""

    region: Id | Text | Annotated[tuple[Id | Text, ...], Field(min_length=1)] = Field(
        description="Region id (PSOLID id) or name, or a list of them."
    )
    value: YoungsModulus = Field(description="Its value in this bench [Pa].")


class FlexibleBodySection(Moving, Damped):
    """A body reduced from a finite-element mesh after Craig and Bampton."""

    type: Literal["flexible"] = Field(description="Kind of body.")
    mesh: MeshFile = Field(description="The finite-element model, whose supports hold the body on the ground.")
    scale: Annotated[Positive, Plausible(1e-3, 1e3)] = Field(
        1.0, description="The body is so many times the size of its deck, of the same material [-]."
    )
    modes: Annotated[Annotated[int, Field(ge=0)] | None, Plausible(0, 500)] = Field(
        None, description="Modes with held interfaces to keep [-]; null: as many as `cutoff` asks for, or 10."
    )
    cutoff: Frequency | None = expert(None, description="Keep the body's frequencies below this to 0.5 % instead [Hz].")
    moduli: dict[Name, Modulus] = Field({}, description="Young's moduli that stay free, by name.")

    def problems(self) -> Iterator[Problem]:
        if self.modes is not None and self.cutoff is not None:
            yield Problem("cutoff", "modes and cutoff are both given", "give one of them")
        for key in ("matrices", "results"):
            if getattr(self.mesh, key) is not None:
                what = "a body of a bench is reduced from its solids"
                yield Problem(f"mesh.{key}", what, f"leave mesh.{key} out")
        if self.mesh.free:
            yield Problem("mesh.free", "a body of a bench is free in any case", "remove the key", at_key=True)


Body = Annotated[RigidBodySection | FlexibleBodySection, Field(discriminator="type")]


class FrameSection(Section):
    """A point with three axes on a body or on the ground."""

    body: BodyName = Field(description="Name of the body, or 'ground'.")
    node: NodeId | None = Field(
        None, description="Interface node of a flexible body: the reference node of a rigid element (RBE2)."
    )
    pose: PoseSection = with_defaults(
        PoseSection,
        "In body axes (ground: global ones); at a node its origin is the node's and is left out.",
    )


Bearings = BearingName | Annotated[tuple[BearingName, ...], Field(min_length=1)] | None
"""Names of bearings; None: all."""


RADII = ("radius_inner_left", "radius_inner_right", "radius_outer_left", "radius_outer_right")
"""Fields of a bearing that are the radius of a groove."""

GrooveRadius = Annotated[Positive, Plausible(2.5e-4, 0.2, "m")]


class BearingSection(Section):
    """A four-point-contact ball bearing (thesis 1.18-1.25)."""

    balls: int = Field(ge=3, le=10000, description="Number of balls [-].")
    ball_diameter: Annotated[Positive, Plausible(5e-4, 0.2, "m")] = Field(description="Diameter D of the balls [m].")
    pitch_diameter: Annotated[Positive, Plausible(5e-3, 20.0, "m")] = Field(
        description="Diameter of the circle of ball centres [m]."
    )
    contact_angle: Annotated[float, Plausible(5.0, 85.0, "deg")] = Field(
        gt=0, lt=90, description="Free contact angle [deg]."
    )
    radius_inner_left: GrooveRadius = Field(description="Groove radius of that raceway [m]; above D/2.")
    radius_inner_right: GrooveRadius = Field(description="Groove radius of that raceway [m]; above D/2.")
    radius_outer_left: GrooveRadius = Field(description="Groove radius of that raceway [m]; above D/2.")
    radius_outer_right: GrooveRadius = Field(description="Groove radius of that raceway [m]; above D/2.")
    preload: Annotated[float, Plausible(0.0, 1e-3, "m")] = Field(
        0.0, description="Oversize of the balls on their radius [m]; negative: clearance; at most 2 % of D."
    )
    groove_centres: Literal["follow", "fixed"] = Field(
        "follow",
        description="What a change of ball or groove does: follow: the contact point at the free angle stays; fixed: the "
        "groove centres stay, and the change becomes interference.",
    )
    youngs_modulus: Annotated[Positive, Plausible(1e10, 1e12, "Pa")] = expert(
        2.08e11, description="Young's modulus of balls and rings [Pa]."
    )
    poisson_ratio: float = expert(0.3, gt=-1, lt=0.5, description="Poisson's ratio of balls and rings [-].")
    density: Annotated[Positive, DENSITY] = expert(
        7850.0, description="Density of the balls [kg/m³], for their centrifugal force."
    )
    speed: Annotated[float, SPIN] = expert(
        0.0, description="Speed of the inner ring, for the centrifugal force [rad/s]."
    )
    pressure_limit: Annotated[Positive, Plausible(1e8, 1e10, "Pa")] = Field(
        4.2e9,
        description="Contact pressure beyond which a warning says so [Pa]: 4200 MPa is what presses a hardened raceway in by "
        "1e-4 of the ball (ISO 76).",
    )
    first_ball: Annotated[float, ANGLE] = expert(
        0.0, description="Station of the first ball, from the y axis towards z [deg]."
    )

    def problems(self) -> Iterator[Problem]:
        """What `multibody.bearing.geometry` refuses too, for whoever builds a bearing without a config: only here the file, the
        line and all problems can be listed at once, and a config knows no kernel."""
        half = self.ball_diameter / 2
        limit = LARGEST_PRELOAD * self.ball_diameter
        if abs(self.preload) > limit:
            yield Problem(
                "preload",
                f"{self.preload:g} m is beyond {limit:g} m, {100 * LARGEST_PRELOAD:g} % of the ball diameter",
                "give the oversize of the balls on their radius in metres (clearance: negative); usual are 1e-5 to 1e-4 m",
            )
        for radius in RADII:
            value = getattr(self, radius)
            if not value > half:
                what = f"{value:g} m is not above half the ball diameter, {half:g} m"
                yield Problem(
                    radius,
                    what,
                    "a groove is wider than its ball: usual radii are 1.03 to 1.06 times half the diameter",
                )
            elif not value > half + self.preload and self.preload <= limit:
                what = f"balls of {half:g} m in radius with {self.preload:g} m of oversize do not pass {radius}, {value:g} m"
                yield Problem("preload", what, f"take less than {value - half:.6g} m, or a wider groove")
        if self.ball_diameter * self.balls > np.pi * self.pitch_diameter:
            what = f"{self.balls} balls of {self.ball_diameter:g} m do not fit on a circle of {self.pitch_diameter:g} m"
            yield Problem("balls", what, f"take at most {int(np.pi * self.pitch_diameter / self.ball_diameter)}")


class OfBearings(Section):
    """What holds for one bearing, for some, or for all."""

    bearing: Bearings = Field(None, description="Name of the bearing, or a list of them; null: every one.")

    def includes(self, name: str) -> bool:
        """Whether it holds for this bearing."""
        return self.bearing is None or name in ((self.bearing,) if isinstance(self.bearing, str) else self.bearing)


class LoadCase(OfBearings):
    """A load on the inner ring, the outer ring held."""

    force: Annotated[tuple[float, float, float], FORCE] = Field(
        (0.0, 0.0, 0.0), description="Along the bearing's axis x, y and z [N]."
    )
    moment: Annotated[tuple[float, float], MOMENT] = Field((0.0, 0.0), description="About y and z [N m].")


class CurveSection(OfBearings):
    """A load-displacement curve: one displacement of the inner ring runs, the others are held at zero."""

    along: Literal["x", "y", "z", "tilt_y", "tilt_z"] = Field(description="Which displacement.")
    reach: Annotated[Positive, Plausible(1e-9, 1.0, "m or rad")] = Field(
        description="It runs from −reach to reach [m or rad]; at the pitch circle at most the ball diameter."
    )
    points: int = Field(41, ge=3, le=10001, description="Points of the curve [-].")


class BearingLoads(Section):
    """What the stage `bearing` computes of bearings alone."""

    cases: dict[Name, LoadCase] = Field(
        {}, description="Loads to compute the displacement, stiffness and ball loads of a bearing alone for."
    )
    curves: tuple[CurveSection, ...] = Field((), description="Load-displacement curves of a bearing alone.")


class BearingConfig(NamedRun, BearingLoads):
    """A bearing alone: load-displacement curves, stiffness, loads of every ball."""

    kind: Literal["bearing"] = Field(description="Which pipeline.")
    bearings: Annotated[dict[Name, BearingSection], Field(min_length=1)] = Field(description="Bearings, by name.")
