"""Shells of a Nastran deck: CQUAD4, CTRIA3 and PSHELL."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from strainsight.decks.faults import folded
from strainsight.decks.nastran.cards import Card
from strainsight.decks.nastran.grids import Grids, resolved_system
from strainsight.decks.numbers import parse_integer
from strainsight.mesh.model import FloatArray, IntArray
from strainsight.mesh.plates import PARALLEL, plate_normals
from strainsight.mesh.thin import BeamSection, Section, ShellBlock, ShellSection

SHELLS = {"CQUAD4": 4, "CQUADR": 4, "CTRIA3": 3, "CTRIAR": 3}
"""Card → number of nodes."""
KINDS = {4: "quad4", 3: "tri3"}
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

    Raises DeckError for a missing or repeated node, a shell of no area, folded or warped too much, one whose corners are of
    another thickness than its property, and a material axis along its normal.
    """
    if read_as := sorted({card.name for card in cards} & {"CQUADR", "CTRIAR"}):
        notes.append(f"{', '.join(read_as)}: read as CQUAD4 and CTRIA3")
    blocks = []
    for corners, kind in KINDS.items():
        rows = np.flatnonzero([SHELLS[card.name] == corners for card in cards])
        if not rows.size:
            continue
        own = [cards[i] for i in rows.tolist()]
        given = np.array([[card.integer(2 + i, "a node id") for i in range(corners)] for card in own], dtype=np.int64)
        nodes = grids.nodes.rows_of_cards(given, own)
        if (at := folded(nodes)) is not None:
            raise own[at].error(
                "a node stands twice in the element", "write a collapsed quadrangle as a CTRIA3, take others out"
            )
        x = grids.position[nodes]
        normal = _normals(own, x, notes)
        for card, number in zip(own, region[rows].tolist(), strict=True):
            section = sections[number]
            assert not isinstance(section, BeamSection)
            _check_corners(card, corners, section.thickness)
        axis = np.array(
            [_axis(card, corners, *of, grids) for card, of in zip(own, zip(x, normal, strict=True), strict=True)]
        )
        offset = np.array([card.real(corners + 3, "the offset ZOFFS", 0.0) for card in own])
        offset = offset + np.array([middles.get(number, 0.0) for number in region[rows].tolist()])
        blocks.append(ShellBlock(kind, ids[rows], nodes, region[rows], offset, axis.reshape(-1, 3)))
    return tuple(blocks)


def _normals(cards: Sequence[Card], x: FloatArray, notes: list[str]) -> FloatArray:
    """Unit normals (n, 3) of shells with corners x (n, k, 3)."""
    return plate_normals(
        x,
        lambda i, what, remedy: cards[i].error(what, remedy),
        lambda i: f"CQUAD4 {cards[i].text(0)}",
        "CTRIA3",
        notes,
    )


def _check_corners(card: Card, corners: int, thickness: float) -> None:
    """T1 to T4, or what they are of T where TFLAG is 1, have to be the thickness of the property."""
    if not any(card.text(10 + i) for i in range(corners)):
        return
    unit = thickness if card.integer(9, "TFLAG", 0) == 1 else 1.0
    for i in range(corners):
        own = unit * card.real(10 + i, "the thickness of a corner", thickness / unit)
        if abs(own - thickness) > SAME * thickness:
            raise card.error(
                f"T{i + 1} makes it {own:g} thick at a corner, its property {thickness:g}: a thickness that varies is not "
                "supported",
                "leave T1 to T4 blank, and give it a PSHELL of the thickness that it has in the mean",
            )


def _axis(card: Card, corners: int, x: FloatArray, normal: FloatArray, grids: Grids) -> FloatArray:
    """Its material axis (3,): side 1-2 turned by THETA about the normal, x of the system MCID; NaN for side 1-2."""
    token = card.text(corners + 2)
    if parse_integer(token) is not None:
        axis = resolved_system(card, corners + 2, grids.systems).axes[:, 0]
        if not np.linalg.norm(np.cross(axis, normal)) > PARALLEL:
            raise card.error(
                f"x of its material system {token} is along its normal", "name a system whose x lies along the shell"
            )
        return axis
    theta = np.radians(card.real(corners + 2, "the angle THETA", 0.0))
    if theta == 0:
        return np.full(3, np.nan)
    side = x[1] - x[0]
    side = side - (side @ normal) * normal
    side = side / np.linalg.norm(side)
    return np.asarray(np.cos(theta) * side + np.sin(theta) * np.cross(normal, side))
