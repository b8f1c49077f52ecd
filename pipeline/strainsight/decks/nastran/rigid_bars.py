"""Rigid bars and bodies of a Nastran deck, whose independent motions may be spread over their nodes: RBAR, RBAR1, RROD, RBE1."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from strainsight.decks.nastran.cards import Card
from strainsight.decks.nastran.grids import Grids
from strainsight.decks.nastran.supports import components
from strainsight.mesh.joins import Relation, RigidElement
from strainsight.mesh.model import FloatArray

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


def rigid_bars(cards: dict[str, list[Card]], grids: Grids) -> Bars:
    """All of them, with u_i = u + θ × (x_i − x), θ_i = θ of the rigid body along the axes of each node:

        RBAR, RBE1   z_D = G_D G_I⁻¹ z_I,  the six independent motions z_I = G_I (u, θ)
        RROD         e·(u_B − u_A) = 0 along the line from A to B

    Raises DeckError for a node that is not there or stands twice, and independent motions that do not hold a rigid body.
    """
    found = Bars()
    for card in cards.get("RBAR", []):
        a, b = _ends(card, grids)
        independent = [*_motions(a, card.text(3), card), *_motions(b, card.text(4), card)]
        left = {node: "".join(str(c + 1) for c in SIX if (node, c) not in independent) for node in (a, b)}
        stated = {a: card.text(5), b: card.text(6)}
        # blank in both: all that are not independent
        dependent = stated if any(text not in ("", "0") for text in stated.values()) else left
        _rigid(card, grids, independent, [m for node in (a, b) for m in _motions(node, dependent[node], card)], found)
    for card in cards.get("RBAR1", []):
        a, b = _ends(card, grids)
        _rigid(card, grids, _motions(a, "123456", card), _motions(b, card.text(3) or "123456", card), found)
    for card in cards.get("RBE1", []):
        tokens = [token.upper() for token in card.fields]
        if "UM" not in tokens:
            raise card.error("has no UM, behind which its dependent motions stand")
        at = tokens.index("UM")
        _rigid(card, grids, _listed(card, 1, at, grids), _listed(card, at + 1, len(tokens), grids), found)
    for card in cards.get("RROD", []):
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
            card,
            [motion, *(independent[i] for i in kept)],
            [1.0, *(-values[i] * unit[i + 1] / unit[0] for i in kept)],
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
