"""Materials of a Nastran deck: MAT1, MAT8, MAT9, MAT11, and laminates of them (PCOMP)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from strainsight.decks.faults import OR_CONFIG, Doubt, elastic_fault, lamina_fault
from strainsight.decks.nastran.cards import Card
from strainsight.mesh.anisotropic import Anisotropic, constants_fault, orthotropic, stiffness_fault
from strainsight.mesh.model import Material
from strainsight.mesh.thin import Lamina, Laminate, Ply


def isotropic_material(card: Card, of_beams: bool, notes: list[str]) -> tuple[Material, float]:
    """Material of a MAT1: two of E, G, ν define the third, E = 2 (1 + ν) G, E alone ν = 0; if all three are
    inconsistent, also G over E/2(1 + ν).

    Solids and membranes use E and ν, transverse shear of shells G, beams and rods E and G. of_beams: only beams and rods use it.
    """
    number = card.text(0)
    specified = [bool(card.text(i)) for i in (1, 2, 3)]
    E, G, nu = (
        card.real(i, name, 0.0)
        for i, name in ((1, "Young's modulus E"), (2, "shear modulus G"), (3, "Poisson's ratio"))
    )
    if sum(specified) == 1 and not specified[0]:
        alone = "G (E is then 0)" if specified[1] else "NU"
        raise card.error(f"the card defines only {alone}: this is not sufficient", "specify E and NU")
    if not any(specified):
        raise card.error("the card has neither E nor G nor NU", f"specify E and NU{OR_CONFIG}")
    if specified == [True, False, False]:
        notes.append(
            Doubt(
                f"MAT1 {number} defines only E: NU = 0 and G = E/2 are used, but Nastran uses NU = 0 and G = 0 for torsion "
                "of beams and shear of shells; specify NU"
            )
        )
    if specified[1] and G <= 0:
        raise card.error(f"the shear modulus is {G:g}, not positive", "specify a positive modulus")
    if not specified[0]:
        E = 2 * (1 + nu) * G
    implied = E / (2 * G) - 1 if specified[1] else nu
    inconsistent = all(specified) and nu > -1 and abs(E / (2 * (1 + nu) * G) - 1) > 0.01
    ratio = 1.0
    if of_beams and specified[:2] == [True, True] and E > 0 and not -1 < implied < 0.5:
        ratio, nu = 2 * G / E, 0.0
        notes.append(
            f"MAT1 {number}: NU from E and G is {implied:.3g}, outside -1 to 0.5; beams and rods are not affected, because they "
            "use E and G"
        )
    elif not specified[2] or (inconsistent and of_beams):
        nu = implied
    if fault := elastic_fault(E if specified[0] else G, nu):
        raise card.error(*fault)
    if inconsistent and of_beams and ratio == 1:
        notes.append(
            f"MAT1 {number}: NU {card.text(3)} is inconsistent with E and G; only beams and rods use this material, "
            f"so NU = {nu:.4g} from E and G is used"
        )
    elif inconsistent and not of_beams:
        ratio = 2 * (1 + nu) * G / E
        notes.append(
            Doubt(
                f"MAT1 {number}: G = {G:.5g} is {ratio:.4g} times E/2(1 + NU) for E = {E:.5g} and NU = {nu:g}; "
                "solids and membranes use E and NU, transverse shear and beam torsion use G, as in Nastran"
            )
        )
    density = card.not_negative(4, "the density", 0.0)
    return Material(card.integer(0, "the material id"), E, nu, density), ratio


ANISOTROPIC = ("MAT9", "MAT11")
_DAMPING = {"MAT1": 7, "MAT2": 12, "MAT8": 16, "MAT9": 30, "MAT11": 15}
"""Card → field of GE."""


def note_damping(cards: Iterable[Card], notes: list[str]) -> None:
    """Add a note on materials with non-zero GE, by card name."""
    damped: dict[str, list[str]] = {}
    for card in cards:
        if card.real(field := _DAMPING[card.name], "the structural damping GE", 0.0):
            damped.setdefault(card.name, []).append(f"{card.name} {card.text(0)} (GE = {card.text(field)})")
    for names in damped.values():
        notes.append(f"{first_names(names)}: structural damping GE is not imported; define `damping` in the config")


def first_names(names: list[str]) -> str:
    """The first three names, and the number of others."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def solid_material(card: Card) -> Anisotropic:
    """MAT9, the upper triangle of C by rows in our order xx yy zz xy yz zx; or MAT11, engineering constants. Raises DeckError
    for a stiffness that is not positive definite, with its smallest eigenvalue, and a negative density."""
    if card.name == "MAT9":
        rows, columns = np.triu_indices(6)
        C = np.zeros((6, 6))
        for i, (a, b) in enumerate(zip(rows.tolist(), columns.tolist(), strict=True), start=1):
            C[a, b] = C[b, a] = card.real(i, f"G{a + 1}{b + 1}", 0.0)
        fault, place = stiffness_fault(C), 22
    else:
        names = ("E1", "E2", "E3", "NU12", "NU13", "NU23", "G12", "G13", "G23")
        constants = [card.real(i, name) for i, name in enumerate(names, start=1)]
        triples = constants[:3], constants[3:6], constants[6:]
        fault, place = constants_fault(*triples), 10
        C = np.zeros((6, 6)) if fault else orthotropic(*triples)
    if fault:
        raise card.error(*fault)
    return Anisotropic(card.integer(0, "the material id"), C, card.not_negative(place, "the density", 0.0))


COMPOSITES = ("PCOMP", "PCOMPG")
_FIRST = 8
"""First field of the plies."""


def laminate(card: Card) -> Laminate:
    """PCOMP or PCOMPG: plies from the bottom up, mirrored for LAM SYM; blank material and thickness repeat the previous ply.

    `middle_of` computes the offset. Raises DeckError for a card without plies, a ply without material or thickness,
    and for LAM MEM, BEND, SMEAR and SMCORE."""
    kind = card.text(7).upper()
    if kind not in ("", "SYM"):
        raise card.error(
            f"LAM is {kind}: only complete (blank) and symmetric (SYM) laminates are supported",
            "leave LAM blank and specify all plies",
        )
    nonstructural = card.not_negative(2, "the nonstructural mass NSM", 0.0)
    step, at = (8, 1) if card.name == "PCOMPG" else (4, 0)
    plies = plies_of(card, step, at)
    return Laminate((*plies, *reversed(plies)) if kind == "SYM" else plies, nonstructural)


def plies_of(card: Card, step: int, at: int) -> tuple[Ply, ...]:
    """Material, thickness and angle of each ply, in groups of `step` fields from field `at`; blank material and thickness repeat
    the previous ply. Raises DeckError for a ply without material or thickness, and if there are no plies."""
    plies: list[Ply] = []
    for start in range(_FIRST, len(card.tokens), step):
        if not any(card.text(i) for i in range(start, start + step)):
            continue
        i, number = start + at, len(plies) + 1
        before = plies[-1] if plies else None
        material = card.integer(i, f"the material of ply {number}", before.material if before else None)
        t = card.positive(i + 1, f"the thickness of ply {number}", before.thickness if before else None)
        plies.append(Ply(material, t, card.real(i + 2, f"the angle of ply {number}", 0.0)))
    if not plies:
        raise card.error("the laminate has no plies", "specify material, thickness and angle of each ply")
    return tuple(plies)


def lamina(card: Card) -> Lamina:
    """MAT8; rigid in transverse shear without G1Z or G2Z. Raises DeckError for non-positive moduli and NU12² ≥ E1/E2."""
    names = ("E1", "E2", "NU12", "G12", "G1Z", "G2Z")
    e1, e2, nu12, g12, g1z, g2z = (card.real(i, name, 0.0 if i > 4 else None) for i, name in enumerate(names, start=1))
    g1z, g2z = g1z or np.inf, g2z or np.inf
    if fault := lamina_fault({"E1": e1, "E2": e2, "G12": g12, "G1Z": g1z, "G2Z": g2z}, nu12):
        raise card.error(*fault)
    density = card.not_negative(7, "the density", 0.0)
    return Lamina(card.integer(0, "the material id"), e1, e2, nu12, g12, g1z, g2z, density)
