"""Sections of beams that a Nastran deck gives as a shape with dimensions: PBARL and PBEAML."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.decks.nastran.cards import Card
from strainsight.decks.nastran.sections import STATIONS, check_station
from strainsight.errors import DeckError
from strainsight.mesh.model import FloatArray
from strainsight.mesh.section_shapes import SHAPES, section_of_shape
from strainsight.mesh.thin import BeamSection

CENTRED = 1e-6
"""Distance over the size of a section, within which its places of stress are symmetric about the centroid."""


def bar_shape(card: Card) -> tuple[int, BeamSection]:
    """MID and section of a PBARL, whose axis is through the centroid."""
    _, count = _shape(card)
    own = _section(card, _dimensions(card, 8, count, None))
    nonstructural = card.real(8 + count, "the mass NSM", 0.0)
    return card.integer(1, "the material id"), _weighed(card, own, nonstructural)


def beam_shape(card: Card) -> tuple[int, BeamSection]:
    """MID and section of a PBEAML at its ends; sections between them have to lie on the line.

    Raises DeckError for stations off the line, and for shapes whose shear centre, which is the axis of a CBEAM, lies beside the
    centroid: those that are not symmetric about a point.
    """
    kind, count = _shape(card)
    dimensions = _dimensions(card, 8, count, None)
    mass = card.real(8 + count, "the mass NSM", 0.0)
    end_a = _weighed(card, _section(card, dimensions), mass)
    at, between, end_b = 9 + count, [], end_a
    while any(card.text(i) for i in range(at, at + 3 + count)):
        if card.text(at).upper() not in ("", *STATIONS):
            raise card.error(f"SO (field {at + 2}) is {card.text(at)}", "write YES or NO")
        x = card.real(at + 1, "the place X/XB", 1.0)
        if not 0 < x <= 1:
            raise card.error(f"X/XB is {x:g}, no station behind end A", "give places above 0, end B at 1")
        blank = not any(card.text(i) for i in range(at + 2, at + 3 + count))
        own = _section(card, _dimensions(card, at + 2, count, dimensions))
        own = _weighed(card, own, card.real(at + 2 + count, "the mass NSM", mass))
        if x == 1:
            end_b = own
        elif not blank:
            between.append((x, own))
        at += 3 + count
    for x, own in between:
        check_station(card, x, own, end_a, end_b)
    for end in (end_a, end_b):
        if not _symmetric(end.points):
            raise card.error(
                f"the shear centre of this {kind} is not its centroid: such a section of a CBEAM is not supported",
                "make it a CBAR with a PBARL, whose axis is through the centroid, with WA and WB where it lies elsewhere",
            )
    same = end_b is end_a or _equal(end_a, end_b)
    return card.integer(1, "the material id"), end_a if same else replace(end_a, at_b=end_b)


def _shape(card: Card) -> tuple[str, int]:
    """TYPE, and how many dimensions it has."""
    if card.text(2).upper() not in ("", "MSCBML0"):
        raise card.error(f"GROUP is {card.text(2)}, not MSCBML0", "give the section by its area and moments")
    kind = card.text(3).upper()
    return kind, SHAPES[kind][0] if kind in SHAPES else 0


def _dimensions(card: Card, at: int, count: int, default: list[float] | None) -> list[float]:
    return [card.real(at + i, f"DIM{i + 1}", default[i] if default else None) for i in range(count)]


def _section(card: Card, dimensions: list[float]) -> BeamSection:
    try:
        return section_of_shape(card.text(3).upper(), dimensions)
    except DeckError as fault:
        raise card.error(fault.what, fault.remedy or "correct the card and run again") from None


def _weighed(card: Card, own: BeamSection, mass: float) -> BeamSection:
    if mass < 0:
        raise card.error(f"the mass NSM is {mass:g}, negative", "give a positive mass")
    return replace(own, nonstructural=mass)


def _symmetric(points: FloatArray) -> bool:
    """Is there, for each of the points (p, 2), one on the other side of the centroid?"""
    apart = np.linalg.norm(points[:, None] + points[None], axis=2).min(axis=1)
    return bool(apart.max() <= CENTRED * np.abs(points).max())


def _equal(a: BeamSection, b: BeamSection) -> bool:
    return (a.area, a.torsion, a.nonstructural) == (b.area, b.torsion, b.nonstructural) and np.array_equal(
        a.second, b.second
    )
