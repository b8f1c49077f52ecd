"""Nodes that lie on a facet, shell or beam which does not have them, and inside of solids: what does not fit together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strainsight.mesh.facets import Facets
from strainsight.mesh.kinds import kind_of
from strainsight.mesh.model import CellBlock, FloatArray, IntArray, Mesh
from strainsight.mesh.patches import Patches, area, patches
from strainsight.mesh.projection import at_centre, near_pairs, normals
from strainsight.mesh.unjoined import APART, Coincident, Joints, shortest_sides

DEEP = 0.1
"""How far a point lies inside of a solid that is more than touched: of the way from its facets to its centre."""

ALONG = 0.9
"""Cosine of the angle between facets that lie on one another."""

THIN = 0.1
"""Of the shortest side of what lies on a patch: it is no farther off, so that no thin part lies on its own other side."""


@dataclass(frozen=True)
class Met:
    """Nodes (m,) (index) that meet an element (m,) (id) which does not have them."""

    node: IntArray
    element: IntArray

    def __len__(self) -> int:
        return len(np.unique(self.node))


def hanging(mesh: Mesh, own: Patches, joints: Joints, coincident: Coincident) -> Met:
    """Nodes on a patch that has neither them nor a node in their place, and that nothing joins to one of its nodes."""
    points = np.unique(own.nodes[own.nodes >= 0])
    node, element = [], []
    for p, at in near_pairs(mesh.position[points], own.mean, own.radius * (1 + APART) + own.bulge):
        n, has = points[at], own.nodes[p]
        its = np.where(has >= 0, coincident.place[has], -1)
        apart = ~((its == coincident.place[n][:, None]).any(axis=1))
        p, n = p[apart], n[apart]
        close = np.minimum(APART * own.radius[p], THIN * coincident.side[n])
        on = np.isfinite(own.distance(p, mesh.position[n], close))
        p, n = p[on], n[on]
        has = own.nodes[p]
        tied = (joints.between(np.broadcast_to(n[:, None], has.shape), has) & (has >= 0)).any(axis=1)
        node.append(n[~tied])
        element.append(own.element[p[~tied]])
    of_others = [~_of_elements(mesh, n, ids) for n, ids in zip(node, element, strict=True)]
    node, element = ([part[own] for part, own in zip(parts, of_others, strict=True)] for parts in (node, element))
    return _met(node, element)


def inside(mesh: Mesh, own: Patches, joints: Joints, coincident: Coincident) -> Met:
    """Nodes inside of a solid that does not have them, and of facets whose middle is; no more than touched is not inside."""
    thin = np.unique(own.nodes[~own.solid][own.nodes[~own.solid] >= 0])
    surface = np.flatnonzero(own.solid)
    around = np.concatenate([own.corners[surface], np.column_stack([thin, np.full((len(thin), 3), -1)])])
    nodes = np.unique(own.nodes[surface][own.nodes[surface] >= 0])
    around = np.concatenate([around, np.column_stack([nodes, np.full((len(nodes), 3), -1)])])
    points = np.concatenate([own.centre[surface], mesh.position[thin], mesh.position[nodes]])
    node, element = [], []
    for block in mesh.blocks if len(points) else ():
        kind = kind_of(block.kind)
        x = mesh.position[block.nodes[:, : kind.corners]]
        centre = x.mean(axis=1)
        radius = np.linalg.norm(x - centre[:, None], axis=2).max(axis=1)
        for which, at in near_pairs(points, centre, (1 - DEEP) * radius):
            for facet, local in kind.facets:
                ends = x[which][:, local[: facet.corners]]
                outward = area(ends)
                # of points on the way from the facet's middle to the element's
                whole = np.einsum("mc,mc->m", ends.mean(axis=1) - centre[which], outward)
                part = np.einsum("mc,mc->m", ends.mean(axis=1) - points[at], outward)
                deep = (part > DEEP * whole) & (whole > 0)
                which, at = which[deep], at[deep]
            deep = _beyond_bulges(mesh, block, which, points[at])
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
    chord = area(own.x)  # the last corner stands twice in triangles
    solid = np.flatnonzero(own.solid)
    if not len(solid):
        return found
    lies = np.zeros(len(own.element), dtype=bool)
    side = np.append(shortest_sides(mesh), np.inf)  # of a corner −1, which is none
    for p, at in near_pairs(own.centre[solid], own.mean, own.radius * (1 + APART) + own.bulge):
        on = solid[at]
        other = own.element[p] != own.element[on]
        facing = other & ((np.einsum("mc,mc->m", chord[p], chord[on]) < 0) | ~own.solid[p])
        p, on = p[facing], on[facing]
        close = np.minimum(APART * own.radius[p], THIN * side[own.corners[on]].min(axis=1))
        near = np.isfinite(own.distance(p, own.centre[on], close))
        p, on, close = p[near], on[near], close[near]
        outward = _outward(mesh, own, on)
        for which, nodes, feet in own.feet(p, own.centre[on]):
            if feet.dN.shape[2] < 2:
                continue
            cosine = np.einsum("mc,mc->m", normals(nodes, feet.dN), outward[which])
            ahead = np.einsum("mc,mc->m", feet.x - own.centre[on[which]], outward[which]) >= -close[which] / 2
            looks = np.where(own.solid[p[which]], cosine < -ALONG, abs(cosine) > ALONG)
            lies[on[which[looks & ahead]]] = True
    keys = {tuple(nodes) for nodes in np.sort(own.nodes[lies], axis=1).tolist()}
    if keys:
        found = np.array([tuple(nodes) in keys for nodes in np.sort(facets.nodes, axis=1).tolist()])
    return found


def _outward(mesh: Mesh, own: Patches, on: IntArray) -> FloatArray:
    """Unit normals (m, 3) at the centres of facets."""
    normal = np.zeros((len(on), 3))
    for code in np.unique(own.code[on]):
        which, (_, slope) = own.code[on] == code, at_centre(int(code))
        nodes = mesh.position[own.nodes[on[which], : len(slope)]]
        normal[which] = normals(nodes, np.broadcast_to(slope, (len(nodes), *slope.shape)))
    return normal


def _beyond_bulges(mesh: Mesh, block: CellBlock, which: IntArray, point: FloatArray) -> NDArray[np.bool_]:
    """Which points (m, 3) lie deeper below the chords of every facet of elements (m,) than it bulges inwards."""
    deeper = np.ones(len(which), dtype=bool)
    for facet, local in kind_of(block.kind).facets:
        if not facet.edges:
            continue
        x = mesh.position[block.nodes[which][:, local]]
        corners = x[:, : facet.corners]
        outward, middle = area(corners), corners.mean(axis=1)
        a, b = np.transpose(facet.edges)
        N = facet.shape(facet.centre)[0]
        inward = [
            np.einsum("mec,mc->me", (corners[:, a] + corners[:, b]) / 2 - x[:, facet.corners :], outward),
            np.einsum("mc,mc->m", middle - np.einsum("a,mac->mc", N, x), outward)[:, None],
        ]
        depth = np.einsum("mc,mc->m", middle - point, outward)
        deeper &= depth > np.concatenate(inward, axis=1).max(axis=1)
    return deeper


def _of_elements(mesh: Mesh, node: IntArray, element: IntArray) -> NDArray[np.bool_]:
    """Whether nodes (m,) are those of solids (m,) (id)."""
    found = np.zeros(len(node), dtype=bool)
    for block in (own for own in mesh.blocks if len(node) and len(own.ids)):
        order = np.argsort(block.ids)
        row = order[np.minimum(np.searchsorted(block.ids, element, sorter=order), len(order) - 1)]
        found |= (block.ids[row] == element) & (block.nodes[row] == node[:, None]).any(axis=1)
    return found


def _met(node: list[IntArray], element: list[IntArray]) -> Met:
    empty = np.zeros(0, dtype=np.int64)
    pairs = np.unique(np.column_stack([np.concatenate([empty, *node]), np.concatenate([empty, *element])]), axis=0)
    return Met(pairs[:, 0], pairs[:, 1])
