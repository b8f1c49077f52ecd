"""Surfaces of an Abaqus deck as nodes, each with its share of the area."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.text import Keyword, Row
from strainsight.decks.text import parse_integer
from strainsight.mesh.facets import OUTWARD, Facets, exterior_facets
from strainsight.mesh.kinds import ELEMENTS, FACETS
from strainsight.mesh.kinds.kind import Kind
from strainsight.mesh.model import CellBlock, FloatArray, IntArray, Mesh
from strainsight.mesh.projection import area_vector


@dataclass(frozen=True)
class Surface:
    """name as the file writes it; scope it is defined in; nodes (k,) rows, sorted; weight (k,): share of the area of the
    facets, or the area the file states for each node, 1 where it states none; facets: kind and nodes (f, k) rows, normal
    outward, none of a surface of nodes; sideless: it holds shells on neither side, or their edges."""

    name: str
    scope: Scope
    nodes: IntArray
    weight: FloatArray
    facets: tuple[tuple[Kind, IntArray], ...] = ()
    sideless: bool = False


SIDES = {"SPOS": 1, "S2": 1, "SNEG": -1, "S1": -1}
"""Label → ±1 times the normal of a shell, S1 and S2 as CalculiX has them."""
EDGES = {f"E{i}": i - 1 for i in range(1, 5)} | {f"S{i}": i - 3 for i in range(3, 7)}
"""Label → the edge of a shell from its node of this place, E1 to E4 of Abaqus, S3 to S6 of CalculiX."""
OF_NODES = {len(kind.nodes): kind for kind in FACETS if not len(kind.read_at)}


@dataclass
class _Builder:
    assembly: Assembly
    mesh: Mesh
    exterior: Facets | None = None


def cell_blocks(assembly: Assembly, region: IntArray) -> tuple[CellBlock, ...]:
    """Solids by kind: their ids, nodes (rows) and region."""
    blocks = []
    for i, kind in enumerate(ELEMENTS):
        rows = np.flatnonzero(assembly.kind == i)
        if rows.size:
            nodes = assembly.nodes[assembly.first[rows][:, None] + np.arange(len(kind.nodes))]
            blocks.append(CellBlock(kind.name, assembly.element_ids[rows], nodes, region[rows]))
    return tuple(blocks)


def surfaces(assembly: Assembly, mesh: Mesh, ignored: Counter[str]) -> dict[tuple[str, str], Surface]:
    """(INSTANCE, NAME) → surface, of *SURFACE with TYPE=ELEMENT (S1 to S6, or the facets outside, of solids; SPOS, SNEG, edges or
    both sides of shells) and TYPE=NODE.

    Facets of other elements are left out, of beams with a note; other types are counted. A facet's area is shared equally among
    its nodes, an edge's length likewise. Raises DeckError for sets that are not there and for facets that an element does not
    have.
    """
    builder = _Builder(assembly, mesh)
    gathered: dict[tuple[str, str], list[tuple[IntArray, FloatArray]]] = {}
    facets: dict[tuple[str, str], list[tuple[Kind, IntArray]]] = {}
    names: dict[tuple[str, str], tuple[str, Scope]] = {}
    sideless: set[tuple[str, str]] = set()
    family = assembly.families
    for scope, keyword in assembly.keywords("SURFACE"):
        kind = keyword.parameters.get("TYPE", "ELEMENT").upper()
        if kind not in ("ELEMENT", "NODE") or "COMBINE" in keyword.parameters or "CROP" in keyword.parameters:
            ignored[f"*SURFACE, {'TYPE=' + kind if kind not in ('ELEMENT', 'NODE') else 'COMBINE'}"] += 1
            continue
        key = (scope.name.upper(), keyword.needs("NAME").upper())
        names.setdefault(key, (keyword.parameters["NAME"], scope))
        own = gathered.setdefault(key, [])
        if not keyword.texts:
            assembly.notes.append(f"{keyword.where}: surface {keyword.parameters['NAME']} is empty")
        for row in keyword.rows(needed=False):
            if kind == "NODE":
                nodes = assembly.node_rows(row.text(0), scope, row)
                own.append((nodes, np.full(len(nodes), row.real(1, "the area", 1.0))))
            else:
                rows = assembly.element_rows(row.text(0), scope, row)
                if (family[rows] == "beam").any() or (family[rows] == "rod").any():
                    assembly.notes.append(
                        f"{row.where}: beams of surface {keyword.parameters['NAME']} are left out of it"
                    )
                pairs = _facets(builder, row, rows[family[rows] == "solid"])
                sides, lines = _of_shells(assembly, row, rows[family[rows] == "shell"])
                own += [_shares(assembly, facet, nodes) for facet, nodes in pairs + sides] + lines
                if row.text(1) or not sides:
                    facets.setdefault(key, []).extend(pairs + sides)
                else:
                    facets.setdefault(key, []).extend(pairs)
                if lines or (sides and not row.text(1)):
                    sideless.add(key)
    found = {}
    for key, parts in gathered.items():
        nodes = np.concatenate([np.zeros(0, dtype=np.int64), *(nodes for nodes, _ in parts)])
        weight = np.concatenate([np.zeros(0), *(weight for _, weight in parts)])
        rows, place = np.unique(nodes, return_inverse=True)
        share = np.bincount(place, weight, minlength=len(rows)).astype(float)
        found[key] = Surface(*names[key], rows, share, tuple(facets.get(key, ())), key in sideless)
    return found


def surface_of(
    entry: str, by: Keyword | Row, assembly: Assembly, scope: Scope, found: Mapping[tuple[str, str], Surface]
) -> Surface:
    """The surface that an entry names; DeckError where there is none."""
    within, name = assembly.split_name(entry, scope)
    surface = found.get((within.name.upper(), name.upper()))
    if surface is None:
        raise by.error(
            f"surface {entry!r} is not in the deck, or of another type", "correct the name, or add the *SURFACE"
        )
    return surface


def _facets(builder: _Builder, row: Row, rows: IntArray) -> list[tuple[Kind, IntArray]]:
    """The facets of the solids in rows that a data line names: their kind and nodes (f, k)."""
    label = row.text(1).upper()
    if not label:
        return _outside(builder, rows) if rows.size else []
    return facets_of(builder.assembly, rows, parse_integer(label[1:]) if label.startswith("S") else None, row, "S")


def _of_shells(
    assembly: Assembly, row: Row, rows: IntArray
) -> tuple[list[tuple[Kind, IntArray]], list[tuple[IntArray, FloatArray]]]:
    """Of the shells in rows the sides that a data line names, kind and nodes (f, k), or the nodes of edges and their shares."""
    label = row.text(1).upper()
    if not rows.size:
        return [], []
    if label and label not in SIDES and label not in EDGES:
        raise row.error(
            f"{row.text(1)!r} is no side or edge of {assembly.element(int(rows[0]))}", "write SPOS, SNEG or E1 to E4"
        )
    facets = shell_facets(assembly, rows)
    if label not in EDGES:
        return [
            (kind, nodes if SIDES.get(label, 1) > 0 else nodes[:, OUTWARD[nodes.shape[1]]]) for kind, nodes in facets
        ], []
    lines = []
    for kind, nodes in facets:
        if not EDGES[label] < kind.corners:
            raise row.error(f"{row.text(1)!r} is no edge of a shell of {kind.corners} corners", "name another edge")
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
    return [
        (OF_NODES[int(k)], assembly.nodes[assembly.first[rows[count == k]][:, None] + np.arange(k)])
        for k in np.unique(count)
    ]


def facets_of(
    assembly: Assembly, rows: IntArray, number: int | None, row: Row, letter: str
) -> list[tuple[Kind, IntArray]]:
    """Facet 1, 2, … of the solids in rows: kind and nodes (f, k); DeckError where they have none of this number."""
    found = []
    for i in np.unique(assembly.kind[rows]):
        facets = ELEMENTS[i].facets
        if number is None or not 1 <= number <= len(facets):
            raise row.error(
                f"{row.text(1)!r} is no facet of a {ELEMENTS[i].name}",
                f"write {letter}1 to {letter}{len(facets)}" + ", or nothing" * (letter == "S"),
            )
        kind, local = facets[number - 1]
        own = rows[assembly.kind[rows] == i]
        found.append((kind, assembly.nodes[assembly.first[own][:, None] + np.array(local)]))
    return found


def _outside(builder: _Builder, rows: IntArray) -> list[tuple[Kind, IntArray]]:
    """Facets of elements that belong to no other element."""
    if builder.exterior is None:
        with builder.mesh.located():
            builder.exterior = exterior_facets(builder.mesh)
    outside = builder.exterior
    chosen = np.isin(outside.element_id, builder.assembly.element_ids[rows])
    found = []
    for i, kind in enumerate(FACETS):
        nodes = outside.nodes[chosen & (outside.kind == i)]
        if nodes.size:
            found.append((kind, nodes[:, : len(kind.nodes)]))
    return found


def _shares(assembly: Assembly, kind: Kind, nodes: IntArray) -> tuple[IntArray, FloatArray]:
    """Each node of facets (f, k) with a k-th of the area between the facet's corners."""
    area = 0.5 * np.linalg.norm(area_vector(assembly.position[nodes[:, : kind.corners]]), axis=1)
    return nodes.ravel(), np.repeat(area / nodes.shape[1], nodes.shape[1])
