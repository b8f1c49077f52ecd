"""import.h5: a `Mesh` by columns; lists of unequal length stand one behind the other with their offsets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from strainsight.mesh.kinds import ELEMENTS
from strainsight.mesh.model import (
    AveragingElement,
    CellBlock,
    Material,
    Mesh,
    NodalForces,
    PointMass,
    Region,
    RigidElement,
    Springs,
)
from strainsight.records.record import Source, dataset, group, read, record

ALL = ", all lists one behind the other"
OFFSET = "list i is [offset[i], offset[i + 1])"


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
class RigidElements:
    """RBE2."""

    id: np.ndarray = dataset("/id", "1", "rigid element", "id of every rigid element (RBE2)")
    reference: np.ndarray = dataset("/reference", "1", "rigid element", "reference node index of every rigid element")
    components: tuple[str, ...] = dataset("/components", "1", "rigid element", "components 1-6 of its dependent nodes")
    name: tuple[str, ...] = dataset("/name", "1", "rigid element", "its name in the words of the file")
    nodes: np.ndarray = dataset("/nodes", "1", "dependent node", "dependent node indices" + ALL)
    nodes_offset: np.ndarray = dataset("/nodes_offset", "1", "rigid element + 1", OFFSET)

    @classmethod
    def of(cls, elements: Sequence[RigidElement]) -> RigidElements:
        nodes, offset = _joined([e.nodes for e in elements], int)
        return cls(
            id=_ints([e.id for e in elements]),
            reference=_ints([e.reference for e in elements]),
            components=tuple(_letters(e.components) for e in elements),
            name=tuple(e.name for e in elements),
            nodes=nodes,
            nodes_offset=offset,
        )

    def made(self) -> tuple[RigidElement, ...]:
        columns = (
            self.id.tolist(),
            self.reference.tolist(),
            _split(self.nodes, self.nodes_offset),
            map(_components, self.components),
            self.name,
        )
        return tuple(RigidElement(*row) for row in zip(*columns, strict=True))


@record
class AveragingElements:
    """RBE3."""

    id: np.ndarray = dataset("/id", "1", "averaging element", "id of every averaging element (RBE3)")
    reference: np.ndarray = dataset(
        "/reference", "1", "averaging element", "reference node index of every averaging element"
    )
    components: tuple[str, ...] = dataset(
        "/components", "1", "averaging element", "components 1-6 of its reference node"
    )
    name: tuple[str, ...] = dataset("/name", "1", "averaging element", "its name in the words of the file")
    nodes: np.ndarray = dataset("/nodes", "1", "averaged node", "node indices" + ALL)
    nodes_offset: np.ndarray = dataset("/nodes_offset", "1", "averaging element + 1", OFFSET)
    weight: np.ndarray = dataset("/weight", "1", "averaged node", "weights" + ALL)
    weight_offset: np.ndarray = dataset("/weight_offset", "1", "averaging element + 1", OFFSET)
    directions: np.ndarray = dataset(
        "/directions", "1", "averaged node × 3", "1 where a translation of a node counts" + ALL
    )
    directions_offset: np.ndarray = dataset("/directions_offset", "1", "averaging element + 1", OFFSET)
    dependent: np.ndarray = dataset(
        "/dependent",
        "1",
        "component × 2",
        "[node index, component] that the relations are solved for (UM); none: the reference's own" + ALL,
    )
    dependent_offset: np.ndarray = dataset("/dependent_offset", "1", "averaging element + 1", OFFSET)

    @classmethod
    def of(cls, elements: Sequence[AveragingElement]) -> AveragingElements:
        counted = [np.ones((len(e.nodes), 3), bool) if e.directions is None else e.directions for e in elements]
        solved = [np.zeros((0, 2), np.int64) if e.dependent is None else e.dependent for e in elements]
        nodes, nodes_offset = _joined([e.nodes for e in elements], int)
        weight, weight_offset = _joined([e.weight for e in elements], float)
        directions, directions_offset = _joined(counted, int, (3,))
        dependent, dependent_offset = _joined(solved, int, (2,))
        return cls(
            id=_ints([e.id for e in elements]),
            reference=_ints([e.reference for e in elements]),
            components=tuple(_letters(e.components) for e in elements),
            name=tuple(e.name for e in elements),
            nodes=nodes,
            nodes_offset=nodes_offset,
            weight=weight,
            weight_offset=weight_offset,
            directions=directions,
            directions_offset=directions_offset,
            dependent=dependent,
            dependent_offset=dependent_offset,
        )

    def made(self) -> tuple[AveragingElement, ...]:
        columns = (
            self.id.tolist(),
            self.reference.tolist(),
            _split(self.nodes, self.nodes_offset),
            _split(self.weight, self.weight_offset),
            map(_components, self.components),
            [entry.astype(bool) for entry in _split(self.directions, self.directions_offset)],
            [entry if len(entry) else None for entry in _split(self.dependent, self.dependent_offset)],
            self.name,
        )
        return tuple(AveragingElement(*row) for row in zip(*columns, strict=True))


@record
class Axes:
    """Displacement systems of their own (CD)."""

    node: np.ndarray = dataset("/node", "1", "turned node", "node indices with a displacement system of their own")
    direction: np.ndarray = dataset(
        "/direction", "1", "turned node × 3 × 3", "their axes, one in a column (node × xyz × axis)"
    )


@record
class Constraints:
    fixed: np.ndarray = dataset(
        "/fixed",
        "1",
        "held component × 2",
        "components held at zero: [node index, component], 0-2 motions, 3-5 rotations",
    )
    rigid: tuple[RigidElement, ...] = group("/rigid", RigidElements)
    averaging: tuple[AveragingElement, ...] = group("/averaging", AveragingElements)
    axes: Axes = group("/axes")


@record
class PointMasses:
    id: np.ndarray = dataset("/id", "1", "mass", "id of every point mass")
    node: np.ndarray = dataset("/node", "1", "mass", "node index of every point mass")
    mass: np.ndarray = dataset("/mass", "kg", "mass", "mass of every point mass")
    offset: np.ndarray = dataset("/offset", "m", "mass × 3", "its centre from the node")
    inertia: np.ndarray = dataset("/inertia", "kg m^2", "mass × 3 × 3", "its inertia about the centre of mass")


@record
class SpringColumns:
    """Springs of elements and supports."""

    name: tuple[str, ...] = dataset("/name", "1", "support", "element or support in the words of the file or config")
    stiffness: np.ndarray = dataset("/stiffness", "SI", "spring", "N/m, of torsion springs N m/rad" + ALL)
    stiffness_offset: np.ndarray = dataset("/stiffness_offset", "1", "support + 1", OFFSET)
    spring: np.ndarray = dataset("/spring", "1", "part", "which spring of its list a motion is a part of" + ALL)
    node: np.ndarray = dataset("/node", "1", "part", "node index of that motion")
    component: np.ndarray = dataset("/component", "1", "part", "component of that motion: 0-2 motions, 3-5 rotations")
    value: np.ndarray = dataset("/value", "SI", "part", "elongation for a unit of that motion")
    part_offset: np.ndarray = dataset("/part_offset", "1", "support + 1", OFFSET)

    @classmethod
    def of(cls, elements: Sequence[Springs]) -> SpringColumns:
        stiffness, stiffness_offset = _joined([e.stiffness for e in elements], float)
        spring, part_offset = _joined([e.spring for e in elements], int)
        return cls(
            name=tuple(e.name for e in elements),
            stiffness=stiffness,
            stiffness_offset=stiffness_offset,
            spring=spring,
            node=_joined([e.node for e in elements], int)[0],
            component=_joined([e.component for e in elements], int)[0],
            value=_joined([e.value for e in elements], float)[0],
            part_offset=part_offset,
        )

    def made(self) -> tuple[Springs, ...]:
        parts = [_split(own, self.part_offset) for own in (self.spring, self.node, self.component, self.value)]
        each = zip(self.name, _split(self.stiffness, self.stiffness_offset), *parts, strict=True)
        return tuple(Springs(*row) for row in each)


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
    regions: Regions = group("/regions")
    materials: Materials = group("/materials")
    constraints: Constraints = group("/constraints")
    masses: PointMasses = group("/masses")
    springs: tuple[Springs, ...] = group("/springs", SpringColumns)
    loads: Loads = group("/loads")
    node_sets: Sets = group("/sets/nodes", what="nodes")
    element_sets: Sets = group("/sets/elements", what="elements")
    faces: NamedFaces = group("/faces/named")
    ignored: Ignored = group("/ignored")
    notes: tuple[str, ...] = dataset("/notes", "1", "note", "how something of the deck was read")

    @classmethod
    def of(cls, mesh: Mesh) -> MeshColumns:
        regions, materials, masses = list(mesh.regions.values()), list(mesh.materials.values()), mesh.point_masses
        loaded, loaded_offset = _joined([load.nodes for load in mesh.loads.values()], int)
        named, named_offset = _joined(list(mesh.faces.values()), int, (2,))
        force, force_offset = _joined([load.force for load in mesh.loads.values()], float, (3,))
        moments = [np.zeros_like(own.force) if own.moment is None else own.moment for own in mesh.loads.values()]
        moment, _ = _joined(moments, float, (3,))
        heavy, heavy_offset = _joined([np.array(load.regions) for load in mesh.loads.values()], int)
        return cls(
            nodes=Nodes(id=mesh.node_ids, position=mesh.position),
            cells={b.kind: Cells(id=b.ids, nodes=b.nodes, region=b.region) for b in mesh.blocks},
            regions=Regions(
                id=_ints([r.id for r in regions]),
                name=tuple(r.name for r in regions),
                material=_ints([r.material for r in regions]),
            ),
            materials=Materials(
                id=_ints([m.id for m in materials]),
                youngs_modulus=_floats([m.youngs_modulus for m in materials]),
                poisson_ratio=_floats([m.poisson_ratio for m in materials]),
                density=_floats([m.density for m in materials]),
                name=tuple(m.name for m in materials),
            ),
            constraints=Constraints(
                fixed=mesh.fixed.reshape(-1, 2),
                rigid=mesh.rigid,
                averaging=mesh.averaging,
                axes=Axes(node=_ints(list(mesh.axes)), direction=_floats(list(mesh.axes.values()), (3, 3))),
            ),
            masses=PointMasses(
                id=_ints([p.id for p in masses]),
                node=_ints([p.node for p in masses]),
                mass=_floats([p.mass for p in masses]),
                offset=_floats([p.offset for p in masses], (3,)),
                inertia=_floats([p.inertia for p in masses], (3, 3)),
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
                count=_ints(list(mesh.ignored.values())),
                effect=tuple(mesh.effect.get(card, "") for card in mesh.ignored),
            ),
            notes=tuple(mesh.notes),
        )

    def made(self) -> Mesh:
        cells, regions, materials, masses, loads = self.cells, self.regions, self.materials, self.masses, self.loads
        properties = (materials.youngs_modulus, materials.poisson_ratio, materials.density)
        tabled = zip(materials.id.tolist(), *(column.tolist() for column in properties), materials.name, strict=True)
        named = zip(regions.id.tolist(), regions.name, regions.material.tolist(), strict=True)
        weights = zip(
            masses.id.tolist(), masses.node.tolist(), masses.mass.tolist(), masses.offset, masses.inertia, strict=True
        )
        columns = (
            _split(loads.nodes, loads.nodes_offset),
            _split(loads.force, loads.force_offset),
            [own if own.any() else None for own in _split(loads.moment, loads.force_offset)],
            [tuple(own.tolist()) for own in _split(loads.regions, loads.regions_offset)],
        )
        axes = self.constraints.axes
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
            point_masses=tuple(PointMass(*row) for row in weights),
            springs=self.springs,
            axes=dict(zip(axes.node.tolist(), axes.direction, strict=True)),
            node_sets=_members(self.node_sets),
            element_sets=_members(self.element_sets),
            faces=dict(zip(self.faces.name, _split(self.faces.facets, self.faces.facets_offset), strict=True)),
            loads={
                name: NodalForces(nodes, force, moment, regions=regions)
                for name, nodes, force, moment, regions in zip(loads.name, *columns, strict=True)
            },
            notes=self.notes,
            ignored=dict(zip(self.ignored.card, self.ignored.count.tolist(), strict=True)),
            effect={card: e for card, e in zip(self.ignored.card, self.ignored.effect, strict=True) if e},
        )


def _sets(sets: Mapping[str, np.ndarray]) -> Sets:
    members, offset = _joined(list(sets.values()), int)
    return Sets(name=tuple(sets), members=members, members_offset=offset)


def _members(sets: Sets) -> dict[str, np.ndarray]:
    return dict(zip(sets.name, _split(sets.members, sets.members_offset), strict=True))


def _ints(values: Sequence[int]) -> np.ndarray:
    return np.array(values, dtype=np.int64)


def _floats(values: Sequence[float] | Sequence[np.ndarray], tail: tuple[int, ...] = ()) -> np.ndarray:
    return np.array(values, dtype=float).reshape(-1, *tail)


def _joined(lists: Sequence[np.ndarray], kind: type, tail: tuple[int, ...] = ()) -> tuple[np.ndarray, np.ndarray]:
    """Lists of entries of shape `tail`, one behind the other, and where each begins."""
    offset = np.concatenate([[0], np.cumsum([len(entry) for entry in lists])]).astype(np.int64)
    return np.concatenate([np.zeros((0, *tail), kind), *(np.asarray(entry, kind) for entry in lists)]), offset


def _split(flat: np.ndarray, offset: np.ndarray) -> list[np.ndarray]:
    return np.split(flat, offset[1:-1]) if len(offset) > 1 else []


def _letters(components: tuple[int, ...]) -> str:
    return "".join(str(c + 1) for c in components)


def _components(letters: str) -> tuple[int, ...]:
    return tuple(int(letter) - 1 for letter in letters)


@record
class Meshes:
    """import.h5 of a bench."""

    bodies: dict[str, Mesh] = group("/bodies/<name>", MeshColumns)


def mesh_from(source: Source, below: str = "") -> Mesh:
    """The mesh of an import, or of a body of a bench below its group."""
    return read(MeshColumns, source, below).made()
