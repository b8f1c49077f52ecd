"""Pressures of a Nastran deck (PLOAD, PLOAD2, PLOAD4) as forces on the nodes of shells and of faces of solids."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.decks.nastran.cards import Card
from strainsight.decks.nastran.grids import Grids, resolved_system
from strainsight.decks.nastran.sets import expand
from strainsight.mesh.coordinates import CoordinateSystem, local_axes
from strainsight.mesh.kinds import FACETS, facet_of, kind_of
from strainsight.mesh.kinds.kind import ElementKind, Kind
from strainsight.mesh.model import CellBlock, FloatArray, IntArray
from strainsight.mesh.thin import ShellBlock
from strainsight.mesh.tractions import consistent_forces

PLATES = {"CQUAD4": 4, "CQUADR": 4, "CQUAD8": 4, "CTRIA3": 3, "CTRIAR": 3, "CTRIA6": 3}
"""Card → number of corners; where one that is not imported coats a solid, a pressure on it is one on the solid."""


@dataclass(frozen=True)
class Pressed:
    """A facet under a pressure: set; kind of the facet; nodes (k,) rows, normal outward; p [Pa] at its corners, positive inward;
    along: system and vector in it along which p acts instead, None for the normal."""

    set: int
    kind: Kind
    nodes: IntArray
    p: tuple[float, ...]
    along: tuple[CoordinateSystem, tuple[float, float, float]] | None = None


def pressure_forces(
    cards: dict[str, list[Card]], grids: Grids, blocks: Sequence[CellBlock], shells: Sequence[ShellBlock]
) -> Iterator[tuple[int, IntArray, FloatArray]]:
    """(set, rows (m,), force (m, 3)) of the pressures, the consistent forces of

        t = −p n       or       t = p N/|N| along the vector N of a PLOAD4,     p linear or bilinear between the corners.

    A pressure is positive inward on a solid (PLOAD4 with its corners), and along the normal by the right-hand rule on the nodes
    of a PLOAD and on plates (PLOAD2, PLOAD4), which are shells of the model or coat a solid.
    Raises DeckError for an element, node or face that is not there, and for loads on edges (SORL = LINE).
    """
    pressed = _pressed(cards, grids, blocks, shells)
    groups: dict[tuple[int, str, int, object], list[Pressed]] = {}
    for own in pressed:
        along = None if own.along is None else (id(own.along[0]), own.along[1])
        groups.setdefault((own.set, own.kind.name, len(own.p), along), []).append(own)
    for group in groups.values():
        first = group[0]
        p, nodes = np.array([own.p for own in group]), np.array([own.nodes for own in group])
        linear = next(kind for kind in FACETS if len(kind.nodes) == first.kind.corners)
        yield first.set, nodes.ravel(), _forces(grids.position, first, linear, nodes, p).reshape(-1, 3)


def _forces(position: FloatArray, like: Pressed, linear: Kind, nodes: IntArray, p: FloatArray) -> FloatArray:
    """Forces (f, k, 3) on facets whose pressures p (f, c) at the corners act as that of `like`."""

    def traction(x: FloatArray, n: FloatArray, xi: FloatArray) -> FloatArray:
        size = np.einsum("qc,fc->fq", linear.shape(xi), p)[..., None]
        if like.along is None:
            return -size * n
        system, vector = like.along
        axes = local_axes(x.reshape(-1, 3), system)[0]
        return size * (axes @ np.array(vector) / np.linalg.norm(vector)).reshape(x.shape)

    return consistent_forces(position, like.kind, nodes, traction)


def _pressed(
    cards: dict[str, list[Card]], grids: Grids, blocks: Sequence[CellBlock], shells: Sequence[ShellBlock]
) -> list[Pressed]:
    found: list[Pressed] = []
    outlines: list[
        tuple[Card, tuple[int, ...], tuple[float, ...]]
    ] = []  # of PLOAD and plates: corners in their sequence
    place = {int(i): (block, row) for block in blocks for row, i in enumerate(block.ids)} if "PLOAD4" in cards else {}
    plates = _plates(cards, grids)
    for card in cards.get("PLOAD", []):
        p = card.real(1, "the pressure")
        ids = [card.integer(2 + i, "a node id") for i in range(4) if i < 3 or card.text(5) not in ("", "0")]
        outlines.append((card, tuple(grids.nodes.row(i, card) for i in ids), (p,) * len(ids)))
    for card in cards.get("PLOAD2", []):
        p = card.real(1, "the pressure")
        for corners in _named_plates(card, card.fields[2:], plates):
            outlines.append((card, corners, (p,) * len(corners)))
    for card in cards.get("PLOAD4", []):
        number = card.integer(1, "the element id")
        first = card.real(2, "the pressure")
        p4 = tuple(card.real(2 + i, "the pressure", first) for i in range(4))
        if number in place and card.text(6).upper() != "THRU":
            block, row = place[number]
            kind, local = _loaded_face(card, kind_of(block.kind), block.nodes[row], grids)
            found.append(
                Pressed(_set(card), kind, block.nodes[row][list(local)], p4[: kind.corners], _along(card, grids))
            )
        else:
            last = [card.text(1), *card.fields[6:8]] if card.text(6).upper() == "THRU" else [card.text(1)]
            for corners in _named_plates(card, last, plates):
                outlines.append((card, corners, p4[: len(corners)]))
    return found + _outlined(outlines, grids, blocks, shells)


def _set(card: Card) -> int:
    return card.integer(0, "the set id")


def _along(card: Card, grids: Grids) -> tuple[CoordinateSystem, tuple[float, float, float]] | None:
    """The vector of a PLOAD4 in its system, where it has one."""
    if card.text(12).upper() == "LINE":
        raise card.error("SORL is LINE: loads on edges are not supported", "spread the load over the face")
    a, b, c = (card.real(9 + i, "a component of the direction", 0.0) for i in range(3))
    return (resolved_system(card, 8, grids.systems), (a, b, c)) if a or b or c else None


def _loaded_face(card: Card, kind: ElementKind, nodes: IntArray, grids: Grids) -> tuple[Kind, tuple[int, ...]]:
    """Facet of a solid that G1 and G3 or G4 name, and its local nodes with G1 first: two opposite corners of a quadrangle; a
    corner of a triangle and, of a tetrahedron, the corner that is not on it, or of a pyramid its edge on the base."""
    own = nodes.tolist()

    def corner(i: int) -> int | None:
        if card.text(i) in ("", "0"):
            return None
        row = grids.nodes.row(card.integer(i, "a node id"), card)
        if row not in own[: kind.corners]:
            raise card.error(
                f"node {card.text(i)} is no corner of element {card.text(1)}", "name corners of the loaded face"
            )
        return own.index(row)

    first, other = corner(6), corner(7)
    found = []
    for facet, local in kind.facets:
        corners = local[: facet.corners]
        if first not in corners:
            continue
        if kind.corners == 4:
            fits = other is not None and other not in corners
        elif facet.corners == 4:
            fits = other in corners and abs(corners.index(first) - corners.index(other)) == 2
        else:
            fits = other is None if kind.corners != 5 else other in corners
        if fits:
            found.append((facet, local))
    if len(found) != 1:
        raise card.error(
            f"G1 and G3 or G4 name {'no face' if not found else 'several faces'} of the {kind.name} element {card.text(1)}",
            "give opposite corners of a quadrangle; of a tetrahedron a corner of the face and the one that is not on it",
        )
    facet, local = found[0]
    at = local.index(first)
    turn = [(at + i) % facet.corners for i in range(facet.corners)]
    middle = [facet.corners + i for i in turn] if len(local) > facet.corners else []
    return facet, tuple(local[i] for i in (*turn, *middle))


def _plates(cards: dict[str, list[Card]], grids: Grids) -> dict[int, tuple[int, ...]]:
    """Element id → rows of its corners, of the plates of the deck, where a pressure may refer to one."""
    if not ("PLOAD2" in cards or "PLOAD4" in cards):
        return {}
    return {
        card.integer(0, "the element id"): tuple(
            grids.nodes.row(card.integer(2 + i, "a node id"), card) for i in range(count)
        )
        for name, count in PLATES.items()
        for card in cards.get(name, [])
    }


def _named_plates(card: Card, tokens: Sequence[str], plates: dict[int, tuple[int, ...]]) -> list[tuple[int, ...]]:
    ids, missing = expand(tokens, np.array(sorted(plates), dtype=np.int64), card.where)
    if missing.size or not ids.size:
        what = f"element {missing[0]} is" if missing.size else "its elements are"
        raise card.error(
            f"{what} no {'plate' if card.name == 'PLOAD2' else 'solid or plate'} of the deck",
            f"correct the id, or leave these loads out (mesh.ignore: [{card.name}])",
        )
    return [plates[i] for i in ids.tolist()]


def _outlined(
    outlines: Sequence[tuple[Card, tuple[int, ...], tuple[float, ...]]],
    grids: Grids,
    blocks: Sequence[CellBlock],
    shells: Sequence[ShellBlock],
) -> list[Pressed]:
    """The facets of solids with these corners, or else shells; a pressure along the sequence of the corners becomes one inward,
    which of a shell is against the normal by its nodes."""
    if not outlines:
        return []
    wanted = np.zeros(len(grids.position), dtype=bool)
    wanted[[row for _, corners, _ in outlines for row in corners]] = True
    facets: dict[frozenset[int], tuple[Kind, IntArray]] = {}
    for block in blocks:
        for kind, local in kind_of(block.kind).facets:
            nodes = block.nodes[:, list(local)]
            for own in nodes[wanted[nodes[:, : kind.corners]].all(axis=1)]:
                facets.setdefault(frozenset(own[: kind.corners].tolist()), (kind, own))
    for shell in shells:
        plane = facet_of(shell.kind)
        for own in shell.nodes[wanted[shell.corners].all(axis=1)]:
            facets.setdefault(frozenset(own[: plane.corners].tolist()), (plane, own))
    found = []
    for card, corners, p in outlines:
        if frozenset(corners) not in facets:
            ids = ", ".join(str(grids.nodes.ids[row]) for row in corners)
            raise card.error(
                f"no solid or shell has a face with the corners {ids}",
                f"give the corners of one, or leave these loads out (mesh.ignore: [{card.name}])",
            )
        kind, nodes = facets[frozenset(corners)]
        at = [corners.index(row) for row in nodes[: kind.corners].tolist()]
        outward = (at[1] - at[0]) % len(corners) == 1
        sign = -1.0 if outward else 1.0
        along = _along(card, grids) if card.name == "PLOAD4" else None
        value = tuple((p[i] if along else sign * p[i]) for i in at)
        found.append(Pressed(_set(card), kind, nodes, value, along))
    return found
