"""Supports, rigid and averaging elements and point masses of a Nastran deck."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.cards import Card, Deck, parse_integer, parse_real
from strainsight.mesh.model import AveragingElement, FloatArray, IntArray, PointMass, RigidElement
from strainsight.mesh.nastran_sets import expand
from strainsight.mesh.text import Line

_SPC = re.compile(r"\s*SPC\s*=\s*(\w+)", re.IGNORECASE)


class NodeTable:
    """Ids (n,) of the file to rows of `Mesh.position`; turned (n,): nodes with a displacement system of their own."""

    def __init__(self, ids: IntArray, turned: np.ndarray):
        self.ids = ids
        self.turned = turned
        self._order = np.argsort(ids)
        self.sorted = ids[self._order]

    def rows(self, ids: IntArray) -> tuple[IntArray, np.ndarray]:
        """Rows, and where an id is missing."""
        at = np.minimum(np.searchsorted(self.sorted, ids), len(self.sorted) - 1)
        return self._order[at].astype(np.int64), self.sorted[at] != ids

    def row(self, node_id: int, card: Card) -> int:
        """Row of one node; DeckError where it is missing."""
        return int(self.rows_of_cards(np.array([[node_id]]), [card])[0, 0])

    def rows_of_cards(self, ids: IntArray, cards: Sequence[Card]) -> IntArray:
        """Rows for ids (c, k), one row of ids a card; DeckError at the first card with a missing node."""
        rows, missing = self.rows(ids)
        if missing.any():
            i, j = np.argwhere(missing)[0]
            raise cards[i].error(
                f"node {ids[i, j]} is not in the deck", f"add a GRID card with id {ids[i, j]}, or correct the id"
            )
        return rows


def components(text: str, card: Card) -> tuple[int, ...]:
    """Digits 1-6 as components 0-5."""
    if not text or any(digit not in "123456" for digit in text) or len(set(text)) < len(text):
        raise card.error(f"components {text!r} are not made of the digits 1 to 6", "write for example 123")
    return tuple(sorted(int(digit) - 1 for digit in text))


def _check_turned(wanted: tuple[int, ...], rows: IntArray, nodes: NodeTable, card: Card) -> None:
    """Components along a system of the node's own (CD) are taken over only where all three of a kind are meant."""
    whole = all(sum(c // 3 == kind for c in wanted) in (0, 3) for kind in (0, 1))
    if not whole and nodes.turned[rows].any():
        node = nodes.ids[rows[np.argmax(nodes.turned[rows])]]
        raise card.error(
            f"components {''.join(str(c + 1) for c in wanted)} of node {node} lie along its own system CD",
            "write the node with CD = 0 and the support in the basic system, or fix all three components",
        )


def fixed_components(
    deck: Deck, nodes: NodeTable, permanent: list[tuple[Card, int, str]], ignored: Counter[str]
) -> IntArray:
    """(f, 2) pairs (row, component) that SPC, SPC1 and the GRID cards hold at zero, each once, sorted.

    The case control selects the set; without a selection the only set counts.
    Raises DeckError for several sets without a selection, for an enforced motion and for nodes that are not there.
    """
    pairs: list[tuple[int, int]] = []
    for card, row, text in permanent:
        wanted = components(text, card)
        _check_turned(wanted, np.array([row]), nodes, card)
        pairs += [(row, c) for c in wanted]
    selected = _selected_sets(deck)
    for card in (*deck.cards.get("SPC", []), *deck.cards.get("SPC1", [])):
        if card.integer(0, "the set id") not in selected:
            ignored[f"{card.name} of a set that is not selected"] += 1
            continue
        for row, wanted in _supports(card, nodes):
            pairs += [(row, c) for c in wanted]
    return np.unique(np.array(pairs, dtype=np.int64).reshape(-1, 2), axis=0)


def _supports(card: Card, nodes: NodeTable) -> list[tuple[int, tuple[int, ...]]]:
    if card.name == "SPC1":
        wanted = components(card.text(1), card)
        ids, _ = expand(card.fields[2:], nodes.sorted, card.where)
        if not ids.size:
            raise card.error("holds no node of the deck", "correct the ids, or remove the card")
        rows = nodes.rows_of_cards(ids[None, :], [card])[0]
        _check_turned(wanted, rows, nodes, card)
        return [(int(row), wanted) for row in rows]
    found = []
    for i in (1, 4):
        if not card.text(i):
            continue
        if card.real(i + 2, "the enforced displacement", 0.0) != 0:
            raise card.error(f"an enforced displacement of {card.text(i + 2)}", "only supports at zero are taken over")
        row, wanted = nodes.row(card.integer(i, "the node id"), card), components(card.text(i + 1), card)
        _check_turned(wanted, np.array([row]), nodes, card)
        found.append((row, wanted))
    return found


def _selected_sets(deck: Deck) -> set[int]:
    """Ids of the SPC and SPC1 sets that count."""
    combined: dict[int, set[int]] = {}
    for card in deck.cards.get("SPCADD", []):
        number = card.integer(0, "the set id")
        if number in combined:
            raise card.error("the set id stands twice")
        combined[number] = {card.integer(1 + i, "a set id") for i, token in enumerate(card.fields[1:]) if token}
    supports = [*deck.cards.get("SPC", []), *deck.cards.get("SPC1", [])]
    single = {card.integer(0, "the set id") for card in supports}
    for card in deck.cards.get("SPCADD", []):
        if lost := combined[int(card.fields[0])] - single:
            raise card.error(f"set {min(lost)} has no SPC or SPC1", "add the set, or take it out")
    chosen: dict[str, Line] = {}
    for line in deck.case_control:
        if match := _SPC.match(line.text):
            chosen.setdefault(match[1], line)
    if len(chosen) > 1:
        raise DeckError(
            f"the subcases select different supports ({', '.join(chosen)})",
            where=[*chosen.values()][1].where,
            remedy="keep one SPC = n in the case control",
        )
    for text, line in chosen.items():
        number = parse_integer(text) or 0
        if number not in single and number not in combined:
            raise DeckError(
                f"SPC = {text} selects a set that is not in the deck",
                where=line.where,
                remedy=f"select one of {', '.join(map(str, sorted(single | set(combined)))) or 'the sets you add'}",
            )
        return combined.get(number, {number})
    top = (single | set(combined)) - {member for members in combined.values() for member in members}
    if len(top) > 1:
        card = next(card for card in (*supports, *deck.cards.get("SPCADD", [])) if int(card.fields[0]) == max(top))
        raise DeckError(
            f"{len(top)} sets of supports ({', '.join(map(str, sorted(top)))}) and no selection",
            where=card.where,
            remedy="select one with SPC = n in the case control, before BEGIN BULK",
        )
    number = next(iter(top), 0)
    return combined.get(number, {number})


def rigid_elements(cards: dict[str, list[Card]], nodes: NodeTable) -> tuple[RigidElement, ...]:
    """RBE2 on translations; rotations of dependent solid nodes have no stiffness and are left out.

    Raises DeckError for a dependent rotation that is another element's reference motion.
    """
    found = cards.get("RBE2", [])
    references = {
        card.integer(i, "the reference node") for name, i in (("RBE2", 1), ("RBE3", 2)) for card in cards.get(name, [])
    }
    elements = []
    for card in found:
        reference = nodes.row(card.integer(1, "the reference node GN"), card)
        wanted = components(card.text(2), card)
        tokens = [token for token in card.fields[3:] if token]
        if tokens and parse_integer(tokens[-1]) is None and parse_real(tokens[-1]) is not None:
            tokens = tokens[:-1]  # thermal expansion, of no effect here
        ids = np.unique(expand(tokens, nodes.sorted, card.where)[0])
        if not ids.size:
            raise card.error("has no dependent node", "give the nodes that follow the reference node")
        rows = nodes.rows_of_cards(ids[None, :], [card])[0]
        if reference in rows:
            raise card.error(
                f"the reference node {card.fields[1]} is also dependent", "take it out of the dependent nodes"
            )
        chained = [int(i) for i in ids if int(i) in references]
        if chained and any(c > 2 for c in wanted):
            raise card.error(
                f"node {chained[0]} is dependent here in rotation and the reference of another element",
                "tie the dependent nodes of both to one reference node",
            )
        _check_turned(wanted, rows, nodes, card)
        translations = tuple(c for c in wanted if c < 3)
        if not translations:
            raise card.error(f"components {card.fields[2]} tie rotations only, which solids do not have", "tie 123")
        elements.append(RigidElement(card.integer(0, "the element id"), reference, rows, translations))
    return tuple(elements)


def averaging_elements(cards: dict[str, list[Card]], nodes: NodeTable) -> tuple[AveragingElement, ...]:
    """RBE3 whose weights act on the translations 123 of its nodes and that has no UM set."""
    elements = []
    for card in cards.get("RBE3", []):
        reference = nodes.row(card.integer(2, "the reference node"), card)
        wanted = components(card.text(3), card)
        ids, weights = _weights(card)
        rows = nodes.rows_of_cards(ids[None, :], [card])[0]
        if len(np.unique(rows)) < len(rows) or reference in rows:
            raise card.error("a node stands twice", "give every node once, and not the reference node")
        _check_turned(wanted, np.array([reference]), nodes, card)
        elements.append(AveragingElement(card.integer(0, "the element id"), reference, rows, weights, wanted))
    return tuple(elements)


def _weights(card: Card) -> tuple[IntArray, FloatArray]:
    """Groups of weight, components, nodes."""
    tokens = [token.upper() for token in card.fields[4:] if token]
    if "UM" in tokens:
        raise card.error("a UM set is not taken over", "let the RBE3 depend on its reference node")
    if "ALPHA" in tokens:
        tokens = tokens[: tokens.index("ALPHA")]
    ids: list[int] = []
    weights: list[float] = []
    weight, i = None, 0
    while i < len(tokens):
        node = parse_integer(tokens[i])
        if node is not None and weight is not None:
            ids.append(node)
            weights.append(weight)
            i += 1
            continue
        weight = parse_real(tokens[i]) if node is None else None
        if weight is None or weight <= 0:
            raise card.error(f"{tokens[i]!r} where a positive weight (with a decimal point) should stand")
        if i + 1 >= len(tokens) or tokens[i + 1] != "123":
            raise card.error(
                f"the components after weight {tokens[i]} are not 123",
                "average translations 123 (solids have no rotations)",
            )
        i += 2
    if not ids:
        raise card.error("has no nodes to average")
    return np.array(ids, dtype=np.int64), np.array(weights)


def point_masses(
    cards: dict[str, list[Card]], nodes: NodeTable, scale: float, ignored: Counter[str]
) -> tuple[PointMass, ...]:
    """CONM2: the mass times `scale` (PARAM WTMASS); offset and inertia are counted as ignored."""
    masses, seen = [], set()
    for card in cards.get("CONM2", []):
        number, node = card.integer(0, "the element id"), card.integer(1, "the node id")
        if number in seen:
            raise card.error("the id stands twice", "give every point mass its own id")
        seen.add(number)
        mass = card.real(3, "the mass", 0.0)
        if mass < 0:
            raise card.error(f"the mass is {mass:g}, negative", "give a positive mass")
        ignored["CONM2 offset"] += any(card.real(i, "the offset", 0.0) for i in (4, 5, 6)) or card.text(2) == "-1"
        ignored["CONM2 inertia"] += any(card.real(i, "the inertia", 0.0) for i in range(8, 14))
        masses.append(PointMass(number, nodes.row(node, card), scale * mass))
    for name in ("CONM2 offset", "CONM2 inertia"):
        if not ignored[name]:
            del ignored[name]
    return tuple(masses)
