"""Relations of a Nastran deck: the MPC cards of the set that its case control selects."""

from __future__ import annotations

from collections import Counter

import numpy as np

from strainsight.decks.nastran.cards import Card, Deck
from strainsight.decks.nastran.grids import NodeTable
from strainsight.decks.nastran.supports import combined_sets, selections
from strainsight.decks.numbers import parse_integer
from strainsight.errors import DeckError
from strainsight.mesh.model import FloatArray, IntArray


def selected_cards(deck: Deck, ignored: Counter[str]) -> list[Card]:
    """The MPC cards that count: of the set that MPC = n of the case control selects, itself or through MPCADD; without a case
    control those of the only set. The others are counted in `ignored`, which has those that the reader was asked to leave out.

    Raises DeckError for subcases that select different sets, several sets without a case control, and a set that is not there.
    """
    found = deck.cards.get("MPC", [])
    added = deck.cards.get("MPCADD", [])
    if not found and not added:
        return []
    selected = _selected_sets(deck, found, left_out=bool(ignored["MPC"] or ignored["MPCADD"]))
    combined = combined_sets(deck, "MPCADD")
    members: set[int] = set().union(*(combined.get(number, {number}) for number in selected))
    for card in (*found, *added):
        number = card.integer(0, "the set id")
        if number not in members and number not in selected:
            ignored[f"{card.name} of a set that is not selected"] += 1
    return [card for card in found if card.integer(0, "the set id") in members]


def _selected_sets(deck: Deck, found: list[Card], *, left_out: bool) -> set[int]:
    """The set that counts, none or one."""
    combined = combined_sets(deck, "MPCADD")
    single = {card.integer(0, "the set id") for card in found}
    for card in deck.cards.get("MPCADD", []):
        if (lost := combined[int(card.fields[0])] - single) and not left_out:
            raise card.error(f"set {min(lost)} has no MPC", "add the set, or take it out")
    there = single | set(combined)
    if not deck.case_control:
        top = there - {member for members in combined.values() for member in members}
        if len(top) > 1:
            card = next(card for card in (*found, *deck.cards.get("MPCADD", [])) if int(card.fields[0]) == max(top))
            raise card.error(
                f"{len(top)} sets of relations ({', '.join(map(str, sorted(top)))}) and no case control that selects one",
                "put the line MPC = n of the set before BEGIN BULK, or leave the relations out (mesh.ignore: [MPC, MPCADD])",
            )
        return top
    chosen = selections(deck, "MPC")
    if len(chosen) > 1:
        raise DeckError(
            f"the subcases select different relations ({', '.join(chosen)})",
            where=[*chosen.values()][1].where,
            remedy="keep one line MPC = n in the case control",
        )
    for text, line in chosen.items():
        number = parse_integer(text) or 0
        if number not in there and not left_out:
            raise DeckError(
                f"MPC = {text} selects a set that is not in the deck",
                where=line.where,
                remedy=f"select one of {', '.join(map(str, sorted(there)))}, or remove the line",
            )
        return {number}
    return set()


def terms(card: Card, nodes: NodeTable) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows, components 0-5 and coefficients of an MPC, first the motion that follows. Raises DeckError for what is no term."""
    node: list[int] = []
    component: list[int] = []
    value: list[float] = []
    if stray := [i for i in range(7, len(card.fields)) if i % 8 in (7, 0) and card.text(i)]:
        raise card.error(
            f"{card.text(stray[0])!r} stands in field {stray[0] + 2}, which is blank", "two terms stand on a line"
        )
    for k in range((len(card.fields) + 2) // 3):
        i = 8 * (k // 2) + 1 + 3 * (k % 2)
        if not any(card.text(i + j) for j in range(3)):
            continue
        digit = card.integer(i + 1, "the component", 0)
        row = nodes.row(card.integer(i, "the node id"), card)
        if not 1 <= digit <= 6:
            raise card.error(
                f"component {digit} (field {i + 3}) is not one of 1 to 6", "give one component of the node"
            )
        node.append(row)
        component.append(digit - 1)
        value.append(card.real(i + 2, "the coefficient", 0.0))
    if not node:
        raise card.error("has no terms", "give nodes, components and coefficients")
    if value[0] == 0:
        raise card.error("the coefficient of the first term is 0", "give a motion first that can follow the others")
    return np.array(node, dtype=np.int64), np.array(component, dtype=np.int64), np.array(value)
