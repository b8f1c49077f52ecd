"""Anisotropic materials of solids, and their axes, of a `Mesh` by columns."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.mesh.anisotropic import Anisotropic, Orientation
from strainsight.mesh.coordinates import CoordinateSystem
from strainsight.records.lists import floats, ints
from strainsight.records.record import dataset, record


@record
class AnisotropicMaterials:
    """Of solids."""

    id: np.ndarray = dataset("/id", "1", "anisotropic", "id of every anisotropic material")
    stiffness: np.ndarray = dataset(
        "/stiffness", "Pa", "anisotropic × 6 × 6", "from strain to stress along its axes: 11 22 33 12 23 31, γ = 2ε"
    )
    density: np.ndarray = dataset("/density", "kg/m^3", "anisotropic", "density of every anisotropic material")
    name: tuple[str, ...] = dataset("/name", "1", "anisotropic", "name in the words of the file or config")

    @classmethod
    def of(cls, materials: Mapping[int, Anisotropic]) -> AnisotropicMaterials | None:
        own = list(materials.values())
        if not own:
            return None
        return cls(
            id=ints([each.id for each in own]),
            stiffness=floats([each.stiffness for each in own], (6, 6)),
            density=floats([each.density for each in own]),
            name=tuple(each.name for each in own),
        )

    def made(self) -> dict[int, Anisotropic]:
        rows = zip(self.id.tolist(), self.stiffness, self.density.tolist(), self.name, strict=True)
        return {row[0]: Anisotropic(*row) for row in rows}


@record
class Orientations:
    """Of anisotropic materials."""

    region: np.ndarray = dataset("/region", "1", "orientation", "region id")
    kind: tuple[str, ...] = dataset(
        "/kind", "1", "orientation", "of the system of its axes: rectangular, cylindrical, spherical"
    )
    origin: np.ndarray = dataset("/origin", "m", "orientation × 3", "of the system")
    axes: np.ndarray = dataset("/axes", "1", "orientation × 3 × 3", "x, y, z of the system, one in a column")
    turn: np.ndarray = dataset(
        "/turn",
        "1",
        "orientation × 3 × 3",
        "axes 1, 2, 3 along the directions of the system at a point, one in a column",
    )

    @classmethod
    def of(cls, orientations: Mapping[int, Orientation]) -> Orientations | None:
        own = list(orientations.values())
        if not own:
            return None
        return cls(
            region=ints(list(orientations)),
            kind=tuple(each.system.kind for each in own),
            origin=floats([each.system.origin for each in own], (3,)),
            axes=floats([each.system.axes for each in own], (3, 3)),
            turn=floats([each.turn for each in own], (3, 3)),
        )

    def made(self) -> dict[int, Orientation]:
        rows = zip(self.region.tolist(), self.kind, self.origin, self.axes, self.turn, strict=True)
        return {region: Orientation(CoordinateSystem(*system), turn) for region, *system, turn in rows}
