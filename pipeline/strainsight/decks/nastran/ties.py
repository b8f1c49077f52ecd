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
from strainsight.decks.text import describe_non_integer, is_whole, parse_integer, parse_real
from strainsight.errors import DeckError
from strainsight.mesh.joins import AveragingElement, Relation, RigidElement
from strainsight.mesh.model import FloatArray, IntArray


def rigid_elements(cards: Cards, nodes: NodeTable, turned: Set[int], notes: list[str]) -> tuple[RigidElement, ...]:
    """RBE2 with their components; turned: ids of the nodes that other cards rotate. An RBE2 that ties only rotations of solid
    nodes without rotations has no effect and becomes a note."""
    elements = []
    led = ((card, i) for name, i in (("RBE2", 1), ("RBE3", 2)) for card in cards.of(name))
    references = {card.integer(i, "the reference node") for card, i in led} | turned
    for card in cards.of("RBE2"):
        reference = nodes.row(card.integer(1, "the reference node GN"), card)
        wanted = components(card.text(2), card)
        tokens = [token for token in card.tokens[3:] if token]
        if tokens and not is_whole(tokens[-1]) and parse_real(tokens[-1]) is not None:
            tokens = tokens[:-1]  # thermal expansion coefficient, not used
        if not (ids := np.unique(expand(tokens, nodes.sorted, card.where)[0])).size:
            raise card.error("the card has no dependent node", "specify the dependent nodes")
        rows = nodes.rows_of_cards(ids[None, :], [card])[0]
        if reference in rows:
            raise card.error(
                f"the reference node {card.tokens[1]} is also dependent", "remove this node from the dependent nodes"
            )
        if min(wanted) > 2 and not references.intersection(ids.tolist()):
            notes.append(
                f"RBE2 {card.tokens[0]} constrains only rotations (components {card.text(2)}), but nodes of solids "
                "have no rotations: the RBE2 has no effect"
            )
        number = card.integer(0, "the element id")
        elements.append(RigidElement(number, reference, rows, wanted, f"RBE2 {number}"))
    return tuple(elements)


def averaging_elements(cards: Cards, nodes: NodeTable, turning: Set[int]) -> tuple[AveragingElement, ...]:
    """RBE3: groups of weight, components and nodes, and the UM set, if any. turning: rows of nodes with rotations, in addition
    to the reference nodes; rotations of other nodes cannot be averaged."""
    elements = []
    turning = turning | {nodes.row(card.integer(2, "the reference node REFGRID"), card) for card in cards.of("RBE3")}
    for card in cards.of("RBE3"):
        reference = nodes.row(card.integer(2, "the reference node REFGRID"), card)
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
                f"reference node {card.text(2)} is also an averaged node"
                if reference in rows
                else f"a component is averaged twice at node {ids[np.argmax(counts.max(axis=1)[place])]}",
                "remove the reference node from the averaged nodes"
                if reference in rows
                else "list each averaged component of this node only once",
            )
        if (still := directions[:, 3:].any(axis=1) & ~np.isin(rows, list(turning))).any():
            raise card.error(
                f"rotations of node {ids[np.argmax(still)]} are averaged, but the node has no rotations",
                "average only translations, for example 123 (solids have no rotations)",
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
            raise card.error(describe_non_integer("a node id", tokens[i]))
        weight = parse_real(tokens[i]) if node is None else None
        if weight is None or weight <= 0:
            raise card.error(
                f"found {tokens[i]!r} instead of a positive weight", "write a positive weight with a decimal point"
            )
        wanted = components(tokens[i + 1] if i + 1 < len(tokens) else "", card)
        i += 2
    if not ids:
        raise card.error("the card has no nodes to average", "add a weight, components and node ids")
    return np.array(ids, dtype=np.int64), np.array(weights), np.array(directions)


def _um_set(card: Card, tokens: list[str], nodes: NodeTable, count: int) -> IntArray:
    """(row, component) of the dependent motions: pairs of a node and its components."""
    motions: list[tuple[int, int]] = []
    for i in range(0, len(tokens), 2):
        if (node := parse_integer(tokens[i])) is None:
            raise card.error(
                f"{tokens[i]!r} in the UM set is not a node id", "specify pairs of a node and its components"
            )
        wanted = components(tokens[i + 1] if i + 1 < len(tokens) else "", card)
        motions += [(nodes.row(node, card), c) for c in wanted]
    if len(motions) != count or len(set(motions)) != count:
        raise card.error(
            f"the UM set has {len(set(motions))} different components, but REFC has {count}",
            "specify as many components in the UM set as in REFC",
        )
    return np.array(motions, dtype=np.int64)


SIX = (0, 1, 2, 3, 4, 5)
NAMES = ("RBAR", "RBAR1", "RROD", "RBE1")
HELD = 1e-10
"""Smallest relative singular value at which six motions constrain a rigid body."""
ROUNDING = 1e-13

Motion = tuple[int, int]
"""Row of a node, component 0-5 along its axes."""


@dataclass
class Bars:
    """Rigid elements, where the six motions of one node lead, and relations elsewhere, with the cards of the relations."""

    rigid: list[RigidElement] = field(default_factory=list)
    relations: list[Relation] = field(default_factory=list)
    cards: list[Card] = field(default_factory=list)

    def relate(self, card: Card, motions: Sequence[Motion], values: Sequence[float]) -> None:
        """Add the relation Σ value motion = 0; the first motion is dependent."""
        node, component = np.array(motions, dtype=np.int64).T
        self.cards.append(card)
        self.relations.append(
            Relation(len(self.cards), node, component, np.array(values), f"{card.name} {card.text(0)}")
        )


def rigid_bars(cards: Cards, grids: Grids) -> Bars:
    """Rigid bars, with u_i = u + θ × (x_i − x), θ_i = θ of the rigid body along the axes of each node:

        RBAR, RBE1   z_D = G_D G_I⁻¹ z_I,  the six independent motions z_I = G_I (u, θ)
        RROD         e·(u_B − u_A) = 0 along the line from A to B

    Raises DeckError for a missing or repeated node, and independent motions that do not constrain a rigid body."""
    bars = Bars()
    for card in cards.of("RBAR"):
        a, b = _ends(card, grids)
        independent = [*_motions(a, card.text(3), card), *_motions(b, card.text(4), card)]
        left = {node: "".join(str(c + 1) for c in SIX if (node, c) not in independent) for node in (a, b)}
        components_on_card = {a: card.text(5), b: card.text(6)}
        # if both are blank, all motions that are not independent
        dependent = components_on_card if any(text not in ("", "0") for text in components_on_card.values()) else left
        _rigid(card, grids, independent, [m for node in (a, b) for m in _motions(node, dependent[node], card)], bars)
    for card in cards.of("RBAR1"):
        a, b = _ends(card, grids)
        _rigid(card, grids, _motions(a, "123456", card), _motions(b, card.text(3) or "123456", card), bars)
    for card in cards.of("RBE1"):
        tokens = [token.upper() for token in card.tokens]
        if "UM" not in tokens:
            raise card.error("the word UM is missing", "write UM before the first dependent node")
        at = tokens.index("UM")
        _rigid(card, grids, _read_motions(card, 1, at, grids), _read_motions(card, at + 1, len(tokens), grids), bars)
    for card in cards.of("RROD"):
        _rod(card, grids, bars)
    return bars


def _ends(card: Card, grids: Grids) -> tuple[int, int]:
    a, b = (grids.nodes.row(card.integer(i, "the node id"), card) for i in (1, 2))
    if a == b:
        raise card.error(f"both ends are at node {card.text(1)}", "specify two nodes")
    return a, b


def _motions(node: int, text: str, card: Card) -> list[Motion]:
    return [(node, c) for c in components(text, card)] if text not in ("", "0") else []


def _read_motions(card: Card, first: int, end: int, grids: Grids) -> list[Motion]:
    """Motions of the pairs of a node and its components in some fields; a line has three pairs."""
    tokens = [card.text(i) for i in range(first, end)]
    tokens = [token for token in tokens if token]
    if len(tokens) % 2 and first > 1:
        tokens = tokens[:-1]  # thermal expansion coefficient, not used
    motions = []
    for i in range(0, len(tokens) - 1, 2):
        if not tokens[i].isdigit():
            raise card.error(f"{tokens[i]!r} is not a node id", "specify pairs of a node and its components")
        motions += _motions(grids.nodes.row(int(tokens[i]), card), tokens[i + 1], card)
    return motions


def _rigid(card: Card, grids: Grids, independent: list[Motion], dependent: list[Motion], bars: Bars) -> None:
    name = f"{card.name} {card.text(0)}"
    number = card.integer(0, "the element id")
    if len(independent) != 6:
        raise card.error(
            f"the card has {len(independent)} independent components instead of six",
            "specify six independent components that constrain a rigid body",
        )
    if not dependent:
        raise card.error("the card has no dependent component", "specify dependent components")
    if twice := set(independent) & set(dependent):
        node, c = min(twice)
        raise card.error(
            f"node {grids.nodes.ids[node]} is both independent and dependent in component {c + 1}",
            "remove one of the two entries",
        )
    lead = {node for node, _ in independent}
    if len(lead) == 1:
        of: dict[int, tuple[int, ...]] = {}
        for node, c in sorted(dependent):
            of[node] = (*of.get(node, ()), c)
        for component_group in dict.fromkeys(of.values()):
            nodes = np.array([node for node, c in of.items() if c == component_group], dtype=np.int64)
            bars.rigid.append(RigidElement(number, min(lead), nodes, component_group, name))
        return
    centre = grids.position[sorted(lead)].mean(axis=0)
    length = float(np.linalg.norm(grids.position[sorted(lead)] - centre, axis=1).max()) or 1.0
    G = np.array([_row(grids, motion, centre, length) for motion in independent])
    strength = np.linalg.svd(G, compute_uv=False)
    if not strength[-1] > HELD * strength[0]:
        raise card.error(
            "the independent components do not constrain a rigid body",
            "choose six components that constrain three translations and three rotations",
        )
    for motion in dependent:
        # rotations are multiplied by the length, so that all entries are comparable
        values = np.linalg.solve(G.T, _row(grids, motion, centre, length))
        nonzero = np.flatnonzero(np.abs(values) > ROUNDING * np.abs(values).max())
        unit = [length if c > 2 else 1.0 for _, c in (motion, *independent)]
        bars.relate(
            card,
            [motion, *(independent[i] for i in nonzero)],
            [1.0, *(-values[i] * unit[i + 1] / unit[0] for i in nonzero)],
        )


def _row(grids: Grids, motion: Motion, centre: FloatArray, length: float) -> FloatArray:
    """Coefficients (6,) of a motion of a rigid body in translation and length times rotation at the centre;
    rotations times length."""
    node, component = motion
    axis = grids.axes.get(node, np.eye(3))[:, component % 3]
    if component > 2:
        return np.concatenate([np.zeros(3), axis])
    return np.concatenate([axis, np.cross((grids.position[node] - centre) / length, axis)])


def _rod(card: Card, grids: Grids, bars: Bars) -> None:
    a, b = _ends(card, grids)
    along = grids.position[b] - grids.position[a]
    if not np.linalg.norm(along) > 0:
        raise card.error("both ends coincide, so the rod has no direction", "specify two nodes at different positions")
    e = along / np.linalg.norm(along)
    follows = [*_motions(a, card.text(3), card), *_motions(b, card.text(4), card)]
    if len(follows) != 1 or follows[0][1] > 2:
        raise card.error("exactly one translation must be dependent", "specify 1, 2 or 3 at one end (CMA or CMB)")
    values = {
        (node, c): sign * float(e @ grids.axes.get(node, np.eye(3))[:, c])
        for node, sign in ((a, -1.0), (b, 1.0))
        for c in range(3)
    }
    dependent_value = values.pop(follows[0])
    if abs(dependent_value) < 1e-6:
        raise card.error(
            "the dependent translation is perpendicular to the rod",
            "choose a translation (CMA or CMB) that is not perpendicular to the rod",
        )
    nonzero = {motion: value for motion, value in values.items() if abs(value) > ROUNDING}
    bars.relate(card, [follows[0], *nonzero], [dependent_value, *nonzero.values()])


def selected_cards(deck: Deck, ignored: Counter[str]) -> list[Card]:
    """The MPC cards to use: of the set that MPC = n of the case control selects, directly or through MPCADD; without
    a case control of the only set. The others are counted in `ignored`, which contains cards to leave out.

    Raises DeckError for subcases that select different sets, several sets without a case control, and a missing set."""
    sets = card_sets(deck, "MPC", ("MPC",), left_out=bool(ignored["MPC"] or ignored["MPCADD"]))
    if not sets.ids:
        return []
    if len(sets.chosen) > 1:
        raise DeckError(
            f"the subcases select different MPC sets ({', '.join(sets.chosen)})",
            where=[*sets.chosen.values()][1].where,
            remedy="keep only one line MPC = n in the case control",
        )
    if not deck.case_control and len(sets.top) > 1:
        raise sets.card(max(sets.top)).error(
            f"the deck has {len(sets.top)} MPC sets ({', '.join(map(str, sorted(sets.top)))}), but no "
            "case control that selects one of these sets",
            "add the line MPC = n before BEGIN BULK, or leave all MPC cards out (mesh.ignore: [MPC, MPCADD])",
        )
    selected = set() if deck.case_control else sets.top
    if sets.chosen:
        selected = {sets.select(", or remove the line")}
    members: set[int] = set().union(*(sets.parts(number) for number in selected))
    for card in deck.cards.of("MPC", "MPCADD"):
        if card.integer(0, "the MPC set id") not in members | selected:
            ignored[f"{card.name} of an MPC set that is not selected"] += 1
    return [card for card in deck.cards.of("MPC") if card.integer(0, "the MPC set id") in members]


def terms(card: Card, nodes: NodeTable) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows, components 0-5 and coefficients of an MPC, with the dependent motion first. Raises DeckError for an invalid term."""
    node: list[int] = []
    component: list[int] = []
    value: list[float] = []
    if stray := [i for i in range(7, len(card.tokens)) if i % 8 in (7, 0) and card.text(i)]:
        raise card.error(
            f"found {card.text(stray[0])!r} in field {stray[0] + 2}, which must be blank",
            "write at most two terms on each line",
        )
    for k in range((len(card.tokens) + 2) // 3):
        i = 8 * (k // 2) + 1 + 3 * (k % 2)
        if not any(card.text(i + j) for j in range(3)):
            continue
        node.append(nodes.row(card.integer(i, "the node id"), card))
        component.append(card.component(i + 1, 0))
        value.append(card.real(i + 2, "the coefficient", 0.0))
    if not node:
        raise card.error("the card has no terms", "specify nodes, components and coefficients")
    if value[0] == 0:
        raise card.error(
            "the coefficient of the first term is 0", "start the card with a term whose coefficient is not zero"
        )
    return np.array(node, dtype=np.int64), np.array(component, dtype=np.int64), np.array(value)
