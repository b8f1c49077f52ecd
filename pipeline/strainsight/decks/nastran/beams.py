"""Beams and rods of a Nastran deck: elements, sections, and section shapes with dimensions."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from strainsight.decks.faults import find_repeated_node
from strainsight.decks.nastran.cards import Card, Cards, Elements
from strainsight.decks.nastran.grids import Grids
from strainsight.decks.nastran.springs import components
from strainsight.decks.text import parse_real
from strainsight.errors import DeckError
from strainsight.mesh.assigned_sections import beam_axes
from strainsight.mesh.model import FloatArray
from strainsight.mesh.section_shapes import SHAPES, section_of_shape
from strainsight.mesh.thin import BeamBlock, BeamSection

BEAMS, RODS = ("CBAR", "CBEAM"), ("CROD", "CTUBE", "CONROD")
DEFAULTS = {"CBAR": "BAROR", "CBEAM": "BEAMOR"}
APART = 1e-9
"""Length of an element relative to the model extent below which its ends coincide."""


def with_defaults(cards: Cards) -> dict[str, list[Card]]:
    """CBAR and CBEAM by name, with blank PID, X1 to X3 (or G0) and OFFT filled from BAROR and BEAMOR."""
    cards_by_name: dict[str, list[Card]] = {}
    for name, default in DEFAULTS.items():
        default_cards = cards.of(default)
        if len(default_cards) > 1:
            raise default_cards[1].error(
                f"{default} is defined twice (first at {default_cards[0].where})", f"keep only one {default}"
            )
        cards_by_name[name] = (
            [_fill_defaults(card, default_cards[0]) for card in cards.of(name)] if default_cards else cards.of(name)
        )
    return cards_by_name


def _fill_defaults(card: Card, default: Card) -> Card:
    fields = [*card.tokens, *[""] * (8 - len(card.tokens))]
    for group in ((1,), (4, 5, 6), (7,)):
        if not any(fields[i] for i in group):
            for i in group:
                fields[i] = "" if i == 1 and default.text(1) == "0" else default.text(i)
    return card._replace(tokens=fields)


def read_beams(elements: Elements, grids: Grids) -> tuple[BeamBlock, ...]:
    """Beams and rods.

        x from GA + WA to GB + WB,     z = x × v/|x × v|,   y = z × x,     v = X1 to X3 in the system CD of GA, or GA
        to G0

    Raises DeckError for a missing or repeated node, coincident ends, an orientation that is missing or along the
    axis, a completely released end, and offsets in element axes (OFFT)."""
    extent = float(np.ptp(grids.position, axis=0).max())
    blocks = []
    for kind, names in (("beam", BEAMS), ("rod", RODS)):
        cards, ids, region = elements.of(names)
        if not cards:
            continue
        node_ids = np.array(
            [[card.integer((1 if card.name == "CONROD" else 2) + i, "a node id") for i in (0, 1)] for card in cards],
            dtype=np.int64,
        )
        nodes = grids.nodes.rows_of_cards(node_ids, cards)
        if (at := find_repeated_node(nodes)) is not None:
            raise cards[at].error(
                "both ends of the element are at the same node", "specify two nodes, or remove the element"
            )
        n = len(cards)
        offset, released = np.zeros((n, 2, 3)), np.zeros((n, 2, 6), dtype=bool)
        if kind == "beam":
            for i, card in enumerate(cards):
                _check_offt(card)
                for end in (0, 1):
                    local = [card.real(10 + 3 * end + k, "an offset", 0.0) for k in range(3)]  # WA or WB
                    offset[i, end] = grids.axes.get(int(nodes[i, end]), np.eye(3)) @ local
                    released[i, end, _released_components(card, end)] = True
        along = np.diff(grids.position[nodes] + offset, axis=1)[:, 0]
        if (short := ~(np.linalg.norm(along, axis=1) > APART * extent)).any():
            raise cards[int(np.argmax(short))].error(
                "both ends of the element coincide", "move a node, correct the offsets, or remove the element"
            )
        if kind == "beam":
            v = np.array([_orientation(card, int(A), grids) for card, A in zip(cards, nodes[:, 0], strict=True)])
        else:
            v = np.eye(3)[np.argmin(np.abs(along), axis=1)]
        axes, lost = beam_axes(along, v)
        if lost.any():
            raise cards[int(np.argmax(lost))].error(
                "the orientation G0 or X1 to X3 is parallel to the beam axis",
                "specify a point off the axis, or a vector not parallel to it",
            )
        blocks.append(BeamBlock(kind, ids, nodes, region, axes, offset, released))
    return tuple(blocks)


def _check_offt(card: Card) -> None:
    """Raise DeckError unless OFFT is GGG, or BGG (orientation in basic axes); 1 and 2 are flags of old decks."""
    text = card.text(7).upper()
    offset = any(card.text(i) and card.real(i, "an offset") != 0 for i in range(10, 16))
    if text in ("", "1", "2", "GGG", "BGG") or (text in ("GGO", "GOG", "GOO", "BGO", "BOG", "BOO") and not offset):
        return
    if parse_real(text) is not None:
        raise card.error(f"BIT is {text}: pretwist is not supported", "leave the BIT field blank")
    raise card.error(f"OFFT is {text}: only offsets along nodal axes are supported", "set OFFT to GGG or BGG")


def _released_components(card: Card, end: int) -> list[int]:
    """Pin flags PA or PB as components."""
    text = card.text(8 + end)
    if text in ("", "0"):
        return []
    pins = components(text, card)
    if len(pins) > 5:
        raise card.error(
            f"pin flags P{'AB'[end]}: all components of end {'AB'[end]} are released",
            f"remove at least one component from P{'AB'[end]}",
        )
    return list(pins)


def _orientation(card: Card, A: int, grids: Grids) -> FloatArray:
    """Orientation vector v (3,) along the basic axes."""
    if (v := grids.direction(card, A, basic=card.text(7).upper().startswith("B"))) is None:
        raise card.error(f"the orientation is missing: G0, X1 to X3, or a {DEFAULTS[card.name]}", "specify G0 or X1-X3")
    return v


LINEAR = 1e-3
"""Deviation of a PBEAM station from the linear variation between its ends, relative to the larger end, that is
attributed to rounding."""
STATIONS = ("YES", "YESA", "NO")


def bar_section(card: Card) -> tuple[int, BeamSection]:
    """MID and section of a PBAR; rigid in shear if K1 and K2 are blank. Raises DeckError for invalid sections."""
    A, I1, I2, J, nonstructural = (card.real(i, what, 0.0) for i, what in _WORDS)
    I12 = card.real(18, "I12", 0.0)
    shear = (card.real(16, "K1", 0.0), card.real(17, "K2", 0.0))
    section = BeamSection(A, _second(I1, I2, I12), J, shear, _points(card, 8), nonstructural)
    return card.integer(1, "the material id"), _check_section(card, section)


_WORDS = ((2, "the area A"), (3, "I1"), (4, "I2"), (5, "J"), (6, "the nonstructural mass NSM"))


_RODS = {"PROD": (1, 2, 3, 5), "CONROD": (3, 4, 5, 7)}
"""Card → fields of MID, A, J and NSM."""


def rod_section(card: Card) -> tuple[int, BeamSection]:
    """MID and section of a PROD or CONROD."""
    mid, *fields = _RODS[card.name]
    area, torsion = card.real(fields[0], "the area A"), card.real(fields[1], "J", 0.0)
    section = BeamSection(area, torsion=torsion, nonstructural=card.real(fields[2], "the nonstructural mass NSM", 0.0))
    return card.integer(mid, "the material id"), _check_section(card, section)


def tube_section(card: Card) -> tuple[int, BeamSection]:
    """MID and section of a PTUBE of outer diameter d and wall t, a solid circle without t:

    A = π (d² − (d − 2t)²)/4,     J = π (d⁴ − (d − 2t)⁴)/32
    """
    d, t = card.real(2, "the outer diameter OD"), card.real(3, "the wall T", 0.0)
    if card.text(5) and card.real(5, "the outer diameter OD2") != d:
        raise card.error(
            "OD2 differs from OD: conical tubes are not supported",
            "divide the tube into pieces with separate PTUBE cards",
        )
    if not 0 <= 2 * t <= d:
        raise card.error(
            f"the wall thickness is {t:g}, but the outer diameter is {d:g}",
            "specify a wall thickness of at most half the diameter",
        )
    inner = d - 2 * t if t else 0.0
    section = BeamSection(
        np.pi * (d**2 - inner**2) / 4,
        torsion=np.pi * (d**4 - inner**4) / 32,
        nonstructural=card.real(4, "the nonstructural mass NSM", 0.0),
    )
    return card.integer(1, "the material id"), _check_section(card, section)


def beam_section(card: Card, notes: list[str]) -> tuple[int, BeamSection]:
    """MID and section of a PBEAM at its ends; intermediate stations must vary linearly. Blank K1 and K2 are 1. N1 and N2, M1 and
    M2 of end B default to those of end A. Raises DeckError for non-linear stations and shear relief (S1, S2)."""
    at, points = 8, np.zeros((0, 2))
    if card.text(8).upper() not in STATIONS:  # the line of stress recovery points is optional
        at, points = 16, _points(card, 8)
    end_a = replace(_station(card, 2, None), points=points)
    stations: list[tuple[float, int, FloatArray]] = []
    while (recovered := card.text(at).upper()) in STATIONS:
        recovery_points = _points(card, at + 8) if recovered == "YES" else points
        stations.append((card.real(at + 1, "the station X/XB"), at + 2, recovery_points))
        at += 16 if recovered == "YES" else 8
    ends = [(field, recovery_points) for x, field, recovery_points in stations if x == 1]
    end_b = replace(_station(card, ends[-1][0], end_a), points=ends[-1][1]) if ends else end_a
    for x, field, _ in stations:
        if not 0 < x <= 1:
            raise card.error(f"X/XB is {x:g}, outside 0 < X/XB ≤ 1", "set X/XB to 1 at end B, below 1 between the ends")
        if x < 1:
            check_station(card, x, _station(card, field, _interpolate(x, end_a, end_b)), end_a, end_b)
    words: tuple[str, ...] = ("K1", "K2", "S1", "S2", "NSI(A)", "NSI(B)", "CW(A)", "CW(B)")
    words += ("M1(A)", "M2(A)", "M1(B)", "M2(B)", "N1(A)", "N2(A)", "N1(B)", "N2(B)")
    more: dict[str, float] = {}
    for i, word in enumerate(words):  # values of end B default to those of end A
        more[word] = card.real(at + i, word, 1.0 if word in ("K1", "K2") else more.get(word.replace("(B)", "(A)"), 0.0))
    nonzero = [word for word in words if more[word] != 0]
    if relief := [word for word in nonzero if word in ("S1", "S2")]:
        raise card.error(
            f"{', '.join(f'{word} is {more[word]:g}' for word in relief)}: shear relief is not supported",
            "leave S1 and S2 blank",
        )
    if (
        any(word[0] == "N" and word[1] != "S" for word in nonzero)
        and not min(*_values(end_a)[1:3], *_values(end_b)[1:3]) > 0
    ):
        raise card.error(
            "the neutral axis has an offset (N1, N2), but I1 or I2 is not positive", "specify positive I1 and I2"
        )
    end_a, end_b = (
        replace(
            station, neutral=(more[f"N1({end})"], more[f"N2({end})"]), beside=(more[f"M1({end})"], more[f"M2({end})"])
        )
        for station, end in ((end_a, "A"), (end_b, "B"))
    )
    if ignored_words := [
        word for i, word in enumerate(words) if more[word] and word[:2] in ("NS", "CW") and card.text(at + i)
    ]:
        notes.append(
            f"PBEAM {card.text(0)}: nonstructural inertia NSI and warping CW have no effect ({', '.join(ignored_words)})"
        )
    shear = (more["K1"], more["K2"])
    section = replace(end_a, shear=shear, at_b=None if _equal_sections(end_a, end_b) else replace(end_b, shear=shear))
    return card.integer(1, "the material id"), _check_section(card, section)


def _station(card: Card, at: int, default: BeamSection | None) -> BeamSection:
    """A, I1, I2, I12, J, NSM from a field on; blank entries default to `default`, at end A to zero except for A, I1 and I2."""
    blank = [None, None, None, 0.0, 0.0, 0.0] if default is None else _values(default)
    names = ("the area A", "I1", "I2", "I12", "J", "the nonstructural mass NSM")
    A, I1, I2, I12, J, nonstructural = (card.real(at + i, names[i], blank[i]) for i in range(6))
    return BeamSection(A, _second(I1, I2, I12), J, nonstructural=nonstructural)


def _values(section: BeamSection) -> list[float]:
    """A, I1, I2, I12, J, NSM."""
    I = section.second
    return [section.area, float(I[0, 0]), float(I[1, 1]), float(I[0, 1]), section.torsion, section.nonstructural]


def _equal_sections(a: BeamSection, b: BeamSection) -> bool:
    """Whether the sections at both ends are equal."""
    return all(np.array_equal(getattr(a, entry.name), getattr(b, entry.name)) for entry in fields(a))


def _interpolate(x: float, a: BeamSection, b: BeamSection) -> BeamSection:
    A, I1, I2, I12, J, nonstructural = ((1 - x) * p + x * q for p, q in zip(_values(a), _values(b), strict=True))
    return BeamSection(A, _second(I1, I2, I12), J, nonstructural=nonstructural)


def check_station(card: Card, x: float, section: BeamSection, a: BeamSection, b: BeamSection) -> None:
    """Raise DeckError unless a section at x of the length from end A varies linearly between the ends."""
    line = _values(_interpolate(x, a, b))
    for name, value, on_line, p, q in zip(
        ("A", "I1", "I2", "I12", "J", "NSM"), _values(section), line, _values(a), _values(b), strict=True
    ):
        if abs(value - on_line) > LINEAR * max(abs(p), abs(q)):
            raise card.error(
                f"{name} is {value:g} at X/XB = {x:g}, but linear variation between the ends requires "
                f"{on_line:g}: a nonlinear variation is not supported",
                "divide the beam at this station, with one PBEAM for each part",
            )


def _second(I1: float, I2: float, I12: float) -> FloatArray:
    return np.array([[I1, I12], [I12, I2]])


def _points(card: Card, at: int) -> FloatArray:
    """Stress recovery points C, D, E, F (p, 2) that are not blank."""
    filled = [i for i in range(at, at + 8, 2) if card.text(i) or card.text(i + 1)]
    return np.array(
        [[card.real(i + j, "a coordinate of a stress recovery point", 0.0) for j in (0, 1)] for i in filled]
    ).reshape(-1, 2)


def _check_section(card: Card, section: BeamSection) -> BeamSection:
    """Raise DeckError for an invalid section."""
    for end in (section, *((section.at_b,) if section.at_b else ())):
        A, I1, I2, I12, J, nonstructural = _values(end)
        if not A > 0:
            raise card.error(f"the area is {A:g}, not positive", "specify a positive area")
        if min(I1, I2, J, nonstructural) < 0 or I12**2 > I1 * I2 * (1 + LINEAR):
            raise card.error(
                f"the section properties are inconsistent: I1 = {I1:g}, I2 = {I2:g}, I12 = {I12:g}, J = {J:g}, "
                f"NSM = {nonstructural:g}",
                "correct the values: only I12 may be negative, and I12² must not exceed I1 I2",
            )
        if min(section.shear) < 0:
            raise card.error(
                f"a shear factor is negative: K1 is {section.shear[0]:g}, K2 is {section.shear[1]:g}",
                "specify values of at least 0",
            )
    return section


CENTRED = 1e-6
"""Tolerance, relative to the section size, for stress recovery points that are symmetric about the centroid."""


def bar_shape(card: Card) -> tuple[int, BeamSection]:
    """MID and section of a PBARL, whose axis is the line of centroids."""
    _, count = _shape(card)
    section = _section(card, _dimensions(card, 8, count, None))
    section = replace(section, nonstructural=card.not_negative(8 + count, "the nonstructural mass NSM", 0.0))
    return card.integer(1, "the material id"), section


def beam_shape(card: Card) -> tuple[int, BeamSection]:
    """MID and section of a PBEAML at its ends; intermediate sections must vary linearly. Raises DeckError for non-linear
    stations, and for shapes whose shear centre (the axis of a CBEAM) is not the centroid: those without point symmetry."""
    kind, count = _shape(card)
    dimensions = _dimensions(card, 8, count, None)
    mass = card.not_negative(8 + count, "the nonstructural mass NSM", 0.0)
    end_a = replace(_section(card, dimensions), nonstructural=mass)
    at, between, end_b = 9 + count, [], end_a
    while any(card.text(i) for i in range(at, at + 3 + count)):
        if card.text(at).upper() not in ("", *STATIONS):
            raise card.error(
                f"SO (field {at + 2}) is {card.text(at)}, but must be YES, YESA or NO", "set SO to YES or NO"
            )
        x = card.real(at + 1, "the station X/XB", 1.0)
        if not 0 < x <= 1:
            raise card.error(f"X/XB is {x:g}, outside 0 < X/XB ≤ 1", "set X/XB to 1 at end B, below 1 between the ends")
        blank = not any(card.text(i) for i in range(at + 2, at + 3 + count))
        station = _section(card, _dimensions(card, at + 2, count, dimensions))
        station = replace(station, nonstructural=card.not_negative(at + 2 + count, "the nonstructural mass NSM", mass))
        if x == 1:
            end_b = station
        elif not blank:
            between.append((x, station))
        at += 3 + count
    for x, station in between:
        check_station(card, x, station, end_a, end_b)
    for end in (end_a, end_b):
        if not _symmetric(end.points):
            raise card.error(
                f"the axis of a CBEAM is its shear centre, which differs from the centroid for {kind}: not supported",
                "use a CBAR with a PBARL; the axis of a CBAR is its centroid, and WA and WB define the offset",
            )
    return card.integer(1, "the material id"), end_a if _equal_sections(end_a, end_b) else replace(end_a, at_b=end_b)


def _shape(card: Card) -> tuple[str, int]:
    """TYPE, and its number of dimensions."""
    if card.text(2).upper() not in ("", "MSCBML0"):
        raise card.error(f"GROUP is {card.text(2)}, but must be MSCBML0", "use a PBAR or PBEAM instead")
    kind = card.text(3).upper()
    return kind, SHAPES[kind][0] if kind in SHAPES else 0


def _dimensions(card: Card, at: int, count: int, default: list[float] | None) -> list[float]:
    return [card.real(at + i, f"DIM{i + 1}", default[i] if default else None) for i in range(count)]


def _section(card: Card, dimensions: list[float]) -> BeamSection:
    try:
        return section_of_shape(card.text(3).upper(), dimensions)
    except DeckError as fault:
        raise card.error(fault.what, str(fault.remedy)) from None


def _symmetric(points: FloatArray) -> bool:
    """Whether each of the points (p, 2) has a counterpart on the other side of the centroid."""
    distance = np.linalg.norm(points[:, None] + points[None], axis=2).min(axis=1)
    return bool(distance.max() <= CENTRED * np.abs(points).max())
