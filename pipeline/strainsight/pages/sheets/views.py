"""Views of a gauge on a drawing sheet: the part from outside and from the side with dimensions of the gauge, and the enlarged
gauge. Lengths and axes are those of the datum."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from html import escape

import numpy as np

from strainsight.pages.arrays import FloatArray
from strainsight.positions import PositionAxes

Point = tuple[float, float]
WIDTH, HEIGHT = 297.0, 210.0
"""A4, landscape [mm]."""
SIZE = f' width="{WIDTH:g}mm" height="{HEIGHT:g}mm"'
ARROW, SLIM = 2.4, 0.4
"""Length and half width of an arrow's head [mm]."""
THIN, THICK = 0.18, 0.35
TEXT = 3.2
"""Height of letters [mm]."""


class Paper:
    """SVG elements in drawing order."""

    def __init__(self) -> None:
        self._marks: list[str] = []

    def svg(self, title: str) -> str:
        """Sheet as a self-contained SVG element."""
        box = f'{SIZE} viewBox="0 0 {WIDTH:g} {HEIGHT:g}"'
        style = f'font-family="Arial, Helvetica, sans-serif" fill="none" stroke="#000000" stroke-width="{THIN}"'
        ground = f'<rect width="{WIDTH:g}" height="{HEIGHT:g}" fill="#ffffff" stroke="none"/>'
        head = f'<svg xmlns="http://www.w3.org/2000/svg"{box} role="img" aria-label="{escape(title)}" {style}>'
        return f"{head}<title>{escape(title)}</title>{ground}{''.join(self._marks)}</svg>\n"

    def path(self, points: Sequence[Point], width: float = THIN, dash: str = "", fill: str = "") -> None:
        """Add a line through points, closed if it is filled."""
        way = "M" + "L".join(f"{_n(x)} {_n(y)}" for x, y in points) + "Z" * bool(fill)
        style = f' stroke-width="{width}"' * (width != THIN) + f' stroke-dasharray="{dash}"' * bool(dash)
        style += f' fill="{fill}"' * bool(fill)
        self._marks.append(f'<path d="{way}"{style}/>')

    def circle(self, at: Point, radius: float) -> None:
        self._marks.append(f'<circle cx="{_n(at[0])}" cy="{_n(at[1])}" r="{_n(radius)}" stroke-width="{THIN}"/>')

    def text(
        self, at: Point, words: str, size: float = TEXT, anchor: str = "start", turn: float = 0.0, bold: bool = False
    ) -> None:
        """Add text on white ground, vertically centred; turn [deg]: counter-clockwise rotation."""
        x, y = _n(at[0]), _n(at[1])
        style = f' text-anchor="{anchor}"' * (anchor != "start") + ' font-weight="bold"' * bold
        style += f' transform="rotate({_n(-turn)} {x} {y})"' * bool(turn)
        ground = 'style="paint-order:stroke" stroke="#ffffff" stroke-width="0.9" fill="#000000"'
        self._marks.append(
            f'<text x="{x}" y="{y}" dy="0.35em" font-size="{size:g}" {ground}{style}>{escape(words)}</text>'
        )

    def arrow(self, tip: Point, angle: float) -> None:
        """Add an arrow head with its tip at an angle [rad], counter-clockwise from the right."""
        c, s = math.cos(angle), -math.sin(angle)
        back = (tip[0] - ARROW * c, tip[1] - ARROW * s)
        sides = [(back[0] - k * SLIM * s, back[1] + k * SLIM * c) for k in (1, -1)]
        self.path([tip, *sides], fill="#000000")

    def ray(self, start: Point, end: Point, words: str = "", width: float = THIN) -> None:
        """Add a line with an arrow head at its end, followed by text."""
        if math.dist(start, end) < 1e-6:
            return
        self.path([start, end], width)
        angle = math.atan2(start[1] - end[1], end[0] - start[0])
        self.arrow(end, angle)
        if words:
            self.text(_polar(end, angle, 3.0), words, anchor="middle")

    def dimension(self, a: Point, b: Point, words: str, offset: float = 2.2) -> None:
        """Add a dimension line with arrow heads at both ends, from outside if it is short, and text next to its middle."""
        long = math.dist(a, b)
        if long < 0.05:
            return
        angle = math.atan2(a[1] - b[1], b[0] - a[0])
        inside = long > 2.6 * ARROW
        tail = (0.0 if inside else 2 * ARROW) / long
        run = [(p[0] + k * tail * (b[0] - a[0]), p[1] + k * tail * (b[1] - a[1])) for p, k in ((a, -1), (b, 1))]
        self.path(run)
        self.arrow(b, angle if inside else angle + math.pi)
        self.arrow(a, angle + math.pi if inside else angle)
        turn = (math.degrees(angle) + 90.0) % 180.0 - 90.0
        if turn <= -89.9:
            turn = 90.0
        up = math.radians(turn + 90.0)
        middle = ((a[0] + b[0]) / 2 + offset * math.cos(up), (a[1] + b[1]) / 2 - offset * math.sin(up))
        self.text(middle, words, anchor="middle", turn=turn)


def _n(value: float) -> str:
    return f"{round(value, 2) + 0.0:g}"


GRAIN = 0.02
"""Distance below which ends are merged [mm]."""
Corner = tuple[int, int]


def joined(segments: FloatArray) -> list[list[tuple[float, float]]]:
    """Segments (s, 2, 2) [mm] as paths through common ends, each once, without collinear points."""
    grid = np.round(np.asarray(segments, dtype=float) / GRAIN).astype(np.int64).reshape(-1, 4)
    ax, ay, bx, by = grid.T
    back = (ax > bx) | ((ax == bx) & (ay > by))
    pairs = np.where(back[:, None], grid[:, [2, 3, 0, 1]], grid)[(ax != bx) | (ay != by)]
    neighbours: dict[Corner, set[Corner]] = {}
    for x, y, x2, y2 in np.unique(pairs, axis=0).tolist():
        a, b = (x, y), (x2, y2)
        neighbours.setdefault(a, set()).add(b)
        neighbours.setdefault(b, set()).add(a)
    ends = [point for point, others in neighbours.items() if len(others) != 2]
    paths = []
    for start in (*ends, *neighbours):
        while neighbours[start]:
            path = _walk(start, neighbours)
            paths.append([(x * GRAIN, y * GRAIN) for x, y in _straightened(path)])
    return paths


def _walk(start: Corner, neighbours: dict[Corner, set[Corner]]) -> list[Corner]:
    """Path from a point to the next branch or end; its segments are removed."""
    path = [start]
    while neighbours[path[-1]] and (len(path) == 1 or len(neighbours[path[-1]]) == 1):
        ahead = min(neighbours[path[-1]])
        neighbours[path[-1]].discard(ahead)
        neighbours[ahead].discard(path[-1])
        path.append(ahead)
    return path


def _straightened(path: list[Corner]) -> list[Corner]:
    """Path without points closer than GRAIN to the line between the others (Douglas and Peucker, 1973)."""
    if len(path) == 2:
        return path
    x = np.array(path, dtype=float)
    selected, spans = {0, len(path) - 1}, [(0, len(path) - 1)]
    while spans:
        a, b = spans.pop()
        if b - a < 2:
            continue
        along, off = x[b] - x[a], x[a + 1 : b] - x[a]
        share = np.clip(off @ along / max(along @ along, 1.0), 0, 1)
        distance = np.linalg.norm(off - share[:, None] * along, axis=1)
        if distance.max() > 1:
            middle = a + 1 + int(np.argmax(distance))
            selected.add(middle)
            spans += [(a, middle), (middle, b)]
    return [path[i] for i in sorted(selected)]


def clipped(segments: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Parts (k, 2, 2) of segments (s, 2, 2) inside a box with these corners (2,) (Liang and Barsky, 1984)."""
    a, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        first, last = (low - a) / along, (high - a) / along
    inside = (a >= low) & (a <= high)
    still = along == 0
    enter = np.where(still, np.where(inside, -np.inf, np.inf), np.minimum(first, last)).max(axis=1).clip(0, 2)
    leave = np.where(still, np.where(inside, np.inf, -np.inf), np.maximum(first, last)).min(axis=1).clip(-1, 1)
    selected = enter < leave
    ends = np.stack([a + enter[:, None] * along, a + leave[:, None] * along], axis=1)
    return np.asarray(ends[selected])


@dataclass(frozen=True)
class Projection:
    """View of the part: right and up (3,) unit vectors of the paper; visible, hidden (s, 2, 3): segments [unit]."""

    right: FloatArray
    up: FloatArray
    visible: FloatArray
    hidden: FloatArray

    def flat(self, x: FloatArray) -> FloatArray:
        """Points (..., 3) → (..., 2) on the paper, without scale."""
        return np.asarray(np.asarray(x) @ np.array([self.right, self.up]).T)


@dataclass(frozen=True)
class Sheet:
    """One gauge, or one arm of a bridge.

    name: "G1", "G3 arm 2"; deck: file name; layout: identifier of the layout; frame: the datum;
    position, normal (3,); directions (c, 3) of the grids; strain: whether it is a bonded strain sensor; grid [unit], 0: unknown;
    grid_width [unit], 0: unknown; carrier: length and width of the foil [unit]; carrier_of: gauge type or "assumed";
    distance (2,), angle (2,) [deg], foot (2, 3), along (2, 3) of the edges, NaN without an edge; element, facet: 0 without one;
    outside: whether no part lies in front of the gauge; front: view against the normal; side: transverse view with the normal
    upward."""

    name: str
    kind: str
    run: str
    deck: str
    layout: str
    frame: PositionAxes
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
    outside: bool
    front: Projection
    side: Projection


MINUS = "−"
HIDDEN = "1.6 0.9"
CHAIN = "4 0.8 0.6 0.8"
GREY = "#dddddd"
SQUARE = 0.9999
"""Cosine from which an axis of the datum is parallel to one of the paper."""
AXIS = 9.0
"""Length of the datum arrows [mm]."""
AWAY = 9.0
"""Distance from a view to its dimension line [mm]."""
USUAL_GRID = 0.375
"""Ratio of grid length to carrier length, if the grid length is unknown."""


@dataclass(frozen=True)
class PlacedView:
    """View on paper with `centre` [unit] at the point `at` [mm]; scale [mm/unit]."""

    view: Projection
    centre: FloatArray
    at: Point
    scale: float

    def __call__(self, x: FloatArray) -> Point:
        """Point (3,) [unit] → [mm]."""
        u, v = self.scale * (self.view.flat(x) - self.centre)
        return float(self.at[0] + u), float(self.at[1] - v)

    def lines(self, segments: FloatArray) -> FloatArray:
        """Segments (s, 2, 3) [unit] → (s, 2, 2) [mm]."""
        flat = self.scale * (self.view.flat(segments) - self.centre)
        return np.asarray(np.array(self.at) + flat * [1, -1])

    def angle(self, d: FloatArray) -> float:
        """Angle of a direction (3,) on the paper [rad], counter-clockwise."""
        u, v = self.view.flat(d)
        return math.atan2(float(v), float(u))


def size(value: float, sheet: Sheet) -> str:
    """Length in the unit of the sheet, with a resolution of at least 0.01 mm."""
    places = max(math.ceil(5 + math.log10(sheet.frame.metres) - 1e-9), 0)
    text = f"{round(float(value), places) + 0.0:.{places}f}"
    return (text.rstrip("0").rstrip(".") if places else text).replace("-", MINUS)


def degrees(angle: float) -> str:
    """Angle rounded to 0.1°."""
    return f"{round(float(angle), 1) + 0.0:g}°".replace("-", MINUS)


def outline(paper: Paper, placed: PlacedView) -> None:
    """Draw the edges of the part; hidden edges are dashed."""
    for path in joined(placed.lines(placed.view.hidden)):
        paper.path(path, 0.13, HIDDEN)
    for path in joined(placed.lines(placed.view.visible)):
        paper.path(path, THICK)


def datum(paper: Paper, placed: PlacedView) -> None:
    """Draw the origin and the axes, if they are not normal to the paper."""
    at = placed(np.zeros(3))
    paper.circle(at, 1.2)
    for i, name in enumerate("xyz"):
        flat = placed.view.flat(np.eye(3)[i])
        if float(np.linalg.norm(flat)) > 0.3:
            paper.ray(at, (at[0] + AXIS * float(flat[0]), at[1] - AXIS * float(flat[1])), name, 0.25)


def from_datum(paper: Paper, placed: PlacedView, sheet: Sheet, box: tuple[float, float], across: bool = True) -> None:
    """Draw dimensions from the origin along datum axes parallel to the paper axes; box: bottom and left of the view [mm];
    across: whether the horizontal dimension is included."""
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


def to_edges(paper: Paper, placed: PlacedView, sheet: Sheet) -> None:
    """Draw dimensions to both edges, if they are long enough to be legible."""
    g = placed(sheet.position)
    for distance, foot in zip(sheet.distance, sheet.foot, strict=True):
        if np.isfinite(distance) and math.dist(g, end := placed(foot)) > 0.5:
            paper.dimension(g, end, size(distance, sheet), offset=2.0)


def foil(paper: Paper, placed: PlacedView, sheet: Sheet, axis: float = 0.0) -> None:
    """Draw the gauge to scale: carrier and grid of a single gauge, a line per grid of a rosette, a circle for other sensors;
    axis [mm]: extension of the centre lines."""
    g = placed(sheet.position)
    single = sheet.strain and len(sheet.directions) == 1 and np.any(sheet.directions[0])
    if single:
        long = sheet.grid or USUAL_GRID * sheet.carrier[0]
        angle = placed.angle(sheet.directions[0])
        paper.path(_rectangle(g, angle, *(placed.scale * side for side in sheet.carrier)), fill="#ffffff")
        paper.path(_rectangle(g, angle, placed.scale * long, placed.scale * (sheet.grid_width or long / 2)), fill=GREY)
        for turned, side in zip((angle, angle + math.pi / 2), sheet.carrier, strict=True):
            reach = placed.scale * side / 2 + axis
            paper.path([_polar(g, turned, -reach), _polar(g, turned, reach)], 0.13)
        return
    reach = placed.scale * sheet.carrier[0] / 2
    paper.circle(g, reach)
    for k, d in enumerate(sheet.directions, start=1):
        if np.linalg.norm(placed.view.flat(d)) > 0.05:
            tip = _polar(g, placed.angle(d), reach + axis)
            paper.ray(g, tip, str(k) * (axis > 0 and len(sheet.directions) > 1), 0.3)


def profile(paper: Paper, placed: PlacedView, sheet: Sheet) -> None:
    """Draw the gauge from the side: its width on the surface, and the normal."""
    g, half = placed(sheet.position), max(placed.scale * sheet.carrier[0] / 2, 0.5)
    paper.path([(g[0] - half, g[1]), (g[0] + half, g[1])], 1.0)
    paper.ray(g, (g[0], g[1] - 8.0), "normal")


def detail(paper: Paper, sheet: Sheet, centre: Point, half: tuple[float, float], scale: float) -> None:
    """Draw the enlarged gauge in a window, with its angle to the nearest edge and the edges inside the window."""
    placed = PlacedView(sheet.front, sheet.front.flat(sheet.position), centre, scale)
    low, high = np.array(centre) - half, np.array(centre) + half
    paper.path([(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1]), (low[0], low[1])])
    for path in joined(clipped(placed.lines(sheet.front.visible), low, high)):
        paper.path(path, THICK)
    foil(paper, placed, sheet, axis=4.0)
    for distance, foot in zip(sheet.distance, sheet.foot, strict=True):
        end = placed(foot)
        if np.isfinite(distance) and np.all((np.array(end) >= low) & (np.array(end) <= high)):
            paper.dimension(centre, end, size(distance, sheet), offset=2.0)
    if np.isfinite(sheet.angle[0]):
        _angle(paper, placed, sheet, min(half) - 4.0)


def _angle(paper: Paper, placed: PlacedView, sheet: Sheet, radius: float) -> None:
    """Draw a line through the gauge along the edge, the measuring direction, and an arc between them."""
    t = placed.angle(sheet.along[0])
    if float(sheet.along[0] @ sheet.directions[0]) < 0:
        t += math.pi
    turn, at = math.radians(float(sheet.angle[0])), partial(_polar, placed(sheet.position))
    paper.path([at(t, -radius), at(t, radius)], 0.25, CHAIN)
    if abs(turn) > 1e-3:
        d, r = t + turn, 0.8 * radius
        paper.path([at(d, 0.0), at(d, radius)], 0.25, CHAIN)
        paper.path([at(t + k / 24 * turn, r) for k in range(25)])
        paper.arrow(at(d, r), d + math.copysign(math.pi / 2, turn))
        words = f"{degrees(sheet.angle[0])} to the edge"
        paper.text(at(t + turn / 2, r), words, anchor="middle", size=2.8)
    else:
        x, y = at(t, 0.75 * radius)
        paper.text((x, y - 3.0), "parallel to the edge", anchor="middle", size=2.8)


def _polar(centre: Point, angle: float, r: float) -> Point:
    """Point at this distance in a direction [rad], counter-clockwise from the right."""
    return centre[0] + r * math.cos(angle), centre[1] - r * math.sin(angle)


def _rectangle(centre: Point, angle: float, long: float, wide: float) -> list[Point]:
    c, s = math.cos(angle), math.sin(angle)
    corners = ((1, 1), (1, -1), (-1, -1), (-1, 1))
    return [
        (centre[0] + i * long / 2 * c - j * wide / 2 * s, centre[1] - i * long / 2 * s - j * wide / 2 * c)
        for i, j in corners
    ]
