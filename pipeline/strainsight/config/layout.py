"""What a layout may be and what makes it good, and zones of the surface: shared by structure and bench."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from strainsight.config.base import (
    DURATION,
    PRICE,
    SIZE,
    Count,
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
    box_problem,
    expert,
    known,
    named_twice,
)

NAMED = "name"
"""Tag of a member of a union that is a plain text."""


def key_of(*keys: str, text: bool = False) -> Any:
    """Distinguish the members of a union by the one key each of them has; where there is one of `text`, that is `NAMED`."""

    def which(value: Any) -> str | None:
        if text and isinstance(value, str):
            return NAMED
        if isinstance(value, Section):
            names = {field.alias or name for name, field in type(value).model_fields.items()}
            return next((key for key in keys if key in names), None)
        present = [key for key in keys if key in value] if isinstance(value, dict) else []
        return present[0] if len(present) == 1 else None

    return Discriminator(
        which,
        custom_error_type="one_key",
        custom_error_message="give exactly one of " + ", ".join(f"'{key}'" for key in keys),
    )


class BoxZone(Section):
    """A box."""

    box: tuple[Point, Point] = Field(description="[[x, y, z], [x, y, z]]: lower and upper corner [m].")

    def problems(self) -> Iterator[Problem]:
        yield from box_problem("box", self.box)


class CylinderZone(Section):
    """A cylinder without ends."""

    point: Point = expert(description="A point on its axis [m].")
    axis: DirectionVector = expert(description="Direction of its axis [-].")
    radius: Annotated[Positive, Plausible(1e-6, 100.0, "m")] = expert(description="Radius [m].")


class InCylinder(Section):
    """The inside of a cylinder without ends."""

    cylinder: CylinderZone = expert(description="The cylinder.")


class ConeZone(Section):
    """Normals near an axis."""

    axis: DirectionVector = Field(description="Axis in global coordinates [-]; its sign does not matter.")
    angle: float = Field(gt=0, le=90, description="Largest angle between the facet's normal and the axis [deg].")


class FacingZone(Section):
    """Facets that face along an axis."""

    normal_cone: ConeZone = Field(description="The normals.")


class SetZone(Section):
    """A set and a distance from it."""

    set: Text = Field(description="Name of a node or element set.")
    distance: Size = Field(description="Nearer than this to one of its nodes [m].")


class NearSetZone(Section):
    """The surroundings of a set."""

    near_set: SetZone = Field(description="The set.")


class NearEdgesZone(Section):
    """The surroundings of edges."""

    near_edges: Size = expert(description="Nearer than this to an edge of the body [m].")


class ShellFaceZone(Section):
    """One face of all shells."""

    shell_face: Literal["upper", "lower"] = Field(
        description="upper: on the side of the normal that the order of the nodes gives by the right-hand rule; lower: the other."
    )


class OnElementsZone(Section):
    """The surface of elements of a kind."""

    on_elements: Literal["solids", "shells", "beams"] = Field(
        description="The faces of solids or shells, or sides of beams."
    )


Zone = Annotated[
    Annotated[BoxZone, Tag("box")]
    | Annotated[InCylinder, Tag("cylinder")]
    | Annotated[FacingZone, Tag("normal_cone")]
    | Annotated[NearEdgesZone, Tag("near_edges")]
    | Annotated[NearSetZone, Tag("near_set")]
    | Annotated[ShellFaceZone, Tag("shell_face")]
    | Annotated[OnElementsZone, Tag("on_elements")]
    | Annotated[Text, Tag(NAMED)],
    key_of("box", "cylinder", "normal_cone", "near_edges", "near_set", "shell_face", "on_elements", text=True),
]


Keep = Annotated[
    Count,
    Field(ge=1, description="Gauges to bond [-], those already bonded among them; with a budget at most so many."),
]


class ZoneLimit(Section):
    """So many gauges in a zone, and no more."""

    zone: Zone = expert(description="The zone.")
    count: Annotated[int, Plausible(0, 1000)] = expert(ge=0, description="Most gauges in it [-].")


class LayoutSettings(Section):
    """The layout: its size, its limits, its criterion, and how it is searched."""

    keep: Keep
    criterion: Literal["trace", "log_determinant", "worst_eigenvalue"] = expert(
        "trace",
        description="What the layout makes small, of the covariance of the unknowns: the sum of their variances; the volume of "
        "what stays uncertain, which no unit changes; or the variance of the combination of them that is known worst.",
    )
    metric_over: tuple[Name, ...] = expert(
        (),
        description="Unknowns that the criterion covers; empty: all. The others are estimated beside them, however "
        "badly.",
    )
    minimum_spacing: Annotated[NotNegative, SIZE] = Field(
        0.0,
        description="Least distance between gauges of the layout [m]. With gauges.type of a structure: the longer side of its "
        "carrier.",
    )
    at_most: tuple[ZoneLimit, ...] = expert((), description="Most gauges in some zones.")
    budget: Annotated[Positive | None, PRICE] = expert(
        None, description="What the gauges may cost together, by their `price`; null: no limit."
    )
    aggregate: Literal["mean", "worst"] = Field(
        "mean",
        description="How instants, parameter samples and load cases of a structure, or poses of a bench, are put together.",
    )
    certificate: bool = Field(True, description="Compute a lower bound on what any layout of that size can reach.")
    exchange: bool = expert(True, description="Exchange gauges after the elimination until none helps.")
    optimise: Literal["metric", "worst_failure"] = expert(
        "metric", description="metric: the criterion; worst_failure: the same after the worst failure of any one gauge."
    )
    prove: Annotated[NotNegative, DURATION] = expert(
        0.0,
        description="Time for a branch and bound that improves the layout or proves it best [s]; 0: none. What it reaches "
        "without a proof depends on the machine.",
    )

    def problems(self) -> Iterator[Problem]:
        if self.prove > 0 and self.optimise != "metric":
            yield Problem("prove", "a proof is of the metric, not of the worst failure", "remove one of the two keys")


def layout_problems(
    place: LayoutSettings, unknowns: Sequence[str], among: str, bonded: int, key: str
) -> Iterator[Problem]:
    """Contradictions between the limits, the criterion and the search; unknowns: those that the key `among` names; bonded:
    how many gauges are there already by the config's `key`."""
    for i, name in enumerate(place.metric_over):
        yield from known(f"place.metric_over.{i}", name, unknowns, f"unknown of {among}")
    yield from named_twice("place.metric_over", place.metric_over)
    if place.keep < bonded:
        what = f"{place.keep} gauges, and {bonded} are bonded already ({key})"
        yield Problem("place.keep", what, f"keep at least {bonded}")
