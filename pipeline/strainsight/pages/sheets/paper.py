"""A sheet of A4 to draw on, in mm from its upper left corner: lines, texts, arrows, dimensions as SVG; few paths of segments."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np

from strainsight.pages.arrays import FloatArray

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
    """Marks in the order in which they are drawn."""

    def __init__(self) -> None:
        self._marks: list[str] = []

    def svg(self, title: str) -> str:
        """The sheet as an SVG element that stands alone."""
        box = f'{SIZE} viewBox="0 0 {WIDTH:g} {HEIGHT:g}"'
        style = f'font-family="Arial, Helvetica, sans-serif" fill="none" stroke="#000000" stroke-width="{THIN}"'
        ground = f'<rect width="{WIDTH:g}" height="{HEIGHT:g}" fill="#ffffff" stroke="none"/>'
        head = f'<svg xmlns="http://www.w3.org/2000/svg"{box} role="img" aria-label="{escape(title)}" {style}>'
        return f"{head}<title>{escape(title)}</title>{ground}{''.join(self._marks)}</svg>\n"

    def path(self, points: Sequence[Point], width: float = THIN, dash: str = "", fill: str = "") -> None:
        """A line through points, closed where it is filled."""
        way = "M" + "L".join(f"{_n(x)} {_n(y)}" for x, y in points) + "Z" * bool(fill)
        style = f' stroke-width="{width}"' * (width != THIN) + f' stroke-dasharray="{dash}"' * bool(dash)
        style += f' fill="{fill}"' * bool(fill)
        self._marks.append(f'<path d="{way}"{style}/>')

    def circle(self, at: Point, radius: float, width: float = THIN) -> None:
        self._marks.append(f'<circle cx="{_n(at[0])}" cy="{_n(at[1])}" r="{_n(radius)}" stroke-width="{width}"/>')

    def text(
        self, at: Point, words: str, size: float = TEXT, anchor: str = "start", turn: float = 0.0, bold: bool = False
    ) -> None:
        """Words on a white ground, their middle at this height; turn [deg] counter-clockwise."""
        x, y = _n(at[0]), _n(at[1])
        style = f' text-anchor="{anchor}"' * (anchor != "start") + ' font-weight="bold"' * bold
        style += f' transform="rotate({_n(-turn)} {x} {y})"' * bool(turn)
        ground = 'style="paint-order:stroke" stroke="#ffffff" stroke-width="0.9" fill="#000000"'
        self._marks.append(
            f'<text x="{x}" y="{y}" dy="0.35em" font-size="{size:g}" {ground}{style}>{escape(words)}</text>'
        )

    def arrow(self, tip: Point, angle: float) -> None:
        """A head whose tip points along an angle [rad], counter-clockwise from the right."""
        c, s = math.cos(angle), -math.sin(angle)
        back = (tip[0] - ARROW * c, tip[1] - ARROW * s)
        sides = [(back[0] - k * SLIM * s, back[1] + k * SLIM * c) for k in (1, -1)]
        self.path([tip, *sides], fill="#000000")

    def ray(self, start: Point, end: Point, words: str = "", width: float = THIN) -> None:
        """A line with a head at its end, and words beyond it."""
        if math.dist(start, end) < 1e-6:
            return
        self.path([start, end], width)
        angle = math.atan2(start[1] - end[1], end[0] - start[0])
        self.arrow(end, angle)
        if words:
            self.text((end[0] + 3 * math.cos(angle), end[1] - 3 * math.sin(angle)), words, anchor="middle")

    def dimension(self, a: Point, b: Point, words: str, beside: float = 2.2) -> None:
        """A line between two points with heads at both ends, from outside where it is short; its words beside its middle."""
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
        middle = ((a[0] + b[0]) / 2 + beside * math.cos(up), (a[1] + b[1]) / 2 - beside * math.sin(up))
        self.text(middle, words, anchor="middle", turn=turn)


def _n(value: float) -> str:
    return f"{round(value, 2) + 0.0:g}"


GRAIN = 0.02
"""[mm] Ends that are nearer than this are one."""
Corner = tuple[int, int]


def joined(segments: FloatArray) -> list[list[tuple[float, float]]]:
    """Segments (s, 2, 2) [mm] as paths through their common ends, each once, without points within a straight line."""
    grid = np.round(np.asarray(segments, dtype=float) / GRAIN).astype(np.int64).reshape(-1, 4)
    ax, ay, bx, by = grid.T
    back = (ax > bx) | ((ax == bx) & (ay > by))
    pairs = np.where(back[:, None], grid[:, [2, 3, 0, 1]], grid)[(ax != bx) | (ay != by)]
    beside: dict[Corner, set[Corner]] = {}
    for x, y, x2, y2 in np.unique(pairs, axis=0).tolist():
        a, b = (x, y), (x2, y2)
        beside.setdefault(a, set()).add(b)
        beside.setdefault(b, set()).add(a)
    ends = [point for point, others in beside.items() if len(others) != 2]
    paths = []
    for start in (*ends, *beside):
        while beside[start]:
            path = _walk(start, beside)
            paths.append([(x * GRAIN, y * GRAIN) for x, y in _straightened(path)])
    return paths


def _walk(start: Corner, beside: dict[Corner, set[Corner]]) -> list[Corner]:
    """From a point on, until there are several ways or none; what was walked is gone."""
    path = [start]
    while beside[path[-1]] and (len(path) == 1 or len(beside[path[-1]]) == 1):
        ahead = min(beside[path[-1]])
        beside[path[-1]].discard(ahead)
        beside[ahead].discard(path[-1])
        path.append(ahead)
    return path


def _straightened(path: list[Corner]) -> list[Corner]:
    """Without points that are less than a grain off the line between those that are kept (Douglas and Peucker, 1973)."""
    if len(path) == 2:
        return path
    x = np.array(path, dtype=float)
    kept, spans = {0, len(path) - 1}, [(0, len(path) - 1)]
    while spans:
        a, b = spans.pop()
        if b - a < 2:
            continue
        along, off = x[b] - x[a], x[a + 1 : b] - x[a]
        share = np.clip(off @ along / max(along @ along, 1.0), 0, 1)
        distance = np.linalg.norm(off - share[:, None] * along, axis=1)
        if distance.max() > 1:
            middle = a + 1 + int(np.argmax(distance))
            kept.add(middle)
            spans += [(a, middle), (middle, b)]
    return [path[i] for i in sorted(kept)]


def clipped(segments: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """What of segments (s, 2, 2) lies in a box with these corners (2,): (k, 2, 2) (Liang and Barsky, 1984)."""
    a, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        first, last = (low - a) / along, (high - a) / along
    inside = (a >= low) & (a <= high)
    still = along == 0
    enter = np.where(still, np.where(inside, -np.inf, np.inf), np.minimum(first, last)).max(axis=1).clip(0, 2)
    leave = np.where(still, np.where(inside, np.inf, -np.inf), np.maximum(first, last)).min(axis=1).clip(-1, 1)
    kept = enter < leave
    ends = np.stack([a + enter[:, None] * along, a + leave[:, None] * along], axis=1)
    return np.asarray(ends[kept])
