"""Types of gauges, where they may go, along what, how noisy they are; those bonded already; motion sensors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal, Protocol

from pydantic import Field, Tag, ValidationError

from strainsight.config.base import (
    ANGLE,
    GAUGE_FACTOR,
    GRID,
    NOISE,
    PRICE,
    RESISTANCE,
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
from strainsight.config.layout import Zone, key_of
from strainsight.errors import did_you_mean

TypeName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_/-]*$", max_length=40)]
"""Of a type of one's own: letters, digits, _, - and /, as in 3/350."""
LEADS = 1.0
"""[Ω] of lead wires that nobody has allowed for: an assumption of ours, of a few metres of thin wire."""


class GaugeType(Section):
    """A type of strain gauge."""

    grid_length: Annotated[Positive, GRID] = Field(description="Length of its grid [m], over which it averages.")
    grid_width: Annotated[Positive, GRID] = Field(description="Width of its grid [m].")
    carrier_length: Annotated[Positive, GRID] = Field(
        description="Length of its carrier, along the grid, untrimmed [m]."
    )
    carrier_width: Annotated[Positive, GRID] = Field(description="Width of its carrier, untrimmed [m].")
    resistance: Annotated[Positive, RESISTANCE] = Field(description="Nominal resistance [Ω].")
    gauge_factor: Annotated[Positive, GAUGE_FACTOR] = expert(
        2.0, description="Nominal gauge factor [-]; that of the lot is on the package."
    )
    gauge_factor_tolerance: float = expert(0.01, gt=0, le=0.5, description="Tolerance of the gauge factor [-].")
    range: Annotated[Positive, STRAIN_RANGE] = expert(0.05, description="Largest strain that it can measure [strain].")
    bend_radius: Annotated[NotNegative, Plausible(1e-4, 1.0, "m")] = expert(
        0.0, description="Smallest radius to which it may be bent, solder tabs included [m]; 0: it follows any surface."
    )
    grids: int = expert(default=1, ge=1, le=3, description="Grids on the carrier: 1, or 2 and 3 of a rosette [-].")
    source: str = expert("", description="Whose gauge it is, for the page.")

    @property
    def spacing(self) -> float:
        """Between the centres of two gauges [m], one behind the other: the longer side of the carrier."""
        return max(self.carrier_length, self.carrier_width)


def _uw(pattern: str, grid: tuple[float, float], carrier: tuple[float, float], resistance: float) -> GaugeType:
    """A linear pattern of the CEA series; lengths in mm. Its range is 3 % below 1/8 inch and 5 % from there on."""
    return GaugeType(
        grid_length=1e-3 * grid[0],
        grid_width=1e-3 * grid[1],
        carrier_length=1e-3 * carrier[0],
        carrier_width=1e-3 * carrier[1],
        resistance=resistance,
        gauge_factor=2.1,
        gauge_factor_tolerance=0.005,
        range=0.05 if grid[0] > 3 else 0.03,
        bend_radius=0.002,
        source=f"as Micro-Measurements CEA-06-{pattern}-{resistance:g}",
    )


_SMALL = (1.57, 3.05), (7.9, 4.8)
_USUAL = (3.18, 4.57), (10.7, 6.9)
_LONG = (6.35, 4.57), (14.0, 6.9)
CATALOGUE: Mapping[str, GaugeType] = {
    "1.5/350": _uw("062UW", *_SMALL, 350.0),
    "3/350": _uw("125UW", *_USUAL, 350.0),
    "6/350": _uw("250UW", *_LONG, 350.0),
    "1.5/120": _uw("062UW", *_SMALL, 120.0),
    "3/120": _uw("125UW", *_USUAL, 120.0),
    "6/120": _uw("250UW", *_LONG, 120.0),
    "10/120": _uw("", (10.0, 3.0), (16.0, 5.2), 120.0).model_copy(
        update={"carrier_width": 0.0052, "gauge_factor_tolerance": 0.01, "source": "as Kyowa KFGS-10-120-C1"}
    ),
    "3/350-rosette": _uw("125UR", (3.18, 1.52), (10.7, 15.7), 350.0).model_copy(update={"grids": 3}),
}
"""By length of the grid in mm, rounded, over resistance in Ω. Nominal sizes and typical values of the data sheets of these types:
Micro-Measurements, Precision Strain Gages and Sensors (CEA series, 0°/45°/90° rosette UR), and Kyowa, Strain Gages (KFGS series).
Neither states a bend radius for them: 2 mm is what HBK states of its Y series with solder tabs, 0.3 mm of the grid alone."""


class Typed(Protocol):
    """What says which type: the section `gauges`."""

    @property
    def type(self) -> str | None: ...

    @property
    def types(self) -> Mapping[str, GaugeType]: ...


def gauge_type(gauges: Typed) -> GaugeType | None:
    """The type that a config names, its own ones first; None where it names none."""
    return None if gauges.type is None else {**CATALOGUE, **gauges.types}[gauges.type]


def type_gain(kind: GaugeType) -> float:
    """σ of the gain of a gauge of this type:

        √(t² + (R_L/R)²)

    t: tolerance of its gauge factor, as if it were σ; R_L = `LEADS` over its resistance R, by which lead wires in series with the
    gauge make its reading smaller. 3/350: 0.58 %, 3/120: 0.97 %.
    """
    return float(round((kind.gauge_factor_tolerance**2 + (LEADS / kind.resistance) ** 2) ** 0.5, 6))


def type_problems(gauges: Typed, rosette: int) -> Iterator[Problem]:
    """A type that is not there, or has other grids than the gauges; rosette: how many theirs have, 1 where they are none."""
    if gauges.type is None:
        return
    known = {**CATALOGUE, **gauges.types}
    if gauges.type not in known:
        remedy = did_you_mean(gauges.type, known, f"known: {', '.join(known)}; or describe it under gauges.types")
        yield Problem("gauges.type", f"no type of gauge is called '{gauges.type}'", remedy)
    elif (grids := known[gauges.type].grids) != rosette:
        what = f"{gauges.type} has {grids} grid{'s' * (grids > 1)}, and a gauge here has {rosette}"
        fitting = [name for name, kind in known.items() if kind.grids == rosette]
        remedy = f"take {' or '.join(fitting)}" if fitting else "describe the rosette under gauges.types"
        yield Problem("gauges.type", what, f"{remedy}; a rosette needs gauges.rosette: true")


def filled(data: Mapping[str, Any]) -> Mapping[str, Any]:
    """The raw data of a placement, with what follows from `gauges.type` where the config says nothing, null included:

        gauges.grid_length, gauges.range, screen.minimum_spacing and place.minimum_spacing (the longer side of the carrier),
        report.gauge_factor, report.resistance, and tolerances.gain (`type_gain`) where all sensors are strain gauges

    The clearance and the bend radius are looked up where they are used. Data that are not valid stay as they are.
    """
    gauges = data.get("gauges")
    if not isinstance(gauges, Mapping) or not isinstance(gauges.get("type"), str) or gauges.get("given") is not None:
        return data
    kind = _named(gauges["type"], gauges.get("types"))
    if kind is None:
        return data
    wanted: dict[str, dict[str, float]] = {
        "gauges": {"grid_length": kind.grid_length, "range": kind.range},
        "screen": {"minimum_spacing": kind.spacing},
        "place": {"minimum_spacing": kind.spacing},
        "report": {"gauge_factor": kind.gauge_factor, "resistance": kind.resistance},
    }
    if not data.get("motion_sensors"):
        wanted["tolerances"] = {"gain": type_gain(kind)}
    completed = dict(data)
    for section, values in wanted.items():
        stated = data.get(section, {} if section in ("screen", "tolerances", "report") else None)
        if isinstance(stated, Mapping):
            completed[section] = {**values, **stated}
    return completed


def _named(name: str, types: Any) -> GaugeType | None:
    described = types.get(name) if isinstance(types, Mapping) else None
    if described is None:
        return CATALOGUE.get(name)
    try:
        return GaugeType.model_validate(described, strict=False)
    except ValidationError:
        return None


def fitting_type(side: float) -> str | None:
    """The type for a part whose largest face is a square of this side [m]: the first of 3/350 and 1.5/350 whose carrier is no
    longer than a third of it; None where it is for both."""
    return next((name for name in ("3/350", "1.5/350") if CATALOGUE[name].carrier_length <= side / 3), None)


Angles = Annotated[tuple[float, ...], Field(min_length=1), ANGLE]


class Angled(Section):
    """What measures along several angles."""

    angles: Angles = Field(
        (0.0,),
        description="Angles from the direction, of an axis as it is projected on the facet, right-handed about the outward "
        "normal [deg]; a candidate each, or the grids of a rosette.",
    )

    def problems(self) -> Iterator[Problem]:
        # A gauge turned by half a turn is the same gauge.
        if len({angle % 180 for angle in self.angles}) < len(self.angles):
            yield Problem("angles", "two angles are the same direction", "remove one of them")


class AxisDirection(Angled):
    """Gauges along an axis projected on the facet, and turned by angles."""

    type: Literal["axis"] = Field(description="Kind of direction.")
    axis: DirectionVector = Field(description="Axis in global coordinates [-]; its length does not matter.")


class PrincipalDirection(Angled):
    """Gauges along the direction that strains most in the training run, facet by facet, and turned by angles."""

    type: Literal["principal"] = Field(description="Kind of direction.")


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


class GaugeRows(Section):
    """Candidates by their strain rows, where the solids of the mesh do not carry them (shells, beams)."""

    rows: Text = Field(description="Matrix file (.mtx, .npz, .op4): strain of each gauge per motion of each row.")
    table: Text = Field(
        description="CSV file, one line a gauge: gauge,x,y,z,dx,dy,dz (number, position in the mesh's unit, direction)."
    )


class BondedGrid(Section):
    """A grid that is already bonded."""

    position: Point = Field(description="Position of its centre [m]; it is moved to the nearest point of the surface.")
    direction: DirectionVector = Field(description="Measuring direction [-]; it is laid on the surface there.")
    length: Annotated[NotNegative | None, GRID] = Field(
        None,
        description="Length of its grid [m], over which it averages; null: gauges.grid_length, on a bench the strain at its "
        "centre.",
    )


class Named(Section):
    """What may have a name of its own."""

    name: Name | None = Field(None, description="What it is called wherever it is named; null: the next free number.")


class BondedGauge(BondedGrid, Angled):
    """A gauge that is already bonded, and so in every layout."""


class NamedGauge(BondedGauge, Named):
    """A gauge with a name of its own."""


class BridgeArm(BondedGrid):
    """One arm of a bridge: a gauge that is bonded."""

    sign: Literal[1, -1] = Field(
        1, description="Of its strain in the reading: 1 for arms 1 and 3 of the bridge, -1 for 2 and 4."
    )


def bridge_problem(signs: Sequence[float]) -> tuple[str, str] | None:
    """What arms with these signs have that a Wheatstone bridge has not, and the remedy; None: they are one."""
    count = f"{len(signs)} arm{'s' * (len(signs) != 1)}"
    if len(signs) < 2:
        return count, "give two to four arms; one alone is a gauge: position, direction"
    if not {*signs} <= {1, -1}:
        return f"an arm of sign {next(s for s in signs if s not in (1, -1)):g}", "give 1 or -1"
    for sign in (1, -1):
        if (alike := list(signs).count(sign)) > 2:
            return (
                f"{alike} arms of sign {sign}",
                "give at most two of either sign: arms 1 and 3 raise the output, 2 and 4 lower it",
            )
    if 1 not in signs:
        return f"{count}, none of sign 1", "turn all signs, and state sign: -1 of the channel in estimate"
    return None


class BondedBridge(Named):
    """A Wheatstone bridge that is already bonded: one reading, the signed sum of the strains of its arms."""

    arms: tuple[BridgeArm, ...] = Field(description="Two to four arms, at most two of either sign.")

    def problems(self) -> Iterator[Problem]:
        if problem := bridge_problem([arm.sign for arm in self.arms]):
            yield Problem("arms", f"a bridge of {problem[0]}", problem[1])


NamedGaugeOrBridge = Annotated[
    Annotated[NamedGauge, Tag("position")] | Annotated[BondedBridge, Tag("arms")], key_of("position", "arms")
]


class Priced(Section):
    """What costs something."""

    price: Annotated[NotNegative, PRICE] = expert(
        1.0, description="Price of one, of a sensor of a bench of each component, in the unit of place.budget."
    )


class Snapped(Section):
    """What is moved to the surface of the mesh."""

    snap_tolerance: Annotated[Positive, Plausible(1e-9, 0.1, "m", share=1.0)] = expert(
        0.005, description="How far a bonded gauge may be from the surface of the mesh before it is refused [m]."
    )


class Noisy(Section):
    """What is read with noise."""

    noise_std: NoiseStd = Field(description="Noise standard deviation of every channel.")


class SensorSites(Priced):
    """Where sensors may go, and what one costs."""

    surface: Text = Field("all", description="'all' exterior facets, or the name of a face, an element or node set.")
    include: tuple[Zone, ...] = expert((), description="Zones that they have to be in, one of them; none: everywhere.")
    exclude: tuple[Zone, ...] = Field(
        (),
        description="Zones without them; a name is that of a face, an element or node set, to which strain gauges keep their "
        "clearance, too.",
    )


class GaugeSites(SensorSites, Snapped):
    """Where strain gauges may go, and how near those that are there already are to the surface."""


class Gauges(GaugeSites, Noisy):
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
    rosette: bool = expert(
        False,
        description="true: the angles of one place are a rosette, placed and removed as one; false: a gauge each.",
    )
    bridge: Literal["half-bending", "full-bending", "half-axial", "full-torsion"] | None = Field(
        None,
        description="Every candidate is a bridge with arms at a place and at the opposite one, through the body: it reads ε − ε′ "
        "(half-bending), 2 (ε − ε′) (full-bending), ε + ε′ (half-axial) or ε₊₄₅ − ε₋₄₅ + ε′₊₄₅ − ε′₋₄₅ (full-torsion); null: a "
        "gauge.",
    )
    grid_length: Annotated[NotNegative, GRID] = expert(
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
    given: GaugeRows | None = Field(None, description="Candidates by their strain rows, instead of a surface.")
    range: Annotated[Positive | None, STRAIN_RANGE] = expert(
        None,
        description="Largest strain that a gauge can measure, of a bridge an arm [strain]; candidates that see more in training "
        "are dropped. With `type`: its range.",
    )


class MotionSensors(SensorSites, Noisy):
    """Accelerometers or displacement sensors that may be placed beside the strain gauges."""

    quantity: Literal["acceleration", "displacement"] = Field(description="What they measure: [m/s²] or [m].")
    axes: Annotated[tuple[DirectionVector | Literal["normal"], ...], Field(min_length=1, max_length=3)] = Field(
        ("normal",),
        description="Measuring directions, 'normal' to the surface or in global coordinates [-]; several are one sensor, as "
        "a triaxial one.",
    )
    every: Size | None = Field(None, description="Least distance between candidates [m]; null: one on every facet.")
    range: Annotated[Positive | None, Plausible(1e-9, 1e6, "m/s² or m")] = expert(
        None, description="Largest reading [m/s² or m]; candidates that see more are dropped."
    )
