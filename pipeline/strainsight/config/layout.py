"""Layout: size, limits, criterion and search; zones of the surface. Shared by structure and bench."""

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
    duplicate_name_problems,
    expert,
    one_of,
)

NAMED = "name"
"""Tag of the union member that is plain text."""


def key_of(*keys: str, text: bool = False) -> Any:
    """Distinguish the members of a union by the one key that each of them has; `text` has the tag `NAMED`."""

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
        custom_error_message="set exactly one of " + ", ".join(f"'{key}'" for key in keys),
    )


class BoxZone(Section):
    """The part of the surface in a box with edges along x, y and z."""

    box: tuple[Point, Point] = Field(description="Lower and upper corner of the box [[x, y, z], [x, y, z]] [m].")

    def problems(self) -> Iterator[Problem]:
        yield from box_problem(self.box)


class CylinderZone(Section):
    """A cylinder of infinite length."""

    point: Point = expert(description="A point on the axis of the cylinder [m].")
    axis: DirectionVector = expert(description="Direction of the axis of the cylinder [-].")
    radius: Annotated[Positive, Plausible(1e-6, 100.0, "m")] = expert(description="Radius of the cylinder [m].")


class InCylinder(Section):
    """The part of the surface in a cylinder of infinite length."""

    cylinder: CylinderZone = expert(description="Axis and radius of the cylinder.")


class ConeZone(Section):
    """An axis, and the largest angle between the axis and a facet normal."""

    axis: DirectionVector = Field(
        description="Axis in global coordinates [-]; the length and the sign of the axis are not used."
    )
    angle: float = Field(gt=0, le=90, description="Largest angle between the normal of the facet and the axis [deg].")


class FacingZone(Section):
    """The facets whose normal is close to an axis."""

    normal_cone: ConeZone = Field(
        description="Axis, and largest angle between the axis and the facet normals of the zone."
    )


class SetZone(Section):
    """A node or element set, and the largest distance of the zone from its nodes."""

    set: Text = Field(description="Name of a node or element set.")
    distance: Size = Field(description="Largest distance from the nearest node of the node or element set [m].")


class NearSetZone(Section):
    """The part of the surface near a node or element set."""

    near_set: SetZone = Field(
        description="Name of a node or element set, and largest distance of the zone from its nodes."
    )


class NearEdgesZone(Section):
    """The part of the surface near sharp edges."""

    near_edges: Size = expert(
        description="Largest distance of the zone from a sharp edge [m]; at a sharp edge, the normal "
        "turns by more than 30°."
    )


class ShellFaceZone(Section):
    """One side of all shells."""

    shell_face: Literal["upper", "lower"] = Field(
        description="Side of the shells. With `upper`: the side of the normal (right-hand rule on the node order). With "
        "`lower`: the opposite side."
    )


class OnElementsZone(Section):
    """The surface of elements of one kind."""

    on_elements: Literal["solids", "shells", "beams"] = Field(
        description="Element kind whose surface is the zone: faces of all solids, faces of all shells, or sides of all beams."
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
    Field(
        ge=1,
        description="Number of gauges of the layout [-], including the gauges already bonded. With `budget`: largest number of "
        "gauges.",
    ),
]


class ZoneLimit(Section):
    """Largest number of gauges in a zone."""

    zone: Zone = expert(description="Zone of the surface to which the limit applies.")
    count: Annotated[int, Plausible(0, 1000)] = expert(ge=0, description="Largest number of gauges in the zone [-].")


Search = Literal["all", "pool"]
SEARCH = (
    "Candidates for the optimised layout. With `all`: the lower bound of the criterion is valid for layouts of "
    "all candidates. Candidates that could improve the layout are added to the pool, which is the result of the stage "
    "`screen`, or `place.pool` of a bench. With `pool`: layout and lower bound consider only the candidates in the pool."
)


class LayoutSettings(Section):
    """Layout of the gauges: number of gauges, limits, criterion and search."""

    keep: Keep
    criterion: Literal["trace", "log_determinant", "worst_eigenvalue"] = expert(
        "trace",
        description="Criterion to minimise, from the covariance of the unknowns. With `trace`: sum of the variances. With "
        "`log_determinant`: volume of the confidence ellipsoid, independent of units. With `worst_eigenvalue`: variance of "
        "the least certain combination of unknowns.",
    )
    metric_over: tuple[Name, ...] = expert(
        (),
        description="Names of the unknowns whose variances enter the criterion; empty: all unknowns. The other unknowns are "
        "estimated, but do not enter the criterion.",
    )
    minimum_spacing: Annotated[NotNegative, SIZE] = Field(
        0.0,
        description="Smallest distance between two gauges of the layout [m]. Default for a structure with gauges.type: the "
        "longer side of the carrier.",
    )
    at_most: tuple[ZoneLimit, ...] = expert((), description="Largest numbers of gauges in zones of the surface.")
    budget: Annotated[Positive | None, PRICE] = expert(
        None, description="Largest sum of the prices (`price`) of the gauges; null: no limit."
    )
    aggregate: Literal["mean", "worst"] = Field(
        "mean",
        description="Aggregation of the criterion over instants, parameter samples and load cases, or over poses of a bench. "
        "With `mean`: mean value. With `worst`: largest value.",
    )
    certificate: bool = Field(
        True,
        description="`true`: compute a lower bound of the criterion for all layouts with the same number of gauges.",
    )
    exchange: bool = expert(
        True,
        description="`true`: exchange single gauges after the backward elimination until no exchange improves the criterion.",
    )
    search: Search = Field("pool", description=SEARCH)
    optimise: Literal["metric", "worst_failure"] = expert(
        "metric",
        description="Objective of the search. With `metric`: the criterion of the whole layout. With `worst_failure`: the "
        "criterion without the gauge whose failure increases the criterion most.",
    )
    prove: Annotated[NotNegative, DURATION] = expert(
        0.0,
        description="Time limit of a branch-and-bound search [s]; 0: no search. The search improves the layout, or proves that "
        "the layout is optimal. If the search ends without a proof, the layout depends on the speed of the machine.",
    )

    def problems(self) -> Iterator[Problem]:
        if self.prove > 0 and self.optimise != "metric":
            what = "optimality can be proved for place.optimise: metric only, not for worst_failure"
            yield Problem("prove", what, "remove place.prove, or set place.optimise: metric")


def layout_problems(
    place: LayoutSettings, unknowns: Sequence[str], among: str, bonded: int, key: str
) -> Iterator[Problem]:
    """Yield the inconsistencies between limits, criterion and search; among: key of the unknowns; bonded: number of gauges
    already bonded, by `key`."""
    for i, name in enumerate(place.metric_over):
        yield from one_of(f"place.metric_over.{i}", name, unknowns, f"no entry of {among} has the name '{name}'")
    yield from duplicate_name_problems("place.metric_over", place.metric_over)
    if place.keep < bonded:
        what = f"place.keep is {place.keep}, but {bonded} gauges are already bonded ({key})"
        yield Problem("place.keep", what, f"set place.keep to at least {bonded}")
