"""Shells, beams and their sections of a `Mesh` by columns."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.mesh.laminates import Lamina, Laminate, Ply
from strainsight.mesh.thin import BeamBlock, BeamSection, GeneralShell, Section, ShellBlock, ShellSection
from strainsight.records.lists import ALL, OFFSET, floats, ints, joined, split
from strainsight.records.record import dataset, record


@record
class Shells:
    id: np.ndarray = dataset("/id", "1", "shell", "id of every shell of that kind in the deck")
    nodes: np.ndarray = dataset("/nodes", "1", "shell × node", "node indices in order around the shell")
    region: np.ndarray = dataset("/region", "1", "shell", "region id of every shell")
    offset: np.ndarray = dataset("/offset", "m", "shell", "its middle from its nodes, along the normal by their order")
    axis: np.ndarray = dataset(
        "/axis", "1", "shell × 3", "vector whose projection is x of its material; NaN: the side from its first node"
    )

    on_faces: np.ndarray = dataset(
        "/on_faces", "1", "shell with faces × 2 × node", "indices of the nodes on its upper and lower face, see /arms"
    )

    @classmethod
    def of(cls, block: ShellBlock) -> Shells:
        return cls(
            id=block.ids,
            nodes=block.nodes,
            region=block.region,
            offset=block.offset,
            axis=block.axis,
            on_faces=block.on_faces.reshape(-1, 2, block.nodes.shape[1]),
        )

    def made(self, kind: str) -> ShellBlock:
        return ShellBlock(kind, self.id, self.nodes, self.region, self.offset, self.axis, self.on_faces)


@record
class Beams:
    id: np.ndarray = dataset("/id", "1", "beam", "id of every beam or rod in the deck")
    nodes: np.ndarray = dataset("/nodes", "1", "beam × node", "node indices of its ends A and B, and of one between")
    region: np.ndarray = dataset("/region", "1", "beam", "region id of every beam or rod")
    axes: np.ndarray = dataset("/axes", "1", "beam × 3 × 3", "its axes x, y, z, one in a column; x from end A to B")
    offset: np.ndarray = dataset("/offset", "m", "beam × node × 3", "its axis from its nodes")
    released: np.ndarray = dataset(
        "/released", "1", "beam × 2 × 6", "1 where an end does not hand on a motion along those axes (pin flags)"
    )
    on_sides: np.ndarray = dataset(
        "/on_sides",
        "1",
        "beam with sides × side × node of it",
        "indices of the nodes on its four sides, −1 for none, see /arms",
    )

    @classmethod
    def of(cls, block: BeamBlock) -> Beams:
        return cls(
            id=block.ids,
            nodes=block.nodes,
            region=block.region,
            axes=block.axes,
            offset=block.offset,
            released=block.released.astype(np.int64),
            on_sides=block.on_sides,
        )

    def made(self, kind: str) -> BeamBlock:
        released = self.released.astype(bool)
        return BeamBlock(kind, self.id, self.nodes, self.region, self.axes, self.offset, released, self.on_sides)


@record
class ShellSections:
    region: np.ndarray = dataset("/region", "1", "shell section", "region id of every section")
    thickness: np.ndarray = dataset("/thickness", "m", "shell section", "thickness t")
    bending: np.ndarray = dataset(
        "/bending", "1", "shell section", "stiffness in bending over that of t³/12; 0: membrane"
    )
    shear: np.ndarray = dataset("/shear", "1", "shell section", "thickness in shear over t; infinite: no shear")
    nonstructural: np.ndarray = dataset("/nonstructural", "kg/m^2", "shell section", "mass that is not of its material")

    @classmethod
    def of(cls, sections: Mapping[int, Section]) -> ShellSections | None:
        own = {region: section for region, section in sections.items() if isinstance(section, ShellSection)}
        if not own:
            return None
        return cls(
            region=ints(list(own)),
            thickness=floats([section.thickness for section in own.values()]),
            bending=floats([section.bending for section in own.values()]),
            shear=floats([section.shear for section in own.values()]),
            nonstructural=floats([section.nonstructural for section in own.values()]),
        )

    def made(self) -> dict[int, Section]:
        columns = (self.thickness, self.bending, self.shear, self.nonstructural)
        rows = zip(*(column.tolist() for column in columns), strict=True)
        return {region: ShellSection(*row) for region, row in zip(self.region.tolist(), rows, strict=True)}


@record
class GeneralShells:
    """Sections of shells of several or anisotropic materials."""

    region: np.ndarray = dataset("/region", "1", "general shell", "region id of every section")
    thickness: np.ndarray = dataset("/thickness", "m", "general shell", "thickness t")
    membrane: np.ndarray = dataset(
        "/membrane", "Pa", "general shell × 3 × 3", "M of forces t M ε, along x and y of its material: xx yy xy, γ = 2ε"
    )
    coupling: np.ndarray = dataset("/coupling", "Pa", "general shell × 3 × 3", "C of forces t² C κ and moments t² C ε")
    bending: np.ndarray = dataset("/bending", "Pa", "general shell × 3 × 3", "D of moments t³/12 D κ; 0: membrane")
    shear: np.ndarray = dataset(
        "/shear", "Pa", "general shell × 2 × 2", "S of forces across t S γ: xz yz; infinite: no shear"
    )
    density: np.ndarray = dataset("/density", "kg/m^3", "general shell", "density")
    uniform: np.ndarray = dataset(
        "/uniform", "1", "general shell", "1 where membrane and bending are of one material, and nothing couples them"
    )
    nonstructural: np.ndarray = dataset("/nonstructural", "kg/m^2", "general shell", "mass that is not of its material")

    @classmethod
    def of(cls, sections: Mapping[int, Section]) -> GeneralShells | None:
        own = {region: section for region, section in sections.items() if isinstance(section, GeneralShell)}
        if not own:
            return None
        each = list(own.values())
        return cls(
            region=ints(list(own)),
            thickness=floats([section.thickness for section in each]),
            membrane=floats([section.membrane for section in each], (3, 3)),
            coupling=floats([section.coupling for section in each], (3, 3)),
            bending=floats([section.bending for section in each], (3, 3)),
            shear=floats([section.shear for section in each], (2, 2)),
            density=floats([section.density for section in each]),
            uniform=ints([section.uniform for section in each]),
            nonstructural=floats([section.nonstructural for section in each]),
        )

    def made(self) -> dict[int, Section]:
        rows = zip(
            self.region.tolist(),
            self.thickness.tolist(),
            self.membrane,
            self.coupling,
            self.bending,
            self.shear,
            self.density.tolist(),
            self.uniform.astype(bool).tolist(),
            self.nonstructural.tolist(),
            strict=True,
        )
        return {region: GeneralShell(*own) for region, *own in rows}


@record
class Laminates:
    """Sections of plies."""

    region: np.ndarray = dataset("/region", "1", "laminate", "region id of every laminate")
    nonstructural: np.ndarray = dataset("/nonstructural", "kg/m^2", "laminate", "mass that is not of its plies")
    plies_offset: np.ndarray = dataset("/plies_offset", "1", "laminate + 1", OFFSET)
    material: np.ndarray = dataset("/material", "1", "ply", "id of its material, from the lower face up" + ALL)
    thickness: np.ndarray = dataset("/thickness", "m", "ply", "thickness" + ALL)
    angle: np.ndarray = dataset("/angle", "deg", "ply", "angle of its axis 1 from x of the laminate" + ALL)

    @classmethod
    def of(cls, sections: Mapping[int, Section]) -> Laminates | None:
        own = {region: section for region, section in sections.items() if isinstance(section, Laminate)}
        if not own:
            return None
        material, offset = joined([ints([ply.material for ply in each.plies]) for each in own.values()], int)
        plies = [ply for each in own.values() for ply in each.plies]
        return cls(
            region=ints(list(own)),
            nonstructural=floats([each.nonstructural for each in own.values()]),
            plies_offset=offset,
            material=material,
            thickness=floats([ply.thickness for ply in plies]),
            angle=floats([ply.angle for ply in plies]),
        )

    def made(self) -> dict[int, Section]:
        rows = zip(self.material.tolist(), self.thickness.tolist(), self.angle.tolist(), strict=True)
        plies = [Ply(*row) for row in rows]
        found: dict[int, Section] = {}
        for i, (region, beside) in enumerate(zip(self.region.tolist(), self.nonstructural.tolist(), strict=True)):
            first, last = self.plies_offset[i : i + 2].tolist()
            found[region] = Laminate(tuple(plies[first:last]), beside)
        return found


@record
class Laminae:
    """Orthotropic materials of plies."""

    id: np.ndarray = dataset("/id", "1", "lamina", "id of every orthotropic material")
    e1: np.ndarray = dataset("/e1", "Pa", "lamina", "modulus along its axis 1")
    e2: np.ndarray = dataset("/e2", "Pa", "lamina", "modulus along its axis 2")
    nu12: np.ndarray = dataset("/nu12", "1", "lamina", "contraction along 2 of a stress along 1")
    g12: np.ndarray = dataset("/g12", "Pa", "lamina", "shear modulus in its plane")
    g1z: np.ndarray = dataset("/g1z", "Pa", "lamina", "shear modulus across, of axis 1; infinite: no shear")
    g2z: np.ndarray = dataset("/g2z", "Pa", "lamina", "shear modulus across, of axis 2; infinite: no shear")
    density: np.ndarray = dataset("/density", "kg/m^3", "lamina", "density of every orthotropic material")
    name: tuple[str, ...] = dataset("/name", "1", "lamina", "name in the words of the file")

    @classmethod
    def of(cls, laminae: Mapping[int, Lamina]) -> Laminae | None:
        own = list(laminae.values())
        if not own:
            return None
        columns = {name: floats([getattr(each, name) for each in own]) for name in _COLUMNS}
        return cls(id=ints([each.id for each in own]), name=tuple(each.name for each in own), **columns)

    def made(self) -> dict[int, Lamina]:
        columns = zip(*(getattr(self, name).tolist() for name in _COLUMNS), strict=True)
        rows = zip(self.id.tolist(), columns, self.name, strict=True)
        return {
            number: Lamina(id=number, name=name, **dict(zip(_COLUMNS, values, strict=True)))
            for number, values, name in rows
        }


_COLUMNS = ("e1", "e2", "nu12", "g12", "g1z", "g2z", "density")


@record
class BeamSections:
    """A row an end: A, and B where the section is another there."""

    region: np.ndarray = dataset("/region", "1", "end", "region id; two rows: end A, then end B")
    area: np.ndarray = dataset("/area", "m^2", "end", "area")
    second: np.ndarray = dataset("/second", "m^4", "end × 2 × 2", "∫ (y, z)ᵀ (y, z) dA")
    torsion: np.ndarray = dataset("/torsion", "m^4", "end", "torsion constant J")
    shear: np.ndarray = dataset("/shear", "1", "end × 2", "areas in shear along y and z over the area; 0: no shear")
    points: np.ndarray = dataset("/points", "m", "point × 2", "y and z where its strain is asked for" + ALL)
    points_offset: np.ndarray = dataset("/points_offset", "1", "end + 1", OFFSET)
    nonstructural: np.ndarray = dataset("/nonstructural", "kg/m", "end", "mass that is not of its material")
    neutral: np.ndarray = dataset("/neutral", "m", "end × 2", "y and z of the neutral axis from the shear centre")
    beside: np.ndarray = dataset("/beside", "m", "end × 2", "y and z of that mass from the shear centre")

    @classmethod
    def of(cls, sections: Mapping[int, Section]) -> BeamSections | None:
        ends = [
            (region, end)
            for region, own in sections.items()
            if isinstance(own, BeamSection)
            for end in (own, own.at_b)
            if end is not None
        ]
        if not ends:
            return None
        points, offset = joined([own.points for _, own in ends], float, (2,))
        return cls(
            region=ints([region for region, _ in ends]),
            area=floats([own.area for _, own in ends]),
            second=floats([own.second for _, own in ends], (2, 2)),
            torsion=floats([own.torsion for _, own in ends]),
            shear=floats([np.array(own.shear) for _, own in ends], (2,)),
            points=points,
            points_offset=offset,
            nonstructural=floats([own.nonstructural for _, own in ends]),
            neutral=floats([np.array(own.neutral) for _, own in ends], (2,)),
            beside=floats([np.array(own.beside) for _, own in ends], (2,)),
        )

    def made(self) -> dict[int, Section]:
        rows = zip(
            self.region.tolist(),
            self.area.tolist(),
            self.second,
            self.torsion.tolist(),
            self.shear.tolist(),
            split(self.points, self.points_offset),
            self.nonstructural.tolist(),
            self.neutral.tolist(),
            self.beside.tolist(),
            strict=True,
        )
        found: dict[int, Section] = {}
        for region, area, second, torsion, (y, z), points, nonstructural, n, m in reversed(list(rows)):  # end B first
            end_b = found.get(region)
            assert end_b is None or isinstance(end_b, BeamSection)
            found[region] = BeamSection(
                *(area, second, torsion, (y, z), points, nonstructural, end_b),
                neutral=(n[0], n[1]),
                beside=(m[0], m[1]),
            )
        return found
