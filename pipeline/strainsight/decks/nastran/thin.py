"""Shells, beams and rods of a Nastran deck with their properties, one region each."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.decks.faults import note_shared
from strainsight.decks.nastran.beams import (
    BEAMS,
    DEFAULTS,
    RODS,
    bar_section,
    bar_shape,
    beam_section,
    beam_shape,
    read_beams,
    rod_section,
    tube_section,
    with_defaults,
)
from strainsight.decks.nastran.cards import Card, Cards, Elements, unique_ids
from strainsight.decks.nastran.grids import Grids
from strainsight.decks.nastran.materials import COMPOSITES, laminate
from strainsight.decks.nastran.shells import (
    SHELLS,
    ThinProperty,
    general_shell,
    is_general,
    materials_of,
    read_shells,
    shell_materials,
    shell_section,
)
from strainsight.errors import DeckError
from strainsight.mesh.model import CellBlock, IntArray
from strainsight.mesh.thin import BeamBlock, BeamSection, Laminate, Ply, Section, ShellBlock, ShellSection

SECTIONS: dict[str, Callable[[Card, list[str]], tuple[int, Section]]] = {
    "PSHELL": lambda card, _: shell_section(card),
    **dict.fromkeys(COMPOSITES, lambda card, _: (0, laminate(card))),
    "PBAR": lambda card, _: bar_section(card),
    "PBARL": lambda card, _: bar_shape(card),
    "PBEAM": beam_section,
    "PBEAML": lambda card, _: beam_shape(card),
    **dict.fromkeys(("PROD", "CONROD"), lambda card, _: rod_section(card)),
    "PTUBE": lambda card, _: tube_section(card),
}
"""Card → its material (0 for laminates) and section; a CONROD defines its section itself."""
PROPERTIES = tuple(name for name in SECTIONS if name[0] == "P")
OF = {
    **dict.fromkeys(SHELLS, ("PSHELL", *COMPOSITES)),
    "CBAR": ("PBAR", "PBARL"),
    "CBEAM": ("PBEAM", "PBEAML"),
    "CROD": ("PROD",),
    "CTUBE": ("PTUBE",),
}
"""Card of an element → cards of its properties."""
ELEMENTS = (*SHELLS, *BEAMS, *RODS)
IMPORTED = (*ELEMENTS, *DEFAULTS.values(), *PROPERTIES)
_PROPERTY = re.compile(
    r"P(SHELL|COMP|SHEAR|PLANE|SOLID|LSOLID|BAR|BEAM|BEND|BCOMP|BMSECT|BRSECT|ROD|TUBE|BUSH|ELAS|DAMP)"
)


@dataclass(frozen=True)
class Thin:
    """Shells, beams and their data: region → property; cards; number of ignored cards by name."""

    shells: tuple[ShellBlock, ...]
    beams: tuple[BeamBlock, ...]
    properties: dict[int, ThinProperty]
    elements: Elements
    left_out: Counter[str]

    @property
    def only_beams(self) -> set[int]:
        """Ids of the materials that only beams use."""
        of_shells = {mid for p in self.properties.values() if not isinstance(p.section, BeamSection) for mid in p.mids}
        return {mid for p in self.properties.values() for mid in p.mids} - of_shells


def read_thin(
    cards: Cards, grids: Grids, blocks: Sequence[CellBlock], solids: Elements, required: bool, notes: list[str]
) -> Thin:
    """Shells, beams and rods. Each CONROD with different values is a region.

    required: require supported properties; otherwise elements without one are left out. Raises DeckError for a
    missing property, a duplicate id, and errors of `read_shells` and `read_beams`."""
    bars = with_defaults(cards)
    elements_in_order = sorted(
        (card for name in ELEMENTS for card in bars.get(name, cards.of(name))), key=lambda card: (card.file, card.line)
    )
    ids = unique_ids(elements_in_order, "element")
    if (clash := np.isin(ids, solids.ids)).any():
        card = elements_in_order[int(np.argmax(clash))]
        raise card.error(
            f"element id {card.text(0)} is used twice, also by a solid", "use a unique id for every element"
        )
    numbers = [card.integer(0, "the property id") for card in cards.of("PSOLID")]
    used_ids = np.concatenate([[0], numbers, ids, *(np.unique(block.region) for block in blocks)]).astype(np.int64)
    region, of_region = _regions(elements_in_order, ids, cards, used_ids, required)
    properties: dict[int, ThinProperty] = {}
    known = shell_materials(cards)
    for number, card in of_region.items():
        try:
            if required or number not in numbers:  # else a PSOLID has it
                properties[number] = _property(card, known, notes)
        except DeckError:
            if required:
                raise
    has_property = np.isin(region, list(properties))
    left_out = Counter(elements_in_order[i].name for i in np.flatnonzero(~has_property))
    left_out.update(_unused(cards, properties))
    imported = [elements_in_order[i] for i in np.flatnonzero(has_property)]
    elements = Elements(imported, ids[has_property], region[has_property])
    shells = read_shells(elements.of(SHELLS), grids, properties, notes)
    beams = read_beams(elements.of((*BEAMS, *RODS)), grids)
    called = {int(card.text(0)): f"{card.name} {card.text(0)}" for card in elements.cards}
    blocks_of: tuple[ShellBlock | BeamBlock, ...] = (*shells, *beams)
    for block in blocks_of:
        note_shared(block.nodes, [called[number] for number in block.ids.tolist()].__getitem__, notes)
    return Thin(shells, beams, properties, elements, left_out)


def _property(card: Card, known: Mapping[int, Sequence[Card]], notes: list[str]) -> ThinProperty:
    """Property of a card; known: MAT1, MAT2 and MAT8 by id."""
    if card.name == "PSHELL" and is_general(card, known):
        return ThinProperty(card, general_shell(card, known, notes), 0, tuple(materials_of(card).values()))
    material, section = SECTIONS[card.name](card, notes)
    if isinstance(section, ShellSection) and "MAT8" in {mat.name for mat in known.get(material, ())}:
        ply = Laminate((Ply(material, section.thickness),), section.nonstructural)
        return ThinProperty(card, ply, 0, (material,))
    if isinstance(section, Laminate):
        half = 0.5 * section.thickness
        middle = card.real(1, "the position Z0 of the lower face of the laminate", -half) + half
        return ThinProperty(card, section, 0, tuple(ply.material for ply in section.plies), middle)
    return ThinProperty(card, section, material, (material,))


def _regions(
    elements: Sequence[Card], ids: IntArray, cards: Cards, used_ids: IntArray, required: bool
) -> tuple[IntArray, dict[int, Card]]:
    """Region (n,) of each element, 0 if its property is missing, and the cards of the regions; used_ids: other ids."""
    property_cards: dict[tuple[str, int], Card] = {}
    for card in cards.of(*PROPERTIES):
        property_cards.setdefault((card.name, card.integer(0, "the property id")), card)
    region = np.zeros(len(elements), dtype=np.int64)
    properties: dict[int, Card] = {}
    alone = []
    for i, card in enumerate(elements):
        if card.name == "CONROD":
            alone.append(i)
            continue
        number = card.integer(1, "the property id", int(ids[i]))
        property_card = next(
            (property_cards[name, number] for name in OF[card.name] if (name, number) in property_cards), None
        )
        if property_card is None:
            if required:
                raise _no_property(card, number, cards)
            continue
        other = properties.setdefault(number, property_card)
        if other is property_card:
            region[i] = number
        elif required:
            raise property_card.error(
                f"property id {number} is used twice (first at {other.where})", "use a unique id for every property"
            )
    free = max([*used_ids.tolist(), *(number for _, number in property_cards)]) + 1
    like: dict[tuple[str, ...], int] = {}
    for i in alone:
        values = tuple(elements[i].text(field) for field in range(3, 8))
        if values not in like:
            like[values] = free + len(like)
            properties[like[values]] = elements[i]
        region[i] = like[values]
    return region, properties


def _no_property(card: Card, number: int, cards: Cards) -> DeckError:
    wanted = " or ".join(OF[card.name])
    other_card = next(
        (name for name in cards if _PROPERTY.match(name) and any(c.text(0) == str(number) for c in cards[name])), None
    )
    what = f"is a {other_card}, but must be a {wanted}" if other_card else f"has no {wanted} card in the deck"
    remedy = f"assign a {wanted} to these elements" if other_card else f"add a {wanted} with id {number}"
    return card.error(f"property {number} {what}", f"{remedy}, or ignore these elements (mesh.ignore: [{card.name}])")


def _unused(cards: Cards, properties: Mapping[int, ThinProperty]) -> dict[str, int]:
    """Cards of unused properties with their number."""
    used = Counter(thin_property.card.name for thin_property in properties.values())
    counts = {name: len(cards.of(name)) - used[name] for name in PROPERTIES}
    return {f"{name} that no element refers to": count for name, count in counts.items() if count}
