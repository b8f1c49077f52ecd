"""Properties of solids of a Nastran deck (PSOLID, PCOMPS), and the materials (MAT1, MAT9, MAT11) of all regions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from strainsight.decks.faults import OR_CONFIG
from strainsight.decks.nastran.cards import Card, Cards, unique_ids
from strainsight.decks.nastran.grids import Grids, resolved_system
from strainsight.decks.nastran.materials import (
    ANISOTROPIC,
    isotropic_material,
    lamina,
    note_damping,
    plies_of,
    solid_material,
    some,
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
    stated: bool,
) -> Properties:
    """PSOLID, and what composite solids, shells and beams refer to → regions, the materials that they and their plies refer to,
    and sections, with the G of a MAT1 that contradicts its E and NU; without either a region of solids has no material, unless it
    has to be stated.

    Raises DeckError for an id that stands twice, a property or material that is not there or of another kind, and fluids.
    """
    solids, layered = cards.of("PSOLID"), _layered(cards, blocks, ignored)
    used = {(own.card.name, pid) for pid, own in thin.properties.items()}
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
    for pid, own in thin.properties.items():
        regions[pid] = Region(pid, f"{own.card.name} {own.card.integer(0, 'the id')}", own.material)
        if own.material:
            named.append((own.card, own.material))
        elif not isinstance(own.section, GeneralShell):
            in_plies += [(own.card, mid) for mid in dict.fromkeys(own.mids)]
    for card, mid in in_plies:
        _check_single(mid, of_plies, isotropic)
        if mid not in of_plies and mid not in isotropic:
            other = _other_material(cards, mid)
            raise card.error(
                f"material {mid} of its plies is {other or 'not in the deck'}",
                "give plies a MAT8 or a MAT1" if other else f"add a MAT8 or MAT1 card with id {mid}",
            )
    laminae = {mid: lamina(of_plies[mid]) for _, mid in in_plies if mid in of_plies}
    if rigid := [str(i) for i, each in laminae.items() if np.isinf(each.g1z) or np.isinf(each.g2z)]:
        notes.append(f"MAT8 {some(rigid)}: without G1Z or G2Z it does not shear across")
    named += [(card, mid) for card, mid in in_plies if mid not in laminae]
    materials, shear = _materials(cards, isotropic, named, thin.only_beams - {*in_solids}, notes, stated)
    pairs = ((of_solids, anisotropic), (of_plies, laminae), (isotropic, materials))
    note_damping((known[mid] for known, mids in pairs for mid in mids), notes)
    general = (own.mids for own in thin.properties.values() if isinstance(own.section, GeneralShell))
    in_general = {mid for mids in general for mid in mids}
    taken: dict[str, Collection[int]] = dict.fromkeys(ANISOTROPIC, anisotropic)
    taken["MAT8"] = taken["MAT2"] = {*laminae, *in_general}
    taken["MAT1"] = {*(mid for _, mid in named), *in_general}
    for name, mids in taken.items():
        if unused := sum(card.integer(0, "the material id") not in mids for card in cards.of(name)):
            ignored[f"{name} that no {'solid' if name in ANISOTROPIC else 'property'} refers to"] += unused
    for block in blocks:
        missing = ~np.isin(block.region, [*(card.integer(0, "the property id") for card in solids), *layered])
        if missing.any() and not stated and not np.isin(block.region[missing], list(thin.properties)).any():
            regions |= {int(pid): Region(int(pid), f"PSOLID {pid}", 0) for pid in np.unique(block.region[missing])}
        elif missing.any():
            i = int(np.argmax(missing))
            card = next(card for card in cards.of(*SOLIDS) if int(card.tokens[0]) == block.ids[i])
            raise card.error(
                f"property {block.region[i]} is no PSOLID of the deck ({int(missing.sum())} {block.kind} elements)",
                f"add a PSOLID card with id {block.region[i]}{OR_CONFIG}",
            )
    return Properties(
        regions=regions,
        materials=materials,
        laminae=laminae,
        anisotropic=anisotropic,
        orientations=orientations,
        composites=composites,
        sections={pid: _with_shear(own.section, shear.get(own.material, 1.0)) for pid, own in thin.properties.items()},
    )


def _layered(cards: Cards, blocks: Sequence[CellBlock], ignored: Counter[str]) -> dict[int, Card]:
    """The PCOMPS that solids refer to, by their ids; others are counted."""
    found, used = {}, {int(number) for block in blocks for number in np.unique(block.region)}
    for card in cards.of("PCOMPS"):
        if (pid := card.integer(0, "the property id")) not in used:
            ignored["PCOMPS that no element refers to"] += 1
        elif pid in found:
            raise card.error(f"property id {pid} stands twice", "give every property its own id")
        else:
            found[pid] = card
    return found


def _solid_regions(
    solids: Sequence[Card], anisotropic: Collection[int], grids: Grids, notes: list[str]
) -> tuple[dict[int, Region], list[tuple[Card, int]], dict[int, Orientation]]:
    """The regions of PSOLID, the isotropic materials that they name, and how the axes of anisotropic ones lie: CORDM, blank or 0
    the basic system, or one of the deck."""
    regions: dict[int, Region] = {}
    named: list[tuple[Card, int]] = []
    orientations: dict[int, Orientation] = {}
    schemes = []
    for card in solids:
        pid, mid = card.integer(0, "the property id"), card.integer(1, "the material id")
        if card.text(6).upper() not in ("", "SMECH"):
            raise card.error(f"FCTN is {card.text(6)}: only structural solids are supported", "remove the fluid part")
        if mid in anisotropic and card.text(2) == "-1":
            raise card.error(
                f"CORDM is -1, the axes of each element, and material {mid} is anisotropic: not supported, as codes define "
                "these axes differently",
                "name a coordinate system (CORD2R, CORD2C, CORD2S) along the material, or 0 for the basic one",
            )
        if card.text(2) != "-1":
            system = resolved_system(card, 2, grids.systems)
            orientations |= {pid: Orientation(system, np.eye(3))} if mid in anisotropic else {}
        if card.text(3) or card.text(5):
            schemes.append(f"{pid} (IN {card.text(3) or 'blank'}, ISOP {card.text(5) or 'blank'})")
        regions[pid] = Region(pid, f"PSOLID {pid}", mid)
        named += [(card, mid)] if mid not in anisotropic else []
    if schemes:
        notes.append(
            f"PSOLID {some(schemes)}: the integration scheme is not supported: solids are integrated fully, linear "
            "hexahedra with incompatible modes"
        )
    return regions, named, orientations


def _by_id(cards: Cards, *names: str) -> dict[int, Card]:
    """The materials on cards of these names. Raises DeckError for an id that stands twice."""
    found = cards.of(*names)
    return dict(zip(unique_ids(found, "material").tolist(), found, strict=True))


def _check_single(mid: int, first: Mapping[int, Card], *others: Mapping[int, Card]) -> None:
    """Raise DeckError for a material that is on one of the first cards and of others."""
    if other := next((known[mid] for known in others if mid in known and mid in first), None):
        raise first[mid].error(
            f"material id {mid} stands twice, a {other.name} has it too", "give every material its own id"
        )


def _other_material(cards: Cards, mid: int) -> str:
    """What card has the id of a material: "a MAT10", or "" for none."""
    name = next((n for n in cards if n.startswith("MAT") and any(c.text(0) == str(mid) for c in cards[n])), "")
    return name and f"a {name}"


def _materials(
    cards: Cards,
    isotropic: Mapping[int, Card],
    named: Sequence[tuple[Card, int]],
    only_beams: Collection[int],
    notes: list[str],
    stated: bool,
) -> tuple[dict[int, Material], dict[int, float]]:
    """The MAT1 that properties name, and of those whose G is another than E/2(1 + ν) the first over the second; only_beams: ids
    of those of beams and rods alone. Unless it has to be stated, one may be blank, as mesh generators write it."""
    materials: dict[int, Material] = {}
    shear: dict[int, float] = {}
    for card, mid in named:
        if mid not in isotropic:
            if (other := _other_material(cards, mid)) or stated:
                raise card.error(
                    f"material {mid} is {other or 'not in the deck'}",
                    "give it a MAT1, solids a MAT9 or MAT11, or shells a MAT8 or MAT2"
                    if other
                    else f"add a MAT1 card with id {mid}{OR_CONFIG}",
                )
        elif mid not in materials and (stated or any(isotropic[mid].text(i) for i in (1, 2, 3))):
            materials[mid], shear[mid] = isotropic_material(isotropic[mid], mid in only_beams, notes)
    return materials, shear


def _with_shear(section: Section, ratio: float) -> Section:
    """The section with G of its material times `ratio`: across a shell, in torsion and across a beam."""
    if ratio == 1:
        return section
    if isinstance(section, BeamSection):
        return section.with_shear(ratio)
    return replace(section, shear=ratio * section.shear) if isinstance(section, ShellSection) else section
