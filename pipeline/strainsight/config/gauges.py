"""Where gauges may go, along what, how noisy they are; those already bonded; accelerometers and displacement sensors."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, Tag

from strainsight.config.base import DirectionVector, Name, NotNegative, Point, Positive, Section, Size, Text
from strainsight.config.gauge_types import GaugeType, TypeName
from strainsight.config.plausible import ANGLE, GRID, NOISE, PRICE, SNAP, STRAIN_RANGE, Plausible
from strainsight.config.zones import Zone, key_of

Angles = Annotated[tuple[float, ...], Field(min_length=1), ANGLE]


class AxisDirection(Section):
    """Gauges along an axis projected on the facet, and turned by angles."""

    type: Literal["axis"] = Field(description="Kind of direction.")
    axis: DirectionVector = Field(description="Axis in global coordinates [-]; its length does not matter.")
    angles: Angles = Field(
        (0.0,),
        description="Angles from the projected axis, right-handed about the outward normal [deg]; a candidate each, or the "
        "grids of a rosette.",
    )


class PrincipalDirection(Section):
    """Gauges along the direction that strains most in the training run, facet by facet, and turned by angles."""

    type: Literal["principal"] = Field(description="Kind of direction.")
    angles: Angles = Field((0.0,), description="Angles from it, right-handed about the outward normal [deg].")


Direction = Annotated[AxisDirection | PrincipalDirection, Field(discriminator="type")]


class RelativeNoise(Section):
    """Noise as a share of the strongest candidate."""

    relative_to_strongest: Annotated[Positive, Plausible(1e-9, 1.0)] = Field(
        description="Noise standard deviation over the largest RMS reading [-]."
    )


class AbsoluteNoise(Section):
    """Noise in the unit of the reading."""

    value: Annotated[Positive, NOISE] = Field(
        description="Noise standard deviation of one sample at train.time_step [strain, m/s² or m]."
    )


NoiseStd = Annotated[
    Annotated[RelativeNoise, Tag("relative_to_strongest")] | Annotated[AbsoluteNoise, Tag("value")],
    key_of("relative_to_strongest", "value"),
]


class GivenGauges(Section):
    """Candidates by their strain rows, where the solids of the mesh do not carry them (shells, beams)."""

    rows: Text = Field(description="Matrix file (.mtx, .npz, .op4): strain of each gauge per motion of each row.")
    table: Text = Field(
        description="CSV file, one line a gauge: gauge,x,y,z,dx,dy,dz (number, position in the mesh's unit, direction)."
    )


class BondedGauge(Section):
    """A gauge that is already bonded, and so in every layout."""

    position: Point = Field(description="Position of its centre [m]; it is moved to the nearest point of the surface.")
    direction: DirectionVector = Field(description="Measuring direction [-]; it is laid on the surface there.")
    length: Annotated[NotNegative | None, GRID] = Field(
        None,
        description="Length of its grid [m], over which it averages; null: gauges.grid_length, on a bench the strain at its "
        "centre.",
    )
    angles: Angles = Field(
        (0.0,), description="Angles of its grids from the direction, right-handed about the outward normal [deg]."
    )


class NamedGauge(BondedGauge):
    """A gauge with a name of its own."""

    name: Name | None = Field(None, description="What it is called wherever it is named; null: the next free number.")


class BridgeArm(Section):
    """One arm of a bridge: a gauge that is bonded."""

    position: Point = Field(description="Position of its centre [m]; it is moved to the nearest point of the surface.")
    direction: DirectionVector = Field(description="Measuring direction [-]; it is laid on the surface there.")
    sign: Literal[1, -1] = Field(
        1, description="Of its strain in the reading: 1 for arms 1 and 3 of the bridge, -1 for 2 and 4."
    )
    length: Annotated[NotNegative | None, GRID] = Field(
        None, description="Length of its grid [m]; null: gauges.grid_length."
    )


class BondedBridge(Section):
    """A Wheatstone bridge that is already bonded: one reading, the signed sum of the strains of its arms."""

    arms: tuple[BridgeArm, ...] = Field(description="Two to four arms, at most two of either sign.")
    name: Name | None = Field(None, description="What it is called wherever it is named; null: the next free number.")


NamedGaugeOrBridge = Annotated[
    Annotated[NamedGauge, Tag("position")] | Annotated[BondedBridge, Tag("arms")], key_of("position", "arms")
]


class SensorSites(Section):
    """Where sensors may go, and what one costs."""

    surface: Text = Field("all", description="'all' exterior facets, or the name of a face, an element or node set.")
    include: tuple[Zone, ...] = Field((), description="Zones that they have to be in, one of them; none: everywhere.")
    exclude: tuple[Zone, ...] = Field(
        (),
        description="Zones without them; a name is that of a face, an element or node set, to which strain gauges keep their "
        "clearance, too.",
    )
    price: Annotated[NotNegative, PRICE] = Field(1.0, description="Price of one, in the unit of place.budget.")


class GaugeSites(SensorSites):
    """Where strain gauges may go, and how near those that are there already are to the surface."""

    snap_tolerance: Annotated[Positive, SNAP] = Field(
        0.005, description="How far a bonded gauge may be from the surface of the mesh before it is refused [m]."
    )


class Gauges(GaugeSites):
    """Where strain gauges may go, along what, and how noisy they are."""

    type: Text | None = Field(
        None,
        description="Type of gauge that is to be bonded, as 3/350: 3 mm, 350 Ω (1.5/350, 3/350, 6/350, 1.5/120, 3/120, 6/120, "
        "10/120, 3/350-rosette, or one of `types`). It gives what is not stated of grid_length, clearance, range, "
        "screen.minimum_spacing, place.minimum_spacing and tolerances.gain, and takes no place that bends tighter than it may; "
        "null: none.",
    )
    types: dict[TypeName, GaugeType] = Field({}, description="Types of gauges of one's own, by name, for `type`.")
    fixed: tuple[NamedGaugeOrBridge, ...] = Field(
        (),
        description="Gauges and bridges ({arms: […]}) that are already bonded; they count in place.keep, a bridge as one.",
    )
    fixed_file: Text | None = Field(
        None,
        description="CSV file of more of them, with their names: a gauges.csv that `place` has written, or one like it with "
        "gauge, position_x, …, direction_x, … in metres.",
    )
    direction: Direction | None = Field(
        None, description="Measuring directions of the candidates; left out only with `given`."
    )
    rosette: bool = Field(
        False,
        description="true: the angles of one place are a rosette, placed and removed as one; false: a gauge each.",
    )
    bridge: Literal["half-bending", "full-bending", "half-axial", "full-torsion"] | None = Field(
        None,
        description="Every candidate is a bridge with arms at a place and at the opposite one, through the body: it reads ε − ε′ "
        "(half-bending), 2 (ε − ε′) (full-bending), ε + ε′ (half-axial) or ε₊₄₅ − ε₋₄₅ + ε′₊₄₅ − ε′₋₄₅ (full-torsion); null: a "
        "gauge.",
    )
    grid_length: Annotated[NotNegative, GRID] = Field(
        0.0,
        description="Length of a gauge's grid [m], over which it averages; 0: the strain at its centre. With `type`: that of its "
        "grid.",
    )
    clearance: Size | Literal["none"] | None = Field(
        None,
        description="How far a gauge's centre stays from sharp edges, from nodes that are held or tied, from nodes that carry a "
        "load and from faces that `exclude` names, in a straight line [m], or 'none'; null: half the diagonal of the carrier of "
        "`type`, without one of the carrier that is assumed for its grid (3 mm where grid_length is 0: 4.6 mm), less where the "
        "part leaves no choice of places.",
    )
    given: GivenGauges | None = Field(None, description="Candidates by their strain rows, instead of a surface.")
    noise_std: NoiseStd = Field(description="Noise standard deviation of every gauge.")
    range: Annotated[Positive | None, STRAIN_RANGE] = Field(
        None,
        description="Largest strain that a gauge can measure, of a bridge an arm [strain]; candidates that see more in training "
        "are dropped. With `type`: its range.",
    )


class MotionSensors(SensorSites):
    """Accelerometers or displacement sensors that may be placed beside the strain gauges."""

    quantity: Literal["acceleration", "displacement"] = Field(description="What they measure: [m/s²] or [m].")
    axes: Annotated[tuple[DirectionVector | Literal["normal"], ...], Field(min_length=1, max_length=3)] = Field(
        ("normal",),
        description="Measuring directions, 'normal' to the surface or in global coordinates [-]; several are one sensor, as "
        "a triaxial one.",
    )
    every: Size | None = Field(None, description="Least distance between candidates [m]; null: one on every facet.")
    noise_std: NoiseStd = Field(description="Noise standard deviation of every channel.")
    range: Annotated[Positive | None, Plausible(1e-9, 1e6, "m/s² or m")] = Field(
        None, description="Largest reading [m/s² or m]; candidates that see more are dropped."
    )
