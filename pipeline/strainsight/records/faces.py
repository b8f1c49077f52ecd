"""What `import` writes: the mesh, and the faces that it finds on its surface."""

from __future__ import annotations

import numpy as np

from strainsight.gauges.faces import Faces
from strainsight.records.mesh import MeshColumns
from strainsight.records.record import dataset, group, record


@record
class FoundFaces:
    """`Faces` without the facets of each."""

    area: np.ndarray = dataset("m^2", "face", "area, the largest first")
    centre: np.ndarray = dataset("m", "face × 3", "centre, weighted by area")
    normal: np.ndarray = dataset("1", "face × 3", "outward normal of a flat face, zero where it is bent")
    radius: np.ndarray = dataset("m", "face", "radius of a cylinder, zero of others")
    axis: np.ndarray = dataset("1", "face × 3", "axis of a cylinder, zero of others")
    hollow: np.ndarray = dataset("1", "face", "whether a cylinder is a bore")
    point: np.ndarray = dataset("m", "face × 3", "a point of each face")

    @classmethod
    def of(cls, faces: Faces) -> FoundFaces:
        return cls(
            area=faces.area,
            centre=faces.centre,
            normal=faces.normal,
            radius=faces.radius,
            axis=faces.axis,
            hollow=faces.hollow,
            point=faces.point,
        )


@record
class Imported:
    """import.h5 of a structure."""

    mesh: MeshColumns = group(path="")
    found: FoundFaces | None = group(path="/faces/found", default=None)
