"""Nodes that follow the surface which they lie on: meshes that do not fit together, joined."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.errors import UserError
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.joins import Relation
from strainsight.mesh.kinds import FACETS
from strainsight.mesh.model import FloatArray, IntArray, Mesh

STEPS = 20
"""Of Gauss-Newton; a facet that is not strongly bent takes three."""


def with_surface_tie(mesh: Mesh, nodes: IntArray, onto: IntArray, within: float, name: str) -> Mesh:
    """A mesh whose nodes (k,) (index) follow the facets of solids whose nodes are all among `onto` (m,):

        z_i = Σ_a N_a(ξ) z_a        at the point ξ of the nearest facet, along x, y and z

    A node that a facet has is passed over. Rigid motions and linear fields are handed on exactly; constant stress where the nodal
    forces of the finer side integrate N_a exactly, and otherwise but for a disturbance in the elements beside.
    Raises UserError where a node lies farther from the facets than `within` [m], or has a displacement system of its own.
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
    weight, of = np.zeros((len(nodes), 8)), np.full((len(nodes), 8), -1, dtype=np.int64)
    for code in np.unique(facets.kind):
        kind = FACETS[code]
        own = facets.nodes[facets.kind == code, : len(kind.nodes)]
        centre = mesh.position[own].mean(axis=1)
        reach = np.linalg.norm(mesh.position[own] - centre[:, None], axis=2).max(axis=1) + within
        for i, node in enumerate(nodes.tolist()):
            x = mesh.position[node]
            near = np.flatnonzero(np.linalg.norm(centre - x, axis=1) <= reach)
            for row in near.tolist():
                N, apart = _nearest(code, mesh.position[own[row]], x)
                if apart < best[i]:
                    best[i], weight[i], of[i] = apart, 0.0, -1
                    weight[i, : len(N)], of[i, : len(N)] = N, own[row]
    far = int(np.argmax(best))
    if best[far] > within:
        raise UserError(
            f"node {mesh.node_ids[nodes[far]]} does not lie on the surface, not within {within:g} m",
            remedy="name the nodes that do, or give `within` [m]",
        )
    turned = [node for node in np.unique(np.append(nodes, of[of >= 0])).tolist() if node in mesh.axes]
    if turned:
        raise UserError(
            f"node {mesh.node_ids[turned[0]]} has a displacement system of its own (CD, *TRANSFORM)",
            remedy="take it out there: a surface is tied along x, y and z",
        )
    first = max([0, *(own.id for own in mesh.relations)]) + 1
    made = []
    for i, node in enumerate(nodes.tolist()):
        kept = np.flatnonzero((of[i] >= 0) & (abs(weight[i]) > 1e-12))
        terms, values = np.append(node, of[i, kept]), np.append(1.0, -weight[i, kept])
        made += [
            Relation(first + 3 * i + c, terms, np.full(len(terms), c, dtype=np.int64), values, name) for c in range(3)
        ]
    return replace(mesh, relations=(*mesh.relations, *made))


def _nearest(code: int, corners: FloatArray, x: FloatArray) -> tuple[FloatArray, float]:
    """N (k,) at the point of a facet nearest to x, and its distance [m]: Gauss-Newton on |x(ξ) − x|², ξ kept in the facet."""
    kind = FACETS[code]
    xi = np.array(kind.centre, dtype=float)
    for _ in range(STEPS):
        N, dN = kind.functions(xi[None])
        J = corners.T @ dN[0]
        step = np.linalg.lstsq(J, x - N[0] @ corners, rcond=None)[0]
        new = _within(xi + step, kind.corners)
        if np.abs(new - xi).max() < 1e-14:
            break
        xi = new
    N = kind.shape(xi)[0]
    return N, float(np.linalg.norm(N @ corners - x))


def _within(xi: FloatArray, corners: int) -> FloatArray:
    if corners == 4:
        return np.clip(xi, -1, 1)
    xi = np.clip(xi, 0, 1)
    over = max(0.0, xi.sum() - 1) / 2
    return np.clip(xi - over, 0, 1)
