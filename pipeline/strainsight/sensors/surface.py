"""Geometry of facets: points, tangents and normals at local coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.errors import UserError
from strainsight.mesh.facets import by_kind
from strainsight.mesh.kinds import FACETS
from strainsight.mesh.kinds.kind import Kind

EQUAL_COSINES = 1e-6
"""Largest difference of equal cosines; those of a plane facet normal are rounded to 1e-15."""


def facet_points(kind: Kind, corners: np.ndarray, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """x(ξ) = Σ Nₖ xₖ and its tangents J = ∂x/∂ξ of every facet at its local coordinates ξ.

    corners (m, k, 3) [m] all nodes of the facets; xi (m, 2) [-]. Returns x (m, 3) [m] and J (m, 3, 2) [m]."""
    N, dN = kind.functions(xi)
    return np.einsum("mk,mkc->mc", N, corners), np.einsum("mka,mkc->mca", dN, corners)


def normals(J: np.ndarray) -> np.ndarray:
    """Unit n ∥ ∂x/∂ξ × ∂x/∂η (m, 3), outward by the node order of the facet; zero for a facet without area."""
    n = np.cross(J[..., 0], J[..., 1])
    length = np.linalg.norm(n, axis=-1, keepdims=True)
    size = np.linalg.norm(J, axis=(-2, -1))[..., None]
    flat = length > 1e-10 * size**2
    return np.where(flat, n / np.where(flat, length, 1.0), 0.0)


def facet_frames(
    position: np.ndarray, code: np.ndarray, nodes: np.ndarray, local: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Point x(ξ) (f, 3) [m] and outward unit normal (f, 3) of every facet at its ξ (f, 2); position (n, 3) [m], code (f,) into
    FACETS, nodes (f, 8)."""
    x, n = np.zeros((len(code), 3)), np.zeros((len(code), 3))
    for kind, which, corners in by_kind(code, nodes):
        x[which], J = facet_points(kind, position[corners], local[which])
        n[which] = normals(J)
    return x, n


def facet_centres(position: np.ndarray, code: np.ndarray, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`facet_frames` at the centres of the facets."""
    return facet_frames(position, code, nodes, centres(code))


def centres(kind: np.ndarray) -> np.ndarray:
    """ξ of the centres of facets by their kinds (m,): (m, 2), zero without a facet."""
    table = np.array([*(kind.centre for kind in FACETS), np.zeros(2)])
    return table[np.asarray(kind, dtype=np.int64)]


def unit_vector(
    axis: Sequence[float], what: str, *, key: str | None = None, remedy: str = "Specify three numbers, not all zero."
) -> np.ndarray:
    """Unit vector of an axis (3,). Raises UserError that names the axis if it has zero length."""
    a = np.asarray(axis, dtype=float)
    length = np.linalg.norm(a)
    if a.shape != (3,) or not (np.isfinite(length) and length > 0):
        raise UserError(f"{what} is {tuple(axis)}", key=key, remedy=remedy)
    return np.asarray(a / length)


def farthest_axis(direction: np.ndarray) -> np.ndarray:
    """The coordinate axis (..., 3) with the largest angle to each direction (..., 3), the first of equal ones."""
    along = np.abs(direction)
    return np.asarray(np.eye(3)[np.argmax(along <= along.min(axis=-1, keepdims=True) + EQUAL_COSINES, axis=-1)])


def tangent(direction: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Unit t ∥ v − (v·n) n (m, 3) of directions v (m, 3) that are not along the unit normal n (m, 3)."""
    t = direction - np.sum(direction * n, axis=1)[:, None] * n
    return np.asarray(t / np.linalg.norm(t, axis=1)[:, None])


def angle_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle between vectors (m, 3) [rad], accurate for small and large angles: (m,)."""
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.sum(a * b, axis=1)))


def on_reference(kind: Kind, xi: np.ndarray, slack: float = 0.0) -> np.ndarray:
    """Which points ξ (m, 2) are on the reference domain of a facet, with a tolerance [-]: (m,) bool."""
    if kind.corners == 3:
        return np.asarray((xi.min(axis=1, initial=np.inf) >= -slack) & (xi.sum(axis=1) <= 1 + slack))
    return np.asarray(np.abs(xi).max(axis=1, initial=0.0) <= 1 + slack)


def turned(direction: np.ndarray, n: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """v rotated by α about the unit normal n (Rodrigues): v cos α + n × v sin α + n (n·v)(1 − cos α).

    direction v (m, 3); n (m, 3); angle (m,) [deg], right-handed. Returns (m, 3)."""
    a = np.deg2rad(np.asarray(angle, dtype=float))[:, None]
    along = np.sum(n * direction, axis=1)[:, None]
    return np.cos(a) * direction + np.sin(a) * np.cross(n, direction) + (1 - np.cos(a)) * along * n


def carried(direction: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """v after the smallest rotation of one unit normal to the other, so that directions follow a curved surface.

        w = n₀ × n₁,     v + w × v + w × (w × v) / (1 + n₀·n₁)

    direction v, before n₀, after n₁ (m, 3), n₁ not opposite to n₀. Tangents stay tangent. Returns (m, 3)."""
    w = np.cross(before, after)
    once = np.cross(w, direction)
    return direction + once + np.cross(w, once) / (1 + np.sum(before * after, axis=1))[:, None]
