"""Rigid and averaging elements, rigid bars and MPC relations of a Nastran deck."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence, Set
from dataclasses import dataclass, field

import numpy as np

from strainsight.decks.nastran.cards import Card, Cards, Deck
from strainsight.decks.nastran.case_control import card_sets, expand
from strainsight.decks.nastran.grids import Grids, NodeTable
from strainsight.decks.nastran.springs import components
from strainsight.decks.text import is_whole, no_integer, parse_integer, parse_real
from strainsight.errors import DeckError
from strainsight.mesh.joins import AveragingElement, Relation, RigidElement
from strainsight.mesh.model import FloatArray, IntArray


def rigid_elements(cards: Cards, nodes: NodeTable, turned: Set[int], notes: list[str]) -> tuple[RigidElement, ...]:
    """RBE2 with all the components that it states; turned: ids of the nodes that other cards turn.

    One that ties rotations only, of nodes of solids that are no reference nodes and so have none, becomes a note.
    """
    elements = []
    led = ((card, i) for name, i in (("RBE2", 1), ("RBE3", 2)) for card in cards.of(name))
    references = {card.integer(i, "the reference node") for card, i in led} | turned
    for card in cards.of("RBE2"):
        reference = nodes.row(card.integer(1, "the reference node GN"), card)
        wanted = components(card.text(2), card)
        tokens = [token for token in card.tokens[3:] if token]
        if tokens and not is_whole(tokens[-1]) and parse_real(tokens[-1]) is not None:
            tokens = tokens[:-1]  # thermal expansion, of no effect here
        ids = np.unique(expand(tokens, nodes.sorted, card.where)[0])
        if not ids.size:
            raise card.error("has no dependent node", "give the nodes that follow the reference node")
        rows = nodes.rows_of_cards(ids[None, :], [card])[0]
        if reference in rows:
            raise card.error(
                f"the reference node {card.tokens[1]} is also dependent", "take it out of the dependent nodes"
            )
        if min(wanted) > 2 and not references.intersection(ids.tolist()):
            notes.append(
                f"RBE2 {card.tokens[0]} ties rotations only (components {card.text(2)}), which nodes of solids do not have: "
                "without effect"
            )
        number = card.integer(0, "the element id")
        elements.append(RigidElement(number, reference, rows, wanted, f"RBE2 {number}"))
    return tuple(elements)


def averaging_elements(cards: Cards, nodes: NodeTable, turning: Set[int]) -> tuple[AveragingElement, ...]:
    """RBE3: groups of weight, components and nodes, and the UM set where it has one.

    turning: rows of the nodes that have rotations, beside the reference nodes; those of another one cannot be averaged.
    """
    elements = []
    turning = turning | {nodes.row(card.integer(2, "the reference node"), card) for card in cards.of("RBE3")}
    for card in cards.of("RBE3"):
        reference = nodes.row(card.integer(2, "the reference node"), card)
        wanted = components(card.text(3), card)
        tokens = [token.upper() for token in card.tokens[4:] if token]
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


SIX = (0, 1, 2, 3, 4, 5)
NAMES = ("RBAR", "RBAR1", "RROD", "RBE1")
HELD = 1e-10
"""Least over largest strength with which six motions hold a rigid body."""
ROUNDING = 1e-13

Motion = tuple[int, int]
"""Row of a node, component 0-5 along its axes."""


@dataclass
class Bars:
    """What the cards are: rigid elements where one node leads with its six motions, relations elsewhere; where each of these
    stands."""

    rigid: list[RigidElement] = field(default_factory=list)
    relations: list[Relation] = field(default_factory=list)
    cards: list[Card] = field(default_factory=list)

    def relate(self, card: Card, motions: Sequence[Motion], values: Sequence[float]) -> None:
        """Add the relation Σ value motion = 0, the first follows."""
        node, component = np.array(motions, dtype=np.int64).T
        self.cards.append(card)
        self.relations.append(
            Relation(len(self.cards), node, component, np.array(values), f"{card.name} {card.text(0)}")
        )


def rigid_bars(cards: Cards, grids: Grids) -> Bars:
    """All of them, with u_i = u + θ × (x_i − x), θ_i = θ of the rigid body along the axes of each node:

        RBAR, RBE1   z_D = G_D G_I⁻¹ z_I,  the six independent motions z_I = G_I (u, θ)
        RROD         e·(u_B − u_A) = 0 along the line from A to B

    Raises DeckError for a node that is not there or stands twice, and independent motions that do not hold a rigid body.
    """
    found = Bars()
    for card in cards.of("RBAR"):
        a, b = _ends(card, grids)
        independent = [*_motions(a, card.text(3), card), *_motions(b, card.text(4), card)]
        left = {node: "".join(str(c + 1) for c in SIX if (node, c) not in independent) for node in (a, b)}
        stated = {a: card.text(5), b: card.text(6)}
        # blank in both: all that are not independent
        dependent = stated if any(text not in ("", "0") for text in stated.values()) else left
        _rigid(card, grids, independent, [m for node in (a, b) for m in _motions(node, dependent[node], card)], found)
    for card in cards.of("RBAR1"):
        a, b = _ends(card, grids)
        _rigid(card, grids, _motions(a, "123456", card), _motions(b, card.text(3) or "123456", card), found)
    for card in cards.of("RBE1"):
        tokens = [token.upper() for token in card.tokens]
        if "UM" not in tokens:
            raise card.error("has no UM, behind which its dependent motions stand")
        at = tokens.index("UM")
        _rigid(card, grids, _listed(card, 1, at, grids), _listed(card, at + 1, len(tokens), grids), found)
    for card in cards.of("RROD"):
        _rod(card, grids, found)
    return found


def _ends(card: Card, grids: Grids) -> tuple[int, int]:
    a, b = (grids.nodes.row(card.integer(i, "the node id"), card) for i in (1, 2))
    if a == b:
        raise card.error(f"both ends are node {card.text(1)}", "give two nodes")
    return a, b


def _motions(node: int, text: str, card: Card) -> list[Motion]:
    return [(node, c) for c in components(text, card)] if text not in ("", "0") else []


def _listed(card: Card, first: int, end: int, grids: Grids) -> list[Motion]:
    """Motions of the pairs of a node and its components in some fields; three pairs stand on a line."""
    tokens = [card.text(i) for i in range(first, end)]
    tokens = [token for token in tokens if token]
    if len(tokens) % 2 and first > 1:
        tokens = tokens[:-1]  # thermal expansion, of no effect here
    found = []
    for i in range(0, len(tokens) - 1, 2):
        if not tokens[i].isdigit():
            raise card.error(f"{tokens[i]!r} is no node id", "give pairs of a node and its components")
        found += _motions(grids.nodes.row(int(tokens[i]), card), tokens[i + 1], card)
    return found


def _rigid(card: Card, grids: Grids, independent: list[Motion], dependent: list[Motion], found: Bars) -> None:
    name = f"{card.name} {card.text(0)}"
    number = card.integer(0, "the element id")
    if len(independent) != 6:
        raise card.error(f"{len(independent)} independent motions", "six of them hold a rigid body")
    if not dependent:
        raise card.error("has no dependent motion", "give components that follow")
    if twice := set(independent) & set(dependent):
        node, c = min(twice)
        raise card.error(f"node {grids.nodes.ids[node]} is independent and dependent in component {c + 1}")
    lead = {node for node, _ in independent}
    if len(lead) == 1:
        of: dict[int, tuple[int, ...]] = {}
        for node, c in sorted(dependent):
            of[node] = (*of.get(node, ()), c)
        for own in dict.fromkeys(of.values()):
            nodes = np.array([node for node, c in of.items() if c == own], dtype=np.int64)
            found.rigid.append(RigidElement(number, min(lead), nodes, own, name))
        return
    centre = grids.position[sorted(lead)].mean(axis=0)
    length = float(np.linalg.norm(grids.position[sorted(lead)] - centre, axis=1).max()) or 1.0
    G = np.array([_row(grids, motion, centre, length) for motion in independent])
    strength = np.linalg.svd(G, compute_uv=False)
    if not strength[-1] > HELD * strength[0]:
        raise card.error(
            "its independent motions do not hold a rigid body",
            "choose six that hold three translations and three rotations",
        )
    for motion in dependent:
        # rotations as their product with the length, so that all entries compare
        values = np.linalg.solve(G.T, _row(grids, motion, centre, length))
        kept = np.flatnonzero(np.abs(values) > ROUNDING * np.abs(values).max())
        unit = [length if c > 2 else 1.0 for _, c in (motion, *independent)]
        found.relate(
            card, [motion, *(independent[i] for i in kept)], [1.0, *(-values[i] * unit[i + 1] / unit[0] for i in kept)]
        )


def _row(grids: Grids, motion: Motion, centre: FloatArray, length: float) -> FloatArray:
    """A motion of a rigid body (6,) over its translation and length times rotation at the centre; of a rotation, times length."""
    node, component = motion
    axis = grids.axes.get(node, np.eye(3))[:, component % 3]
    if component > 2:
        return np.concatenate([np.zeros(3), axis])
    return np.concatenate([axis, np.cross((grids.position[node] - centre) / length, axis)])


def _rod(card: Card, grids: Grids, found: Bars) -> None:
    a, b = _ends(card, grids)
    along = grids.position[b] - grids.position[a]
    if not np.linalg.norm(along) > 0:
        raise card.error("its ends coincide, so that it has no direction", "give two nodes that are apart")
    e = along / np.linalg.norm(along)
    follows = [*_motions(a, card.text(3), card), *_motions(b, card.text(4), card)]
    if len(follows) != 1 or follows[0][1] > 2:
        raise card.error("not one translation is dependent", "give one of 1, 2, 3 at one end (CMA or CMB)")
    values = {
        (node, c): sign * float(e @ grids.axes.get(node, np.eye(3))[:, c])
        for node, sign in ((a, -1.0), (b, 1.0))
        for c in range(3)
    }
    own = values.pop(follows[0])
    if abs(own) < 1e-6:
        raise card.error("its dependent motion is across its line", "let a motion along its line depend on the others")
    kept = {motion: value for motion, value in values.items() if abs(value) > ROUNDING}
    found.relate(card, [follows[0], *kept], [own, *kept.values()])


def selected_cards(deck: Deck, ignored: Counter[str]) -> list[Card]:
    """The MPC cards that count: of the set that MPC = n of the case control selects, itself or through MPCADD; without a case
    control those of the only set. The others are counted in `ignored`, which has those that the reader was asked to leave out.

    Raises DeckError for subcases that select different sets, several sets without a case control, and a set that is not there.
    """
    sets = card_sets(deck, "MPC", ("MPC",), left_out=bool(ignored["MPC"] or ignored["MPCADD"]))
    if not sets.ids:
        return []
    if len(sets.chosen) > 1:
        raise DeckError(
            f"the subcases select different relations ({', '.join(sets.chosen)})",
            where=[*sets.chosen.values()][1].where,
            remedy="keep one line MPC = n in the case control",
        )
    if not deck.case_control and len(sets.top) > 1:
        raise sets.card(max(sets.top)).error(
            f"{len(sets.top)} sets of relations ({', '.join(map(str, sorted(sets.top)))}) and no case control that selects one",
            "put the line MPC = n of the set before BEGIN BULK, or leave the relations out (mesh.ignore: [MPC, MPCADD])",
        )
    selected = set() if deck.case_control else sets.top
    if sets.chosen:
        selected = {sets.select(", or remove the line")}
    members: set[int] = set().union(*(sets.parts(number) for number in selected))
    for card in deck.cards.of("MPC", "MPCADD"):
        if card.integer(0, "the set id") not in members | selected:
            ignored[f"{card.name} of a set that is not selected"] += 1
    return [card for card in deck.cards.of("MPC") if card.integer(0, "the set id") in members]


def terms(card: Card, nodes: NodeTable) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows, components 0-5 and coefficients of an MPC, first the motion that follows. Raises DeckError for what is no term."""
    node: list[int] = []
    component: list[int] = []
    value: list[float] = []
    if stray := [i for i in range(7, len(card.tokens)) if i % 8 in (7, 0) and card.text(i)]:
        raise card.error(
            f"{card.text(stray[0])!r} stands in field {stray[0] + 2}, which is blank", "two terms stand on a line"
        )
    for k in range((len(card.tokens) + 2) // 3):
        i = 8 * (k // 2) + 1 + 3 * (k % 2)
        if not any(card.text(i + j) for j in range(3)):
            continue
        node.append(nodes.row(card.integer(i, "the node id"), card))
        component.append(card.component(i + 1, 0))
        value.append(card.real(i + 2, "the coefficient", 0.0))
    if not node:
        raise card.error("has no terms", "give nodes, components and coefficients")
    if value[0] == 0:
        raise card.error("the coefficient of the first term is 0", "give a motion first that can follow the others")
    return np.array(node, dtype=np.int64), np.array(component, dtype=np.int64), np.array(value)
