"""The strain and stress of a flexible body's surface during a bench run."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

from pydantic import Field

from strainsight.config.base import Section
from strainsight.config.names import FlexibleName
from strainsight.config.problem import Problem


class SurfaceField(Section):
    """Displacement, strain and stress of a flexible body's surface in time, as a grid that ParaView plays."""

    body: FlexibleName = Field(description="Name of the flexible body.")
    of: Literal["simulate", "estimate"] = Field(
        "simulate", description="Of the simulated motion, or of the estimated one with the estimated moduli."
    )
    every: int | None = Field(None, ge=1, description="Steps between pictures [-]; null: as many as `instants` says.")
    instants: int | None = Field(None, ge=2, le=10_000, description="Pictures, evenly from start to end [-]; null: 50.")


def field_problems(config: Any) -> Iterator[Problem]:
    """What `field` demands of the rest of a bench."""
    field = config.field
    if field is None:
        return
    if field.of == "estimate" and config.estimate is None:
        yield Problem("field.of", "nothing is estimated", "give the section estimate, or say simulate")
    if field.every is not None and field.instants is not None:
        yield Problem("field.every", "every and instants are both given", "give one of them")
