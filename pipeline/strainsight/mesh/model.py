"""A finite-element model as read from a mesh file, in SI units and with the ids of the file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from strainsight.columns import Column
from strainsight.errors import DeckError, UserError
from strainsight.mesh.anisotropic import Anisotropic, CompositeSolid, Orientation
from strainsight.mesh.joins import AveragingElement, NodalForces, PointMass, Relation, RigidElement, Springs
from strainsight.mesh.thin import (
    BeamBlock,
    GeneralShell,
    Lamina,
    Laminate,
    Section,
    ShellBlock,
    concatenate,
    nodes_that_turn,
)
from strainsight.mesh.thin import FloatArray as FloatArray
from strainsight.mesh.thin import IntArray as IntArray


@dataclass(frozen=True)
class CellBlock:
    """Elements of one of the `kinds`."""

    kind: str
    ids: Annotated[IntArray, Column("1", "element", "id of every element in the deck", name="id")]
    nodes: Annotated[IntArray, Column("1", "element × node", "node indices of every element, in VTK order")]
    region: Annotated[IntArray, Column("1", "element", "region id of every element")]

    @classmethod
    def joined(cls, blocks: Sequence[CellBlock]) -> CellBlock:
        """Blocks of one kind as one block, of kind "" without any."""
        if not blocks:
            return cls("", *(np.zeros(shape, dtype=np.int64) for shape in (0, (0, 0), 0)))
        columns = ([getattr(block, name) for block in blocks] for name in ("ids", "nodes", "region"))
        return cls(blocks[0].kind, *(np.concatenate(parts) for parts in columns))


@dataclass(frozen=True)
class Material:
    """Linear isotropic."""

    id: Annotated[int, Column("1", "", "id of every material")]
    youngs_modulus: Annotated[float, Column("Pa", "", "Young's modulus of every material")]
    poisson_ratio: Annotated[float, Column("1", "", "Poisson's ratio of every material")]
    density: Annotated[float, Column("kg/m^3", "", "density of every material")]
    name: Annotated[str, Column("1", "", "name of every material in the file or config")] = ""

    def __str__(self) -> str:
        return self.name or f"material {self.id}"


@dataclass(frozen=True)
class Region:
    """A property that elements refer to (a PSOLID, an element set, a physical group); material is 0 without one in the file, and
    for a laminate or composite solid, whose plies or layers have materials."""

    id: Annotated[int, Column("1", "", "id of every region")]
    name: Annotated[str, Column("1", "", "name of every region")]
    material: Annotated[
        int, Column("1", "", "material id of every region; 0: no material, or several (one for each ply or layer)")
    ]

    def __str__(self) -> str:
        return f"region {self.id} ({self.name})"


def element_error(element: int, what: str, remedy: str) -> DeckError:
    """A DeckError at an element (id); the caller adds the line of the file."""
    return DeckError(what, remedy=remedy, entity=("element", int(element)))


class IdTable:
    """Ids (n,) of a file, each once, to their rows."""

    def __init__(self, ids: IntArray):
        self.ids = ids
        self._order = np.argsort(ids, kind="stable")
        self.sorted = ids[self._order]

    def rows(self, ids: IntArray) -> tuple[IntArray, np.ndarray]:
        """Rows for ids of any shape, and whether an id is missing (its row is then meaningless)."""
        if not self.sorted.size:
            return np.zeros(ids.shape, dtype=np.int64), np.ones(ids.shape, dtype=bool)
        at = np.minimum(np.searchsorted(self.sorted, ids), self.sorted.size - 1)
        return self._order[at].astype(np.int64), self.sorted[at] != ids


@dataclass(frozen=True)
class Origin:
    """Lines of entities in the file: ids (n,), line (n,) from 1 in file (n,), an index into files."""

    ids: IntArray
    line: IntArray
    file: IntArray
    files: tuple[str, ...]

    @classmethod
    def at(cls, ids: IntArray, places: Sequence[tuple[str, int]]) -> Origin:
        """Origin of entities with ids (n,) from file and line of each."""
        files = {file: i for i, file in enumerate(dict.fromkeys(file for file, _ in places))}
        file, line = (
            np.array(part, dtype=np.int64) for part in ([files[f] for f, _ in places], [n for _, n in places])
        )
        return cls(ids, line, file, tuple(files))


MATERIAL_FIELDS = {Material: "materials", Lamina: "laminae", Anisotropic: "anisotropic"}
"""Type of a material → the field of `Properties` for it."""


@dataclass(frozen=True, kw_only=True)
class Properties:
    """Regions, materials and sections of elements.

    regions and isotropic materials by id; laminae: orthotropic materials of plies; anisotropic: materials of solids; ids of
    materials are unique among all of them. orientations: region id → orientation of its anisotropic material, default the basic
    axes; composites: region id of solids → their layers; sections: region id of shells or beams → its section."""

    regions: dict[int, Region] = field(default_factory=dict)
    materials: dict[int, Material] = field(default_factory=dict)
    laminae: dict[int, Lamina] = field(default_factory=dict)
    anisotropic: dict[int, Anisotropic] = field(default_factory=dict)
    orientations: dict[int, Orientation] = field(default_factory=dict)
    composites: dict[int, CompositeSolid] = field(default_factory=dict)
    sections: dict[int, Section] = field(default_factory=dict)

    def free_material(self) -> int:
        """An unused material id."""
        return max([0, *self.materials, *self.laminae, *self.anisotropic]) + 1

    def laminate(self, region: int) -> Laminate | None:
        """The plies of a region (id); None for any other section, and for solids."""
        section = self.sections.get(region)
        return section if isinstance(section, Laminate) else None

    def general_shell(self, region: int) -> GeneralShell | None:
        """The general section of a region (id) of shells, with explicit stiffness and density; None for any other."""
        section = self.sections.get(region)
        return section if isinstance(section, GeneralShell) else None

    def ply_materials(self, region: int) -> tuple[Lamina | Material | None, ...]:
        """The material of every ply of a laminate (region id), None if it does not exist."""
        laminate = self.laminate(region)
        ids = [ply.material for ply in laminate.plies] if laminate else []
        return tuple(self.laminae.get(number) or self.materials.get(number) for number in ids)

    def layer_materials(self, region: int) -> tuple[Anisotropic | Material | None, ...]:
        """The material of every layer of a composite solid (region id), None if it does not exist."""
        composite = self.composites.get(region)
        ids = [layer.material for layer in composite.layers] if composite else []
        return tuple(self.anisotropic.get(number) or self.materials.get(number) for number in ids)

    def material_of(self, region: int) -> Material | None:
        """The isotropic material of a region (id); None without one, or for several or anisotropic materials."""
        several = self.laminate(region) or self.composites.get(region)
        return None if several else self.materials.get(self.regions[region].material)

    def anisotropic_of(self, region: int) -> Anisotropic | None:
        """The anisotropic material of a region (id) of solids, or None."""
        return self.anisotropic.get(self.regions[region].material)

    def density_of(self, region: int) -> float | None:
        """Density of a region (id) [kg/m³], for a laminate or composite solid the mean over its thickness, Σ ρt/Σ t; None if a
        material is missing."""
        if (shell := self.general_shell(region)) is not None:
            return shell.density
        if (laminate := self.laminate(region)) is not None:
            stack = [
                (ply.thickness, material)
                for ply, material in zip(laminate.plies, self.ply_materials(region), strict=True)
            ]
            return _mean_density(stack)
        if (composite := self.composites.get(region)) is not None:
            return _mean_density(list(zip(composite.shares.tolist(), self.layer_materials(region), strict=True)))
        material = self.material_of(region) or self.anisotropic_of(region)
        return None if material is None else material.density


def _mean_density(stack: Sequence[tuple[float, Lamina | Anisotropic | Material | None]]) -> float | None:
    """Σ ρt/Σ t of thicknesses and their materials; None if one is missing."""
    parts = [(t, material.density) for t, material in stack if material is not None]
    return sum(rho * t for t, rho in parts) / sum(t for t, _ in parts) if len(parts) == len(stack) else None


@dataclass(frozen=True)
class Mesh(Properties):
    """A finite-element model as read from its file, lengths in m, masses in kg.

    node_ids (n,) of the file; position (n, 3) [m]; blocks of solid cells, shells, beams; fixed (f, 2): pairs (node index,
    component 0-5) that are clamped; rigid and averaging elements, relations between displacements, point_masses, springs;
    arms (a, 2): the last a nodes, on faces of shells and sides of beams, and the node that each follows as a rigid arm, with
    the same id; axes: node index → (3, 3) local axes, one in a column, of the components of fixed, rigid, averaging and
    relations at that node (CD of a GRID), default the basic axes; node_sets and element_sets: name → ids of the file; faces:
    name → facets (k, 2) as element id and local number, their nodes are a node set of that name; loads: name → forces of the
    file; ignored: unsupported card or similar → count; effect: "structure" for those that may add stiffness, mass or a tie,
    "none" for the others; unsupported: ignored elements, ties or loads → file:line of the first; notes: remarks on the import;
    doubts: warnings of probable mistakes in the file; contacts: treatment of contact surfaces, a sentence each; lumped: whether
    the mass of solids is lumped; read: imported card or similar → count; source: the file; included: files included by the
    deck; origin: "node", "element", "tie", "relation" → lines."""

    node_ids: IntArray
    position: FloatArray
    blocks: tuple[CellBlock, ...]
    fixed: IntArray = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    rigid: tuple[RigidElement, ...] = ()
    averaging: tuple[AveragingElement, ...] = ()
    relations: tuple[Relation, ...] = ()
    point_masses: tuple[PointMass, ...] = ()
    springs: tuple[Springs, ...] = ()
    shells: tuple[ShellBlock, ...] = ()
    beams: tuple[BeamBlock, ...] = ()
    arms: IntArray = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    axes: Mapping[int, FloatArray] = field(default_factory=dict)
    node_sets: Mapping[str, IntArray] = field(default_factory=dict)
    element_sets: Mapping[str, IntArray] = field(default_factory=dict)
    faces: Mapping[str, IntArray] = field(default_factory=dict)
    loads: Mapping[str, NodalForces] = field(default_factory=dict)
    ignored: Mapping[str, int] = field(default_factory=dict)
    effect: Mapping[str, str] = field(default_factory=dict)
    unsupported: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    contacts: tuple[str, ...] = ()
    lumped: bool = False
    read: Mapping[str, int] = field(default_factory=dict)
    source: str = ""
    included: tuple[str, ...] = ()
    origin: Mapping[str, Origin] = field(default_factory=dict)

    @property
    def properties(self) -> dict[str, Any]:
        """The fields of `Properties`, for another mesh of the same regions."""
        return {entry.name: getattr(self, entry.name) for entry in fields(Properties)}

    @property
    def connectivity(self) -> tuple[IntArray, ...]:
        """Nodes (e, k) of the elements of every block of solids, shells and beams."""
        return tuple(block.nodes for block in self.elements)

    @property
    def elements(self) -> tuple[CellBlock | ShellBlock | BeamBlock, ...]:
        """Blocks of all elements: solids, shells, beams."""
        return (*self.blocks, *self.thin)

    @property
    def thin(self) -> tuple[ShellBlock | BeamBlock, ...]:
        """Blocks of shells and beams."""
        return (*self.shells, *self.beams)

    def of_kind(self, kind: str) -> tuple[CellBlock | ShellBlock | BeamBlock, ...]:
        """Blocks of "solids", "shells" or "beams"."""
        if kind == "solids":
            return self.blocks
        return self.shells if kind == "shells" else self.beams

    @property
    def thin_nodes(self) -> IntArray:
        """Indices of the nodes of shells and beams, ascending."""
        return np.unique(concatenate(block.nodes.ravel() for block in self.thin))

    @property
    def nodes_of_elements(self) -> IntArray:
        """Indices of the nodes that an element has, ascending."""
        return np.unique(concatenate(nodes.ravel() for nodes in self.connectivity))

    @property
    def ties(self) -> tuple[RigidElement | AveragingElement, ...]:
        """Rigid and averaging elements."""
        return (*self.rigid, *self.averaging)

    @property
    def has_surface(self) -> bool:
        """Whether there is a surface to bond gauges on: solids, shells or sides of beams."""
        return bool(self.blocks or self.shells or any((block.on_sides >= 0).any() for block in self.beams))

    @property
    def own_nodes(self) -> int:
        """Number of nodes of the file; nodes on faces of shells follow them."""
        return len(self.position) - len(self.arms)

    def above(self, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Selected nodes (n,), with the nodes on faces of shells that follow one of them."""
        extended = chosen.copy()
        extended[self.arms[chosen[self.arms[:, 1]], 0]] = True
        return extended

    @property
    def turning(self) -> IntArray:
        """Indices of the nodes whose elements resist rotations: those of shells, and of beams other than rods."""
        return nodes_that_turn(self.shells, self.beams)

    @property
    def turned_by_springs(self) -> IntArray:
        """Indices of the nodes whose rotations springs resist, except those of solids and rods without clamped rotations."""
        nodes = np.unique(concatenate(springs.turned for springs in self.springs))
        still = np.setdiff1d(self.nodes_of_elements, self.fixed[self.fixed[:, 1] > 2, 0])
        return np.setdiff1d(nodes, np.setdiff1d(still, self.turning))

    @property
    def held(self) -> IntArray:
        """(k,) rows of the supported nodes: a translation is clamped, or a rotation (not at nodes of solids and rods only)."""
        still = np.zeros(len(self.position), dtype=bool)
        still[self.nodes_of_elements] = True
        still[self.turning] = False
        node, component = self.fixed.reshape(-1, 2).T
        return np.unique(node[(component < 3) | ~still[node]])

    def node_index(self, node_id: int) -> int:
        """Index of the node with this id of the file. Raises UserError if it does not exist."""
        hits = np.flatnonzero(self.node_ids == node_id)
        if hits.size == 0:
            raise UserError(f"the mesh has no node {node_id}", remedy="Use a node id of the mesh file.")
        return int(hits[0])

    def where(self, kind: str, number: int) -> str | None:
        """file:line of the node, element or tie with this id; None if the file has no lines."""
        origin = self.origin.get(kind)
        hits = np.flatnonzero(origin.ids == number) if origin else np.zeros(0)
        return f"{origin.files[origin.file[hits[0]]]}:{origin.line[hits[0]]}" if origin and hits.size else None

    @contextmanager
    def located(self) -> Iterator[None]:
        """Add the line of the entity, or the file, to errors that name an entity of this mesh."""
        try:
            yield
        except DeckError as error:
            if error.where is None and error.entity:
                error.where = self.where(*error.entity) or self.source or None
            raise
