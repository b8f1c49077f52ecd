"""What cards of a deck that are not supported would do to the structure, by patterns of its format, and their names."""

from __future__ import annotations

import re
from collections.abc import Iterable

ENFORCED = "ENFORCED DISPLACEMENT"
"""What a config calls a support that is not at zero; with it left out the components are free."""
HELD = f"{ENFORCED} of another value than zero"
"""The same where the components are held, as in a frequency analysis of any program."""
MISSING_END = "MISSING ENDDATA"
"""What a config calls that a deck with BEGIN BULK ends without ENDDATA, so that it may be cut off."""
PRELOAD = "PRELOAD"
"""What a config calls the stress under which a deck asks for modes; cards are "PRELOAD by STATSUB" and the like."""
LINEAR = {
    **dict.fromkeys(("S9R5", "CQUAD"), "eight or four nodes"),
    **dict.fromkeys(("T3D3", "CBEAM3"), "two nodes"),
}
"""Shells of nine nodes and quadratic trusses, in the spelling of `short` → what to mesh with instead."""
_UNUSED = re.compile(r" that no | not selected$")


def spelt(card: str) -> str:
    """A card as a config may name it, in one spelling: "*ELEMENT, TYPE=S4R" and "S4R", "*TIE" and "Tie" are the same."""
    return card.partition(" by ")[0].upper().replace(" ", "").replace("*", "").removeprefix("ELEMENT,TYPE=")


def short(card: str) -> str:
    """A card as a config names it best: without what YAML would take for something else."""
    name = card.partition(" by ")[0].removeprefix("*").removeprefix("ELEMENT, TYPE=")
    return f'"{name}"' if "," in name else name


def effects(cards: Iterable[str], structural: re.Pattern[str], control: re.Pattern[str]) -> dict[str, str]:
    """Card → "structure" or "none" (see `Mesh`), where a pattern matches its beginning; not of cards that nothing refers to."""
    found: dict[str, str] = {}
    for card in cards:
        if control.match(card):
            found[card] = "none"
        elif structural.match(card) and not _UNUSED.search(card):
            found[card] = "structure"
    return found
