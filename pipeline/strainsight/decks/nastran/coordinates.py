"""Coordinate systems of a Nastran deck (CORD1R/C/S, CORD2R/C/S): points and directions in the basic system."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from strainsight.decks.nastran.cards import Card
from strainsight.mesh.coordinates import BASIC, CoordinateSystem
from strainsight.mesh.model import FloatArray, IntArray

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


def coordinate_systems(cards: dict[str, list[Card]], point_of: PointOf) -> dict[int, CoordinateSystem]:
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


def _definitions(cards: dict[str, list[Card]], point_of: PointOf) -> dict[int, _Definition]:
    found: dict[int, _Definition] = {}

    def add(cid: int, definition: _Definition) -> None:
        if cid < 1:
            raise definition.card.error("the system id must be positive")
        if cid in found:
            first = found[cid].card.where
            raise definition.card.error(f"system id {cid} stands twice (first at {first})", "give each its own id")
        found[cid] = definition

    for card in (card for name in BY_POINTS for card in cards.get(name, [])):
        points = np.array([card.real(2 + i, "a coordinate", 0.0) for i in range(9)]).reshape(3, 3)
        reference = card.integer(1, "the reference system", 0)
        add(card.integer(0, "the system id"), _Definition(card, points, (reference,) * 3))
    for card in (card for name in BY_NODES for card in cards.get(name, [])):
        for at in (0, 4):
            if at and not any(card.fields[at : at + 4]):
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
