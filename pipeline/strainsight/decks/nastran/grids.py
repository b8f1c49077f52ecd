"""Nodes (GRID) and coordinate systems (CORD) of a Nastran deck: positions in the basic system, axes of displacements."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strainsight.decks.nastran.cards import Card, Cards, unique_ids
from strainsight.decks.nastran.case_control import expand
from strainsight.decks.text import error_at, parse_integer
from strainsight.mesh.coordinates import BASIC, CoordinateSystem, local_axes
from strainsight.mesh.model import FloatArray, IdTable, IntArray

SHAPES = {"R": "rectangular", "C": "cylindrical", "S": "spherical"}
BY_POINTS, BY_NODES = ("CORD2R", "CORD2C", "CORD2S"), ("CORD1R", "CORD1C", "CORD1S")

PointOf = Callable[[int, Card], tuple[FloatArray, int]]
"""Node id and the card that names it → coordinates (3,) and the system CP they are given in."""


@dataclass(frozen=True)
class _Definition:
    """Points A, B, C (3, 3), each given in a system of its own."""

    card: Card
    points: FloatArray
    systems: tuple[int, int, int]


def coordinate_systems(cards: Cards, point_of: PointOf) -> dict[int, CoordinateSystem]:
    """Coordinate systems by id; 0 is the basic one.

        z = (B − A)/|B − A|,   y = z × (C − A)/|z × (C − A)|,   x = y × z

    with A, B, C in the reference system of a CORD2, or the three nodes of a CORD1 in the systems those are given in;
    all of these may come later in the deck.
    Raises DeckError for an id given twice, a reference that is missing or circular, and three points on a line.
    """
    found = _definitions(cards, point_of)
    systems = {0: BASIC}
    for cid in found:
        pending = [cid]
        while pending:
            own = found[pending[-1]]
            missing = [reference for reference in own.systems if reference not in systems]
            if not missing:
                systems[pending[-1]] = _resolved(own, systems)
                pending.pop()
            elif missing[0] not in found:
                raise own.card.error(
                    f"refers to coordinate system {missing[0]}, which is not in the deck", "add its card"
                )
            elif missing[0] in pending:
                raise found[cid].card.error(
                    "refers to itself through its reference systems", "refer one of them to the basic system 0"
                )
            else:
                pending.append(missing[0])
    return systems


def _definitions(cards: Cards, point_of: PointOf) -> dict[int, _Definition]:
    found: dict[int, _Definition] = {}

    def add(cid: int, definition: _Definition) -> None:
        if cid < 1:
            raise definition.card.error("the system id must be positive")
        if cid in found:
            first = found[cid].card.where
            raise definition.card.error(f"system id {cid} stands twice (first at {first})", "give each its own id")
        found[cid] = definition

    for card in cards.of(*BY_POINTS):
        points = np.array([card.real(2 + i, "a coordinate", 0.0) for i in range(9)]).reshape(3, 3)
        reference = card.integer(1, "the reference system", 0)
        add(card.integer(0, "the system id"), _Definition(card, points, (reference,) * 3))
    for card in cards.of(*BY_NODES):
        for at in (0, 4):
            if at and not any(card.tokens[at : at + 4]):
                continue
            a, b, c = (point_of(card.integer(at + i, "a node id"), card) for i in (1, 2, 3))
            points = np.array([a[0], b[0], c[0]])
            add(card.integer(at, "the system id"), _Definition(card, points, (a[1], b[1], c[1])))
    return found


def _resolved(own: _Definition, systems: dict[int, CoordinateSystem]) -> CoordinateSystem:
    A, B, C = to_basic(own.points, np.array(own.systems), systems)
    z, plane = B - A, C - A
    y = np.cross(z, plane)
    length, area = np.linalg.norm(z), np.linalg.norm(y)
    if length == 0 or area <= 1e-9 * length * np.linalg.norm(plane):
        raise own.card.error("the points A, B and C lie on one line", "give a point C off the line from A to B")
    z, y = z / length, y / area
    return CoordinateSystem(SHAPES[own.card.name[-1]], A, np.column_stack([np.cross(y, z), y, z]))


def to_basic(local: FloatArray, system: IntArray, systems: dict[int, CoordinateSystem]) -> FloatArray:
    """x = x₀ + T x',  x' = (r cos θ, r sin θ, z) in cylinders, (r sin θ cos φ, r sin θ sin φ, r cos θ) in spheres.

    local (n, 3) [length, deg]; system (n,) ids, 0 is basic. Returns (n, 3) [length].
    """
    position = local.copy()
    for cid in np.unique(system[system != 0]):
        at = system == cid
        position[at] = _to_basic(local[at], systems[int(cid)])
    return position


def _to_basic(local: FloatArray, system: CoordinateSystem) -> FloatArray:
    a, b, c = local.T
    if system.kind == "cylindrical":
        local = np.column_stack([a * np.cos(np.radians(b)), a * np.sin(np.radians(b)), c])
    elif system.kind == "spherical":
        theta, phi = np.radians(b), np.radians(c)
        r = a * np.sin(theta)
        local = np.column_stack([r * np.cos(phi), r * np.sin(phi), a * np.cos(theta)])
    return system.origin + local @ system.axes.T


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
        if any((expand(card.tokens, own, card.where)[0] == node_id).any() for card in self._scalar):
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

    def direction(self, card: Card, A: int, basic: bool = False) -> FloatArray | None:
        """The vector (3,) of fields 4 to 6 along the system CD of node A or the basic one, or that from A to the node in field 4;
        None where these are blank."""
        if not any(card.text(i) for i in (4, 5, 6)):
            return None
        if not (card.text(5) or card.text(6)) and parse_integer(card.text(4)) is not None:
            return np.asarray(self.position[self.nodes.row(card.integer(4, "the node G0"), card)] - self.position[A])
        axes = np.eye(3) if basic else self.axes.get(A, np.eye(3))
        return np.asarray(axes @ [card.real(i, "a component of X", 0.0) for i in (4, 5, 6)])


def read_grids(cards: Cards, notes: list[str], path: Path) -> Grids:
    """GRID with what GRDSET says where its CP, CD or PS is blank.

    Raises DeckError for a deck without GRID, an id that stands twice, and a system that is not there.
    """
    grids = cards.of("GRID")
    if not grids:
        raise error_at(path, "the deck holds no GRID card", "check that this is the deck of the model")
    if long := [card for card in grids if len(card.tokens) > 8 and any(card.tokens[8:])]:
        raise long[0].error(
            "more than 8 data fields", "remove what is behind field 9; a line of its own begins every card"
        )
    CP, CD, PS = _defaults(cards.of("GRDSET"))
    nodes = NodeTable(unique_ids(grids, "node"), cards.of("SPOINT"))
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
