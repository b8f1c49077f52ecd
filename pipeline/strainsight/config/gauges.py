"""Where gauges may go, along what, and how noisy they are."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from strainsight.config.base import Positive, Section, Text, Vector


def _key_of(*keys: str) -> Any:
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


class AxisDirection(Section):
    """Gauges along an axis projected on the facet, and turned by angles."""

    type: Literal["axis"] = Field(description="Kind of direction.")
    axis: Vector = Field(description="Axis in global coordinates [-]; its length does not matter.")
    angles: Annotated[tuple[float, ...], Field(min_length=1)] = Field(
        (0.0,), description="Angles from the projected axis, positive about the outward normal [deg]; a candidate each."
    )


class RelativeNoise(Section):
    """Noise as a share of the strongest candidate."""

    relative_to_strongest: Positive = Field(description="Noise standard deviation over the largest RMS strain [-].")


class AbsoluteNoise(Section):
    """Noise as a strain."""

    value: Positive = Field(description="Noise standard deviation of one sample at train.time_step [strain].")


class KeepOutBox(Section):
    """No gauges in a box."""

    box: tuple[Vector, Vector] = Field(description="[[x, y, z], [x, y, z]]: lower and upper corner [m].")


class CylinderZone(Section):
    """A cylinder without ends."""

    point: Vector = Field(description="A point on its axis [m].")
    axis: Vector = Field(description="Direction of its axis [-].")
    radius: Positive = Field(description="Radius [m].")


class KeepOutCylinder(Section):
    """No gauges in a cylinder."""

    cylinder: CylinderZone = Field(description="The cylinder.")


class ConeZone(Section):
    """Normals near an axis."""

    axis: Vector = Field(description="Axis in global coordinates [-]; its sign does not matter.")
    angle: float = Field(gt=0, le=90, description="Largest angle between the facet's normal and the axis [deg].")


class KeepOutNormals(Section):
    """No gauges on facets that face along an axis."""

    normal_cone: ConeZone = Field(description="The normals.")


class SetZone(Section):
    """The surroundings of a set."""

    set: Text = Field(description="Name of a node or element set.")
    distance: Positive = Field(description="Least distance from its nodes [m].")


class KeepOutSet(Section):
    """No gauges close to a set."""

    near_set: SetZone = Field(description="The set.")


class KeepOutEdges(Section):
    """No gauges close to edges."""

    near_edges: Positive = Field(description="Least distance from an edge of the body [m].")


NoiseStd = Annotated[
    Annotated[RelativeNoise, Tag("relative_to_strongest")] | Annotated[AbsoluteNoise, Tag("value")],
    _key_of("relative_to_strongest", "value"),
]
KeepOut = Annotated[
    Annotated[KeepOutBox, Tag("box")]
    | Annotated[KeepOutCylinder, Tag("cylinder")]
    | Annotated[KeepOutNormals, Tag("normal_cone")]
    | Annotated[KeepOutEdges, Tag("near_edges")]
    | Annotated[KeepOutSet, Tag("near_set")],
    _key_of("box", "cylinder", "normal_cone", "near_edges", "near_set"),
]


class GivenGauges(Section):
    """Candidates by their strain rows, where the solids of the mesh do not carry them (shells, beams)."""

    rows: Text = Field(description="Matrix file (.mtx, .npz, .op4): strain of each gauge per motion of each row.")
    table: Text = Field(
        description="CSV file, one line a gauge: gauge,x,y,z,dx,dy,dz (number, position in the mesh's unit, direction)."
    )


class Gauges(Section):
    """Where gauges may go, along what, and how noisy they are."""

    surface: Text = Field("all", description="'all' exterior facets, or the name of an element or node set.")
    direction: AxisDirection | None = Field(
        None, description="Measuring directions of the candidates; left out only with `given`."
    )
    given: GivenGauges | None = Field(None, description="Candidates by their strain rows, instead of a surface.")
    noise_std: NoiseStd = Field(description="Noise standard deviation of every gauge.")
    exclude: tuple[KeepOut, ...] = Field((), description="Zones without gauges.")
