"""Base of all config models: sections, markers, plausible ranges, references between entries, problems."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Annotated, Any, get_args

from pydantic import BaseModel, ConfigDict, Field
from pydantic.fields import FieldInfo

from strainsight.errors import at_least, at_most, did_you_mean


def mark_of(field: FieldInfo, kind: Any) -> Any:
    """Marker of one kind (a class or a union of classes) in the annotation of a field, or None."""
    return next((item for item in _parts(field.annotation, *field.metadata) if isinstance(item, kind)), None)


@dataclass(frozen=True)
class Marked:
    """A text or number of a config, and a marker (such as `Plausible`) in the annotation of its field."""

    section: BaseModel
    field: str
    key: str
    value: str | int | float
    mark: Any


def marked(section: BaseModel, kind: Any, above: str = "") -> Iterator[Marked]:
    """Iterate over every text and number with a marker of this kind, in a section and below; above: dotted key of the section."""
    for name, field in type(section).model_fields.items():
        mark, below = mark_of(field, kind), f"{above}.{field.alias or name}".removeprefix(".")
        for key, value in leaves(below, getattr(section, name)):
            if isinstance(value, BaseModel):
                yield from marked(value, kind, key)
            elif mark is not None and isinstance(value, str | int | float) and not isinstance(value, bool):
                yield Marked(section, below, key, value, mark)


def _parts(*annotations: Any) -> Iterator[Any]:
    for item in annotations:
        yield item
        yield from _parts(*get_args(item))


def leaves(key: str, value: Any, vectors: bool = False) -> Iterator[tuple[str, Any]]:
    """Iterate over the values in mappings and lists, with their keys; vectors: do not split lists of numbers."""
    if not isinstance(value, dict | tuple) or (vectors and isinstance(value, tuple) and isinstance(value[0], float)):
        yield key, value
        return
    for place, item in value.items() if isinstance(value, dict) else enumerate(value):
        yield from leaves(f"{key}.{place}".removeprefix("."), item, vectors)


@dataclass(frozen=True)
class Problem:
    """One fault of a config: dotted key, fault, remedy; at_key: the key is wrong, not its value."""

    key: str
    what: str
    remedy: str = ""
    at_key: bool = False


def shown_key(key: str) -> str:
    """A dotted key as printed: `loads.0.node` becomes loads[0].node."""
    return re.sub(r"\.(\d+)(?=\.|$)", r"[\1]", key)


def exactly_one(values: Mapping[str, object]) -> Iterator[Problem]:
    """Yield a problem unless exactly one of the values is set."""
    names = [f"'{name}'" for name, value in values.items() if value is not None]
    if len(names) != 1:
        listed = [f"'{name}'" for name in values]
        what = f"{' and '.join(names)} cannot be combined" if names else f"none of {', '.join(listed)} is set"
        yield Problem("", what, f"set exactly one of {', '.join(listed)}", at_key=True)


def step_problems(key: str, duration: float, step: float, fewest: int, most: int, other: str = "") -> Iterator[Problem]:
    """Yield a problem unless the duration [s] is a whole number of steps [s] within the limits; other: key of the duration, if it
    may change as well."""
    steps = duration / step
    if not fewest * (1 - 1e-9) <= steps <= most:
        what = f"the duration of {duration:g} s is {steps:.3g} times the time step of {step:g} s"
        if steps < fewest:
            yield Problem(
                key, f"{what}; the minimum is {fewest}", f"use a time step of at most {at_most(duration / fewest)} s"
            )
        else:
            yield Problem(
                key, f"{what}; the maximum is {most:g}", f"use a time step of at least {at_least(duration / most)} s"
            )
    elif abs(steps - round(steps)) > 1e-6 * steps:
        what = f"the time step of {step:g} s does not divide the duration of {duration:g} s ({steps:.6g} steps)"
        longer = f", or set {other} to {step * round(steps):.9g} s" if other else ""
        yield Problem(key, what, f"use a time step of {duration / round(steps):.9g} s{longer}")


def known(key: str, name: str, names: Collection[str], kind: str, at_key: bool = False) -> Iterator[Problem]:
    """Yield a problem unless the name is one of the known names of this kind."""
    yield from one_of(key, name, names, f"no {kind} has the name '{name}'", at_key)


def one_of(key: str, name: str, names: Collection[str], what: str, at_key: bool = False) -> Iterator[Problem]:
    """Yield a problem with the message `what` unless the name is one of the known names."""
    if name not in names:
        listed = ", ".join(names) or "none"
        yield Problem(key, what, did_you_mean(name, names, f"known names: {listed}"), at_key)


def duplicate_name_problems(key: str, names: Sequence[str]) -> Iterator[Problem]:
    """Yield a problem for every repeated entry of the list at a key."""
    for i, name in enumerate(names):
        if name in names[:i]:
            yield Problem(f"{key}.{i}", f"'{name}' appears twice", "remove one of the two entries")


def box_problem(box: tuple[Vector, Vector]) -> Iterator[Problem]:
    """Yield a problem unless the first corner is the lower one."""
    if any(low >= high for low, high in zip(*box, strict=True)):
        what = "each coordinate of the first corner of the box has to be smaller than that of the second corner"
        yield Problem("box", what, "write [[xmin, ymin, zmin], [xmax, ymax, zmax]]")


DOTTED = re.compile(r"[\w-]+(\.[\w-]+)*")
"""A dotted key, as in --set place.keep=6."""
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
"""Other units in which a number may have been written, with their conversion factors."""


@dataclass(frozen=True)
class Plausible:
    """Marks a number that is plausible if it is 0 or its magnitude is between low and high [unit]; share: upper limit of a
    length, as a multiple of the size of the structure."""

    low: float
    high: float
    unit: str = "-"
    share: float = inf

    def of(self, section: BaseModel) -> Plausible | None:
        return self

    def interval(self) -> str:
        """`0.0005 to 0.2 m`, or `up to 360 deg`"""
        unit = "" if self.unit == "-" else f" {self.unit}"
        return f"{f'{self.low:g}' if self.low else 'up'} to {self.high:g}{unit}"

    def __get_pydantic_json_schema__(self, core: Any, handler: Any) -> Any:
        return handler(core) | {"plausible": self.interval()}


@dataclass(frozen=True)
class PlausibleBy:
    """Marks a number whose plausible range depends on another key of its section."""

    key: str
    ranges: Mapping[str, Plausible]

    def of(self, section: BaseModel) -> Plausible | None:
        return self.ranges.get(getattr(section, self.key))

    def __get_pydantic_json_schema__(self, core: Any, handler: Any) -> Any:
        cases: dict[str, list[str]] = {}
        for case, limits in self.ranges.items():
            cases.setdefault(limits.interval(), []).append(case)
        return handler(core) | {
            "plausible": "; ".join(f"{interval} ({', '.join(of)})" for interval, of in cases.items())
        }


@dataclass(frozen=True)
class Unbounded:
    """Marks a number without a plausible range."""

    reason: str

    def of(self, section: BaseModel) -> Plausible | None:
        return None


Marker = Plausible | PlausibleBy | Unbounded

PRICE = Unbounded("any currency")
READING = Unbounded("any unit")

SIZE = Plausible(1e-6, 100.0, "m", share=1.0)
GRID = Plausible(1e-4, 0.3, "m", share=1.0)
MISPLACED = Plausible(1e-6, 0.1, "m", share=0.1)
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
DRIVEN = Plausible(0.0, 1e10, "N, N m, rad, m, rad/s or m/s")
STRAIN = Plausible(1e-9, 1e-2, "strain")
STRAIN_RANGE = Plausible(1e-5, 0.5, "strain")
NOISE = Plausible(1e-12, 1e3, "strain, m, m/s² or rad")
GAIN = Plausible(1e-5, 0.2)
RELATIVE_STD = Plausible(1e-6, 100.0)
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
    """Yield a problem for every number outside its plausible range; extent: size of the structure [m]."""
    for number in marked(config, Marker):
        limits = number.mark.of(number.section)
        if limits is not None and not isinstance(number.value, str):
            yield from _outside(number.key, number.value, limits, extent)


def _outside(key: str, value: float, limits: Plausible, extent: float) -> Iterator[Problem]:
    size, unit = abs(value), "" if re.search("^-| or ", limits.unit) else f" {limits.unit}"
    if value != 0 and not limits.low <= size <= limits.high:
        others = UNITS.get(limits.unit, {}).items()
        meant = (
            f"if {value:g} is a value in {other}, write {value * factor:.4g}"
            for other, factor in others
            if limits.low <= size * factor <= limits.high
        )
        what = f"{value:g}{unit} is outside the plausible range of {limits.interval()}"
        yield Problem(key, what, next(meant, "check the value and its unit"))
    elif size > limits.share * extent:
        share = "" if limits.share == 1 else f"{limits.share:g} times "
        what = f"the length of {value:g} m is larger than {share}the size of the structure, {extent:.4g} m"
        remedy = f"use a length in m, at most {limits.share * extent:.2g}, or check the key `length_unit` of the mesh"
        yield Problem(key, what, remedy)


Name = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_-]*$", max_length=64)]
"""Name of a parameter or load: letters, digits, - and _. It becomes part of dataset paths and of dotted keys."""

RunName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=100)]
"""Name of a run: its folder in the results folder."""

Id = Annotated[int, Unbounded("any id")]
Seed = Annotated[int, Field(ge=0, lt=2**32)]
Count = Annotated[int, Field(ge=1), Plausible(1, 10_000)]
Text = Annotated[str, Field(min_length=1)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Vector = tuple[float, float, float]
DIRECTION = Unbounded("unused length")
DirectionVector = Annotated[Vector, DIRECTION]
"""A vector of nonzero length (checked by `section_problems`)."""
Point = Annotated[Vector, Plausible(0.0, 1e4, "m")]
Size = Annotated[Positive, SIZE]
TimeStep = Annotated[Positive, Plausible(1e-7, 10.0, "s")]
Duration = Annotated[Positive, DURATION]
Frequency = Annotated[Positive, FREQUENCY]
Amplitude = Annotated[Positive, Plausible(1e-6, 1e10, "N, N m, Pa, m/s², rad²/s² or 1")]
YoungsModulus = Annotated[Positive, MODULUS]
Stress = Annotated[Positive, Plausible(1e5, 1e10, "Pa")]
Cycles = Annotated[Positive, Plausible(1.0, 1e12)]
ParameterValue = Annotated[Positive, PARAMETER]


class Section(BaseModel):
    """Common rules of all sections of a config: unknown keys, values of a wrong type and NaN are errors."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

    def problems(self) -> Iterator[Problem]:
        """Yield the inconsistencies between the fields of this section; keys are relative to it."""
        yield from ()


def section_problems(section: Section, above: str = "") -> Iterator[Problem]:
    """Yield the inconsistencies of a section and all sections below it, and vectors of length zero; above: dotted key of the
    section."""
    for problem in section.problems():
        yield replace(problem, key=f"{above}.{problem.key}".strip("."))
    for name, field in type(section).model_fields.items():
        directed = mark_of(field, Unbounded) is DIRECTION
        for key, value in leaves(f"{above}.{field.alias or name}".removeprefix("."), getattr(section, name), directed):
            if isinstance(value, Section):
                yield from section_problems(value, key)
            elif directed and isinstance(value, tuple) and not any(value):
                yield Problem(key, "the vector has length zero", "use a vector such as [1, 0, 0]")


class TimeSpan(Section):
    """Duration and time step of a simulation."""

    duration: Duration = Field(description="Duration of the simulation [s].")
    time_step: TimeStep = Field(description="Time step of the simulation [s].")


class NamedRun(Section):
    """Keys of every run: name and seed."""

    name: RunName = Field(description="Name of the run; its results are written to results/NAME.")
    seed: Seed = Field(0, description="Seed of the random number generator [-].")


PARALLEL = 1e-6
"""sin² of the smallest angle between the two axes of a coordinate system, 0.06°."""


class AxesSection(Section):
    """A right-handed coordinate system, z = x × y."""

    origin: Point = Field(
        (0.0, 0.0, 0.0),
        description="Origin of the coordinate system, in coordinates of the mesh [m; for `report.datum`: length unit of the "
        "deck].",
    )
    x: DirectionVector = Field((1.0, 0.0, 0.0), description="Direction of the x axis, in coordinates of the mesh [-].")
    y: DirectionVector = Field(
        (0.0, 1.0, 0.0),
        description="Vector in the x-y plane towards positive y, in coordinates of the mesh [-]; not parallel to `x`.",
    )

    def problems(self) -> Iterator[Problem]:
        """Check that the two directions span a plane."""
        x, y = self.x, self.y
        along = sum(a * b for a, b in zip(x, y, strict=True))
        if any(x) and any(y) and along**2 >= (1 - PARALLEL) * sum(a * a for a in x) * sum(b * b for b in y):
            what = f"{list(y)} is parallel to the x axis, {list(x)}"
            yield Problem("y", what, "use a vector in the x-y plane that is not parallel to `x`")


def expert(*default: Any, **settings: Any) -> Any:
    """A `Field` for experts: not in the template, and listed under the expert keys of the reference."""
    return Field(*default, json_schema_extra={"expert": True}, **settings)


def with_defaults(section: type[Section], description: str) -> Any:
    """An optional field; by default its section has all its defaults."""
    factory: Any = section
    return Field(default_factory=factory, description=description)


@dataclass(frozen=True)
class Names:
    """Marks a text as the name of an entry of a section: its kind in words, the required `type` if any, and other permitted
    names."""

    section: str
    what: str
    type: str | None = None
    besides: tuple[str, ...] = ()


GROUND = "ground"
BodyName = Annotated[Text, Names("bodies", "body", besides=(GROUND,))]
FlexibleName = Annotated[Text, Names("bodies", "flexible body", type="flexible")]
FrameName = Annotated[Text, Names("frames", "frame")]
JointName = Annotated[Text, Names("joints", "joint")]
BearingName = Annotated[Text, Names("bearings", "bearing")]


def name_problems(config: BaseModel) -> Iterator[Problem]:
    """Yield a problem for every reference to an entry that does not exist."""
    for name in marked(config, Names):
        mark = name.mark
        entries = getattr(config, mark.section)
        names = [key for key, entry in entries.items() if mark.type is None or entry.type == mark.type]
        yield from known(name.field, str(name.value), [*names, *mark.besides], mark.what)
