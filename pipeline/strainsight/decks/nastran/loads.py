"""Static loads of a Nastran deck: forces, moments, pressures, weight, rotation, and what a LOAD makes of them."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from strainsight.decks.faults import PRELOAD, moment_note
from strainsight.decks.nastran.cards import Card, Cards, Deck
from strainsight.decks.nastran.case_control import expand, large_displacements
from strainsight.decks.nastran.grids import Grids, axes_at, resolved_system
from strainsight.decks.text import Line
from strainsight.mesh.coordinates import CoordinateSystem, local_axes
from strainsight.mesh.facets import consistent_forces
from strainsight.mesh.joins import BodyForce, NodalForces
from strainsight.mesh.kinds import FACETS, facet_of, kind_of
from strainsight.mesh.kinds.kind import ElementKind, Kind
from strainsight.mesh.model import FloatArray, IntArray, Mesh

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


def pressure_forces(cards: Cards, grids: Grids, mesh: Mesh) -> Iterator[tuple[int, IntArray, FloatArray]]:
    """(set, rows (m,), force (m, 3)) of the pressures, the consistent forces of

        t = −p n       or       t = p N/|N| along the vector N of a PLOAD4,     p linear or bilinear between the corners.

    A pressure is positive inward on a solid (PLOAD4 with its corners), and along the normal by the right-hand rule on the nodes
    of a PLOAD and on plates (PLOAD2, PLOAD4), which are shells of the model or coat a solid.
    Raises DeckError for an element, node or face that is not there, and for loads on edges (SORL = LINE).
    """
    groups: dict[tuple[int, str, int, object], list[Pressed]] = {}
    for own in _pressed(cards, grids, mesh):
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


def _pressed(cards: Cards, grids: Grids, mesh: Mesh) -> list[Pressed]:
    found: list[Pressed] = []
    outlines: list[
        tuple[Card, tuple[int, ...], tuple[float, ...]]
    ] = []  # of PLOAD and plates: corners in their sequence
    place = (
        {int(i): (block, row) for block in mesh.blocks for row, i in enumerate(block.ids)} if "PLOAD4" in cards else {}
    )
    plates = _plates(cards, grids)
    for card in cards.of("PLOAD"):
        p = card.real(1, "the pressure")
        ids = [card.integer(2 + i, "a node id") for i in range(4) if i < 3 or not card.is_blank(5)]
        outlines.append((card, tuple(grids.nodes.row(i, card) for i in ids), (p,) * len(ids)))
    for card in cards.of("PLOAD2"):
        p = card.real(1, "the pressure")
        for corners in _named_plates(card, card.tokens[2:], plates):
            outlines.append((card, corners, (p,) * len(corners)))
    for card in cards.of("PLOAD4"):
        number = card.integer(1, "the element id")
        first = card.real(2, "the pressure")
        p4 = tuple(card.real(2 + i, "the pressure", first) for i in range(4))
        if number in place and card.text(6).upper() != "THRU":
            block, row = place[number]
            kind, local = _loaded_face(card, kind_of(block.kind), block.nodes[row], grids)
            found.append(
                Pressed(
                    _set(card), kind, block.nodes[row][list(local)], p4[: kind.corners], _pressures_along(card, grids)
                )
            )
        else:
            last = [card.text(1), *card.tokens[6:8]] if card.text(6).upper() == "THRU" else [card.text(1)]
            for corners in _named_plates(card, last, plates):
                outlines.append((card, corners, p4[: len(corners)]))
    return found + _outlined(outlines, grids, mesh)


def _set(card: Card) -> int:
    return card.integer(0, "the set id")


def _pressures_along(card: Card, grids: Grids) -> tuple[CoordinateSystem, tuple[float, float, float]] | None:
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
        if card.is_blank(i):
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


def _plates(cards: Cards, grids: Grids) -> dict[int, tuple[int, ...]]:
    """Element id → rows of its corners, of the plates of the deck, where a pressure may refer to one."""
    if not ("PLOAD2" in cards or "PLOAD4" in cards):
        return {}
    return {
        card.integer(0, "the element id"): tuple(
            grids.nodes.row(card.integer(2 + i, "a node id"), card) for i in range(count)
        )
        for name, count in PLATES.items()
        for card in cards.of(name)
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
    outlines: Sequence[tuple[Card, tuple[int, ...], tuple[float, ...]]], grids: Grids, mesh: Mesh
) -> list[Pressed]:
    """The facets of solids with these corners, or else shells; a pressure along the sequence of the corners becomes one inward,
    which of a shell is against the normal by its nodes."""
    if not outlines:
        return []
    wanted = np.zeros(len(grids.position), dtype=bool)
    wanted[[row for _, corners, _ in outlines for row in corners]] = True
    facets: dict[frozenset[int], tuple[Kind, IntArray]] = {}
    for block in mesh.blocks:
        for kind, local in kind_of(block.kind).facets:
            nodes = block.nodes[:, list(local)]
            for own in nodes[wanted[nodes[:, : kind.corners]].all(axis=1)]:
                facets.setdefault(frozenset(own[: kind.corners].tolist()), (kind, own))
    for shell in mesh.shells:
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
        along = _pressures_along(card, grids) if card.name == "PLOAD4" else None
        value = tuple((p[i] if along else sign * p[i]) for i in at)
        found.append(Pressed(_set(card), kind, nodes, value, along))
    return found


POINTS = {"": 0, "1": 2, "2": 4}
"""FORCE, FORCE1, FORCE2: by how many nodes the direction is given."""
LOADS = (
    *(f"{kind}{which}" for kind in ("FORCE", "MOMENT") for which in POINTS),
    *("PLOAD", "PLOAD2", "PLOAD4", "GRAV", "RFORCE", "LOAD"),
)
_SOLUTION = re.compile(r"\s*SOL[\s=]+(\w+)", re.IGNORECASE)
_STATSUB = re.compile(r"\s*STATSUB\b\s*(\(.*?\))?\s*=", re.IGNORECASE)
_METHOD = re.compile(r"\s*C?METHOD\b\s*(\(.*?\))?\s*=", re.IGNORECASE)
_MODES = re.compile(r"\s*(NLIC\b|ANALYSIS\s*=\s*(MODES|MCEIG|DCEIG|MFREQ|DFREQ|MTRAN|DTRAN))", re.IGNORECASE)
_LOADED = re.compile(r"\s*ANALYSIS\s*=\s*(NLST|STATIC|PRELOAD)", re.IGNORECASE)
BUCKLING = {"105", "SEBUCKL", "5"}
STATIC = {"106", "NLSTATIC", "66"}
"""Nonlinear statics: METHOD beside LGDISP asks for the modes about the loaded state."""
STEPS = {"400", "401", "402"}
"""Solutions of several steps, in which modes follow statics; displacements may be large unless LGDISP says they are not."""


@dataclass
class LoadSet:
    """What a set holds: force and moment by row of the node, body forces, and the names of its cards."""

    force: defaultdict[int, FloatArray] = field(default_factory=lambda: defaultdict(lambda: np.zeros(3)))
    moment: defaultdict[int, FloatArray] = field(default_factory=lambda: defaultdict(lambda: np.zeros(3)))
    body: list[BodyForce] = field(default_factory=list)
    cards: set[str] = field(default_factory=set)

    def add(self, other: LoadSet, factor: float) -> None:
        """What the other set holds, times a factor."""
        for own, more in ((self.force, other.force), (self.moment, other.moment)):
            for row, value in more.items():
                own[row] += factor * value
        self.body += [replace(body, factor=factor * body.factor) for body in other.body]

    def made(self) -> NodalForces:
        """As a load of the mesh."""
        rows, none = list(dict.fromkeys([*self.force, *self.moment])), np.zeros(3)
        force, moment = (np.array([own.get(i, none) for i in rows]).reshape(-1, 3) for own in (self.force, self.moment))
        return NodalForces(np.array(rows, dtype=np.int64), force, moment if self.moment else None, tuple(self.body))


def static_loads(
    cards: Cards, grids: Grids, mesh: Mesh, turning: Collection[int], notes: list[str]
) -> dict[str, NodalForces]:
    """The loads of set s: "FORCE-s" where it holds FORCE cards alone, else "LOAD-s"; of a LOAD card "LOAD-s" too.

        FORCE   F N along the directions of its CID at the node,   FORCE1  along G1G2,   FORCE2  along G1G2 × G3G4
        GRAV    g = A N,     RFORCE  ω = 2π A R through the node G,     LOAD  S Σ S_i L_i

    MOMENTs likewise; mesh: solids and shells on their nodes; turning: rows of nodes with rotations, a MOMENT on any other
    becomes a note. Loads on one node add up.
    Raises DeckError for a node, element, system or set that is not there, and for an angular acceleration.
    """
    sets: dict[int, LoadSet] = {}

    def of(card: Card) -> LoadSet:
        own = sets.setdefault(card.integer(0, "the set id"), LoadSet())
        own.cards.add(card.name)
        return own

    for kind in ("FORCE", "MOMENT"):
        for which, points in POINTS.items():
            for card in cards.of(kind + which):
                row = grids.nodes.row(card.integer(1, "the node id"), card)
                values = of(card).force if kind == "FORCE" else of(card).moment
                values[row] += _vector(card, row, points, grids)
    for name in ("PLOAD", "PLOAD2", "PLOAD4"):
        for card in cards.of(name):
            of(card)
    for number, rows, force in pressure_forces(cards, grids, mesh):
        own = sets[number].force
        for row, value in zip(rows.tolist(), force, strict=True):
            own[row] += value
    for card in cards.of("GRAV"):
        of(card).body.append(BodyForce(acceleration=_along(card, 1, 2, grids)))
    for card in cards.of("RFORCE"):
        if card.real(8, "the angular acceleration RACC", 0.0) != 0:
            raise card.error("RACC states an angular acceleration", "only a steady rotation is supported: leave it out")
        at = card.integer(1, "the node G", 0)
        centre = grids.position[grids.nodes.row(at, card)] if at else np.zeros(3)
        of(card).body.append(BodyForce(rotation=2 * np.pi * _along(card, 2, 3, grids), centre=centre))
    loose = sorted({int(grids.nodes.ids[row]) for own in sets.values() for row in own.moment if row not in turning})
    if loose:
        notes.append(moment_note("MOMENT", loose))
    named = {
        f"{'FORCE' if own.cards == {'FORCE'} else 'LOAD'}-{number}": own.made() for number, own in sorted(sets.items())
    }
    return named | _combined(cards.of("LOAD"), sets)


def _combined(cards: Sequence[Card], sets: dict[int, LoadSet]) -> dict[str, NodalForces]:
    found: dict[int, LoadSet] = {}
    for card in cards:
        number, whole = card.integer(0, "the set id"), card.real(1, "the factor S")
        if number in sets or number in found:
            raise card.error("other loads have its set id", "give the combination an id of its own")
        own = found[number] = LoadSet()
        for i in range(2, len(card.tokens), 2):
            if not (card.text(i) or card.text(i + 1)):
                continue
            part = card.integer(i + 1, "a set id")
            if part not in sets:
                raise card.error(
                    f"set {part} holds no load that is imported",
                    "take it out, or leave the combination out (mesh.ignore: [LOAD])",
                )
            own.add(sets[part], whole * card.real(i, "a factor"))
    return {f"LOAD-{number}": own.made() for number, own in sorted(found.items())}


def _vector(card: Card, row: int, points: int, grids: Grids) -> FloatArray:
    """Force or moment of a card, by the components in its system or by two or four nodes."""
    if not points:
        axes = axes_at(grids.position[row], resolved_system(card, 2, grids.systems))
        size = card.real(3, f"the {card.name.lower()}")
        return np.asarray(size * axes @ [card.real(i, "the direction", 0.0) for i in (4, 5, 6)])
    x = [grids.position[grids.nodes.row(card.integer(3 + i, "a node id"), card)] for i in range(points)]
    direction = x[1] - x[0] if points == 2 else np.cross(x[1] - x[0], x[3] - x[2])
    if not np.linalg.norm(direction) > 0:
        raise card.error("its nodes give no direction", "name nodes that do not coincide or lie on one line")
    size = card.real(2, f"the {card.name.rstrip('12').lower()}")
    return np.asarray(size * direction / np.linalg.norm(direction))


def _along(card: Card, system: int, size: int, grids: Grids) -> FloatArray:
    """Size times the vector behind it, in a rectangular system."""
    own = resolved_system(card, system, grids.systems)
    if own.kind != "rectangular":
        raise card.error("its system is not rectangular", "give the vector in a rectangular one")
    vector = [card.real(size + 1 + i, "a component of the vector", 0.0) for i in range(3)]
    return np.asarray(card.real(size, "the factor A") * own.axes @ vector)


def preloads(deck: Deck) -> dict[str, list[Line]]:
    """Cards as `Mesh.ignored` names them, "PRELOAD by STATSUB" → the lines of the case control that ask for it."""
    control = deck.case_control
    solution = next((match[1].upper() for line in control if (match := _SOLUTION.match(line.text))), "")
    found: dict[str, list[Line]] = {}
    if solution not in BUCKLING:
        found["STATSUB"] = [line for line in control if _STATSUB.match(line.text)]
    large = large_displacements(deck)
    if solution in STATIC and large:
        found[f"SOL {solution}"] = [line for line in control if _METHOD.match(line.text)]
    loaded = any(_LOADED.match(line.text) for line in control)
    if solution in STEPS and loaded and large is not False:
        found[f"SOL {solution}"] = [line for line in control if _MODES.match(line.text)]
    return {f"{PRELOAD} by {name}": lines for name, lines in found.items() if lines}
