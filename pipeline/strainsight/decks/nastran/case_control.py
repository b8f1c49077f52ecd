"""Id lists, sets and PARAM of a Nastran deck, and the selections of its case control."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np

from strainsight.decks.faults import Doubt
from strainsight.decks.nastran.cards import Card, Deck
from strainsight.decks.text import Line, describe_non_integer, error_at, is_whole, parse_integer, parse_real
from strainsight.mesh.model import IntArray

_SELECTION = re.compile(r"\s*(SPC|MPC)\s*=\s*(\w+)", re.IGNORECASE)
_SET = re.compile(r"\s*SET\s+(\d+)\s*=\s*(.*)$", re.IGNORECASE)


def expand(tokens: Sequence[str], existing: IntArray, where: str) -> tuple[IntArray, IntArray]:
    """Ids of a list such as 1, 4, THRU, 9, EXCEPT, 7, BY, 2, restricted to the existing ids.

    A range contains only existing ids; a single id need not exist. existing (n,) sorted. Returns (all ids in the
    order of the list, single ids that do not exist). Raises DeckError for other words."""
    words = [token.upper() for token in tokens if token]
    parts: list[IntArray] = []
    i, low, high = 0, 1, 0
    while i < len(words):
        if words[i] == "EXCEPT":
            excluded = set()
            i += 1
            while i < len(words) and (value := parse_integer(words[i])) is not None and low <= value <= high:
                excluded.add(value)
                i += 1
            if not excluded or not parts:
                raise error_at(
                    where,
                    "EXCEPT must be followed by ids of the preceding range",
                    "write the list as: first THRU last EXCEPT ids",
                )
            parts[-1] = parts[-1][~np.isin(parts[-1], list(excluded))]
            continue
        first = _id(words[i], where)
        if i + 1 < len(words) and words[i + 1] == "THRU":
            low, high = first, _id(words[i + 2] if i + 2 < len(words) else "", where)
            step, i = 1, i + 3
            if i < len(words) and words[i] == "BY":
                step, i = _id(words[i + 1] if i + 1 < len(words) else "", where), i + 2
            if high < low:
                raise error_at(where, f"the range {low} THRU {high} is decreasing", "write the lower id first")
            within = existing[np.searchsorted(existing, low) : np.searchsorted(existing, high, side="right")]
            parts.append(within[(within - low) % step == 0])
            continue
        low, high = 1, 0
        parts.append(np.array([first], dtype=np.int64))
        i += 1
    ids = np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)
    if not existing.size:
        return ids, ids
    at = np.minimum(np.searchsorted(existing, ids), len(existing) - 1)
    return ids, ids[existing[at] != ids]


def _id(word: str, where: str) -> int:
    value = parse_integer(word)
    if value is None or value < 1:
        what = describe_non_integer("an id", word) if value is None and is_whole(word) else f"{word!r} is not an id"
        raise error_at(where, what, "use positive integers, and ranges first THRU last")
    return value


def sets(
    deck: Deck, node_ids: IntArray, element_ids: IntArray, left_out: Mapping[str, Sequence[Card]], ignored: Counter[str]
) -> tuple[dict[str, IntArray], dict[str, IntArray]]:
    """Node sets and element sets by name.

    SET1 contains nodes; SET3 states its type. A SET of the case control is a node set if all its single ids are nodes, an
    element set if all are elements, and both if both are true. node_ids and element_ids sorted; left_out: ignored cards."""
    nodes: dict[str, IntArray] = {}
    elements: dict[str, IntArray] = {}
    for number, tokens, where in _case_control_sets(deck):
        if "ALL" in tokens or not all(token in ("THRU", "EXCEPT", "BY") or parse_integer(token) for token in tokens):
            ignored["SET of the case control"] += 1
            continue
        is_set = False
        for sets_by_name, ids in ((nodes, node_ids), (elements, element_ids)):
            members, missing = expand(tokens, ids, where)
            if members.size and not missing.size:
                sets_by_name[f"SET-{number}"] = np.unique(members)
                is_set = True
        if not is_set:
            ignored["SET of the case control"] += 1
    for card in deck.cards.of("SET1"):
        tokens = [token for token in card.tokens[1:] if token.upper() != "SKIN"]
        nodes[_name(card, nodes)] = _members(card, tokens, node_ids, "node")
    for card in deck.cards.of("SET3"):
        match card.text(1).upper():
            case "GRID" | "POINT":
                nodes[_name(card, nodes)] = _members(card, card.tokens[2:], node_ids, "node")
            case "ELEM" | "ELEMENT":
                member_tokens = card.tokens[2:]
                if other := _others({**left_out, **deck.cards}, member_tokens, element_ids, card.where):
                    ignored["SET3 with elements that are not imported"] += 1
                    member_tokens = [token for token in member_tokens if token not in other]
                if any(member_tokens):
                    elements[_name(card, elements)] = _members(card, member_tokens, element_ids, "element")
            case _:
                ignored["SET3"] += 1
    return nodes, elements


def _name(card: Card, sets_by_name: dict[str, IntArray]) -> str:
    name = f"{card.name}-{card.integer(0, 'the set id')}"
    if name in sets_by_name:
        raise card.error(f"set {name} is defined twice", f"use a unique id for every {card.name}")
    return name


def _members(card: Card, tokens: Sequence[str], existing: IntArray, what: str) -> IntArray:
    members, missing = expand(tokens, existing, card.where)
    if missing.size:
        raise card.error(f"{what} {missing[0]} is not in the deck", f"remove the id, or add the {what}")
    return np.unique(members)


def _others(cards: Mapping[str, Sequence[Card]], tokens: Sequence[str], imported: IntArray, where: str) -> set[str]:
    """Tokens that are single ids of elements in the deck that are not imported."""
    missing = {str(number) for number in expand(tokens, imported, where)[1].tolist()}
    if not missing:
        return missing
    return missing & {
        card.text(0) for name, cards_of_name in cards.items() if name[0] in "CR" for card in cards_of_name
    }


def _case_control_sets(deck: Deck) -> list[tuple[int, list[str], str]]:
    """(number, words, where) of each SET, including continuation lines after a comma."""
    definitions: list[tuple[int, list[str], str]] = []
    continued = False
    for line in deck.case_control:
        match = _SET.match(line.text)
        if match:
            definitions.append((_id(match[1], line.where), [], line.where))
        if match or continued:
            definitions[-1][1].extend((match[2] if match else line.text).replace(",", " ").upper().split())
            continued = line.text.endswith(",")
    return definitions


@dataclass(frozen=True)
class CardSets:
    """Sets of supports ("SPC") or constraint equations ("MPC"), with their name `what`; cards of all; combined: set → sets of
    its SPCADD or MPCADD; ids of all, top: sets that are not part of another; chosen: ids, as written, selected by lines "SPC = n"
    of the case control, with the first line of each; left_out: some cards are ignored, so sets may be missing."""

    what: str
    cards: list[Card]
    combined: dict[int, set[int]]
    ids: set[int]
    top: set[int]
    chosen: dict[str, Line]
    left_out: bool

    def parts(self, number: int) -> set[int]:
        """Sets that form a combined set, or the set itself."""
        return self.combined.get(number, {number})

    def card(self, number: int) -> Card:
        """The first card of a set."""
        return next(card for card in self.cards if int(card.tokens[0]) == number)

    def choices(self, more: str = "") -> str:
        """Remedy for a missing set; more: alternative to the selection of another set."""
        return (
            f"select one of the {self.what} sets {', '.join(map(str, sorted(self.ids)))}{more}"
            if self.ids
            else f"add {self.what} cards with this set id"
        )

    def select(self, more: str) -> int:
        """The set that the first line selects. Raises DeckError, with `more` in the remedy, if it is missing."""
        text, line = next(iter(self.chosen.items()))
        number = parse_integer(text) or 0
        if number not in self.ids and not self.left_out:
            raise line.error(
                f"{self.what} = {text} selects an {self.what} set that is not in the deck", self.choices(more)
            )
        return number


def card_sets(deck: Deck, what: str, names: Sequence[str], *, left_out: bool) -> CardSets:
    """The sets on cards of these names. Raises DeckError for a combined set with a missing member."""
    single = {card.integer(0, f"the {what} set id") for card in deck.cards.of(*names)}
    combined: dict[int, set[int]] = {}
    for card in deck.cards.of(f"{what}ADD"):
        number = card.integer(0, f"the {what}ADD set id")
        if number in combined:
            raise card.error(f"set id {number} is used twice", f"use a unique id for every {what}ADD")
        combined[number] = {
            card.integer(1 + i, f"the {what} set id") for i, token in enumerate(card.tokens[1:]) if token
        }
        if (lost := combined[number] - single) and not left_out:
            raise card.error(
                f"{what}ADD refers to set {min(lost)}, which has no {' or '.join(names)} card",
                f"add {what} cards with this set id, or remove the set id from this card",
            )
    ids = single | set(combined)
    chosen: dict[str, Line] = {}
    for line in deck.case_control:
        if (match := _SELECTION.match(line.text)) and match[1].upper() == what:
            chosen.setdefault(match[2], line)
    top = ids - {member for members in combined.values() for member in members}
    return CardSets(what, deck.cards.of(*names, f"{what}ADD"), combined, ids, top, chosen, left_out)


HONOURED = ("WTMASS",)
"""Parameters with the same effect as in Nastran."""
SCALES = ("CK1", "CK2", "CK3", "CM1", "CM2", "CB1", "CB2", "CP1", "CP2")
"""Factors on stiffness, mass, damping and loads, without effect if they are 1."""
STRUCTURE = (*SCALES, "LGDISP", "INREL")
"""Parameters that change the structure or its supports: large displacements, inertia relief."""
NONE = (
    *("POST", "POSTEXT", "PRGPST", "PRTMAXIM", "PRTRESLT", "GRDPNT", "OGEOM", "OUGCORD", "OMAXR", "EXTOUT"),
    *("ECHO", "NOCOMPS", "AUTOSPC", "AUTOSPCR", "EPZERO", "EPPRT", "SPCGEN", "SINGULAR", "MAXRATIO", "BAILOUT"),
    *("CHECKOUT", "MESH", "USETPRT", "RESVEC", "RESVINER", "RESVALT", "LFREQ", "HFREQ", "LMODES", "LFREQFL"),
    *("HFREQFL", "LMODESFL", "DDRMM", "MODACC", "G", "GFL", "W3", "W4", "KDAMP", "ALPHA1", "ALPHA2", "NDAMP"),
    *("HYBRID", "K6ROT", "SNORM", "COUPMASS", "TINY", "SHIFT1", "AUNITS", "DBALL", "NASPRT", "NEWSEQ", "SOLVE"),
    *("UNSYMF", "TABS"),
)
"""Parameters without effect: output, checks, residual vectors, damping (set in the config), and element details of
other programs (drilling stiffness, normals, mass). COUPMASS for a lumped mass is not one of them."""
_LINE = re.compile(r"\s*PARAM[\s,]+([A-Z][A-Z0-9]*)[\s,=]+([^\s,$]+)", re.IGNORECASE)


def _of_case_control(deck: Deck) -> list[Card]:
    """PARAM lines of the case control, as cards of a name and a value."""
    lines = [(line, match) for line in deck.case_control if (match := _LINE.match(line.text))]
    return [Card("PARAM", [match[1].upper(), match[2]], line.file, line.number) for line, match in lines]


def mass_scale(deck: Deck) -> float:
    """PARAM WTMASS: the factor from weights of the deck to masses. Raises DeckError if it is not positive, and if bulk data,
    case control or subcases differ."""
    definitions = _parameters_named(deck.cards.of("PARAM"), "WTMASS")[-1:]  # the last one of the bulk data applies
    definitions += _parameters_named(_of_case_control(deck), "WTMASS")
    factors = [card.real(1, "the factor") for card in definitions]
    for card, scale in zip(definitions, factors, strict=True):
        if scale <= 0:
            raise card.error(f"the factor WTMASS is {scale:g}, not positive", "specify a positive factor")
        if scale != factors[0]:
            raise card.error(
                f"the factor WTMASS is {scale:g} here, but {factors[0]:g} at {definitions[0].where}",
                "keep only one PARAM WTMASS in the deck",
            )
    return factors[0] if factors else 1.0


def is_lumped(deck: Deck) -> bool:
    """Whether the last COUPMASS is not positive, so that the mass of the deck is lumped."""
    return any((parse_real(card.text(1)) or 0) <= 0 for card in _parameters_named(_parameters(deck), "COUPMASS")[-1:])


def large_displacements(deck: Deck) -> bool | None:
    """Whether the last LGDISP activates large displacements; None without LGDISP."""
    parameters = _parameters_named(_parameters(deck), "LGDISP")
    return (parse_real(parameters[-1].text(1)) or 0) > 0 if parameters else None


def count_parameters(deck: Deck, ignored: Counter[str], notes: list[str]) -> dict[str, str]:
    """Count PARAM that are not used, "PARAM POST", and return the effect of each: "structure" or "none" (see
    `Mesh`). A name that resembles a used one is a doubt."""
    effect = {}
    for card in _parameters(deck):
        name, value = card.text(0).upper(), parse_real(card.text(1))
        if name in HONOURED or (name in SCALES and value == 1) or (name in STRUCTURE and value == 0):
            continue
        if name == "LGDISP" and not large_displacements(deck):
            continue
        ignored[f"PARAM {name}"] += 1
        if name == "COUPMASS" and is_lumped(deck):
            effect[f"PARAM {name}"] = "structure"
        elif name in STRUCTURE or name in NONE:
            effect[f"PARAM {name}"] = "structure" if name in STRUCTURE else "none"
        elif meant := get_close_matches(name, (*HONOURED, *STRUCTURE), n=1, cutoff=0.8):
            notes.append(Doubt(f"PARAM {name} ({card.where}) is unknown and has no effect: did you mean {meant[0]}?"))
    return effect


def _parameters(deck: Deck) -> tuple[Card, ...]:
    return (*deck.cards.of("PARAM"), *_of_case_control(deck))


def _parameters_named(cards: Sequence[Card], name: str) -> list[Card]:
    return [card for card in cards if card.text(0).upper() == name]
