"""Ties of an Abaqus deck: rigid bodies, couplings, multi-point constraints, tied surfaces, and the cut faces of a sector."""

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
    """Rigid and averaging elements, numbered together from 1, and where each stands; rotations: see `Supports.pairs`; axes: row
    of a node → its *TRANSFORM; ignored: what is not supported is counted there."""

    surfaces: Surfaces
    axes: Mapping[int, FloatArray]
    ignored: Counter[str]
    rigid: list[RigidElement] = field(default_factory=list)
    averaging: list[AveragingElement] = field(default_factory=list)
    where: list[tuple[str, int]] = field(default_factory=list)
    rotations: dict[int, int] = field(default_factory=dict)

    def number(self, at: Keyword | Row) -> int:
        """The next id, noted with its line."""
        self.where.append(
            (at.keyword.files[at.i], at.keyword.numbers[at.i]) if isinstance(at, Row) else (at.file, at.line)
        )
        return len(self.where)

    def reference(self, scope: Scope, keyword: Keyword, parameter: str = "REF NODE") -> int:
        """The node that a parameter names; DeckError where it is not one."""
        rows = self.surfaces.assembly.node_rows(keyword.needs(parameter), scope, keyword)
        if len(rows) != 1:
            raise keyword.error(
                f"{parameter}={keyword.parameters[parameter.replace(' ', '')]} holds {len(rows)} nodes", "give one node"
            )
        return int(rows[0])

    def add_rigid(self, at: Keyword | Row, reference: int, nodes: IntArray, components: tuple[int, ...]) -> None:
        """One rigid element more."""
        name = at.keyword.title if isinstance(at, Row) else at.title
        self.rigid.append(RigidElement(self.number(at), reference, nodes, components, name))

    def check_axes(self, at: Keyword | Row, nodes: IntArray, components: tuple[int, ...]) -> None:
        """Abaqus means basic axes here, `Mesh` those of the node: they agree where all three components are tied, or none."""
        turned = next((node for node in nodes.tolist() if node in self.axes), None)
        if turned is not None and _single(components):
            raise at.error(
                f"ties single components of node {self.surfaces.assembly.node_ids[turned]}, which has axes of its own "
                "(*TRANSFORM)",
                "tie all three components, or take the node out of the *TRANSFORM",
            )

    def add_kinematic_coupling(self, scope: Scope, keyword: Keyword) -> None:
        reference = self.reference(scope, keyword)
        for row in keyword.rows():
            nodes = _without(self.surfaces.assembly.node_rows(row.text(0), scope, row), reference, row)
            components = component_range([row], 1)
            _check_orientation(keyword, row, components)
            self.check_axes(row, nodes, components)
            self.add_rigid(row, reference, nodes, components)

    def add_rigid_body(self, scope: Scope, keyword: Keyword) -> None:
        assembly, given = self.surfaces.assembly, keyword.parameters
        tied, pinned = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
        for parameter, members in (("TIENSET", tied), ("NSET", tied), ("PINNSET", pinned)):
            if given.get(parameter):
                members.append(assembly.node_set(given[parameter], scope, keyword))
        if given.get("ELSET"):
            tied.append(assembly.element_nodes(assembly.element_set(given["ELSET"], scope, keyword)))
        every = np.concatenate([*tied, *pinned])
        if given.get("REFNODE") or not every.size:
            reference = self.reference(scope, keyword)
        else:
            # CalculiX adds a node that nothing else can name: the body moves alike, whichever node of it leads
            reference = int(every[0])
            assembly.notes.append(
                f"{keyword.where}: *RIGID BODY without REF NODE is led by its first node, {assembly.node_ids[reference]}"
            )
        if given.get("ROTNODE"):
            turning = self.reference(scope, keyword, "ROT NODE")
            if not np.allclose(self.axes.get(turning, np.eye(3)), self.axes.get(reference, np.eye(3))):
                raise keyword.error("REF NODE and ROT NODE have different axes (*TRANSFORM)", "give both the same ones")
            self.rotations[turning] = reference
        if given.get("POSITION", "INPUT").upper() != "INPUT":
            assembly.notes.append(f"{keyword.where}: *RIGID BODY keeps the place of its reference node")
        whole = np.unique(np.concatenate(tied))
        points = np.setdiff1d(np.concatenate(pinned), whole)
        _without(np.concatenate([whole, points]), reference, keyword)
        for nodes, components in ((whole, SIX), (points, TRANSLATIONS)):
            if (nodes := nodes[nodes != reference]).size:
                self.add_rigid(keyword, reference, nodes, components)

    def add_coupling(self, scope: Scope, keyword: Keyword, following: Sequence[Keyword]) -> None:
        assembly = self.surfaces.assembly
        if not following or following[0].name not in ("KINEMATIC", "DISTRIBUTING"):
            raise keyword.error("neither *KINEMATIC nor *DISTRIBUTING follows", "add the one that is meant")
        kind = following[0]
        reference = self.reference(scope, keyword)
        surface = self.surfaces.find(keyword.needs("SURFACE"), scope, keyword)
        radius = keyword.number("INFLUENCE RADIUS", np.inf, "give a radius")
        keep = np.linalg.norm(assembly.position[surface.nodes] - assembly.position[reference], axis=1) <= radius
        keep &= surface.nodes != reference
        nodes = _without(surface.nodes[keep], reference, keyword)
        components = component_range(kind.rows(needed=False), 0)
        _check_orientation(keyword, keyword, components)
        if kind.name == "KINEMATIC":
            self.check_axes(keyword, nodes, components)
            self.add_rigid(keyword, reference, nodes, components)
            return
        method = kind.word("WEIGHTINGMETHOD", "UNIFORM")
        if method != "UNIFORM":
            assembly.notes.append(f"{kind.where}: *DISTRIBUTING with WEIGHTING METHOD={method} taken as UNIFORM")
        if kind.word("COUPLING", "CONTINUUM") != "CONTINUUM":
            assembly.notes.append(f"{kind.where}: *DISTRIBUTING averages displacements only (COUPLING=CONTINUUM)")
        components = tuple(sorted({*components, *TRANSLATIONS}))
        self.check_axes(keyword, np.array([reference]), components)
        self.averaging.append(
            AveragingElement(
                self.number(keyword), reference, nodes, surface.weight[keep], components, name=keyword.title
            )
        )

    def add_multi_point(self, scope: Scope, row: Row) -> None:
        """BEAM: the first entry, a node or a set, follows the second, one node; TIE and PIN likewise, PIN in translations only,
        where all are at the same place. What has other entries or is of another type is counted."""
        assembly, kind = self.surfaces.assembly, row.text(0).upper()
        members = [entry for entry in row.tokens[1:] if entry]
        nodes = reference = NOTHING
        if kind in ("BEAM", "TIE", "PIN") and len(members) == 2:
            nodes, reference = (assembly.node_rows(entry, scope, row) for entry in members)
        apart = assembly.position[nodes] - assembly.position[reference[:1]] if len(reference) == 1 else np.zeros((0, 3))
        size = float(np.ptp(assembly.position, axis=0).max())
        if len(reference) != 1 or (kind != "BEAM" and np.linalg.norm(apart, axis=1).max(initial=0.0) > 1e-9 * size):
            self.ignored[f"*MPC {kind}"] += 1
            return
        nodes = _without(nodes, int(reference[0]), row)
        self.add_rigid(row, int(reference[0]), nodes, TRANSLATIONS if kind == "PIN" else SIX)


def ties(surfaces: Surfaces, axes: Mapping[int, FloatArray], ignored: Counter[str]) -> Ties:
    """*RIGID BODY, *COUPLING with *KINEMATIC or *DISTRIBUTING, *KINEMATIC COUPLING and *MPC of types BEAM, TIE and PIN.

    Raises DeckError for references that are not one node, sets and surfaces that are not there, and single components of
    nodes with axes of their own or along an ORIENTATION.
    """
    made = Ties(surfaces, axes, ignored)
    for scope in surfaces.assembly.scopes.values():
        keywords = scope.part.keywords
        for i, keyword in enumerate(keywords):
            match keyword.name:
                case "RIGIDBODY":
                    made.add_rigid_body(scope, keyword)
                case "COUPLING":
                    made.add_coupling(scope, keyword, keywords[i + 1 : i + 2])
                case "KINEMATICCOUPLING":
                    made.add_kinematic_coupling(scope, keyword)
                case "MPC" if "USER" in keyword.parameters:
                    ignored["*MPC, USER"] += len(keyword.rows())
                case "MPC" if keyword.word("MODE") == "DOF":
                    ignored["*MPC, MODE=DOF"] += len(keyword.rows())
                case "MPC":
                    for row in keyword.rows():
                        made.add_multi_point(scope, row)
    return made


def _without(nodes: IntArray, reference: int, at: Keyword | Row) -> IntArray:
    rest = nodes[nodes != reference]
    if not rest.size:
        raise at.error("holds no node beside its reference node", "give the nodes that follow it")
    return rest


def _check_orientation(keyword: Keyword, at: Keyword | Row, components: tuple[int, ...]) -> None:
    """The axes of an ORIENTATION do not matter where all three components are tied, or none."""
    if keyword.parameters.get("ORIENTATION") and _single(components):
        raise at.error("single components along an ORIENTATION", "tie all three components, or basic ones")


def _single(components: tuple[int, ...]) -> bool:
    """Are some, but not all, of the translations tied, or of the rotations?"""
    return any(sum(c // 3 == kind for c in components) in (1, 2) for kind in (0, 1))


PLAIN = {"NAME", "ADJUST", "POSITIONTOLERANCE", "TYPE", "NOROTATION", "CONSTRAINTRATIO", "TIEDNSET", "INPUT"}
"""Options of a *TIE that joins two surfaces; others make it a symmetry, or a tie of something else."""
TOLERANCE = 0.05
"""Of the mean size of the facets: how far off nodes may lie where the deck does not say (Abaqus; CalculiX: 0.025)."""


SECTOR = "CYCLICSYMMETRYMODEL"
"""The name of the keyword that makes a deck a sector."""
OF_THIN, OTHER = "*TIE that joins shells or beams", "*TIE that is a symmetry"
"""What a *TIE that is not supported is called, so that `mesh.ignore` can name it and keep the others."""


def cyclic_ties(assembly: Assembly) -> list[tuple[Scope, Keyword]]:
    """The *TIE of cut faces, in a deck that is a sector."""
    if not any(True for _ in assembly.keywords(SECTOR)):
        return []
    return [pair for pair in assembly.keywords("TIE") if "CYCLICSYMMETRY" in pair[1].parameters]


def with_tied_surfaces(mesh: Mesh, surfaces: Surfaces) -> tuple[Mesh, dict[str, list[str]]]:
    """A mesh in which the nodes of the first surface of each *TIE follow the second, see `with_surface_tie`; nodes that lie
    farther off than POSITION TOLERANCE, or than `TOLERANCE` of a facet, are left out, with a note, as in Abaqus and CalculiX.

    Beside it the *TIE that are not supported, `OTHER` and, where nodes of the first one turn (shells, beams) or the second one is
    not of solids, `OF_THIN` → file:line of each.
    Raises DeckError for surfaces that are not in the deck, and where no node of the first lies on the second.
    """
    assembly, cyclic = surfaces.assembly, [keyword for _, keyword in cyclic_ties(surfaces.assembly)]
    refused: dict[str, list[str]] = {}
    for scope, keyword in assembly.keywords("TIE"):
        if not set(keyword.parameters) <= PLAIN:
            refused.setdefault(OTHER, []).extend([] if keyword in cyclic else [keyword.where])
            continue
        for row in keyword.rows():
            first, second = (surfaces.find(row.text(i), scope, row) for i in (0, 1))
            size = facet_size(mesh, first, second)
            if size is None:
                refused.setdefault(OF_THIN, []).append(row.where)
                continue
            within = keyword.number("POSITION TOLERANCE", TOLERANCE * size, "give a distance")
            name = f"*TIE {keyword.parameters.get('NAME', '')}".strip()
            try:
                mesh, tied = following(mesh, row, first.nodes, second.nodes, within, name)
            except UserError as error:
                raise row.error(error.what, error.remedy or "") from None
            left = len(np.setdiff1d(first.nodes, second.nodes)) - tied
            said = f"{row.where}: {tied} nodes of {first.name} follow {second.name} ({name})"
            if left:
                off = f"{left} of {tied + left} others lie more than {within:.3g} off, and are not tied"
                ways = "give *TIE a larger POSITION TOLERANCE, or tie them in the config (mesh.ties, type: surface)"
                said = Doubt(f"{said}; {off}: {ways}")
            assembly.notes.append(said)
    return mesh, {card: where for card, where in refused.items() if where}


def facet_size(mesh: Mesh, first: Surface, second: Surface) -> float | None:
    """The mean size of the facets of the second surface; None where it is not of solids, or nodes of the first one turn."""
    turning = nodes_that_turn(mesh.shells, mesh.beams)
    solid = [nodes for _, nodes in second.facets if not np.isin(nodes, turning).any()]
    if not solid or len(solid) < len(second.facets) or np.isin(first.nodes, turning).any():
        return None
    corners = [mesh.position[nodes].mean(axis=1, keepdims=True) - mesh.position[nodes] for nodes in solid]
    return 2 * float(np.mean(np.concatenate([np.linalg.norm(own, axis=2).max(axis=1) for own in corners])))


def following(mesh: Mesh, row: Row, nodes: IntArray, onto: IntArray, within: float, name: str) -> tuple[Mesh, int]:
    """The mesh whose nodes (k,) follow the facets of nodes (m,) where they are within reach, by relations that stand at the
    row, and how many do. Raises UserError where none is."""
    before = len(mesh.relations)
    mesh = with_surface_tie(mesh, nodes, onto, within, name, far="left")
    made, origin = len(mesh.relations) - before, mesh.origin["relation"]
    file = row.keyword.files[row.i]
    files = origin.files if file in origin.files else (*origin.files, file)
    more = Origin(
        np.arange(1, before + made + 1),
        np.append(origin.line, np.full(made, row.keyword.numbers[row.i])),
        np.append(origin.file, np.full(made, files.index(file))),
        files,
    )
    return replace(mesh, origin={**mesh.origin, "relation": more}), made // 3


def with_whole_ring(mesh: Mesh, surfaces: Surfaces) -> tuple[Mesh, Surfaces]:
    """The mesh, and its surfaces, of the whole ring where the deck is a sector, see `whole_ring`, and a note on it: N of *CYCLIC
    SYMMETRY MODEL, its axis, and the cut faces of the *TIE, CYCLIC SYMMETRY. Nodes of the first of these that meet none of the
    second follow its facets.

    Faces of a model with CONTACT press on those of the next sector, as their *CONTACT PAIR says, and are no cut. Raises DeckError
    for sectors of several numbers or axes (multistage), and for what `whole_ring` refuses.
    """
    assembly = surfaces.assembly
    models = list(assembly.keywords(SECTOR))
    if not models:
        return mesh, surfaces
    first = models[0][1]
    count, axis = _of(first)
    for _, keyword in models[1:]:
        if _of(keyword)[0] != count or not np.allclose(_of(keyword)[1], axis):
            raise keyword.error(
                f"sectors of another number or axis than those of {first.where}",
                "a structure of several stages is not made whole: mesh all of it",
            )
    touching = {k.word("TIE") for _, k in models if "CONTACT" in k.parameters}
    ties = [(s, tie) for s, tie in cyclic_ties(assembly) if tie.word("NAME") not in touching]
    cuts = [(row, *_cut(row, scope, surfaces)) for scope, tie in ties for row in tie.rows()]
    if not cuts:
        raise first.error("no *TIE, CYCLIC SYMMETRY has its cut faces", "add it, with the two surfaces")
    a, b = axis.reshape(2, 3)
    try:
        ring = whole_ring(mesh, count, a, b - a, [(one.nodes, other.nodes) for _, one, other in cuts])
    except UserError as error:
        raise first.error(error.what, error.remedy or "") from None
    made = _with_loose(ring, cuts, assembly)
    whole = {key: _whole(surface, ring.at) for key, surface in surfaces.by_name.items()}
    n = len(mesh.position)
    loose = sum(len(own) for own, _ in ring.loose)
    met = count * n - len(ring.mesh.position)
    own = [region.name for number, region in mesh.regions.items() if number + ring.shift in ring.mesh.regions]
    assembly.notes.append(
        f"{first.where}: the sector is made a whole ring of {count}: {len(ring.mesh.position)} nodes, ids of copy j are those of "
        f"the sector + j × {ring.shift}; {met} nodes of cut faces and the axis became others"
        + f", {loose} follow the facets of the opposite face" * bool(loose)
        + (f"; {', '.join(own)}, whose axes turn: a region in each, as '{own[0]} (sector 2)'" if own else "")
        + "; sets and loads are on every copy, SECTOR-1, SECTOR-2, … have one each"
    )
    return made, replace(surfaces, by_name=whole)


def _of(keyword: Keyword) -> tuple[int, np.ndarray]:
    """The number of sectors, and two points (6,) on the axis."""
    count = parse_integer(keyword.needs("N"))
    if count is None or count < 2:
        raise keyword.error(f"N is {keyword.parameters['N']!r}, no number of sectors", "give an integer above 1")
    axis = keyword.rows()[0].reals(6, "a coordinate")
    if np.allclose(axis[:3], axis[3:]):
        raise keyword.error("the two points of its axis are one", "give two points on the axis")
    return count, axis


def _cut(row: Row, scope: Scope, surfaces: Surfaces) -> tuple[Surface, Surface]:
    one, other = (surfaces.find(row.text(i), scope, row) for i in (0, 1))
    if not len(one.nodes) or not len(other.nodes):
        raise row.error("a cut face has no nodes", "correct the surface")
    return one, other


def _with_loose(ring: Ring, cuts: list[tuple[Row, Surface, Surface]], assembly: Assembly) -> Mesh:
    """The ring, with nodes of cut faces that meet no other node following the facets there."""
    mesh = ring.mesh
    for (row, _, other), (nodes, onto) in zip(cuts, ring.loose, strict=True):
        if not len(nodes):
            continue
        spacing = np.asarray(cKDTree(mesh.position[onto]).query(mesh.position[onto], k=2)[0])[:, 1].mean()
        within = row.keyword.number("POSITION TOLERANCE", 2 * TOLERANCE * float(spacing), "give a distance")
        try:
            mesh, tied = following(mesh, row, nodes, onto, within, "*TIE, CYCLIC SYMMETRY")
        except UserError as error:
            raise row.error(error.what, error.remedy or "") from None
        if tied < len(nodes):
            off = (
                f"{len(nodes) - tied} nodes of cut faces lie more than {within:.3g} off {other.name} of the next sector"
            )
            assembly.notes.append(
                Doubt(f"{row.where}: {off}, and are free: check the number of sectors, and the mesh there")
            )
    return mesh


def _whole(surface: Surface, at: IntArray) -> Surface:
    """A surface on every copy."""
    nodes, first = np.unique(at[:, surface.nodes], return_index=True)
    weight = np.tile(surface.weight, len(at))[first]
    facets = tuple((kind, np.concatenate([own[rows] for own in at])) for kind, rows in surface.facets)
    return replace(surface, nodes=nodes, weight=weight, facets=facets)
