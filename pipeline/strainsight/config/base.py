"""The types that all config models share."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

Name = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_-]*$", max_length=64)]
"""Of a parameter, a load: letters, digits, - and _; it becomes part of dataset paths and of dotted keys."""

RunName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=100)]
"""Of a run: the folder below the results folder."""

Seed = Annotated[int, Field(ge=0, lt=2**32)]
Text = Annotated[str, Field(min_length=1)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Vector = tuple[float, float, float]


class Section(BaseModel):
    """A mapping of the config: no unknown keys, no coercion, no NaN, not to be changed."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


def with_defaults(section: type[Section], description: str) -> Any:
    """A field that may be left out: its section then has all its defaults."""
    factory: Any = section
    return Field(default_factory=factory, description=description)
