"""Sections of beams and rods of a Nastran deck: PBAR, PBEAM, PROD, PTUBE, and those that a CONROD states itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.decks.nastran.cards import Card
from strainsight.mesh.model import FloatArray
from strainsight.mesh.thin import BeamSection

LINEAR = 1e-3
"""Deviation of a station of a PBEAM from the line between its ends, over the larger end, that the digits of a card explain."""
STATIONS = ("YES", "YESA", "NO")


def bar_section(card: Card) -> tuple[int, BeamSection]:
    """MID and section of a PBAR; blank K1 and K2: it does not shear. Raises DeckError for sections that cannot be."""
    A, I1, I2, J, nonstructural = (card.real(i, what, 0.0) for i, what in _WORDS)
    I12 = card.real(18, "I12", 0.0)
    shear = (card.real(16, "K1", 0.0), card.real(17, "K2", 0.0))
    own = BeamSection(A, _second(I1, I2, I12), J, shear, _points(card, 8), nonstructural)
    return card.integer(1, "the material id"), _checked(card, own)


_WORDS = ((2, "the area A"), (3, "I1"), (4, "I2"), (5, "J"), (6, "the mass NSM"))


def rod_section(card: Card) -> tuple[int, BeamSection]:
    """MID and section of a PROD."""
    A, J, nonstructural = card.real(2, "the area A"), card.real(3, "J", 0.0), card.real(5, "the mass NSM", 0.0)
    own = BeamSection(A, torsion=J, nonstructural=nonstructural)
    return card.integer(1, "the material id"), _checked(card, own)


def own_section(card: Card) -> tuple[int, BeamSection]:
    """MID and section of a CONROD."""
    A, J, nonstructural = card.real(4, "the area A"), card.real(5, "J", 0.0), card.real(7, "the mass NSM", 0.0)
    own = BeamSection(A, torsion=J, nonstructural=nonstructural)
    return card.integer(3, "the material id"), _checked(card, own)


def tube_section(card: Card) -> tuple[int, BeamSection]:
    """MID and section of a PTUBE of outer diameter d and wall t, a full circle without t:

    A = π (d² − (d − 2t)²)/4,     J = π (d⁴ − (d − 2t)⁴)/32
    """
    d, t = card.real(2, "the outer diameter OD"), card.real(3, "the wall T", 0.0)
    if card.text(5) and card.real(5, "the outer diameter OD2") != d:
        raise card.error("OD2 makes it conical, which is not supported", "give pieces with PTUBEs of their own")
    if not 0 <= 2 * t <= d:
        raise card.error(f"the wall is {t:g}, of a tube {d:g} thick", "give a wall of at most half the diameter")
    inner = d - 2 * t if t else 0.0
    own = BeamSection(
        np.pi * (d**2 - inner**2) / 4,
        torsion=np.pi * (d**4 - inner**4) / 32,
        nonstructural=card.real(4, "the mass NSM", 0.0),
    )
    return card.integer(1, "the material id"), _checked(card, own)


def beam_section(card: Card, notes: list[str]) -> tuple[int, BeamSection]:
    """MID and section of a PBEAM at its ends; stations between them have to lie on the line. K1 and K2 are 1 where blank.

    N1 and N2, M1 and M2 of end B are those of end A where blank. Raises DeckError for stations off the line, and for relief of
    shear by taper (S1, S2).
    """
    at, points = 8, np.zeros((0, 2))
    if card.text(8).upper() not in STATIONS:  # the line of places of stress may be left out
        at, points = 16, _points(card, 8)
    end_a = replace(_station(card, 2, None), points=points)
    stations: list[tuple[float, int, FloatArray]] = []
    while (recovered := card.text(at).upper()) in STATIONS:
        own = _points(card, at + 8) if recovered == "YES" else points
        stations.append((card.real(at + 1, "the place X/XB"), at + 2, own))
        at += 16 if recovered == "YES" else 8
    ends = [(field, own) for x, field, own in stations if x == 1]
    end_b = replace(_station(card, ends[-1][0], end_a), points=ends[-1][1]) if ends else end_a
    for x, field, _ in stations:
        if not 0 < x <= 1:
            raise card.error(f"X/XB is {x:g}, no station behind end A", "give places above 0, end B at 1")
        if x < 1:
            check_station(card, x, _station(card, field, _between(x, end_a, end_b)), end_a, end_b)
    words: tuple[str, ...] = ("K1", "K2", "S1", "S2", "NSI(A)", "NSI(B)", "CW(A)", "CW(B)")
    words += ("M1(A)", "M2(A)", "M1(B)", "M2(B)", "N1(A)", "N2(A)", "N1(B)", "N2(B)")
    more: dict[str, float] = {}
    for i, word in enumerate(words):  # of end B the values of end A where it is blank
        more[word] = card.real(at + i, word, 1.0 if word in ("K1", "K2") else more.get(word.replace("(B)", "(A)"), 0.0))
    given = [word for word in words if more[word] != 0]
    if relief := [word for word in given if word in ("S1", "S2")]:
        raise card.error(
            f"{', '.join(f'{word} is {more[word]:g}' for word in relief)}: relief of shear by taper is not supported",
            "leave them blank",
        )
    if (
        any(word[0] == "N" and word[1] != "S" for word in given)
        and not min(*_values(end_a)[1:3], *_values(end_b)[1:3]) > 0
    ):
        raise card.error(
            "a neutral axis beside the shear centre (N1, N2) of a beam that does not bend", "give I1 and I2"
        )
    end_a, end_b = (
        replace(own, neutral=(more[f"N1({end})"], more[f"N2({end})"]), beside=(more[f"M1({end})"], more[f"M2({end})"]))
        for own, end in ((end_a, "A"), (end_b, "B"))
    )
    if idle := [word for i, word in enumerate(words) if more[word] and word[:2] in ("NS", "CW") and card.text(at + i)]:
        notes.append(f"PBEAM {card.text(0)}: {', '.join(idle)} (inertia about the axis, warping) have no effect")
    shear = (more["K1"], more["K2"])
    same = all(np.array_equal(a, b) for a, b in zip(_values(end_a), _values(end_b), strict=True))
    same = same and np.array_equal(end_a.points, end_b.points)
    same = same and (end_a.neutral, end_a.beside) == (end_b.neutral, end_b.beside)
    made = replace(end_a, shear=shear, at_b=None if same else replace(end_b, shear=shear))
    return card.integer(1, "the material id"), _checked(card, made)


def _station(card: Card, at: int, default: BeamSection | None) -> BeamSection:
    """A, I1, I2, I12, J, NSM from a field on; blank ones are those of `default`, and at end A zero but for A, I1 and I2."""
    blank = [None, None, None, 0.0, 0.0, 0.0] if default is None else _values(default)
    names = ("the area A", "I1", "I2", "I12", "J", "the mass NSM")
    A, I1, I2, I12, J, nonstructural = (card.real(at + i, names[i], blank[i]) for i in range(6))
    return BeamSection(A, _second(I1, I2, I12), J, nonstructural=nonstructural)


def _values(own: BeamSection) -> list[float]:
    """A, I1, I2, I12, J, NSM."""
    I = own.second
    return [own.area, float(I[0, 0]), float(I[1, 1]), float(I[0, 1]), own.torsion, own.nonstructural]


def _between(x: float, a: BeamSection, b: BeamSection) -> BeamSection:
    A, I1, I2, I12, J, nonstructural = ((1 - x) * p + x * q for p, q in zip(_values(a), _values(b), strict=True))
    return BeamSection(A, _second(I1, I2, I12), J, nonstructural=nonstructural)


def check_station(card: Card, x: float, own: BeamSection, a: BeamSection, b: BeamSection) -> None:
    """Raise DeckError unless a section at x of the length from end A is that on the line between the ends."""
    line = _values(_between(x, a, b))
    for name, value, on_line, p, q in zip(
        ("A", "I1", "I2", "I12", "J", "NSM"), _values(own), line, _values(a), _values(b), strict=True
    ):
        if abs(value - on_line) > LINEAR * max(abs(p), abs(q)):
            raise card.error(
                f"{name} is {value:g} at X/XB = {x:g}, on the line between its ends {on_line:g}: other stations are not "
                "supported",
                "divide the beam there, with a PBEAM for each part",
            )


def _second(I1: float, I2: float, I12: float) -> FloatArray:
    return np.array([[I1, I12], [I12, I2]])


def _points(card: Card, at: int) -> FloatArray:
    """Places C, D, E, F (p, 2) of stress, those that are given."""
    given = [i for i in range(at, at + 8, 2) if card.text(i) or card.text(i + 1)]
    return np.array([[card.real(i + j, "a place of stress", 0.0) for j in (0, 1)] for i in given]).reshape(-1, 2)


def _checked(card: Card, own: BeamSection) -> BeamSection:
    """Raise DeckError for what no section can be."""
    for end in (own, *((own.at_b,) if own.at_b else ())):
        A, I1, I2, I12, J, nonstructural = _values(end)
        if not A > 0:
            raise card.error(f"the area is {A:g}, not positive", "give a positive area")
        if min(I1, I2, J, nonstructural) < 0 or I12**2 > I1 * I2 * (1 + LINEAR):
            raise card.error(
                f"I1 is {I1:g}, I2 {I2:g}, I12 {I12:g}, J {J:g}, NSM {nonstructural:g}",
                "none but I12 may be negative, and I12² at most I1 I2",
            )
        if min(own.shear) < 0:
            raise card.error(f"K1 is {own.shear[0]:g} and K2 {own.shear[1]:g}", "neither may be negative")
    return own
