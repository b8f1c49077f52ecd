"""import.h5: a `Mesh` by columns."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.mesh.forces import NodalForces
from strainsight.mesh.joins import PointMass, Springs
from strainsight.mesh.kinds import ELEMENTS
from strainsight.mesh.model import CellBlock, Material, Mesh, Region
from strainsight.mesh.thin import BEAM_KINDS, SHELL_KINDS, Section
from strainsight.records.anisotropic import AnisotropicMaterials, Composites, Orientations
from strainsight.records.lists import ALL, OFFSET, floats, ints, joined, split
from strainsight.records.record import Source, dataset, group, read, record
from strainsight.records.thin import Beams, BeamSections, GeneralShells, Laminae, Laminates, Shells, ShellSections
from strainsight.records.ties import Axes, Constraints, SpringColumns


@record
class Nodes:
    id: np.ndarray = dataset("/id", "1", "/id", "id of every node in the deck")
    position: np.ndarray = dataset("/position", "m", "/id × 3", "position of every node")


@record
class Cells:
    id: np.ndarray = dataset("/id", "1", "element", "id of every element of that kind in the deck")
    nodes: np.ndarray = dataset("/nodes", "1", "element × node", "node indices in VTK order")
    region: np.ndarray = dataset("/region", "1", "element", "region id of every element")


@record
class Regions:
    id: np.ndarray = dataset("/id", "1", "region", "id of every region")
    name: tuple[str, ...] = dataset("/name", "1", "region", "name of every region")
    material: np.ndarray = dataset("/material", "1", "region", "material id of every region")


@record
class Materials:
    id: np.ndarray = dataset("/id", "1", "material", "id of every material")
    youngs_modulus: np.ndarray = dataset("/youngs_modulus", "Pa", "material", "Young's modulus of every material")
    poisson_ratio: np.ndarray = dataset("/poisson_ratio", "1", "material", "Poisson's ratio of every material")
    density: np.ndarray = dataset("/density", "kg/m^3", "material", "density of every material")
    name: tuple[str, ...] = dataset(
        "/name", "1", "material", "name of every material, in the words of the file or config"
    )


@record
class PointMasses:
    id: np.ndarray = dataset("/id", "1", "mass", "id of every point mass")
    node: np.ndarray = dataset("/node", "1", "mass", "node index of every point mass")
    mass: np.ndarray = dataset("/mass", "kg", "mass", "mass of every point mass")
    offset: np.ndarray = dataset("/offset", "m", "mass × 3", "its centre from the node")
    inertia: np.ndarray = dataset("/inertia", "kg m^2", "mass × 3 × 3", "its inertia about the centre of mass")
    matrix: np.ndarray = dataset(
        "/matrix", "SI", "mass × 6 × 6", "of one that is another mass along another axis (CONM1, CMASS), else 0"
    )


@record
class Loads:
    name: tuple[str, ...] = dataset("/name", "1", "load", "name of every load of the deck")
    nodes: np.ndarray = dataset("/nodes", "1", "loaded node", "loaded node indices" + ALL)
    nodes_offset: np.ndarray = dataset("/nodes_offset", "1", "load + 1", OFFSET)
    force: np.ndarray = dataset("/force", "N", "loaded node × 3", "forces" + ALL)
    force_offset: np.ndarray = dataset("/force_offset", "1", "load + 1", OFFSET)
    moment: np.ndarray = dataset("/moment", "N m", "loaded node × 3", "moments, 0 where there are none" + ALL)
    regions: np.ndarray = dataset("/regions", "1", "region", "ids of regions whose mass makes some of the forces" + ALL)
    regions_offset: np.ndarray = dataset("/regions_offset", "1", "load + 1", OFFSET)


@record
class Sets:
    name: tuple[str, ...] = dataset("/name", "1", "set", "name of every set of <what>")
    members: np.ndarray = dataset("/members", "1", "member", "ids of the deck" + ALL)
    members_offset: np.ndarray = dataset("/members_offset", "1", "set + 1", OFFSET)


@record
class NamedFaces:
    """Faces that the config names."""

    name: tuple[str, ...] = dataset("/name", "1", "name", "name; its nodes are a node set of that name")
    facets: np.ndarray = dataset("/facets", "1", "named facet × 2", "element id and local facet number" + ALL)
    facets_offset: np.ndarray = dataset("/facets_offset", "1", "name + 1", OFFSET)


@record
class Ignored:
    card: tuple[str, ...] = dataset("/card", "1", "card", "card that is not supported")
    count: np.ndarray = dataset("/count", "1", "card", "how often")
    effect: tuple[str, ...] = dataset(
        "/effect",
        "1",
        "card",
        "structure: it may add stiffness, mass or a tie; none: it changes none of them; empty: unknown",
    )


@record
class MeshColumns:
    """`Mesh`; lengths in m."""

    nodes: Nodes = group("/nodes")
    cells: dict[str, Cells] = group("/cells/<name>")
    shells: dict[str, Shells] = group("/shells/<name>")
    beams: dict[str, Beams] = group("/beams/<name>")
    arms: np.ndarray = dataset(
        "/arms",
        "1",
        "arm × 2",
        "node on a face of a shell or a side of a beam, and the node that it follows as a rigid arm",
    )
    regions: Regions = group("/regions")
    shell_sections: ShellSections | None = group("/sections/shells")
    general_shells: GeneralShells | None = group("/sections/general")
    beam_sections: BeamSections | None = group("/sections/beams")
    laminates: Laminates | None = group("/sections/laminates")
    laminae: Laminae | None = group("/laminae")
    materials: Materials = group("/materials")
    anisotropic: AnisotropicMaterials | None = group("/anisotropic")
    orientations: Orientations | None = group("/orientations")
    composites: Composites | None = group("/composites")
    constraints: Constraints = group("/constraints")
    masses: PointMasses = group("/masses")
    springs: tuple[Springs, ...] = group("/springs", SpringColumns)
    loads: Loads = group("/loads")
    node_sets: Sets = group("/sets/nodes", what="nodes")
    element_sets: Sets = group("/sets/elements", what="elements")
    faces: NamedFaces = group("/faces/named")
    ignored: Ignored = group("/ignored")
    notes: tuple[str, ...] = dataset("/notes", "1", "note", "how something of the deck was read")
    doubts: tuple[str, ...] = dataset(
        "/doubts", "1", "doubt", "what the deck says that is more likely a mistake than meant"
    )
    contacts: tuple[str, ...] | None = dataset(
        "/contacts",
        "1",
        "pair",
        "what became of each pair of surfaces in contact; missing without contact",
        default=None,
    )
    lumped: int | None = dataset(
        "/lumped", "1", "", "1 where the mass of solids is lumped; missing where it is consistent", default=None
    )

    @classmethod
    def of(cls, mesh: Mesh) -> MeshColumns:
        regions, materials, masses = list(mesh.regions.values()), list(mesh.materials.values()), mesh.point_masses
        loaded, loaded_offset = joined([load.nodes for load in mesh.loads.values()], int)
        named, named_offset = joined(list(mesh.faces.values()), int, (2,))
        force, force_offset = joined([load.force for load in mesh.loads.values()], float, (3,))
        moments = [np.zeros_like(own.force) if own.moment is None else own.moment for own in mesh.loads.values()]
        moment, _ = joined(moments, float, (3,))
        heavy, heavy_offset = joined([np.array(load.regions) for load in mesh.loads.values()], int)
        return cls(
            nodes=Nodes(id=mesh.node_ids, position=mesh.position),
            cells={b.kind: Cells(id=b.ids, nodes=b.nodes, region=b.region) for b in mesh.blocks},
            shells={b.kind: Shells.of(b) for b in mesh.shells},
            beams={b.kind: Beams.of(b) for b in mesh.beams},
            arms=mesh.arms,
            shell_sections=ShellSections.of(mesh.sections),
            general_shells=GeneralShells.of(mesh.sections),
            beam_sections=BeamSections.of(mesh.sections),
            laminates=Laminates.of(mesh.sections),
            laminae=Laminae.of(mesh.laminae),
            anisotropic=AnisotropicMaterials.of(mesh.anisotropic),
            orientations=Orientations.of(mesh.orientations),
            composites=Composites.of(mesh.composites),
            regions=Regions(
                id=ints([r.id for r in regions]),
                name=tuple(r.name for r in regions),
                material=ints([r.material for r in regions]),
            ),
            materials=Materials(
                id=ints([m.id for m in materials]),
                youngs_modulus=floats([m.youngs_modulus for m in materials]),
                poisson_ratio=floats([m.poisson_ratio for m in materials]),
                density=floats([m.density for m in materials]),
                name=tuple(m.name for m in materials),
            ),
            constraints=Constraints(
                fixed=mesh.fixed.reshape(-1, 2),
                rigid=mesh.rigid,
                averaging=mesh.averaging,
                relations=mesh.relations,
                axes=Axes(node=ints(list(mesh.axes)), direction=floats(list(mesh.axes.values()), (3, 3))),
            ),
            masses=PointMasses(
                id=ints([p.id for p in masses]),
                node=ints([p.node for p in masses]),
                mass=floats([p.mass for p in masses]),
                offset=floats([p.offset for p in masses], (3,)),
                inertia=floats([p.inertia for p in masses], (3, 3)),
                matrix=floats([np.zeros((6, 6)) if p.matrix is None else p.matrix for p in masses], (6, 6)),
            ),
            springs=mesh.springs,
            loads=Loads(
                name=tuple(mesh.loads),
                nodes=loaded,
                nodes_offset=loaded_offset,
                force=force,
                force_offset=force_offset,
                moment=moment,
                regions=heavy,
                regions_offset=heavy_offset,
            ),
            node_sets=_sets(mesh.node_sets),
            element_sets=_sets(mesh.element_sets),
            faces=NamedFaces(name=tuple(mesh.faces), facets=named, facets_offset=named_offset),
            ignored=Ignored(
                card=tuple(mesh.ignored),
                count=ints(list(mesh.ignored.values())),
                effect=tuple(mesh.effect.get(card, "") for card in mesh.ignored),
            ),
            notes=tuple(mesh.notes),
            doubts=tuple(mesh.doubts),
            contacts=mesh.contacts or None,
            lumped=1 if mesh.lumped else None,
        )

    def made(self) -> Mesh:
        cells, regions, materials, masses, loads = self.cells, self.regions, self.materials, self.masses, self.loads
        properties = (materials.youngs_modulus, materials.poisson_ratio, materials.density)
        tabled = zip(materials.id.tolist(), *(column.tolist() for column in properties), materials.name, strict=True)
        named = zip(regions.id.tolist(), regions.name, regions.material.tolist(), strict=True)
        matrices = [own if own.any() else None for own in masses.matrix]
        numbers = masses.id.tolist(), masses.node.tolist(), masses.mass.tolist()
        weights = zip(*numbers, masses.offset, masses.inertia, matrices, strict=True)
        columns = (
            split(loads.nodes, loads.nodes_offset),
            split(loads.force, loads.force_offset),
            [own if own.any() else None for own in split(loads.moment, loads.force_offset)],
            [tuple(own.tolist()) for own in split(loads.regions, loads.regions_offset)],
        )
        axes = self.constraints.axes
        sections: dict[int, Section] = {}
        for own in (self.shell_sections, self.general_shells, self.beam_sections, self.laminates):
            sections |= own.made() if own is not None else {}
        return Mesh(
            node_ids=self.nodes.id,
            position=self.nodes.position,
            blocks=tuple(
                CellBlock(kind, cells[kind].id, cells[kind].nodes, cells[kind].region)
                for kind in (known.name for known in ELEMENTS)
                if kind in cells
            ),
            regions={row[0]: Region(*row) for row in named},
            materials={row[0]: Material(*row) for row in tabled},
            fixed=self.constraints.fixed,
            rigid=self.constraints.rigid,
            averaging=self.constraints.averaging,
            relations=self.constraints.relations,
            point_masses=tuple(PointMass(*row) for row in weights),
            springs=self.springs,
            shells=tuple(self.shells[kind].made(kind) for kind in SHELL_KINDS if kind in self.shells),
            beams=tuple(self.beams[kind].made(kind) for kind in BEAM_KINDS if kind in self.beams),
            arms=self.arms,
            laminae={} if self.laminae is None else self.laminae.made(),
            anisotropic={} if self.anisotropic is None else self.anisotropic.made(),
            orientations={} if self.orientations is None else self.orientations.made(),
            composites={} if self.composites is None else self.composites.made(),
            sections={number: sections[number] for number in regions.id.tolist() if number in sections},
            axes=dict(zip(axes.node.tolist(), axes.direction, strict=True)),
            node_sets=_members(self.node_sets),
            element_sets=_members(self.element_sets),
            faces=dict(zip(self.faces.name, split(self.faces.facets, self.faces.facets_offset), strict=True)),
            loads={
                name: NodalForces(nodes, force, moment, regions=regions)
                for name, nodes, force, moment, regions in zip(loads.name, *columns, strict=True)
            },
            notes=self.notes,
            doubts=self.doubts,
            contacts=self.contacts or (),
            lumped=bool(self.lumped),
            ignored=dict(zip(self.ignored.card, self.ignored.count.tolist(), strict=True)),
            effect={card: e for card, e in zip(self.ignored.card, self.ignored.effect, strict=True) if e},
        )


def _sets(sets: Mapping[str, np.ndarray]) -> Sets:
    members, offset = joined(list(sets.values()), int)
    return Sets(name=tuple(sets), members=members, members_offset=offset)


def _members(sets: Sets) -> dict[str, np.ndarray]:
    return dict(zip(sets.name, split(sets.members, sets.members_offset), strict=True))


@record
class Meshes:
    """import.h5 of a bench."""

    bodies: dict[str, Mesh] = group("/bodies/<name>", MeshColumns)


def mesh_from(source: Source, below: str = "") -> Mesh:
    """The mesh of an import, or of a body of a bench below its group."""
    return read(MeshColumns, source, below).made()
