"""The types that all config models share."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from strainsight.config.plausible import DURATION, FREQUENCY, PARAMETER, SIZE, Plausible, Unbounded

Name = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_-]*$", max_length=64)]
"""Of a parameter, a load: letters, digits, - and _; it becomes part of dataset paths and of dotted keys."""

RunName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=100)]
"""Of a run: the folder below the results folder."""

Id = Annotated[int, Unbounded("an id of the deck")]
Seed = Annotated[int, Field(ge=0, lt=2**32)]
Count = Annotated[int, Field(ge=1), Plausible(1, 10_000)]
Text = Annotated[str, Field(min_length=1)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Vector = tuple[float, float, float]
DirectionVector = Annotated[Vector, Unbounded("only the direction counts")]
Point = Annotated[Vector, Plausible(0.0, 1e4, "m")]
Size = Annotated[Positive, SIZE]
TimeStep = Annotated[Positive, Plausible(1e-7, 10.0, "s")]
Duration = Annotated[Positive, DURATION]
Frequency = Annotated[Positive, FREQUENCY]
Amplitude = Annotated[Positive, Plausible(1e-6, 1e10, "in the unit of the load")]
YoungsModulus = Annotated[Positive, Plausible(1e5, 2e12, "Pa")]
Stress = Annotated[Positive, Plausible(1e5, 1e10, "Pa")]
Cycles = Annotated[Positive, Plausible(1.0, 1e12)]
ParameterValue = Annotated[Positive, PARAMETER]


class Section(BaseModel):
    """A mapping of the config: no unknown keys, no coercion, no NaN, not to be changed."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


def with_defaults(section: type[Section], description: str) -> Any:
    """A field that may be left out: its section then has all its defaults."""
    factory: Any = section
    return Field(default_factory=factory, description=description)
