"""Nodes (GRID) and coordinate systems (CORD) of a Nastran deck: positions in the basic system, nodal axes."""

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
"""Node id and the card that refers to it → coordinates (3,) and their system CP."""


@dataclass(frozen=True)
class _Definition:
    """Points A, B, C (3, 3), each with its coordinate system."""

    card: Card
    points: FloatArray
    systems: tuple[int, int, int]


def coordinate_systems(cards: Cards, point_of: PointOf) -> dict[int, CoordinateSystem]:
    """Coordinate systems by id; 0 is the basic one.

        z = (B − A)/|B − A|,   y = z × (C − A)/|z × (C − A)|,   x = y × z

    with A, B, C in the reference system of a CORD2, or the three nodes of a CORD1 in their systems CP, in any order
    in the deck. Raises DeckError for a duplicate id, a missing or circular reference, and three points on a line."""
    definitions = _definitions(cards, point_of)
    systems = {0: BASIC}
    for cid in definitions:
        pending = [cid]
        while pending:
            definition = definitions[pending[-1]]
            missing = [reference for reference in definition.systems if reference not in systems]
            if not missing:
                systems[pending[-1]] = _resolve(definition, systems)
                pending.pop()
            elif missing[0] not in definitions:
                raise definition.card.error(
                    f"the card refers to coordinate system {missing[0]}, which is not in the deck",
                    "add the card of this coordinate system, or correct its id on this card",
                )
            elif missing[0] in pending:
                raise definitions[cid].card.error(
                    "the reference systems RID form a loop", "define one of the systems in the basic system (RID 0)"
                )
            else:
                pending.append(missing[0])
    return systems


def _definitions(cards: Cards, point_of: PointOf) -> dict[int, _Definition]:
    definitions: dict[int, _Definition] = {}

    def add(cid: int, definition: _Definition) -> None:
        if cid < 1:
            raise definition.card.error(f"the coordinate system id is {cid}, not positive", "use ids of at least 1")
        if cid in definitions:
            first = definitions[cid].card.where
            raise definition.card.error(
                f"coordinate system id {cid} is used twice (first at {first})", "use a unique id for every system"
            )
        definitions[cid] = definition

    for card in cards.of(*BY_POINTS):
        points = np.array([card.real(2 + i, "a coordinate", 0.0) for i in range(9)]).reshape(3, 3)
        reference = card.integer(1, "the reference system RID", 0)
        add(card.integer(0, "the coordinate system id"), _Definition(card, points, (reference,) * 3))
    for card in cards.of(*BY_NODES):
        for at in (0, 4):
            if at and not any(card.tokens[at : at + 4]):
                continue
            a, b, c = (point_of(card.integer(at + i, "a node id"), card) for i in (1, 2, 3))
            points = np.array([a[0], b[0], c[0]])
            add(card.integer(at, "the coordinate system id"), _Definition(card, points, (a[1], b[1], c[1])))
    return definitions


def _resolve(definition: _Definition, systems: dict[int, CoordinateSystem]) -> CoordinateSystem:
    A, B, C = to_basic(definition.points, np.array(definition.systems), systems)
    z, plane = B - A, C - A
    y = np.cross(z, plane)
    length, area = np.linalg.norm(z), np.linalg.norm(y)
    if length == 0 or area <= 1e-9 * length * np.linalg.norm(plane):
        raise definition.card.error(
            "the points A, B and C are on one line", "specify a point C that is not on the line through A and B"
        )
    z, y = z / length, y / area
    return CoordinateSystem(SHAPES[definition.card.name[-1]], A, np.column_stack([np.cross(y, z), y, z]))


def to_basic(local: FloatArray, system: IntArray, systems: dict[int, CoordinateSystem]) -> FloatArray:
    """x = x₀ + T x',  x' = (r cos θ, r sin θ, z) in cylinders, (r sin θ cos φ, r sin θ sin φ, r cos θ) in spheres.

    local (n, 3) [length, deg]; system (n,) ids, 0 is basic. Returns (n, 3) [length]."""
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
    """Ids (n,) of the file → rows of `Mesh.position`; the SPOINT cards for errors."""

    def __init__(self, ids: IntArray, scalar: Sequence[Card] = ()):
        super().__init__(ids)
        self._scalar = scalar

    def row(self, node_id: int, card: Card) -> int:
        """Row of one node; DeckError if it is missing."""
        return int(self.rows_of_cards(np.array([[node_id]]), [card])[0, 0])

    def rows_of_cards(self, ids: IntArray, cards: Sequence[Card]) -> IntArray:
        """Rows for ids (c, k), one row of ids a card; DeckError at the first card with a missing node."""
        rows, missing = self.rows(ids)
        if missing.any():
            i, j = np.argwhere(missing)[0]
            raise cards[i].error(*self._fault(int(ids[i, j])))
        return rows

    def _fault(self, node_id: int) -> tuple[str, str]:
        ids = np.array([node_id])
        if any((expand(card.tokens, ids, card.where)[0] == node_id).any() for card in self._scalar):
            return f"node {node_id} is a scalar point (SPOINT), which is not supported", "define the node as a GRID"
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
        """Vector (3,) of fields 4 to 6 along the system CD of node A or the basic system, or from A to the node in
        field 4; None if the fields are blank."""
        if not any(card.text(i) for i in (4, 5, 6)):
            return None
        if not (card.text(5) or card.text(6)) and parse_integer(card.text(4)) is not None:
            return np.asarray(self.position[self.nodes.row(card.integer(4, "the node G0"), card)] - self.position[A])
        axes = np.eye(3) if basic else self.axes.get(A, np.eye(3))
        return np.asarray(axes @ [card.real(i, "a component of X", 0.0) for i in (4, 5, 6)])


def read_grids(cards: Cards, notes: list[str], path: Path) -> Grids:
    """Read GRID; blank fields CP, CD and PS have the values of GRDSET. Raises DeckError for a deck without GRID, a duplicate id,
    and a missing system."""
    if not (grids := cards.of("GRID")):
        raise error_at(path, "the deck contains no GRID card", "check that the file is the input deck of the model")
    if long := [card for card in grids if len(card.tokens) > 8 and any(card.tokens[8:])]:
        raise long[0].error(
            "the card has more than 8 data fields",
            "remove the entries after field 9, and start every card on a new line",
        )
    CP, CD, PS = _defaults(cards.of("GRDSET"))
    nodes = NodeTable(unique_ids(grids, "node"), cards.of("SPOINT"))
    local = np.array([[card.real(i, "a coordinate", 0.0) for i in (2, 3, 4)] for card in grids])
    systems_cp = np.array([card.integer(1, "the coordinate system CP", CP) for card in grids])
    meant = np.array([card.integer(5, "the coordinate system CD", CD) for card in grids])

    def point_of(node_id: int, card: Card) -> tuple[FloatArray, int]:
        row = nodes.row(node_id, card)
        return local[row], int(systems_cp[row])

    systems = coordinate_systems(cards, point_of)
    for system in (systems_cp, meant):
        for cid in np.unique(system):
            if int(cid) not in systems:
                raise grids[int(np.argmax(system == cid))].error(
                    f"coordinate system {cid} is not a CORD1 or CORD2 of the deck",
                    "add the card of this coordinate system, or set CP or CD of the node to 0, the basic system",
                )
    position = to_basic(local, systems_cp, systems)
    axes: dict[int, FloatArray] = {}
    for cid in np.unique(meant[meant != 0]):
        rows = np.flatnonzero(meant == cid)
        directions, on_axis = local_axes(position[rows], systems[int(cid)])
        axes |= zip(rows.tolist(), directions, strict=True)
        if on_axis.any():
            lost = "e_r and e_θ" if systems[int(cid)].kind == "cylindrical" else "e_θ and e_φ"
            notes.append(
                f"nodes with CD = {cid} on the axis of this coordinate system ({on_axis.sum()} in total, first node "
                f"{nodes.ids[rows[on_axis][0]]}): {lost} are undefined there, so the rectangular axes of the "
                "system are used"
            )
    texts = [card.text(6) or PS for card in grids]
    permanent = [(grids[i], i, text) for i, text in enumerate(texts) if text not in ("", "0")]
    return Grids(nodes, position, systems, axes, permanent)


def _defaults(cards: list[Card]) -> tuple[int, int, str]:
    """CP, CD and PS for blank fields of GRID."""
    if len(cards) > 1:
        raise cards[1].error(f"GRDSET is defined twice (first at {cards[0].where})", "keep only one GRDSET")
    if not cards:
        return 0, 0, ""
    return (
        cards[0].integer(1, "the coordinate system CP", 0),
        cards[0].integer(5, "the coordinate system CD", 0),
        cards[0].text(6),
    )


def find_system(card: Card, field: int, systems: dict[int, CoordinateSystem]) -> CoordinateSystem:
    """The coordinate system of a field; the basic one if it is blank. Raises DeckError if it is missing."""
    cid = card.integer(field, "the coordinate system CID", 0)
    if cid not in systems:
        raise card.error(f"coordinate system {cid} is not a CORD1 or CORD2 of the deck", "add its card, or correct CID")
    return systems[cid]


def axes_at(position: FloatArray, system: CoordinateSystem) -> FloatArray:
    """Axes of a system at one point (3,)."""
    if system is BASIC:
        return BASIC.axes
    return local_axes(position[None, :], system)[0][0]
