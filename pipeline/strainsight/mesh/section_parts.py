"""A section of a beam as parts whose areas and moments add up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.mesh.thin import BeamSection

ON = 1e-6
"""Of the moment of a rectangle, I = A h²/12 = A (h/2)²/3: a place on its edge is on it."""


@dataclass(frozen=True)
class Part:
    """Area at (y, z), and its own moments about there."""

    area: float
    y: float
    z: float
    Iy: float
    Iz: float


@dataclass(frozen=True)
class Shape:
    """Parts, J, areas that shear along y and z, and points C, D, E, F as (y, z); all from one origin."""

    parts: tuple[Part, ...]
    torsion: float
    sheared: tuple[float, float]
    points: tuple[tuple[float, float], ...]


class NoFit(Exception):
    """A part has no thickness or length left."""


def section_from(shape: Shape) -> BeamSection:
    """A = Σ A_i, the moments Σ I_i + A_i r_i r_iᵀ about the centroid, the points from there, and the sides that it has: of
    several parts those whose middle lies on one of them, rectangles √(12 I/A) high and wide."""
    area = sum(part.area for part in shape.parts)
    center = (
        np.array([sum(part.area * part.y for part in shape.parts), sum(part.area * part.z for part in shape.parts)])
        / area
    )
    second = np.zeros((2, 2))
    for part in shape.parts:
        r = np.array([part.y, part.z]) - center
        second += np.diag([part.Iy, part.Iz]) + part.area * np.outer(r, r)
    shear = (shape.sheared[0] / area, shape.sheared[1] / area)
    return BeamSection(area, second, shape.torsion, shear, np.array(shape.points) - center, sides=_sides(shape))


def _sides(shape: Shape) -> tuple[bool, bool, bool, bool]:
    if len(shape.parts) == 1:
        return True, True, True, True
    low, high = np.min(shape.points, axis=0), np.max(shape.points, axis=0)
    y, z = 0.5 * (low + high)

    def on(place: tuple[float, float]) -> bool:
        size = [(abs(p.y - place[0]) ** 2 * p.area / 3, abs(p.z - place[1]) ** 2 * p.area / 3, p) for p in shape.parts]
        return any(a <= p.Iy * (1 + ON) and b <= p.Iz * (1 + ON) for a, b, p in size)

    return on((high[0], z)), on((y, high[1])), on((low[0], z)), on((y, low[1]))


def block(bottom: float, left: float, height: float, width: float) -> Part:
    """Rectangle with its lower left corner at (bottom, left)."""
    if not (height > 0 and width > 0):
        raise NoFit
    area = height * width
    return Part(area, bottom + height / 2, left + width / 2, area * height**2 / 12, area * width**2 / 12)


def walls(*walls: tuple[float, float]) -> float:
    """J of open walls (length of the middle line, thickness)."""
    return sum(length * thickness**3 for length, thickness in walls) / 3


def solid(width: float, height: float) -> float:
    """J of a rectangle (Roark, table 10.7)."""
    a, b = max(width, height), min(width, height)
    return a * b**3 * (1 / 3 - 0.21 * b / a * (1 - b**4 / (12 * a**4)))


def corners(
    top: float, bottom: float, above: tuple[float, float], below: tuple[float, float]
) -> tuple[tuple[float, float], ...]:
    """C top right, D bottom right, E bottom left, F top left; above and below are z from left to right."""
    return (top, above[1]), (bottom, below[1]), (bottom, below[0]), (top, above[0])
