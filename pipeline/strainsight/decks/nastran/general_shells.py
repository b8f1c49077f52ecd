"""PSHELL whose membrane, bending and shear are of different or anisotropic materials: MAT1, MAT2 and MAT8."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from strainsight.decks.nastran.cards import Card
from strainsight.decks.nastran.composites import lamina
from strainsight.decks.nastran.isotropic import isotropic_material
from strainsight.decks.nastran.shells import shell_section
from strainsight.mesh.anisotropic import general_fault
from strainsight.mesh.model import FloatArray
from strainsight.mesh.thin import GeneralShell

_PLACES = {1: "MID1", 3: "MID2 (bending)", 5: "MID3 (shear)", 10: "MID4 (coupling)"}
"""Field of a material → its name."""
_DAMPING = {"MAT1": 7, "MAT2": 12, "MAT8": 16}
"""Field of GE."""


def shell_materials(cards: Mapping[str, Sequence[Card]]) -> dict[int, list[Card]]:
    """Id → the MAT1, MAT2 and MAT8 of a deck that have it."""
    found: dict[int, list[Card]] = {}
    for card in (card for name in ("MAT1", "MAT2", "MAT8") for card in cards.get(name, [])):
        found.setdefault(card.integer(0, "the material id"), []).append(card)
    return found


def materials_of(card: Card) -> dict[int, int]:
    """Field → id of the materials that a PSHELL names, without those that are blank or 0."""
    return {i: card.integer(i, f"the material {what}") for i, what in _PLACES.items() if card.text(i) not in ("", "0")}


def is_general(card: Card, known: Mapping[int, Sequence[Card]]) -> bool:
    """Whether a PSHELL is neither of one MAT1, as `ShellSection` is, nor of one MAT8 as a laminate of one ply."""
    named = materials_of(card)
    if 1 not in named or named.get(3) == -1:
        return False  # `shell_section` refuses it
    first = {own.name for own in known.get(named[1], [])}
    if 10 in named or len(set(named.values())) > 1:
        return True
    if "MAT8" in first:
        uniform = card.real(4, "12 I/T³", 1.0) == 1 and np.isclose(card.real(6, "TS/T", 5 / 6), 5 / 6, rtol=1e-3)
        return not ({3, 5} <= set(named) and uniform)
    return "MAT2" in first


def general_shell(card: Card, known: Mapping[int, Sequence[Card]], notes: list[str]) -> GeneralShell:
    """M = G₁, C = −G₄, D = (12 I/T³) G₂ and S = (T_s/T) G₃ of `GeneralShell`, G of the materials MID1, MID4, MID2, MID3.

    The curvature χ of Nastran is −κ, strain ε − zχ, so that G₄ = ∫ −z G dz/T² of plies. Without MID2 it does not bend, without
    MID3 not shear. The density is that of MID1.
    Raises DeckError for a material that is not there or none of a shell, MID3 without MID2, MID4 without both, and a stiffness
    that is not positive definite.
    """
    _, plain = shell_section(card)
    named = materials_of(card)
    own = {i: _card(card, what, named[i], known) for i, what in _PLACES.items() if i in named}
    if (5 in own and 3 not in own) or (10 in own and not {3, 5} <= set(own)):
        raise card.error(
            "MID3 stands without MID2" if 3 not in own else "MID4 stands without MID3", "give them, or leave both blank"
        )
    said: list[str] = []
    membrane, zero = _plane(own[1], said), np.zeros((3, 3))
    bending = plain.bending * _plane(own[3], said) if 3 in own else zero
    coupling = -_plane(own[10], said) if 10 in own else zero
    shear = np.diag([np.inf, np.inf] if 3 in own else [0.0, 0.0])
    if 5 in own:
        shear = plain.shear * _across(own[5], said)
    for material in own.values():
        if ge := material.real(_DAMPING[material.name], "the structural damping GE", 0.0):
            said.append(
                f"{material.name} {material.text(0)} (GE {ge:g}): structural damping GE is not imported: damping comes from the "
                "config"
            )
    notes += [note for note in dict.fromkeys(said) if note not in notes]
    density = own[1].real(4 if own[1].name == "MAT1" else 7, "the density", 0.0)
    if density < 0:
        raise own[1].error(f"the density is {density:g}, negative", "give a positive density")
    uniform = 10 not in named and named.get(3, named[1]) == named[1]
    shell = GeneralShell(plain.thickness, membrane, coupling, bending, shear, density, uniform, plain.nonstructural)
    if fault := general_fault(shell):
        raise card.error(*fault)
    return shell


def _card(card: Card, what: str, number: int, known: Mapping[int, Sequence[Card]]) -> Card:
    found = known.get(number, [])
    if not found:
        raise card.error(
            f"material {number} of {what} is no MAT1, MAT2 or MAT8 of the deck", f"add the card, with id {number}"
        )
    if len(found) > 1:
        raise found[1].error(
            f"material id {number} stands twice (first at {found[0].where})", "give every material its own id"
        )
    return found[0]


def _plane(card: Card, notes: list[str]) -> FloatArray:
    """G (3, 3) of σ = G ε in plane stress, xx yy xy."""
    if card.name == "MAT2":
        G = np.zeros((3, 3))
        for k, (i, j) in enumerate(zip(*np.triu_indices(3), strict=True), start=1):
            G[i, j] = G[j, i] = card.real(k, f"G{i + 1}{j + 1}", 0.0)
        return G
    if card.name == "MAT8":
        ply = lamina(card)
        e1, e2, nu12, g12 = ply.e1, ply.e2, ply.nu12, ply.g12
    else:
        same, _ = isotropic_material(card, False, notes)
        e1 = e2 = same.youngs_modulus
        nu12, g12 = same.poisson_ratio, same.youngs_modulus / (2 * (1 + same.poisson_ratio))
    S = np.array([[1 / e1, -nu12 / e1, 0.0], [-nu12 / e1, 1 / e2, 0.0], [0.0, 0.0, 1 / g12]])
    return np.asarray(np.linalg.inv(S))


def _across(card: Card, notes: list[str]) -> FloatArray:
    """G (2, 2) of shear across, xz yz: G11, G12 and G22 of a MAT2, G1Z and G2Z of a MAT8, G of a MAT1."""
    if card.name == "MAT2":
        a, b, c = (card.real(i, name, 0.0) for i, name in ((1, "G11"), (2, "G12"), (4, "G22")))
        return np.array([[a, b], [b, c]])
    if card.name == "MAT8":
        ply = lamina(card)
        return np.diag([ply.g1z, ply.g2z])
    same, ratio = isotropic_material(card, False, notes)
    return np.asarray(ratio * same.youngs_modulus / (2 * (1 + same.poisson_ratio)) * np.eye(2))
