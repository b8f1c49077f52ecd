"""Shells, beams and rods of a Nastran deck with their properties, each a region of its own."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
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
from strainsight.decks.nastran.cards import Card, Cards, Elements, origin, unique_ids
from strainsight.decks.nastran.grids import Grids
from strainsight.decks.nastran.materials import COMPOSITES, laminate
from strainsight.decks.nastran.shells import (
    SHELLS,
    general_shell,
    is_general,
    materials_of,
    read_shells,
    shell_materials,
    shell_section,
)
from strainsight.errors import DeckError
from strainsight.mesh.model import CellBlock, IntArray, Origin
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
"""Card → its material, 0 where its plies have theirs, and its section; a CONROD has its own."""
PROPERTIES = tuple(name for name in SECTIONS if name[0] == "P")
OF = {
    **dict.fromkeys(SHELLS, ("PSHELL", *COMPOSITES)),
    "CBAR": ("PBAR", "PBARL"),
    "CBEAM": ("PBEAM", "PBEAML"),
    "CROD": ("PROD",),
    "CTUBE": ("PTUBE",),
}
"""Card of an element → those of its properties."""
ELEMENTS = (*SHELLS, *BEAMS, *RODS)
TAKEN = (*ELEMENTS, *DEFAULTS.values(), *PROPERTIES)
_PROPERTY = re.compile(
    r"P(SHELL|COMP|SHEAR|PLANE|SOLID|LSOLID|BAR|BEAM|BEND|BCOMP|BMSECT|BRSECT|ROD|TUBE|BUSH|ELAS|DAMP)"
)


@dataclass(frozen=True)
class Thin:
    """shells, beams and what they refer to: region → the card of its property, material and section, and of shells of several
    materials which; where the elements stand;
    how many of each card are left out."""

    shells: tuple[ShellBlock, ...]
    beams: tuple[BeamBlock, ...]
    properties: dict[int, Card]
    materials: dict[int, int]
    sections: dict[int, Section]
    general: dict[int, tuple[int, ...]]
    elements: Origin
    left_out: Counter[str]

    def named(self, region: int) -> tuple[int, ...]:
        """Ids of the materials that a region refers to."""
        section = self.sections[region]
        if region in self.general:
            return self.general[region]
        return (
            tuple(ply.material for ply in section.plies) if isinstance(section, Laminate) else (self.materials[region],)
        )

    @property
    def only_beams(self) -> set[int]:
        """Ids of the materials that no shell is of."""
        shells = {
            mid for pid in self.sections if not isinstance(self.sections[pid], BeamSection) for mid in self.named(pid)
        }
        return set(self.materials.values()) - shells


def read_thin(
    cards: Cards, grids: Grids, blocks: Sequence[CellBlock], solids: Origin, required: bool, notes: list[str]
) -> Thin:
    """Shells, beams and rods. Each CONROD of other values is a region.

    required: their properties have to be there and supported; otherwise those of others are left out. Raises DeckError for
    that, an id that stands twice, and what `read_shells` and `read_beams` refuse.
    """
    bars = with_defaults(cards)
    own = sorted(
        (card for name in ELEMENTS for card in bars.get(name, cards.of(name))), key=lambda card: (card.file, card.line)
    )
    ids = unique_ids(own, "element")
    if (clash := np.isin(ids, solids.ids)).any():
        card = own[int(np.argmax(clash))]
        raise card.error(f"element id {card.text(0)} stands twice, a solid has it too", "give every element its own id")
    given: dict[tuple[str, int], Card] = {}
    for name in PROPERTIES:
        for card in cards.of(name):
            given.setdefault((name, card.integer(0, "the property id")), card)
    numbers = [card.integer(0, "the property id") for card in cards.of("PSOLID")]
    taken = np.concatenate([[0], numbers, ids, *(np.unique(block.region) for block in blocks)]).astype(np.int64)
    region, properties = _regions(own, ids, given, cards, taken, required)
    materials: dict[int, int] = {}
    sections: dict[int, Section] = {}
    middles: dict[int, float] = {}
    general: dict[int, tuple[int, ...]] = {}
    orthotropic = {card.text(0) for card in cards.of("MAT8")}
    known = shell_materials(cards)
    for number, card in list(properties.items()):
        if not required and number in numbers:  # a PSOLID has it
            del properties[number]
            continue
        try:
            section: Section
            if card.name == "PSHELL" and is_general(card, known):
                materials[number], section = 0, general_shell(card, known, notes)
                general[number] = tuple(materials_of(card).values())
            else:
                materials[number], section = SECTIONS[card.name](card, notes)
            if isinstance(section, ShellSection) and str(materials[number]) in orthotropic:
                section = Laminate((Ply(materials[number], section.thickness),), section.nonstructural)
                materials[number] = 0
            elif isinstance(section, Laminate):
                half = 0.5 * section.thickness
                middles[number] = card.real(1, "the place Z0 of the lower face", -half) + half
        except DeckError:
            if required:
                raise
            del properties[number]
            continue
        sections[number] = section
    kept = np.isin(region, list(sections))
    left_out = Counter(card.name for card, there in zip(own, kept, strict=True) if not there)
    left_out.update(_unused(cards, properties))
    elements = Elements([card for card, there in zip(own, kept, strict=True) if there], ids[kept], region[kept])
    shells = read_shells(elements.of(SHELLS), grids, sections, middles, notes)
    beams = read_beams(elements.of((*BEAMS, *RODS)), grids)
    called = {int(card.text(0)): f"{card.name} {card.text(0)}" for card in elements.cards}
    blocks_of: tuple[ShellBlock | BeamBlock, ...] = (*shells, *beams)
    for block in blocks_of:
        note_shared(block.nodes, [called[number] for number in block.ids.tolist()].__getitem__, notes)
    where = origin(elements.ids, elements.cards)
    return Thin(shells, beams, properties, materials, sections, general, where, left_out)


def _regions(
    own: Sequence[Card],
    ids: IntArray,
    given: dict[tuple[str, int], Card],
    cards: Cards,
    taken: IntArray,
    required: bool,
) -> tuple[IntArray, dict[int, Card]]:
    """Region (n,) of each element, 0 where its property is not there, and the cards of the regions; taken: other ids."""
    region = np.zeros(len(own), dtype=np.int64)
    properties: dict[int, Card] = {}
    alone = []
    for i, card in enumerate(own):
        if card.name == "CONROD":
            alone.append(i)
            continue
        number = card.integer(1, "the property id", int(ids[i]))
        found = next((given[name, number] for name in OF[card.name] if (name, number) in given), None)
        if found is None:
            if required:
                raise _no_property(card, number, cards)
            continue
        other = properties.setdefault(number, found)
        if other is not found and not required:
            continue
        if other is not found:
            raise found.error(
                f"property id {number} stands twice (first at {other.where})", "give every property its own id"
            )
        region[i] = number
    free = max([*taken.tolist(), *(number for _, number in given)]) + 1
    like: dict[tuple[str, ...], int] = {}
    for i in alone:
        values = tuple(own[i].text(field) for field in range(3, 8))
        if values not in like:
            like[values] = free + len(like)
            properties[like[values]] = own[i]
        region[i] = like[values]
    return region, properties


def _no_property(card: Card, number: int, cards: Cards) -> DeckError:
    wanted = " or ".join(OF[card.name])
    there = next(
        (name for name in cards if _PROPERTY.match(name) and any(c.text(0) == str(number) for c in cards[name])), None
    )
    what = f"is a {there}, not a {wanted}" if there else f"is not in the deck ({wanted})"
    remedy = "give these elements" if there else f"add, with id {number},"
    return card.error(
        f"property {number} {what}", f"{remedy} a {wanted}, or leave them out (mesh.ignore: [{card.name}])"
    )


def _unused(cards: Cards, properties: dict[int, Card]) -> dict[str, int]:
    """Cards of properties that make no region, with how many there are."""
    used = Counter(card.name for card in properties.values())
    counts = {name: len(cards.of(name)) - used[name] for name in PROPERTIES}
    return {f"{name} that no element refers to": count for name, count in counts.items() if count}
