"""Sections of beams by the names and dimensions that PBARL and PBEAML give them.

Dimensions: MSC Nastran Quick Reference Guide, PBARL. y is up and z to the right in its figures. Moments are about the centroid;
shear centres off the centroid are ignored, as in PBARL. J follows the NX Nastran Element Library Reference. Open walls have
Σ ℓ t³/3 of the middle lines (up to 10 % high for a wall less than four times as long as thick). Closed walls have 4 A²/∮ ds/t
(Bredt). Shear factors are shares of the area. They use the webs along y and the flanges along z (5/6 of those of I, T, H and Z).
A rectangle has 5/6, a circle 9/10, a tube 1/2. MSC Nastran 2022 computes J and the shear factors by finite elements instead,
unless MDLPRM,TWBRBML,1."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.errors import DeckError, did_you_mean
from strainsight.mesh.thin import BeamSection

ON = 1e-6
"""Tolerance of a position on the edge of a rectangle, I = A h²/12 = A (h/2)²/3, as a share of its moment."""


def section_of_shape(kind: str, dimensions: Sequence[float]) -> BeamSection:
    """Area A = Σ A_i, moments ∫ (y, z)ᵀ (y, z) dA = Σ I_i + A_i r_i r_iᵀ about the centroid, J, shear factors and the points
    C, D, E, F of a shape.

    kind "ROD", "TUBE", "I", …; dimensions DIM1, DIM2, … [m]. Raises DeckError for an unknown shape, a wrong number of
    dimensions, and dimensions that are not positive or not compatible."""
    if kind not in SHAPES:
        remedy = f"Use a PBAR or PBEAM instead. Known shapes are {', '.join(SHAPES)}."
        raise DeckError(
            f"the section shape {kind} is unknown",
            remedy=remedy if kind in OTHERS else did_you_mean(kind, SHAPES, remedy),
        )
    count, build = SHAPES[kind]
    listed = ", ".join(f"{value:g}" for value in dimensions)
    if len(dimensions) != count:
        raise DeckError(
            f"the number of dimensions of the section {kind} is {len(dimensions)} ({listed}), not {count}",
            remedy="Specify all dimensions as defined for PBARL.",
        )
    try:
        if not (np.array(dimensions) > 0).all():
            raise NoFit
        return section_from(build(*map(float, dimensions)))
    except (NoFit, OverflowError):
        raise DeckError(
            f"the section {kind} has impossible dimensions {listed}: not positive, too large, or a wall of zero length",
            remedy="Check the dimensions against the definition of PBARL, or use a PBAR.",
        ) from None


def _round(outer: float, inner: float, factor: float) -> Shape:
    if not 0 <= inner < outer:
        raise NoFit
    area, moment = np.pi * (outer**2 - inner**2), np.pi * (outer**4 - inner**4) / 4
    points = (outer, 0.0), (0.0, outer), (-outer, 0.0), (0.0, -outer)
    return Shape((Part(area, 0.0, 0.0, moment, moment),), 2 * moment, (factor * area,) * 2, points)


def _bar(width: float, height: float) -> Shape:
    area = width * height
    half = (-width / 2, width / 2)
    points = corners(height / 2, -height / 2, half, half)
    return Shape((block(-height / 2, -width / 2, height, width),), solid(width, height), (5 / 6 * area,) * 2, points)


def _box1(width: float, height: float, top: float, bottom: float, right: float, left: float) -> Shape:
    clear, between = height - top - bottom, width - left - right
    parts = (
        block(0, 0, bottom, width),
        block(height - top, 0, top, width),
        block(bottom, 0, clear, left),
        block(bottom, width - right, clear, right),
    )
    b, h = width - (left + right) / 2, height - (top + bottom) / 2
    J = 4 * (b * h) ** 2 / (b / top + b / bottom + h / left + h / right)
    sheared = clear * (left + right), between * (top + bottom)
    return Shape(parts, J, sheared, corners(height, 0, (0, width), (0, width)))


def _i(height: float, bottom: float, top: float, web: float, below: float, above: float) -> Shape:
    clear = height - below - above
    parts = (
        block(0, -bottom / 2, below, bottom),
        block(below, -web / 2, clear, web),
        block(height - above, -top / 2, above, top),
    )
    J = walls((bottom, below), (top, above), (height - (below + above) / 2, web))
    sheared = clear * web, 5 / 6 * (bottom * below + top * above)
    return Shape(parts, J, sheared, corners(height, 0, (-top / 2, top / 2), (-bottom / 2, bottom / 2)))


def _i1(overhang: float, web: float, clear: float, height: float) -> Shape:
    flange, width = (height - clear) / 2, overhang + web
    return _i(height, width, width, web, flange, flange)


def _chan(width: float, height: float, web: float, flange: float) -> Shape:
    """Open to the right."""
    clear, overhang = height - 2 * flange, width - web
    parts = (block(0, 0, height, web), block(0, web, flange, overhang), block(height - flange, web, flange, overhang))
    J = walls((width - web / 2, flange), (width - web / 2, flange), (height - flange, web))
    if not clear > 0:
        raise NoFit
    return Shape(parts, J, (clear * web, 2 * overhang * flange), corners(height, 0, (0, width), (0, width)))


def _chan1(overhang: float, web: float, clear: float, height: float) -> Shape:
    return _chan(overhang + web, height, web, (height - clear) / 2)


def _chan2(leg: float, web: float, height: float, width: float) -> Shape:
    """Open to the top."""
    clear, overhang = width - 2 * leg, height - web
    parts = block(0, 0, web, width), block(web, 0, overhang, leg), block(web, width - leg, overhang, leg)
    J = walls((height - web / 2, leg), (height - web / 2, leg), (width - leg, web))
    if not clear > 0:
        raise NoFit
    return Shape(parts, J, (2 * overhang * leg, clear * web), corners(height, 0, (0, width), (0, width)))


def _t(width: float, height: float, flange: float, web: float) -> Shape:
    """Flange at the top."""
    clear = height - flange
    parts = block(clear, -width / 2, flange, width), block(0, -web / 2, clear, web)
    J = walls((width, flange), (height - flange / 2, web))
    points = (height, 0.0), (height, width / 2), (0.0, 0.0), (height, -width / 2)
    return Shape(parts, J, (clear * web, 5 / 6 * width * flange), points)


def _t1(height: float, web: float, flange: float, thickness: float) -> Shape:
    """Flange at the right, upright."""
    parts = block(-height / 2, web, height, flange), block(-thickness / 2, 0, thickness, web)
    J = walls((height, flange), (web + flange / 2, thickness))
    right = web + flange
    points = (0.0, right), (-height / 2, right), (0.0, 0.0), (height / 2, right)
    return Shape(parts, J, (5 / 6 * height * flange, web * thickness), points)


def _t2(width: float, height: float, flange: float, web: float) -> Shape:
    """Flange at the bottom."""
    clear = height - flange
    parts = block(0, -width / 2, flange, width), block(flange, -web / 2, clear, web)
    J = walls((width, flange), (height - flange / 2, web))
    points = corners(height, 0, (-web / 2, web / 2), (-width / 2, width / 2))
    return Shape(parts, J, (clear * web, 5 / 6 * width * flange), points)


def _l(width: float, height: float, flange: float, web: float) -> Shape:
    """Web at the left, flange at the bottom."""
    parts = block(0, 0, flange, width), block(flange, 0, height - flange, web)
    J = walls((width - web / 2, flange), (height - flange / 2, web))
    if not width > web:
        raise NoFit
    sheared = (height - flange) * web, (width - web) * flange
    return Shape(parts, J, sheared, corners(height, 0, (0, web), (0, width)))


def _h(web: float, flanges: float, height: float, thickness: float) -> Shape:
    """DIM2 is the thickness of both flanges together."""
    flange, width = flanges / 2, web + flanges
    parts = (
        block(-height / 2, -width / 2, height, flange),
        block(-height / 2, web / 2, height, flange),
        block(-thickness / 2, -web / 2, thickness, web),
    )
    J = walls((height, flange), (height, flange), (web + flange, thickness))
    half = (-width / 2, width / 2)
    sheared = 5 / 6 * 2 * height * flange, web * thickness
    return Shape(parts, J, sheared, corners(height / 2, -height / 2, half, half))


def _cross(overhangs: float, upright: float, height: float, level: float) -> Shape:
    """DIM1 is the total length of both arms on the sides of the upright."""
    width, arm = overhangs + upright, overhangs / 2
    parts = (
        block(-height / 2, -upright / 2, height, upright),
        block(-level / 2, -width / 2, level, arm),
        block(-level / 2, upright / 2, level, arm),
    )
    points = (height / 2, 0.0), (0.0, width / 2), (-height / 2, 0.0), (0.0, -width / 2)
    J = walls((height, upright), (overhangs, level))
    return Shape(parts, J, (5 / 6 * height * upright, 5 / 6 * width * level), points)


def _z(overhang: float, web: float, clear: float, height: float) -> Shape:
    """Upper flange to the left, lower flange to the right."""
    flange, width = (height - clear) / 2, overhang + web
    parts = (
        block(-height / 2, -web / 2, flange, width),
        block(-clear / 2, -web / 2, clear, web),
        block(clear / 2, web / 2 - width, flange, width),
    )
    J = walls((overhang + web / 2, flange), (overhang + web / 2, flange), (height - flange, web))
    points = corners(height / 2, -height / 2, (web / 2 - width, web / 2), (-web / 2, width - web / 2))
    return Shape(parts, J, (clear * web, 5 / 6 * 2 * width * flange), points)


def _hexa(point: float, width: float, height: float) -> Shape:
    """A rectangle with an isosceles triangle on either side; J of a rectangle of the average width."""
    inner, area = width - 2 * point, point * height / 2
    side, moments = inner / 2 + point / 3, (area * height**2 / 24, area * point**2 / 18)
    middle = block(-height / 2, -inner / 2, height, inner)
    parts = middle, Part(area, 0.0, side, *moments), Part(area, 0.0, -side, *moments)
    points = (height / 2, 0.0), (-height / 2, 0.0), (0.0, width / 2), (0.0, -width / 2)
    sheared = 5 / 6 * (middle.area + 2 * area)
    return Shape(parts, solid(width - point, height), (sheared, sheared), points)


def _hat(height: float, t: float, top: float, brim: float) -> Shape:
    """Walls of one thickness; the brims reach outward at the bottom."""
    clear = height - 2 * t
    parts = (
        block(height - t, -top / 2, t, top),
        block(t, -top / 2, clear, t),
        block(t, top / 2 - t, clear, t),
        block(0, -top / 2 - brim, t, brim + t),
        block(0, top / 2 - t, t, brim + t),
    )
    J = walls((top - t, t), (2 * (height - t), t), (2 * brim + t, t))
    if not top > 2 * t:
        raise NoFit
    points = corners(height, 0, (-top / 2, top / 2), (-top / 2 - brim, top / 2 + brim))
    return Shape(parts, J, (2 * clear * t, 0.0), points)


SHAPES: dict[str, tuple[int, Callable[..., Shape]]] = {
    "ROD": (1, lambda radius: _round(radius, 0.0, 0.9)),
    "TUBE": (2, lambda outer, inner: _round(outer, inner, 0.5)),
    "TUBE2": (2, lambda outer, t: _round(outer, outer - t, 0.5)),
    "BAR": (2, _bar),
    "BOX": (4, lambda width, height, level, upright: _box1(width, height, level, level, upright, upright)),
    "BOX1": (6, _box1),
    "I": (6, _i),
    "I1": (4, _i1),
    "T": (4, _t),
    "T1": (4, _t1),
    "T2": (4, _t2),
    "L": (4, _l),
    "CHAN": (4, _chan),
    "CHAN1": (4, _chan1),
    "CHAN2": (4, _chan2),
    "H": (4, _h),
    "CROSS": (4, _cross),
    "HEXA": (3, _hexa),
    "Z": (4, _z),
    "HAT": (4, _hat),
}
"""Number of dimensions, and the function of them."""

OTHERS = ("HAT1", "DBOX")
"""Unsupported shapes of PBARL: HAT1 is closed by a plate, DBOX has two cells."""


@dataclass(frozen=True)
class Part:
    """Area at (y, z), and its moments about that point."""

    area: float
    y: float
    z: float
    Iy: float
    Iz: float


@dataclass(frozen=True)
class Shape:
    """Parts, J, shear areas along y and z, and points C, D, E, F as (y, z); all from one origin."""

    parts: tuple[Part, ...]
    torsion: float
    sheared: tuple[float, float]
    points: tuple[tuple[float, float], ...]


class NoFit(Exception):
    """Raised for a part without thickness or length."""


def section_from(shape: Shape) -> BeamSection:
    """A = Σ A_i, the moments Σ I_i + A_i r_i r_iᵀ about the centroid, the points from there, and the solid sides: for several
    parts those with their middle on a part, represented by rectangles √(12 I/A) high and wide."""
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
