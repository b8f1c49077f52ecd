"""Triangles, mesh lines and the side to look from: what a picture needs to know of a structure."""

from __future__ import annotations

import numpy as np

from strainsight.pages.arrays import FloatArray, IntArray

# Local node triples by number of facet nodes, in VTK order; facets with mid-side nodes are cut along them.
TRIANGLES = {
    3: ((0, 1, 2),),
    4: ((0, 1, 2), (0, 2, 3)),
    6: ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
    8: ((0, 4, 7), (4, 1, 5), (5, 2, 6), (6, 3, 7), (4, 5, 6), (4, 6, 7)),
}
OUTLINE = {3: (0, 1, 2), 4: (0, 1, 2, 3), 6: (0, 3, 1, 4, 2, 5), 8: (0, 4, 1, 5, 2, 6, 3, 7)}


def triangles(faces: IntArray) -> IntArray:
    """Triangles (t, 3) of facets (f, 8) padded with −1, in the facets' own orientation."""
    count = np.sum(faces >= 0, axis=1)
    parts = [faces[count == k][:, np.array(local)].reshape(-1, 3) for k, local in TRIANGLES.items()]
    return np.concatenate(parts)


def facet_of_triangle(faces: IntArray) -> IntArray:
    """The facet (t,) that each of these triangles comes from."""
    count = np.sum(faces >= 0, axis=1)
    return np.concatenate([np.repeat(np.flatnonzero(count == k), len(local)) for k, local in TRIANGLES.items()])


def areas(points: FloatArray, faces: IntArray) -> FloatArray:
    """Area (f,) [m²] of each facet, that of its triangles."""
    a, b, c = (points[column] for column in triangles(faces).T)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return np.asarray(np.bincount(facet_of_triangle(faces), weights=area, minlength=len(faces)), dtype=float)


def mesh_lines(faces: IntArray) -> IntArray:
    """The facets' outlines (l, 2), through their mid-side nodes, each line once."""
    count = np.sum(faces >= 0, axis=1)
    parts = []
    for k, local in OUTLINE.items():
        ring = faces[count == k][:, np.array(local)]
        parts.append(np.stack([ring, np.roll(ring, -1, axis=1)], axis=2).reshape(-1, 2))
    low, high = np.sort(np.concatenate(parts), axis=1).T
    span = int(faces.max(initial=0)) + 1
    return np.column_stack(np.divmod(np.unique(low * span + high), span))


def hit_by_ray(points: FloatArray, triangle: IntArray, origin: FloatArray, direction: FloatArray) -> bool:
    """Whether the ray origin + s·direction, s > 0, meets any triangle (Möller and Trumbore, 1997)."""
    a, b, c = points[triangle[:, 0]], points[triangle[:, 1]], points[triangle[:, 2]]
    p = np.cross(direction, c - a)
    det = np.einsum("ij,ij->i", b - a, p)
    met = np.abs(det) > 1e-14 * np.abs(det).max(initial=1e-300)
    inverse = 1.0 / np.where(met, det, 1.0)
    t = origin - a
    u = np.einsum("ij,ij->i", t, p) * inverse
    q = np.cross(t, b - a)
    v = q @ direction * inverse
    s = np.einsum("ij,ij->i", c - a, q) * inverse
    return bool(np.any(met & (u >= 0) & (v >= 0) & (u + v <= 1) & (s > 0)))


def seen_from(
    points: FloatArray, triangle: IntArray, position: FloatArray, normal: FloatArray, view: FloatArray
) -> IntArray:
    """Which gauges an eye in direction `view` (3,) sees: facing it and with nothing in between.

    position, normal (g, 3), zero where a gauge lies on no surface and faces every way. Returns (g,) 0 or 1.
    """
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    seen = (normal @ view > 0.12) | ~np.any(normal, axis=1)
    if not seen.any():
        return seen.astype(int)
    # Only triangles whose shadow along the view holds the gauge can hide it.
    plane = np.linalg.svd(view[None])[2][1:].T
    shadow = points @ plane
    a, b, c = (shadow[triangle[:, k]] for k in range(3))
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    for i in np.flatnonzero(seen):
        origin = position[i] + 1e-4 * size * (normal[i] if np.any(normal[i]) else view)
        near = ((low <= origin @ plane) & (origin @ plane <= high)).all(axis=1)
        seen[i] = not hit_by_ray(points, triangle[near], origin, view)
    return seen.astype(int)


def views(points: FloatArray, triangle: IntArray, position: FloatArray, normal: FloatArray) -> tuple[FloatArray, ...]:
    """One or two directions to look from: the corner that shows most gauges and, if it misses some, one for those.

    The first of equals wins, and corners above the structure come first: people expect to look down on it.
    """
    extent = np.ptp(points, axis=0)
    long = int(np.argmax(extent))
    # Look less along the longest axis, so that a beam does not shrink to its end face.
    weight = np.array([1.0, 1.0, 0.8])
    if extent[long] > 2.5 * np.sort(extent)[1]:
        weight[long] = 0.25
    corners = [np.array([x, y, z]) * weight for z in (1, -1) for x, y in ((1, -1), (-1, -1), (1, 1), (-1, 1))]
    corners = [corner / np.linalg.norm(corner) for corner in corners]
    seen = np.array([seen_from(points, triangle, position, normal, corner) for corner in corners])
    first = int(np.argmax(seen.sum(axis=1)))
    missed = seen[first] == 0
    if not missed.any() or not seen[:, missed].any():
        return (corners[first],)
    return corners[first], corners[int(np.argmax(seen[:, missed].sum(axis=1)))]


def at_points(values: FloatArray, faces: IntArray, points: int) -> FloatArray:
    """Values (f,) of facets (f, 8), padded with −1, as the mean of the facets about every point (n,); NaN where none is."""
    facet, column = np.nonzero(faces >= 0)
    node = faces[facet, column]
    many = np.bincount(node, minlength=points)
    total = np.bincount(node, weights=values[facet], minlength=points)
    return np.where(many > 0, total / np.maximum(many, 1), np.nan)
