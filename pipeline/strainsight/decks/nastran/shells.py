"""Shells of a Nastran deck: CQUAD4, CTRIA3, CQUAD8, CTRIA6 and PSHELL."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.decks.faults import find_repeated_node
from strainsight.decks.nastran.cards import Card, Cards, Elements
from strainsight.decks.nastran.grids import Grids, find_system
from strainsight.decks.nastran.materials import isotropic_material, lamina, note_damping
from strainsight.decks.text import parse_integer
from strainsight.mesh.anisotropic import general_fault
from strainsight.mesh.model import FloatArray
from strainsight.mesh.node_order import PARALLEL, plate_normals
from strainsight.mesh.thin import SHELL_KINDS, BeamSection, GeneralShell, Section, ShellBlock, ShellSection


@dataclass(frozen=True)
class Layout:
    """Layout of a card: kind of shell; corners; fields of THETA, ZOFFS, TFLAG and T1."""

    kind: str
    corners: int
    theta: int
    offset: int
    flag: int
    thickness: int

    @property
    def nodes(self) -> int:
        """Number of nodes."""
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
"""Card → layout."""
SAME = 1e-5
"""Relative rounding difference of two thicknesses on cards."""


@dataclass(frozen=True)
class ThinProperty:
    """Property of shells, beams or rods: card and section; material: 0 if plies, or membrane and bending, have
    separate ones; mids: ids of all materials; middle: offset of a laminate from the plane of its elements."""

    card: Card
    section: Section
    material: int
    mids: tuple[int, ...]
    middle: float = 0.0


def shell_section(card: Card) -> tuple[int, ShellSection]:
    """MID1 of a PSHELL, and its section if all materials are MID1; without MID2 it is a membrane, without MID3 rigid in shear.
    Raises DeckError for plane strain (MID2 = −1), and a thickness that is not positive."""
    t = card.positive(2, "the thickness")
    if card.is_blank(1):
        raise card.error("MID1 is blank, so the shell has no membrane stiffness", "set MID1 to the material of MID2")
    mid = card.integer(1, "the material MID1")
    if card.text(3) == "-1":
        raise card.error("MID2 is -1 (plane strain), which is not supported", "leave MID2 blank for a membrane")
    if card.text(11):
        raise card.error(
            "an entry after MID4 is not supported", "remove the entry, and define offsets at the elements (ZOFFS)"
        )
    bending, shear = card.real(4, "12 I/T³", 1.0), card.real(6, "TS/T", 5 / 6)
    if bending < 0 or shear <= 0:
        raise card.error(f"12 I/T³ = {bending:g} or TS/T = {shear:g} is too small", "specify 12 I/T³ ≥ 0 and TS/T > 0")
    if card.is_blank(3):
        bending, shear = 0.0, 0.0
    elif card.is_blank(5):
        shear = np.inf
    return mid, ShellSection(t, bending, shear, card.not_negative(7, "the nonstructural mass NSM", 0.0))


def read_shells(
    elements: Elements, grids: Grids, properties: Mapping[int, ThinProperty], notes: list[str]
) -> tuple[ShellBlock, ...]:
    """One block a kind; properties: of their regions.

    Raises DeckError for a missing or repeated node, missing mid-side nodes, a shell without area, folded or warped
    too much, a corner thickness different from the property, and a material axis along the normal."""
    if read_as := sorted({card.name for card in elements.cards} & {"CQUADR", "CTRIAR"}):
        notes.append(f"{', '.join(read_as)} elements are imported as CQUAD4 or CTRIA3")
    blocks = []
    for kind in SHELL_KINDS:
        cards, ids, region = elements.of([name for name, layout in SHELLS.items() if layout.kind == kind])
        if not cards:
            continue
        nodes = grids.nodes.rows_of_cards(np.array([_node_ids(card) for card in cards], dtype=np.int64), cards)
        if (at := find_repeated_node(nodes)) is not None:
            raise cards[at].error(
                "the element has the same node twice",
                "replace a collapsed quadrilateral by a CTRIA3; remove other elements with a repeated node",
            )
        x = grids.position[nodes[:, : SHELLS[cards[0].name].corners]]
        normal = _normals(cards, x, notes)
        for card, number in zip(cards, region.tolist(), strict=True):
            _check_corners(card, properties[number].section)
        axis = np.array([_axis(*each, grids) for each in zip(cards, x, normal, strict=True)])
        offset = np.array([card.real(SHELLS[card.name].offset, "the shell offset ZOFFS", 0.0) for card in cards])
        offset = offset + np.array([properties[number].middle for number in region.tolist()])
        blocks.append(ShellBlock(kind, ids, nodes, region, offset, axis.reshape(-1, 3)))
    return tuple(blocks)


def _node_ids(card: Card) -> list[int]:
    """Corners, then mid-side nodes, the first between the first two corners."""
    layout = SHELLS[card.name]
    missing = [i for i in range(layout.corners, layout.nodes) if card.is_blank(2 + i)]
    if missing:
        sides = layout.nodes - layout.corners
        linear = "CQUAD4" if layout.corners == 4 else "CTRIA3"
        raise card.error(
            f"the element has {sides - len(missing)} of {sides} mid-side nodes (G{missing[0] + 1} is blank)",
            f"specify all mid-side nodes, or use a {linear} without mid-side nodes",
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
    """Raise DeckError unless T1 to T4, or their product with T if TFLAG is 1, are the thickness of the property."""
    layout = SHELLS[card.name]
    if not any(card.text(layout.thickness + i) for i in range(layout.corners)):
        return
    assert not isinstance(section, BeamSection)
    thickness = section.thickness
    unit = thickness if card.integer(layout.flag, "TFLAG", 0) == 1 else 1.0
    for i in range(layout.corners):
        corner_thickness = unit * card.real(layout.thickness + i, "the thickness at a corner", thickness / unit)
        if abs(corner_thickness - thickness) > SAME * thickness:
            raise card.error(
                f"T{i + 1} defines a thickness of {corner_thickness:g} at a corner, but the property has "
                f"{thickness:g}: variable thickness is not supported",
                "leave T1 to T4 blank, and assign a PSHELL with the mean thickness",
            )


def _axis(card: Card, x: FloatArray, normal: FloatArray, grids: Grids) -> FloatArray:
    """Material axis (3,): side 1-2 rotated by THETA about the normal, or x of the system MCID; NaN for side 1-2."""
    theta_at = SHELLS[card.name].theta
    token = card.text(theta_at)
    if parse_integer(token) is not None:
        axis = find_system(card, theta_at, grids.systems).axes[:, 0]
        if not math.hypot(*_cross(axis.tolist(), normal.tolist())) > PARALLEL:
            raise card.error(
                f"the x axis of the material coordinate system {token} is normal to the shell",
                "set MCID to a coordinate system whose x axis is not normal to the shell",
            )
        return axis
    theta = np.radians(card.real(theta_at, "the material angle THETA", 0.0))
    if theta == 0:
        return np.full(3, np.nan)
    side = x[1] - x[0]
    side = side - (side @ normal) * normal
    side = side / np.linalg.norm(side)
    return np.asarray(np.cos(theta) * side + np.sin(theta) * np.array(_cross(normal.tolist(), side.tolist())))


def _cross(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    """a × b of one element, 20 times faster than NumPy."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


_PLACES = {1: "MID1", 3: "MID2 (bending)", 5: "MID3 (shear)", 10: "MID4 (coupling)"}
"""Field of a material → name."""


def shell_materials(cards: Cards) -> dict[int, list[Card]]:
    """Id → cards MAT1, MAT2 and MAT8 with this id."""
    cards_by_id: dict[int, list[Card]] = {}
    for card in cards.of("MAT1", "MAT2", "MAT8"):
        cards_by_id.setdefault(card.integer(0, "the material id"), []).append(card)
    return cards_by_id


def materials_of(card: Card) -> dict[int, int]:
    """Field → id of the materials of a PSHELL, without blank and zero fields."""
    return {i: card.integer(i, f"the material {what}") for i, what in _PLACES.items() if not card.is_blank(i)}


def is_general(card: Card, known: Mapping[int, Sequence[Card]]) -> bool:
    """Whether a PSHELL has neither one MAT1, as in `ShellSection`, nor one MAT8, as in a laminate of one ply."""
    named = materials_of(card)
    if 1 not in named or named.get(3) == -1:
        return False  # `shell_section` raises the error
    first = {card_names.name for card_names in known.get(named[1], [])}
    if 10 in named or len(set(named.values())) > 1:
        return True
    if "MAT8" in first:
        uniform = card.real(4, "12 I/T³", 1.0) == 1 and np.isclose(card.real(6, "TS/T", 5 / 6), 5 / 6, rtol=1e-3)
        return not ({3, 5} <= set(named) and uniform)
    return "MAT2" in first


def general_shell(card: Card, known: Mapping[int, Sequence[Card]], notes: list[str]) -> GeneralShell:
    """M = G₁, C = −G₄, D = (12 I/T³) G₂ and S = (T_s/T) G₃ of `GeneralShell`, G of the materials MID1, MID4, MID2, MID3.

    The curvature χ of Nastran is −κ, strain ε − zχ, so that G₄ = ∫ −z G dz/T² of plies. Without MID2 the shell has no bending
    stiffness, without MID3 it is rigid in shear. The density is that of MID1. Raises DeckError for a missing or unsupported
    material, MID3 without MID2, MID4 without both, and a stiffness that is not positive definite."""
    _, plain = shell_section(card)
    named = materials_of(card)
    material_cards = {i: _card(card, what, named[i], known) for i, what in _PLACES.items() if i in named}
    if (5 in material_cards and 3 not in material_cards) or (
        10 in material_cards and not {3, 5} <= set(material_cards)
    ):
        raise card.error("MID3 requires MID2" if 3 not in material_cards else "MID4 requires MID3", "specify both")
    new_notes: list[str] = []
    membrane, zero = _plane(material_cards[1], new_notes), np.zeros((3, 3))
    bending = plain.bending * _plane(material_cards[3], new_notes) if 3 in material_cards else zero
    coupling = -_plane(material_cards[10], new_notes) if 10 in material_cards else zero
    shear = np.diag([np.inf, np.inf] if 3 in material_cards else [0.0, 0.0])
    if 5 in material_cards:
        shear = plain.shear * _across(material_cards[5], new_notes)
    note_damping(material_cards.values(), new_notes)
    notes += [note for note in dict.fromkeys(new_notes) if note not in notes]
    density = material_cards[1].not_negative(4 if material_cards[1].name == "MAT1" else 7, "the density", 0.0)
    uniform = 10 not in named and named.get(3, named[1]) == named[1]
    shell = GeneralShell(plain.thickness, membrane, coupling, bending, shear, density, uniform, plain.nonstructural)
    if fault := general_fault(shell):
        raise card.error(*fault)
    return shell


def _card(card: Card, what: str, number: int, known: Mapping[int, Sequence[Card]]) -> Card:
    if not (cards := known.get(number, [])):
        raise card.error(
            f"material {number} of {what} is not a MAT1, MAT2 or MAT8 of the deck",
            f"add one of these cards with id {number}",
        )
    if len(cards) > 1:
        raise cards[1].error(
            f"material id {number} is used twice (first at {cards[0].where})", "use a unique id for every material"
        )
    return cards[0]


def _plane(card: Card, notes: list[str]) -> FloatArray:
    """G (3, 3) of σ = G ε in plane stress, xx yy xy."""
    if card.name == "MAT2":
        G = np.zeros((3, 3))
        for k, (i, j) in enumerate(zip(*np.triu_indices(3), strict=True), start=1):
            G[i, j] = G[j, i] = card.real(k, f"G{i + 1}{j + 1}", 0.0)
        return G
    if card.name == "MAT8":
        ply = lamina(card)
        e1, e2, nu12, g12 = ply.e1, ply.e2, ply.nu12, ply.g12
    else:
        same, _ = isotropic_material(card, False, notes)
        e1 = e2 = same.youngs_modulus
        nu12, g12 = same.poisson_ratio, same.youngs_modulus / (2 * (1 + same.poisson_ratio))
    S = np.array([[1 / e1, -nu12 / e1, 0.0], [-nu12 / e1, 1 / e2, 0.0], [0.0, 0.0, 1 / g12]])
    return np.asarray(np.linalg.inv(S))


def _across(card: Card, notes: list[str]) -> FloatArray:
    """Transverse shear G (2, 2), xz yz: G11, G12 and G22 of a MAT2, G1Z and G2Z of a MAT8, G of a MAT1."""
    if card.name == "MAT2":
        a, b, c = (card.real(i, name, 0.0) for i, name in ((1, "G11"), (2, "G12"), (4, "G22")))
        return np.array([[a, b], [b, c]])
    if card.name == "MAT8":
        ply = lamina(card)
        return np.diag([ply.g1z, ply.g2z])
    same, ratio = isotropic_material(card, False, notes)
    return np.asarray(ratio * same.youngs_modulus / (2 * (1 + same.poisson_ratio)) * np.eye(2))
