"""Solid elements of a Nastran deck, including layered solids (PCOMPS) and solids without some mid-side nodes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.decks.faults import check_elements
from strainsight.decks.nastran.cards import Card, Cards, Elements, unique_ids
from strainsight.decks.nastran.grids import Grids, NodeTable, find_system
from strainsight.decks.text import parse_integer
from strainsight.mesh.anisotropic import STACKED, CompositeSolid, Layer, Orientation
from strainsight.mesh.coordinates import BASIC, rotation
from strainsight.mesh.joins import STRAIGHT, Relation
from strainsight.mesh.kinds import ELEMENTS, FAMILIES, kind_of
from strainsight.mesh.kinds.kind import ElementKind, in_order
from strainsight.mesh.model import CellBlock, FloatArray, IntArray
from strainsight.mesh.node_order import left_handed
from strainsight.mesh.thin import Ply

SOLIDS = {
    card: {len(kind.nodes): kind for kind in ELEMENTS if kind.nastran == card}
    for card in dict.fromkeys(kind.nastran for kind in ELEMENTS if kind.nastran)
}
"""Card → number of nodes → kind."""
OTHER_SOLIDS = ("CTETR", "CHEX", "CPENT", "CPYR", "CTRIAX", "CTRAX", "CQUADX")


def read_solids(
    cards: Cards, nodes: NodeTable, position: FloatArray, notes: list[str]
) -> tuple[tuple[CellBlock, ...], Elements]:
    """One block a kind, elements in the order of the deck, and their cards; position (n, 3) of the nodes.

    The node order of an element that is left-handed at all corners is mirrored, as in MSC Nastran, with a note. Raises DeckError
    for unsupported solids, a duplicate id, a missing or repeated node, and two elements with the same nodes."""
    for name, cards_of_name in cards.items():
        if name.startswith(OTHER_SOLIDS) and name not in SOLIDS:
            raise cards_of_name[0].error(
                f"{name} solids are not supported ({len(cards_of_name)} in the deck)",
                f"mesh with {FAMILIES} ({', '.join(SOLIDS)})",
            )
    elements = sorted(cards.of(*SOLIDS), key=lambda card: (card.file, card.line))
    ids = unique_ids(elements, "element")
    regions = [card.integer(1, "the property id", number) for card, number in zip(elements, ids.tolist(), strict=True)]
    region = np.array(regions, dtype=np.int64)
    gathered: defaultdict[ElementKind, list[tuple[int, list[int]]]] = defaultdict(list)
    for i, card in enumerate(elements):
        kind, node_ids = _connectivity(card)
        gathered[kind].append((i, node_ids))
    blocks = []
    turned: list[Card] = []
    for kind in ELEMENTS:
        if kind not in gathered:
            continue
        rows, connectivity = (list(part) for part in zip(*gathered[kind], strict=True))
        cards_of_kind = [elements[i] for i in rows]
        index = nodes.rows_of_cards(np.array(connectivity, dtype=np.int64), cards_of_kind)
        nodes_ = in_order(index, kind.nastran_order)
        left = left_handed(kind, nodes_, position)
        nodes_[left] = in_order(nodes_[left], kind.mirrored)
        turned += [cards_of_kind[i] for i in np.flatnonzero(left)]
        blocks.append(CellBlock(kind.name, ids[rows], nodes_, region[rows]))
    if turned:
        names = ", ".join(f"{card.name} {card.text(0)}" for card in turned[:3]) + (", …" if turned[3:] else "")
        notes.append(
            f"{len(turned)} of {len(elements)} solid elements had a left-handed node order in the deck, which is corrected: "
            f"{names} (first at {turned[0].where})"
        )
    by_id = dict(zip(ids.tolist(), elements, strict=True))
    check_elements(
        blocks,
        lambda _, number: by_id[number].where,
        lambda block, i: f"{by_id[int(block.ids[i])].name} {block.ids[i]}",
    )
    return tuple(blocks), Elements(elements, ids, region)


def _connectivity(card: Card) -> tuple[ElementKind, list[int]]:
    """Element kind and node ids, in the order of the card."""
    tokens = card.tokens[2:]
    while tokens and tokens[-1] in ("", "0"):
        tokens = tokens[:-1]
    counts = SOLIDS[card.name]
    if len(tokens) not in counts:
        raise card.error(
            f"the element has {len(tokens)} nodes, but a {card.name} needs {' or '.join(map(str, sorted(counts)))}",
            "specify all nodes of the element",
        )
    node_ids = [parse_integer(token) for token in tokens]
    for i, value in enumerate(node_ids):
        if value is None:
            card.integer(i + 2, "a node id")
    return counts[len(tokens)], node_ids  # type: ignore[return-value]


DIRECTIONS = (12, 13, 21, 23, 31, 32)
MOST, NOTED = 45.0, 5.0
"""Largest angle [deg] between the normal of the layers of an element and its axis of CORDM: limit for an error and for a note."""


def composite_solid(
    card: Card,
    plies: Sequence[Ply],
    anisotropic: Collection[int],
    blocks: Sequence[CellBlock],
    grids: Grids,
    notes: list[str],
) -> CompositeSolid:
    """Layers from G1-G4 to G5-G8 of hexahedra, from triangle to triangle of wedges. PSDIR p s: THETA rotates
    material axis 1 from axis p of CORDM about axis s, which is material axis 3 and normal to the layers.

    anisotropic: ids of anisotropic materials, for which CORDM matters. Raises DeckError for a blank or −1 CORDM, an
    invalid PSDIR, elements that cannot have layers, and elements whose layers are not normal to the axis."""
    pid = card.integer(0, "the property id")
    elements_by_block = [(block, block.nodes[block.region == pid], block.ids[block.region == pid]) for block in blocks]
    for block, nodes, ids in elements_by_block:
        if len(nodes) and block.kind not in STACKED:
            raise card.error(
                f"{block.kind} element {ids[0]} cannot have layers",
                "use PCOMPS only for CHEXA and CPENTA, and PSOLID for other elements",
            )
    if not any(ply.material in anisotropic for ply in plies):
        return CompositeSolid(tuple(Layer(p.material, p.thickness, Orientation(BASIC, np.eye(3))) for p in plies))
    if card.text(1) in ("", "-1"):
        raise card.error(
            f"CORDM is {card.text(1) or 'blank'}, but the plies are anisotropic: programs interpret this value differently",
            "set CORDM to a coordinate system (CORD2R, CORD2C, CORD2S) with an axis normal to the layers, or 0 "
            "for the basic system",
        )
    directions = card.integer(2, "the ply directions PSDIR", 13)
    if directions not in DIRECTIONS:
        raise card.error(
            f"PSDIR is {directions}, which is not supported",
            "set PSDIR to the axis of CORDM along 0° plies and the axis normal to the plies: 12, 13, 21, 23, 31 or 32",
        )
    along, across = directions // 10 - 1, directions % 10 - 1
    axes = np.eye(3)[:, [along, along, across]]
    axes[:, 1] = np.cross(axes[:, 2], axes[:, 0])
    orientation = Orientation(find_system(card, 1, grids.systems), axes)
    layers = [(ply.material, ply.thickness, ply.angle) for ply in plies]
    for block, nodes, ids in elements_by_block:
        off = _off_normal(kind_of(block.kind), grids.position[nodes], orientation, layers == layers[::-1])
        angle, worst = off.max(initial=0.0), int(np.argmax(np.append(off, 0.0)))
        if angle > MOST:
            raise card.error(
                f"the stacking direction of {block.kind} element {ids[worst]} is {angle:.3g}° off the layer normal that CORDM "
                "and PSDIR define; layers are stacked from the facet G1, G2, … to the opposite facet",
                "reorder the nodes of the element: begin with the facet at the bottom of the layup; or "
                "correct CORDM or PSDIR",
            )
        if angle > NOTED:
            notes.append(
                f"PCOMPS {card.text(0)}: the ply normal defined by CORDM is up to {angle:.3g}° off the element normal (element "
                f"{ids[worst]}); the ply axes follow CORDM and are not projected on the element"
            )
    return CompositeSolid(
        tuple(
            Layer(
                p.material, p.thickness, replace(orientation, turn=axes @ rotation(np.eye(3)[2], np.radians(p.angle)))
            )
            for p in plies
        )
    )


def _off_normal(kind: ElementKind, x: FloatArray, orientation: Orientation, symmetric: bool) -> FloatArray:
    """Angle [deg] (e,) between axis 3 of elements x (e, k, 3) at their centres and the layer normal ∂x/∂ξ × ∂x/∂η,
    ignoring its sign for a symmetric layup."""
    r, s = np.einsum("kd,ekc->dec", kind.gradient(kind.centre)[0], x)[:2]
    normal = np.cross(r, s)
    centre = np.einsum("k,ekc->ec", kind.shape(kind.centre)[0], x)
    cosine = np.einsum("ec,ec->e", normal, orientation.axes_at(centre)[:, :, 2]) / np.linalg.norm(normal, axis=1)
    return np.asarray(np.degrees(np.arccos(np.clip(abs(cosine) if symmetric else cosine, -1.0, 1.0))))


BLANK = ("", "0")
DIGITS = 16
"""Digits of a number in the large format."""


@dataclass(frozen=True)
class Middles:
    """side (m, 2): rows of the two corners of each new node; cards (m,): first element without this node."""

    side: IntArray
    cards: tuple[Card, ...]


def with_middles(cards: Cards, grids: Grids, notes: list[str]) -> tuple[Grids, Middles]:
    """Add the missing mid-side nodes of partially quadratic elements, to the grids and to their cards.

    With u_m = ½(u_a + u_b) the side stays straight, and the shape functions are those of the element without that
    node: N_a + ½ N_m, N_b + ½ N_m. Elements with the same side share its node. Raises DeckError for a missing corner.
    Source: elements with a variable number of nodes, Bathe, Finite Element Procedures (1996), 5.3."""
    side: dict[tuple[int, int], int] = {}
    first: list[Card] = []
    last = partial = 0
    for name, kinds in SOLIDS.items():
        few, many = min(kinds), max(kinds)
        kind = kinds[many]
        order = list(kind.nastran_order) or list(range(many))
        for i, card in enumerate(cards.of(name)):
            node_tokens = card.tokens[2 : 2 + many] + [""] * (2 + many - len(card.tokens))
            lacking = [place for place in range(few, many) if node_tokens[place] in BLANK]
            if few == many or not 0 < len(lacking) < many - few:
                continue
            partial, last = partial + 1, last or _highest(cards, grids)
            for place in lacking:
                # our node a is node order[a] of the card
                ends = kind.edges[order.index(place) - few]
                rows = sorted(grids.nodes.row(card.integer(2 + order[end], "a node id"), card) for end in ends)
                key = (rows[0], rows[1])
                if key not in side:
                    side[key] = last + 1 + len(side)
                    first.append(card)
                node_tokens[place] = str(side[key])
            cards[name][i] = card._replace(tokens=[*card.tokens[:2], *node_tokens, *card.tokens[2 + many :]])
    if not side:
        return grids, Middles(np.zeros((0, 2), dtype=np.int64), ())
    ends_of = np.array([*side], dtype=np.int64)
    notes.append(
        f"solid elements without some mid-side nodes ({partial} in total, first {first[0].name} {first[0].text(0)}, "
        f"{first[0].where}) are completed with nodes {last + 1} to {last + len(side)}; each moves with the two corner nodes "
        "of its side, so the side stays straight"
    )
    ids = np.concatenate([grids.nodes.ids, np.arange(last + 1, last + 1 + len(side))])
    position = np.vstack([grids.position, grids.position[ends_of].mean(axis=1)])
    whole = replace(grids, nodes=NodeTable(ids, cards.of("SPOINT")), position=position)
    return whole, Middles(ends_of, tuple(first))


def _highest(cards: Cards, grids: Grids) -> int:
    """Highest number on any card, up to the digits of an id, so that new ids neither match missing nodes nor ranges."""
    texts = (text for cards_of_name in cards.values() for card in cards_of_name for text in card.tokens)
    named = (int(text) for text in texts if text.isdecimal() and len(text) <= DIGITS)
    return max(int(grids.nodes.ids.max()), *named)


def straight_sides(middles: Middles, nodes: int, axes: dict[int, FloatArray], number: int) -> tuple[Relation, ...]:
    """Relation u_m = ½(u_a + u_b) for every new node (the last rows); axes: row → (3, 3) of nodes with nodal axes;
    number: relations before these."""
    relations: list[Relation] = []
    for m, ends in enumerate(middles.side.tolist(), start=nodes - len(middles.side)):
        for k in range(3):
            node, component, value = [m], [k], [1.0]
            for end in ends:
                along = axes[end][k] if end in axes else np.eye(3)[k]
                nonzero = np.flatnonzero(along)
                node += [end] * len(nonzero)
                component += nonzero.tolist()
                value += (-0.5 * along[nonzero]).tolist()
            terms = np.array(node), np.array(component), np.array(value)
            relations.append(Relation(number + len(relations) + 1, *terms, STRAIGHT))
    return tuple(relations)
