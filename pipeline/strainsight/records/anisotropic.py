"""Anisotropic materials of solids, their axes, and composite solids, of a `Mesh` by columns."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.mesh.anisotropic import Anisotropic, Orientation
from strainsight.mesh.composite_solids import CompositeSolid, Layer
from strainsight.mesh.coordinates import CoordinateSystem
from strainsight.records.lists import ALL, OFFSET, floats, ints, joined
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


@record
class Composites:
    """Solids of layers."""

    region: np.ndarray = dataset("/region", "1", "composite", "region id")
    direction: np.ndarray = dataset(
        "/direction",
        "1",
        "composite",
        "along which of its reference directions the layers of an element lie: 0, 1 or 2",
    )
    layers_offset: np.ndarray = dataset("/layers_offset", "1", "composite + 1", OFFSET)
    material: np.ndarray = dataset("/material", "1", "layer", "id of its material, from ξ = −1 on" + ALL)
    thickness: np.ndarray = dataset("/thickness", "1", "layer", "relative to the others" + ALL)
    kind: tuple[str, ...] = dataset("/kind", "1", "layer", "of the system of its axes, see /orientations" + ALL)
    origin: np.ndarray = dataset("/origin", "m", "layer × 3", "of the system" + ALL)
    axes: np.ndarray = dataset("/axes", "1", "layer × 3 × 3", "x, y, z of the system, one in a column" + ALL)
    turn: np.ndarray = dataset(
        "/turn", "1", "layer × 3 × 3", "axes 1, 2, 3 along the directions of the system, one in a column" + ALL
    )

    @classmethod
    def of(cls, composites: Mapping[int, CompositeSolid]) -> Composites | None:
        if not composites:
            return None
        material, offset = joined([ints([own.material for own in each.layers]) for each in composites.values()], int)
        layers = [own for each in composites.values() for own in each.layers]
        systems = [own.orientation.system for own in layers]
        return cls(
            region=ints(list(composites)),
            direction=ints([each.direction for each in composites.values()]),
            layers_offset=offset,
            material=material,
            thickness=floats([own.thickness for own in layers]),
            kind=tuple(own.kind for own in systems),
            origin=floats([own.origin for own in systems], (3,)),
            axes=floats([own.axes for own in systems], (3, 3)),
            turn=floats([own.orientation.turn for own in layers], (3, 3)),
        )

    def made(self) -> dict[int, CompositeSolid]:
        rows = zip(
            self.material.tolist(), self.thickness.tolist(), self.kind, self.origin, self.axes, self.turn, strict=True
        )
        layers = [Layer(of, t, Orientation(CoordinateSystem(*system), turn)) for of, t, *system, turn in rows]
        found = {}
        for i, (region, direction) in enumerate(zip(self.region.tolist(), self.direction.tolist(), strict=True)):
            first, last = self.layers_offset[i : i + 2].tolist()
            found[region] = CompositeSolid(tuple(layers[first:last]), direction)
        return found
