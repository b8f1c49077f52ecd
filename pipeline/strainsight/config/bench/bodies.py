"""Bodies of a bench, their frames, and bearings."""

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
from strainsight.config.parameters import Damped

FARTHEST = 1e8
"""[m] Largest distance from the origin; beyond it, the rounding of positions exceeds 10 nm, the scale of bearing motion."""
PARALLEL = 1e-6
"""Sine of the smallest angle between the two axes of a pose."""
GYRATION = (1e-7, 1e7)
"""[m] Plausible radius of gyration; beyond it, rotation or translation is negligible in the mass metric."""
LARGEST_PRELOAD = 0.02
"""Largest preload relative to the ball diameter: several times the load limit of hard steel, or a worn-out bearing."""


class PoseSection(Section):
    """Pose (position and axes) of a body in global axes, or of a frame in the axes of its body."""

    origin: Point = Field(
        (0.0, 0.0, 0.0),
        description="Position of the origin of the body, in global axes [m]. For a frame on a body: position of the frame origin "
        "relative to the body origin, in the axes of the body.",
    )
    x_axis: DirectionVector = expert(
        (1.0, 0.0, 0.0),
        description="Direction of the x axis [-]: in global axes, or for a frame on a body, in the axes of the body. The length "
        "of the vector is not used.",
    )
    y_axis: DirectionVector = expert(
        (0.0, 1.0, 0.0),
        description="Direction of the y axis [-]: in global axes, or for a frame on a body, in the axes of the body. The "
        "component of the vector along the x axis is ignored.",
    )

    def problems(self) -> Iterator[Problem]:
        farthest = float(np.max(np.abs(self.origin)))
        if farthest > FARTHEST:
            resolution = f"its numerical resolution is only {np.spacing(farthest):.1g} m"
            what = f"a coordinate of {farthest:g} m exceeds the limit of {FARTHEST:g} m: {resolution}"
            remedy = "use coordinates in metres, measured from an origin near the bench"
            yield Problem("origin", what, remedy)
        if any(self.x_axis) and any(self.y_axis):
            x, y = (np.array(v) / np.linalg.norm(v) for v in (self.x_axis, self.y_axis))
            if np.linalg.norm(np.cross(x, y)) < PARALLEL:
                yield Problem("y_axis", "is parallel to the x axis", "use a vector that is not parallel to x_axis")


class InertiaSection(Section):
    """Moments and products of inertia about the centre of mass, in body axes [kg m²]: xx = ∫ρ(y² + z²), xy = −∫ρxy."""

    xx: Annotated[Positive, INERTIA] = Field(description="Moment of inertia about the centroidal body x axis [kg m²].")
    yy: Annotated[Positive, INERTIA] = Field(description="Moment of inertia about the centroidal body y axis [kg m²].")
    zz: Annotated[Positive, INERTIA] = Field(description="Moment of inertia about the centroidal body z axis [kg m²].")
    xy: Annotated[float, INERTIA] = expert(0.0, description="Centroidal product of inertia −∫ρxy in body axes [kg m²].")
    xz: Annotated[float, INERTIA] = expert(0.0, description="Centroidal product of inertia −∫ρxz in body axes [kg m²].")
    yz: Annotated[float, INERTIA] = expert(0.0, description="Centroidal product of inertia −∫ρyz in body axes [kg m²].")

    @property
    def trace(self) -> float:
        """Sum of the moments [kg m²]."""
        return self.xx + self.yy + self.zz

    def problems(self) -> Iterator[Problem]:
        tensor = np.array([[self.xx, self.xy, self.xz], [self.xy, self.yy, self.yz], [self.xz, self.yz, self.zz]])
        least = np.linalg.eigvalsh(0.5 * self.trace * np.eye(3) - tensor)[0]
        if least < -1e-9 * self.trace:
            what = "one principal moment of inertia is larger than the sum of the other two principal moments: this is impossible"
            yield Problem("", what, "specify `inertia` about the centre of mass, with products of inertia xy = −∫ρxy")


class Moving(Section):
    """Initial pose and velocity of a body."""

    pose: PoseSection = with_defaults(
        PoseSection, "Initial pose of the body, in global axes. A flexible body with supports has no initial pose."
    )
    velocity: Annotated[Vector, VELOCITY] = expert(
        (0.0, 0.0, 0.0), description="Initial velocity of the origin of the body, in global axes [m/s]."
    )
    spin: Annotated[Vector, SPIN] = expert(
        (0.0, 0.0, 0.0), description="Initial angular velocity of the body, in global axes [rad/s]."
    )


class RigidBodySection(Moving):
    """A rigid body."""

    type: Literal["rigid"] = Field(description="Kind of body: rigid body.")
    mass: Annotated[Positive, Plausible(1e-6, 1e8, "kg")] = Field(description="Mass of the body [kg].")
    centre: Point = Field(
        (0.0, 0.0, 0.0), description="Position of the centre of mass relative to the body origin, in body axes [m]."
    )
    inertia: InertiaSection = Field(
        description="Moments and products of inertia about the centre of mass, in body axes."
    )

    def problems(self) -> Iterator[Problem]:
        """Radius of gyration √(½ tr I / m), which scales rotations against translations in the mass metric of the joints."""
        radius = float(np.sqrt(self.inertia.trace / 2) / np.sqrt(self.mass))
        low, high = GYRATION
        if not low <= radius <= high:
            yield Problem(
                "mass",
                f"a mass of {self.mass:g} kg and moments of inertia with a sum of {self.inertia.trace:.3g} kg m² "
                f"give a radius of gyration of {radius:.3g} m, outside the plausible {low:g} to {high:g} m",
                "check the units: mass in kg, moments of inertia in kg m²",
            )


class Modulus(Section):
    """A Young's modulus of one or more regions, as a parameter that can be estimated."""

    region: Id | Text | Annotated[tuple[Id | Text, ...], Field(min_length=1)] = Field(
        description="Region of the mesh with this modulus: id (PSOLID id) or name, or a list of ids and names."
    )
    value: YoungsModulus = Field(
        description="Young's modulus of these regions in this bench [Pa], instead of the modulus in the mesh file."
    )


class FlexibleBodySection(Moving, Damped):
    """A flexible body: a finite-element mesh with Craig-Bampton reduction."""

    type: Literal["flexible"] = Field(description="Kind of body: flexible body.")
    mesh: MeshFile = Field(
        description="Finite-element model of the body. Supports in the model fix the body to the ground."
    )
    scale: Annotated[Positive, Plausible(1e-3, 1e3)] = Field(
        1.0, description="Scale factor on all lengths of the mesh [-]; moduli and densities are unchanged."
    )
    modes: Annotated[Annotated[int, Field(ge=0)] | None, Plausible(0, 500)] = Field(
        None, description="Number of fixed-interface modes [-]; null: computed from `cutoff`, or 10 without `cutoff`."
    )
    cutoff: Frequency | None = expert(
        None,
        description="The reduced body reproduces natural frequencies of the mesh up to this value [Hz] to 0.5 %; the "
        "number of modes is computed accordingly. Do not set `modes` as well.",
    )
    moduli: dict[Name, Modulus] = Field(
        {}, description="Young's moduli that can be estimated as parameters, by parameter name."
    )

    def problems(self) -> Iterator[Problem]:
        if self.modes is not None and self.cutoff is not None:
            yield Problem("cutoff", "'modes' and 'cutoff' are both set", "remove one of the two keys")
        for key in ("matrices", "results"):
            if getattr(self.mesh, key) is not None:
                what = f"a flexible body of a bench does not support imported {key}"
                yield Problem(f"mesh.{key}", what, f"remove mesh.{key}, and use a mesh of solid elements")
        if self.mesh.free:
            yield Problem(
                "mesh.free", "has no effect: a body without supports is always free", "remove the key", at_key=True
            )


Body = Annotated[RigidBodySection | FlexibleBodySection, Field(discriminator="type")]


class FrameSection(Section):
    """A point with three axes, on a body or on the ground."""

    body: BodyName = Field(description="Name of the body with the frame, or 'ground'.")
    node: NodeId | None = Field(
        None,
        description="Node id of the frame origin, required on a flexible body: reference node of a rigid element (RBE2).",
    )
    pose: PoseSection = with_defaults(
        PoseSection,
        "Pose of the frame in the axes of the body; for a frame on the ground, in global axes. With `node`, omit "
        "`pose.origin`: the node is the origin of the frame.",
    )


Bearings = BearingName | Annotated[tuple[BearingName, ...], Field(min_length=1)] | None
"""Names of bearings; None: all."""


RADII = ("radius_inner_left", "radius_inner_right", "radius_outer_left", "radius_outer_right")
"""Groove radii of a bearing."""

GrooveRadius = Annotated[Positive, Plausible(2.5e-4, 0.2, "m")]


class BearingSection(Section):
    """A four-point-contact ball bearing (thesis of Cottone 2022, equations 1.18 to 1.25)."""

    balls: int = Field(ge=3, le=10000, description="Number of balls [-].")
    ball_diameter: Annotated[Positive, Plausible(5e-4, 0.2, "m")] = Field(description="Diameter of the balls [m].")
    pitch_diameter: Annotated[Positive, Plausible(5e-3, 20.0, "m")] = Field(
        description="Pitch diameter: diameter of the circle of ball centres [m]."
    )
    contact_angle: Annotated[float, Plausible(5.0, 85.0, "deg")] = Field(
        gt=0, lt=90, description="Free contact angle [deg]."
    )
    radius_inner_left: GrooveRadius = Field(
        description="Groove radius of the left inner raceway (towards negative x) [m]; larger than half of `ball_diameter`."
    )
    radius_inner_right: GrooveRadius = Field(
        description="Groove radius of the right inner raceway (towards positive x) [m]; larger than half of `ball_diameter`."
    )
    radius_outer_left: GrooveRadius = Field(
        description="Groove radius of the left outer raceway (towards negative x) [m]; larger than half of `ball_diameter`."
    )
    radius_outer_right: GrooveRadius = Field(
        description="Groove radius of the right outer raceway (towards positive x) [m]; larger than half of `ball_diameter`."
    )
    preload: Annotated[float, Plausible(0.0, 1e-3, "m")] = Field(
        0.0,
        description="Preload, as the radial oversize of the balls [m]; negative: clearance. At most 2 % of `ball_diameter`.",
    )
    groove_centres: Literal["follow", "fixed"] = Field(
        "follow",
        description="Effect of a change of the ball diameter or a groove radius, for example in an estimate. With `follow`: "
        "the groove centres move, and the contact point at the free contact angle stays in place. With `fixed`: the groove "
        "centres stay in place, and the change causes interference.",
    )
    youngs_modulus: Annotated[Positive, Plausible(1e10, 1e12, "Pa")] = expert(
        2.08e11, description="Young's modulus of balls and rings [Pa]."
    )
    poisson_ratio: float = expert(0.3, gt=-1, lt=0.5, description="Poisson's ratio of balls and rings [-].")
    density: Annotated[Positive, DENSITY] = expert(
        7850.0, description="Density of the balls [kg/m³], for the centrifugal force of the balls."
    )
    speed: Annotated[float, SPIN] = expert(
        0.0, description="Angular speed of the inner ring [rad/s], for the centrifugal force of the balls."
    )
    pressure_limit: Annotated[Positive, Plausible(1e8, 1e10, "Pa")] = Field(
        4.2e9,
        description="Contact pressure above which a warning is printed [Pa]. At 4200 MPa, the permanent deformation of a "
        "hardened raceway is 1e-4 of the ball diameter (ISO 76).",
    )
    first_ball: Annotated[float, ANGLE] = expert(
        0.0,
        description="Angular position of the first ball about the bearing axis (x), from the y axis towards the z axis [deg].",
    )

    def problems(self) -> Iterator[Problem]:
        """Check the geometry as `multibody.bearing.geometry` does, but with file, line and all problems at once."""
        half = self.ball_diameter / 2
        limit = LARGEST_PRELOAD * self.ball_diameter
        if abs(self.preload) > limit:
            yield Problem(
                "preload",
                f"the preload of {self.preload:g} m exceeds ±{limit:g} m, {100 * LARGEST_PRELOAD:g} % of the ball diameter",
                "set the radial oversize of the balls in metres, negative for clearance; typical values are 1e-5 to 1e-4 m",
            )
        for radius in RADII:
            value = getattr(self, radius)
            if not value > half:
                what = f"the groove radius of {value:g} m is not larger than half the ball diameter, {half:g} m"
                yield Problem(radius, what, "use a larger groove radius, typically 1.03 to 1.06 times the ball radius")
            elif not value > half + self.preload and self.preload <= limit:
                what = (
                    f"balls with a radius of {half:g} m and an oversize of {self.preload:g} m do not fit into "
                    f"the groove with the radius {value:g} m ({radius})"
                )
                yield Problem("preload", what, f"use a preload below {value - half:.6g} m, or a larger {radius}")
        if self.ball_diameter * self.balls > np.pi * self.pitch_diameter:
            what = (
                f"{self.balls} balls with a diameter of {self.ball_diameter:g} m do not fit on a pitch circle of "
                f"{self.pitch_diameter:g} m"
            )
            yield Problem("balls", what, f"use at most {int(np.pi * self.pitch_diameter / self.ball_diameter)} balls")


class OfBearings(Section):
    """Key shared by all sections for one, several or all bearings."""

    bearing: Bearings = Field(
        None, description="Name of the bearing for the computation, or a list of names; null: all bearings."
    )

    def includes(self, name: str) -> bool:
        """Whether the section applies to this bearing."""
        return self.bearing is None or name in ((self.bearing,) if isinstance(self.bearing, str) else self.bearing)


class LoadCase(OfBearings):
    """A load on the inner ring, with the outer ring fixed."""

    force: Annotated[tuple[float, float, float], FORCE] = Field(
        (0.0, 0.0, 0.0), description="Force on the inner ring along the x axis (bearing axis), y axis and z axis [N]."
    )
    moment: Annotated[tuple[float, float], MOMENT] = Field(
        (0.0, 0.0), description="Moment on the inner ring about the y axis and z axis [N m]."
    )


class CurveSection(OfBearings):
    """A load-displacement curve: one displacement of the inner ring varies, the other displacements are zero."""

    along: Literal["x", "y", "z", "tilt_y", "tilt_z"] = Field(
        description="Displacement or tilt of the inner ring that varies along the curve."
    )
    reach: Annotated[Positive, Plausible(1e-9, 1.0, "m or rad")] = Field(
        description="Largest displacement [m] or tilt [rad]: the curve extends from −`reach` to `reach`. A "
        "displacement, or tilt × pitch radius, must not exceed the ball diameter."
    )
    points: int = Field(41, ge=3, le=10001, description="Number of points of the curve [-].")


class BearingLoads(Section):
    """Computations for single bearings, independent of the bench."""

    cases: dict[Name, LoadCase] = Field(
        {},
        description="Load cases of single bearings, by name: displacement, stiffness and ball loads are computed for each "
        "load case.",
    )
    curves: tuple[CurveSection, ...] = Field((), description="Load-displacement curves of single bearings.")


class BearingConfig(NamedRun, BearingLoads):
    """A single bearing: load-displacement curves, stiffness, and the load of every ball."""

    kind: Literal["bearing"] = Field(description="Which pipeline.")
    bearings: Annotated[dict[Name, BearingSection], Field(min_length=1)] = Field(description="Bearings, by name.")
