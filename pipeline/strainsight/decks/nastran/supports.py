"""Supports of a Nastran deck, and the sets of them and of MPC that its case control selects."""

from __future__ import annotations

import re
from collections import Counter

import numpy as np

from strainsight.decks.faults import ENFORCED, HELD, Doubt
from strainsight.decks.nastran.cards import Card, Deck
from strainsight.decks.nastran.case_control import expand
from strainsight.decks.nastran.grids import NodeTable
from strainsight.decks.text import Line, parse_integer
from strainsight.errors import ChoiceError, DeckError
from strainsight.mesh.model import IntArray

_SELECTION = re.compile(r"\s*(SPC|MPC)\s*=\s*(\w+)", re.IGNORECASE)


def components(text: str, card: Card) -> tuple[int, ...]:
    """Digits 1-6 as components 0-5."""
    if not text or any(digit not in "123456" for digit in text) or len(set(text)) < len(text):
        raise card.error(f"components {text!r} are not made of the digits 1 to 6", "write for example 123")
    return tuple(sorted(int(digit) - 1 for digit in text))


def fixed_components(
    deck: Deck,
    nodes: NodeTable,
    permanent: list[tuple[Card, int, str]],
    ignored: Counter[str],
    notes: list[str],
    chosen: int | None = None,
    free: bool = False,
) -> IntArray:
    """(f, 2) pairs (row, component) that SPC, SPC1 and the GRID cards hold, each once, sorted. A displacement that is enforced is
    held at zero, or free, and counted.

    free: what is not held at zero is not held; chosen: the set that counts. Otherwise the case control selects it; without a
    selection the only set counts. `ignored` has the cards that the reader was asked to leave out; notes: that a set counts
    which nothing selects.
    Raises ChoiceError for several selections, and for several sets without one, DeckError for sets and nodes that are not there.
    """
    pairs: list[tuple[int, int]] = []
    for card, row, text in permanent:
        pairs += [(row, c) for c in components(text, card)]
    selected = _selected_sets(deck, chosen, notes, left_out=bool(ignored["SPC"] or ignored["SPC1"]))
    for card in (*deck.cards.get("SPC", []), *deck.cards.get("SPC1", [])):
        if card.integer(0, "the set id") not in selected:
            ignored[f"{card.name} of a set that is not selected"] += 1
            continue
        for row, wanted in _supports(card, nodes, ignored, free):
            pairs += [(row, c) for c in wanted]
    return np.unique(np.array(pairs, dtype=np.int64).reshape(-1, 2), axis=0)


def _supports(card: Card, nodes: NodeTable, ignored: Counter[str], free: bool) -> list[tuple[int, tuple[int, ...]]]:
    if card.name == "SPC1":
        ids, _ = expand(card.fields[2:], nodes.sorted, card.where)
        if not ids.size:
            raise card.error("holds no node of the deck", "correct the ids, or remove the card")
        rows = nodes.rows_of_cards(ids[None, :], [card])[0]
        wanted = components(card.text(1), card)
        return [(int(row), wanted) for row in rows]
    found = []
    for i in (1, 4):
        if not card.text(i):
            continue
        row, wanted = nodes.row(card.integer(i, "the node id"), card), components(card.text(i + 1), card)
        moves = card.real(i + 2, "the enforced displacement", 0.0) != 0
        if moves:
            ignored[ENFORCED if free else HELD] += 1
        if not (moves and free):
            found.append((row, wanted))
    return found


def _selected_sets(deck: Deck, wanted: int | None, notes: list[str], *, left_out: bool) -> set[int]:
    """Ids of the SPC and SPC1 sets that count; left_out: some of those cards were, so that none need be there."""
    combined = combined_sets(deck, "SPCADD")
    supports = [*deck.cards.get("SPC", []), *deck.cards.get("SPC1", [])]
    single = {card.integer(0, "the set id") for card in supports}
    for card in deck.cards.get("SPCADD", []):
        if (lost := combined[int(card.fields[0])] - single) and not left_out:
            raise card.error(f"set {min(lost)} has no SPC or SPC1", "add the set, or take it out")
    there = single | set(combined)
    listed = f"select one of {', '.join(map(str, sorted(there)))}" if there else "add the set"
    if wanted is not None:
        if wanted not in there:
            raise DeckError(f"set {wanted} of supports (mesh.spc) is not in the deck", remedy=listed)
        return combined.get(wanted, {wanted})
    chosen = selections(deck, "SPC")
    selected = tuple(sorted({parse_integer(text) or 0 for text in chosen} & there))
    if len(chosen) > 1 and selected:
        raise ChoiceError(
            f"the subcases select different supports ({', '.join(chosen)})",
            where=[*chosen.values()][1].where,
            remedy=f"say which hold: mesh.spc: {selected[0]}",
            sets=selected,
        )
    for text, line in chosen.items():
        number = parse_integer(text) or 0
        if number not in there and not left_out:
            raise DeckError(
                f"SPC = {text} selects a set that is not in the deck",
                where=line.where,
                remedy=f"{listed}, here or with mesh.spc" if there else listed,
            )
        return combined.get(number, {number})
    top = there - {member for members in combined.values() for member in members}
    if len(top) > 1:
        card = next(card for card in (*supports, *deck.cards.get("SPCADD", [])) if int(card.fields[0]) == max(top))
        raise ChoiceError(
            f"{len(top)} sets of supports ({', '.join(map(str, sorted(top)))}) and no selection",
            where=card.where,
            remedy=f"say which hold: mesh.spc: {min(top)}",
            sets=tuple(sorted(top)),
        )
    number = next(iter(top), 0)
    if top and deck.case_control:
        notes.append(
            Doubt(
                f"the case control selects no supports, so that Nastran has none: the only set of the deck, {number}, holds "
                "here; leave it out with mesh.ignore: [SPC, SPC1], or name it with mesh.spc"
            )
        )
    return combined.get(number, {number})


def selections(deck: Deck, what: str) -> dict[str, Line]:
    """Set ids, as written, that lines "SPC = n" or "MPC = n" of the case control select, and the first line of each."""
    chosen: dict[str, Line] = {}
    for line in deck.case_control:
        if (match := _SELECTION.match(line.text)) and match[1].upper() == what:
            chosen.setdefault(match[2], line)
    return chosen


def combined_sets(deck: Deck, name: str) -> dict[int, set[int]]:
    """Set id → sets that an SPCADD or MPCADD makes it of."""
    found: dict[int, set[int]] = {}
    for card in deck.cards.get(name, []):
        number = card.integer(0, "the set id")
        if number in found:
            raise card.error("the set id stands twice")
        found[number] = {card.integer(1 + i, "a set id") for i, token in enumerate(card.fields[1:]) if token}
    return found
