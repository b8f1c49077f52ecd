"""Laminates of a Nastran deck: PCOMP, PCOMPG, and PSHELL of an orthotropic material; MAT8."""

from __future__ import annotations

import numpy as np

from strainsight.decks.faults import lamina_fault
from strainsight.decks.nastran.cards import Card
from strainsight.mesh.laminates import Lamina, Laminate, Ply
from strainsight.mesh.thin import ShellSection

COMPOSITES = ("PCOMP", "PCOMPG")
_FIRST = 8
"""Field at which the plies begin."""


def laminate(card: Card) -> Laminate:
    """PCOMP or PCOMPG: plies from the lower face up, mirrored for LAM SYM; blank material and thickness are those before.

    Where its middle is, `middle_of` says. Raises DeckError for a card without plies or with one that has no material or no
    thickness, and for LAM MEM, BEND, SMEAR and SMCORE.
    """
    kind = card.text(7).upper()
    if kind not in ("", "SYM"):
        raise card.error(
            f"LAM is {kind}: only whole laminates and symmetric ones (SYM) are supported",
            "leave LAM blank and write all plies out",
        )
    nonstructural = card.real(2, "the mass NSM", 0.0)
    if nonstructural < 0:
        raise card.error(f"the mass NSM is {nonstructural:g}, negative", "give a positive mass")
    step, at = (8, 1) if card.name == "PCOMPG" else (4, 0)
    plies = plies_of(card, step, at)
    return Laminate((*plies, *reversed(plies)) if kind == "SYM" else plies, nonstructural)


def plies_of(card: Card, step: int, at: int) -> tuple[Ply, ...]:
    """Material, thickness and angle of each ply, which begin in field `at` of `step` fields; blank material and thickness are
    those before. Raises DeckError for a ply that has no material or no thickness, and where there are none."""
    plies: list[Ply] = []
    for start in range(_FIRST, len(card.fields), step):
        if not any(card.text(i) for i in range(start, start + step)):
            continue
        i, number = start + at, len(plies) + 1
        before = plies[-1] if plies else None
        material = card.integer(i, f"the material of ply {number}", before.material if before else None)
        t = card.real(i + 1, f"the thickness of ply {number}", before.thickness if before else None)
        if not t > 0:
            raise card.error(f"the thickness of ply {number} is {t:g}, not positive", "give a positive thickness")
        plies.append(Ply(material, t, card.real(i + 2, f"the angle of ply {number}", 0.0)))
    if not plies:
        raise card.error("it has no plies", "give the material, thickness and angle of each from the second line on")
    return tuple(plies)


def middle_of(card: Card, own: Laminate) -> float:
    """From the plane of the elements to the middle of a laminate: Z0, of its lower face, and half its thickness; 0 by default."""
    return card.real(1, "the place Z0 of the lower face", -0.5 * own.thickness) + 0.5 * own.thickness


def one_ply(material: int, own: ShellSection) -> Laminate:
    """PSHELL of one orthotropic material in MID1, MID2 and MID3, homogeneous."""
    return Laminate((Ply(material, own.thickness),), own.nonstructural)


def lamina(card: Card) -> Lamina:
    """MAT8; without G1Z or G2Z it does not shear across. Raises DeckError for moduli not positive, and NU12² ≥ E1/E2."""
    names = ("E1", "E2", "NU12", "G12", "G1Z", "G2Z")
    e1, e2, nu12, g12, g1z, g2z = (card.real(i, name, 0.0 if i > 4 else None) for i, name in enumerate(names, start=1))
    g1z, g2z = g1z or np.inf, g2z or np.inf
    if fault := lamina_fault({"E1": e1, "E2": e2, "G12": g12, "G1Z": g1z, "G2Z": g2z}, nu12):
        raise card.error(*fault)
    density = card.real(7, "the density", 0.0)
    if density < 0:
        raise card.error(f"the density is {density:g}, negative", "give a positive density")
    return Lamina(card.integer(0, "the material id"), e1, e2, nu12, g12, g1z, g2z, density)
