"""Four-point-contact ball bearings, and how one is looked at alone."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from strainsight.config.base import Name, Positive, RunName, Section, Seed
from strainsight.config.names import BearingName
from strainsight.config.plausible import ANGLE, DENSITY, FORCE, MOMENT, SPIN, Plausible

Bearings = BearingName | Annotated[tuple[BearingName, ...], Field(min_length=1)] | None
"""Names of bearings; None: all."""


RADII = ("radius_inner_left", "radius_inner_right", "radius_outer_left", "radius_outer_right")
"""Fields of a bearing that are the radius of a groove."""

GrooveRadius = Annotated[Positive, Plausible(2.5e-4, 0.2, "m")]


class Bearing(Section):
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
    youngs_modulus: Annotated[Positive, Plausible(1e10, 1e12, "Pa")] = Field(
        2.08e11, description="Young's modulus of balls and rings [Pa]."
    )
    poisson_ratio: float = Field(0.3, gt=-1, lt=0.5, description="Poisson's ratio of balls and rings [-].")
    density: Annotated[Positive, DENSITY] = Field(
        7850.0, description="Density of the balls [kg/m³], for their centrifugal force."
    )
    speed: Annotated[float, SPIN] = Field(
        0.0, description="Speed of the inner ring, for the centrifugal force [rad/s]."
    )
    pressure_limit: Annotated[Positive, Plausible(1e8, 1e10, "Pa")] = Field(
        4.2e9,
        description="Contact pressure beyond which a warning says so [Pa]: 4200 MPa is what presses a hardened raceway in by "
        "1e-4 of the ball (ISO 76).",
    )
    first_ball: Annotated[float, ANGLE] = Field(
        0.0, description="Station of the first ball, from the y axis towards z [deg]."
    )


class LoadCase(Section):
    """A load on the inner ring, the outer ring held."""

    force: Annotated[tuple[float, float, float], FORCE] = Field(
        (0.0, 0.0, 0.0), description="Along the bearing's axis x, y and z [N]."
    )
    moment: Annotated[tuple[float, float], MOMENT] = Field((0.0, 0.0), description="About y and z [N m].")
    bearing: Bearings = Field(None, description="Name of the bearing it loads, or a list of them; null: every one.")


class Curve(Section):
    """A load-displacement curve: one displacement of the inner ring runs, the others are held at zero."""

    along: Literal["x", "y", "z", "tilt_y", "tilt_z"] = Field(description="Which displacement.")
    reach: Annotated[Positive, Plausible(1e-9, 1.0, "m or rad")] = Field(
        description="It runs from −reach to reach [m or rad]; at the pitch circle at most the ball diameter."
    )
    points: int = Field(41, ge=3, le=10001, description="Points of the curve [-].")
    bearing: Bearings = Field(None, description="Name of the bearing it is of, or a list of them; null: every one.")


class BearingConfig(Section):
    """A bearing alone: load-displacement curves, stiffness, loads of every ball."""

    kind: Literal["bearing"] = Field(description="Which pipeline.")
    name: RunName = Field(description="Name of the run; its results go to results/NAME.")
    seed: Seed = Field(0, description="Seed of everything that is drawn at random [-].")
    bearings: Annotated[dict[Name, Bearing], Field(min_length=1)] = Field(description="Bearings, by name.")
    cases: dict[Name, LoadCase] = Field({}, description="Loads to find the displacement, stiffness and ball loads for.")
    curves: tuple[Curve, ...] = Field((), description="Load-displacement curves.")
