"""Points of lines and surfaces, straight or curved, that are nearest to others."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from strainsight.mesh.kinds import FACETS
from strainsight.mesh.kinds.kind import Values, barycentric, quadratic_simplex
from strainsight.mesh.model import FloatArray, IntArray

STEPS = 20
"""Of Gauss-Newton; a facet that is not strongly bent takes three."""
CHUNK = 16384
"""Points at a time."""
LINE, BENT = len(FACETS), len(FACETS) + 1
"""Codes of lines of two nodes, and of those with a third between them; surfaces have their place in FACETS."""


@dataclass(frozen=True)
class Feet:
    """Points of elements: N (m, k) [-] there, dN (m, k, d) [-] along the coordinates of the element, x (m, 3) [m], and how far
    they are from the points that they are nearest to, apart (m,) [m]."""

    N: FloatArray
    dN: FloatArray
    x: FloatArray
    apart: FloatArray


def nearest(code: int, nodes: FloatArray, point: FloatArray) -> Feet:
    """The points of elements, of nodes (m, k, 3) [m], that are nearest to others (m, 3) [m], one each: Gauss-Newton on
    |x(ξ) − x|², ξ kept in the element."""
    functions, centre, square = _reference(code)
    xi = np.repeat(centre[None], len(point), axis=0)
    for start in range(0, len(point), CHUNK):
        left = np.arange(start, min(start + CHUNK, len(point)))
        for _ in range(STEPS):
            N, dN = functions(xi[left])
            J = np.einsum("mac,mad->mcd", nodes[left], dN)
            off = point[left] - np.einsum("ma,mac->mc", N, nodes[left])
            A = np.einsum("mci,mcj->mij", J, J)
            # a side without length has no direction to go in
            ridge = 1e-14 * np.trace(A, axis1=1, axis2=2) + np.finfo(float).tiny
            A += ridge[:, None, None] * np.eye(A.shape[1])
            step = np.linalg.solve(A, np.einsum("mci,mc->mi", J, off)[..., None])[..., 0]
            new = _within(xi[left] + step, square)
            moved = np.abs(new - xi[left]).max(axis=1) >= 1e-14
            xi[left] = new
            left = left[moved]
            if not len(left):
                break
    N, dN = functions(xi)
    x = np.einsum("ma,mac->mc", N, nodes)
    return Feet(N, dN, x, np.linalg.norm(x - point, axis=1))


def normals(nodes: FloatArray, dN: FloatArray) -> FloatArray:
    """Unit normals (m, 3) of surfaces of nodes (m, k, 3) where the slopes are dN (m, k, 2); zero where they have none."""
    t = np.einsum("mac,mad->mdc", nodes, dN)
    n = np.cross(t[:, 0], t[:, 1])
    length = np.linalg.norm(n, axis=1)[:, None]
    return np.divide(n, length, out=np.zeros_like(n), where=length > 0)


def at_centre(code: int) -> Values:
    """N (k,) and ∂N/∂ξ (k, d) at the centre of an element."""
    functions, centre, _ = _reference(code)
    N, dN = functions(centre[None])
    return N[0], dN[0]


def near_pairs(points: FloatArray, centre: FloatArray, radius: FloatArray) -> Iterator[tuple[IntArray, IntArray]]:
    """Pairs (m,) of a centre and a point no farther from it than its radius, in parts of centres of like size."""
    tree = cKDTree(points)
    size = np.floor(np.log2(np.maximum(radius, np.finfo(float).tiny)))
    for one in np.unique(size):
        some = np.flatnonzero(size == one)
        found = cKDTree(centre[some]).sparse_distance_matrix(tree, radius[some].max(), output_type="ndarray")
        close = found["v"] <= radius[some][found["i"]]
        yield some[found["i"][close]], found["j"][close].astype(np.int64)


def _reference(code: int) -> tuple[Callable[[FloatArray], Values], FloatArray, bool]:
    if code == LINE:
        return barycentric, np.full(1, 0.5), False
    if code == BENT:
        return partial(quadratic_simplex, edges=((0, 1),)), np.full(1, 0.5), False
    kind = FACETS[code]
    return kind.functions, np.asarray(kind.centre, dtype=float), kind.corners == 4


def _within(xi: FloatArray, square: bool) -> FloatArray:
    if square:
        return np.clip(xi, -1, 1)
    xi = np.clip(xi, 0, 1)
    over = np.maximum(0.0, xi.sum(axis=1) - 1) / xi.shape[1]
    return np.clip(xi - over[:, None], 0, 1)
