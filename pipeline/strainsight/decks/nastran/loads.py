"""Point masses (CONM2) and nodal forces (FORCE) of a Nastran deck."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from strainsight.decks.nastran.cards import Card, unique_ids
from strainsight.decks.nastran.coordinates import BASIC, CoordinateSystem, local_axes
from strainsight.decks.nastran.grids import Grids, resolved_system
from strainsight.mesh.model import FloatArray, NodalForces, PointMass

INDEFINITE = 1e-6
"""Least principal moment over the largest, below zero, that the digits of a card do not explain."""


def point_masses(
    cards: dict[str, list[Card]], grids: Grids, scale: float, turning: Collection[int], notes: list[str]
) -> tuple[PointMass, ...]:
    """CONM2 with offset and inertia along the basic axes; masses and inertia times `scale` (PARAM WTMASS).

        J = [I11, −I21, −I31; −I21, I22, −I32; −I31, −I32, I33] about the centre, the card holds positive products

    turning: rows of the nodes with rotations; at the others only the mass counts, which becomes a note.
    Raises DeckError for a negative mass, an inertia that is not positive semidefinite, a node or system that is not there.
    """
    found = cards.get("CONM2", [])
    masses = []
    for number, card in zip(unique_ids(found, "point mass").tolist(), found, strict=True):
        row = grids.nodes.row(card.integer(1, "the node id"), card)
        mass = card.real(3, "the mass", 0.0)
        if mass < 0:
            raise card.error(f"the mass is {mass:g}, negative", "give a positive mass")
        at_position = card.text(2) == "-1"
        axes = np.eye(3) if at_position else _axes(grids.position[row], resolved_system(card, 2, grids.systems))
        offset = axes @ [card.real(i, "the offset", 0.0) for i in (4, 5, 6)] - at_position * grids.position[row]
        inertia = axes @ _inertia(card) @ axes.T
        if (offset.any() or inertia.any()) and row not in turning:
            notes.append(
                f"CONM2 {number}: node {grids.nodes.ids[row]} has no rotations (no RBE2 or RBE3 gives it any), so "
                "its mass acts at the node itself, its offset and inertia have no effect"
            )
        masses.append(PointMass(number, row, scale * mass, offset, scale * inertia))
    return tuple(masses)


def _inertia(card: Card) -> FloatArray:
    I11, I21, I22, I31, I32, I33 = (card.real(i, "the inertia", 0.0) for i in range(8, 14))
    J = np.array([[I11, -I21, -I31], [-I21, I22, -I32], [-I31, -I32, I33]])
    principal = np.linalg.eigvalsh(J)
    if principal[0] < -INDEFINITE * max(principal[-1], 0.0) or principal[-1] < 0:
        raise card.error(
            f"the inertia has the principal moments {principal[0]:.4g}, {principal[1]:.4g}, {principal[2]:.4g}",
            "none may be negative; I21, I31 and I32 are the products themselves, without a minus sign",
        )
    return J


def nodal_forces(cards: dict[str, list[Card]], grids: Grids) -> dict[str, NodalForces]:
    """FORCE cards of set s as the load "FORCE-s": F (N1 e₁ + N2 e₂ + N3 e₃), directions of its CID at the node.

    Forces on one node add up. Raises DeckError for a node or system that is not there.
    """
    sets: dict[int, dict[int, FloatArray]] = {}
    for card in cards.get("FORCE", []):
        number = card.integer(0, "the set id")
        row = grids.nodes.row(card.integer(1, "the node id"), card)
        axes = _axes(grids.position[row], resolved_system(card, 2, grids.systems))
        force = card.real(3, "the force") * axes @ [card.real(i, "the direction", 0.0) for i in (4, 5, 6)]
        own = sets.setdefault(number, {})
        own[row] = own.get(row, np.zeros(3)) + force
    return {
        f"FORCE-{number}": NodalForces(np.array(list(own), dtype=np.int64), np.array(list(own.values())))
        for number, own in sorted(sets.items())
    }


def _axes(position: FloatArray, system: CoordinateSystem) -> FloatArray:
    """The directions of a system at one point (3,)."""
    if system is BASIC:
        return BASIC.axes
    return local_axes(position[None, :], system)[0][0]
