"""Surfaces of an Abaqus deck as nodes, each with its share of the area."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.text import Keyword, Row
from strainsight.decks.text import parse_integer
from strainsight.mesh.facets import OUTWARD, Facets, by_kind, exterior_facets
from strainsight.mesh.kinds import ELEMENTS, FACETS
from strainsight.mesh.kinds.kind import Kind
from strainsight.mesh.model import CellBlock, FloatArray, IntArray, Mesh
from strainsight.mesh.projection import area_vector
from strainsight.mesh.thin import concatenate


@dataclass(frozen=True)
class Surface:
    """name as in the file; scope of its definition; nodes (k,) rows, sorted; weight (k,): share of the area of the
    facets, or the area of each node in the file, 1 by default; facets: kind and nodes (f, k) rows, normal outward,
    empty for a node surface; sideless: contains shells without side, or shell edges."""

    name: str
    scope: Scope
    nodes: IntArray
    weight: FloatArray
    facets: tuple[tuple[Kind, IntArray], ...] = ()
    sideless: bool = False


SIDES = {"SPOS": 1, "S2": 1, "SNEG": -1, "S1": -1}
"""Label → ±1 times the normal of a shell, S1 and S2 as in CalculiX."""
EDGES = {f"E{i}": i - 1 for i in range(1, 5)} | {f"S{i}": i - 3 for i in range(3, 7)}
"""Label → edge of a shell that starts at its node of this position, E1 to E4 of Abaqus, S3 to S6 of CalculiX."""
SHELL_LABELS = "use SPOS or SNEG for a side, and E1 to E4 (triangles: E1 to E3) for an edge"
OF_NODES = {len(kind.nodes): kind for kind in FACETS if not len(kind.read_at)}


@dataclass(frozen=True)
class Surfaces:
    """The surfaces of a deck; by_name: (INSTANCE, NAME) → surface."""

    assembly: Assembly
    by_name: dict[tuple[str, str], Surface]

    def find(self, entry: str, scope: Scope, by: Keyword | Row) -> Surface:
        """The surface that an entry names; DeckError if it does not exist."""
        within, name = self.assembly.split_name(entry, scope)
        if (surface := self.by_name.get((within.name.upper(), name.upper()))) is None:
            raise by.error(
                f"surface {entry!r} is not in the deck, or has an unsupported type",
                "correct the name, or define the surface by *SURFACE with TYPE=ELEMENT or NODE",
            )
        return surface


def cell_blocks(assembly: Assembly, region: IntArray) -> tuple[CellBlock, ...]:
    """Solids by kind: their ids, nodes (rows) and region."""
    blocks = []
    for i, kind in enumerate(ELEMENTS):
        if (rows := np.flatnonzero(assembly.kind == i)).size:
            nodes = assembly.connectivity(rows, range(len(kind.nodes)))
            blocks.append(CellBlock(kind.name, assembly.element_ids[rows], nodes, region[rows]))
    return tuple(blocks)


def surfaces(assembly: Assembly, mesh: Mesh, ignored: Counter[str]) -> Surfaces:
    """Surfaces of *SURFACE with TYPE=ELEMENT (S1 to S6 or the exterior facets of solids; SPOS, SNEG, edges or both
    sides of shells) and TYPE=NODE.

    Facets of other elements are left out, with a note for beams; other types are counted. The area of a facet and the length of
    an edge are shared equally among their nodes. Raises DeckError for missing sets and for invalid facet numbers."""
    gathered: dict[tuple[str, str], _Parts] = {}
    outside: Facets | None = None
    family = assembly.families
    for scope, keyword in assembly.keywords("SURFACE"):
        kind = keyword.word("TYPE", "ELEMENT")
        if kind not in ("ELEMENT", "NODE") or "COMBINE" in keyword.parameters or "CROP" in keyword.parameters:
            ignored[f"*SURFACE, {'TYPE=' + kind if kind not in ('ELEMENT', 'NODE') else 'COMBINE'}"] += 1
            continue
        name = keyword.needs("NAME")
        parts = gathered.setdefault((scope.name.upper(), name.upper()), _Parts(name, scope))
        if not keyword.texts:
            assembly.notes.append(f"{keyword.where}: surface {name} has no data lines, so it is empty")
        for row in keyword.rows(needed=False):
            if kind == "NODE":
                nodes = assembly.rows("NODE", row.text(0), scope, row)
                parts.shares.append((nodes, np.full(len(nodes), row.real(1, "the area", 1.0))))
                continue
            rows = assembly.rows("ELEMENT", row.text(0), scope, row)
            if np.isin(family[rows], ("beam", "rod")).any():
                assembly.notes.append(f"{row.where}: beams and trusses are left out of surface {name} (no facets)")
            solids, label = rows[family[rows] == "solid"], row.text(1).upper()
            if label:
                number = parse_integer(label[1:]) if label.startswith("S") else None
                pairs = facets_of(assembly, solids, number, row, "S")
            elif solids.size:
                with mesh.located():
                    outside = exterior_facets(mesh) if outside is None else outside
                facets = outside.some(np.isin(outside.element_id, assembly.element_ids[solids]))
                pairs = [(kind_of_facet, nodes) for kind_of_facet, _, nodes in by_kind(facets.kind, facets.nodes)]
            else:
                pairs = []
            sides, lines = _of_shells(assembly, row, rows[family[rows] == "shell"])
            parts.shares += [_shares(assembly, facet, nodes) for facet, nodes in pairs + sides] + lines
            parts.facets += pairs + sides if label else pairs
            parts.sideless |= bool(lines or (sides and not label))
    return Surfaces(assembly, {key: parts.surface() for key, parts in gathered.items()})


@dataclass
class _Parts:
    """Lines of a surface, see `Surface`; shares: nodes and the area of each."""

    name: str
    scope: Scope
    shares: list[tuple[IntArray, FloatArray]] = field(default_factory=list)
    facets: list[tuple[Kind, IntArray]] = field(default_factory=list)
    sideless: bool = False

    def surface(self) -> Surface:
        nodes = concatenate(nodes for nodes, _ in self.shares)
        weight = np.concatenate([np.zeros(0), *(weight for _, weight in self.shares)])
        rows, place = np.unique(nodes, return_inverse=True)
        share = np.bincount(place, weight, minlength=len(rows)).astype(float)
        return Surface(self.name, self.scope, rows, share, tuple(self.facets), self.sideless)


def _of_shells(
    assembly: Assembly, row: Row, rows: IntArray
) -> tuple[list[tuple[Kind, IntArray]], list[tuple[IntArray, FloatArray]]]:
    """Sides of the shells in rows, kind and nodes (f, k), or the nodes of their edges and their shares."""
    label = row.text(1).upper()
    if not rows.size:
        return [], []
    if label and label not in SIDES and label not in EDGES:
        raise row.error(f"{row.text(1)!r} is not a side or edge of {assembly.element(int(rows[0]))}", SHELL_LABELS)
    facets = shell_facets(assembly, rows)
    if label not in EDGES:
        return [
            (kind, nodes if SIDES.get(label, 1) > 0 else nodes[:, OUTWARD[nodes.shape[1]]]) for kind, nodes in facets
        ], []
    lines = []
    for kind, nodes in facets:
        if not EDGES[label] < kind.corners:
            raise row.error(f"{row.text(1)!r} is not an edge of a shell with {kind.corners} corners", SHELL_LABELS)
        ends = np.take(nodes[:, : kind.corners], [EDGES[label], EDGES[label] + 1], axis=1, mode="wrap")
        length = np.linalg.norm(np.diff(assembly.position[ends], axis=1)[:, 0], axis=1)
        if kind.edges:
            edge = np.column_stack([ends, nodes[:, kind.corners + EDGES[label]]])
            lines.append((edge.ravel(), np.repeat(length / 3, 3)))
        else:
            lines.append((ends.ravel(), np.repeat(length / 2, 2)))
    return [], lines


def shell_facets(assembly: Assembly, rows: IntArray) -> list[tuple[Kind, IntArray]]:
    """Shells in rows as facets with their normal: kind and nodes (f, k)."""
    count = assembly.first[rows + 1] - assembly.first[rows]
    return [(OF_NODES[k], assembly.connectivity(rows[count == k], range(k))) for k in np.unique(count).tolist()]


def facets_of(
    assembly: Assembly, rows: IntArray, number: int | None, row: Row, letter: str
) -> list[tuple[Kind, IntArray]]:
    """Facet 1, 2, … of the solids in rows: kind and nodes (f, k); DeckError if an element has no such facet."""
    facets_by_kind = []
    for i in np.unique(assembly.kind[rows]):
        facets = ELEMENTS[i].facets
        if number is None or not 1 <= number <= len(facets):
            raise row.error(
                f"{row.text(1)!r} is not a facet of a {ELEMENTS[i].name}",
                f"use {letter}1 to {letter}{len(facets)}" + ", or leave the entry blank" * (letter == "S"),
            )
        kind, local = facets[number - 1]
        facets_by_kind.append((kind, assembly.connectivity(rows[assembly.kind[rows] == i], local)))
    return facets_by_kind


def _shares(assembly: Assembly, kind: Kind, nodes: IntArray) -> tuple[IntArray, FloatArray]:
    """Each node of facets (f, k) with 1/k of the area between the facet's corners."""
    area = 0.5 * np.linalg.norm(area_vector(assembly.position[nodes[:, : kind.corners]]), axis=1)
    return nodes.ravel(), np.repeat(area / nodes.shape[1], nodes.shape[1])
