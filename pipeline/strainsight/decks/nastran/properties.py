"""Properties of solids of a Nastran deck (PSOLID, PCOMPS), and the materials (MAT1, MAT9, MAT11) of all regions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from strainsight.decks.faults import OR_CONFIG
from strainsight.decks.nastran.cards import Card, Cards, unique_ids
from strainsight.decks.nastran.grids import Grids, find_system
from strainsight.decks.nastran.materials import (
    ANISOTROPIC,
    first_names,
    isotropic_material,
    lamina,
    note_damping,
    plies_of,
    solid_material,
)
from strainsight.decks.nastran.solids import SOLIDS, composite_solid
from strainsight.decks.nastran.thin import PROPERTIES, Section, Thin
from strainsight.mesh.anisotropic import CompositeSolid, Orientation
from strainsight.mesh.model import CellBlock, Material, Properties, Region
from strainsight.mesh.thin import BeamSection, GeneralShell, ShellSection


def properties(
    cards: Cards,
    blocks: Sequence[CellBlock],
    grids: Grids,
    thin: Thin,
    ignored: Counter[str],
    notes: list[str],
    materials_required: bool,
) -> Properties:
    """Properties of solids, shells and beams → regions, materials and sections, with the G of a MAT1 that is
    inconsistent with its E and NU. Unless materials are required, a region of solids without PSOLID has no material.

    Raises DeckError for a duplicate id, a missing or unsupported property or material, and fluids."""
    solids, layered = cards.of("PSOLID"), _layered(cards, blocks, ignored)
    used = {(thin_property.card.name, pid) for pid, thin_property in thin.properties.items()}
    of_thin = [card for card in cards.of(*PROPERTIES) if (card.name, card.integer(0, "the id")) in used]
    unique_ids([*solids, *layered.values(), *of_thin], "property")
    plies = {pid: plies_of(card, step=8, at=1) for pid, card in layered.items()}
    in_solids = [card.integer(1, "the material id") for card in solids]
    in_solids += [ply.material for layers in plies.values() for ply in layers]
    of_solids, of_plies, isotropic = (_by_id(cards, *names) for names in (ANISOTROPIC, ("MAT8",), ("MAT1",)))
    _by_id(cards, "MAT2")
    for mid in in_solids:
        _check_single(mid, of_solids, isotropic, of_plies)
    anisotropic = {mid: solid_material(of_solids[mid]) for mid in in_solids if mid in of_solids}
    regions, named, orientations = _solid_regions(solids, anisotropic, grids, notes)
    composites: dict[int, CompositeSolid] = {}
    for pid, card in layered.items():
        regions[pid] = Region(pid, f"PCOMPS {pid}", 0)
        composites[pid] = composite_solid(card, plies[pid], anisotropic, blocks, grids, notes)
        named += [(card, mid) for mid in dict.fromkeys(ply.material for ply in plies[pid]) if mid not in anisotropic]
    in_plies: list[tuple[Card, int]] = []
    for pid, thin_property in thin.properties.items():
        regions[pid] = Region(
            pid, f"{thin_property.card.name} {thin_property.card.integer(0, 'the id')}", thin_property.material
        )
        if thin_property.material:
            named.append((thin_property.card, thin_property.material))
        elif not isinstance(thin_property.section, GeneralShell):
            in_plies += [(thin_property.card, mid) for mid in dict.fromkeys(thin_property.mids)]
    for card, mid in in_plies:
        _check_single(mid, of_plies, isotropic)
        if mid not in of_plies and mid not in isotropic:
            other = _other_material(cards, mid)
            raise card.error(
                f"material {mid} of the plies is {other or 'not in the deck'}",
                "use a MAT8 or a MAT1 for plies" if other else f"add a MAT8 or MAT1 card with id {mid}",
            )
    laminae = {mid: lamina(of_plies[mid]) for _, mid in in_plies if mid in of_plies}
    if rigid := [str(i) for i, each in laminae.items() if np.isinf(each.g1z) or np.isinf(each.g2z)]:
        notes.append(
            f"MAT8 without G1Z or G2Z: {first_names(rigid)}; plies of these materials are rigid in transverse shear"
        )
    named += [(card, mid) for card, mid in in_plies if mid not in laminae]
    materials, shear = _materials(cards, isotropic, named, thin.only_beams - {*in_solids}, notes, materials_required)
    pairs = ((of_solids, anisotropic), (of_plies, laminae), (isotropic, materials))
    note_damping((known[mid] for known, mids in pairs for mid in mids), notes)
    in_general = {mid for p in thin.properties.values() if isinstance(p.section, GeneralShell) for mid in p.mids}
    used_materials: dict[str, Collection[int]] = dict.fromkeys(ANISOTROPIC, anisotropic)
    used_materials["MAT8"] = used_materials["MAT2"] = {*laminae, *in_general}
    used_materials["MAT1"] = {*(mid for _, mid in named), *in_general}
    for name, mids in used_materials.items():
        if unused := sum(card.integer(0, "the material id") not in mids for card in cards.of(name)):
            ignored[f"{name} that no {'solid' if name in ANISOTROPIC else 'property'} refers to"] += unused
    for block in blocks:
        missing = ~np.isin(block.region, [*(card.integer(0, "the property id") for card in solids), *layered])
        if missing.any() and not materials_required and not np.isin(block.region[missing], list(thin.properties)).any():
            regions |= {int(pid): Region(int(pid), f"PSOLID {pid}", 0) for pid in np.unique(block.region[missing])}
        elif missing.any():
            i = int(np.argmax(missing))
            card = next(card for card in cards.of(*SOLIDS) if int(card.tokens[0]) == block.ids[i])
            raise card.error(
                f"property {block.region[i]} is not a PSOLID of the deck ({missing.sum()} {block.kind} elements without PSOLID)",
                f"add a PSOLID card with id {block.region[i]}{OR_CONFIG}",
            )
    return Properties(
        regions=regions,
        materials=materials,
        laminae=laminae,
        anisotropic=anisotropic,
        orientations=orientations,
        composites=composites,
        sections={
            pid: _with_shear(thin_property.section, shear.get(thin_property.material, 1.0))
            for pid, thin_property in thin.properties.items()
        },
    )


def _layered(cards: Cards, blocks: Sequence[CellBlock], ignored: Counter[str]) -> dict[int, Card]:
    """The PCOMPS of solids by id; others are counted."""
    cards_by_id, used = {}, {int(number) for block in blocks for number in np.unique(block.region)}
    for card in cards.of("PCOMPS"):
        if (pid := card.integer(0, "the property id")) not in used:
            ignored["PCOMPS that no element refers to"] += 1
        elif pid in cards_by_id:
            raise card.error(f"property id {pid} is used twice", "use a unique id for every property")
        else:
            cards_by_id[pid] = card
    return cards_by_id


def _solid_regions(
    solids: Sequence[Card], anisotropic: Collection[int], grids: Grids, notes: list[str]
) -> tuple[dict[int, Region], list[tuple[Card, int]], dict[int, Orientation]]:
    """Regions of PSOLID, their isotropic materials, and the orientation of anisotropic ones: CORDM, or the basic
    system if it is blank or 0."""
    regions: dict[int, Region] = {}
    named: list[tuple[Card, int]] = []
    orientations: dict[int, Orientation] = {}
    schemes = []
    for card in solids:
        pid, mid = card.integer(0, "the property id"), card.integer(1, "the material id")
        if card.text(6).upper() not in ("", "SMECH"):
            raise card.error(
                f"FCTN is {card.text(6)}: only structural solids are supported",
                "remove the fluid elements with this property",
            )
        if mid in anisotropic and card.text(2) == "-1":
            raise card.error(
                f"CORDM is -1 (element axes) and material {mid} is anisotropic: not supported, because programs "
                "define these axes differently",
                "set CORDM to a coordinate system (CORD2R, CORD2C, CORD2S) along the material axes, or 0 for "
                "the basic system",
            )
        if card.text(2) != "-1":
            system = find_system(card, 2, grids.systems)
            orientations |= {pid: Orientation(system, np.eye(3))} if mid in anisotropic else {}
        if card.text(3) or card.text(5):
            schemes.append(f"PSOLID {pid} (IN {card.text(3) or 'blank'}, ISOP {card.text(5) or 'blank'})")
        regions[pid] = Region(pid, f"PSOLID {pid}", mid)
        named += [(card, mid)] if mid not in anisotropic else []
    if schemes:
        notes.append(
            f"{first_names(schemes)}: the integration scheme of the deck is not used; solids are fully "
            "integrated, and linear hexahedra have incompatible modes"
        )
    return regions, named, orientations


def _by_id(cards: Cards, *names: str) -> dict[int, Card]:
    """The materials on cards of these names. Raises DeckError for a duplicate id."""
    material_cards = cards.of(*names)
    return dict(zip(unique_ids(material_cards, "material").tolist(), material_cards, strict=True))


def _check_single(mid: int, first: Mapping[int, Card], *others: Mapping[int, Card]) -> None:
    """Raise DeckError for a material id in `first` and also in `others`."""
    if other := next((known[mid] for known in others if mid in known and mid in first), None):
        raise first[mid].error(
            f"material id {mid} is used twice, also by a {other.name}", "use a unique id for every material"
        )


def _other_material(cards: Cards, mid: int) -> str:
    """Card with the id of a material: "a MAT10", or "" if there is no card."""
    name = next((n for n in cards if n.startswith("MAT") and any(c.text(0) == str(mid) for c in cards[n])), "")
    return name and f"a {name}"


def _materials(
    cards: Cards,
    isotropic: Mapping[int, Card],
    named: Sequence[tuple[Card, int]],
    only_beams: Collection[int],
    notes: list[str],
    materials_required: bool,
) -> tuple[dict[int, Material], dict[int, float]]:
    """The MAT1 of properties, and the ratio of G to E/2(1 + ν); only_beams: ids of materials only of beams and rods.
    Unless materials are required, a MAT1 may be blank, as mesh generators write it."""
    materials: dict[int, Material] = {}
    shear: dict[int, float] = {}
    for card, mid in named:
        if mid not in isotropic:
            if (other := _other_material(cards, mid)) or materials_required:
                raise card.error(
                    f"material {mid} is {other or 'not in the deck'}",
                    "use a MAT1; solids also allow MAT9 or MAT11, shells MAT8 or MAT2"
                    if other
                    else f"add a MAT1 card with id {mid}{OR_CONFIG}",
                )
        elif mid not in materials and (materials_required or any(isotropic[mid].text(i) for i in (1, 2, 3))):
            materials[mid], shear[mid] = isotropic_material(isotropic[mid], mid in only_beams, notes)
    return materials, shear


def _with_shear(section: Section, ratio: float) -> Section:
    """Section with G of its material times `ratio`: in transverse shear and torsion."""
    if ratio == 1:
        return section
    if isinstance(section, BeamSection):
        return section.with_shear(ratio)
    return replace(section, shear=ratio * section.shear) if isinstance(section, ShellSection) else section
