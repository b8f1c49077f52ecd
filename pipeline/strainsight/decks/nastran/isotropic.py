"""MAT1 of a Nastran deck."""

from __future__ import annotations

from strainsight.decks.faults import OR_CONFIG, Doubt, elastic_fault
from strainsight.decks.nastran.cards import Card
from strainsight.mesh.model import Material


def states_moduli(card: Card) -> bool:
    """Whether a MAT1 says E, G or ν; mesh generators write it blank."""
    return any(card.text(i) for i in (1, 2, 3))


def isotropic_material(card: Card, of_beams: bool, notes: list[str]) -> tuple[Material, float]:
    """MAT1: two of E, G, ν give the third, E = 2 (1 + ν) G, E alone ν = 0; of three that contradict this, G over E/2(1 + ν).

    Solids, and shells in their plane, have E and ν, shells across it G; beams and rods E and G, and no ν. of_beams: alone.
    """
    number = card.text(0)
    given = [bool(card.text(i)) for i in (1, 2, 3)]
    E, G, nu = (
        card.real(i, name, 0.0)
        for i, name in ((1, "Young's modulus E"), (2, "shear modulus G"), (3, "Poisson's ratio"))
    )
    if sum(given) == 1 and not given[0]:
        alone = "G alone, and E is 0 then" if given[1] else "NU alone"
        raise card.error(f"states {alone}: nothing can be made of it", "give E and NU")
    if not any(given):
        raise card.error("needs E, and G or NU", f"give E and NU{OR_CONFIG}")
    if given == [True, False, False]:
        notes.append(
            Doubt(
                f"MAT1 {number} states E alone: NU = 0, as in Nastran, so that it does not contract sideways, and G = E/2, where "
                "Nastran has G = 0 in torsion of beams and in shear across shells; give NU if it should be another"
            )
        )
    if given[1] and G <= 0:
        raise card.error(f"the shear modulus is {G:g}, not positive", "give a positive modulus")
    if not given[0]:
        E = 2 * (1 + nu) * G
    implied = E / (2 * G) - 1 if given[1] else nu
    contradicts = all(given) and nu > -1 and abs(E / (2 * (1 + nu) * G) - 1) > 0.01
    ratio = 1.0
    if of_beams and given[:2] == [True, True] and E > 0 and not -1 < implied < 0.5:
        ratio, nu = 2 * G / E, 0.0
        notes.append(
            f"MAT1 {number}: E and G of its beams and rods are those of no NU between -1 and 0.5: both are taken"
        )
    elif not given[2] or (contradicts and of_beams):
        nu = implied
    if fault := elastic_fault(E if given[0] else G, nu):
        raise card.error(*fault)
    if contradicts and of_beams and ratio == 1:
        notes.append(
            f"MAT1 {number}: NU {card.text(3)} does not go with E and G, which are all that beams and rods need: {nu:.4g}"
        )
    elif contradicts and not of_beams:
        ratio = 2 * (1 + nu) * G / E
        notes.append(
            Doubt(
                f"MAT1 {number}: G = {G:.5g} is {ratio:.4g} times E/2(1 + NU), which E = {E:.5g} and NU = {nu:g} give: solids, "
                "and shells in their plane, have E and NU, shear across shells and torsion of beams have G, as in Nastran"
            )
        )
    density = card.real(4, "the density", 0.0)
    if density < 0:
        raise card.error(f"the density is {density:g}, negative", "give a positive density")
    return Material(card.integer(0, "the material id"), E, nu, density), ratio
