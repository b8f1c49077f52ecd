"""Candidate locations, measuring directions and noise; bonded gauges; motion sensors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Literal

from pydantic import Field, Tag

from strainsight.config.base import (
    ANGLE,
    GRID,
    NOISE,
    PRICE,
    STRAIN_RANGE,
    DirectionVector,
    Name,
    NotNegative,
    Plausible,
    Point,
    Positive,
    Problem,
    Section,
    Size,
    Text,
    expert,
)
from strainsight.config.gauge_types import GaugeType
from strainsight.config.layout import Zone, key_of


class Angled(Section):
    """Several measuring directions, as angles from one direction."""

    angles: Annotated[tuple[float, ...], Field(min_length=1), ANGLE] = Field(
        (0.0,),
        description="Angles from the measuring direction, counter-clockwise about the outward normal [deg]; the direction is "
        "first projected onto the surface. For a candidate, each angle is a separate gauge, or with gauges.rosette a measuring "
        "grid of the rosette. For a bonded gauge, each angle is a measuring grid of this gauge.",
    )

    def problems(self) -> Iterator[Problem]:
        # A gauge turned by half a turn is the same gauge.
        if len({angle % 180 for angle in self.angles}) < len(self.angles):
            yield Problem("angles", "two angles have the same direction", "remove one of the two angles")


class AxisDirection(Angled):
    """Measuring directions along an axis that is projected onto the facet, and rotated by angles."""

    type: Literal["axis"] = Field(description="Kind of measuring direction: along a projected axis.")
    axis: DirectionVector = Field(description="Axis in global coordinates [-]; its length is not used.")


class PrincipalDirection(Angled):
    """Measuring directions along the principal strain direction of each facet in the training simulation (stage `train`),
    rotated by angles."""

    type: Literal["principal"] = Field(description="Kind of measuring direction: along a principal strain.")


Direction = Annotated[AxisDirection | PrincipalDirection, Field(discriminator="type")]


class RelativeNoise(Section):
    """Noise relative to the largest RMS reading of the candidates."""

    relative_to_strongest: Annotated[Positive, Plausible(1e-9, 1.0)] = Field(
        description="Noise standard deviation of one sample, divided by the largest RMS reading of all candidates in the "
        "training simulation (stage `train`) [-]."
    )


class AbsoluteNoise(Section):
    """Noise in the unit of the readings."""

    value: Annotated[Positive, NOISE] = Field(
        description="Noise standard deviation of one sample at the sampling interval train.time_step [strain, m/s² or m]."
    )


NoiseStd = Annotated[
    Annotated[RelativeNoise, Tag("relative_to_strongest")] | Annotated[AbsoluteNoise, Tag("value")],
    key_of("relative_to_strongest", "value"),
]


class GaugeRows(Section):
    """Candidates defined by rows of the strain operator from another program. Requires mesh.matrices."""

    rows: Text = Field(
        description="Matrix file (.mtx, .npz, .op4) with one row for each gauge: strain of the gauge per unit displacement or "
        "rotation of each degree of freedom."
    )
    table: Text = Field(
        description="CSV file with one line for each gauge and the header gauge,x,y,z,dx,dy,dz: number of the gauge, position in "
        "the length unit of the mesh, and measuring direction."
    )


class BondedGrid(Section):
    """A bonded measuring grid."""

    position: Point = Field(
        description="Position of the grid centre [m]; the grid centre is moved to the nearest point of the surface."
    )
    direction: DirectionVector = Field(
        description="Measuring direction, in coordinates of the mesh [-]; the direction is projected onto the surface."
    )
    length: Annotated[NotNegative | None, GRID] = Field(
        None,
        description="Length of the measuring grid [m]. Null: gauges.grid_length for a structure; 0 (strain at the grid centre) "
        "for a bench.",
    )


class Named(Section):
    """A gauge or bridge with a name."""

    name: Name | None = Field(
        None, description="Name of the gauge in tables and files; null: the next free label, such as G1."
    )


class BondedGauge(BondedGrid, Angled):
    """A bonded gauge, which is part of every layout."""


class NamedGauge(BondedGauge, Named):
    """A bonded gauge with a name."""


class BridgeArm(BondedGrid):
    """One arm of a bridge: a bonded gauge."""

    sign: Literal[1, -1] = Field(
        1, description="Sign of the arm in the reading [-]: 1 for arms 1 and 3 of the bridge, −1 for arms 2 and 4."
    )


def bridge_problem(signs: Sequence[float]) -> tuple[str, str] | None:
    """Fault of a bridge with these arm signs and its remedy, or None."""
    if len(signs) < 2:
        return (
            f"the bridge has {len(signs)} arm{'s' * (len(signs) != 1)}",
            "use two to four arms; for a single gauge, set `position` and `direction` instead of `arms`",
        )
    if not {*signs} <= {1, -1}:
        return (
            f"an arm of the bridge has the sign {next(s for s in signs if s not in (1, -1)):g}",
            "set `sign` to 1 or -1",
        )
    for sign in (1, -1):
        if (equal := list(signs).count(sign)) > 2:
            return (
                f"{equal} arms of the bridge have the sign {sign}",
                "use at most two arms of each sign: arms 1 and 3 increase the output, arms 2 and 4 reduce it",
            )
    if 1 not in signs:
        return (
            "no arm of the bridge has the sign 1",
            "reverse `sign` of every arm, and set `sign: -1` for the channel in estimate.channels",
        )
    return None


class BondedBridge(Named):
    """A bonded Wheatstone bridge: its reading is the signed sum of the arm strains."""

    arms: tuple[BridgeArm, ...] = Field(
        description="Two to four arms of the bridge, with at most two arms of each sign."
    )

    def problems(self) -> Iterator[Problem]:
        if problem := bridge_problem([arm.sign for arm in self.arms]):
            yield Problem("arms", *problem)


NamedGaugeOrBridge = Annotated[
    Annotated[NamedGauge, Tag("position")] | Annotated[BondedBridge, Tag("arms")], key_of("position", "arms")
]


class Priced(Section):
    """Sensors with a price."""

    price: Annotated[NotNegative, PRICE] = expert(
        1.0,
        description="Price of one sensor in the unit of place.budget; in a bench, price of each component of the sensor.",
    )


class Snapped(Section):
    """Bonded gauges, which are moved to the nearest point on the surface of the mesh."""

    snap_tolerance: Annotated[Positive, Plausible(1e-9, 0.1, "m", share=1.0)] = expert(
        0.005, description="Largest accepted distance of a bonded gauge from the surface of the mesh [m]."
    )


class Noisy(Section):
    """Sensors with measurement noise."""

    noise_std: NoiseStd = Field(description="Noise standard deviation of one sample of every channel.")


class SensorSites(Priced):
    """Candidate locations of sensors, and their price."""

    surface: Text = Field(
        "all",
        description="Surface with the candidate locations: 'all' (all exterior facets), or the name of a face, an element set "
        "or a node set.",
    )
    include: tuple[Zone, ...] = expert(
        (),
        description="Zones for candidates; each candidate is in at least one of these zones. Empty list: no restriction.",
    )
    exclude: tuple[Zone, ...] = Field(
        (),
        description="Zones without candidates. A zone may be the name of a face, an element set or a node set; strain gauges "
        "then also keep the distance `clearance` from this face or set.",
    )


class GaugeSites(SensorSites, Snapped):
    """Candidate locations of strain gauges, and largest distance of bonded gauges from the surface."""


class Accessible(Section):
    """Sensors on places that can be reached by hand."""

    allow: tuple[Literal["enclosed", "bores", "loaded"], ...] = Field(
        (),
        description="Places for candidates that are excluded by default. With `enclosed`: surfaces with a view factor of the "
        "outside below 5 %, as inside a closed part. With `bores`: bores narrower than 60 mm, or with loads, supports or ties. "
        "With `loaded`: facets of solids under a load other than a pressure.",
    )


class Gauges(GaugeSites, Accessible, Noisy):
    """Candidate locations, measuring directions and noise of strain gauges."""

    type: Text | None = Field(
        None,
        description="Gauge type, named by grid length and resistance, as 3/350 for 3 mm and 350 Ω: 1.5/350, 3/350, 6/350, "
        "1.5/120, 3/120, 6/120, 10/120, 3/350-rosette, or a name of `types`. The type sets the defaults of grid_length, "
        "clearance, range, screen.minimum_spacing, place.minimum_spacing and tolerances.gain. Surfaces with a radius of "
        "curvature below the bend radius of the type are excluded. Null: no type.",
    )
    types: dict[Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_/-]*$", max_length=40)], GaugeType] = Field(
        {}, description="User-defined gauge types, by name; the name is a value of `type`."
    )
    fixed: tuple[NamedGaugeOrBridge, ...] = Field(
        (),
        description="Gauges and bridges ({arms: […]}) that are already bonded; each counts as one gauge in place.keep.",
    )
    fixed_file: Text | None = Field(
        None,
        description="CSV file with the names and locations of further bonded gauges: gauges.csv of the stage `place`, or a file "
        "with the columns gauge, position_x, …, direction_x, … in metres.",
    )
    direction: Direction | None = Field(
        None, description="Measuring directions of the candidates; required unless `strain_operator` is set."
    )
    rosette: bool = expert(
        False,
        description="`true`: the angles at one location are the measuring grids of one rosette, and are placed and removed "
        "together. `false`: each angle is a separate gauge.",
    )
    bridge: Literal["half-bending", "full-bending", "half-axial", "full-torsion"] | None = Field(
        None,
        description="Bridge of every candidate, with arms at the location (strain ε) and on the opposite side of the body "
        "(strain ε′). Readings: ε − ε′ (half-bending), 2 (ε − ε′) (full-bending), ε + ε′ (half-axial), ε₊₄₅ − ε₋₄₅ + ε′₊₄₅ "
        "− ε′₋₄₅ (full-torsion, arms at ±45°). Null: every candidate is a single gauge.",
    )
    grid_length: Annotated[NotNegative, GRID] = expert(
        0.0,
        description="Length of the measuring grid [m]; the gauge measures the mean strain over the grid. 0: strain at the grid "
        "centre. Default with `type`: grid length of the type.",
    )
    clearance: Size | Literal["none"] | None = Field(
        None,
        description="Smallest straight-line distance of a gauge centre from sharp edges, supported or tied nodes, loaded nodes "
        "and the faces in `exclude` [m], or 'none'. Null: half the diagonal of the carrier of `type`. Without `type`, the "
        "carrier size is assumed from `grid_length`: the default is 4.6 mm for a grid length of 3 mm or 0. If it leaves less "
        "than half of the separate locations (at least 20; 50 are enough), it is halved once or twice, and finally set to 0.",
    )
    strain_operator: GaugeRows | None = Field(
        None,
        description="Candidates defined by rows of the strain operator (strain per unit displacement or rotation of each degree "
        "of freedom), instead of locations on a surface. Requires mesh.matrices.",
    )
    range: Annotated[Positive | None, STRAIN_RANGE] = expert(
        None,
        description="Largest strain that a gauge or a bridge arm can measure [strain]; candidates with a larger strain in "
        "the training simulation (stage `train`) are removed. Default with `type`: range of the type.",
    )


class MotionSensors(SensorSites, Accessible, Noisy):
    """Candidate accelerometers or displacement sensors, in addition to the strain gauges."""

    quantity: Literal["acceleration", "displacement"] = Field(
        description="Measured quantity: acceleration [m/s²] or displacement [m]."
    )
    axes: Annotated[tuple[DirectionVector | Literal["normal"], ...], Field(min_length=1, max_length=3)] = Field(
        ("normal",),
        description="Measuring directions: 'normal' to the surface, or vectors in global coordinates [-]. Several directions "
        "belong to one sensor, such as a triaxial accelerometer.",
    )
    every: Size | None = Field(
        None, description="Smallest distance between candidates [m]; null: one candidate on every facet."
    )
    range: Annotated[Positive | None, Plausible(1e-9, 1e6, "m/s² or m")] = expert(
        None,
        description="Largest reading of the sensor [m/s² or m]; candidates with a larger reading in the training simulation "
        "(stage `train`) are removed.",
    )
