"""Springs (CELAS, CBUSH), point masses (CONM, CMASS) and supports (SPC) of a Nastran deck."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from typing import TypeVar

import numpy as np

from strainsight.decks.faults import ENFORCED, HELD, Doubt
from strainsight.decks.nastran.cards import Card, Cards, Deck, unique_ids
from strainsight.decks.nastran.case_control import card_sets, expand
from strainsight.decks.nastran.grids import Grids, NodeTable, axes_at, find_system
from strainsight.decks.text import parse_integer
from strainsight.errors import ChoiceError, DeckError
from strainsight.mesh.coordinates import local_axes
from strainsight.mesh.joins import PointMass, Springs, spring_between
from strainsight.mesh.model import FloatArray, IntArray

T = TypeVar("T")
SPRINGS = ("CELAS1", "CELAS2", "CBUSH", "PELAS", "PBUSH")
PARTS = ("K", "B", "GE", "RCV", "M")
"""Quantities on a line of a PBUSH."""
APART = 1e-9
"""Length of a CBUSH relative to the model extent below which its ends coincide."""


def springs(cards: Cards, grids: Grids, notes: list[str]) -> tuple[Springs, ...]:
    """Springs with elongation  s = u_1 − u_2  of two components along the systems CD of their nodes (CELAS), or of
    two points along the axes of the element (CBUSH):

        s_c = e_c·(u_B + θ_B × (x − x_B) − u_A − θ_A × (x − x_A)),     s_c = e_c·(θ_B − θ_A) of c = 4, 5, 6

    with x = (1 − S) x_A + S x_B.

    A blank node or component is the ground. Damping becomes a note. Raises DeckError for missing nodes, properties
    and systems, a spring between a translation and a rotation, and a CBUSH without axes, with OCID, rigid or with mass."""
    elements = cards.of("CELAS1", "CELAS2", "CBUSH")
    unique_ids(elements, "element")
    bushes = _bush_properties(cards, notes)
    scalar = {
        number: (card.real(at + 1, "the stiffness"), card.real(at + 2, "the damping coefficient GE", 0.0))
        for number, card, at in _packed_properties(cards, "PELAS", 4)
    }
    elements_found, damped = [], 0
    for card in elements:
        if card.name == "CBUSH":
            elements_found.append(_bush(card, grids, bushes))
            continue
        if card.name == "CELAS2":
            k, damping = card.real(1, "the stiffness"), card.real(6, "the damping coefficient GE", 0.0)
        else:
            k, damping = _property_of(card, scalar, "PELAS")
        damped += damping != 0
        elements_found.append(_elastic(card, grids, k))
    if damped:
        notes.append(f"damping GE of CELAS cards ({damped} in total) is not imported: define `damping` in the config")
    return tuple(elements_found)


def _packed_properties(cards: Cards, name: str, size: int) -> Iterator[tuple[int, Card, int]]:
    """Id, card and first field of the properties on cards with one property in every `size` of eight fields."""
    known: set[int] = set()
    for card in cards.of(name):
        for at in range(0, 8, size):
            if at and not card.text(at):
                continue
            number = card.integer(at, "the property id")
            if number in known:
                raise card.error(f"property id {number} is used twice", "use a unique id for every property")
            known.add(number)
            yield number, card, at


def _property_of(card: Card, properties: Mapping[int, T], name: str) -> T:
    """Property of an element; its id defaults to that of the element."""
    number = card.integer(1, "the property id", card.integer(0, "the element id"))
    if number not in properties:
        raise card.error(f"property {number} is not a {name} of the deck", f"add a {name} card with id {number}")
    return properties[number]


def _elastic(card: Card, grids: Grids, k: float) -> Springs:
    """A CELAS; its two ends begin at field 2."""
    if k < 0:
        raise card.error(f"the stiffness is {k:g}, negative", "specify a positive stiffness")
    ends = []
    for at, sign in ((2, 1.0), (4, -1.0)):
        if card.is_blank(at) or card.integer(at + 1, "the component", 0) == 0:
            continue
        component = card.component(at + 1)
        row = grids.nodes.row(card.integer(at, "the node id"), card)
        ends.append((row, 3 * (component // 3), sign * grids.axes.get(row, np.eye(3))[:, component % 3]))
    if not ends:
        raise card.error("the spring is not connected to a node", "specify a node and its component")
    if len({first for _, first, _ in ends}) > 1:
        raise card.error("the spring connects a translation with a rotation", "use two translations or two rotations")
    return spring_between(f"{card.name} {card.text(0)}", k, ends)


def _bush_properties(cards: Cards, notes: list[str]) -> dict[int, FloatArray]:
    """PBUSH id → K (6,)."""
    stiffness_by_id: dict[int, FloatArray] = {}
    damped = 0
    for card, number in zip(cards.of("PBUSH"), unique_ids(cards.of("PBUSH"), "property"), strict=True):
        k = np.zeros(6)
        for at in range(0, len(card.tokens), 8):
            part = card.text(at + 1).upper()
            values = [card.text(at + 2 + i) for i in range(6)]
            if part and part not in PARTS:
                raise card.error(f"{part!r} is not a PBUSH flag ({', '.join(PARTS)})", "write K, then six stiffnesses")
            if part == "K":
                if "RIGID" in (value.upper() for value in values):
                    raise card.error(
                        "rigid stiffness (RIGID) is not supported",
                        "use an RBE2 instead of the spring, or specify the stiffness as a number",
                    )
                k = np.array([card.real(at + 2 + i, f"the stiffness K{i + 1}", 0.0) for i in range(6)])
            elif part == "M" and any(values):
                raise card.error("mass (M) is not supported", "use a CONM2 for the mass")
            damped += part in ("B", "GE") and any(values)
        if np.any(k < 0):
            raise card.error(f"the stiffness is {k.min():g}, negative", "specify stiffnesses of at least 0")
        stiffness_by_id[int(number)] = k
    if damped:
        notes.append("damping B and GE of PBUSH is not imported: define `damping` in the config")
    return stiffness_by_id


def _bush(card: Card, grids: Grids, properties: dict[int, FloatArray]) -> Springs:
    """A CBUSH: springs along its axes, without those of zero stiffness."""
    k = _property_of(card, properties, "PBUSH")
    if card.text(9) not in ("", "-1"):  # otherwise S1 to S3 have no effect
        raise card.error(
            "OCID is not supported: it moves the spring away from the line between its nodes",
            "leave OCID blank, and define nodes at the position of the spring",
        )
    if not 0 <= (S := card.real(8, "the place S", 0.5)) <= 1:
        raise card.error(f"S is {card.text(8)}, but must be between 0 and 1", "specify 0 (at GA) to 1 (at GB)")
    A = grids.nodes.row(card.integer(2, "the node GA"), card)
    B = grids.nodes.row(card.integer(3, "the node GB"), card) if not card.is_blank(3) else None
    axes = _axes(card, grids, A, B, k)
    x = grids.position[A] if B is None else (1 - S) * grids.position[A] + S * grids.position[B]
    spring, node, component, value = [], [], [], []
    stiff = np.flatnonzero(k)
    for i, c in enumerate(stiff.tolist()):
        e = axes[:, c % 3]
        for row, sign in ((A, -1.0), *(((B, 1.0),) if B is not None else ())):
            turn = np.cross(x - grids.position[row], e) if c < 3 else e
            reach = np.linalg.norm(x - grids.position[row])
            turn = np.where(np.abs(turn) > APART * reach, turn, 0.0) if c < 3 else turn
            part = np.concatenate([e, turn]) if c < 3 else np.concatenate([np.zeros(3), e])
            nonzero = np.flatnonzero(part)
            spring += [i] * len(nonzero)
            node += [row] * len(nonzero)
            component += nonzero.tolist()
            value += (sign * part[nonzero]).tolist()
    return Springs(
        f"CBUSH {card.text(0)}",
        k[stiff],
        np.array(spring, dtype=np.int64),
        np.array(node, dtype=np.int64),
        np.array(component, dtype=np.int64),
        np.array(value),
    )


def _axes(card: Card, grids: Grids, A: int, B: int | None, k: FloatArray) -> FloatArray:
    """x, y, z of the element, one in a column: those of CID at GA, or x from GA to GB and y towards GO or the vector X."""
    if card.text(7):
        return np.asarray(local_axes(grids.position[A][None], find_system(card, 7, grids.systems))[0][0])
    extent = float(np.ptp(grids.position, axis=0).max())
    along = np.zeros(3) if B is None else grids.position[B] - grids.position[A]
    length = float(np.linalg.norm(along))
    if length <= APART * extent:
        raise card.error(
            "the ends coincide or one end is grounded, so the element axes are undefined",
            "specify CID; 0 is the basic system",
        )
    x = along / length
    if not k[[1, 2, 4, 5]].any():  # with stiffness only along and about x, y and z have no effect
        first = np.eye(3)[int(np.argmin(np.abs(x)))]
    elif (first := grids.direction(card, A)) is None:
        raise card.error("the transverse axes are undefined: CID, GO and X1 to X3 are blank", "specify CID or GO")
    z = np.cross(x, first)
    if not np.linalg.norm(z) > APART * np.linalg.norm(first):
        raise card.error(
            "the orientation GO or X1 to X3 is parallel to the element axis",
            "specify a point off the axis, or a vector not parallel to it",
        )
    z = z / np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z])


MASSES = ("CONM1", "CONM2", "CMASS1", "CMASS2")
INDEFINITE = 1e-6
"""Ratio of the smallest negative to the largest principal moment that is attributed to rounding."""


def point_masses(
    cards: Cards, grids: Grids, scale: float, turning: Collection[int], notes: list[str]
) -> tuple[PointMass, ...]:
    """CONM2 with offset and inertia along the basic axes; masses and inertia times `scale` (PARAM WTMASS).

        J = [I11, −I21, −I31; −I21, I22, −I32; −I31, −I32, I33] about the centre; the card has positive products

    CONM1 as a matrix (6, 6) along the axes of CID, CMASS as a matrix with one entry along the axes of its node. turning: rows of
    the nodes with rotations; at other nodes only the mass is used, with a note. Raises DeckError for a negative mass, an inertia
    or matrix that is not positive semidefinite, a missing node, system or property, and a CMASS between two motions."""
    mass_cards = cards.of(*MASSES)
    properties = {
        number: card.real(at + 1, "the mass", 0.0) for number, card, at in _packed_properties(cards, "PMASS", 2)
    }
    masses = []
    for number, card in zip(unique_ids(mass_cards, "point mass").tolist(), mass_cards, strict=True):
        if card.name != "CONM2":
            masses.append(_mass_from_matrix(card, grids, properties, scale, turning, notes))
            continue
        row = grids.nodes.row(card.integer(1, "the node id"), card)
        mass = card.not_negative(3, "the mass", 0.0)
        at_position = card.text(2) == "-1"
        axes = np.eye(3) if at_position else axes_at(grids.position[row], find_system(card, 2, grids.systems))
        offset = axes @ [card.real(i, "the offset", 0.0) for i in (4, 5, 6)] - at_position * grids.position[row]
        inertia = axes @ _inertia(card) @ axes.T
        if (offset.any() or inertia.any()) and row not in turning:
            notes.append(
                f"CONM2 {number}: node {grids.nodes.ids[row]} has no rotations (not in an RBE2 or RBE3), so "
                "offset and inertia have no effect"
            )
        masses.append(PointMass(number, row, scale * mass, offset, scale * inertia))
    return tuple(masses)


def _inertia(card: Card) -> FloatArray:
    I11, I21, I22, I31, I32, I33 = (card.real(i, "the inertia", 0.0) for i in range(8, 14))
    J = np.array([[I11, -I21, -I31], [-I21, I22, -I32], [-I31, -I32, I33]])
    principal = np.linalg.eigvalsh(J)
    if principal[0] < -INDEFINITE * max(principal[-1], 0.0) or principal[-1] < 0:
        raise card.error(
            f"a principal moment of inertia is negative: {principal[0]:.4g}, {principal[1]:.4g}, {principal[2]:.4g}",
            "correct the inertia so that no moment is negative; specify I21, I31 and I32 without a minus sign",
        )
    return J


def _mass_from_matrix(
    card: Card, grids: Grids, properties: dict[int, float], scale: float, turning: Collection[int], notes: list[str]
) -> PointMass:
    """Point mass of a CONM1 or CMASS."""
    row, M = _conm1(card, grids) if card.name == "CONM1" else _cmass(card, grids, properties)
    size = np.sqrt(np.maximum(M.diagonal(), 0.0))
    size[size == 0] = 1.0
    least = float(np.linalg.eigvalsh(M / np.outer(size, size))[0])
    if M.diagonal().min() < 0 or least < -INDEFINITE:
        raise card.error(
            "the mass matrix is not positive semidefinite",
            "correct negative diagonal entries, or reduce the off-diagonal entries",
        )
    if M[3:].any() and row not in turning:
        notes.append(
            f"{card.name} {card.text(0)}: node {grids.nodes.ids[row]} has no rotations (not in an RBE2 or "
            "RBE3), so the rotational entries have no effect"
        )
    mean = float(np.trace(M[:3, :3])) / 3
    return PointMass(card.integer(0, "the element id"), row, scale * mean, matrix=scale * M)


def _conm1(card: Card, grids: Grids) -> tuple[int, FloatArray]:
    row = grids.nodes.row(card.integer(1, "the node id"), card)
    axes = np.kron(np.eye(2), axes_at(grids.position[row], find_system(card, 2, grids.systems)))
    M = np.zeros((6, 6))
    M[np.tril_indices(6)] = [card.real(3 + i, "an entry of the mass matrix", 0.0) for i in range(21)]
    M = M + np.tril(M, -1).T
    return row, axes @ M @ axes.T


def _cmass(card: Card, grids: Grids, properties: dict[int, float]) -> tuple[int, FloatArray]:
    mass = card.real(1, "the mass") if card.name == "CMASS2" else _property_of(card, properties, "PMASS")
    ends = [i for i in (2, 4) if not card.is_blank(i) and not card.is_blank(i + 1)]
    if len(ends) != 1:
        raise card.error(
            f"the mass acts on {len(ends)} components, but only a mass on exactly one component is supported",
            f"define the mass as CONM2, or leave these cards out (mesh.ignore: [{card.name}])",
        )
    component = card.component(ends[0] + 1)
    row = grids.nodes.row(card.integer(ends[0], "the node id"), card)
    along = np.zeros(6)
    start = 3 * (component // 3)
    along[start : start + 3] = grids.axes.get(row, np.eye(3))[:, component % 3]
    return row, mass * np.outer(along, along)


def components(text: str, card: Card) -> tuple[int, ...]:
    """Digits 1-6 as components 0-5."""
    if not text or any(digit not in "123456" for digit in text) or len(set(text)) < len(text):
        raise card.error(
            f"components {text!r} must contain only the digits 1 to 6, each at most once",
            "write the components as, for example, 123",
        )
    return tuple(sorted(int(digit) - 1 for digit in text))


def fixed_components(
    deck: Deck,
    nodes: NodeTable,
    permanent: list[tuple[Card, int, str]],
    ignored: Counter[str],
    notes: list[str],
    chosen: int | None = None,
    free: bool = False,
) -> IntArray:
    """(f, 2) unique sorted pairs (row, component) that SPC, SPC1 and the GRID cards fix. Prescribed displacements
    are fixed at zero, or left free, and counted.

    free: leave prescribed displacements free; chosen: the support set. Otherwise the case control selects it; without a
    selection the only set is used. `ignored` contains cards to leave out; notes: set that is used without a selection. Raises
    ChoiceError for several selections, and for several sets without one, DeckError for missing sets and nodes."""
    pairs: list[tuple[int, int]] = []
    for card, row, text in permanent:
        pairs += [(row, c) for c in components(text, card)]
    selected = _selected_sets(deck, chosen, notes, left_out=bool(ignored["SPC"] or ignored["SPC1"]))
    for card in (*deck.cards.of("SPC"), *deck.cards.of("SPC1")):
        if card.integer(0, "the support set id") not in selected:
            ignored[f"{card.name} of a support set that is not selected"] += 1
            continue
        for row, wanted in _supports(card, nodes, ignored, free):
            pairs += [(row, c) for c in wanted]
    return np.unique(np.array(pairs, dtype=np.int64).reshape(-1, 2), axis=0)


def _supports(card: Card, nodes: NodeTable, ignored: Counter[str], free: bool) -> list[tuple[int, tuple[int, ...]]]:
    if card.name == "SPC1":
        ids, _ = expand(card.tokens[2:], nodes.sorted, card.where)
        if not ids.size:
            raise card.error("the card contains no node of the deck", "correct the ids, or remove the card")
        rows = nodes.rows_of_cards(ids[None, :], [card])[0]
        wanted = components(card.text(1), card)
        return [(int(row), wanted) for row in rows]
    supports = []
    for i in (1, 4):
        if not card.text(i):
            continue
        row, wanted = nodes.row(card.integer(i, "the node id"), card), components(card.text(i + 1), card)
        moves = card.real(i + 2, "the enforced displacement", 0.0) != 0
        if moves:
            ignored[ENFORCED if free else HELD] += 1
        if not (moves and free):
            supports.append((row, wanted))
    return supports


def _selected_sets(deck: Deck, wanted: int | None, notes: list[str], *, left_out: bool) -> set[int]:
    """Ids of the SPC and SPC1 sets to use; left_out: some of these cards are ignored, so sets may be missing."""
    sets = card_sets(deck, "SPC", ("SPC", "SPC1"), left_out=left_out)
    if wanted is not None:
        if wanted not in sets.ids:
            raise DeckError(f"support set {wanted} (mesh.spc) is not in the deck", remedy=sets.choices())
        return sets.parts(wanted)
    selected = tuple(sorted({parse_integer(text) or 0 for text in sets.chosen} & sets.ids))
    if len(sets.chosen) > 1 and selected:
        raise ChoiceError(
            f"the subcases select different support sets ({', '.join(sets.chosen)})",
            where=[*sets.chosen.values()][1].where,
            remedy=f"set mesh.spc to the support set of the model, for example mesh.spc: {selected[0]}",
            choices=selected,
            key="spc",
        )
    if sets.chosen:
        return sets.parts(sets.select(", here or with mesh.spc"))
    if len(sets.top) > 1:
        raise ChoiceError(
            f"the deck has {len(sets.top)} support sets ({', '.join(map(str, sorted(sets.top)))}), and the case "
            "control selects none",
            where=sets.card(max(sets.top)).where,
            remedy=f"set mesh.spc to the support set of the model, for example mesh.spc: {min(sets.top)}",
            choices=tuple(sorted(sets.top)),
            key="spc",
        )
    number = next(iter(sets.top), 0)
    if sets.top and deck.case_control:
        notes.append(
            Doubt(
                f"the case control selects no supports, so Nastran uses none; strainsight uses the only support set {number}. "
                f"Set mesh.spc to {number} to confirm this support set, or mesh.ignore to [SPC, SPC1] to leave it out"
            )
        )
    return sets.parts(number)
