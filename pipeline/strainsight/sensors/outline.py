"""The outline of a part as it is drawn: its sharp edges, and where its skin turns away from who looks at it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.mesh.facets import Facets
from strainsight.sensors.edges import edges_of
from strainsight.sensors.faces import facet_vectors

LEVEL = 1e-6
"""Cosine below which a facet is seen from its side."""


@dataclass(frozen=True)
class EdgeLines:
    """The e edges of a skin, each with both facets: path (e, 3, 3) [m] from end through the middle to end; normal (e, 2, 3) of
    the facets left and right of it, unit, twice the same where there is but one; sharp (e,)."""

    path: np.ndarray
    normal: np.ndarray
    sharp: np.ndarray


def edge_lines(position: np.ndarray, facets: Facets) -> EdgeLines:
    """All edges of exterior facets; position (n, 3) [m]."""
    edges = edges_of(position, facets)
    vector = facet_vectors(position, facets)
    size = np.linalg.norm(vector, axis=1, keepdims=True)
    normal = vector / np.where(size > 0, size, 1.0)
    first = edges.start
    second = np.where(edges.count > 1, first + 1, first)
    a, b = (position[edges.ends[first, end]] for end in (0, 1))
    path = np.stack([a, edges.middle[first], b], axis=1)
    return EdgeLines(path, np.stack([normal[edges.facet[first]], normal[edges.facet[second]]], axis=1), edges.sharp)


def seen_from(lines: EdgeLines, toward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What is drawn for a viewer in the direction `toward` (3,): edges in view and edges behind, as segments (s, 2, 3) [m].

    In view is a sharp edge of which a facet faces the viewer, or both are seen from their side, and a smooth one where the skin
    turns away. That one part of the body covers another is not looked for: of a body that is not convex some edges in view are
    hidden in truth.
    """
    facing = lines.normal @ toward
    front, back = facing.max(axis=1), facing.min(axis=1)
    behind = (front <= LEVEL) & (back < -LEVEL)
    turning = (front > LEVEL) & (back <= LEVEL)
    seen = np.where(lines.sharp, ~behind, turning)
    return _segments(lines.path[seen]), _segments(lines.path[lines.sharp & behind])


def _segments(path: np.ndarray) -> np.ndarray:
    return np.concatenate([path[:, :2], path[:, 1:]])
