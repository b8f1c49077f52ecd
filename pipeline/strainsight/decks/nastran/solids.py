"""Solid elements of a Nastran deck, those with layers (PCOMPS), and those that lack mid-side nodes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.decks.faults import check_elements, plural
from strainsight.decks.nastran.cards import Card, Cards, Elements, unique_ids
from strainsight.decks.nastran.grids import Grids, NodeTable, resolved_system
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

    An element that is left-handed at all its corners is turned round, as MSC Nastran does, with a note.
    Raises DeckError for other solids, an id that stands twice, a missing or repeated node, and two elements on the same nodes.
    """
    for name, found in cards.items():
        if name.startswith(OTHER_SOLIDS) and name not in SOLIDS:
            raise found[0].error(
                f"{name} solids are not supported ({len(found)} in the deck)",
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
        own = [elements[i] for i in rows]
        index = nodes.rows_of_cards(np.array(connectivity, dtype=np.int64), own)
        nodes_ = in_order(index, kind.nastran_order)
        left = left_handed(kind, nodes_, position)
        nodes_[left] = in_order(nodes_[left], kind.mirrored)
        turned += [own[i] for i in np.flatnonzero(left)]
        blocks.append(CellBlock(kind.name, ids[rows], nodes_, region[rows]))
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
    return tuple(blocks), Elements(elements, ids, region)


def _connectivity(card: Card) -> tuple[ElementKind, list[int]]:
    """Element kind and node ids, in the order of the card."""
    tokens = card.tokens[2:]
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


DIRECTIONS = (12, 13, 21, 23, 31, 32)
MOST, NOTED = 45.0, 5.0
"""Degrees between the normal of the layers of an element and the axis that CORDM has for it: an error, and a note."""


def composite_solid(
    card: Card,
    plies: Sequence[Ply],
    anisotropic: Collection[int],
    blocks: Sequence[CellBlock],
    grids: Grids,
    notes: list[str],
) -> CompositeSolid:
    """Layers from G1-G4 to G5-G8 of hexahedra, from triangle to triangle of wedges. PSDIR p s: THETA turns axis 1 of a material
    from axis p of CORDM about axis s, which is its axis 3, and lies across the layers.

    anisotropic: ids of such materials, the only ones that CORDM matters to. Raises DeckError for a
    CORDM that is blank or −1, a PSDIR that is none, elements that have no layers, and those whose layers lie across another axis.
    """
    pid = card.integer(0, "the property id")
    own = [(block, block.nodes[block.region == pid], block.ids[block.region == pid]) for block in blocks]
    for block, nodes, ids in own:
        if len(nodes) and block.kind not in STACKED:
            raise card.error(
                f"{block.kind} element {ids[0]} can have no layers",
                "give layers to CHEXA and CPENTA, and others a PSOLID",
            )
    if not any(ply.material in anisotropic for ply in plies):
        return CompositeSolid(tuple(Layer(p.material, p.thickness, Orientation(BASIC, np.eye(3))) for p in plies))
    if card.text(1) in ("", "-1"):
        raise card.error(
            f"CORDM is {card.text(1) or 'blank'}, and its plies are anisotropic: codes read that as other axes",
            "name a coordinate system (CORD2R, CORD2C, CORD2S) with an axis across the layers, or 0 for the basic one",
        )
    directions = card.integer(2, "the directions PSDIR", 13)
    if directions not in DIRECTIONS:
        raise card.error(
            f"PSDIR is {directions}",
            "give the axis of CORDM along plies at 0° and the one across them, 12, 13, 21, 23, 31 or 32",
        )
    along, across = directions // 10 - 1, directions % 10 - 1
    axes = np.eye(3)[:, [along, along, across]]
    axes[:, 1] = np.cross(axes[:, 2], axes[:, 0])
    orientation = Orientation(resolved_system(card, 1, grids.systems), axes)
    layers = [(ply.material, ply.thickness, ply.angle) for ply in plies]
    for block, nodes, ids in own:
        off = _off_normal(kind_of(block.kind), grids.position[nodes], orientation, layers == layers[::-1])
        angle, worst = off.max(initial=0.0), int(np.argmax(np.append(off, 0.0)))
        if angle > MOST:
            raise card.error(
                f"layers of {block.kind} element {ids[worst]} lie from its first facet (G1, G2, …) to the opposite one, "
                f"{angle:.3g}° off the axis of CORDM that PSDIR puts across them",
                "number the nodes of the element so that its first facet is below the plies, or correct CORDM or PSDIR",
            )
        if angle > NOTED:
            notes.append(
                f"PCOMPS {card.text(0)}: the axis of CORDM across the plies is up to {angle:.3g}° off the normal of elements "
                f"({ids[worst]}); axes of plies are those of CORDM, not projected on the element"
            )
    return CompositeSolid(
        tuple(
            Layer(
                p.material, p.thickness, replace(orientation, turn=axes @ rotation(np.eye(3)[2], np.radians(p.angle)))
            )
            for p in plies
        )
    )


def _off_normal(kind: ElementKind, x: FloatArray, orientation: Orientation, alike: bool) -> FloatArray:
    """Degrees (e,) between axis 3 of elements x (e, k, 3) at their centres and the normal of the layers there, ∂x/∂ξ × ∂x/∂η, or
    its line where the layers are `alike` from both sides."""
    r, s = np.einsum("kd,ekc->dec", kind.gradient(kind.centre)[0], x)[:2]
    normal = np.cross(r, s)
    centre = np.einsum("k,ekc->ec", kind.shape(kind.centre)[0], x)
    cosine = np.einsum("ec,ec->e", normal, orientation.axes_at(centre)[:, :, 2]) / np.linalg.norm(normal, axis=1)
    return np.asarray(np.degrees(np.arccos(np.clip(abs(cosine) if alike else cosine, -1.0, 1.0))))


BLANK = ("", "0")
DIGITS = 16
"""Of a number in the large format."""


@dataclass(frozen=True)
class Middles:
    """side (m, 2): rows of the corners between which each new node lies; cards (m,): the first element that lacks it."""

    side: IntArray
    cards: tuple[Card, ...]


def with_middles(cards: Cards, grids: Grids, notes: list[str]) -> tuple[Grids, Middles]:
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
        for i, card in enumerate(cards.of(name)):
            given = card.tokens[2 : 2 + many] + [""] * (2 + many - len(card.tokens))
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
            cards[name][i] = card._replace(tokens=[*card.tokens[:2], *given, *card.tokens[2 + many :]])
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
    whole = replace(grids, nodes=NodeTable(ids, cards.of("SPOINT")), position=position)
    return whole, Middles(ends_of, tuple(first))


def _highest(cards: Cards, grids: Grids) -> int:
    """The highest number of any card, of as many digits as an id may have: a node that one names and the deck lacks stays
    missing, and no range has a new one in it."""
    texts = (text for found in cards.values() for card in found for text in card.tokens)
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
            terms = np.array(node), np.array(component), np.array(value)
            found.append(Relation(number + len(found) + 1, *terms, STRAIGHT))
    return tuple(found)
