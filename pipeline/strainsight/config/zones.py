"""Parts of the surface: where gauges may go, may not, or only so many of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from strainsight.config.base import DirectionVector, Point, Positive, Section, Size, Text, Vector
from strainsight.config.plausible import Plausible
from strainsight.config.problem import Problem

NO_LENGTH = "a vector of length zero"
FOR_EXAMPLE = "give a vector such as [1, 0, 0]"


NAMED = "name"
"""Tag of a member of a union that is a plain text."""


def key_of(*keys: str, text: bool = False) -> Any:
    """Distinguish the members of a union by the one key each of them has; where there is one of `text`, that is `NAMED`."""

    def which(value: Any) -> str | None:
        if text and isinstance(value, str):
            return NAMED
        if isinstance(value, Section):
            own = {field.alias or name for name, field in type(value).model_fields.items()}
            return next((key for key in keys if key in own), None)
        found = [key for key in keys if key in value] if isinstance(value, dict) else []
        return found[0] if len(found) == 1 else None

    return Discriminator(
        which,
        custom_error_type="one_key",
        custom_error_message="give exactly one of " + ", ".join(f"'{key}'" for key in keys),
    )


class BoxZone(Section):
    """A box."""

    box: tuple[Point, Point] = Field(description="[[x, y, z], [x, y, z]]: lower and upper corner [m].")


class CylinderZone(Section):
    """A cylinder without ends."""

    point: Point = Field(description="A point on its axis [m].")
    axis: DirectionVector = Field(description="Direction of its axis [-].")
    radius: Annotated[Positive, Plausible(1e-6, 100.0, "m")] = Field(description="Radius [m].")


class InCylinder(Section):
    """The inside of a cylinder without ends."""

    cylinder: CylinderZone = Field(description="The cylinder.")


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

    near_edges: Size = Field(description="Nearer than this to an edge of the body [m].")


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


def zone_problems(key: str, zones: Sequence[Any]) -> Iterator[Problem]:
    for i, zone in enumerate(zones):
        yield from zone_problem(f"{key}.{i}", zone)


def box_problem(key: str, box: tuple[Vector, Vector]) -> Iterator[Problem]:
    if any(low >= high for low, high in zip(*box, strict=True)):
        yield Problem(key, "the lower corner is not below the upper one", "give [[lowest], [highest]] x, y, z")


def zone_problem(key: str, zone: Any) -> Iterator[Problem]:
    if isinstance(zone, BoxZone):
        yield from box_problem(f"{key}.box", zone.box)
    elif isinstance(zone, InCylinder) and not any(zone.cylinder.axis):
        yield Problem(f"{key}.cylinder.axis", NO_LENGTH, FOR_EXAMPLE)
    elif isinstance(zone, FacingZone) and not any(zone.normal_cone.axis):
        yield Problem(f"{key}.normal_cone.axis", NO_LENGTH, FOR_EXAMPLE)
