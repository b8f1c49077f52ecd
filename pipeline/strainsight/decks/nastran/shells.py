"""Shells of a Nastran deck: CQUAD4, CTRIA3, CQUAD8, CTRIA6 and PSHELL."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.decks.faults import folded
from strainsight.decks.nastran.cards import Card
from strainsight.decks.nastran.grids import Grids, resolved_system
from strainsight.decks.numbers import parse_integer
from strainsight.mesh.model import FloatArray, IntArray
from strainsight.mesh.plates import PARALLEL, plate_normals
from strainsight.mesh.thin import SHELL_KINDS, BeamSection, Section, ShellBlock, ShellSection


@dataclass(frozen=True)
class Layout:
    """Of a card: kind of shell; corners; fields of THETA, ZOFFS, TFLAG and T1."""

    kind: str
    corners: int
    theta: int
    offset: int
    flag: int
    thickness: int

    @property
    def nodes(self) -> int:
        """How many it has."""
        return self.corners * (2 if self.kind in ("quad8", "tri6") else 1)


_QUAD4, _TRI3 = Layout("quad4", 4, 6, 7, 9, 10), Layout("tri3", 3, 5, 6, 9, 10)
SHELLS = {
    "CQUAD4": _QUAD4,
    "CQUADR": _QUAD4,
    "CTRIA3": _TRI3,
    "CTRIAR": _TRI3,
    "CQUAD8": Layout("quad8", 4, 14, 15, 16, 10),
    "CTRIA6": Layout("tri6", 3, 8, 9, 13, 10),
}
"""Card → where its entries stand."""
SAME = 1e-5
"""Relative difference of two thicknesses that the digits of a card explain."""


def shell_section(card: Card) -> tuple[int, ShellSection]:
    """MID1 of a PSHELL, and its section where that is the material of all; without MID2 it is a membrane, without MID3 it does
    not shear.

    Raises DeckError for plane strain (MID2 = −1), and a thickness that is not positive.
    """
    t = card.real(2, "the thickness T")
    if not t > 0:
        raise card.error(f"the thickness is {t:g}, not positive", "give a positive thickness")
    if card.text(1) in ("", "0"):
        raise card.error("MID1 is blank: it does not stretch", "give the material of MID2 as MID1 too")
    mid = card.integer(1, "the material MID1")
    if card.text(3) == "-1":
        raise card.error(
            "MID2 is -1, plane strain, which is not supported", "leave MID2 blank for a membrane, in plane stress"
        )
    if card.text(11):
        raise card.error("an entry after MID4 is not supported", "state offsets at the elements (ZOFFS)")
    bending, shear = card.real(4, "12 I/T³", 1.0), card.real(6, "TS/T", 5 / 6)
    if bending < 0 or shear <= 0:
        raise card.error(f"12 I/T³ is {bending:g} and TS/T is {shear:g}", "neither may be negative, nor TS/T zero")
    if card.text(3) in ("", "0"):
        bending, shear = 0.0, 0.0
    elif card.text(5) in ("", "0"):
        shear = np.inf
    nonstructural = card.real(7, "the mass NSM", 0.0)
    if nonstructural < 0:
        raise card.error(f"the mass NSM is {nonstructural:g}, negative", "give a positive mass")
    return mid, ShellSection(t, bending, shear, nonstructural)


def read_shells(
    cards: Sequence[Card],
    ids: IntArray,
    region: IntArray,
    grids: Grids,
    sections: Mapping[int, Section],
    middles: Mapping[int, float],
    notes: list[str],
) -> tuple[ShellBlock, ...]:
    """One block a kind of the cards, whose ids and regions are (n,); middles: region → its middle from the plane of its
    elements, where that is not zero.

    Raises DeckError for a missing or repeated node, one of the second order without all of its mid-side nodes, a shell of no
    area, folded or warped too much, one whose corners are of another thickness than its property, and a material axis along its
    normal.
    """
    if read_as := sorted({card.name for card in cards} & {"CQUADR", "CTRIAR"}):
        notes.append(f"{', '.join(read_as)}: read as CQUAD4 and CTRIA3")
    blocks = []
    for kind in SHELL_KINDS:
        rows = np.flatnonzero([SHELLS[card.name].kind == kind for card in cards])
        if not rows.size:
            continue
        own = [cards[i] for i in rows.tolist()]
        given = np.array([_node_ids(card) for card in own], dtype=np.int64)
        nodes = grids.nodes.rows_of_cards(given, own)
        if (at := folded(nodes)) is not None:
            raise own[at].error(
                "a node stands twice in the element", "write a collapsed quadrangle as a CTRIA3, take others out"
            )
        x = grids.position[nodes[:, : SHELLS[own[0].name].corners]]
        normal = _normals(own, x, notes)
        for card, number in zip(own, region[rows].tolist(), strict=True):
            section = sections[number]
            _check_corners(card, section)
        axis = np.array([_axis(card, *of, grids) for card, of in zip(own, zip(x, normal, strict=True), strict=True)])
        offset = np.array([card.real(SHELLS[card.name].offset, "the offset ZOFFS", 0.0) for card in own])
        offset = offset + np.array([middles.get(number, 0.0) for number in region[rows].tolist()])
        blocks.append(ShellBlock(kind, ids[rows], nodes, region[rows], offset, axis.reshape(-1, 3)))
    return tuple(blocks)


def _node_ids(card: Card) -> list[int]:
    """Corners, then those on the sides, the first between the first two corners."""
    layout = SHELLS[card.name]
    missing = [i for i in range(layout.corners, layout.nodes) if card.text(2 + i) in ("", "0")]
    if missing:
        sides = layout.nodes - layout.corners
        linear = "CQUAD4" if layout.corners == 4 else "CTRIA3"
        raise card.error(
            f"{sides - len(missing)} of {sides} mid-side nodes (G{missing[0] + 1} is blank)",
            f"give all mid-side nodes, or make a {linear} of it where it has none",
        )
    return [card.integer(2 + i, "a node id") for i in range(layout.nodes)]


def _normals(cards: Sequence[Card], x: FloatArray, notes: list[str]) -> FloatArray:
    """Unit normals (n, 3) of shells with corners x (n, k, 3)."""
    return plate_normals(
        x,
        lambda i, what, remedy: cards[i].error(what, remedy),
        lambda i: f"{cards[i].name.replace('QUADR', 'QUAD4')} {cards[i].text(0)}",
        "CTRIA3",
        notes,
    )


def _check_corners(card: Card, section: Section) -> None:
    """T1 to T4, or what they are of T where TFLAG is 1, have to be the thickness of the property."""
    layout = SHELLS[card.name]
    if not any(card.text(layout.thickness + i) for i in range(layout.corners)):
        return
    assert not isinstance(section, BeamSection)
    thickness = section.thickness
    unit = thickness if card.integer(layout.flag, "TFLAG", 0) == 1 else 1.0
    for i in range(layout.corners):
        own = unit * card.real(layout.thickness + i, "the thickness of a corner", thickness / unit)
        if abs(own - thickness) > SAME * thickness:
            raise card.error(
                f"T{i + 1} makes it {own:g} thick at a corner, its property {thickness:g}: a thickness that varies is not "
                "supported",
                "leave T1 to T4 blank, and give it a PSHELL of the thickness that it has in the mean",
            )


def _axis(card: Card, x: FloatArray, normal: FloatArray, grids: Grids) -> FloatArray:
    """Its material axis (3,): side 1-2 turned by THETA about the normal, x of the system MCID; NaN for side 1-2."""
    theta_at = SHELLS[card.name].theta
    token = card.text(theta_at)
    if parse_integer(token) is not None:
        axis = resolved_system(card, theta_at, grids.systems).axes[:, 0]
        if not math.hypot(*_cross(axis.tolist(), normal.tolist())) > PARALLEL:
            raise card.error(
                f"x of its material system {token} is along its normal", "name a system whose x lies along the shell"
            )
        return axis
    theta = np.radians(card.real(theta_at, "the angle THETA", 0.0))
    if theta == 0:
        return np.full(3, np.nan)
    side = x[1] - x[0]
    side = side - (side @ normal) * normal
    side = side / np.linalg.norm(side)
    return np.asarray(np.cos(theta) * side + np.sin(theta) * np.array(_cross(normal.tolist(), side.tolist())))


def _cross(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    """a × b of one element: NumPy takes twenty times as long for it."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
