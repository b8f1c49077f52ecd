"""Point masses of a Nastran deck: CONM1, CONM2, and CMASS1, CMASS2 against the ground."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from strainsight.decks.nastran.cards import Card, unique_ids
from strainsight.decks.nastran.grids import Grids, axes_at, resolved_system
from strainsight.mesh.joins import PointMass, matrix_mass
from strainsight.mesh.model import FloatArray

MASSES = ("CONM1", "CONM2", "CMASS1", "CMASS2")
INDEFINITE = 1e-6
"""Least principal moment over the largest, below zero, that the digits of a card do not explain."""


def point_masses(
    cards: dict[str, list[Card]], grids: Grids, scale: float, turning: Collection[int], notes: list[str]
) -> tuple[PointMass, ...]:
    """CONM2 with offset and inertia along the basic axes; masses and inertia times `scale` (PARAM WTMASS).

        J = [I11, −I21, −I31; −I21, I22, −I32; −I31, −I32, I33] about the centre, the card holds positive products

    CONM1 as a matrix (6, 6) along the axes of CID, CMASS as one of its one entry along the axes of its node.
    turning: rows of the nodes with rotations; at the others only the mass counts, which becomes a note.
    Raises DeckError for a negative mass, an inertia or a matrix that is not positive semidefinite, a node, system or property
    that is not there, and a CMASS between two motions.
    """
    found = [card for name in MASSES for card in cards.get(name, [])]
    properties = _scalar_properties(cards)
    masses = []
    for number, card in zip(unique_ids(found, "point mass").tolist(), found, strict=True):
        if card.name != "CONM2":
            masses.append(_of_matrix(card, grids, properties, scale, turning, notes))
            continue
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


def _of_matrix(
    card: Card, grids: Grids, properties: dict[int, float], scale: float, turning: Collection[int], notes: list[str]
) -> PointMass:
    """A CONM1 or a CMASS."""
    row, M = _conm1(card, grids) if card.name == "CONM1" else _cmass(card, grids, properties)
    size = np.sqrt(np.maximum(M.diagonal(), 0.0))
    size[size == 0] = 1.0
    least = float(np.linalg.eigvalsh(M / np.outer(size, size))[0])
    if M.diagonal().min() < 0 or least < -INDEFINITE:
        raise card.error("the mass along some motion is negative", "correct its entries, of which none may be so large")
    if M[3:].any() and row not in turning:
        notes.append(
            f"{card.name} {card.text(0)}: node {grids.nodes.ids[row]} has no rotations (no RBE2 or RBE3 gives it any), so that "
            "its entries of rotations have no effect"
        )
    return matrix_mass(card.integer(0, "the element id"), row, scale * M)


def _conm1(card: Card, grids: Grids) -> tuple[int, FloatArray]:
    row = grids.nodes.row(card.integer(1, "the node id"), card)
    axes = np.kron(np.eye(2), axes_at(grids.position[row], resolved_system(card, 2, grids.systems)))
    M = np.zeros((6, 6))
    M[np.tril_indices(6)] = [card.real(3 + i, "an entry of the matrix", 0.0) for i in range(21)]
    M = M + np.tril(M, -1).T
    return row, axes @ M @ axes.T


def _cmass(card: Card, grids: Grids, properties: dict[int, float]) -> tuple[int, FloatArray]:
    if card.name == "CMASS2":
        mass = card.real(1, "the mass")
    else:
        number = card.integer(1, "the property id", card.integer(0, "the element id"))
        if number not in properties:
            raise card.error(f"property {number} is no PMASS of the deck", f"add a PMASS card with id {number}")
        mass = properties[number]
    ends = [i for i in (2, 4) if card.text(i) not in ("", "0") and card.text(i + 1) not in ("", "0")]
    if len(ends) != 1:
        raise card.error(
            f"{len(ends)} ends on nodes: only a mass between a motion and the ground is supported",
            "leave it out (mesh.ignore), or give the mass as CONM2",
        )
    component = card.integer(ends[0] + 1, "the component")
    if not 1 <= component <= 6:
        raise card.error(f"component {component} is not one of 1 to 6", "name one component of the node")
    row = grids.nodes.row(card.integer(ends[0], "the node id"), card)
    along = np.zeros(6)
    start = 3 * ((component - 1) // 3)
    along[start : start + 3] = grids.axes.get(row, np.eye(3))[:, (component - 1) % 3]
    return row, mass * np.outer(along, along)


def _scalar_properties(cards: dict[str, list[Card]]) -> dict[int, float]:
    """PMASS id → mass; four stand on one card."""
    found: dict[int, float] = {}
    for card in cards.get("PMASS", []):
        for at in range(0, 8, 2):
            if at and not card.text(at):
                continue
            number = card.integer(at, "the property id")
            if number in found:
                raise card.error(f"property id {number} stands twice", "give every property its own id")
            found[number] = card.real(at + 1, "the mass", 0.0)
    return found
