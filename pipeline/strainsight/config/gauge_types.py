"""Types of strain gauges, and the defaults of a config that follow from its type."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, ValidationError

from strainsight.config.base import (
    GAUGE_FACTOR,
    GRID,
    RESISTANCE,
    STRAIN_RANGE,
    NotNegative,
    Plausible,
    Positive,
    Problem,
    Section,
    expert,
)
from strainsight.errors import did_you_mean

if TYPE_CHECKING:
    from strainsight.config.gauges import Gauges

LEADS = 1.0
"""[Ω] Assumed lead wire resistance without compensation: a few metres of thin wire."""


class GaugeType(Section):
    """A type of strain gauge."""

    grid_length: Annotated[Positive, GRID] = Field(
        description="Length of the measuring grid [m]; the gauge measures the mean strain over the grid."
    )
    grid_width: Annotated[Positive, GRID] = Field(description="Width of the measuring grid [m].")
    carrier_length: Annotated[Positive, GRID] = Field(
        description="Length of the carrier along the grid, untrimmed [m]."
    )
    carrier_width: Annotated[Positive, GRID] = Field(description="Width of the carrier, untrimmed [m].")
    resistance: Annotated[Positive, RESISTANCE] = Field(description="Nominal resistance of the gauge [Ω].")
    gauge_factor: Annotated[Positive, GAUGE_FACTOR] = expert(
        2.0, description="Nominal gauge factor [-]; the gauge factor of the batch is printed on the package."
    )
    gauge_factor_tolerance: float = expert(
        0.01, gt=0, le=0.5, description="Relative tolerance of the gauge factor [-]; 0.01 is ±1 %."
    )
    range: Annotated[Positive, STRAIN_RANGE] = expert(
        0.05, description="Largest strain that the gauge can measure [strain]."
    )
    bend_radius: Annotated[NotNegative, Plausible(1e-4, 1.0, "m")] = expert(
        0.0, description="Smallest permitted bend radius of the gauge and its solder tabs [m]; 0: no limit."
    )
    grids: int = expert(
        default=1,
        ge=1,
        le=3,
        description="Number of measuring grids on the carrier [-]: 1 for a single gauge, 2 or 3 for a rosette.",
    )
    source: str = expert("", description="Manufacturer and model of the gauge, printed on the results page.")

    @property
    def spacing(self) -> float:
        """Smallest distance between the centres of two gauges [m]: the longer side of the carrier."""
        return max(self.carrier_length, self.carrier_width)


def _uw(pattern: str, grid: tuple[float, float], carrier: tuple[float, float], resistance: float) -> GaugeType:
    """A linear pattern of the CEA series; lengths in mm. Its range is 3 % below a grid length of 1/8 inch, otherwise 5 %."""
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
        source=f"data of Micro-Measurements CEA-06-{pattern}-{resistance:g}",
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
"""Gauge types by grid length in mm, rounded, over resistance in Ω.

Nominal dimensions and typical values of the data sheets: Micro-Measurements, Precision Strain Gages and Sensors (CEA series,
0°/45°/90° rosette UR), and Kyowa, Strain Gages (KFGS series). They specify no bend radius; HBK specifies 2 mm for its Y series
with solder tabs, 0.3 mm for the grid alone.
"""


def gauge_type(gauges: Gauges) -> GaugeType | None:
    """Gauge type of a config; user-defined types first. None if the config has no type."""
    return None if gauges.type is None else {**CATALOGUE, **gauges.types}[gauges.type]


def type_gain(kind: GaugeType) -> float:
    """σ of the gain of a gauge of this type:

        √(t² + (R_L/R)²)

    t: tolerance of its gauge factor, as if it were σ; R_L = `LEADS` over its resistance R, by which lead wires in series with the
    gauge make its reading smaller. 3/350: 0.58 %, 3/120: 0.97 %."""
    return float(round((kind.gauge_factor_tolerance**2 + (LEADS / kind.resistance) ** 2) ** 0.5, 6))


def type_problems(gauges: Gauges, required: int) -> Iterator[Problem]:
    """Yield a problem if the type is unknown, or if its number of grids differs from the required number."""
    if gauges.type is None:
        return
    known = {**CATALOGUE, **gauges.types}
    if gauges.type not in known:
        remedy = did_you_mean(
            gauges.type, known, f"known types: {', '.join(known)}; define other types under gauges.types"
        )
        yield Problem("gauges.type", f"unknown gauge type '{gauges.type}'", remedy)
    elif (grids := known[gauges.type].grids) != required:
        what = (
            f"gauge type {gauges.type} has {grids} measuring grid{'s' * (grids > 1)}, "
            f"but each gauge of the config needs {required}"
        )
        fitting = [name for name, kind in known.items() if kind.grids == required]
        remedy = (
            f"set gauges.type to {' or '.join(fitting)}"
            if fitting
            else f"define a type with `grids: {required}` in gauges.types"
        )
        yield Problem("gauges.type", what, remedy + "; for a rosette, set gauges.rosette: true" * (required == 1))


def filled(data: Mapping[str, Any]) -> Mapping[str, Any]:
    """Raw data of a placement, completed with the defaults of `gauges.type` for keys that are not in the config.

    Completed keys: gauges.grid_length, gauges.range, screen.minimum_spacing and place.minimum_spacing (longer side of the
    carrier), report.gauge_factor, report.resistance, and tolerances.gain (`type_gain`) if all sensors are strain gauges.
    Clearance and bend radius are read where they are used. Invalid data remain unchanged."""
    gauges = data.get("gauges")
    if (
        not isinstance(gauges, Mapping)
        or not isinstance(gauges.get("type"), str)
        or gauges.get("strain_operator") is not None
    ):
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
        section_data = data.get(section, {} if section in ("screen", "tolerances", "report") else None)
        if isinstance(section_data, Mapping):
            completed[section] = {**values, **section_data}
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
    """Gauge type for a part whose largest face is a square of this side [m]: the first of 3/350 and 1.5/350 with a carrier of at
    most a third of it, or None."""
    return next((name for name in ("3/350", "1.5/350") if CATALOGUE[name].carrier_length <= side / 3), None)
