"""Plausible ranges of the numbers of a config, each stated with its field: `Annotated[float, Plausible(low, high, unit)]`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import inf
from typing import Any

from pydantic import BaseModel

from strainsight.config.marks import marked
from strainsight.config.problem import Problem

UNITS = {
    "-": {"per cent": 0.01},
    "m": {"mm": 1e-3, "µm": 1e-6, "inches": 0.0254},
    "s": {"ms": 1e-3, "µs": 1e-6},
    "deg": {"rad": 57.29577951308232},
    "rad": {"degrees": 0.017453292519943295},
    "Hz": {"rad/s": 0.15915494309189535, "kHz": 1e3},
    "Pa": {"GPa": 1e9, "MPa": 1e6, "psi": 6894.757},
    "kg/m³": {"g/cm³": 1e3, "t/mm³": 1e12, "kg/mm³": 1e9},
    "strain": {"µm/m": 1e-6, "per cent": 0.01},
    "kg": {"t": 1e3, "g": 1e-3},
}
"""Other units in which a number may have been written, and their factors."""


@dataclass(frozen=True)
class Plausible:
    """Marks a number that is plausible if it is 0 or its magnitude lies within low and high [unit]; share: where it is a length,
    and the size of the structure is known, at most so many times that."""

    low: float
    high: float
    unit: str = "-"
    share: float = inf

    def of(self, section: BaseModel) -> Plausible | None:
        return self

    def words(self) -> str:
        """`0.0005 to 0.2 m`, or `up to 360 deg`"""
        unit = "" if self.unit == "-" else f" {self.unit}"
        return f"{self.low:g} to {self.high:g}{unit}" if self.low else f"up to {self.high:g}{unit}"

    def __get_pydantic_json_schema__(self, core: Any, handler: Any) -> Any:
        return handler(core) | {"plausible": self.words()}


@dataclass(frozen=True)
class PlausibleBy:
    """Marks a number whose plausible range depends on another key of its section."""

    key: str
    ranges: Mapping[str, Plausible]

    def of(self, section: BaseModel) -> Plausible | None:
        return self.ranges.get(getattr(section, self.key))

    def __get_pydantic_json_schema__(self, core: Any, handler: Any) -> Any:
        cases: dict[str, list[str]] = {}
        for case, own in self.ranges.items():
            cases.setdefault(own.words(), []).append(case)
        return handler(core) | {"plausible": "; ".join(f"{words} ({', '.join(of)})" for words, of in cases.items())}


@dataclass(frozen=True)
class Unbounded:
    """Marks a number of which any value is plausible."""

    reason: str

    def of(self, section: BaseModel) -> Plausible | None:
        return None


Marker = Plausible | PlausibleBy | Unbounded

PRICE = Unbounded("in any currency")
READING = Unbounded("in the unit of the file")
COMPARED = Unbounded("a number of any stage")

SIZE = Plausible(1e-6, 100.0, "m", share=1.0)
GRID = Plausible(1e-4, 0.3, "m", share=1.0)
MISPLACED = Plausible(1e-6, 0.1, "m", share=0.1)
SNAP = Plausible(1e-9, 0.1, "m", share=1.0)
ANGLE = Plausible(0.0, 360.0, "deg")
MISALIGNED = Plausible(0.01, 20.0, "deg")
TURN = Plausible(0.0, 6.2832, "rad")
DURATION = Plausible(1e-4, 1e6, "s")
INSTANT = Plausible(0.0, 1e6, "s")
FREQUENCY = Plausible(1e-4, 1e5, "Hz")
SPIN = Plausible(0.0, 1e4, "rad/s")
VELOCITY = Plausible(0.0, 1e3, "m/s")
MODULUS = Plausible(1e5, 2e12, "Pa")
DENSITY = Plausible(1.0, 2.5e4, "kg/m³")
INERTIA = Plausible(1e-12, 1e10, "kg m²")
STIFFNESS = Plausible(1e-6, 1e15, "N/m or N m/rad")
VISCOUS = Plausible(1e-9, 1e12, "N s/m or N m s/rad")
FORCE = Plausible(0.0, 1e9, "N")
MOMENT = Plausible(0.0, 1e10, "N m")
DRIVEN = Plausible(0.0, 1e10, "N, N m or the unit of the drive")
DAMPING = Plausible(1e-5, 0.2)
KAPPA = Plausible(1e-6, 1e4)
STRAIN = Plausible(1e-9, 1e-2, "strain")
STRAIN_RANGE = Plausible(1e-5, 0.5, "strain")
NOISE = Plausible(1e-12, 1e3, "strain, m, m/s² or rad")
GAIN = Plausible(1e-5, 0.2)
RELATIVE_STD = Plausible(1e-6, 100.0)
SCALE = Plausible(1e-6, 1e6)
GAUGE_FACTOR = Plausible(1.0, 200.0)
RESISTANCE = Plausible(50.0, 1e4, "Ω")
PARAMETER = Plausible(1e-15, 2e12, "Pa, kg/m³, m or 1")
FACTOR = Plausible(0.01, 100.0)
PROPERTY = PlausibleBy(
    "property",
    {
        "youngs_modulus": MODULUS,
        "density": DENSITY,
        "thickness": Plausible(1e-5, 2.0, "m", share=1.0),
        **dict.fromkeys(("e1", "e2", "g12", "g1z", "g2z"), MODULUS),
        **dict.fromkeys(
            ("stiffness_factor", "area_factor", "bending_factor", "torsion_factor", "damping_factor"), FACTOR
        ),
    },
)


def implausible(config: BaseModel, extent: float = inf) -> Iterator[Problem]:
    """Every number of a config outside its plausible range; extent: size of the structure [m]."""
    for number in marked(config, Marker):
        limits = number.mark.of(number.section)
        if limits is not None and not isinstance(number.value, str):
            yield from _outside(number.key, number.value, limits, extent)


def _outside(key: str, value: float, limits: Plausible, extent: float) -> Iterator[Problem]:
    size, unit = abs(value), "" if limits.unit == "-" else f" {limits.unit}"
    if value != 0 and not limits.low <= size <= limits.high:
        others = UNITS.get(limits.unit, {}).items()
        meant = (
            f"if {value:g} is in {other}, write {value * factor:.4g}"
            for other, factor in others
            if limits.low <= size * factor <= limits.high
        )
        what = f"{value:g}{unit} is outside the plausible range of {limits.words()}"
        yield Problem(key, what, next(meant, "check the value and its unit"))
    elif size > limits.share * extent:
        share = "" if limits.share == 1 else f"{limits.share:g} times "
        what = f"{value:g} m is more than {share}the size of the structure, {extent:.4g} m"
        yield Problem(
            key, what, f"lengths of the config are in m: give at most {limits.share * extent:.2g}, or check the mesh"
        )
