"""Edges of a surface: which facets meet there, how sharply, and what lies near the sharp ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from strainsight.mesh.facets import Facets
from strainsight.sensors.surface import by_kind, facet_points, normals

SHARP = np.deg2rad(30.0)


@dataclass(frozen=True)
class Edges:
    """The edges of all facets, each once for every facet it belongs to, h of them, those of one edge side by side.

    facet (h,) index; side (h,) number of the edge within the facet, from its node `side` to the next; ends (h, 2) corners
    of the facets, ascending; middle (h, 3) [m]; start (e,) first row of each of the e edges; count (e,) of facets that meet
    there; sharp (e,) whether they meet at more than 30°, or are not two.
    """

    facet: np.ndarray
    side: np.ndarray
    ends: np.ndarray
    middle: np.ndarray
    start: np.ndarray
    count: np.ndarray
    sharp: np.ndarray


def edges_of(position: np.ndarray, facets: Facets) -> Edges:
    """Every edge of the facets; position (n, 3) [m].

    The normals are taken at the middle of the edge, so that a coarsely meshed curved surface is smooth if its facets
    are quadratic.
    """
    rows: list[tuple[np.ndarray, ...]] = []
    for kind, which, nodes in by_kind(facets.kind, facets.nodes):
        for a in range(kind.corners):
            b = (a + 1) % kind.corners
            xi = 0.5 * (kind.nodes[a] + kind.nodes[b])
            x, J = facet_points(kind, position[nodes], np.tile(xi, (len(nodes), 1)))
            ends = np.sort(facets.corners[which][:, [a, b]], axis=1)
            rows.append((which, np.full(len(which), a), ends, x, normals(J)))
    if not rows:
        none = np.zeros(0, dtype=np.int64)
        return Edges(none, none, np.zeros((0, 2), dtype=np.int64), np.zeros((0, 3)), none, none, np.zeros(0, bool))
    facet, side, ends, middle, normal = (np.concatenate(column) for column in zip(*rows, strict=True))
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    facet, side, ends, middle, normal = (column[order] for column in (facet, side, ends, middle, normal))
    start = np.flatnonzero(np.any(np.diff(ends, axis=0, prepend=-1) != 0, axis=1))
    count = np.diff(start, append=len(ends))
    two = count == 2
    angle = np.full(len(start), np.pi)
    left, right = normal[start[two]], normal[start[two] + 1]
    angle[two] = np.arctan2(np.linalg.norm(np.cross(left, right), axis=1), np.sum(left * right, axis=1))
    return Edges(facet, side, ends, middle, start, count, angle > SHARP)


def sharp_edges(position: np.ndarray, facets: Facets) -> np.ndarray:
    """Edges where two exterior facets meet at more than 30°, or more than two do, or one ends: segments (s, 2, 3) [m].

    A quadratic edge gives two segments. position (n, 3) [m].
    """
    edges = edges_of(position, facets)
    first = edges.start[edges.sharp]
    a, b = position[edges.ends[first, 0]], position[edges.ends[first, 1]]
    m = edges.middle[first]
    return np.concatenate([np.stack([a, m], axis=1), np.stack([m, b], axis=1)])


def near_segments(points: np.ndarray, segments: np.ndarray, distance: float) -> np.ndarray:
    """Which points (m, 3) [m] are nearer than `distance` [m] to one of the segments (s, 2, 3) [m]: (m,) bool."""
    near = np.zeros(len(points), dtype=bool)
    if not len(segments) or not len(points):
        return near
    a, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    length = np.linalg.norm(along, axis=1)
    hits = cKDTree(points).query_ball_point(a + 0.5 * along, distance + 0.5 * length)
    for i, hit in enumerate(hits):
        apart = points[hit] - a[i]
        share = np.clip(apart @ along[i] / max(length[i] ** 2, np.finfo(float).tiny), 0, 1)
        near[hit] |= np.linalg.norm(apart - share[:, None] * along[i], axis=1) < distance
    return near
