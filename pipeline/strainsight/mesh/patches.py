"""Facets of solids, middles of shells and beams, straight or curved, and how far points lie from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strainsight.mesh.facets import CODE, Facets, exterior_facets
from strainsight.mesh.kinds import FACETS
from strainsight.mesh.model import FloatArray, IntArray, Mesh
from strainsight.mesh.projection import BENT, LINE, Feet, at_centre, nearest

STRAIGHT = 1e-5
"""Of its size: what leaves its chords by no more is flat."""


@dataclass(frozen=True)
class Patches:
    """Polygons and lines that something may lie on: corners (p, 4) nodes (index), −1 where it has fewer, two of a line; nodes
    (p, 8) all that it has; element (p,) id; code (p,) of `projection`; bulge (p,) [m]: it leaves the triangles between its sides
    and the mean of its corners by no more; centre (p, 3) [m] on it; solid (p,) whether it is the facet of one.

    position (n, 3) [m] of all nodes; x (p, 4, 3) [m] corners, the last one again where they are fewer; mean (p, 3) [m] of the
    corners, and radius (p,) [m], how far the farthest is from it."""

    corners: IntArray
    nodes: IntArray
    element: IntArray
    code: IntArray
    bulge: FloatArray
    centre: FloatArray
    solid: NDArray[np.bool_]
    position: FloatArray
    x: FloatArray
    mean: FloatArray
    radius: FloatArray

    def feet(self, p: IntArray, point: FloatArray) -> list[tuple[IntArray, FloatArray, Feet]]:
        """Points of patches p (m,) that are nearest to others (m, 3), by kinds: which of them, their nodes (l, k, 3), feet."""
        found = []
        for code in np.unique(self.code[p]):
            which = np.flatnonzero(self.code[p] == code)
            nodes = self.position[self.nodes[p[which], : node_count(code)]]
            found.append((which, nodes, nearest(int(code), nodes, point[which])))
        return found

    def distance(self, p: IntArray, point: FloatArray, within: FloatArray) -> FloatArray:
        """Of points (m, 3) from patches p (m,), straight or curved as they are, infinite where it is more than within (m,)."""
        apart = from_polygon(point, self.x[p], self.mean[p])
        curved = self.bulge[p] > STRAIGHT * self.radius[p]
        near = np.flatnonzero(curved & (apart <= self.bulge[p] + within))
        apart[curved] = np.inf
        for which, _, feet in self.feet(p[near], point[near]):
            apart[near[which]] = feet.apart
        return np.where(apart <= within, apart, np.inf)


def patches(mesh: Mesh, facets: Facets | None = None) -> Patches:
    """Exterior facets of solids, the middles of shells, and beams as lines; facets: the exterior ones, where they are at hand."""
    corners, nodes, element, codes, bulge, centre, solid = [], [], [], [], [], [], []

    def add(
        own: IntArray, k: int, ids: IntArray, code: int, edges: tuple[tuple[int, int], ...], of_solid: bool
    ) -> None:
        padded = np.full((len(own), 8), -1, dtype=np.int64)
        padded[:, : own.shape[1]] = own
        at = mesh.position[own]
        sag = [np.linalg.norm(at[:, k + i] - (at[:, a] + at[:, b]) / 2, axis=1) for i, (a, b) in enumerate(edges)]
        corners.append(np.where(np.arange(4) < k, padded[:, :4], -1))
        nodes.append(padded)
        element.append(ids)
        codes.append(np.full(len(own), code))
        # the functions of the nodes between corners sum to two at most
        bulge.append(2 * np.max(sag, axis=0) if sag else np.zeros(len(own)))
        if k == 4:
            bulge[-1] = bulge[-1] + np.linalg.norm(at[:, 0] - at[:, 1] + at[:, 2] - at[:, 3], axis=1) / 4
        centre.append(np.einsum("a,mac->mc", at_centre(code)[0], at))
        solid.append(np.full(len(own), of_solid))

    add(np.zeros((0, 3), dtype=np.int64), 3, np.zeros(0, dtype=np.int64), CODE["tri3"], (), False)
    if mesh.blocks:
        found = exterior_facets(mesh) if facets is None else facets
        found = found.some(found.of(mesh.blocks))
        for code in np.unique(found.kind):
            kind, which = FACETS[code], found.kind == code
            own = found.nodes[which, : len(kind.nodes)]
            add(own, kind.corners, found.element_id[which], int(code), kind.edges, True)
    for shell in mesh.shells:
        kind = next(kind for kind in FACETS if len(kind.nodes) == shell.nodes.shape[1])
        add(shell.nodes, kind.corners, shell.ids, FACETS.index(kind), kind.edges, False)
    for beam in mesh.beams:
        bent = beam.nodes.shape[1] > 2
        add(beam.nodes, 2, beam.ids, BENT if bent else LINE, ((0, 1),) if bent else (), False)
    around = np.concatenate(corners)
    count = (around >= 0).sum(axis=1)
    x = mesh.position[np.where(around >= 0, around, around[np.arange(len(count)), count - 1, None])]
    mean = np.where((around >= 0)[..., None], x, 0.0).sum(axis=1) / count[:, None]
    radius = np.linalg.norm(x - mean[:, None], axis=2).max(axis=1, initial=0.0)
    return Patches(
        *(around, np.concatenate(nodes), np.concatenate(element), np.concatenate(codes), np.concatenate(bulge)),
        *(np.concatenate(centre), np.concatenate(solid), mesh.position, x, mean, radius),
    )


def node_count(code: int) -> int:
    """How many nodes a patch of this code has."""
    return len(FACETS[code].nodes) if code < len(FACETS) else code - LINE + 2


def area(x: FloatArray) -> FloatArray:
    """A normal (m, 3) of polygons of three or four corners x (m, c, 3)."""
    return (
        np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
        if x.shape[1] > 3
        else np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    )


def from_polygon(point: FloatArray, x: FloatArray, mean: FloatArray) -> FloatArray:
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
