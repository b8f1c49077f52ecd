"""The zones of a config on the surface of a mesh."""

from __future__ import annotations

from strainsight.config import zones as stated
from strainsight.mesh.facets import LOWER, UPPER
from strainsight.sensors.zones import (
    Box,
    Cylinder,
    NearEdges,
    NearSet,
    NormalCone,
    On,
    OnElements,
    ShellFace,
    Zone,
)


def zone_of(entry: stated.Zone) -> Zone:
    """A zone of a config."""
    match entry:
        case stated.BoxZone(box=(low, high)):
            return Box(low, high)
        case stated.InCylinder(cylinder=own):
            return Cylinder(own.point, own.axis, own.radius)
        case stated.FacingZone(normal_cone=cone):
            return NormalCone(cone.axis, cone.angle)
        case stated.NearSetZone(near_set=near):
            return NearSet(near.set, near.distance)
        case stated.NearEdgesZone(near_edges=distance):
            return NearEdges(distance)
        case stated.ShellFaceZone(shell_face=face):
            return ShellFace(UPPER if face == "upper" else LOWER)
        case stated.OnElementsZone(on_elements=kind):
            return OnElements(kind)
    return On(entry)
