"""Solids with only some of their mid-side nodes: the others are put in the middle of their sides, which they follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.decks.faults import plural
from strainsight.decks.nastran.cards import Card
from strainsight.decks.nastran.grids import Grids, NodeTable
from strainsight.decks.nastran.solids import SOLIDS
from strainsight.mesh.joins import STRAIGHT, Relation
from strainsight.mesh.model import FloatArray, IntArray

BLANK = ("", "0")
DIGITS = 16
"""Of a number in the large format."""


@dataclass(frozen=True)
class Middles:
    """side (m, 2): rows of the corners between which each new node lies; cards (m,): the first element that lacks it."""

    side: IntArray
    cards: tuple[Card, ...]


def with_middles(cards: dict[str, list[Card]], grids: Grids, notes: list[str]) -> tuple[Grids, Middles]:
    """The nodes with those that elements lack, and in `cards` these elements with all of their nodes.

    With u_m = ½(u_a + u_b) the side stays straight, and the shape functions are those of the element without that node:
    N_a + ½ N_m, N_b + ½ N_m. Elements that lack the same side share its node. Raises DeckError for a corner that is missing.
    Source: elements with a variable number of nodes, Bathe, Finite Element Procedures (1996), 5.3.
    """
    side: dict[tuple[int, int], int] = {}
    first: list[Card] = []
    last = partial = 0
    for name, kinds in SOLIDS.items():
        few, many = min(kinds), max(kinds)
        kind = kinds[many]
        order = list(kind.nastran_order) or list(range(many))
        for i, card in enumerate(cards.get(name, [])):
            given = card.fields[2 : 2 + many] + [""] * (2 + many - len(card.fields))
            lacking = [place for place in range(few, many) if given[place] in BLANK]
            if few == many or not 0 < len(lacking) < many - few:
                continue
            partial, last = partial + 1, last or _highest(cards, grids)
            for place in lacking:
                # node a of ours is node order[a] of the card
                ends = kind.edges[order.index(place) - few]
                rows = sorted(grids.nodes.row(card.integer(2 + order[end], "a node id"), card) for end in ends)
                key = (rows[0], rows[1])
                if key not in side:
                    side[key] = last + 1 + len(side)
                    first.append(card)
                given[place] = str(side[key])
            cards[name][i] = card._replace(fields=[*card.fields[:2], *given, *card.fields[2 + many :]])
    if not side:
        return grids, Middles(np.zeros((0, 2), dtype=np.int64), ())
    ends_of = np.array([*side], dtype=np.int64)
    notes.append(
        f"{plural(partial, 'solid element')} without some mid-side nodes: {plural(len(side), 'side')} straight, a node in the "
        f"middle of each follows its ends, ids {last + 1} to {last + len(side)} (first {first[0].name} "
        f"{first[0].text(0)}, {first[0].where})"
    )
    ids = np.concatenate([grids.nodes.ids, np.arange(last + 1, last + 1 + len(side))])
    position = np.vstack([grids.position, grids.position[ends_of].mean(axis=1)])
    whole = replace(grids, nodes=NodeTable(ids, cards.get("SPOINT", [])), position=position)
    return whole, Middles(ends_of, tuple(first))


def _highest(cards: dict[str, list[Card]], grids: Grids) -> int:
    """The highest number of any card, of as many digits as an id may have: a node that one names and the deck lacks stays
    missing, and no range has a new one in it."""
    texts = (text for found in cards.values() for card in found for text in card.fields)
    named = (int(text) for text in texts if text.isdecimal() and len(text) <= DIGITS)
    return max(int(grids.nodes.ids.max()), *named)


def straight_sides(middles: Middles, nodes: int, axes: dict[int, FloatArray], number: int) -> tuple[Relation, ...]:
    """u_m = ½(u_a + u_b) of every new node, the last of so many; axes: row → (3, 3) of the nodes that have some; number: of
    relations before these."""
    found: list[Relation] = []
    for m, ends in enumerate(middles.side.tolist(), start=nodes - len(middles.side)):
        for k in range(3):
            node, component, value = [m], [k], [1.0]
            for end in ends:
                along = axes[end][k] if end in axes else np.eye(3)[k]
                there = np.flatnonzero(along)
                node += [end] * len(there)
                component += there.tolist()
                value += (-0.5 * along[there]).tolist()
            found.append(_relation(number + len(found) + 1, node, component, value))
    return tuple(found)


def _relation(number: int, node: Sequence[int], component: Sequence[int], value: Sequence[float]) -> Relation:
    return Relation(number, np.array(node), np.array(component), np.array(value, dtype=float), STRAIGHT)
