"""Where a straight line from the surface of a body meets it again: the other side of it, or what stands over a place."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from strainsight.mesh.kinds import FACETS
from strainsight.sensors.locate import Located, radius_of
from strainsight.sensors.points import normals_at
from strainsight.sensors.surface import by_kind, facet_centres, facet_points, farthest_axis
from strainsight.sensors.walk import Skin, local_at

ON = 1e-7
"""Of the local range: how far outside a facet a point still counts as on it, so that none is lost between two."""


def opposite(skin: Skin, points: np.ndarray, normals: np.ndarray) -> Located:
    """The first exit of the rays x = p − t n, t > 0, through the surface: `_first`.

    points p (k, 3) [m] on the surface; normals n (k, 3) outward there. facet −1 where a ray meets none.
    """
    return _first(skin, points, normals, 1.0, np.inf)


def room_over(skin: Skin, points: np.ndarray, ahead: np.ndarray, reach: float) -> np.ndarray:
    """How far (k,) [m] the rays x = p + t r, t > 0, go outside the body before they enter it, by `_first`; inf where they do not
    within a reach [m].

    points p (k, 3) [m] on the surface; r ahead (k, 3) unit, outward there.
    """
    distance = _first(skin, points, -np.asarray(ahead, dtype=float), -1.0, reach).distance
    return np.asarray(np.where(distance <= reach, distance, np.inf))


def _first(skin: Skin, points: np.ndarray, normals: np.ndarray, way: float, reach: float) -> Located:
    """Where the rays x = p − t n, t > 0, first leave the body (way 1), or enter it (−1):

        (x(ξ) − p)·[e₁, e₂] = 0,   e₁, e₂ across n,     way n′·n < 0,     the least t

    Rays go on step by step, each of the size of the largest facet, among the facets whose spheres come near to that step, up to
    the first step beyond the reach [m]. Of facets met at one t (a common edge) the first counts.
    """
    k = len(points)
    centre, _ = facet_centres(skin.position, skin.facets.kind, skin.facets.nodes)
    radius, tree = radius_of(skin, centre), cKDTree(centre)
    step = float(radius.max())
    far = float(np.linalg.norm(np.ptp(skin.position, axis=0))) + step
    facet, local, t = np.full(k, -1), np.zeros((k, 2)), np.full(k, np.inf)
    active = np.arange(k)
    for number in range(int(np.ceil(min(far, reach) / step))):
        if not len(active):
            break
        middle = points[active] - (number + 0.5) * step * normals[active]
        near = tree.query_ball_point(middle, np.full(len(middle), 1.5 * step * (1 + ON)))
        of = np.repeat(active, [len(own) for own in near])
        asked = np.concatenate([np.sort(np.asarray(own, dtype=np.int64)) for own in near])
        away = centre[asked] - points[of]
        aside = np.linalg.norm(away - np.sum(away * normals[of], axis=1)[:, None] * normals[of], axis=1)
        worth = aside <= radius[asked] * (1 + ON)
        xi, at, leaves = _met(skin, points, normals, of[worth], asked[worth], way)
        of, asked = of[worth], asked[worth]
        # What is farther than this step is asked again in its own, among all that may be there.
        order = np.flatnonzero(leaves & (at > 0) & (at <= (number + 1) * step))
        order = order[np.lexsort((asked[order], np.round(at[order] / (1e-9 * step)), of[order]))]
        first = order[np.flatnonzero(np.diff(of[order], prepend=-1) != 0)]
        facet[of[first]], local[of[first]], t[of[first]] = asked[first], xi[first], at[first]
        active = active[facet[active] < 0]
    there = facet >= 0
    x = np.full((k, 3), np.nan)
    for kind, which, nodes in by_kind(skin.facets.kind[facet[there]], skin.facets.nodes[facet[there]]):
        own = np.flatnonzero(there)[which]
        x[own], _ = facet_points(kind, skin.position[nodes], local[own])
    return Located(facet, local, x, t)


def _met(
    skin: Skin, points: np.ndarray, normals: np.ndarray, of: np.ndarray, facet: np.ndarray, way: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """ξ (q, 2) and t (q,) [m] at which rays `of` (q,) meet facets (q,), and whether they leave the body there (q,), or, way −1,
    enter it."""
    n = normals[of]
    e1 = np.cross(n, farthest_axis(n))
    e1 /= np.linalg.norm(e1, axis=1)[:, None]
    plane = np.stack([e1, np.cross(n, e1)], axis=1)
    xi, found = local_at(skin, facet, points[of], plane, np.zeros((len(of), 2)))
    x = np.zeros((len(of), 3))
    for kind, which, nodes in by_kind(skin.facets.kind[facet], skin.facets.nodes[facet]):
        x[which], _ = facet_points(kind, skin.position[nodes], xi[which])
    simplex = np.array([kind.corners == 3 for kind in FACETS])[skin.facets.kind[facet]]
    triangle = (xi.min(axis=1, initial=np.inf) >= -ON) & (xi.sum(axis=1) <= 1 + ON)
    found &= np.where(simplex, triangle, np.abs(xi).max(axis=1, initial=0.0) <= 1 + ON)
    found &= way * np.sum(normals_at(skin, facet, xi) * n, axis=1) < -1e-9
    return xi, np.sum((points[of] - x) * n, axis=1), found
