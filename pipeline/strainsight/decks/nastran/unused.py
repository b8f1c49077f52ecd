"""Lines of the case control that change the structure and are not honoured, and coordinate systems that nothing refers to."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from strainsight.decks.nastran.cards import Card, Deck
from strainsight.decks.nastran.grids import BY_NODES, BY_POINTS
from strainsight.decks.nastran.shells import SHELLS
from strainsight.decks.text import parse_integer

STRUCTURE = (
    "K2GG",
    "M2GG",
    "K2PP",
    "M2PP",
    "A2GG",
    "SUPORT1",
    "BCONTACT",
    "BCSET",
    "BGSET",
    "NSM",
    "DEFORM",
)
"""Matrices beside the elements, supports of a free structure, contact, more mass."""
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
"""Card → fields that name a coordinate system; of a shell a whole number is one, a real number an angle."""


def structural_lines(deck: Deck) -> list[str]:
    """Names of lines of the case control that make the structure another one: "STATSUB of the case control"."""
    found = (_LINE.match(line.text) for line in deck.case_control)
    return [f"{match[1].upper()} of the case control" for match in found if match]


def unused_systems(cards: Mapping[str, Sequence[Card]]) -> dict[str, int]:
    """CORD1 and CORD2 that no card refers to, "CORD2R that no card refers to" → how many."""
    used = {
        parse_integer(card.text(i))
        for name, fields in SYSTEM_FIELDS.items()
        for card in cards.get(name, [])
        for i in fields
    }
    found: dict[str, int] = {}
    for name in (*BY_POINTS, *BY_NODES):
        # a CORD1 may define two
        of_card = (0, 4) if name in BY_NODES else (0,)
        ids = [parse_integer(card.text(i)) for card in cards.get(name, []) for i in of_card if card.text(i)]
        if count := sum(own not in used for own in ids):
            found[f"{name} that no card refers to"] = count
    return found
