"""Solid elements of a Nastran deck."""

from __future__ import annotations

import numpy as np

from strainsight.decks.faults import check_elements, plural
from strainsight.decks.nastran.cards import Card, origin, unique_ids
from strainsight.decks.nastran.grids import NodeTable
from strainsight.decks.numbers import parse_integer
from strainsight.mesh.kinds import ELEMENTS, FAMILIES
from strainsight.mesh.kinds.kind import ElementKind, in_order
from strainsight.mesh.left_handed import left_handed
from strainsight.mesh.model import CellBlock, FloatArray, Origin

SOLIDS = {
    card: {len(kind.nodes): kind for kind in ELEMENTS if kind.nastran == card}
    for card in dict.fromkeys(kind.nastran for kind in ELEMENTS if kind.nastran)
}
"""Card → number of nodes → kind."""
OTHER_SOLIDS = ("CTETR", "CHEX", "CPENT", "CPYR", "CTRIAX", "CTRAX", "CQUADX")


def read_solids(
    cards: dict[str, list[Card]], nodes: NodeTable, position: FloatArray, notes: list[str]
) -> tuple[tuple[CellBlock, ...], Origin]:
    """One block a kind, elements in the order of the deck, and where they stand; position (n, 3) of the nodes.

    An element that is left-handed at all its corners is turned round, as MSC Nastran does, with a note.
    Raises DeckError for other solids, an id that stands twice, a missing or repeated node, and two elements on the same nodes.
    """
    for name, found in cards.items():
        if name.startswith(OTHER_SOLIDS) and name not in SOLIDS:
            raise found[0].error(
                f"{name} solids are not supported ({len(found)} in the deck)",
                f"mesh with {FAMILIES} ({', '.join(SOLIDS)})",
            )
    elements = sorted(
        (card for name in SOLIDS for card in cards.get(name, [])), key=lambda card: (card.file, card.line)
    )
    ids = unique_ids(elements, "element")
    gathered: dict[ElementKind, list[tuple[int, int, list[int]]]] = {}
    for i, card in enumerate(elements):
        kind, node_ids = _connectivity(card)
        gathered.setdefault(kind, []).append((i, card.integer(1, "the property id", int(ids[i])), node_ids))
    blocks = []
    turned: list[Card] = []
    for kind in ELEMENTS:
        if kind not in gathered:
            continue
        rows, region, connectivity = zip(*gathered[kind], strict=True)
        own = [elements[i] for i in rows]
        index = nodes.rows_of_cards(np.array(connectivity, dtype=np.int64), own)
        nodes_ = in_order(index, kind.nastran_order)
        left = left_handed(kind, nodes_, position)
        nodes_[left] = in_order(nodes_[left], kind.mirrored)
        turned += [own[i] for i in np.flatnonzero(left)]
        blocks.append(CellBlock(kind.name, ids[list(rows)], nodes_, np.array(region, dtype=np.int64)))
    if turned:
        names = ", ".join(f"{card.name} {card.text(0)}" for card in turned[:3]) + (", …" if turned[3:] else "")
        notes.append(
            f"{plural(len(turned), 'solid element')} of {len(elements)} numbered left-handed, and turned round: {names} "
            f"(first at {turned[0].where})"
        )
    by_id = dict(zip(ids.tolist(), elements, strict=True))
    check_elements(
        blocks,
        lambda _, number: by_id[number].where,
        lambda block, i: f"{by_id[int(block.ids[i])].name} {block.ids[i]}",
    )
    return tuple(blocks), origin(ids, elements)


def _connectivity(card: Card) -> tuple[ElementKind, list[int]]:
    """Element kind and node ids, in the order of the card."""
    tokens = card.fields[2:]
    while tokens and tokens[-1] in ("", "0"):
        tokens = tokens[:-1]
    counts = SOLIDS[card.name]
    if len(tokens) not in counts:
        raise card.error(
            f"{len(tokens)} nodes, where a {card.name} has {' or '.join(map(str, sorted(counts)))}",
            "give the nodes of a whole element",
        )
    node_ids = [parse_integer(token) for token in tokens]
    for i, value in enumerate(node_ids):
        if value is None:
            card.integer(i + 2, "a node id")
    return counts[len(tokens)], node_ids  # type: ignore[return-value]
