"""Surfaces of an Abaqus deck as nodes, each with its share of the area."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.text import Row
from strainsight.decks.numbers import parse_integer
from strainsight.mesh.facets import Facets, exterior_facets
from strainsight.mesh.kinds import ELEMENTS, FACETS
from strainsight.mesh.kinds.kind import Kind
from strainsight.mesh.model import CellBlock, FloatArray, IntArray, Mesh


@dataclass(frozen=True)
class Surface:
    """name as the file writes it; scope it is defined in; nodes (k,) rows, sorted; weight (k,): share of the area of the
    facets, or the area the file states for each node, 1 where it states none; facets: kind and nodes (f, k) rows, normal
    outward, none of a surface of nodes."""

    name: str
    scope: Scope
    nodes: IntArray
    weight: FloatArray
    facets: tuple[tuple[Kind, IntArray], ...] = ()


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
    """(INSTANCE, NAME) → surface, of *SURFACE with TYPE=ELEMENT (S1 to S6, or the facets outside) and TYPE=NODE.

    Facets of elements that are no solids are left out; other types are counted. A facet's area is shared equally among
    its nodes. Raises DeckError for sets that are not there and for facets that an element does not have.
    """
    builder = _Builder(assembly, mesh)
    gathered: dict[tuple[str, str], list[tuple[IntArray, FloatArray]]] = {}
    facets: dict[tuple[str, str], list[tuple[Kind, IntArray]]] = {}
    names: dict[tuple[str, str], tuple[str, Scope]] = {}
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
                pairs = _facets(builder, row, scope)
                own += [_shares(assembly, facet, nodes) for facet, nodes in pairs]
                facets.setdefault(key, []).extend(pairs)
    found = {}
    for key, parts in gathered.items():
        nodes = np.concatenate([np.zeros(0, dtype=np.int64), *(nodes for nodes, _ in parts)])
        weight = np.concatenate([np.zeros(0), *(weight for _, weight in parts)])
        rows, place = np.unique(nodes, return_inverse=True)
        share = np.bincount(place, weight, minlength=len(rows)).astype(float)
        found[key] = Surface(*names[key], rows, share, tuple(facets.get(key, ())))
    return found


def _facets(builder: _Builder, row: Row, scope: Scope) -> list[tuple[Kind, IntArray]]:
    """The facets of solids that a data line names: their kind and nodes (f, k)."""
    assembly = builder.assembly
    rows = assembly.element_rows(row.text(0), scope, row)
    label = row.text(1).upper()
    rows = rows[assembly.kind[rows] >= 0]
    if not label:
        return _outside(builder, rows)
    return facets_of(assembly, rows, parse_integer(label[1:]) if label.startswith("S") else None, row, "S")


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
    x = assembly.position[nodes[:, : kind.corners]]
    area = 0.5 * np.linalg.norm(
        np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
        if kind.corners == 3
        else np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]),
        axis=1,
    )
    return nodes.ravel(), np.repeat(area / nodes.shape[1], nodes.shape[1])
