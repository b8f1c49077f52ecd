"""How far a gauge sits from the edges of its face, and how it is turned against them: what a workshop measures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from strainsight.mesh.facets import Facets, facet_key
from strainsight.sensors.edges import Edges, edges_of

ALIKE = 1e-6
"""Distances that differ by less than this share are alike."""
ACROSS = np.cos(np.deg2rad(45.0))
"""The second edge is turned by more than 45° against the first."""
OFF = np.sin(np.deg2rad(30.0))
"""The way to it leaves the tangent plane by less than 30°: else it runs through the body, round which nobody measures."""


@dataclass(frozen=True)
class EdgeDimensions:
    """Of k places the nearest edge of the face, and the nearest of those that run across it; NaN where there is none.

    distance (k, 2) [m] in a straight line; foot (k, 2, 3) [m] nearest point of the edge; along (k, 2, 3) unit vector of the edge,
    laid on the surface, NaN where it is along the normal; angle (k, 2) [deg] from the edge to the measuring direction,
    right-handed about the outward normal, in (−90, 90], NaN of a direction along the normal.
    """

    distance: np.ndarray
    foot: np.ndarray
    along: np.ndarray
    angle: np.ndarray


def edge_dimensions(
    position: np.ndarray,
    facets: Facets,
    on: np.ndarray,
    points: np.ndarray,
    directions: np.ndarray,
    normals: np.ndarray,
) -> EdgeDimensions:
    """The nearest two edges of the face on which each place lies.

    A face ends at sharp edges, where facets meet at more than 30° or an edge is not of two (`edges_of`). With t the edge, n the
    normal, d the direction:

        α = atan2((t × d)·n, t·d)   in (−90°, 90°], as an edge has no sense

    The second edge is one whose perpendicular through the place meets it, turned against the first by more than 45°, at most 30°
    out of the tangent plane.
    position (n, 3) [m] of nodes; facets: exterior ones; on (k,): key of the facet below each place, one that is not there has
    no edges; points (k, 3) [m]; directions, normals (k, 3) unit.
    """
    edges = edges_of(position, facets)
    face = _smooth_faces(len(facets.kind), edges)
    index = {int(key): i for i, key in enumerate(facets.key)}
    of = np.array([face[index[int(key)]] if int(key) in index else -1 for key in on], dtype=np.int64)
    found = no_edges(len(points))
    for own in np.unique(of[of >= 0]):
        segments = _rim(position, edges, face == own)
        for i in np.flatnonzero(of == own):
            for j, (d, x, t) in enumerate(_nearest_two(segments, points[i], normals[i])):
                found.distance[i, j], found.foot[i, j], found.along[i, j] = d, x, t
                found.angle[i, j] = angle_from(t, directions[i], normals[i])
    return found


def no_edges(count: int) -> EdgeDimensions:
    """Of places without any."""
    nothing = (np.full((count, 2), np.nan), np.full((count, 2, 3), np.nan))
    return EdgeDimensions(nothing[0], nothing[1], nothing[1].copy(), nothing[0].copy())


def facet_keys(element: np.ndarray, facet: np.ndarray) -> np.ndarray:
    """Keys (k,) of facets by element ids and local numbers (k,), −1 of what lies on none (facet 0)."""
    return np.where(np.asarray(facet) > 0, facet_key(np.asarray(element), np.asarray(facet)), -1)


def angle_from(t: np.ndarray, d: np.ndarray, n: np.ndarray) -> float:
    """From the line t to the line d [deg], right-handed about n: in (−90, 90]; NaN where t is, and of a d along n or of no
    length, which has no angle on the surface."""
    if np.linalg.norm(np.cross(d, n)) <= ALIKE:
        return float("nan")
    angle = float(np.rad2deg(np.arctan2(np.cross(t, d) @ n, t @ d)))
    rounded = round(angle, 9)
    return angle + 180.0 * (rounded <= -90.0) - 180.0 * (rounded > 90.0)


def _smooth_faces(count: int, edges: Edges) -> np.ndarray:
    """Number of the face of every facet (count,)."""
    first = edges.start[~edges.sharp]
    left, right = edges.facet[first], edges.facet[first + 1]
    pairs = coo_array((np.ones(len(left)), (left, right)), shape=(count, count))
    return np.asarray(connected_components(pairs, directed=False)[1])


def _rim(position: np.ndarray, edges: Edges, chosen: np.ndarray) -> np.ndarray:
    """Sharp edges of the chosen facets, through their middle: segments (s, 2, 3) [m]."""
    sharp = np.repeat(edges.sharp, edges.count) & chosen[edges.facet]
    a, b = position[edges.ends[sharp, 0]], position[edges.ends[sharp, 1]]
    m = edges.middle[sharp]
    return np.concatenate([np.stack([a, m], axis=1), np.stack([m, b], axis=1)])


def _nearest_two(
    segments: np.ndarray, point: np.ndarray, normal: np.ndarray
) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """(distance, foot, unit vector along the edge on the surface) of the nearest edge and of the nearest across it."""
    if not len(segments):
        return []
    a, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    length = np.linalg.norm(along, axis=1)
    share = np.sum((point - a) * along, axis=1) / np.maximum(length**2, np.finfo(float).tiny)
    foot = a + np.clip(share, 0, 1)[:, None] * along
    distance = np.linalg.norm(foot - point, axis=1)
    flat = along - np.outer(along @ normal, normal)
    size = np.linalg.norm(flat, axis=1)
    # Where a corner is nearest, of the edges that meet there the one that lies most on the surface.
    lying = size / np.maximum(length, np.finfo(float).tiny)
    with np.errstate(invalid="ignore", divide="ignore"):
        t = np.where(lying[:, None] > ALIKE, flat / size[:, None], np.nan)

    def best(allowed: np.ndarray) -> int:
        near = allowed & (distance <= distance[allowed].min() * (1 + ALIKE))
        return int(np.flatnonzero(near & (lying >= lying[near].max() - ALIKE))[0])

    first = best(np.ones(len(segments), dtype=bool))
    found = [first]
    with np.errstate(invalid="ignore"):
        turned = np.abs(t @ t[first]) < ACROSS
    lies = np.abs((foot - point) @ normal) <= OFF * distance
    across = turned & lies & (share >= -ALIKE) & (share <= 1 + ALIKE)
    if across.any():
        found.append(best(across))
    return [(float(distance[i]), foot[i], t[i]) for i in found]
