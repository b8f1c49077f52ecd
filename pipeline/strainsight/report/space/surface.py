"""The surface of a structure as few triangles as one looks at, with normals that are sharp at its creases."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from strainsight.report.arrays import FloatArray, IntArray
from strainsight.report.picture.geometry import mesh_lines, triangles
from strainsight.report.picture.markers import surface_mesh

LARGEST = 20_000
"""Triangles: more would make the page heavy and look the same."""
MOST_LINES = 30_000
"""Mesh lines: more would turn the surface black."""
CREASE = 30.0
"""Between facets that meet at a larger angle [deg] the surface has an edge."""
CORNERS = {3: 3, 4: 4, 6: 3, 8: 4}


@dataclass(frozen=True)
class Surface:
    """position (v, 3) [m], normal (v, 3) unit vectors; triangle (t, 3), line (l, 2), crease (c, 2): indices into them;
    source (v,): which point of the structure a vertex stands for; thinned: whether triangles were merged."""

    position: FloatArray
    normal: FloatArray
    triangle: IntArray
    line: IntArray
    crease: IntArray
    source: IntArray
    thinned: bool


def surface(points: FloatArray, faces: IntArray, largest: int = LARGEST) -> Surface:
    """points (n, 3) [m], faces (f, 8) padded with −1 → what is drawn of them: at most about `largest` triangles.

    Too many are first drawn without their mid-side nodes, then merged by quadric errors (Garland and Heckbert, 1997).
    """
    triangle = triangles(faces)
    if not len(triangle):
        nothing, none = np.empty((0, 3)), np.empty((0, 2), dtype=np.int64)
        return Surface(nothing, nothing, triangle, none, none, np.empty(0, dtype=np.int64), False)
    lines = mesh_lines(faces)
    if len(triangle) > largest:
        faces = straight(faces)
        triangle, lines = triangles(faces), mesh_lines(faces)
    body = _body(points, triangle)
    thinned = len(triangle) > largest
    if thinned:
        body = body.decimate(1 - largest / len(triangle))
        body.point_data["source"] = _nearest(points[np.unique(triangle)], np.unique(triangle), body.points)
    shaded = body.compute_normals(
        cell_normals=False, split_vertices=True, feature_angle=CREASE, consistent_normals=False,
        auto_orient_normals=False,
    )  # fmt: skip
    source = np.asarray(shaded.point_data["source"], dtype=np.int64)
    position = np.asarray(shaded.points, dtype=float)
    edges = body.extract_feature_edges(CREASE, manifold_edges=False, non_manifold_edges=False)
    return Surface(
        position,
        np.asarray(shaded.point_data["Normals"], dtype=float),
        shaded.faces.reshape(-1, 4)[:, 1:],
        np.empty((0, 2), int) if thinned or len(lines) > MOST_LINES else _at(source, lines),
        _nearest(position, np.arange(len(position)), edges.points)[edges.lines.reshape(-1, 3)[:, 1:]],
        source,
        thinned,
    )


def straight(faces: IntArray) -> IntArray:
    """Facets (f, 8) without their mid-side nodes."""
    count = np.sum(faces >= 0, axis=1)
    corners = np.array([CORNERS.get(k, k) for k in range(9)])[count]
    return np.where(np.arange(faces.shape[1]) < corners[:, None], faces, -1)


def _body(points: FloatArray, triangle: IntArray) -> Any:
    """PyVista's surface of the points that triangles have, which remember where they come from."""
    used, local = np.unique(triangle, return_inverse=True)
    body = surface_mesh(points[used], local.reshape(triangle.shape))
    body.point_data["source"] = used
    return body


def _nearest(points: FloatArray, numbers: IntArray, wanted: FloatArray) -> IntArray:
    """The number of the point that is nearest to each wanted one."""
    from scipy.spatial import cKDTree

    if not len(wanted):
        return np.empty(0, dtype=np.int64)
    return np.asarray(numbers[cKDTree(points).query(wanted)[1]], dtype=np.int64)


def _at(source: IntArray, lines: IntArray) -> IntArray:
    """Lines between points as lines between the vertices that stand for them (the first of several)."""
    known, first = np.unique(source, return_index=True)
    return np.asarray(first[np.searchsorted(known, lines)], dtype=np.int64)
