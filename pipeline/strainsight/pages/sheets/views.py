"""What a drawing sheet shows of one gauge, and its views: the part from outside and across with the gauge's dimensions, and the
gauge enlarged. Lengths and axes are those of the datum."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from strainsight.pages.arrays import FloatArray
from strainsight.pages.datum import Frame
from strainsight.pages.sheets.paper import THICK, Paper, Point, clipped, joined


@dataclass(frozen=True)
class Projection:
    """A view of the part: right and up (3,) unit vectors of the paper; seen, hidden (s, 2, 3) segments [unit]."""

    right: FloatArray
    up: FloatArray
    seen: FloatArray
    hidden: FloatArray

    def flat(self, x: FloatArray) -> FloatArray:
        """Points (..., 3) → (..., 2) on the paper, not yet to scale."""
        return np.asarray(np.asarray(x) @ np.array([self.right, self.up]).T)


@dataclass(frozen=True)
class Sheet:
    """One gauge, or one arm of a bridge.

    name ("G1", "G3 arm 2"); kind; run; deck: name of its file; layout: what tells this layout from another; frame: the datum;
    position, normal (3,); directions (c, 3) of its grids; strain: whether it is bonded on; grid [unit], 0: not stated; grid_width
    [unit], 0: not known; carrier: length and width of the foil [unit]; carrier_of: type of gauge that it is of, or "assumed";
    distance (2,), angle (2,) [deg], foot (2, 3), along (2, 3) of the edges, NaN where there is none; element and facet, 0: on
    none; front: seen along the normal from outside; side: seen across, with the normal upward.
    """

    name: str
    kind: str
    run: str
    deck: str
    layout: str
    frame: Frame
    position: FloatArray
    normal: FloatArray
    directions: FloatArray
    strain: bool
    grid: float
    grid_width: float
    carrier: tuple[float, float]
    carrier_of: str
    distance: FloatArray
    angle: FloatArray
    foot: FloatArray
    along: FloatArray
    element: int
    facet: int
    front: Projection
    side: Projection


def paper_axes(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Right and up (3,) of the view along a normal (3,): z upward; of a surface that faces along z x to the right."""
    n = np.asarray(normal, dtype=float)
    if abs(n[2]) > 0.9:
        right = np.array([1.0, 0.0, 0.0]) - n[0] * n
        right /= np.linalg.norm(right)
        return right, np.cross(n, right)
    up = np.array([0.0, 0.0, 1.0]) - n[2] * n
    up /= np.linalg.norm(up)
    return np.cross(up, n), up


MINUS = "−"
HIDDEN = "1.6 0.9"
CHAIN = "4 0.8 0.6 0.8"
GREY = "#dddddd"
SQUARE = 0.9999
"""Cosine from which an axis of the datum lies along one of the paper."""
AXIS = 9.0
"""[mm] of the arrows of the datum."""
AWAY = 9.0
"""[mm] from a view to the dimension beside it."""
USUAL_GRID = 0.375
"""Share of a carrier that its grid takes where that is not stated."""


@dataclass(frozen=True)
class Placed:
    """A view on paper: what of it is at `centre` [unit] lies at the point `at` [mm]; scale [mm/unit]."""

    view: Projection
    centre: FloatArray
    at: Point
    scale: float

    def __call__(self, x: FloatArray) -> Point:
        """A point (3,) [unit] → [mm]."""
        u, v = self.scale * (self.view.flat(x) - self.centre)
        return float(self.at[0] + u), float(self.at[1] - v)

    def lines(self, segments: FloatArray) -> FloatArray:
        """Segments (s, 2, 3) [unit] → (s, 2, 2) [mm]."""
        flat = self.scale * (self.view.flat(segments) - self.centre)
        return np.asarray(np.array(self.at) + flat * [1, -1])

    def angle(self, d: FloatArray) -> float:
        """Of a direction (3,) on the paper [rad], counter-clockwise."""
        u, v = self.view.flat(d)
        return math.atan2(float(v), float(u))


def size(value: float, sheet: Sheet) -> str:
    """A length in the unit of the sheet, to a hundredth of a millimetre at least."""
    places = max(math.ceil(5 + math.log10(sheet.frame.metres) - 1e-9), 0)
    text = f"{round(float(value), places) + 0.0:.{places}f}"
    return (text.rstrip("0").rstrip(".") if places else text).replace("-", MINUS)


def degrees(angle: float) -> str:
    """To a tenth."""
    return f"{round(float(angle), 1) + 0.0:g}°".replace("-", MINUS)


def outline(paper: Paper, placed: Placed) -> None:
    """Edges of the part, those behind broken."""
    for path in joined(placed.lines(placed.view.hidden)):
        paper.path(path, 0.13, HIDDEN)
    for path in joined(placed.lines(placed.view.seen)):
        paper.path(path, THICK)


def datum(paper: Paper, placed: Placed, sheet: Sheet) -> None:
    """The origin, and its axes as far as they lie in the paper."""
    at = placed(np.zeros(3))
    paper.circle(at, 1.2)
    for i, name in enumerate("xyz"):
        flat = placed.view.flat(np.eye(3)[i])
        long = float(np.linalg.norm(flat))
        if long > 0.3:
            paper.ray(at, (at[0] + AXIS * float(flat[0]), at[1] - AXIS * float(flat[1])), name, 0.25)


def from_datum(paper: Paper, placed: Placed, sheet: Sheet, box: tuple[float, float], across: bool = True) -> None:
    """Dimensions from the origin along axes of the datum that lie along those of the paper; box: bottom and left of the view
    [mm]; across: the horizontal one too."""
    o, g = placed(np.zeros(3)), placed(sheet.position)
    for i, name in enumerate("xyz"):
        u, v = placed.view.flat(np.eye(3)[i])
        words = f"{name} = {size(sheet.position[i], sheet)}"
        if across and abs(u) > SQUARE and abs(g[0] - o[0]) > 0.05:
            y = box[0] + AWAY
            for x, start in ((o[0], o[1]), (g[0], g[1])):
                paper.path([(x, start + 1.5), (x, y + 1.5)], 0.13)
            paper.dimension((o[0], y), (g[0], y), words)
        if abs(v) > SQUARE and abs(g[1] - o[1]) > 0.05:
            x = box[1] - AWAY
            for start, y in ((o[0], o[1]), (g[0], g[1])):
                paper.path([(start - 1.5, y), (x - 1.5, y)], 0.13)
            paper.dimension((x, o[1]), (x, g[1]), words)


def to_edges(paper: Paper, placed: Placed, sheet: Sheet) -> None:
    """Dimensions to both edges, where they are long enough on paper to be read."""
    g = placed(sheet.position)
    for distance, foot in zip(sheet.distance, sheet.foot, strict=True):
        if np.isfinite(distance) and math.dist(g, end := placed(foot)) > 0.5:
            paper.dimension(g, end, size(distance, sheet), beside=2.0)


def foil(paper: Paper, placed: Placed, sheet: Sheet, axis: float = 0.0) -> None:
    """The gauge to scale: carrier and grid of a single one, a line a grid of a rosette, a circle of what is not bonded on; axis
    [mm] that its centre lines are longer than it."""
    g = placed(sheet.position)
    single = sheet.strain and len(sheet.directions) == 1 and np.any(sheet.directions[0])
    if single:
        long = sheet.grid or USUAL_GRID * sheet.carrier[0]
        angle = placed.angle(sheet.directions[0])
        paper.path(_rectangle(g, angle, *(placed.scale * side for side in sheet.carrier)), fill="#ffffff")
        paper.path(_rectangle(g, angle, placed.scale * long, placed.scale * (sheet.grid_width or long / 2)), fill=GREY)
        _centre_lines(
            paper, g, angle, placed.scale * sheet.carrier[0] / 2 + axis, placed.scale * sheet.carrier[1] / 2 + axis
        )
        return
    reach = placed.scale * sheet.carrier[0] / 2
    paper.circle(g, reach)
    for k, d in enumerate(sheet.directions, start=1):
        if np.linalg.norm(placed.view.flat(d)) > 0.05:
            angle = placed.angle(d)
            tip = (g[0] + (reach + axis) * math.cos(angle), g[1] - (reach + axis) * math.sin(angle))
            paper.ray(g, tip, str(k) * (axis > 0 and len(sheet.directions) > 1), 0.3)


def profile(paper: Paper, placed: Placed, sheet: Sheet) -> None:
    """The gauge from the side: its width on the surface, and the normal."""
    g, half = placed(sheet.position), max(placed.scale * sheet.carrier[0] / 2, 0.5)
    paper.path([(g[0] - half, g[1]), (g[0] + half, g[1])], 1.0)
    paper.ray(g, (g[0], g[1] - 8.0), "normal")


def detail(paper: Paper, sheet: Sheet, centre: Point, half: tuple[float, float], scale: float) -> None:
    """The gauge enlarged in a window, with its angle to the nearest edge and the edges that lie in the window."""
    placed = Placed(sheet.front, sheet.front.flat(sheet.position), centre, scale)
    low, high = np.array(centre) - half, np.array(centre) + half
    paper.path([(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1]), (low[0], low[1])])
    for path in joined(clipped(placed.lines(sheet.front.seen), low, high)):
        paper.path(path, THICK)
    foil(paper, placed, sheet, axis=4.0)
    for distance, foot in zip(sheet.distance, sheet.foot, strict=True):
        end = placed(foot)
        if np.isfinite(distance) and np.all((np.array(end) >= low) & (np.array(end) <= high)):
            paper.dimension(centre, end, size(distance, sheet), beside=2.0)
    if np.isfinite(sheet.angle[0]):
        _angle(paper, placed, sheet, min(half) - 4.0)


def _angle(paper: Paper, placed: Placed, sheet: Sheet, radius: float) -> None:
    """A line through the gauge along the edge, the measuring direction, and an arc between them."""
    t = placed.angle(sheet.along[0])
    if float(sheet.along[0] @ sheet.directions[0]) < 0:
        t += math.pi
    turn = math.radians(float(sheet.angle[0]))
    g = placed(sheet.position)

    def at(angle: float, r: float) -> Point:
        return g[0] + r * math.cos(angle), g[1] - r * math.sin(angle)

    paper.path([at(t, -radius), at(t, radius)], 0.25, CHAIN)
    if abs(turn) > 1e-3:
        d = t + turn
        paper.path([at(d, 0.0), at(d, radius)], 0.25, CHAIN)
        r = 0.8 * radius
        paper.path([at(t + k / 24 * turn, r) for k in range(25)])
        ahead = math.copysign(math.pi / 2, turn)
        paper.arrow(at(d, r), d + ahead)
        words = f"{degrees(sheet.angle[0])} to the edge"
        paper.text(at(t + turn / 2, 0.8 * radius), words, anchor="middle", size=2.8)
    else:
        x, y = at(t, 0.75 * radius)
        paper.text((x, y - 3.0), "parallel to the edge", anchor="middle", size=2.8)


def _centre_lines(paper: Paper, g: Point, angle: float, along: float, across: float) -> None:
    for turned, reach in ((angle, along), (angle + math.pi / 2, across)):
        c, s = reach * math.cos(turned), reach * math.sin(turned)
        paper.path([(g[0] - c, g[1] + s), (g[0] + c, g[1] - s)], 0.13)


def _rectangle(centre: Point, angle: float, long: float, wide: float) -> list[Point]:
    c, s = math.cos(angle), math.sin(angle)
    corners = ((1, 1), (1, -1), (-1, -1), (-1, 1))
    return [
        (centre[0] + i * long / 2 * c - j * wide / 2 * s, centre[1] - i * long / 2 * s - j * wide / 2 * c)
        for i, j in corners
    ]
