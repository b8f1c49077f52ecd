"""Nastran decks: solids, shells, beams, materials, supports, ties and masses; everything else is counted."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from strainsight.decks.faults import (
    ENFORCED,
    HELD,
    MISSING_END,
    classify_effects,
    notes_and_doubts,
    spelt,
    turning_nodes,
)
from strainsight.decks.nastran.cards import Cards, Deck, origin, read_deck, unique_ids
from strainsight.decks.nastran.case_control import count_parameters, is_lumped, mass_scale, sets
from strainsight.decks.nastran.grids import BY_NODES, BY_POINTS, read_grids
from strainsight.decks.nastran.loads import LOADS, PLATES, preloads, static_loads
from strainsight.decks.nastran.materials import ANISOTROPIC
from strainsight.decks.nastran.properties import properties
from strainsight.decks.nastran.shells import SHELLS
from strainsight.decks.nastran.solids import SOLIDS, read_solids, straight_sides, with_middles
from strainsight.decks.nastran.springs import MASSES, SPRINGS, fixed_components, point_masses, springs
from strainsight.decks.nastran.thin import IMPORTED as THIN
from strainsight.decks.nastran.thin import read_thin
from strainsight.decks.nastran.ties import NAMES as RIGID_BARS
from strainsight.decks.nastran.ties import averaging_elements, rigid_bars, rigid_elements, selected_cards, terms
from strainsight.decks.text import error_at, parse_integer
from strainsight.errors import DeckError
from strainsight.mesh.joins import Relation
from strainsight.mesh.kinds import FAMILIES
from strainsight.mesh.model import Mesh
from strainsight.mesh.thin import nodes_that_turn
from strainsight.mesh.units import rescaled

STRUCTURE = (*("K2GG", "M2GG", "K2PP", "M2PP", "A2GG", "SUPORT1", "BCONTACT", "BCSET", "BGSET", "NSM", "DEFORM"),)
"""Matrices, supports of a free structure, contact and additional mass."""
_LINE = re.compile(rf"\s*({'|'.join(STRUCTURE)})\b\s*(\(.*?\))?\s*=", re.IGNORECASE)
SYSTEM_FIELDS: Mapping[str, Sequence[int]] = {
    "GRID": (1, 5),
    "GRDSET": (1, 5),
    "PSOLID": (2,),
    "PCOMPS": (1,),
    "CONM1": (2,),
    "CONM2": (2,),
    **{name: (layout.theta,) for name, layout in SHELLS.items()},
    "CBUSH": (7, 9),
    **dict.fromkeys(("FORCE", "MOMENT", "RFORCE"), (2,)),
    "GRAV": (1,),
    "PLOAD4": (8,),
    **dict.fromkeys(BY_POINTS, (1,)),
}
"""Card → fields that refer to a coordinate system; in a shell an integer is a system, a real number an angle."""


def unused_systems(cards: Cards) -> dict[str, int]:
    """CORD1 and CORD2 that no card uses, "CORD2R that no card refers to" → count."""
    used = {
        parse_integer(card.text(i)) for name, fields in SYSTEM_FIELDS.items() for card in cards.of(name) for i in fields
    }
    counts: dict[str, int] = {}
    for name in (*BY_POINTS, *BY_NODES):
        # a CORD1 may define two systems
        of_card = (0, 4) if name in BY_NODES else (0,)
        ids = [parse_integer(card.text(i)) for card in cards.of(name) for i in of_card if card.text(i)]
        if count := sum(number not in used for number in ids):
            counts[f"{name} that no card refers to"] = count
    return counts


IMPORTED = {
    *("GRID", "GRDSET", "PSOLID", "PCOMPS", "MAT1", "MAT2", "MAT8", "SPC", "SPC1", "SPCADD", "RBE2", "RBE3"),
    *("MPC", "MPCADD", "PMASS", "SET1", "SET3"),
    *(*ANISOTROPIC, *MASSES, *RIGID_BARS, *SOLIDS, *THIN, *LOADS, *SPRINGS, *BY_POINTS, *BY_NODES),
}
_CONTACT = "(BGSET|BGADD|BCTSET|BCTADD|BCTABLE|BCONP|BCONTACT|BCONECT|BLSEG|BOLT|BOLTFOR|BOLTFRC|BOLTLD|PRETENS)$"
STRUCTURAL = re.compile(
    r"C(?!ORD|ONVM?$|REEP)[A-Z]|GENEL|R(BAR|ROD|BE1|BE2GS|TRPLT|SPLINE|JOINT|SSCON)|MPC|DMIG|NSM|ASET|OMIT|SUPORT|MATT|"
    + _CONTACT
)
UNSUPPORTED = re.compile(
    r"C(?!ORD|ONVM?$|REEP)[A-Z]|GENEL|R(BE2GS|TRPLT|SPLINE|JOINT|SSCON)|DMIG|NSM"
    r"|PLOAD|ACCEL|SLOAD|LOADCY|DEFORM|(FORCE|MOM|PRES)AX$|" + _CONTACT
)
"""Elements, ties, bonded faces, contact, preloaded bolts and static loads without which the model is wrong."""
CONTROL = re.compile(
    r"PARAM$|BGPARM|BCTPARM|BCPARA|EIG[BCRP]|EIGRL|FREQ\d?$|TSTEP|TABDMP|TABLE|DLOAD|TLOAD|RLOAD|DAREA|DPHASE|DELAY|MOMENT|PLOAD|GRAV|SPCD|TEMP"
    r"|FORCE|RFORCE|MDLPRM|NLPARM|lines after ENDDATA"
)


def read_nastran(
    path: Path,
    *,
    required: bool = True,
    materials_required: bool = True,
    ignore: Sequence[str] = (),
    spc: int | None = None,
    include: Sequence[Path] = (),
) -> Mesh:
    """Read a Nastran deck with its units and ids.

    Imported: GRID (CP, CD, PS), GRDSET, CORD1R/C/S, CORD2R/C/S, the solids of `mesh.kinds`, PSOLID, PCOMPS, MAT1, MAT9 and MAT11
    of solids, MAT8 of plies, the cards of `thin`, SPC, SPC1, SPCADD, MPC, MPCADD, RBE2, RBE3, RBAR, RBAR1, RROD, RBE1, `MASSES`,
    springs, the static loads of `static_loads`, SET1, SET3, case-control SPC, MPC and SET, PARAM WTMASS (also of the case
    control), INCLUDE. Every other card is counted in `ignored`. SET 5 of the case control is the set "SET-5", SET1 5 of the bulk
    data "SET1-5". Without a selection in the case control the only support set is used. required: require elements, and
    properties of shells and beams; materials_required: require PSOLID and MAT1 of all elements; ignore: cards to leave out, and
    MISSING ENDDATA to accept a deck with BEGIN BULK and without ENDDATA; spc: support set instead of the selected one; include:
    further folders of included files. Raises DeckError with file:line for unsupported input."""
    path = Path(path)
    deck = read_deck(path, include)
    notes = [*_check_end(deck, ignore), *deck.notes]
    cut = deck.begun and not deck.ended
    cards = deck.cards
    left_out = {name: cards.pop(name) for name in {spelt(name) for name in ignore} & {*cards} & IMPORTED}
    ignored = Counter(
        {name: len(cards_of_name) for name, cards_of_name in left_out.items()}
    )  # others are counted anyway
    first = {name: cards_of_name[0].where for name, cards_of_name in cards.items()}
    grids, middles = with_middles(cards, read_grids(cards, notes, path), notes)
    nodes = grids.nodes
    blocks, solids = read_solids(cards, nodes, grids.position, notes)
    scale = mass_scale(deck)
    thin = read_thin(cards, grids, blocks, solids, required, notes)
    if required and not (blocks or thin.shells or thin.beams):
        raise error_at(
            path,
            "the deck contains no solid, shell or beam elements",
            f"add elements of these types: {FAMILIES} ({', '.join(SOLIDS)}), CQUAD4, CTRIA3, CBAR or CBEAM",
        )
    ignored += thin.left_out
    element_ids = np.concatenate([solids.ids, thin.elements.ids])
    region_properties = rescaled(properties(cards, blocks, grids, thin, ignored, notes, materials_required), mass=scale)
    ties = cards.of("RBE2", "RBE3", *RIGID_BARS)
    tie_ids = unique_ids(ties, "rigid element")
    turned = nodes_that_turn(thin.shells, thin.beams)
    bars, mpc = rigid_bars(cards, grids), selected_cards(deck, ignored)
    relations = (
        *bars.relations,
        *(
            Relation(i, *terms(card, nodes), f"MPC {card.text(0)}")
            for i, card in enumerate(mpc, len(bars.relations) + 1)
        ),
    )
    relations += straight_sides(middles, len(nodes.ids), grids.axes, len(relations))
    added = [card for card in middles.cards for _ in range(3)]
    relation_origin = origin(np.arange(1, len(relations) + 1), [*bars.cards, *mpc, *added])
    turning = turning_nodes(bars.rigid, (), relations) | set(turned.tolist())
    rigid = (*rigid_elements(cards, nodes, {int(nodes.ids[row]) for row in turning}, notes), *bars.rigid)
    averaging = averaging_elements(cards, nodes, turning_nodes(rigid, ()) | turning)
    turning |= turning_nodes(rigid, averaging)
    node_sets, element_sets = sets(deck, nodes.sorted, np.sort(element_ids), left_out, ignored)
    free = spelt(ENFORCED) in {spelt(name) for name in ignore}
    fixed = fixed_components(deck, nodes, grids.permanent, ignored, notes, spc, free)
    sprung = springs(cards, grids, notes)
    turning |= {int(row) for spring in sprung for row in spring.turned}
    masses = point_masses(cards, grids, scale, turning, notes)
    # an ignored plate still locates a pressure load
    loaded_cards = Cards({**{name: left_out[name] for name in PLATES if name in left_out}, **cards})
    mesh = Mesh(nodes.ids, grids.position, blocks, shells=thin.shells)
    loads = static_loads(loaded_cards, grids, mesh, turning, notes)
    of_parameters = _count_ignored(deck, ignored, notes)
    loaded = preloads(deck)
    ignored.update({card: len(lines) for card, lines in loaded.items()})
    diagonal = is_lumped(deck) and not (thin.shells or thin.beams)
    if diagonal:
        del ignored["PARAM COUPMASS"]
    ignored.update({MISSING_END: 1} if cut else {})
    by_temperature = any(name.startswith("MATT") for name in cards)
    messages, doubts = notes_and_doubts(notes)
    return Mesh(
        **vars(region_properties),
        node_ids=nodes.ids,
        position=grids.position,
        blocks=blocks,
        fixed=fixed,
        rigid=rigid,
        averaging=averaging,
        relations=relations,
        point_masses=masses,
        springs=sprung,
        shells=thin.shells,
        beams=thin.beams,
        axes=grids.axes,
        node_sets=node_sets,
        element_sets=element_sets,
        loads=loads,
        ignored=dict(sorted(ignored.items())),
        effect=classify_effects(ignored, STRUCTURAL, CONTROL)
        | of_parameters
        | {card: "structure" for card in ignored if card in (ENFORCED, HELD) or card in loaded},
        unsupported={
            name: first[name]
            for name in sorted(ignored)
            if name in first and (UNSUPPORTED.match(name) or (by_temperature and name.startswith("TEMP")))
        }
        | {card: lines[0].where for card, lines in loaded.items()}
        | ({MISSING_END: deck.last.where} if cut else {}),
        notes=messages,
        doubts=doubts,
        lumped=diagonal,
        read={name: len(cards_of_name) for name, cards_of_name in cards.items() if name in IMPORTED},
        source=str(path),
        included=deck.included,
        origin={
            "node": origin(nodes.ids, [*cards["GRID"], *middles.cards]),
            "element": origin(element_ids, [*solids.cards, *thin.elements.cards]),
            "tie": origin(tie_ids, ties),
            "relation": relation_origin,
        },
    )


def _check_end(deck: Deck, ignore: Sequence[str]) -> list[str]:
    """Note on a deck without ENDDATA. Raises DeckError if it has BEGIN BULK and `ignore` does not contain MISSING ENDDATA."""
    if deck.ended:
        return []
    if deck.begun and spelt(MISSING_END) not in {spelt(name) for name in ignore}:
        raise DeckError(
            "ENDDATA is missing: the deck may be truncated",
            where=deck.last.where,
            remedy="copy the deck again, or add the line ENDDATA if the deck is complete; to import the deck unchanged, set "
            f"mesh.ignore: [{MISSING_END}]",
        )
    begin = "" if deck.begun else " and no BEGIN BULK"
    last = deck.last.text.strip()
    return [
        f"the deck has no ENDDATA{begin}, so check that the deck is complete; its last line is "
        f"{last[:72] + ' …' if len(last) > 72 else last!r} ({deck.last.where})"
    ]


def _count_ignored(deck: Deck, ignored: Counter[str], notes: list[str]) -> dict[str, str]:
    """Count cards that are not imported; returns the effect of PARAM cards and of case-control lines by name."""
    for name, cards_of_name in deck.cards.items():
        if name not in IMPORTED and name != "PARAM":
            ignored[name] += len(cards_of_name)
    if deck.after_end:
        ignored["lines after ENDDATA"] += deck.after_end
    matches = (_LINE.match(line.text) for line in deck.case_control)
    lines = [f"{match[1].upper()} of the case control" for match in matches if match]
    ignored.update(lines)
    systems = unused_systems(deck.cards)
    ignored.update(systems)
    effect = dict.fromkeys(lines, "structure") | dict.fromkeys(systems, "none")
    return count_parameters(deck, ignored, notes) | effect
