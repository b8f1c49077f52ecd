"""Point masses (CONM2) of a Nastran deck."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from strainsight.decks.nastran.cards import Card, unique_ids
from strainsight.decks.nastran.grids import Grids, axes_at, resolved_system
from strainsight.mesh.model import FloatArray, PointMass

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
        axes = np.eye(3) if at_position else axes_at(grids.position[row], resolved_system(card, 2, grids.systems))
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
