"""Properties of solids of a Nastran deck (PSOLID, PCOMPS), and the materials (MAT1, MAT9, MAT11) of all regions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.decks.faults import OR_CONFIG
from strainsight.decks.nastran.cards import Card, unique_ids
from strainsight.decks.nastran.grids import resolved_system
from strainsight.decks.nastran.materials import (
    ANISOTROPIC,
    isotropic_material,
    lamina,
    note_damping,
    solid_material,
    some,
    states_moduli,
)
from strainsight.decks.nastran.solids import SOLIDS, composite_solid, layers_of
from strainsight.decks.nastran.thin import PROPERTIES, Section, Thin
from strainsight.mesh.anisotropic import Anisotropic, CompositeSolid, Orientation
from strainsight.mesh.coordinates import CoordinateSystem
from strainsight.mesh.model import CellBlock, FloatArray, Material, Region
from strainsight.mesh.thin import BeamSection, Lamina, ShellSection


@dataclass(frozen=True)
class Properties:
    """Of a deck, by their ids: regions, isotropic materials, those of plies, anisotropic ones of solids, how their axes lie in
    regions, layers of regions of composite solids, and sections of shells and beams."""

    regions: dict[int, Region]
    materials: dict[int, Material]
    laminae: dict[int, Lamina]
    anisotropic: dict[int, Anisotropic]
    orientations: dict[int, Orientation]
    composites: dict[int, CompositeSolid]
    sections: dict[int, Section]


def properties(
    cards: dict[str, list[Card]],
    blocks: Sequence[CellBlock],
    position: FloatArray,
    thin: Thin,
    systems: dict[int, CoordinateSystem],
    ignored: Counter[str],
    notes: list[str],
    stated: bool,
) -> Properties:
    """PSOLID, and what composite solids, shells and beams refer to → regions, the materials that they and their plies refer to,
    and sections, with the G of a MAT1 that contradicts its E and NU; without either a region of solids has no material, unless it
    has to be stated.

    Raises DeckError for an id that stands twice, a property or material that is not there or of another kind, and fluids.
    """
    solids = cards.get("PSOLID", [])
    layered = _layered(cards, blocks, ignored)
    used = {(card.name, pid) for pid, card in thin.properties.items()}
    own = [card for name in PROPERTIES for card in cards.get(name, []) if (name, card.integer(0, "the id")) in used]
    unique_ids([*solids, *layered.values(), *own], "property")
    regions, named = {}, []
    plies = {pid: layers_of(card) for pid, card in layered.items()}
    in_solids = [card.integer(1, "the material id") for card in solids]
    in_solids += [ply.material for own in plies.values() for ply in own]
    anisotropic = _anisotropic(cards, in_solids, ignored, notes)
    orientations: dict[int, Orientation] = {}
    schemes = []
    for card in solids:
        pid, mid = card.integer(0, "the property id"), card.integer(1, "the material id")
        if card.text(6).upper() not in ("", "SMECH"):
            raise card.error(f"FCTN is {card.text(6)}: only structural solids are supported", "remove the fluid part")
        if mid in anisotropic:
            orientations[pid] = _orientation(card, mid, systems)
        elif card.text(2) != "-1":
            resolved_system(card, 2, systems)
        if card.text(3) or card.text(5):
            schemes.append(f"{pid} (IN {card.text(3) or 'blank'}, ISOP {card.text(5) or 'blank'})")
        regions[pid] = Region(pid, f"PSOLID {pid}", mid)
        if mid not in anisotropic:
            named.append((card, mid))
    if schemes:
        notes.append(
            f"PSOLID {some(schemes)}: the integration scheme is not supported: solids are integrated fully, linear "
            "hexahedra with incompatible modes"
        )
    composites: dict[int, CompositeSolid] = {}
    for pid, card in layered.items():
        regions[pid] = Region(pid, f"PCOMPS {pid}", 0)
        composites[pid] = composite_solid(card, plies[pid], anisotropic, blocks, position, systems, notes)
        named += [(card, mid) for mid in dict.fromkeys(ply.material for ply in plies[pid]) if mid not in anisotropic]
    of_plies: list[tuple[Card, int]] = []
    for pid, card in thin.properties.items():
        regions[pid] = Region(pid, f"{card.name} {card.integer(0, 'the id')}", thin.materials[pid])
        if thin.materials[pid]:
            named.append((card, thin.materials[pid]))
        elif pid not in thin.general:
            of_plies += [(card, mid) for mid in dict.fromkeys(thin.named(pid))]
    in_general = {mid for named in thin.general.values() for mid in named}
    laminae = _laminae(cards, of_plies, in_general, ignored, notes)
    named += [(card, mid) for card, mid in of_plies if mid not in laminae]
    materials, shear = _materials(cards, named, thin.only_beams - {*in_solids}, in_general, ignored, notes, stated)
    sections = {pid: _with_shear(own, shear.get(thin.materials[pid], 1.0)) for pid, own in thin.sections.items()}
    for block in blocks:
        missing = ~np.isin(block.region, [*(card.integer(0, "the property id") for card in solids), *layered])
        if missing.any() and not stated and not np.isin(block.region[missing], list(thin.properties)).any():
            regions |= {int(pid): Region(int(pid), f"PSOLID {pid}", 0) for pid in np.unique(block.region[missing])}
        elif missing.any():
            i = int(np.argmax(missing))
            card = next(c for name in SOLIDS for c in cards.get(name, []) if int(c.fields[0]) == block.ids[i])
            raise card.error(
                f"property {block.region[i]} is no PSOLID of the deck ({int(missing.sum())} {block.kind} elements)",
                f"add a PSOLID card with id {block.region[i]}{OR_CONFIG}",
            )
    return Properties(regions, materials, laminae, anisotropic, orientations, composites, sections)


def _layered(cards: dict[str, list[Card]], blocks: Sequence[CellBlock], ignored: Counter[str]) -> dict[int, Card]:
    """The PCOMPS that solids refer to, by their ids; others are counted."""
    found, used = {}, {int(number) for block in blocks for number in np.unique(block.region)}
    for card in cards.get("PCOMPS", []):
        if (pid := card.integer(0, "the property id")) not in used:
            ignored["PCOMPS that no element refers to"] += 1
        elif pid in found:
            raise card.error(f"property id {pid} stands twice", "give every property its own id")
        else:
            found[pid] = card
    return found


def _orientation(card: Card, mid: int, systems: dict[int, CoordinateSystem]) -> Orientation:
    """CORDM of a PSOLID of an anisotropic material: blank or 0 the basic system, or one of the deck."""
    if card.text(2) == "-1":
        raise card.error(
            f"CORDM is -1, the axes of each element, and material {mid} is anisotropic: not supported, as codes define these "
            "axes differently",
            "name a coordinate system (CORD2R, CORD2C, CORD2S) along the material, or 0 for the basic one",
        )
    return Orientation(resolved_system(card, 2, systems), np.eye(3))


def _by_id(cards: dict[str, list[Card]], *names: str) -> dict[int, Card]:
    """The materials on cards of these names. Raises DeckError for an id that stands twice."""
    own = [card for name in names for card in cards.get(name, [])]
    return dict(zip(unique_ids(own, "material").tolist(), own, strict=True))


def _other_material(cards: dict[str, list[Card]], mid: int) -> str:
    """What card has the id of a material: "a MAT10", or "" for none."""
    name = next((n for n in cards if n.startswith("MAT") and any(c.text(0) == str(mid) for c in cards[n])), "")
    return name and f"a {name}"


def _anisotropic(
    cards: dict[str, list[Card]], named: Sequence[int], ignored: Counter[str], notes: list[str]
) -> dict[int, Anisotropic]:
    """The MAT9 and MAT11 that solids name, by id. Raises DeckError for an id of one of those that stands twice."""
    by_id = _by_id(cards, *ANISOTROPIC)
    others = {card.text(0): card.name for name in ("MAT1", "MAT8") for card in cards.get(name, [])}
    used = {}
    for mid in dict.fromkeys(named):
        if mid not in by_id:
            continue
        if str(mid) in others:
            raise by_id[mid].error(
                f"material id {mid} stands twice, a {others[str(mid)]} has it too", "give every material its own id"
            )
        used[mid] = solid_material(by_id[mid])
    note_damping((by_id[mid] for mid in used), notes)
    for name in ANISOTROPIC:
        if unused := sum(card.name == name for number, card in by_id.items() if number not in used):
            ignored[f"{name} that no solid refers to"] += unused
    return used


def _laminae(
    cards: dict[str, list[Card]],
    named: Sequence[tuple[Card, int]],
    in_general: Collection[int],
    ignored: Counter[str],
    notes: list[str],
) -> dict[int, Lamina]:
    """The MAT8 that plies name; in_general: ids of materials that shells of several have taken, for those that nothing refers to,
    MAT2 too. Raises DeckError for a material of plies that is neither a MAT8 nor a MAT1 of the deck."""
    own = _by_id(cards, "MAT8")
    both = set(own) & set(_by_id(cards, "MAT1"))
    if both & {mid for _, mid in named}:
        number = min(both & {mid for _, mid in named})
        raise own[number].error(
            f"material id {number} stands twice, a MAT1 has it too", "give every material its own id"
        )
    known = {*own, *_by_id(cards, "MAT1")}
    for card, mid in named:
        if mid not in known:
            other = _other_material(cards, mid)
            raise card.error(
                f"material {mid} of its plies is {other or 'not in the deck'}",
                "give plies a MAT8 or a MAT1" if other else f"add a MAT8 or MAT1 card with id {mid}",
            )
    found = {mid: lamina(own[mid]) for _, mid in named if mid in own}
    note_damping((own[mid] for mid in found), notes)
    if rigid := [str(i) for i, each in found.items() if np.isinf(each.g1z) or np.isinf(each.g2z)]:
        notes.append(f"MAT8 {some(rigid)}: without G1Z or G2Z it does not shear across")
    for name, ids in (("MAT8", own), ("MAT2", _by_id(cards, "MAT2"))):
        if unused := len({*ids} - {*found} - {*in_general}):
            ignored[f"{name} that no property refers to"] += unused
    return found


def _materials(
    cards: dict[str, list[Card]],
    named: Sequence[tuple[Card, int]],
    only_beams: Collection[int],
    in_general: Collection[int],
    ignored: Counter[str],
    notes: list[str],
    stated: bool,
) -> tuple[dict[int, Material], dict[int, float]]:
    """The MAT1 that properties name, and of those whose G is another than E/2(1 + ν) the first over the second; only_beams: ids
    of those of beams and rods alone; in_general: of those that shells of several materials have taken."""
    material_cards = _by_id(cards, "MAT1")
    materials: dict[int, Material] = {}
    shear: dict[int, float] = {}
    for card, mid in named:
        if mid not in material_cards:
            if (other := _other_material(cards, mid)) or stated:
                raise card.error(
                    f"material {mid} is {other or 'not in the deck'}",
                    "give it a MAT1, solids a MAT9 or MAT11, or shells a MAT8 or MAT2"
                    if other
                    else f"add a MAT1 card with id {mid}{OR_CONFIG}",
                )
        elif mid not in materials and (stated or states_moduli(material_cards[mid])):
            materials[mid], shear[mid] = isotropic_material(material_cards[mid], mid in only_beams, notes)
    note_damping((material_cards[mid] for mid in materials), notes)
    if unused := len({*material_cards} - {mid for _, mid in named} - {*in_general}):
        ignored["MAT1 that no property refers to"] += unused
    return materials, shear


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
