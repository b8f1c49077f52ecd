"""Enclosed surfaces: facets from which almost no straight way leads out of the part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from strainsight.compiled import kept
from strainsight.mesh.facets import Facets, by_kind
from strainsight.sensors.candidates import Candidates
from strainsight.sensors.surface_paths import Skin

SEEN = 0.05
"""Least view factor of the outside. In a long tube it is 0.06 one diameter from the open end, 0.01 two diameters from it."""
OCTANT = 16
"""Directions in an octant; with their mirror images they are symmetric about the global coordinate planes."""
GOLDEN = 0.6180339887498949
"""Golden ratio less 1: turn of a Fibonacci lattice."""
LEAF = 4
"""Largest number of triangles in a leaf of the tree."""
ON = 1e-9
"""Margin of facets, and distance of a point that lies on one, as a share of the size of the part."""


@dataclass(frozen=True)
class RayTree:
    """Triangles of a surface in a binary tree of boxes: node i has the children 2i and 2i + 1, the last half are leaves.

    low, high (2l, 3) [m] corners of the boxes; start (l + 1,) first triangle of each leaf; corner (t, 3) [m] of the triangles and
    side (t, 2, 3) [m] from it; owner (t,): facet of each; centre (f, 3) [m] of the corners of each facet; margin [m]."""

    low: np.ndarray
    high: np.ndarray
    start: np.ndarray
    corner: np.ndarray
    side: np.ndarray
    owner: np.ndarray
    centre: np.ndarray
    margin: float


def ray_tree(position: np.ndarray, facets: Facets) -> RayTree:
    """The tree of a surface; position (n, 3) [m]. Facets are plane between their corners; quadrilaterals are two triangles."""
    centre, triangles, owners = np.zeros((len(facets.kind), 3)), [], []
    for kind, which, nodes in by_kind(facets.kind, facets.nodes):
        x = position[nodes[:, : kind.corners]]
        centre[which] = x.mean(axis=1)
        for last in range(2, kind.corners):
            triangles.append(x[:, [0, last - 1, last]])
            owners.append(which)
    x, owner = np.concatenate(triangles), np.concatenate(owners)
    order = cKDTree(x.mean(axis=1), leafsize=1).indices
    x, owner, count = x[order], owner[order], len(order)
    leaves = 1 << max(int(np.ceil(np.log2(count / LEAF))), 0)
    start = np.arange(leaves + 1) * count // leaves
    margin = ON * float(np.ptp(x, axis=(0, 1)).max())
    low, high = np.zeros((2, 2 * leaves, 3))
    low[leaves:] = np.minimum.reduceat(x.min(axis=1), start[:-1]) - margin
    high[leaves:] = np.maximum.reduceat(x.max(axis=1), start[:-1]) + margin
    while leaves > 1:
        pairs, leaves = slice(leaves, 2 * leaves), leaves // 2
        low[leaves : 2 * leaves] = low[pairs].reshape(-1, 2, 3).min(axis=1)
        high[leaves : 2 * leaves] = high[pairs].reshape(-1, 2, 3).max(axis=1)
    return RayTree(low, high, start, x[:, 0], x[:, 1:] - x[:, :1], owner, centre, margin)


def sees_outside(
    tree: RayTree, facet: np.ndarray, point: np.ndarray, normal: np.ndarray, directions: np.ndarray, least: float = SEEN
) -> np.ndarray:
    """Whether the view factor of the outside is at least `least` at points (k, 3) [m] on facets (k,) with normals n (k, 3):

        F = Σ v (n·d) / Σ (n·d)     over the directions d with n·d > 0

    v is 1 if the ray along d meets no other facet, else 0. directions (m, 3) unit."""
    d = np.where(np.abs(directions) < 1e-30, 1e-30, directions)
    weight = np.maximum(sum(np.multiply.outer(normal[:, c], d[:, c]) for c in range(3)), 0.0)
    boxes, triangles = (tree.low, tree.high, tree.start), (tree.corner, tree.side, tree.owner, tree.margin)
    return np.asarray(_sees_outside(*boxes, *triangles, point, facet, d, weight, least))  # type: ignore[no-untyped-call]


def unobstructed(skin: Skin, grids: Candidates) -> np.ndarray:
    """Whether no facet lies in front of grids (g,), along their normals."""
    tree, facet = ray_tree(skin.position, skin.facets), skin.index_of(grids.element, grids.facet)
    rays = zip(facet[:, None], grids.position[:, None], grids.normal[:, None], strict=True)
    return np.array([sees_outside(tree, *ray, ray[2], 1.0)[0] for ray in rays], dtype=bool)


def all_directions() -> np.ndarray:
    """Directions (8 OCTANT, 3), evenly distributed over the sphere, and every few consecutive ones, too."""
    number = 7 * np.arange(OCTANT) % OCTANT
    z, turn = (number + 0.5) / OCTANT, 0.5 * np.pi * ((GOLDEN * number + 0.5) % 1.0)
    across = np.sqrt(1 - z**2)
    first = np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)
    signs = 1.0 - 2.0 * (np.arange(8)[:, None] >> np.arange(3) & 1)
    return np.asarray((first[:, None] * signs).reshape(-1, 3))


@kept()
def _sees_outside(  # type: ignore[no-untyped-def]
    low, high, start, corner, side, owner, margin, point, facet, directions, weights, least
):
    leaves = len(low) // 2
    sees, stack = np.zeros(len(point), np.bool_), np.zeros(64, np.int64)
    for i in range(len(point)):
        x, y, z = point[i]
        weight, possible, free = weights[i], 0.0, 0.0
        for w in weight:
            possible += w
        wanted = least * possible
        for j in range(len(directions)):
            if weight[j] == 0.0:
                continue
            a, b, c = directions[j]
            meets, depth = False, 1
            stack[0] = 1
            while depth > 0 and not meets:
                depth -= 1
                node = stack[depth]
                x0, x1 = (low[node, 0] - x) / a, (high[node, 0] - x) / a
                y0, y1 = (low[node, 1] - y) / b, (high[node, 1] - y) / b
                z0, z1 = (low[node, 2] - z) / c, (high[node, 2] - z) / c
                enter = max(min(x0, x1), min(y0, y1), min(z0, z1), 0.0)
                if enter > min(max(x0, x1), max(y0, y1), max(z0, z1)):
                    continue
                if node < leaves:
                    stack[depth], stack[depth + 1] = 2 * node, 2 * node + 1
                    depth += 2
                    continue
                for k in range(start[node - leaves], start[node - leaves + 1]):
                    if owner[k] == facet[i]:
                        continue
                    # x + t d = corner + u e + v f (Möller and Trumbore, 1997)
                    ex, ey, ez = side[k, 0]
                    fx, fy, fz = side[k, 1]
                    px, py, pz = b * fz - c * fy, c * fx - a * fz, a * fy - b * fx
                    volume = ex * px + ey * py + ez * pz
                    if volume == 0.0:
                        continue
                    sx, sy, sz = x - corner[k, 0], y - corner[k, 1], z - corner[k, 2]
                    qx, qy, qz = sy * ez - sz * ey, sz * ex - sx * ez, sx * ey - sy * ex
                    u = (sx * px + sy * py + sz * pz) / volume
                    v = (a * qx + b * qy + c * qz) / volume
                    t = (fx * qx + fy * qy + fz * qz) / volume
                    # a ray that starts on a facet meets it if it enters there
                    if u >= -ON and v >= -ON and u + v <= 1.0 + ON and t > (-margin if volume > 0.0 else margin):
                        meets = True
                        break
            if meets:
                possible -= weight[j]
            else:
                free += weight[j]
            if free >= wanted or possible < wanted:
                break
        sees[i] = free >= wanted
    return sees
