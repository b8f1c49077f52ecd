"""Segments on paper as few paths."""

from __future__ import annotations

import numpy as np

from strainsight.report.arrays import FloatArray

GRAIN = 0.02
"""[mm] Ends that are nearer than this are one."""
Point = tuple[int, int]


def joined(segments: FloatArray) -> list[list[tuple[float, float]]]:
    """Segments (s, 2, 2) [mm] as paths through their common ends, each once, without points within a straight line."""
    grid = np.round(np.asarray(segments, dtype=float) / GRAIN).astype(np.int64).reshape(-1, 4)
    ax, ay, bx, by = grid.T
    back = (ax > bx) | ((ax == bx) & (ay > by))
    pairs = np.where(back[:, None], grid[:, [2, 3, 0, 1]], grid)[(ax != bx) | (ay != by)]
    beside: dict[Point, set[Point]] = {}
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


def _walk(start: Point, beside: dict[Point, set[Point]]) -> list[Point]:
    """From a point on, until there are several ways or none; what was walked is gone."""
    path = [start]
    while beside[path[-1]] and (len(path) == 1 or len(beside[path[-1]]) == 1):
        ahead = min(beside[path[-1]])
        beside[path[-1]].discard(ahead)
        beside[ahead].discard(path[-1])
        path.append(ahead)
    return path


def _straightened(path: list[Point]) -> list[Point]:
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
