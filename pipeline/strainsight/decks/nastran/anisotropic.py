"""Anisotropic materials of solids of a Nastran deck: MAT9, MAT11."""

from __future__ import annotations

import numpy as np

from strainsight.decks.nastran.cards import Card
from strainsight.mesh.anisotropic import Anisotropic, constants_fault, orthotropic, stiffness_fault

ANISOTROPIC = ("MAT9", "MAT11")
_DAMPING = {"MAT9": 30, "MAT11": 15}
"""Field of GE."""


def solid_material(card: Card) -> Anisotropic:
    """MAT9, the upper triangle of C by rows in the order xx yy zz xy yz zx, which is ours; or MAT11, engineering constants.

    Raises DeckError for a stiffness that is not positive definite, with its least eigenvalue, and a negative density.
    """
    if card.name == "MAT9":
        rows, columns = np.triu_indices(6)
        C = np.zeros((6, 6))
        for i, (a, b) in enumerate(zip(rows.tolist(), columns.tolist(), strict=True), start=1):
            C[a, b] = C[b, a] = card.real(i, f"G{a + 1}{b + 1}", 0.0)
        fault, density = stiffness_fault(C), card.real(22, "the density", 0.0)
    else:
        names = ("E1", "E2", "E3", "NU12", "NU13", "NU23", "G12", "G13", "G23")
        constants = [card.real(i, name) for i, name in enumerate(names, start=1)]
        triples = constants[:3], constants[3:6], constants[6:]
        fault, density = constants_fault(*triples), card.real(10, "the density", 0.0)
        C = np.zeros((6, 6)) if fault else orthotropic(*triples)
    if fault:
        raise card.error(*fault)
    if density < 0:
        raise card.error(f"the density is {density:g}, negative", "give a positive density")
    return Anisotropic(card.integer(0, "the material id"), C, density)


def damped(card: Card) -> str:
    """GE of a material where it is not zero, in words."""
    field = _DAMPING[card.name]
    return f"{card.text(0)} (GE {card.text(field)})" if card.real(field, "the structural damping GE", 0.0) else ""
