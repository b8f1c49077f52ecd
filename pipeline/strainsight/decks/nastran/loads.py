"""Static loads of a Nastran deck: forces, moments, pressures, gravity, rotation, and their combinations (LOAD)."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from strainsight.decks.faults import PRELOAD, moment_note
from strainsight.decks.nastran.cards import Card, Cards, Deck
from strainsight.decks.nastran.case_control import expand, large_displacements
from strainsight.decks.nastran.grids import Grids, axes_at, find_system
from strainsight.decks.text import Line
from strainsight.mesh.coordinates import CoordinateSystem, local_axes
from strainsight.mesh.facets import consistent_forces
from strainsight.mesh.joins import BodyForce, NodalForces
from strainsight.mesh.kinds import FACETS, facet_of, kind_of
from strainsight.mesh.kinds.kind import ElementKind, Kind
from strainsight.mesh.model import FloatArray, IntArray, Mesh

PLATES = {"CQUAD4": 4, "CQUADR": 4, "CQUAD8": 4, "CTRIA3": 3, "CTRIAR": 3, "CTRIA6": 3}
"""Card → number of corners; if an ignored plate coats a solid, its pressure acts on the solid."""


@dataclass(frozen=True)
class Pressed:
    """A facet under pressure: set; kind; nodes (k,) rows, normal outward; p [Pa] at its corners, positive inward;
    along: system and vector of the direction of p, None for the normal."""

    set: int
    kind: Kind
    nodes: IntArray
    p: tuple[float, ...]
    along: tuple[CoordinateSystem, tuple[float, float, float]] | None = None


def pressure_forces(cards: Cards, grids: Grids, mesh: Mesh) -> Iterator[tuple[int, IntArray, FloatArray]]:
    """(set, rows (m,), force (m, 3)) of the pressures, the consistent forces of

        t = −p n       or       t = p N/|N| along the vector N of a PLOAD4,     p linear or bilinear between the
        corners.

    A pressure is positive inward on a solid (PLOAD4 with its corners), and along the normal by the right-hand rule
    for the nodes of a PLOAD and for plates (PLOAD2, PLOAD4), which are shells of the model or coat a solid. Raises
    DeckError for a missing element, node or face, and for loads on edges (SORL = LINE)."""
    groups: dict[tuple[int, str, int, object], list[Pressed]] = {}
    for facet in _pressed_facets(cards, grids, mesh):
        along = None if facet.along is None else (id(facet.along[0]), facet.along[1])
        groups.setdefault((facet.set, facet.kind.name, len(facet.p), along), []).append(facet)
    for group in groups.values():
        first = group[0]
        p, nodes = np.array([facet.p for facet in group]), np.array([facet.nodes for facet in group])
        linear = next(kind for kind in FACETS if len(kind.nodes) == first.kind.corners)
        yield first.set, nodes.ravel(), _forces(grids.position, first, linear, nodes, p).reshape(-1, 3)


def _forces(position: FloatArray, like: Pressed, linear: Kind, nodes: IntArray, p: FloatArray) -> FloatArray:
    """Forces (f, k, 3) on facets with pressures p (f, c) at the corners, in the direction of `like`."""

    def traction(x: FloatArray, n: FloatArray, xi: FloatArray) -> FloatArray:
        size = np.einsum("qc,fc->fq", linear.shape(xi), p)[..., None]
        if like.along is None:
            return -size * n
        system, vector = like.along
        axes = local_axes(x.reshape(-1, 3), system)[0]
        return size * (axes @ np.array(vector) / np.linalg.norm(vector)).reshape(x.shape)

    return consistent_forces(position, like.kind, nodes, traction)


def _pressed_facets(cards: Cards, grids: Grids, mesh: Mesh) -> list[Pressed]:
    facets: list[Pressed] = []
    outlines: list[tuple[Card, tuple[int, ...], tuple[float, ...]]] = []  # PLOAD and plates: corners in order
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
        named = _named_plates(card, card.tokens[2:], plates)
        outlines += [(card, corners, (p,) * len(corners)) for corners in named]
    for card in cards.of("PLOAD4"):
        number = card.integer(1, "the element id")
        first = card.real(2, "the pressure")
        p4 = tuple(card.real(2 + i, "the pressure", first) for i in range(4))
        if number in place and card.text(6).upper() != "THRU":
            block, row = place[number]
            kind, local = _loaded_face(card, kind_of(block.kind), block.nodes[row], grids)
            facets.append(
                Pressed(
                    _set(card), kind, block.nodes[row][list(local)], p4[: kind.corners], _pressures_along(card, grids)
                )
            )
        else:
            last = [card.text(1), *card.tokens[6:8]] if card.text(6).upper() == "THRU" else [card.text(1)]
            outlines += [(card, corners, p4[: len(corners)]) for corners in _named_plates(card, last, plates)]
    return facets + _facets_of_outlines(outlines, grids, mesh)


def _set(card: Card) -> int:
    return card.integer(0, "the load set id")


def _pressures_along(card: Card, grids: Grids) -> tuple[CoordinateSystem, tuple[float, float, float]] | None:
    """Vector of a PLOAD4 in its system, or None."""
    if card.text(12).upper() == "LINE":
        raise card.error("SORL is LINE: loads on edges are not supported", "define the load as a pressure on the face")
    a, b, c = (card.real(9 + i, "a component of the load direction", 0.0) for i in range(3))
    return (find_system(card, 8, grids.systems), (a, b, c)) if a or b or c else None


def _loaded_face(card: Card, kind: ElementKind, nodes: IntArray, grids: Grids) -> tuple[Kind, tuple[int, ...]]:
    """Facet of a solid defined by G1 and G3 or G4, and its local nodes with G1 first. G3/G4 is the opposite corner
    of a quadrilateral; of a tetrahedron the corner that is not on the triangle; of a pyramid the end of its base edge."""
    node_rows = nodes.tolist()

    def corner(i: int) -> int | None:
        if card.is_blank(i):
            return None
        row = grids.nodes.row(card.integer(i, "a node id"), card)
        if row not in node_rows[: kind.corners]:
            raise card.error(
                f"node {card.text(i)} is not a corner of element {card.text(1)}",
                "specify corner nodes of the element as G1 and G3/G4",
            )
        return node_rows.index(row)

    first, other = corner(6), corner(7)
    matches = []
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
            matches.append((facet, local))
    if len(matches) != 1:
        raise card.error(
            f"G1 and G3 or G4 define {'no face' if not matches else 'several faces'} of the {kind.name} element {card.text(1)}",
            "quadrilateral face: specify two opposite corners as G1 and G3; tetrahedron: specify a corner of the face "
            "as G1, and the corner that is not on the face as G4",
        )
    facet, local = matches[0]
    at = local.index(first)
    turn = [(at + i) % facet.corners for i in range(facet.corners)]
    middle = [facet.corners + i for i in turn] if len(local) > facet.corners else []
    return facet, tuple(local[i] for i in (*turn, *middle))


def _plates(cards: Cards, grids: Grids) -> dict[int, tuple[int, ...]]:
    """Element id → rows of its corners, for the plates that pressure loads may use."""
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
        what = f"element {missing[0]} is not a" if missing.size else "the card refers to no"
        raise card.error(
            f"{what} {'shell' if card.name == 'PLOAD2' else 'solid or shell'} of the deck",
            f"correct the id, or leave these loads out (mesh.ignore: [{card.name}])",
        )
    return [plates[i] for i in ids.tolist()]


def _facets_of_outlines(
    outlines: Sequence[tuple[Card, tuple[int, ...], tuple[float, ...]]], grids: Grids, mesh: Mesh
) -> list[Pressed]:
    """Facets of solids, or else shells, with these corners; a pressure along the right-hand normal of the corners
    becomes inward pressure, which acts against the nodal normal of a shell."""
    if not outlines:
        return []
    wanted = np.zeros(len(grids.position), dtype=bool)
    wanted[[row for _, corners, _ in outlines for row in corners]] = True
    facets: dict[frozenset[int], tuple[Kind, IntArray]] = {}
    for block in mesh.blocks:
        for kind, local in kind_of(block.kind).facets:
            nodes = block.nodes[:, list(local)]
            for nodes_of_facet in nodes[wanted[nodes[:, : kind.corners]].all(axis=1)]:
                facets.setdefault(frozenset(nodes_of_facet[: kind.corners].tolist()), (kind, nodes_of_facet))
    for shell in mesh.shells:
        plane = facet_of(shell.kind)
        for nodes_of_facet in shell.nodes[wanted[shell.corners].all(axis=1)]:
            facets.setdefault(frozenset(nodes_of_facet[: plane.corners].tolist()), (plane, nodes_of_facet))
    pressed = []
    for card, corners, p in outlines:
        if frozenset(corners) not in facets:
            ids = ", ".join(str(grids.nodes.ids[row]) for row in corners)
            raise card.error(
                f"no solid or shell has a face with the corners {ids}",
                f"correct the corners, or leave these loads out (mesh.ignore: [{card.name}])",
            )
        kind, nodes = facets[frozenset(corners)]
        at = [corners.index(row) for row in nodes[: kind.corners].tolist()]
        sign = -1.0 if (at[1] - at[0]) % len(corners) == 1 else 1.0  # outward normal: -1
        along = _pressures_along(card, grids) if card.name == "PLOAD4" else None
        value = tuple((p[i] if along else sign * p[i]) for i in at)
        pressed.append(Pressed(_set(card), kind, nodes, value, along))
    return pressed


POINTS = {"": 0, "1": 2, "2": 4}
"""FORCE, FORCE1, FORCE2: number of nodes that define the direction."""
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
"""Nonlinear statics: METHOD with LGDISP requests modes about the loaded state."""
STEPS = {"400", "401", "402"}
"""Solutions with several steps, in which modes follow statics; displacements are large unless LGDISP disables them."""


@dataclass
class LoadSet:
    """Loads of a set: force and moment by node row, body forces, and the names of the cards."""

    force: defaultdict[int, FloatArray] = field(default_factory=lambda: defaultdict(lambda: np.zeros(3)))
    moment: defaultdict[int, FloatArray] = field(default_factory=lambda: defaultdict(lambda: np.zeros(3)))
    body: list[BodyForce] = field(default_factory=list)
    cards: set[str] = field(default_factory=set)

    def add(self, other: LoadSet, factor: float) -> None:
        """Add the loads of the other set, times a factor."""
        for values, more in ((self.force, other.force), (self.moment, other.moment)):
            for row, value in more.items():
                values[row] += factor * value
        self.body += [replace(body, factor=factor * body.factor) for body in other.body]

    def to_nodal_forces(self) -> NodalForces:
        """The set as a load of the mesh."""
        rows, none = list(dict.fromkeys([*self.force, *self.moment])), np.zeros(3)
        force, moment = (
            np.array([vectors.get(i, none) for i in rows]).reshape(-1, 3) for vectors in (self.force, self.moment)
        )
        return NodalForces(np.array(rows, dtype=np.int64), force, moment if self.moment else None, tuple(self.body))


def static_loads(
    cards: Cards, grids: Grids, mesh: Mesh, turning: Collection[int], notes: list[str]
) -> dict[str, NodalForces]:
    """Loads of set s: "FORCE-s" if it contains only FORCE cards, else "LOAD-s"; a LOAD card is "LOAD-s" too.

        FORCE   F N along the directions of its CID at the node,   FORCE1  along G1G2,   FORCE2  along G1G2 × G3G4
        GRAV    g = A N,     RFORCE  ω = 2π A R through the node G,     LOAD  S Σ S_i L_i

    MOMENTs likewise; mesh: solids and shells; turning: rows of nodes with rotations; a MOMENT on another node becomes a note.
    Loads on one node are added. Raises DeckError for a missing node, element, system or set, and for an angular acceleration.
    """
    sets: dict[int, LoadSet] = {}

    def of(card: Card) -> LoadSet:
        load_set = sets.setdefault(card.integer(0, "the load set id"), LoadSet())
        load_set.cards.add(card.name)
        return load_set

    for kind in ("FORCE", "MOMENT"):
        for which, points in POINTS.items():
            for card in cards.of(kind + which):
                row = grids.nodes.row(card.integer(1, "the node id"), card)
                values = of(card).force if kind == "FORCE" else of(card).moment
                values[row] += _vector(card, row, points, grids)
    for card in cards.of("PLOAD", "PLOAD2", "PLOAD4"):
        of(card)
    for number, rows, force in pressure_forces(cards, grids, mesh):
        forces = sets[number].force
        for row, value in zip(rows.tolist(), force, strict=True):
            forces[row] += value
    for card in cards.of("GRAV"):
        of(card).body.append(BodyForce(acceleration=_along(card, 1, 2, grids)))
    for card in cards.of("RFORCE"):
        if card.real(8, "the angular acceleration RACC", 0.0) != 0:
            raise card.error("angular acceleration (RACC) is not supported", "leave RACC blank")
        at = card.integer(1, "the node G", 0)
        centre = grids.position[grids.nodes.row(at, card)] if at else np.zeros(3)
        of(card).body.append(BodyForce(rotation=2 * np.pi * _along(card, 2, 3, grids), centre=centre))
    loose = sorted(
        {int(grids.nodes.ids[row]) for load_set in sets.values() for row in load_set.moment if row not in turning}
    )
    if loose:
        notes.append(moment_note("MOMENT", loose))
    named = {
        f"{'FORCE' if load_set.cards == {'FORCE'} else 'LOAD'}-{number}": load_set.to_nodal_forces()
        for number, load_set in sorted(sets.items())
    }
    return named | _combine_loads(cards.of("LOAD"), sets)


def _combine_loads(cards: Sequence[Card], sets: dict[int, LoadSet]) -> dict[str, NodalForces]:
    combined: dict[int, LoadSet] = {}
    for card in cards:
        number, whole = card.integer(0, "the load set id"), card.real(1, "the factor S")
        if number in sets or number in combined:
            raise card.error(f"set id {number} is also used by other loads", "use a unique set id for this LOAD card")
        total = combined[number] = LoadSet()
        for i in range(2, len(card.tokens), 2):
            if not (card.text(i) or card.text(i + 1)):
                continue
            part = card.integer(i + 1, "a set id")
            if part not in sets:
                raise card.error(
                    f"load set {part} contains no imported load",
                    "remove this load set from the card, or leave all LOAD cards out (mesh.ignore: [LOAD])",
                )
            total.add(sets[part], whole * card.real(i, "a factor"))
    return {f"LOAD-{number}": total.to_nodal_forces() for number, total in sorted(combined.items())}


def _vector(card: Card, row: int, points: int, grids: Grids) -> FloatArray:
    """Force or moment of a card, from the components in its system or from two or four nodes."""
    if not points:
        axes = axes_at(grids.position[row], find_system(card, 2, grids.systems))
        size = card.real(3, f"the {card.name.lower()}")
        return np.asarray(size * axes @ [card.real(i, "the direction", 0.0) for i in (4, 5, 6)])
    x = [grids.position[grids.nodes.row(card.integer(3 + i, "a node id"), card)] for i in range(points)]
    direction = x[1] - x[0] if points == 2 else np.cross(x[1] - x[0], x[3] - x[2])
    if not np.linalg.norm(direction) > 0:
        raise card.error(
            "the nodes do not define a direction",
            f"specify {'G1 and G2 at different points' if points == 2 else 'G1-G2 and G3-G4 on lines that are not parallel'}",
        )
    size = card.real(2, f"the {card.name.rstrip('12').lower()}")
    return np.asarray(size * direction / np.linalg.norm(direction))


def _along(card: Card, system: int, size: int, grids: Grids) -> FloatArray:
    """Magnitude times vector, in a rectangular system."""
    coordinate_system = find_system(card, system, grids.systems)
    if coordinate_system.kind != "rectangular":
        raise card.error("the coordinate system CID is not rectangular", "specify the vector in a rectangular system")
    vector = [card.real(size + 1 + i, "a component of the load vector", 0.0) for i in range(3)]
    return np.asarray(card.real(size, "the factor A") * coordinate_system.axes @ vector)


def preloads(deck: Deck) -> dict[str, list[Line]]:
    """Preload cards, named as in `Mesh.ignored`, "PRELOAD by STATSUB" → lines of the case control that cause them."""
    control = deck.case_control
    solution = next((match[1].upper() for line in control if (match := _SOLUTION.match(line.text))), "")
    lines_by_name: dict[str, list[Line]] = {}
    if solution not in BUCKLING:
        lines_by_name["STATSUB"] = [line for line in control if _STATSUB.match(line.text)]
    large = large_displacements(deck)
    if solution in STATIC and large:
        lines_by_name[f"SOL {solution}"] = [line for line in control if _METHOD.match(line.text)]
    if solution in STEPS and any(_LOADED.match(line.text) for line in control) and large is not False:
        lines_by_name[f"SOL {solution}"] = [line for line in control if _MODES.match(line.text)]
    return {f"{PRELOAD} by {name}": lines for name, lines in lines_by_name.items() if lines}
