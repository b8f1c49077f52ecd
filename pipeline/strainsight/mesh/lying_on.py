"""Nodes that lie on a facet, shell or beam which does not have them, and inside of solids: what does not fit together."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from strainsight.mesh.facets import Facets, exterior_facets
from strainsight.mesh.kinds import FACETS, kind_of
from strainsight.mesh.model import FloatArray, IntArray, Mesh
from strainsight.mesh.unjoined import APART, Coincident, Joints

DEEP = 0.1
"""How far a point lies inside of a solid that is more than touched: of the way from its facets to its centre."""

ALONG = 0.9
"""Cosine of the angle between facets that lie on one another."""


@dataclass(frozen=True)
class Met:
    """Nodes (m,) (index) that meet an element (m,) (id) which does not have them."""

    node: IntArray
    element: IntArray

    def __len__(self) -> int:
        return len(np.unique(self.node))


@dataclass(frozen=True)
class Patches:
    """Polygons and lines that something may lie on: corners (p, 4) nodes (index), −1 where it has fewer, two of a line; nodes
    (p, 8) all that it has; element (p,) id; bulge (p,) [m] how far its sides leave the straight ones; solid (p,) whether it is
    the facet of one."""

    corners: IntArray
    nodes: IntArray
    element: IntArray
    bulge: FloatArray
    solid: NDArray[np.bool_]

    def geometry(self, position: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Corners (p, 4, 3) [m], the last one again where they are fewer; their mean (p, 3); how far the farthest is from it."""
        count = (self.corners >= 0).sum(axis=1)
        x = position[np.where(self.corners >= 0, self.corners, self.corners[np.arange(len(count)), count - 1, None])]
        mean = np.where((self.corners >= 0)[..., None], x, 0.0).sum(axis=1) / count[:, None]
        return x, mean, np.linalg.norm(x - mean[:, None], axis=2).max(axis=1, initial=0.0)


def patches(mesh: Mesh, facets: Facets | None = None) -> Patches:
    """Exterior facets of solids, the middles of shells, and beams as lines; facets: the exterior ones, where they are at hand."""
    corners, nodes, element, bulge, solid = [], [], [], [], []

    def add(own: IntArray, k: int, ids: IntArray, edges: tuple[tuple[int, int], ...], of_solid: bool) -> None:
        padded = np.full((len(own), 8), -1, dtype=np.int64)
        padded[:, : own.shape[1]] = own
        at = mesh.position[own]
        sag = [np.linalg.norm(at[:, k + i] - (at[:, a] + at[:, b]) / 2, axis=1) for i, (a, b) in enumerate(edges)]
        corners.append(np.where(np.arange(4) < k, padded[:, :4], -1))
        nodes.append(padded)
        element.append(ids)
        bulge.append(np.max(sag, axis=0) if sag else np.zeros(len(own)))
        solid.append(np.full(len(own), of_solid))

    add(np.zeros((0, 3), dtype=np.int64), 3, np.zeros(0, dtype=np.int64), (), False)
    if mesh.blocks:
        found = exterior_facets(mesh) if facets is None else facets
        found = found.some(found.of(mesh.blocks))
        for code in np.unique(found.kind):
            kind, which = FACETS[code], found.kind == code
            add(found.nodes[which, : len(kind.nodes)], kind.corners, found.element_id[which], kind.edges, True)
    for shell in mesh.shells:
        k = shell.corners.shape[1]
        around = tuple((a, (a + 1) % k) for a in range(k))
        add(shell.nodes, k, shell.ids, around if shell.nodes.shape[1] > k else (), False)
    for beam in mesh.beams:
        add(beam.nodes, 2, beam.ids, ((0, 1),) if beam.nodes.shape[1] > 2 else (), False)
    return Patches(*(np.concatenate(part) for part in (corners, nodes, element, bulge, solid)))


def hanging(mesh: Mesh, own: Patches, joints: Joints, coincident: Coincident) -> Met:
    """Nodes on a patch that has neither them nor a node in their place, and that nothing joins to one of its nodes."""
    points = np.unique(own.nodes[own.nodes >= 0])
    x, mean, radius = own.geometry(mesh.position)
    node, element = [], []
    for which, at in _near(mesh.position[points], mean, radius * (1 + APART) + own.bulge):
        p, n = which, points[at]
        on = _distance(mesh.position[n], x[p], mean[p]) <= own.bulge[p] + APART * radius[p]
        p, n = p[on], n[on]
        has = own.nodes[p]
        its = np.where(has >= 0, coincident.place[has], -1)
        apart = ~((its == coincident.place[n][:, None]).any(axis=1))
        tied = (joints.between(np.broadcast_to(n[:, None], has.shape), has) & (has >= 0)).any(axis=1)
        node.append(n[apart & ~tied])
        element.append(own.element[p[apart & ~tied]])
    return _met(node, element)


def inside(mesh: Mesh, own: Patches, joints: Joints, coincident: Coincident) -> Met:
    """Nodes inside of a solid that does not have them, and of facets whose middle is; no more than touched is not inside."""
    thin = np.unique(own.nodes[~own.solid][own.nodes[~own.solid] >= 0])
    _, mean, _ = own.geometry(mesh.position)
    surface = np.flatnonzero(own.solid)
    around = np.concatenate([own.corners[surface], np.column_stack([thin, np.full((len(thin), 3), -1)])])
    nodes = np.unique(own.nodes[surface][own.nodes[surface] >= 0])
    around = np.concatenate([around, np.column_stack([nodes, np.full((len(nodes), 3), -1)])])
    points = np.concatenate([mean[surface], mesh.position[thin], mesh.position[nodes]])
    node, element = [], []
    for block in mesh.blocks if len(points) else ():
        kind = kind_of(block.kind)
        x = mesh.position[block.nodes[:, : kind.corners]]
        centre = x.mean(axis=1)
        radius = np.linalg.norm(x - centre[:, None], axis=2).max(axis=1)
        for which, at in _near(points, centre, (1 - DEEP) * radius):
            for facet, local in kind.facets:
                ends = x[which][:, local[: facet.corners]]
                outward = _area(ends)
                # of points on the way from the facet's middle to the element's
                whole = np.einsum("mc,mc->m", ends.mean(axis=1) - centre[which], outward)
                part = np.einsum("mc,mc->m", ends.mean(axis=1) - points[at], outward)
                deep = (part > DEEP * whole) & (whole > 0)
                which, at = which[deep], at[deep]
            its, has = coincident.place[around[at]], coincident.place[block.nodes[which]]
            real = around[at] >= 0
            shares = ((its[:, :, None] == has[:, None, :]) & real[:, :, None]).any(axis=(1, 2))
            first = np.broadcast_to(around[at][:, :1], has.shape)
            left = ~shares & ~joints.between(first, block.nodes[which]).any(axis=1)
            node.append(around[at[left], 0])
            element.append(block.ids[which[left]])
    return _met(node, element)


def covered(mesh: Mesh, facets: Facets) -> NDArray[np.bool_]:
    """Which of the exterior facets (f,), of solids, have their middle on the facet of another solid that looks at them, or on a
    shell: no gauge can sit there."""
    found = np.zeros(len(facets.element_id), dtype=bool)
    if not mesh.blocks:
        return found
    own = patches(mesh, facets)
    x, mean, radius = own.geometry(mesh.position)
    normal = _area(x)  # the last corner stands twice in triangles
    length = np.linalg.norm(normal, axis=1)
    normal = np.divide(normal, length[:, None], out=np.zeros_like(normal), where=length[:, None] > 0)
    solid = np.flatnonzero(own.solid)
    if not len(solid):
        return found
    lies = np.zeros(len(own.element), dtype=bool)
    for p, at in _near(mean[solid], mean, radius * (1 + APART) + own.bulge):
        on = solid[at]
        cosine = np.einsum("mc,mc->m", normal[p], normal[on])
        facing = np.where(own.solid[p], cosine < -ALONG, abs(cosine) > ALONG) & (p != on)
        p, on = p[facing], on[facing]
        near = own.bulge[p] + own.bulge[on] + APART * radius[p]
        lies[on[_distance(mean[on], x[p], mean[p]) <= near]] = True
    keys = {tuple(nodes) for nodes in np.sort(own.nodes[lies], axis=1).tolist()}
    if keys:
        found = np.array([tuple(nodes) in keys for nodes in np.sort(facets.nodes, axis=1).tolist()])
    return found


def _met(node: list[IntArray], element: list[IntArray]) -> Met:
    empty = np.zeros(0, dtype=np.int64)
    pairs = np.unique(np.column_stack([np.concatenate([empty, *node]), np.concatenate([empty, *element])]), axis=0)
    return Met(pairs[:, 0], pairs[:, 1])


def _near(points: FloatArray, centre: FloatArray, radius: FloatArray) -> Iterator[tuple[IntArray, IntArray]]:
    """Pairs (m,) of a centre and a point no farther from it than its radius, in parts of centres of like size."""
    tree = cKDTree(points)
    size = np.floor(np.log2(np.maximum(radius, np.finfo(float).tiny)))
    for one in np.unique(size):
        some = np.flatnonzero(size == one)
        found = cKDTree(centre[some]).sparse_distance_matrix(tree, radius[some].max(), output_type="ndarray")
        close = found["v"] <= radius[some][found["i"]]
        yield some[found["i"][close]], found["j"][close].astype(np.int64)


def _area(x: FloatArray) -> FloatArray:
    """A normal (m, 3) of polygons of three or four corners x (m, c, 3)."""
    return (
        np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
        if x.shape[1] > 3
        else np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    )


def _distance(point: FloatArray, x: FloatArray, mean: FloatArray) -> FloatArray:
    """Of points (m, 3) from polygons of corners x (m, 4, 3) about their mean (m, 3): triangles of each side and the mean."""
    least = np.full(len(point), np.inf)
    for a in range(4):
        least = np.minimum(least, _from_triangle(point - mean, x[:, a] - mean, x[:, (a + 1) % 4] - mean))
    return least


def _from_triangle(p: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distance of p (m, 3) from triangles 0, a, b: of its projection where that is inside, else of the nearest side."""
    aa, ab, bb = (np.einsum("mc,mc->m", u, v) for u, v in ((a, a), (a, b), (b, b)))
    pa, pb = (np.einsum("mc,mc->m", p, v) for v in (a, b))
    det = aa * bb - ab**2
    flat = det > 1e-12 * aa * bb
    s, t = (
        np.divide(own, det, out=np.full(len(p), -1.0), where=flat) for own in (bb * pa - ab * pb, aa * pb - ab * pa)
    )
    within = np.linalg.norm(p - s[:, None] * a - t[:, None] * b, axis=1)
    sides = np.minimum.reduce([_from_line(p, a), _from_line(p, b), _from_line(p - a, b - a)])
    return np.where((s >= 0) & (t >= 0) & (s + t <= 1), within, sides)


def _from_line(p: FloatArray, a: FloatArray) -> FloatArray:
    """Distance of p (m, 3) from lines 0 to a."""
    aa = np.einsum("mc,mc->m", a, a)
    s = np.divide(np.einsum("mc,mc->m", p, a), aa, out=np.zeros(len(p)), where=aa > 0)
    return np.asarray(np.linalg.norm(p - np.clip(s, 0, 1)[:, None] * a, axis=1))
