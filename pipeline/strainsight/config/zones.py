"""Parts of the surface: where gauges may go, may not, or only so many of them."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag

from strainsight.config.base import Positive, Section, Text, Vector


def key_of(*keys: str) -> Any:
    """Tell the members of a union apart by the one key each of them has."""

    def which(value: Any) -> str | None:
        if isinstance(value, Section):
            return next((key for key in keys if key in type(value).model_fields), None)
        found = [key for key in keys if key in value] if isinstance(value, dict) else []
        return found[0] if len(found) == 1 else None

    return Discriminator(
        which,
        custom_error_type="one_key",
        custom_error_message="give exactly one of " + ", ".join(f"'{key}'" for key in keys),
    )


class BoxZone(Section):
    """A box."""

    box: tuple[Vector, Vector] = Field(description="[[x, y, z], [x, y, z]]: lower and upper corner [m].")


class CylinderZone(Section):
    """A cylinder without ends."""

    point: Vector = Field(description="A point on its axis [m].")
    axis: Vector = Field(description="Direction of its axis [-].")
    radius: Positive = Field(description="Radius [m].")


class InCylinder(Section):
    """The inside of a cylinder without ends."""

    cylinder: CylinderZone = Field(description="The cylinder.")


class ConeZone(Section):
    """Normals near an axis."""

    axis: Vector = Field(description="Axis in global coordinates [-]; its sign does not matter.")
    angle: float = Field(gt=0, le=90, description="Largest angle between the facet's normal and the axis [deg].")


class FacingZone(Section):
    """Facets that face along an axis."""

    normal_cone: ConeZone = Field(description="The normals.")


class SetZone(Section):
    """A set and a distance from it."""

    set: Text = Field(description="Name of a node or element set.")
    distance: Positive = Field(description="Nearer than this to one of its nodes [m].")


class NearSetZone(Section):
    """The surroundings of a set."""

    near_set: SetZone = Field(description="The set.")


class NearEdgesZone(Section):
    """The surroundings of edges."""

    near_edges: Positive = Field(description="Nearer than this to an edge of the body [m].")


Zone = Annotated[
    Annotated[BoxZone, Tag("box")]
    | Annotated[InCylinder, Tag("cylinder")]
    | Annotated[FacingZone, Tag("normal_cone")]
    | Annotated[NearEdgesZone, Tag("near_edges")]
    | Annotated[NearSetZone, Tag("near_set")],
    key_of("box", "cylinder", "normal_cone", "near_edges", "near_set"),
]
