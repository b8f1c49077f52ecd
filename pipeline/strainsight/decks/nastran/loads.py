"""Static loads of a Nastran deck: forces, moments, pressures, weight, rotation, and what a LOAD makes of them."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from strainsight.decks.effects import PRELOAD
from strainsight.decks.moments import moment_note
from strainsight.decks.nastran.cards import Card, Deck
from strainsight.decks.nastran.grids import Grids, axes_at, resolved_system
from strainsight.decks.nastran.parameters import large_displacements
from strainsight.decks.nastran.pressures import pressure_forces
from strainsight.decks.text import Line
from strainsight.mesh.forces import BodyForce, NodalForces
from strainsight.mesh.model import CellBlock, FloatArray
from strainsight.mesh.thin import ShellBlock

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

    force: dict[int, FloatArray] = field(default_factory=dict)
    moment: dict[int, FloatArray] = field(default_factory=dict)
    body: list[BodyForce] = field(default_factory=list)
    cards: set[str] = field(default_factory=set)

    def add(self, other: LoadSet, factor: float) -> None:
        """What the other set holds, times a factor."""
        for own, more in ((self.force, other.force), (self.moment, other.moment)):
            for row, value in more.items():
                own[row] = own.get(row, np.zeros(3)) + factor * value
        self.body += [replace(body, factor=factor * body.factor) for body in other.body]

    def made(self) -> NodalForces:
        """As a load of the mesh."""
        rows = list(dict.fromkeys([*self.force, *self.moment]))
        nothing = np.zeros(3)
        force = np.array([self.force.get(row, nothing) for row in rows]).reshape(-1, 3)
        moment = np.array([self.moment.get(row, nothing) for row in rows]).reshape(-1, 3) if self.moment else None
        return NodalForces(np.array(rows, dtype=np.int64), force, moment, tuple(self.body))


def static_loads(
    cards: dict[str, list[Card]],
    grids: Grids,
    blocks: Sequence[CellBlock],
    shells: Sequence[ShellBlock],
    turning: Collection[int],
    notes: list[str],
) -> dict[str, NodalForces]:
    """The loads of set s: "FORCE-s" where it holds FORCE cards alone, else "LOAD-s"; of a LOAD card "LOAD-s" too.

        FORCE   F N along the directions of its CID at the node,   FORCE1  along G1G2,   FORCE2  along G1G2 × G3G4
        GRAV    g = A N,     RFORCE  ω = 2π A R through the node G,     LOAD  S Σ S_i L_i

    MOMENTs likewise; turning: rows of nodes with rotations, a MOMENT on any other becomes a note. Loads on one node add up.
    Raises DeckError for a node, element, system or set that is not there, and for an angular acceleration.
    """
    sets: dict[int, LoadSet] = {}

    def of(card: Card) -> LoadSet:
        own = sets.setdefault(card.integer(0, "the set id"), LoadSet())
        own.cards.add(card.name)
        return own

    for kind in ("FORCE", "MOMENT"):
        for which, points in POINTS.items():
            for card in cards.get(kind + which, []):
                row = grids.nodes.row(card.integer(1, "the node id"), card)
                values = of(card).force if kind == "FORCE" else of(card).moment
                values[row] = values.get(row, np.zeros(3)) + _vector(card, row, points, grids)
    for name in ("PLOAD", "PLOAD2", "PLOAD4"):
        for card in cards.get(name, []):
            of(card)
    for number, rows, force in pressure_forces(cards, grids, blocks, shells):
        own = sets[number].force
        for row, value in zip(rows.tolist(), force, strict=True):
            own[row] = own.get(row, np.zeros(3)) + value
    for card in cards.get("GRAV", []):
        of(card).body.append(BodyForce(acceleration=_along(card, 1, 2, grids)))
    for card in cards.get("RFORCE", []):
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
    return named | _combined(cards.get("LOAD", []), sets)


def _combined(cards: Sequence[Card], sets: dict[int, LoadSet]) -> dict[str, NodalForces]:
    found: dict[int, LoadSet] = {}
    for card in cards:
        number, whole = card.integer(0, "the set id"), card.real(1, "the factor S")
        if number in sets or number in found:
            raise card.error("other loads have its set id", "give the combination an id of its own")
        own = found[number] = LoadSet()
        for i in range(2, len(card.fields), 2):
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
