"""PARAM cards by name, of the bulk data and of the case control: what each would do to the structure."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from difflib import get_close_matches

from strainsight.decks.faults import Doubt
from strainsight.decks.nastran.cards import Card, Deck
from strainsight.decks.text import parse_real

HONOURED = ("WTMASS",)
"""Those that count here as in Nastran."""
SCALES = ("CK1", "CK2", "CK3", "CM1", "CM2", "CB1", "CB2", "CP1", "CP2")
"""Factors on stiffness, mass, damping and loads: without effect where they are 1."""
STRUCTURE = (*SCALES, "LGDISP", "INREL")
"""Those that make the structure another one, or hold it in another way: large displacements, inertia relief."""
NONE = (
    *(
        "POST",
        "POSTEXT",
        "PRGPST",
        "PRTMAXIM",
        "PRTRESLT",
        "GRDPNT",
        "OGEOM",
        "OUGCORD",
        "OMAXR",
        "EXTOUT",
        "ECHO",
        "NOCOMPS",
    ),
    *(
        "AUTOSPC",
        "AUTOSPCR",
        "EPZERO",
        "EPPRT",
        "SPCGEN",
        "SINGULAR",
        "MAXRATIO",
        "BAILOUT",
        "CHECKOUT",
        "MESH",
        "USETPRT",
    ),
    *("RESVEC", "RESVINER", "RESVALT", "LFREQ", "HFREQ", "LMODES", "LFREQFL", "HFREQFL", "LMODESFL", "DDRMM", "MODACC"),
    *("G", "GFL", "W3", "W4", "KDAMP", "ALPHA1", "ALPHA2", "NDAMP", "HYBRID"),
    *("K6ROT", "SNORM", "COUPMASS", "TINY", "SHIFT1", "AUNITS", "DBALL", "NASPRT", "NEWSEQ", "SOLVE", "UNSYMF", "TABS"),
)
"""Output, checks, residual vectors, damping (which the config states), and what elements of another program do within: drilling
stiffness, normals and masses. Elements here have their own, and mass is consistent: COUPMASS that lumps it is of the others."""
_LINE = re.compile(r"\s*PARAM[\s,]+([A-Z][A-Z0-9]*)[\s,=]+([^\s,$]+)", re.IGNORECASE)


def _of_case_control(deck: Deck) -> list[Card]:
    """PARAM lines of the case control, as cards of a name and a value."""
    lines = [(line, match) for line in deck.case_control if (match := _LINE.match(line.text))]
    return [Card("PARAM", [match[1].upper(), match[2]], line.file, line.number) for line, match in lines]


def mass_scale(deck: Deck) -> float:
    """PARAM WTMASS: the factor that turns the deck's weights into masses.

    Raises DeckError where it is not positive, and where bulk data and case control, or subcases, state different ones."""
    found = _named(deck.cards.get("PARAM", []), "WTMASS")[-1:]  # of the bulk data the last one counts
    found += _named(_of_case_control(deck), "WTMASS")
    factors = [card.real(1, "the factor") for card in found]
    for card, scale in zip(found, factors, strict=True):
        if scale <= 0:
            raise card.error(f"the factor is {scale:g}, not positive")
        if scale != factors[0]:
            raise card.error(
                f"the factor is {scale:g}, and {factors[0]:g} at {found[0].where}", "state the one that holds, once"
            )
    return factors[0] if factors else 1.0


def lumped(deck: Deck) -> bool:
    """Whether a deck says that its mass is lumped: COUPMASS, in its last card, that is not positive."""
    return any((parse_real(card.text(1)) or 0) <= 0 for card in _named(_parameters(deck), "COUPMASS")[-1:])


def large_displacements(deck: Deck) -> bool | None:
    """What LGDISP states, in its last card; None where there is none."""
    found = _named(_parameters(deck), "LGDISP")
    return (parse_real(found[-1].text(1)) or 0) > 0 if found else None


def count_parameters(deck: Deck, ignored: Counter[str], notes: list[str]) -> dict[str, str]:
    """Count what is not honoured, "PARAM POST", and say what each does: "structure" or "none" (see `Mesh`); a name that is nearly
    one of those that count is a doubt."""
    effect = {}
    for card in _parameters(deck):
        name = card.text(0).upper()
        if name in HONOURED or (name in SCALES and _is(card, 1.0)) or (name in STRUCTURE and _is(card, 0.0)):
            continue
        if name == "LGDISP" and not large_displacements(deck):
            continue
        ignored[f"PARAM {name}"] += 1
        if name == "COUPMASS" and lumped(deck):
            effect[f"PARAM {name}"] = "structure"
        elif name in STRUCTURE or name in NONE:
            effect[f"PARAM {name}"] = "structure" if name in STRUCTURE else "none"
        elif meant := get_close_matches(name, (*HONOURED, *STRUCTURE), n=1, cutoff=0.8):
            notes.append(Doubt(f"PARAM {name} ({card.where}) is not known and has no effect: did you mean {meant[0]}?"))
    return effect


def _parameters(deck: Deck) -> tuple[Card, ...]:
    return (*deck.cards.get("PARAM", []), *_of_case_control(deck))


def _named(cards: Sequence[Card], name: str) -> list[Card]:
    return [card for card in cards if card.text(0).upper() == name]


def _is(card: Card, value: float) -> bool:
    return parse_real(card.text(1)) == value
