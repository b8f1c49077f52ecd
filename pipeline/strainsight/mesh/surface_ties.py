"""Surface ties: nodes that follow the facets of a non-matching mesh."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from strainsight.errors import UserError
from strainsight.mesh.facets import CODE, by_kind, exterior_facets
from strainsight.mesh.joins import Relation
from strainsight.mesh.model import FloatArray, IntArray, Mesh
from strainsight.mesh.projection import near_pairs, nearest, normals

TOUCHING = 1e-12
"""Distance from a facet, as a share of its size, below which a node has no arm."""


def with_surface_tie(
    mesh: Mesh, nodes: IntArray, onto: IntArray, within: float, name: str, far: Literal["refused", "left"] = "refused"
) -> Mesh:
    """Tie nodes (k,) (index) to the facets of solids whose nodes are all among `onto` (m,):

        z_i = Σ_a N_a(ξ) z_a + ω × g        at the point ξ of the nearest facet

    with the arm g = x_i − x(ξ) across a gap and the rotation ω of the facet there, see `_turn`. Nodes of a facet are skipped.
    Rigid motions are transferred exactly, linear fields except for their strain across the gap. Without a gap, constant stress is
    transferred exactly if the nodal forces of the finer side integrate N_a exactly, otherwise with an error in the adjacent
    elements. Relations use the local axes of each node. Raises UserError for a node farther from the facets than `within` [m],
    unless far is "left", which leaves it untied."""
    facets = exterior_facets(mesh)
    chosen = np.zeros(len(mesh.position) + 1, dtype=bool)
    chosen[onto] = chosen[-1] = True
    facets = facets.some(facets.of(mesh.blocks) & chosen[facets.nodes].all(axis=1))
    if not len(facets.kind):
        raise UserError(
            "no facet of a solid lies in the coarser surface of the tie",
            remedy="Set `to` of mesh.ties to a face (mesh.faces) of the coarser side.",
        )
    nodes = np.setdiff1d(nodes, facets.nodes)
    if not len(nodes):
        raise UserError(
            "all nodes of the finer side already belong to the coarser surface",
            remedy="In mesh.ties, set `set` to the finer side and `to` to the coarser side.",
        )
    best = np.full(len(nodes), np.inf)
    weight, tied_to = np.zeros((len(nodes), 3, 8, 3)), np.full((len(nodes), 8), -1, dtype=np.int64)
    for kind, _, facet_nodes in by_kind(facets.kind, facets.nodes):
        k = len(kind.nodes)
        centre = mesh.position[facet_nodes].mean(axis=1)
        reach = np.linalg.norm(mesh.position[facet_nodes] - centre[:, None], axis=2).max(axis=1) + within
        for row, which in near_pairs(mesh.position[nodes], centre, reach):
            x, point = mesh.position[facet_nodes[row]], mesh.position[nodes[which]]
            feet = nearest(CODE[kind.name], x, point)
            order = np.lexsort((row, feet.distance, which))
            first = order[np.unique(which[order], return_index=True)[1]]
            first = first[feet.distance[first] < best[which[first]]]
            at = which[first]
            best[at] = feet.distance[first]
            tied_to[at], tied_to[at, :k] = -1, facet_nodes[row[first]]
            weight[at] = 0.0
            weight[at, :, :k] = _weights(x[first], feet.N[first], feet.dN[first], point[first] - feet.x[first])
    if far == "left" and (near := best <= within).any():
        nodes, weight, tied_to, best = nodes[near], weight[near], tied_to[near], best[near]
    last = int(np.argmax(best))
    if best[last] > within:
        raise UserError(
            f"node {mesh.node_ids[nodes[last]]} is farther than {within:g} m from the surface of the tie",
            remedy="Specify only nodes on this surface, or increase the tie distance (`within` of mesh.ties, POSITION "
            "TOLERANCE of *TIE).",
        )
    axes = np.array([mesh.axes.get(node, np.eye(3)) for node in nodes.tolist()]).reshape(-1, 3, 3)
    onto_axes = np.array([mesh.axes.get(node, np.eye(3)) for node in tied_to.ravel().tolist()]).reshape(
        *tied_to.shape, 3, 3
    )
    weight = np.einsum("mic,miaj,majd->mcad", axes, weight, onto_axes)
    number = max([0, *(relation.id for relation in mesh.relations)]) + 1
    relations = []
    for i, node in enumerate(nodes.tolist()):
        for c in range(3):
            a, component = np.nonzero((abs(weight[i, c]) > 1e-14) & (tied_to[i] >= 0)[:, None])
            terms, values = np.append(node, tied_to[i, a]), np.append(1.0, -weight[i, c, a, component])
            relations.append(Relation(number + 3 * i + c, terms, np.append(c, component), values, name, yields=True))
    return replace(mesh, relations=(*mesh.relations, *relations))


def without_held(mesh: Mesh) -> Mesh:
    """The mesh without relations of surface ties whose dependent motion is clamped, with a note; such motions occur where a
    symmetry plane cuts both sides."""
    clamped = set(map(tuple, mesh.fixed.tolist()))
    remaining = tuple(tie for tie in mesh.relations if not (tie.yields and tie.follower in clamped))
    if not (count := len(mesh.relations) - len(remaining)):
        return mesh
    note = (
        "supports clamp components of nodes tied to a surface (*TIE, mesh.ties) and replace the tie there (number of components: "
        f"{count})"
    )
    return replace(mesh, relations=remaining, notes=(*mesh.notes, note))


def _weights(x: FloatArray, N: FloatArray, dN: FloatArray, arm: FloatArray) -> FloatArray:
    """(m, 3, k, 3): displacement at an arm (m, 3) [m] from a point of facets, by displacements of their nodes at x (m, k, 3) [m];
    N (m, k) and dN (m, k, 2) at the point."""
    weight = np.einsum("ma,ij->miaj", N, np.eye(3))
    size = np.linalg.norm(x - x.mean(axis=1, keepdims=True), axis=2).max(axis=1)
    off = np.linalg.norm(arm, axis=1) > TOUCHING * size
    turn = _turn(x[off], dN[off])
    # (ω × g)_i for each column of ω, and its terms in order
    weight[off] += np.cross(turn, arm[off, None, None], axisa=1, axisb=3).transpose(0, 3, 1, 2)
    return weight


def _turn(x: FloatArray, dN: FloatArray) -> FloatArray:
    """(m, 3, k, 3): the rotation ω of surfaces with nodes x (m, k, 3), by displacements of the nodes,

        ω = Σ_a (½ n (n × s_a)ᵀ − (n × s_a) nᵀ) u_a        s_a = ∇N_a along the surface

    n × δn of the normal, δn = −Σ_a s_a (n·u_a), and half of the curl about the normal; exact for rigid motions."""
    n = normals(x, dN)[:, None]
    s = np.einsum("mad,mdc->mac", dN, np.linalg.pinv(np.einsum("mac,mad->mcd", x, dN)))
    tangential = np.cross(n, s)
    about = np.einsum("mc,mad->mcad", n[:, 0], tangential) / 2
    return np.asarray(about - np.einsum("mac,md->mcad", tangential, n[:, 0]))
