"""Rigid and averaging elements of a Nastran deck."""

from __future__ import annotations

from collections.abc import Set

import numpy as np

from strainsight.decks.nastran.cards import Card
from strainsight.decks.nastran.grids import NodeTable
from strainsight.decks.nastran.sets import expand
from strainsight.decks.nastran.supports import components
from strainsight.decks.numbers import is_whole, no_integer, parse_integer, parse_real
from strainsight.mesh.joins import AveragingElement, RigidElement
from strainsight.mesh.model import FloatArray, IntArray


def rigid_elements(
    cards: dict[str, list[Card]], nodes: NodeTable, turned: Set[int], notes: list[str]
) -> tuple[RigidElement, ...]:
    """RBE2 with all the components that it states; turned: ids of the nodes that other cards turn.

    One that ties rotations only, of nodes of solids that are no reference nodes and so have none, becomes a note.
    """
    elements = []
    references = _references(cards) | turned
    for card in cards.get("RBE2", []):
        reference = nodes.row(card.integer(1, "the reference node GN"), card)
        wanted = components(card.text(2), card)
        tokens = [token for token in card.fields[3:] if token]
        if tokens and not is_whole(tokens[-1]) and parse_real(tokens[-1]) is not None:
            tokens = tokens[:-1]  # thermal expansion, of no effect here
        ids = np.unique(expand(tokens, nodes.sorted, card.where)[0])
        if not ids.size:
            raise card.error("has no dependent node", "give the nodes that follow the reference node")
        rows = nodes.rows_of_cards(ids[None, :], [card])[0]
        if reference in rows:
            raise card.error(
                f"the reference node {card.fields[1]} is also dependent", "take it out of the dependent nodes"
            )
        if min(wanted) > 2 and not references.intersection(ids.tolist()):
            notes.append(
                f"RBE2 {card.fields[0]} ties rotations only (components {card.text(2)}), which nodes of solids do not have: "
                "without effect"
            )
        number = card.integer(0, "the element id")
        elements.append(RigidElement(number, reference, rows, wanted, f"RBE2 {number}"))
    return tuple(elements)


def _references(cards: dict[str, list[Card]]) -> set[int]:
    """Ids of the nodes that an element gives rotations."""
    fields = (("RBE2", 1), ("RBE3", 2))
    return {card.integer(i, "the reference node") for name, i in fields for card in cards.get(name, [])}


def averaging_elements(
    cards: dict[str, list[Card]], nodes: NodeTable, turning: Set[int]
) -> tuple[AveragingElement, ...]:
    """RBE3: groups of weight, components and nodes, and the UM set where it has one.

    turning: rows of the nodes that have rotations, beside the reference nodes; those of another one cannot be averaged.
    """
    elements = []
    turning = turning | {nodes.row(card.integer(2, "the reference node"), card) for card in cards.get("RBE3", [])}
    for card in cards.get("RBE3", []):
        reference = nodes.row(card.integer(2, "the reference node"), card)
        wanted = components(card.text(3), card)
        tokens = [token.upper() for token in card.fields[4:] if token]
        if "ALPHA" in tokens:
            tokens = tokens[: tokens.index("ALPHA")]
        split = tokens.index("UM") if "UM" in tokens else len(tokens)
        ids, weights, directions = _groups(card, tokens[:split])
        rows = nodes.rows_of_cards(ids[None, :], [card])[0]
        _, place = np.unique(rows, return_inverse=True)
        counts = np.zeros((place.max() + 1, 6), dtype=int)
        np.add.at(counts, place, directions)
        if counts.max() > 1 or reference in rows:
            raise card.error(
                "a node stands twice", "give every node once in a direction, and not the reference node among them"
            )
        still = directions[:, 3:].any(axis=1) & ~np.isin(rows, list(turning))
        if still.any():
            raise card.error(
                f"rotations of node {ids[np.argmax(still)]} are averaged, which has none",
                "average translations only, for example 123 (solids have no rotations)",
            )
        dependent = _um_set(card, tokens[split + 1 :], nodes, len(wanted)) if split < len(tokens) else None
        whole = None if directions[:, :3].all() else directions[:, :3]
        turned = directions[:, 3:] if directions[:, 3:].any() else None
        number = card.integer(0, "the element id")
        name = f"RBE3 {number}"
        elements.append(AveragingElement(number, reference, rows, weights, wanted, whole, dependent, name, turned))
    return tuple(elements)


def _groups(card: Card, tokens: list[str]) -> tuple[IntArray, FloatArray, np.ndarray]:
    """Ids (k,), weights (k,) and directions (k, 6) of the groups weight, components, nodes."""
    ids: list[int] = []
    weights: list[float] = []
    directions: list[list[bool]] = []
    weight: float | None = None
    wanted: tuple[int, ...] = ()
    i = 0
    while i < len(tokens):
        node = parse_integer(tokens[i])
        if node is not None and weight is not None:
            ids.append(node)
            weights.append(weight)
            directions.append([c in wanted for c in range(6)])
            i += 1
            continue
        if node is None and is_whole(tokens[i]):
            raise card.error(f"a node id {no_integer(tokens[i])}")
        weight = parse_real(tokens[i]) if node is None else None
        if weight is None or weight <= 0:
            raise card.error(f"{tokens[i]!r} where a positive weight (with a decimal point) should stand")
        wanted = components(tokens[i + 1] if i + 1 < len(tokens) else "", card)
        i += 2
    if not ids:
        raise card.error("has no nodes to average")
    return np.array(ids, dtype=np.int64), np.array(weights), np.array(directions)


def _um_set(card: Card, tokens: list[str], nodes: NodeTable, count: int) -> IntArray:
    """(row, component) of the motions that depend on the others: pairs of a node and its components."""
    found: list[tuple[int, int]] = []
    for i in range(0, len(tokens), 2):
        node = parse_integer(tokens[i])
        if node is None:
            raise card.error(f"{tokens[i]!r} in the UM set is no node id")
        wanted = components(tokens[i + 1] if i + 1 < len(tokens) else "", card)
        found += [(nodes.row(node, card), c) for c in wanted]
    if len(found) != count or len(set(found)) != count:
        raise card.error(
            f"the UM set holds {len(set(found))} motions, the reference components are {count}",
            "give as many different motions as reference components",
        )
    return np.array(found, dtype=np.int64)
