"""How tightly a surface bends, facet by facet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from strainsight.mesh.facets import Facets
from strainsight.sensors.edges import SHARP
from strainsight.sensors.surface import by_kind, facet_centres, facet_points, farthest_axis, normals


def bend_radius(position: np.ndarray, facets: Facets) -> np.ndarray:
    """The least radius of curvature (f,) [m] of every facet, inf where it is flat:

        dn = S dx,     R = 1 / max |eig S|

    S (2, 2), symmetric, from the normals at the corners of the facet by least squares, each the mean of those of all facets that
    meet at the corner and whose own normal there is within 30° of the facet's: what is sharper is an edge, and no bend
    (Rusinkiewicz, Estimating curvatures and their derivatives on triangle meshes, 3DPVT 2004). A flat facet beside a bend takes
    part of it: the bend is spread over a facet on either side. position (n, 3) [m].
    """
    corners = _corners(position, facets)
    mean = _smooth(corners.node, corners.normal)
    radius = np.full(len(facets.kind), np.inf)
    _, normal = facet_centres(position, facets.kind, facets.nodes)
    e1 = np.cross(normal, farthest_axis(normal))
    length = np.linalg.norm(e1, axis=1, keepdims=True)
    e1 = e1 / np.where(length > 0, length, 1.0)
    plane = np.stack([e1, np.cross(normal, e1)], axis=2)
    for which, rows in corners.of_facets:
        u, v = (_about_the_mean(values[rows]) @ plane[which] for values in (corners.position, mean))
        S = np.linalg.pinv(u) @ v
        bend = np.abs(np.linalg.eigvalsh(0.5 * (S + S.transpose(0, 2, 1)))).max(axis=1)
        size = np.linalg.norm(u, axis=(1, 2))
        bent = bend * size > 1e-6  # below that it is rounding of the nodes
        radius[which[bent]] = 1 / bend[bent]
    return radius


@dataclass(frozen=True)
class _Corners:
    """The corners of all facets, h of them: node (h,), position (h, 3) [m], normal (h, 3) of the facet there; of_facets: of every
    kind of facet the facets (m,) and their corners (m, c)."""

    node: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    of_facets: tuple[tuple[np.ndarray, np.ndarray], ...]


def _corners(position: np.ndarray, facets: Facets) -> _Corners:
    node, normal, of_facets, start = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))], [], 0
    for kind, which, nodes in by_kind(facets.kind, facets.nodes):
        of_facets.append((which, start + np.arange(len(which) * kind.corners).reshape(kind.corners, -1).T))
        for a in range(kind.corners):
            _, J = facet_points(kind, position[nodes], np.tile(kind.nodes[a], (len(nodes), 1)))
            node.append(nodes[:, a])
            normal.append(normals(J))
        start += len(which) * kind.corners
    every = np.concatenate(node)
    return _Corners(every, position[every], np.concatenate(normal), tuple(of_facets))


def _smooth(node: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The mean normal (h, 3) at every corner, over the corners at the same node that face within 30° of it."""
    h = len(node)
    at = csr_array((np.ones(h), (np.arange(h), node)), shape=(h, int(node.max(initial=-1)) + 1))
    pair = (at @ at.T).tocoo()
    one, other = pair.row, pair.col
    alike = np.sum(normal[one] * normal[other], axis=1) > np.cos(SHARP)
    total = np.zeros((h, 3))
    np.add.at(total, one[alike], normal[other[alike]])
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.asarray(total / np.where(length > 0, length, 1.0))


def _about_the_mean(values: np.ndarray) -> np.ndarray:
    return np.asarray(values - values.mean(axis=1, keepdims=True))


def tight(position: np.ndarray, facets: Facets, radius: float) -> np.ndarray:
    """Which facets (f,) bend tighter than a radius [m]."""
    return np.asarray(bend_radius(position, facets) < radius * (1 - 1e-6))


def sides(position: np.ndarray, facets: Facets, chosen: np.ndarray) -> np.ndarray:
    """The straight sides and diagonals of the chosen facets (f,): segments (s, 2, 3) [m]. No point of a facet is farther from
    them than a quarter of its size or so."""
    found = [np.zeros((0, 2, 3))]
    for kind, which, nodes in by_kind(facets.kind, facets.nodes):
        x = position[nodes[chosen[which], : kind.corners]]
        pairs = [(a, b) for a in range(kind.corners) for b in range(a)]
        found += [np.stack([x[:, a], x[:, b]], axis=1) for a, b in pairs]
    return np.concatenate(found)
