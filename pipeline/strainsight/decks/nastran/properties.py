"""Properties of solids of a Nastran deck (PSOLID), and the materials (MAT1) of all regions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.decks.faults import OR_CONFIG, elastic_fault
from strainsight.decks.nastran.cards import Card, unique_ids
from strainsight.decks.nastran.composites import lamina
from strainsight.decks.nastran.grids import resolved_system
from strainsight.decks.nastran.solids import SOLIDS
from strainsight.decks.nastran.thin import PROPERTIES, Section, Thin
from strainsight.mesh.coordinates import CoordinateSystem
from strainsight.mesh.laminates import Lamina
from strainsight.mesh.model import CellBlock, Material, Region
from strainsight.mesh.thin import BeamSection, ShellSection


@dataclass(frozen=True)
class Properties:
    """Of a deck, by their ids: regions, isotropic materials, those of plies, and sections of shells and beams."""

    regions: dict[int, Region]
    materials: dict[int, Material]
    laminae: dict[int, Lamina]
    sections: dict[int, Section]


def properties(
    cards: dict[str, list[Card]],
    blocks: Sequence[CellBlock],
    thin: Thin,
    systems: dict[int, CoordinateSystem],
    ignored: Counter[str],
    notes: list[str],
    stated: bool,
) -> Properties:
    """PSOLID and what shells and beams refer to → regions, the MAT1 and MAT8 that they and their plies refer to, and sections,
    with the G of a MAT1 that contradicts its E and NU; without either a region of solids has no material, unless it has to be
    stated.

    Raises DeckError for an id that stands twice, a property or material that is not there or of another kind, and fluids.
    """
    solids = cards.get("PSOLID", [])
    used = {(card.name, pid) for pid, card in thin.properties.items()}
    own = [card for name in PROPERTIES for card in cards.get(name, []) if (name, card.integer(0, "the id")) in used]
    unique_ids([*solids, *own], "property")
    regions, named = {}, []
    schemes = []
    for card in solids:
        pid, mid = card.integer(0, "the property id"), card.integer(1, "the material id")
        if card.text(6).upper() not in ("", "SMECH"):
            raise card.error(f"FCTN is {card.text(6)}: only structural solids are supported", "remove the fluid part")
        if card.text(2) != "-1":
            resolved_system(card, 2, systems)
        if card.text(3) or card.text(5):
            schemes.append(f"{pid} (IN {card.text(3) or 'blank'}, ISOP {card.text(5) or 'blank'})")
        regions[pid] = Region(pid, f"PSOLID {pid}", mid)
        named.append((card, mid))
    if schemes:
        notes.append(
            f"PSOLID {_some(schemes)}: the integration scheme is not supported: solids are integrated fully, linear "
            "hexahedra with incompatible modes"
        )
    in_solids = {mid for _, mid in named}
    of_plies: list[tuple[Card, int]] = []
    for pid, card in thin.properties.items():
        regions[pid] = Region(pid, f"{card.name} {card.integer(0, 'the id')}", thin.materials[pid])
        if thin.materials[pid]:
            named.append((card, thin.materials[pid]))
        else:
            of_plies += [(card, mid) for mid in dict.fromkeys(thin.named(pid))]
    laminae = _laminae(cards, of_plies, ignored, notes)
    named += [(card, mid) for card, mid in of_plies if mid not in laminae]
    materials, shear = _materials(cards, named, thin.only_beams - in_solids, ignored, notes, stated)
    sections = {pid: _with_shear(own, shear.get(thin.materials[pid], 1.0)) for pid, own in thin.sections.items()}
    for block in blocks:
        missing = ~np.isin(block.region, [card.integer(0, "the property id") for card in solids])
        if missing.any() and not stated and not np.isin(block.region[missing], list(thin.properties)).any():
            regions |= {int(pid): Region(int(pid), f"PSOLID {pid}", 0) for pid in np.unique(block.region[missing])}
        elif missing.any():
            i = int(np.argmax(missing))
            card = next(c for name in SOLIDS for c in cards.get(name, []) if int(c.fields[0]) == block.ids[i])
            raise card.error(
                f"property {block.region[i]} is no PSOLID of the deck ({int(missing.sum())} {block.kind} elements)",
                f"add a PSOLID card with id {block.region[i]}{OR_CONFIG}",
            )
    return Properties(regions, materials, laminae, sections)


def _laminae(
    cards: dict[str, list[Card]], named: Sequence[tuple[Card, int]], ignored: Counter[str], notes: list[str]
) -> dict[int, Lamina]:
    """The MAT8 that plies name. Raises DeckError for a material of plies that is neither a MAT8 nor a MAT1 of the deck."""
    orthotropic, isotropic = cards.get("MAT8", []), cards.get("MAT1", [])
    own = dict(zip(unique_ids(orthotropic, "material").tolist(), orthotropic, strict=True))
    both = set(own) & set(unique_ids(isotropic, "material").tolist())
    if both & {mid for _, mid in named}:
        number = min(both & {mid for _, mid in named})
        raise own[number].error(
            f"material id {number} stands twice, a MAT1 has it too", "give every material its own id"
        )
    known = {*own, *(card.integer(0, "the material id") for card in isotropic)}
    for card, mid in named:
        if mid not in known:
            other = next((n for n in cards if n.startswith("MAT") and any(c.text(0) == str(mid) for c in cards[n])), "")
            raise card.error(
                f"material {mid} of its plies is {'a ' + other if other else 'not in the deck'}",
                "give plies a MAT8 or a MAT1" if other else f"add a MAT8 or MAT1 card with id {mid}",
            )
    found = {mid: lamina(own[mid]) for _, mid in named if mid in own}
    if damped := [f"{i} (GE {own[i].text(16)})" for i in found if own[i].real(16, "the structural damping GE", 0.0)]:
        notes.append(f"MAT8 {_some(damped)}: structural damping GE is not imported: damping comes from the config")
    if rigid := [str(i) for i, each in found.items() if np.isinf(each.g1z) or np.isinf(each.g2z)]:
        notes.append(f"MAT8 {_some(rigid)}: without G1Z or G2Z it does not shear across")
    if unused := len(own) - len(found):
        ignored["MAT8 that no property refers to"] += unused
    return found


def _materials(
    cards: dict[str, list[Card]],
    named: Sequence[tuple[Card, int]],
    only_beams: Collection[int],
    ignored: Counter[str],
    notes: list[str],
    stated: bool,
) -> tuple[dict[int, Material], dict[int, float]]:
    """The MAT1 that properties name, and of those whose G is another than E/2(1 + ν) the first over the second; only_beams: ids
    of those of beams and rods alone."""
    isotropic = cards.get("MAT1", [])
    material_cards = dict(zip(unique_ids(isotropic, "material").tolist(), isotropic, strict=True))
    materials: dict[int, Material] = {}
    shear: dict[int, float] = {}
    damped: list[str] = []
    for card, mid in named:
        if mid not in material_cards:
            other = [
                name for name in cards if name.startswith("MAT") and any(c.text(0) == str(mid) for c in cards[name])
            ]
            if other or stated:
                raise card.error(
                    f"material {mid} is {'a ' + other[0] if other else 'not in the deck'}",
                    "give it a MAT1, or shells a MAT8" if other else f"add a MAT1 card with id {mid}{OR_CONFIG}",
                )
        elif mid not in materials:
            materials[mid], shear[mid] = _material(material_cards[mid], mid in only_beams, notes)
            if material_cards[mid].real(7, "the structural damping GE", 0.0) != 0:
                damped.append(f"{mid} (GE {material_cards[mid].text(7)})")
    if damped:
        notes.append(f"MAT1 {_some(damped)}: structural damping GE is not imported: damping comes from the config")
    if unused := len(material_cards) - len(materials):
        ignored["MAT1 that no property refers to"] += unused
    return materials, shear


def _some(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _with_shear(section: Section, ratio: float) -> Section:
    """The section with G of its material times `ratio`: across a shell, in torsion and across a beam."""
    if ratio == 1:
        return section
    if isinstance(section, BeamSection):
        return _twisted(section, ratio)
    return replace(section, shear=ratio * section.shear) if isinstance(section, ShellSection) else section


def _twisted(section: BeamSection, ratio: float) -> BeamSection:
    at_b = None if section.at_b is None else _twisted(section.at_b, ratio)
    y, z = section.shear
    return replace(section, torsion=ratio * section.torsion, shear=(ratio * y, ratio * z), at_b=at_b)


def _material(card: Card, of_beams: bool, notes: list[str]) -> tuple[Material, float]:
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
        raise card.error("needs E, and G or NU", "give E and NU")
    if given == [True, False, False]:
        notes.append(
            f"MAT1 {number} states E alone: NU = 0, as in Nastran, so that it does not contract sideways, and G = E/2, where "
            "Nastran has G = 0 in torsion of beams and in shear across shells; give NU if it should be another"
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
            f"MAT1 {number}: G = {G:.5g} is {ratio:.4g} times E/2(1 + NU), which E = {E:.5g} and NU = {nu:g} give: solids, and "
            "shells in their plane, have E and NU, shear across shells and torsion of beams have G, as in Nastran"
        )
    density = card.real(4, "the density", 0.0)
    if density < 0:
        raise card.error(f"the density is {density:g}, negative", "give a positive density")
    return Material(card.integer(0, "the material id"), E, nu, density), ratio
