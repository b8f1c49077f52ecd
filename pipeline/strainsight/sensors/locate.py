"""The nearest point of a surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from strainsight.mesh.kinds.kind import Kind
from strainsight.sensors.surface import by_kind, facet_centres, facet_points
from strainsight.sensors.walk import Skin

FIRST = 6
"""Facets by their centres that give a first bound on the distance."""
REACH = 1.3
"""How far a bent facet may reach beyond its nodes, as a share of their distance from its centre."""


@dataclass(frozen=True)
class Located:
    """facet (p,) index; local (p, 2) ξ there; point (p, 3) [m] of the surface; distance (p,) [m] to it."""

    facet: np.ndarray
    local: np.ndarray
    point: np.ndarray
    distance: np.ndarray


def locate(skin: Skin, points: np.ndarray) -> Located:
    """The point of the surface nearest to each of the points (p, 3) [m].

    The nearest of a few facets bounds the distance from above; every facet whose sphere comes nearer is then projected onto,
    so that a large facet beside small ones is not missed. Of facets equally near (to 1e-9 of their size) the first counts.
    """
    centre, _ = facet_centres(skin.position, skin.facets.kind, skin.facets.nodes)
    radius = radius_of(skin, centre)
    tree = cKDTree(centre)
    _, some = tree.query(points, k=min(FIRST, len(centre)))
    pair_point = np.repeat(np.arange(len(points)), some.size // max(1, len(points)))
    best = _nearest(skin, points, pair_point, some.ravel())
    # Twice the rounding of the bound, so that the facet which gave it stays among those asked.
    bound = best.distance * (1 + 1e-9) + 1e-12 * radius.max()
    near = tree.query_ball_point(points, bound + radius.max())
    pair_point = np.repeat(np.arange(len(points)), [len(facets) for facets in near])
    pair_facet = np.concatenate([np.sort(np.asarray(facets, dtype=np.int64)) for facets in near])
    apart = np.linalg.norm(points[pair_point] - centre[pair_facet], axis=1)
    worth = apart - radius[pair_facet] <= bound[pair_point]
    return _nearest(skin, points, pair_point[worth], pair_facet[worth])


def radius_of(skin: Skin, centre: np.ndarray) -> np.ndarray:
    """Radius (f,) [m] of a sphere about the centre (f, 3) of each facet that all of it lies in."""
    radius = np.zeros(len(centre))
    for kind, which, nodes in by_kind(skin.facets.kind, skin.facets.nodes):
        far = np.linalg.norm(skin.position[nodes] - centre[which, None], axis=2).max(axis=1)
        radius[which] = far * (REACH if kind.edges else 1.0)
    return radius


def _nearest(skin: Skin, points: np.ndarray, of: np.ndarray, facet: np.ndarray) -> Located:
    """The best facet of every point among pairs of a point (k,) and a facet (k,)."""
    local, x = np.zeros((len(of), 2)), np.zeros((len(of), 3))
    for kind, which, nodes in by_kind(skin.facets.kind[facet], skin.facets.nodes[facet]):
        local[which], x[which] = project(kind, skin.position[nodes], points[of[which]])
    distance = np.linalg.norm(x - points[of], axis=1)
    step = 1e-9 * skin.size[facet].max(initial=1e-300)
    order = np.lexsort((facet, np.round(distance / step), of))
    first = order[np.flatnonzero(np.diff(of[order], prepend=-1) != 0)]
    return Located(facet[first], local[first], x[first], distance[first])


def project(kind: Kind, corners: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """ξ (k, 2) and x(ξ) (k, 3) of the point of each facet, its edges included, that is nearest to its point (k, 3).

    Inside, Newton's method for min |x(ξ) − p|² from the nearest of a few samples; on every edge, a parabola in t, the same in
    one dimension. corners (k, n, 3) [m] all nodes of the facets.
    """
    local, best = _inside(kind, corners, points)
    x, _ = facet_points(kind, corners, local)
    least = np.linalg.norm(x - points, axis=1)
    least[~best] = np.inf
    reference, count = kind.nodes, kind.corners
    for a in range(count):
        b = (a + 1) % count
        left, right = corners[:, a], corners[:, b]
        mean = 0.5 * (left + right)
        middle = corners[:, count + a] if kind.edges else mean
        t = _along(middle - points, 0.5 * (right - left), mean - middle)
        xi = 0.5 * (reference[a] + reference[b]) + 0.5 * t[:, None] * (reference[b] - reference[a])
        at, _ = facet_points(kind, corners, xi)
        apart = np.linalg.norm(at - points, axis=1)
        nearer = apart < least
        local[nearer], x[nearer], least[nearer] = xi[nearer], at[nearer], apart[nearer]
    return local, x


def _along(c: np.ndarray, b: np.ndarray, a: np.ndarray) -> np.ndarray:
    """t (k,) in [−1, 1] that minimises |c + b t + a t²|, all (k, 3): Newton from the least of nine samples."""
    samples = np.linspace(-1, 1, 9)
    value = c[:, None] + b[:, None] * samples[:, None] + a[:, None] * samples[:, None] ** 2
    t = samples[np.argmin(np.sum(value**2, axis=2), axis=1)]
    for _ in range(15):
        x, dx = c + b * t[:, None] + a * t[:, None] ** 2, b + 2 * a * t[:, None]
        slope, flat = np.sum(x * dx, axis=1), np.sum(dx * dx, axis=1)
        bend = flat + 2 * np.sum(x * a, axis=1)
        bend = np.where(bend > 0.1 * flat, bend, flat)
        t = np.clip(t - slope / np.where(bend > 0, bend, 1.0), -1, 1)
    return t


def _inside(kind: Kind, corners: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """ξ (k, 2) of the nearest point of the facet's interior, and whether it is one (k,)."""
    simplex, line = kind.corners == 3, (np.arange(4) + 0.5) / 4
    if simplex:
        samples = np.array([(u, v) for u in line for v in line if u + v < 1])
    else:
        samples = np.array([(u, v) for u in 2 * line - 1 for v in 2 * line - 1])
    apart = np.stack([facet_points(kind, corners, np.tile(s, (len(corners), 1)))[0] - points for s in samples], axis=1)
    xi = samples[np.argmin(np.sum(apart**2, axis=2), axis=1)]
    for _ in range(20):
        x, J = facet_points(kind, corners, xi)
        miss = x - points
        slope = np.einsum("kca,kc->ka", J, miss)
        flat = np.swapaxes(J, 1, 2) @ J
        H = flat + _bend(kind, corners, xi, miss)
        trace, det = np.trace(H, axis1=1, axis2=2), np.linalg.det(H)
        sound = (trace > 0) & (det > 1e-3 * np.linalg.det(flat))
        H = np.where(sound[:, None, None], H, flat)
        H = np.where((np.abs(np.linalg.det(H)) > 1e-300)[:, None, None], H, np.eye(2))
        step = np.clip(np.linalg.solve(H, -slope[..., None])[..., 0], -0.5, 0.5)
        xi = np.clip(xi + step, -0.05 if simplex else -1.05, 1.05)
    within = (xi.min(axis=1) >= 0) & (xi.sum(axis=1) <= 1) if simplex else np.abs(xi).max(axis=1) <= 1
    return xi, within


def _bend(kind: Kind, corners: np.ndarray, xi: np.ndarray, miss: np.ndarray) -> np.ndarray:
    """(x − p)·∂²x/∂ξ∂ξ (k, 2, 2); central differences of the gradients, which are polynomials of degree 2, are exact."""
    second = []
    for b in np.eye(2):
        ahead, behind = kind.gradient(xi + 0.5 * b), kind.gradient(xi - 0.5 * b)
        second.append(np.einsum("kna,knc,kc->ka", ahead - behind, corners, miss))
    H = np.stack(second, axis=2)
    return 0.5 * (H + np.swapaxes(H, 1, 2))
