"""Nodes of a Nastran deck: GRID and GRDSET, in the basic system, and the systems their displacements are meant in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strainsight.decks.faults import IdTable
from strainsight.decks.nastran.cards import Card, unique_ids
from strainsight.decks.nastran.coordinates import coordinate_systems, to_basic
from strainsight.decks.nastran.sets import expand
from strainsight.errors import DeckError
from strainsight.mesh.coordinates import BASIC, CoordinateSystem, local_axes
from strainsight.mesh.model import FloatArray, IntArray


class NodeTable(IdTable):
    """Ids (n,) of the file to rows of `Mesh.position`; the SPOINT cards, for errors."""

    def __init__(self, ids: IntArray, scalar: Sequence[Card] = ()):
        super().__init__(ids)
        self._scalar = scalar

    def row(self, node_id: int, card: Card) -> int:
        """Row of one node; DeckError where it is missing."""
        return int(self.rows_of_cards(np.array([[node_id]]), [card])[0, 0])

    def rows_of_cards(self, ids: IntArray, cards: Sequence[Card]) -> IntArray:
        """Rows for ids (c, k), one row of ids a card; DeckError at the first card with a missing node."""
        rows, missing = self.rows(ids)
        if missing.any():
            i, j = np.argwhere(missing)[0]
            raise cards[i].error(*self._fault(int(ids[i, j])))
        return rows

    def _fault(self, node_id: int) -> tuple[str, str]:
        own = np.array([node_id])
        if any((expand(card.fields, own, card.where)[0] == node_id).any() for card in self._scalar):
            return (
                f"node {node_id} is a scalar point: scalar points are not supported",
                "take it out, or give it as a GRID card with a place in space",
            )
        return f"node {node_id} is not in the deck", f"add a GRID card with id {node_id}, or correct the id"


@dataclass(frozen=True)
class Grids:
    """position (n, 3) basic; axes row → (3, 3) of the nodes with a CD; permanent supports (card, row, components)."""

    nodes: NodeTable
    position: FloatArray
    systems: dict[int, CoordinateSystem]
    axes: dict[int, FloatArray]
    permanent: list[tuple[Card, int, str]]


def read_grids(cards: dict[str, list[Card]], notes: list[str], path: Path) -> Grids:
    """GRID with what GRDSET says where its CP, CD or PS is blank.

    Raises DeckError for a deck without GRID, an id that stands twice, and a system that is not there.
    """
    grids = cards.get("GRID", [])
    if not grids:
        raise DeckError(
            "the deck holds no GRID card", where=str(path), remedy="check that this is the deck of the model"
        )
    if long := [card for card in grids if len(card.fields) > 8 and any(card.fields[8:])]:
        raise long[0].error(
            "more than 8 data fields", "remove what is behind field 9; a line of its own begins every card"
        )
    CP, CD, PS = _defaults(cards.get("GRDSET", []))
    nodes = NodeTable(unique_ids(grids, "node"), cards.get("SPOINT", []))
    local = np.array([[card.real(i, "a coordinate", 0.0) for i in (2, 3, 4)] for card in grids])
    given = np.array([card.integer(1, "the system CP", CP) for card in grids])
    meant = np.array([card.integer(5, "the system CD", CD) for card in grids])

    def point_of(node_id: int, card: Card) -> tuple[FloatArray, int]:
        row = nodes.row(node_id, card)
        return local[row], int(given[row])

    systems = coordinate_systems(cards, point_of)
    for system in (given, meant):
        for cid in np.unique(system):
            if int(cid) not in systems:
                raise grids[int(np.argmax(system == cid))].error(
                    f"coordinate system {cid} is no CORD1 or CORD2 of the deck",
                    "add the card of the system, or give the node in the basic system 0",
                )
    position = to_basic(local, given, systems)
    axes: dict[int, FloatArray] = {}
    for cid in np.unique(meant[meant != 0]):
        rows = np.flatnonzero(meant == cid)
        directions, on_axis = local_axes(position[rows], systems[int(cid)])
        axes |= zip(rows.tolist(), directions, strict=True)
        if on_axis.any():
            lost = "e_r and e_θ" if systems[int(cid)].kind == "cylindrical" else "e_θ and e_φ"
            notes.append(
                f"{int(on_axis.sum())} of the nodes with CD = {cid} lie on its axis (node {nodes.ids[rows[on_axis][0]]}), "
                f"where {lost} have no direction: their components are along the rectangular axes that define it"
            )
    texts = [card.text(6) or PS for card in grids]
    permanent = [(grids[i], i, text) for i, text in enumerate(texts) if text not in ("", "0")]
    return Grids(nodes, position, systems, axes, permanent)


def _defaults(found: list[Card]) -> tuple[int, int, str]:
    """CP, CD and PS of a blank field of GRID."""
    if len(found) > 1:
        raise found[1].error(f"a second one (first at {found[0].where})", "keep one GRDSET")
    if not found:
        return 0, 0, ""
    return found[0].integer(1, "the system CP", 0), found[0].integer(5, "the system CD", 0), found[0].text(6)


def resolved_system(card: Card, field: int, systems: dict[int, CoordinateSystem]) -> CoordinateSystem:
    """The coordinate system that a field names; blank is the basic one. Raises DeckError where it is not there."""
    cid = card.integer(field, "the system CID", 0)
    if cid not in systems:
        raise card.error(f"coordinate system {cid} is no CORD1 or CORD2 of the deck", "add the card of the system")
    return systems[cid]


def axes_at(position: FloatArray, system: CoordinateSystem) -> FloatArray:
    """The directions of a system at one point (3,)."""
    if system is BASIC:
        return BASIC.axes
    return local_axes(position[None, :], system)[0][0]
