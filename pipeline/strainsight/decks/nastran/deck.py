"""Nastran decks: solids, materials, supports, rigid elements and masses; the rest is counted, never dropped."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from strainsight.decks.effects import ENFORCED, effects, spelt
from strainsight.decks.faults import OR_CONFIG, elastic_fault
from strainsight.decks.moments import turning_nodes
from strainsight.decks.nastran.cards import Card, Deck, origin, read_deck, unique_ids
from strainsight.decks.nastran.coordinates import BY_NODES, BY_POINTS, CoordinateSystem
from strainsight.decks.nastran.grids import read_grids, resolved_system
from strainsight.decks.nastran.loads import LOADS, static_loads
from strainsight.decks.nastran.masses import point_masses
from strainsight.decks.nastran.sets import sets
from strainsight.decks.nastran.solids import SOLIDS, read_solids
from strainsight.decks.nastran.springs import SPRINGS, springs
from strainsight.decks.nastran.supports import count_relations, fixed_components
from strainsight.decks.nastran.ties import averaging_elements, rigid_elements
from strainsight.mesh.model import CellBlock, Material, Mesh, Region

TAKEN = {
    *("GRID", "GRDSET", "PSOLID", "MAT1", "SPC", "SPC1", "SPCADD", "RBE2", "RBE3", "CONM2", "SET1", "SET3"),
    *SOLIDS,
    *LOADS,
    *SPRINGS,
    *BY_POINTS,
    *BY_NODES,
}
STRUCTURAL = re.compile(
    r"C(?!ORD|ONVM?$|REEP)[A-Z]|GENEL|R(BAR|ROD|BE1|BE2GS|TRPLT|SPLINE|JOINT|SSCON)|MPC|DMIG|NSM|ASET|OMIT|SUPORT|MATT"
)
UNSUPPORTED = re.compile(
    r"C(?!ORD|ONVM?$|REEP)[A-Z]|GENEL|R(BAR|ROD|BE1|BE2GS|TRPLT|SPLINE|JOINT|SSCON)|MPC$|DMIG|NSM"
    r"|PLOAD|ACCEL|SLOAD|LOADCY|DEFORM|SPCD|TEMP|(FORCE|MOM|PRES)AX$"
)
"""Elements, ties and static loads: what a model is not the same without."""
CONTROL = re.compile(
    r"PARAM$|EIG[BCRP]|EIGRL|FREQ\d?$|TSTEP|TABDMP|TABLE|DLOAD|TLOAD|RLOAD|DAREA|DPHASE|DELAY|MOMENT|PLOAD|GRAV|TEMP"
    r"|FORCE|RFORCE|MDLPRM|NLPARM|lines after ENDDATA"
)


def read_nastran(
    path: Path, *, required: bool = True, stated: bool = True, ignore: Sequence[str] = (), spc: int | None = None
) -> Mesh:
    """A Nastran deck in its own units, with its own ids.

    Imported: GRID (CP, CD, PS), GRDSET, CORD1R/C/S, CORD2R/C/S, the solids of `mesh.kinds`, PSOLID, MAT1,
    SPC, SPC1, SPCADD, RBE2, RBE3, CONM2, springs, the static loads of `static_loads`, SET1, SET3, case-control SPC and SET,
    PARAM WTMASS, INCLUDE. Every other card is in `ignored` with its count. SET 5 of the case control is the set "SET-5", SET1 5
    of the bulk data "SET1-5". Without a selection in the case control the only set of supports counts.
    required: there have to be solids; stated: PSOLID and MAT1 of all of them; ignore: cards that are left out; spc: set of
    supports that counts, whatever is selected.
    Raises DeckError with file:line for what cannot be imported as it stands.
    """
    path = Path(path)
    deck = read_deck(path)
    cards = deck.cards
    ignored: Counter[str] = Counter()
    for name in {spelt(name) for name in ignore} & {*cards} & TAKEN:  # others are counted anyway
        ignored[name] += len(cards.pop(name))
    first = {name: found[0].where for name, found in cards.items()}
    notes: list[str] = []
    if not deck.ended:
        notes.append("the deck has no ENDDATA (and no BEGIN BULK): that it is whole cannot be seen")
    grids = read_grids(cards, notes, path)
    nodes = grids.nodes
    blocks, elements = read_solids(cards, nodes, path, required)
    regions, materials = _properties(cards, blocks, grids.systems, ignored, notes, stated)
    scale = _mass_scale(cards)
    ties = [card for name in ("RBE2", "RBE3") for card in cards.get(name, [])]
    tie_ids = unique_ids(ties, "rigid element")
    rigid = rigid_elements(cards, nodes, notes)
    averaging = averaging_elements(cards, nodes)
    node_sets, element_sets = sets(deck, nodes.sorted, np.sort(elements.ids), ignored)
    fixed, enforced = fixed_components(deck, nodes, grids.permanent, ignored, spc)
    turning = turning_nodes(rigid, averaging)
    masses = point_masses(cards, grids, scale, turning, notes)
    loads = static_loads(cards, grids, blocks, turning, notes)
    count_relations(deck, ignored, notes)
    _count_ignored(deck, ignored)
    ignored.update({ENFORCED: len(enforced)} if enforced else {})
    return Mesh(
        node_ids=nodes.ids,
        position=grids.position,
        blocks=blocks,
        regions=regions,
        materials={i: replace(material, density=scale * material.density) for i, material in materials.items()},
        fixed=fixed,
        rigid=rigid,
        averaging=averaging,
        point_masses=masses,
        springs=springs(cards, grids, notes),
        axes=grids.axes,
        node_sets=node_sets,
        element_sets=element_sets,
        loads=loads,
        ignored=dict(sorted(ignored.items())),
        effect=effects(ignored, STRUCTURAL, CONTROL),
        unsupported={name: first[name] for name in sorted(ignored) if name in first and UNSUPPORTED.match(name)}
        | ({ENFORCED: enforced[0]} if enforced else {}),
        notes=tuple(notes),
        source=str(path),
        included=deck.included,
        origin={"node": origin(nodes.ids, cards["GRID"]), "element": elements, "tie": origin(tie_ids, ties)},
    )


def _properties(
    cards: dict[str, list[Card]],
    blocks: tuple[CellBlock, ...],
    systems: dict[int, CoordinateSystem],
    ignored: Counter[str],
    notes: list[str],
    stated: bool,
) -> tuple[dict[int, Region], dict[int, Material]]:
    """PSOLID → regions, and the MAT1 that they refer to; without either a region has no material, unless it has to be stated."""
    solids, isotropic = cards.get("PSOLID", []), cards.get("MAT1", [])
    unique_ids(solids, "property")
    material_cards = dict(zip(unique_ids(isotropic, "material").tolist(), isotropic, strict=True))
    regions, materials = {}, {}
    damped, schemes = [], []
    for card in solids:
        pid, mid = card.integer(0, "the property id"), card.integer(1, "the material id")
        if card.text(6).upper() not in ("", "SMECH"):
            raise card.error(f"FCTN is {card.text(6)}: only structural solids are supported", "remove the fluid part")
        if mid not in material_cards:
            other = [
                name for name in cards if name.startswith("MAT") and any(c.text(0) == str(mid) for c in cards[name])
            ]
            if other or stated:
                raise card.error(
                    f"material {mid} is {'a ' + other[0] if other else 'not in the deck'}",
                    "give the region an isotropic MAT1" if other else f"add a MAT1 card with id {mid}{OR_CONFIG}",
                )
        if card.text(2) != "-1":
            resolved_system(card, 2, systems)
        if card.text(3) or card.text(5):
            schemes.append(f"{pid} (IN {card.text(3) or 'blank'}, ISOP {card.text(5) or 'blank'})")
        regions[pid] = Region(pid, f"PSOLID {pid}", mid)
        if mid in material_cards and mid not in materials:
            materials[mid] = _material(material_cards[mid])
            if material_cards[mid].real(7, "the structural damping GE", 0.0) != 0:
                damped.append(f"{mid} (GE {material_cards[mid].text(7)})")
    if schemes:
        notes.append(
            f"PSOLID {_some(schemes)}: the integration scheme is not supported: solids are integrated fully, linear "
            "hexahedra with incompatible modes"
        )
    if damped:
        notes.append(f"MAT1 {_some(damped)}: structural damping GE is not imported: damping comes from the config")
    if unused := len(material_cards) - len(materials):
        ignored["MAT1 that no PSOLID refers to"] += unused
    for block in blocks:
        missing = ~np.isin(block.region, list(regions))
        if missing.any() and not stated:
            regions |= {int(pid): Region(int(pid), f"PSOLID {pid}", 0) for pid in np.unique(block.region[missing])}
        elif missing.any():
            i = int(np.argmax(missing))
            card = next(c for name in SOLIDS for c in cards.get(name, []) if int(c.fields[0]) == block.ids[i])
            raise card.error(
                f"property {block.region[i]} is no PSOLID of the deck ({int(missing.sum())} {block.kind} elements)",
                f"add a PSOLID card with id {block.region[i]}{OR_CONFIG}",
            )
    return regions, materials


def _some(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _material(card: Card) -> Material:
    """MAT1: two of E, G, ν give the third, E = 2 (1 + ν) G."""
    given = [bool(card.text(i)) for i in (1, 2, 3)]
    E, G, nu = (
        card.real(i, name, 0.0)
        for i, name in ((1, "Young's modulus E"), (2, "shear modulus G"), (3, "Poisson's ratio"))
    )
    if sum(given) < 2:
        raise card.error("needs two of E, G and NU", "give E and NU")
    if given[1] and G <= 0:
        raise card.error(f"the shear modulus is {G:g}, not positive", "give a positive modulus")
    if not given[0]:
        E = 2 * (1 + nu) * G
    if not given[2]:
        nu = E / (2 * G) - 1
    if fault := elastic_fault(E if given[0] else G, nu):
        raise card.error(*fault)
    if all(given) and abs(E / (2 * (1 + nu) * G) - 1) > 0.01:
        raise card.error(f"E = {E:g}, G = {G:g} and NU = {nu:g} contradict E = 2 (1 + NU) G", "leave G blank")
    density = card.real(4, "the density", 0.0)
    if density < 0:
        raise card.error(f"the density is {density:g}, negative", "give a positive density")
    return Material(card.integer(0, "the material id"), E, nu, density)


def _mass_scale(cards: dict[str, list[Card]]) -> float:
    """PARAM WTMASS: the factor that turns the deck's weights into masses."""
    found = [card for card in cards.get("PARAM", []) if card.text(0).upper() == "WTMASS"]
    scale = found[-1].real(1, "the factor") if found else 1.0
    if scale <= 0:
        raise found[-1].error(f"the factor is {scale:g}, not positive")
    return scale


def _count_ignored(deck: Deck, ignored: Counter[str]) -> None:
    for name, found in deck.cards.items():
        if name not in TAKEN and name not in ("MPC", "MPCADD"):
            count = len(found) if name != "PARAM" else sum(card.text(0).upper() != "WTMASS" for card in found)
            if count:
                ignored[name] += count
    if deck.after_end:
        ignored["lines after ENDDATA"] += deck.after_end
