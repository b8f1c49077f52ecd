"""Sharp edges of a surface, and what lies near them."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from strainsight.fem.elements import REFERENCE_NODES
from strainsight.gauges.surface import by_kind, facet_points, normals
from strainsight.mesh.facets import CORNERS, Facets

SHARP = np.deg2rad(30.0)


def sharp_edges(position: np.ndarray, facets: Facets) -> np.ndarray:
    """Edges where two exterior facets meet at more than 30°, or more than two do: segments (s, 2, 3) [m].

    The normals are taken at the middle of the edge, so that a coarsely meshed curved surface is smooth if its facets
    are quadratic; a quadratic edge gives two segments. position (n, 3) [m].
    """
    ends, middles, normal = [], [], []
    for name, _, nodes in by_kind(facets.kind, facets.nodes):
        corners = CORNERS[name]
        for a in range(corners):
            b = (a + 1) % corners
            xi = 0.5 * (REFERENCE_NODES[name][a] + REFERENCE_NODES[name][b])
            x, J = facet_points(name, position[nodes], np.tile(xi, (len(nodes), 1)))
            ends.append(np.sort(nodes[:, [a, b]], axis=1))
            middles.append(x)
            normal.append(normals(J))
    if not ends:
        return np.zeros((0, 2, 3))
    pairs, middle, n = np.concatenate(ends), np.concatenate(middles), np.concatenate(normal)
    edge, first, inverse, count = np.unique(pairs, axis=0, return_index=True, return_inverse=True, return_counts=True)
    order = np.argsort(inverse.ravel(), kind="stable")
    start = np.concatenate([[0], np.cumsum(count)[:-1]])
    two = count == 2
    angle = np.full(len(edge), np.pi)
    left, right = n[order[start[two]]], n[order[start[two] + 1]]
    angle[two] = np.arctan2(np.linalg.norm(np.cross(left, right), axis=1), np.sum(left * right, axis=1))
    sharp = angle > SHARP
    a, b, m = position[edge[sharp, 0]], position[edge[sharp, 1]], middle[first[sharp]]
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
