"""Points given in coordinate systems of the deck (CORD2R, CORD2C, CORD2S), in the basic system."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.mesh.cards import Card
from strainsight.mesh.model import FloatArray, IntArray

KINDS = {"CORD2R": "rectangular", "CORD2C": "cylindrical", "CORD2S": "spherical"}


@dataclass(frozen=True)
class CoordinateSystem:
    """kind rectangular, cylindrical or spherical; origin (3,) and axes (3, 3), one in a column, in the basic system."""

    kind: str
    origin: FloatArray
    axes: FloatArray


BASIC = CoordinateSystem("rectangular", np.zeros(3), np.eye(3))


def coordinate_systems(cards: dict[str, list[Card]]) -> dict[int, CoordinateSystem]:
    """Coordinate systems by id; 0 is the basic one.

        z = (B − A)/|B − A|,   y = z × (C − A)/|z × (C − A)|,   x = y × z

    with A, B, C in the reference system of the card, which may come later in the deck.
    Raises DeckError for an id given twice, a reference that is missing or circular, and three points on a line.
    """
    found: dict[int, Card] = {}
    for card in (card for name in KINDS for card in cards.get(name, [])):
        cid = card.integer(0, "the system id")
        if cid < 1:
            raise card.error("the system id must be positive")
        if cid in found:
            raise card.error(
                f"the system id stands twice (first at {found[cid].where})", "give every system its own id"
            )
        found[cid] = card
    systems = {0: BASIC}
    for card in found.values():
        chain = [card]
        while (reference := chain[-1].integer(1, "the reference system", 0)) not in systems:
            if reference not in found:
                raise chain[-1].error(
                    f"refers to coordinate system {reference}, which is not in the deck", "add its card"
                )
            if found[reference] in chain:
                raise card.error(
                    "refers to itself through its reference systems", "refer one of them to the basic system 0"
                )
            chain.append(found[reference])
        for link in reversed(chain):
            systems[int(link.fields[0])] = _resolved(link, systems[link.integer(1, "the reference system", 0)])
    return systems


def _resolved(card: Card, reference: CoordinateSystem) -> CoordinateSystem:
    points = np.array([card.real(2 + i, "a coordinate", 0.0) for i in range(9)]).reshape(3, 3)
    A, B, C = _to_basic(points, reference)
    z, plane = B - A, C - A
    y = np.cross(z, plane)
    length, area = np.linalg.norm(z), np.linalg.norm(y)
    if length == 0 or area <= 1e-9 * length * np.linalg.norm(plane):
        raise card.error("the points A, B and C lie on one line", "give a point C off the line from A to B")
    z, y = z / length, y / area
    return CoordinateSystem(KINDS[card.name], A, np.column_stack([np.cross(y, z), y, z]))


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
