"""Nearest points of lines and surfaces, straight or curved; overlapping and hanging parts of a mesh."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from strainsight.mesh.coincident import APART, Coincident, Joints, shortest_sides
from strainsight.mesh.facets import CODE, Facets, by_kind, exterior_facets
from strainsight.mesh.kinds import FACETS, kind_of
from strainsight.mesh.kinds.kind import Values, barycentric, quadratic_simplex
from strainsight.mesh.model import CellBlock, FloatArray, IntArray, Mesh

STEPS = 20
"""Largest number of Gauss-Newton steps; a facet with little curvature needs three."""
CHUNK = 16384
"""Points at a time."""
LINE, BENT = len(FACETS), len(FACETS) + 1
"""Codes of lines of two nodes, and of lines with a mid-node; surfaces have their index in FACETS."""


@dataclass(frozen=True)
class Feet:
    """Nearest points of elements: N (m, k) [-] there, dN (m, k, d) [-] along the element coordinates, x (m, 3) [m], and their
    distance (m,) [m] from the query points."""

    N: FloatArray
    dN: FloatArray
    x: FloatArray
    distance: FloatArray


def nearest(code: int, nodes: FloatArray, point: FloatArray) -> Feet:
    """The points of elements, with nodes (m, k, 3) [m], nearest to query points (m, 3) [m], one each: Gauss-Newton on
    |x(ξ) − x|² with ξ limited to the element."""
    functions, centre, square = _reference(code)
    xi = np.repeat(centre[None], len(point), axis=0)
    for start in range(0, len(point), CHUNK):
        remaining = np.arange(start, min(start + CHUNK, len(point)))
        for _ in range(STEPS):
            N, dN = functions(xi[remaining])
            J = np.einsum("mac,mad->mcd", nodes[remaining], dN)
            off = point[remaining] - np.einsum("ma,mac->mc", N, nodes[remaining])
            A = np.einsum("mci,mcj->mij", J, J)
            # a side of zero length has no direction
            ridge = 1e-14 * np.trace(A, axis1=1, axis2=2) + np.finfo(float).tiny
            A += ridge[:, None, None] * np.eye(A.shape[1])
            step = np.linalg.solve(A, np.einsum("mci,mc->mi", J, off)[..., None])[..., 0]
            new = _within(xi[remaining] + step, square)
            moved = np.abs(new - xi[remaining]).max(axis=1) >= 1e-14
            xi[remaining] = new
            remaining = remaining[moved]
            if not len(remaining):
                break
    N, dN = functions(xi)
    x = np.einsum("ma,mac->mc", N, nodes)
    return Feet(N, dN, x, np.linalg.norm(x - point, axis=1))


def normals(nodes: FloatArray, dN: FloatArray) -> FloatArray:
    """Unit normals (m, 3) of surfaces with nodes (m, k, 3) and gradients dN (m, k, 2); zero where undefined."""
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
    """Pairs (m,) of a centre and a point within its radius, in groups of centres of similar radius."""
    tree = cKDTree(points)
    size = np.floor(np.log2(np.maximum(radius, np.finfo(float).tiny)))
    for one in np.unique(size):
        some = np.flatnonzero(size == one)
        distances = cKDTree(centre[some]).sparse_distance_matrix(tree, radius[some].max(), output_type="ndarray")
        close = distances["v"] <= radius[some][distances["i"]]
        yield some[distances["i"][close]], distances["j"][close].astype(np.int64)


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


STRAIGHT = 1e-5
"""Largest distance from its chords, as a share of its size, of a flat patch."""


@dataclass(frozen=True)
class Patches:
    """Polygons and lines: corners (p, 4) nodes (index), padded with −1, two for a line; nodes (p, 8) all nodes; element (p,) id;
    code (p,) of `projection`; bulge (p,) [m]: bound of its distance from the triangles between its sides and the mean of its
    corners; centre (p, 3) [m] on it; solid (p,) whether it is the facet of a solid.

    position (n, 3) [m] of all nodes; x (p, 4, 3) [m] corners, the last one repeated for triangles and lines; mean (p, 3) [m] of
    the corners; radius (p,) [m], the largest distance of a corner from it."""

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
        """Nearest points of patches p (m,) to query points (m, 3), by kind: their numbers, their nodes (l, k, 3), feet."""
        groups = []
        for code in np.unique(self.code[p]):
            which = np.flatnonzero(self.code[p] == code)
            nodes = self.position[self.nodes[p[which], : len(at_centre(code)[0])]]
            groups.append((which, nodes, nearest(int(code), nodes, point[which])))
        return groups

    def distance(self, p: IntArray, point: FloatArray, within: FloatArray) -> FloatArray:
        """Distance of points (m, 3) from patches p (m,), straight or curved, infinite if greater than within (m,)."""
        distance = from_polygon(point, self.x[p], self.mean[p])
        curved = self.bulge[p] > STRAIGHT * self.radius[p]
        near = np.flatnonzero(curved & (distance <= self.bulge[p] + within))
        distance[curved] = np.inf
        for which, _, feet in self.feet(p[near], point[near]):
            distance[near[which]] = feet.distance
        return np.where(distance <= within, distance, np.inf)


def patches(mesh: Mesh, facets: Facets | None = None) -> Patches:
    """Exterior facets of solids, middle surfaces of shells, and beams as lines; facets: the exterior ones, if available."""
    parts = []

    def add(
        cells: IntArray, k: int, ids: IntArray, code: int, edges: tuple[tuple[int, int], ...], of_solid: bool
    ) -> None:
        padded = np.full((len(cells), 8), -1, dtype=np.int64)
        padded[:, : cells.shape[1]] = cells
        at = mesh.position[cells]
        sag = [np.linalg.norm(at[:, k + i] - (at[:, a] + at[:, b]) / 2, axis=1) for i, (a, b) in enumerate(edges)]
        # the shape functions of mid-side nodes sum to two at most
        bulge = 2 * np.max(sag, axis=0) if sag else np.zeros(len(cells))
        if k == 4:
            bulge = bulge + np.linalg.norm(at[:, 0] - at[:, 1] + at[:, 2] - at[:, 3], axis=1) / 4
        corners, centre = np.where(np.arange(4) < k, padded[:, :4], -1), np.einsum("a,mac->mc", at_centre(code)[0], at)
        parts.append((corners, padded, ids, np.full(len(cells), code), bulge, centre, np.full(len(cells), of_solid)))

    add(np.zeros((0, 3), dtype=np.int64), 3, np.zeros(0, dtype=np.int64), CODE["tri3"], (), False)
    if mesh.blocks:
        exterior = exterior_facets(mesh) if facets is None else facets
        exterior = exterior.some(exterior.of(mesh.blocks))
        for kind, which, cells in by_kind(exterior.kind, exterior.nodes):
            add(cells, kind.corners, exterior.element_id[which], CODE[kind.name], kind.edges, True)
    for shell in mesh.shells:
        kind = next(kind for kind in FACETS if len(kind.nodes) == shell.nodes.shape[1])
        add(shell.nodes, kind.corners, shell.ids, FACETS.index(kind), kind.edges, False)
    for beam in mesh.beams:
        bent = beam.nodes.shape[1] > 2
        add(beam.nodes, 2, beam.ids, BENT if bent else LINE, ((0, 1),) if bent else (), False)
    around, nodes, element, codes, bulge, centre, solid = (np.concatenate(part) for part in zip(*parts, strict=True))
    count = (around >= 0).sum(axis=1)
    x = mesh.position[np.where(around >= 0, around, around[np.arange(len(count)), count - 1, None])]
    mean = np.where((around >= 0)[..., None], x, 0.0).sum(axis=1) / count[:, None]
    radius = np.linalg.norm(x - mean[:, None], axis=2).max(axis=1, initial=0.0)
    return Patches(around, nodes, element, codes, bulge, centre, solid, mesh.position, x, mean, radius)


def area_vector(x: FloatArray) -> FloatArray:
    """A normal (m, 3) of polygons of three or four corners x (m, c, 3)."""
    return (
        np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
        if x.shape[1] > 3
        else np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    )


def from_polygon(point: FloatArray, x: FloatArray, mean: FloatArray) -> FloatArray:
    """Distance of points (m, 3) from polygons with corners x (m, 4, 3) and mean (m, 3): triangles of each side and the mean."""
    least = np.full(len(point), np.inf)
    for a in range(4):
        least = np.minimum(least, _from_triangle(point - mean, x[:, a] - mean, x[:, (a + 1) % 4] - mean))
    return least


def _from_triangle(p: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distance of p (m, 3) from triangles 0, a, b: of its projection if that is inside, otherwise of the nearest side."""
    aa, ab, bb = (np.einsum("mc,mc->m", u, v) for u, v in ((a, a), (a, b), (b, b)))
    pa, pb = (np.einsum("mc,mc->m", p, v) for v in (a, b))
    det = aa * bb - ab**2
    flat = det > 1e-12 * aa * bb
    s, t = (
        np.divide(numerator, det, out=np.full(len(p), -1.0), where=flat)
        for numerator in (bb * pa - ab * pb, aa * pb - ab * pa)
    )
    within = np.linalg.norm(p - s[:, None] * a - t[:, None] * b, axis=1)
    sides = np.minimum.reduce([_from_line(p, a), _from_line(p, b), _from_line(p - a, b - a)])
    return np.where((s >= 0) & (t >= 0) & (s + t <= 1), within, sides)


def _from_line(p: FloatArray, a: FloatArray) -> FloatArray:
    """Distance of p (m, 3) from lines 0 to a."""
    aa = np.einsum("mc,mc->m", a, a)
    s = np.divide(np.einsum("mc,mc->m", p, a), aa, out=np.zeros(len(p)), where=aa > 0)
    return np.asarray(np.linalg.norm(p - np.clip(s, 0, 1)[:, None] * a, axis=1))


DEEP = 0.1
"""Least depth of a point inside a solid, as a share of the way from its facets to its centre; less counts as touching."""

ALONG = 0.9
"""Least cosine of the angle between facets that lie on each other."""

THIN = 0.1
"""Largest distance from a patch as a share of the shortest side, so that no thin part lies on its opposite side."""


@dataclass(frozen=True)
class Contacts:
    """Nodes (m,) (index) on or in an element (m,) (id) that does not contain them."""

    node: IntArray
    element: IntArray

    def __len__(self) -> int:
        return len(np.unique(self.node))


def hanging(mesh: Mesh, surface: Patches, joints: Joints, coincident: Coincident) -> Contacts:
    """Nodes on a patch that contains neither them nor a coincident node, without a joint to one of its nodes."""
    points = np.unique(surface.nodes[surface.nodes >= 0])
    node, element = [], []
    for p, at in near_pairs(mesh.position[points], surface.mean, surface.radius * (1 + APART) + surface.bulge):
        n, has = points[at], surface.nodes[p]
        its = np.where(has >= 0, coincident.place[has], -1)
        is_separate = ~((its == coincident.place[n][:, None]).any(axis=1))
        p, n = p[is_separate], n[is_separate]
        tolerance = np.minimum(APART * surface.radius[p], THIN * coincident.side[n])
        on = np.isfinite(surface.distance(p, mesh.position[n], tolerance))
        p, n = p[on], n[on]
        has = surface.nodes[p]
        tied = (joints.between(np.broadcast_to(n[:, None], has.shape), has) & (has >= 0)).any(axis=1)
        node.append(n[~tied])
        element.append(surface.element[p[~tied]])
    of_others = [~_belong_to(mesh, n, ids) for n, ids in zip(node, element, strict=True)]
    node, element = (
        [part[surface] for part, surface in zip(parts, of_others, strict=True)] for parts in (node, element)
    )
    return _contacts(node, element)


def inside(mesh: Mesh, surface: Patches, joints: Joints, coincident: Coincident) -> Contacts:
    """Nodes inside a solid that does not contain them, and facets with their middle inside; touching does not count."""
    thin = np.unique(surface.nodes[~surface.solid][surface.nodes[~surface.solid] >= 0])
    solid_patches = np.flatnonzero(surface.solid)
    around = np.concatenate([surface.corners[solid_patches], np.column_stack([thin, np.full((len(thin), 3), -1)])])
    nodes = np.unique(surface.nodes[solid_patches][surface.nodes[solid_patches] >= 0])
    around = np.concatenate([around, np.column_stack([nodes, np.full((len(nodes), 3), -1)])])
    points = np.concatenate([surface.centre[solid_patches], mesh.position[thin], mesh.position[nodes]])
    node, element = [], []
    for block in mesh.blocks if len(points) else ():
        kind = kind_of(block.kind)
        x = mesh.position[block.nodes[:, : kind.corners]]
        centre = x.mean(axis=1)
        radius = np.linalg.norm(x - centre[:, None], axis=2).max(axis=1)
        for which, at in near_pairs(points, centre, (1 - DEEP) * radius):
            for facet, local in kind.facets:
                ends = x[which][:, local[: facet.corners]]
                outward = area_vector(ends)
                # of points on the way from the middle of the facet to that of the element
                whole = np.einsum("mc,mc->m", ends.mean(axis=1) - centre[which], outward)
                part = np.einsum("mc,mc->m", ends.mean(axis=1) - points[at], outward)
                deep = (part > DEEP * whole) & (whole > 0)
                which, at = which[deep], at[deep]
            deep = _below_bulges(mesh, block, which, points[at])
            which, at = which[deep], at[deep]
            its, has = coincident.place[around[at]], coincident.place[block.nodes[which]]
            real = around[at] >= 0
            shares = ((its[:, :, None] == has[:, None, :]) & real[:, :, None]).any(axis=(1, 2))
            first = np.broadcast_to(around[at][:, :1], has.shape)
            unconnected = ~shares & ~joints.between(first, block.nodes[which]).any(axis=1)
            node.append(around[at[unconnected], 0])
            element.append(block.ids[which[unconnected]])
    return _contacts(node, element)


def covered(mesh: Mesh, facets: Facets) -> NDArray[np.bool_]:
    """Exterior facets (f,) of solids with their middle on the opposed facet of another solid, or on a shell, where no gauge can
    be bonded."""
    result = np.zeros(len(facets.element_id), dtype=bool)
    if not mesh.blocks:
        return result
    surface = patches(mesh, facets)
    chord = area_vector(surface.x)  # triangles repeat the last corner
    solid = np.flatnonzero(surface.solid)
    if not len(solid):
        return result
    is_covered = np.zeros(len(surface.element), dtype=bool)
    side = np.append(shortest_sides(mesh), np.inf)  # for the padding −1
    for p, at in near_pairs(surface.centre[solid], surface.mean, surface.radius * (1 + APART) + surface.bulge):
        on = solid[at]
        other = surface.element[p] != surface.element[on]
        facing = other & ((np.einsum("mc,mc->m", chord[p], chord[on]) < 0) | ~surface.solid[p])
        p, on = p[facing], on[facing]
        close = np.minimum(APART * surface.radius[p], THIN * side[surface.corners[on]].min(axis=1))
        near = np.isfinite(surface.distance(p, surface.centre[on], close))
        p, on, close = p[near], on[near], close[near]
        outward = _outward(mesh, surface, on)
        for which, nodes, feet in surface.feet(p, surface.centre[on]):
            if feet.dN.shape[2] < 2:
                continue
            cosine = np.einsum("mc,mc->m", normals(nodes, feet.dN), outward[which])
            ahead = np.einsum("mc,mc->m", feet.x - surface.centre[on[which]], outward[which]) >= -close[which] / 2
            looks = np.where(surface.solid[p[which]], cosine < -ALONG, abs(cosine) > ALONG)
            is_covered[on[which[looks & ahead]]] = True
    keys = {tuple(nodes) for nodes in np.sort(surface.nodes[is_covered], axis=1).tolist()}
    if keys:
        result = np.array([tuple(nodes) in keys for nodes in np.sort(facets.nodes, axis=1).tolist()])
    return result


def _outward(mesh: Mesh, surface: Patches, on: IntArray) -> FloatArray:
    """Unit normals (m, 3) at the centres of facets."""
    normal = np.zeros((len(on), 3))
    for code in np.unique(surface.code[on]):
        which, (_, slope) = surface.code[on] == code, at_centre(int(code))
        nodes = mesh.position[surface.nodes[on[which], : len(slope)]]
        normal[which] = normals(nodes, np.broadcast_to(slope, (len(nodes), *slope.shape)))
    return normal


def _below_bulges(mesh: Mesh, block: CellBlock, which: IntArray, point: FloatArray) -> NDArray[np.bool_]:
    """Which points (m, 3) are deeper below the chords of every facet of elements (m,) than its inward bulge."""
    deeper = np.ones(len(which), dtype=bool)
    for facet, local in kind_of(block.kind).facets:
        if not facet.edges:
            continue
        x = mesh.position[block.nodes[which][:, local]]
        corners = x[:, : facet.corners]
        outward, middle = area_vector(corners), corners.mean(axis=1)
        a, b = np.transpose(facet.edges)
        N = facet.shape(facet.centre)[0]
        inward = [
            np.einsum("mec,mc->me", (corners[:, a] + corners[:, b]) / 2 - x[:, facet.corners :], outward),
            np.einsum("mc,mc->m", middle - np.einsum("a,mac->mc", N, x), outward)[:, None],
        ]
        depth = np.einsum("mc,mc->m", middle - point, outward)
        deeper &= depth > np.concatenate(inward, axis=1).max(axis=1)
    return deeper


def _belong_to(mesh: Mesh, node: IntArray, element: IntArray) -> NDArray[np.bool_]:
    """Whether nodes (m,) belong to the solids (m,) (id)."""
    result = np.zeros(len(node), dtype=bool)
    for block in (block for block in mesh.blocks if len(node) and len(block.ids)):
        order = np.argsort(block.ids)
        row = order[np.minimum(np.searchsorted(block.ids, element, sorter=order), len(order) - 1)]
        result |= (block.ids[row] == element) & (block.nodes[row] == node[:, None]).any(axis=1)
    return result


def _contacts(node: list[IntArray], element: list[IntArray]) -> Contacts:
    empty = np.zeros(0, dtype=np.int64)
    pairs = np.unique(np.column_stack([np.concatenate([empty, *node]), np.concatenate([empty, *element])]), axis=0)
    return Contacts(pairs[:, 0], pairs[:, 1])
