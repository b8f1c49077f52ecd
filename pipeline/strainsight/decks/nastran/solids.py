"""Solid elements of a Nastran deck: CTETRA, CHEXA, CPENTA of both orders."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from strainsight.decks.faults import check_elements
from strainsight.decks.nastran.cards import Card, origin, unique_ids
from strainsight.decks.nastran.grids import NodeTable
from strainsight.decks.numbers import parse_integer
from strainsight.errors import DeckError
from strainsight.mesh.model import ELEMENT_KINDS, CellBlock, Origin

SOLIDS = {
    "CTETRA": {4: "tet4", 10: "tet10"},
    "CHEXA": {8: "hex8", 20: "hex20"},
    "CPENTA": {6: "wedge6", 15: "wedge15"},
}
OTHER_SOLIDS = ("CTETR", "CHEX", "CPENT", "CPYR", "CTRIAX", "CTRAX", "CQUADX")
TO_VTK = {
    # Nastran numbers the mid-sides bottom, uprights, top; VTK bottom, top, uprights.
    "hex20": (*range(12), 16, 17, 18, 19, 12, 13, 14, 15),
    "wedge15": (*range(9), 12, 13, 14, 9, 10, 11),
}


def read_solids(
    cards: dict[str, list[Card]], nodes: NodeTable, path: Path, required: bool = True
) -> tuple[tuple[CellBlock, ...], Origin]:
    """One block a kind, elements in the order of the deck, and where they stand.

    Raises DeckError for other solids, an id that stands twice, an element with some of its mid-side nodes, a missing or
    repeated node, and two elements on the same nodes.
    """
    for name, found in cards.items():
        if name.startswith(OTHER_SOLIDS) and name not in SOLIDS:
            raise found[0].error(
                f"{name} solids are not taken over ({len(found)} in the deck)",
                "mesh with tetrahedra, hexahedra or wedges (CTETRA, CHEXA, CPENTA)",
            )
    elements = sorted(
        (card for name in SOLIDS for card in cards.get(name, [])), key=lambda card: (card.file, card.line)
    )
    if not elements and required:
        raise DeckError(
            "the deck holds no solid element", where=str(path), remedy="the model needs CTETRA, CHEXA or CPENTA"
        )
    ids = unique_ids(elements, "element")
    gathered: dict[str, list[tuple[int, int, list[int]]]] = {}
    for i, card in enumerate(elements):
        kind, node_ids = _connectivity(card)
        gathered.setdefault(kind, []).append((i, card.integer(1, "the property id", int(ids[i])), node_ids))
    blocks = []
    for kind in ELEMENT_KINDS:
        if kind not in gathered:
            continue
        rows, region, connectivity = zip(*gathered[kind], strict=True)
        own = [elements[i] for i in rows]
        index = nodes.rows_of_cards(np.array(connectivity, dtype=np.int64), own)
        order = list(TO_VTK.get(kind, range(index.shape[1])))
        blocks.append(CellBlock(kind, ids[list(rows)], index[:, order], np.array(region, dtype=np.int64)))
    by_id = dict(zip(ids.tolist(), elements, strict=True))
    check_elements(
        blocks,
        lambda _, number: by_id[number].where,
        lambda block, i: f"{by_id[int(block.ids[i])].name} {block.ids[i]}",
    )
    return tuple(blocks), origin(ids, elements)


def _connectivity(card: Card) -> tuple[str, list[int]]:
    """Element kind and node ids, in the order of the card."""
    tokens = card.fields[2:]
    while tokens and tokens[-1] in ("", "0"):
        tokens = tokens[:-1]
    counts = SOLIDS[card.name]
    few, many = sorted(counts)
    if few < len(tokens) <= many and (len(tokens) < many or any(token in ("", "0") for token in tokens[few:])):
        given = sum(token not in ("", "0") for token in tokens[few:])
        raise card.error(
            f"{given} of {many - few} mid-side nodes", f"give all mid-side nodes, or none ({few} or {many} nodes)"
        )
    if len(tokens) not in counts:
        raise card.error(
            f"{len(tokens)} nodes, where a {card.name} has {few} or {many}", "give the nodes of a whole element"
        )
    node_ids = [parse_integer(token) for token in tokens]
    for i, value in enumerate(node_ids):
        if value is None:
            card.integer(i + 2, "a node id")
    return counts[len(tokens)], node_ids  # type: ignore[return-value]
