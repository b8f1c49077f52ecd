"""Ties of an Abaqus deck: rigid bodies, couplings, multi-point constraints, tied surfaces, and cyclic symmetry."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.supports import component_range
from strainsight.decks.abaqus.surfaces import Surface, Surfaces
from strainsight.decks.abaqus.text import Keyword, Row
from strainsight.decks.faults import Doubt
from strainsight.decks.text import parse_integer
from strainsight.errors import UserError
from strainsight.mesh.cyclic import Ring, whole_ring
from strainsight.mesh.joins import AveragingElement, RigidElement
from strainsight.mesh.model import FloatArray, IntArray, Mesh, Origin
from strainsight.mesh.surface_ties import with_surface_tie
from strainsight.mesh.thin import nodes_that_turn

SIX = (0, 1, 2, 3, 4, 5)
TRANSLATIONS = (0, 1, 2)
NOTHING = np.zeros(0, dtype=np.int64)


@dataclass
class Ties:
    """Rigid and averaging elements, numbered together from 1, and file and line of each; rotations: see
    `Supports.pairs`; axes: row of a node → its *TRANSFORM; ignored: counts unsupported ties."""

    surfaces: Surfaces
    axes: Mapping[int, FloatArray]
    ignored: Counter[str]
    rigid: list[RigidElement] = field(default_factory=list)
    averaging: list[AveragingElement] = field(default_factory=list)
    where: list[tuple[str, int]] = field(default_factory=list)
    rotations: dict[int, int] = field(default_factory=dict)

    def number(self, at: Keyword | Row) -> int:
        """The next id; stores its line."""
        self.where.append(
            (at.keyword.files[at.i], at.keyword.numbers[at.i]) if isinstance(at, Row) else (at.file, at.line)
        )
        return len(self.where)

    def reference(self, scope: Scope, keyword: Keyword, parameter: str = "REF NODE") -> int:
        """The node that a parameter names; DeckError if it is not exactly one."""
        rows = self.surfaces.assembly.rows("NODE", keyword.needs(parameter), scope, keyword)
        if len(rows) != 1:
            raise keyword.error(
                f"{parameter}={keyword.parameters[parameter.replace(' ', '')]} refers to {len(rows)} nodes instead of one",
                "specify exactly one node",
            )
        return int(rows[0])

    def add_rigid(self, at: Keyword | Row, reference: int, nodes: IntArray, components: tuple[int, ...]) -> None:
        """Add a rigid element."""
        name = at.keyword.title if isinstance(at, Row) else at.title
        self.rigid.append(RigidElement(self.number(at), reference, nodes, components, name))

    def check_axes(self, at: Keyword | Row, nodes: IntArray, components: tuple[int, ...]) -> None:
        """Raise DeckError if basic axes (Abaqus) and nodal axes (`Mesh`) differ; they agree if all three components
        are tied, or none."""
        turned = next((node for node in nodes.tolist() if node in self.axes), None)
        if turned is not None and _is_partial(components):
            raise at.error(
                f"only some components are tied at node {self.surfaces.assembly.node_ids[turned]}, which has nodal "
                "axes (*TRANSFORM)",
                "tie all three translations, all three rotations or both, or remove the node from the *TRANSFORM",
            )

    def add_kinematic_coupling(self, scope: Scope, keyword: Keyword) -> None:
        reference = self.reference(scope, keyword)
        for row in keyword.rows():
            nodes = _remove_reference(self.surfaces.assembly.rows("NODE", row.text(0), scope, row), reference, row)
            components = component_range([row], 1)
            _check_orientation(keyword, row, components)
            self.check_axes(row, nodes, components)
            self.add_rigid(row, reference, nodes, components)

    def add_rigid_body(self, scope: Scope, keyword: Keyword) -> None:
        assembly, parameters = self.surfaces.assembly, keyword.parameters
        tied, pinned = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
        for parameter, members in (("TIENSET", tied), ("NSET", tied), ("PINNSET", pinned)):
            if parameters.get(parameter):
                members.append(assembly.set_rows("NODE", parameters[parameter], scope, keyword))
        if parameters.get("ELSET"):
            tied.append(assembly.element_nodes(assembly.set_rows("ELEMENT", parameters["ELSET"], scope, keyword)))
        every = np.concatenate([*tied, *pinned])
        if parameters.get("REFNODE") or not every.size:
            reference = self.reference(scope, keyword)
        else:
            # CalculiX adds a node that no other keyword can name; any node of the body can lead it
            reference = int(every[0])
            assembly.notes.append(
                f"{keyword.where}: *RIGID BODY has no REF NODE, so its first node "
                f"{assembly.node_ids[reference]} is used"
            )
        if parameters.get("ROTNODE"):
            turning = self.reference(scope, keyword, "ROT NODE")
            if not np.allclose(self.axes.get(turning, np.eye(3)), self.axes.get(reference, np.eye(3))):
                raise keyword.error(
                    "REF NODE and ROT NODE have different axes (*TRANSFORM)", "use the same *TRANSFORM for both nodes"
                )
            self.rotations[turning] = reference
        if parameters.get("POSITION", "INPUT").upper() != "INPUT":
            assembly.notes.append(f"{keyword.where}: POSITION of *RIGID BODY has no effect")
        whole = np.unique(np.concatenate(tied))
        points = np.setdiff1d(np.concatenate(pinned), whole)
        _remove_reference(np.concatenate([whole, points]), reference, keyword)
        for nodes, components in ((whole, SIX), (points, TRANSLATIONS)):
            if (nodes := nodes[nodes != reference]).size:
                self.add_rigid(keyword, reference, nodes, components)

    def add_coupling(self, scope: Scope, keyword: Keyword, following: Sequence[Keyword]) -> None:
        assembly = self.surfaces.assembly
        if not following or following[0].name not in ("KINEMATIC", "DISTRIBUTING"):
            raise keyword.error(
                "*KINEMATIC or *DISTRIBUTING is missing after this keyword",
                "add *KINEMATIC or *DISTRIBUTING directly below this keyword",
            )
        kind = following[0]
        reference = self.reference(scope, keyword)
        surface = self.surfaces.find(keyword.needs("SURFACE"), scope, keyword)
        radius = keyword.number("INFLUENCE RADIUS", np.inf, "specify a radius")
        keep = np.linalg.norm(assembly.position[surface.nodes] - assembly.position[reference], axis=1) <= radius
        keep &= surface.nodes != reference
        nodes = _remove_reference(surface.nodes[keep], reference, keyword)
        components = component_range(kind.rows(needed=False), 0)
        _check_orientation(keyword, keyword, components)
        if kind.name == "KINEMATIC":
            self.check_axes(keyword, nodes, components)
            self.add_rigid(keyword, reference, nodes, components)
            return
        method = kind.word("WEIGHTINGMETHOD", "UNIFORM")
        if method != "UNIFORM":
            assembly.notes.append(f"{kind.where}: *DISTRIBUTING with WEIGHTING METHOD={method} is imported as UNIFORM")
        if kind.word("COUPLING", "CONTINUUM") != "CONTINUUM":
            assembly.notes.append(
                f"{kind.where}: *DISTRIBUTING is imported with COUPLING=CONTINUUM, which couples only displacements"
            )
        components = tuple(sorted({*components, *TRANSLATIONS}))
        self.check_axes(keyword, np.array([reference]), components)
        self.averaging.append(
            AveragingElement(
                self.number(keyword), reference, nodes, surface.weight[keep], components, name=keyword.title
            )
        )

    def add_multi_point(self, scope: Scope, row: Row) -> None:
        """BEAM: the first entry, a node or a set, follows the second, one node; TIE and PIN too (PIN only
        translations) if all nodes coincide. Other types and entries are counted."""
        assembly, kind = self.surfaces.assembly, row.text(0).upper()
        members = [entry for entry in row.tokens[1:] if entry]
        nodes = reference = NOTHING
        if kind in ("BEAM", "TIE", "PIN") and len(members) == 2:
            nodes, reference = (assembly.rows("NODE", entry, scope, row) for entry in members)
        distance = (
            assembly.position[nodes] - assembly.position[reference[:1]] if len(reference) == 1 else np.zeros((0, 3))
        )
        size = float(np.ptp(assembly.position, axis=0).max())
        if len(reference) != 1 or (kind != "BEAM" and np.linalg.norm(distance, axis=1).max(initial=0.0) > 1e-9 * size):
            self.ignored[f"*MPC {kind}"] += 1
            return
        nodes = _remove_reference(nodes, int(reference[0]), row)
        self.add_rigid(row, int(reference[0]), nodes, TRANSLATIONS if kind == "PIN" else SIX)


def ties(surfaces: Surfaces, axes: Mapping[int, FloatArray], ignored: Counter[str]) -> Ties:
    """*RIGID BODY, *COUPLING with *KINEMATIC or *DISTRIBUTING, *KINEMATIC COUPLING and *MPC of types BEAM, TIE and PIN.

    Raises DeckError for references that are not one node, missing sets and surfaces, and single components of nodes
    with nodal axes or along an ORIENTATION."""
    result = Ties(surfaces, axes, ignored)
    for scope in surfaces.assembly.scopes.values():
        keywords = scope.part.keywords
        for i, keyword in enumerate(keywords):
            match keyword.name:
                case "RIGIDBODY":
                    result.add_rigid_body(scope, keyword)
                case "COUPLING":
                    result.add_coupling(scope, keyword, keywords[i + 1 : i + 2])
                case "KINEMATICCOUPLING":
                    result.add_kinematic_coupling(scope, keyword)
                case "MPC" if "USER" in keyword.parameters:
                    ignored["*MPC, USER"] += len(keyword.rows())
                case "MPC" if keyword.word("MODE") == "DOF":
                    ignored["*MPC, MODE=DOF"] += len(keyword.rows())
                case "MPC":
                    for row in keyword.rows():
                        result.add_multi_point(scope, row)
    return result


def _remove_reference(nodes: IntArray, reference: int, at: Keyword | Row) -> IntArray:
    if not (rest := nodes[nodes != reference]).size:
        raise at.error("the only tied node is the reference node", "add the dependent nodes to the node set or surface")
    return rest


def _check_orientation(keyword: Keyword, at: Keyword | Row, components: tuple[int, ...]) -> None:
    """Raise DeckError for an ORIENTATION unless all three components are tied, or none."""
    if keyword.parameters.get("ORIENTATION") and _is_partial(components):
        raise at.error(
            "tying only some components along an ORIENTATION is not supported",
            "tie all three translations, all three rotations or both, or remove ORIENTATION",
        )


def _is_partial(components: tuple[int, ...]) -> bool:
    """Whether some, but not all, translations or rotations are tied."""
    return any(sum(c // 3 == kind for c in components) in (1, 2) for kind in (0, 1))


PLAIN = {"NAME", "ADJUST", "POSITIONTOLERANCE", "TYPE", "NOROTATION", "CONSTRAINTRATIO", "TIEDNSET", "INPUT"}
"""Options of a *TIE between two surfaces; other options make it a symmetry or a tie of other entities."""
TOLERANCE = 0.05
"""Default tie distance relative to the mean facet size (Abaqus; CalculiX: 0.025)."""


SECTOR = "CYCLICSYMMETRYMODEL"
"""Keyword of a cyclic sector."""
OF_THIN, OTHER = "*TIE that joins shells or beams", "*TIE that is a symmetry"
"""Names of unsupported kinds of *TIE, so that `mesh.ignore` can select them."""


def cyclic_ties(assembly: Assembly) -> list[tuple[Scope, Keyword]]:
    """The *TIE of the sector faces of a cyclic model."""
    if not any(True for _ in assembly.keywords(SECTOR)):
        return []
    return [pair for pair in assembly.keywords("TIE") if "CYCLICSYMMETRY" in pair[1].parameters]


def with_tied_surfaces(mesh: Mesh, surfaces: Surfaces) -> tuple[Mesh, dict[str, list[str]]]:
    """Mesh in which the nodes of the first surface of each *TIE follow the second, see `with_surface_tie`; nodes
    farther away than POSITION TOLERANCE or `TOLERANCE` of a facet are left out, with a note, as in Abaqus and CalculiX.

    Also returns unsupported *TIE → file:line of each: `OTHER`, and `OF_THIN` if shells or beams are involved. Raises
    DeckError for missing surfaces, and if no node of the first surface is on the second."""
    assembly, cyclic = surfaces.assembly, [keyword for _, keyword in cyclic_ties(surfaces.assembly)]
    refused: dict[str, list[str]] = {}
    for scope, keyword in assembly.keywords("TIE"):
        if not set(keyword.parameters) <= PLAIN:
            refused.setdefault(OTHER, []).extend([] if keyword in cyclic else [keyword.where])
            continue
        for row in keyword.rows():
            first, second = (surfaces.find(row.text(i), scope, row) for i in (0, 1))
            if (size := facet_size(mesh, first, second)) is None:
                refused.setdefault(OF_THIN, []).append(row.where)
                continue
            within = keyword.number("POSITION TOLERANCE", TOLERANCE * size, "specify a distance")
            tie = f"*TIE {keyword.parameters.get('NAME', '')}".strip()
            try:
                mesh, tied = following(mesh, row, first.nodes, second.nodes, within, tie)
            except UserError as error:
                raise row.error(error.what, error.remedy or "") from None
            count = len(np.setdiff1d(first.nodes, second.nodes))
            pair = f"surface {first.name} are tied to surface {second.name}"
            message = f"{row.where}: {tied} of {count} nodes of {pair} ({tie})"
            if tied < count:
                reach = f"{within:.3g} length units of the deck from {second.name}"
                off = f"the other nodes are not tied, because they are farther than {reach}"
                ways = "increase POSITION TOLERANCE of *TIE, or tie the nodes in the config (mesh.ties, type: surface)"
                message = Doubt(f"{message}; {off}: {ways}")
            assembly.notes.append(message)
    return mesh, {card: where for card, where in refused.items() if where}


def facet_size(mesh: Mesh, first: Surface, second: Surface) -> float | None:
    """Mean facet size of the second surface; None unless it consists of solids only and the nodes of the first have
    no rotations."""
    turning = nodes_that_turn(mesh.shells, mesh.beams)
    solid = [nodes for _, nodes in second.facets if not np.isin(nodes, turning).any()]
    if not solid or len(solid) < len(second.facets) or np.isin(first.nodes, turning).any():
        return None
    corners = [mesh.position[nodes].mean(axis=1, keepdims=True) - mesh.position[nodes] for nodes in solid]
    return 2 * float(np.mean(np.concatenate([np.linalg.norm(vectors, axis=2).max(axis=1) for vectors in corners])))


def following(mesh: Mesh, row: Row, nodes: IntArray, onto: IntArray, within: float, name: str) -> tuple[Mesh, int]:
    """Mesh whose nodes (k,) follow the facets of nodes (m,) within reach, by relations located at `row`, and the
    number of tied nodes. Raises UserError if no node is tied."""
    before = len(mesh.relations)
    mesh = with_surface_tie(mesh, nodes, onto, within, name, far="left")
    added, origin = len(mesh.relations) - before, mesh.origin["relation"]
    file = row.keyword.files[row.i]
    files = origin.files if file in origin.files else (*origin.files, file)
    more = Origin(
        np.arange(1, before + added + 1),
        np.append(origin.line, np.full(added, row.keyword.numbers[row.i])),
        np.append(origin.file, np.full(added, files.index(file))),
        files,
    )
    return replace(mesh, origin={**mesh.origin, "relation": more}), added // 3


def with_whole_ring(mesh: Mesh, surfaces: Surfaces) -> tuple[Mesh, Surfaces]:
    """Mesh and surfaces of the full ring if the deck is a cyclic sector, see `whole_ring`, with a note: N of *CYCLIC
    SYMMETRY MODEL, its axis, and the sector faces of *TIE, CYCLIC SYMMETRY. Nodes of the first face without a matching
    node follow facets of the second.

    Faces of a model with CONTACT press on those through their *CONTACT PAIR and are not sector
    faces. Raises DeckError for sectors of several numbers or axes (multistage), and for errors of `whole_ring`."""
    assembly = surfaces.assembly
    if not (models := list(assembly.keywords(SECTOR))):
        return mesh, surfaces
    first = models[0][1]
    count, axis = _sector_of(first)
    for _, keyword in models[1:]:
        if _sector_of(keyword)[0] != count or not np.allclose(_sector_of(keyword)[1], axis):
            raise keyword.error(
                f"the number of sectors or the symmetry axis differs from that at {first.where}",
                "mesh the full structure; multistage cyclic symmetry is not supported",
            )
    touching = {k.word("TIE") for _, k in models if "CONTACT" in k.parameters}
    ties = [(s, tie) for s, tie in cyclic_ties(assembly) if tie.word("NAME") not in touching]
    cuts = [(row, *_cut(row, scope, surfaces)) for scope, tie in ties for row in tie.rows()]
    if not cuts:
        raise first.error(
            "the *TIE, CYCLIC SYMMETRY of the sector faces is missing",
            "add a *TIE, CYCLIC SYMMETRY with the surfaces of the two sector faces",
        )
    a, b = axis.reshape(2, 3)
    try:
        ring = whole_ring(mesh, count, a, b - a, [(one.nodes, other.nodes) for _, one, other in cuts])
    except UserError as error:
        raise first.error(error.what, error.remedy or "") from None
    mesh_with_loose = _with_loose(ring, cuts, assembly)
    whole = {key: _copy_surface(surface, ring.at) for key, surface in surfaces.by_name.items()}
    n = len(mesh.position)
    loose = sum(len(nodes) for nodes, _ in ring.loose)
    merged = count * n - len(ring.mesh.position)
    names = [region.name for number, region in mesh.regions.items() if number + ring.shift in ring.mesh.regions]
    assembly.notes.append(
        f"{first.where}: the sector is expanded to a full ring of {count} sectors with {len(ring.mesh.position)} nodes. "
        f"Node and element ids of sector k are those of the sector in the deck + (k - 1) × {ring.shift}; "
        f"{merged} nodes on the sector faces and on the axis are merged"
        + f", {loose} are tied to facets of the opposite sector face" * bool(loose)
        + (f". Regions are copied to each sector, for example '{names[0]} (sector 2)'" if names else "")
        + ". Sets and loads of the deck apply to all sectors; the new sets SECTOR-1, SECTOR-2, … contain one sector each"
    )
    return mesh_with_loose, replace(surfaces, by_name=whole)


def _sector_of(keyword: Keyword) -> tuple[int, np.ndarray]:
    """Number of sectors, and two points (6,) on the axis."""
    count = parse_integer(keyword.needs("N"))
    if count is None or count < 2:
        raise keyword.error(f"the number of sectors N is {keyword.parameters['N']!r}", "specify an integer above 1")
    axis = keyword.rows()[0].reals(6, "a coordinate")
    if np.allclose(axis[:3], axis[3:]):
        raise keyword.error("the two points of the symmetry axis coincide", "specify two different points on the axis")
    return count, axis


def _cut(row: Row, scope: Scope, surfaces: Surfaces) -> tuple[Surface, Surface]:
    one, other = (surfaces.find(row.text(i), scope, row) for i in (0, 1))
    if not len(one.nodes) or not len(other.nodes):
        raise row.error(
            f"surface {(other if len(one.nodes) else one).name} of a sector face has no nodes",
            "in its *SURFACE, list the nodes or facets of the sector face",
        )
    return one, other


def _with_loose(ring: Ring, cuts: list[tuple[Row, Surface, Surface]], assembly: Assembly) -> Mesh:
    """Ring in which unmatched nodes of sector faces follow the facets of the opposite face."""
    mesh = ring.mesh
    for (row, _, other), (nodes, onto) in zip(cuts, ring.loose, strict=True):
        if not len(nodes):
            continue
        spacing = np.asarray(cKDTree(mesh.position[onto]).query(mesh.position[onto], k=2)[0])[:, 1].mean()
        within = row.keyword.number("POSITION TOLERANCE", 2 * TOLERANCE * float(spacing), "specify a distance")
        try:
            mesh, tied = following(mesh, row, nodes, onto, within, "*TIE, CYCLIC SYMMETRY")
        except UserError as error:
            raise row.error(error.what, error.remedy or "") from None
        if tied < len(nodes):
            off = (
                f"{len(nodes) - tied} of {len(nodes)} nodes of the sector face are not tied, because they are farther than "
                f"{within:.3g} length units of the deck from {other.name} of the next sector"
            )
            assembly.notes.append(
                Doubt(f"{row.where}: {off}: check the number of sectors N, and the mesh at the sector faces")
            )
    return mesh


def _copy_surface(surface: Surface, at: IntArray) -> Surface:
    """A surface on every copy of the sector."""
    nodes, first = np.unique(at[:, surface.nodes], return_index=True)
    weight = np.tile(surface.weight, len(at))[first]
    facets = tuple((kind, np.concatenate([copy_rows[rows] for copy_rows in at])) for kind, rows in surface.facets)
    return replace(surface, nodes=nodes, weight=weight, facets=facets)
