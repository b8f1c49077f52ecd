"""Nodes that follow the surface which they lie on: meshes that do not fit together, joined."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from strainsight.errors import UserError
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.joins import Relation
from strainsight.mesh.kinds import FACETS
from strainsight.mesh.model import FloatArray, IntArray, Mesh
from strainsight.mesh.projection import near_pairs, nearest, normals

TOUCHING = 1e-12
"""Of the size of a facet: a node that is no farther off has no arm."""


def with_surface_tie(
    mesh: Mesh, nodes: IntArray, onto: IntArray, within: float, name: str, far: Literal["refused", "left"] = "refused"
) -> Mesh:
    """A mesh whose nodes (k,) (index) follow the facets of solids whose nodes are all among `onto` (m,):

        z_i = Σ_a N_a(ξ) z_a + ω × g        at the point ξ of the nearest facet

    with the arm g = x_i − x(ξ) over a gap and the turn ω of the facet there, see `_turn`. A node that a facet has is passed over.
    Rigid motions are handed on exactly, linear fields but for their strain over the gap; constant stress, without a gap, where
    the nodal forces of the finer side integrate N_a exactly, and otherwise but for a disturbance in the elements beside.
    Relations are along the axes of each node. Raises UserError where a node lies farther from the facets than `within` [m],
    unless those are left as they are.
    """
    facets = exterior_facets(mesh)
    chosen = np.zeros(len(mesh.position) + 1, dtype=bool)
    chosen[onto] = chosen[-1] = True
    facets = facets.some(facets.of(mesh.blocks) & chosen[facets.nodes].all(axis=1))
    if not len(facets.kind):
        raise UserError(
            "no facet of a solid has all its nodes there", remedy="name a face of the coarser side (mesh.faces)"
        )
    nodes = np.setdiff1d(nodes, facets.nodes)
    if not len(nodes):
        raise UserError(
            "its nodes are those of the surface already", remedy="name the finer side as `set`, the coarser as `to`"
        )
    best = np.full(len(nodes), np.inf)
    weight, of = np.zeros((len(nodes), 3, 8, 3)), np.full((len(nodes), 8), -1, dtype=np.int64)
    for code in np.unique(facets.kind):
        k = len(FACETS[code].nodes)
        own = facets.nodes[facets.kind == code, :k]
        centre = mesh.position[own].mean(axis=1)
        reach = np.linalg.norm(mesh.position[own] - centre[:, None], axis=2).max(axis=1) + within
        for row, which in near_pairs(mesh.position[nodes], centre, reach):
            x, point = mesh.position[own[row]], mesh.position[nodes[which]]
            feet = nearest(int(code), x, point)
            order = np.lexsort((row, feet.apart, which))
            first = order[np.unique(which[order], return_index=True)[1]]
            first = first[feet.apart[first] < best[which[first]]]
            at = which[first]
            best[at] = feet.apart[first]
            of[at], of[at, :k] = -1, own[row[first]]
            weight[at] = 0.0
            weight[at, :, :k] = _weights(x[first], feet.N[first], feet.dN[first], point[first] - feet.x[first])
    if far == "left" and (near := best <= within).any():
        nodes, weight, of, best = nodes[near], weight[near], of[near], best[near]
    last = int(np.argmax(best))
    if best[last] > within:
        raise UserError(
            f"node {mesh.node_ids[nodes[last]]} does not lie on the surface, not within {within:g} m",
            remedy="name the nodes that do, or give `within` [m]",
        )
    axes = np.array([mesh.axes.get(node, np.eye(3)) for node in nodes.tolist()]).reshape(-1, 3, 3)
    onto_axes = np.array([mesh.axes.get(node, np.eye(3)) for node in of.ravel().tolist()]).reshape(*of.shape, 3, 3)
    weight = np.einsum("mic,miaj,majd->mcad", axes, weight, onto_axes)
    number = max([0, *(own.id for own in mesh.relations)]) + 1
    made = []
    for i, node in enumerate(nodes.tolist()):
        for c in range(3):
            a, component = np.nonzero((abs(weight[i, c]) > 1e-14) & (of[i] >= 0)[:, None])
            terms, values = np.append(node, of[i, a]), np.append(1.0, -weight[i, c, a, component])
            made.append(Relation(number + 3 * i + c, terms, np.append(c, component), values, name, yields=True))
    return replace(mesh, relations=(*mesh.relations, *made))


def without_held(mesh: Mesh) -> Mesh:
    """The mesh without relations of surface ties whose first motion a support holds, and a note on them: the support wins, as
    where a plane of symmetry goes through both sides."""
    held = set(map(tuple, mesh.fixed.tolist()))
    kept = tuple(own for own in mesh.relations if not (own.yields and own.follower in held))
    if not (count := len(mesh.relations) - len(kept)):
        return mesh
    note = f"{count} components of nodes that follow a surface (*TIE, mesh.ties) are held by supports: there the supports count"
    return replace(mesh, relations=kept, notes=(*mesh.notes, note))


def _weights(x: FloatArray, N: FloatArray, dN: FloatArray, arm: FloatArray) -> FloatArray:
    """(m, 3, k, 3): what displacements of the nodes of facets, at x (m, k, 3) [m], give at an arm (m, 3) [m] from where they have
    N (m, k) and dN (m, k, 2)."""
    weight = np.einsum("ma,ij->miaj", N, np.eye(3))
    size = np.linalg.norm(x - x.mean(axis=1, keepdims=True), axis=2).max(axis=1)
    off = np.linalg.norm(arm, axis=1) > TOUCHING * size
    turn = _turn(x[off], dN[off])
    # (ω × g)_i for each column of ω, and its terms in order
    weight[off] += np.cross(turn, arm[off, None, None], axisa=1, axisb=3).transpose(0, 3, 1, 2)
    return weight


def _turn(x: FloatArray, dN: FloatArray) -> FloatArray:
    """(m, 3, k, 3): the turn ω of surfaces of nodes x (m, k, 3) from the displacements of these,

        ω = Σ_a (½ n (n × s_a)ᵀ − (n × s_a) nᵀ) u_a        s_a = ∇N_a along the surface

    its normal's n × δn, δn = −Σ_a s_a (n·u_a), and half of its curl about the normal: that of every rigid motion.
    """
    n = normals(x, dN)[:, None]
    s = np.einsum("mad,mdc->mac", dN, np.linalg.pinv(np.einsum("mac,mad->mcd", x, dN)))
    beside = np.cross(n, s)
    about = np.einsum("mc,mad->mcad", n[:, 0], beside) / 2
    return np.asarray(about - np.einsum("mac,md->mcad", beside, n[:, 0]))
