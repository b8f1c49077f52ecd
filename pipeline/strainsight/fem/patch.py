"""A patch of elements of a mesh, and the motions and forces that act on its nodes from outside."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from strainsight.mesh.model import Mesh


@dataclass(frozen=True)
class Incidence:
    """Incidence of nodes (n,) and elements (e,), CSR both ways; elements in the order of the blocks."""

    elements_of: sparse.csr_array
    nodes_of: sparse.csr_array

    @classmethod
    def of(cls, mesh: Mesh) -> Incidence:
        nodes = [block.nodes.ravel() for block in mesh.blocks]
        width = np.concatenate([np.full(len(block.ids), block.nodes.shape[1]) for block in mesh.blocks])
        indptr, columns = np.r_[0, np.cumsum(width)], np.concatenate(nodes)
        shape = (len(width), len(mesh.position))
        incidence = sparse.csr_array((np.ones(len(columns), dtype=np.int8), columns, indptr), shape=shape)
        return cls(sparse.csr_array(incidence.T.tocsr()), incidence)


@dataclass(frozen=True)
class Patch:
    """Some elements of a mesh: a mesh of them alone; nodes (k,) their indices in the whole mesh, ascending; cut (k,): nodes that
    elements outside share."""

    mesh: Mesh
    nodes: np.ndarray
    cut: np.ndarray

    def local(self, nodes: np.ndarray) -> np.ndarray:
        """Indices in the patch of nodes of the whole mesh, −1 for padding and for nodes outside."""
        at = np.minimum(np.searchsorted(self.nodes, nodes), len(self.nodes) - 1)
        return np.where(self.nodes[at] == nodes, at, -1)


def patch_around(mesh: Mesh, incidence: Incidence, nodes: np.ndarray, layers: int) -> Patch:
    """Elements that contain the nodes (s,), and the given number of layers of elements around them."""
    chosen = np.zeros(incidence.nodes_of.shape[0], dtype=bool)
    within = np.zeros(len(mesh.position), dtype=bool)
    within[nodes] = True
    for _ in range(layers):
        chosen[incidence.elements_of[np.flatnonzero(within)].indices] = True
        within[incidence.nodes_of[np.flatnonzero(chosen)].indices] = True
    patch_nodes = np.flatnonzero(within)
    inside = np.asarray(incidence.nodes_of[np.flatnonzero(chosen)].sum(axis=0)).ravel()[patch_nodes]
    number = np.full(len(mesh.position), -1)
    number[patch_nodes] = np.arange(len(patch_nodes))
    blocks, start = [], 0
    for block in mesh.blocks:
        part = np.flatnonzero(chosen[start : start + len(block.ids)])
        start += len(block.ids)
        if len(part):
            region = block.region[part]
            blocks.append(replace(block, ids=block.ids[part], nodes=number[block.nodes[part]], region=region))
    alone = Mesh(
        mesh.node_ids[patch_nodes], mesh.position[patch_nodes], tuple(blocks), source=mesh.source, **mesh.properties
    )
    return Patch(alone, patch_nodes, inside < np.diff(incidence.elements_of.indptr)[patch_nodes])


def held_components(mesh: Mesh) -> np.ndarray:
    """Translations (n, 3) of the nodes that supports, rigid and averaging elements or relations prescribe.

    All translations of a node with a local coordinate system count as prescribed if one does."""
    prescribed = np.zeros((len(mesh.position), 3), dtype=bool)
    fixed = mesh.fixed.reshape(-1, 2)
    moving = fixed[fixed[:, 1] < 3]
    prescribed[moving[:, 0], moving[:, 1]] = True
    for rigid in mesh.rigid:
        for component in rigid.components:
            prescribed[rigid.nodes, component % 3] |= component < 3
    for averaging in mesh.averaging:
        if averaging.dependent is None:
            prescribed[averaging.reference] |= [c in averaging.components for c in range(3)]
        else:
            dependent = averaging.dependent[averaging.dependent[:, 1] < 3]
            prescribed[dependent[:, 0], dependent[:, 1]] = True
    for node, component in (relation.follower for relation in mesh.relations):
        prescribed[node, component % 3] |= component < 3
    for node in mesh.axes:
        prescribed[node] = prescribed[node].any()
    return prescribed


def forced_nodes(mesh: Mesh) -> np.ndarray:
    """Nodes (n,) bool where ties, springs, point masses, shells and beams exert concentrated forces."""
    forced = np.zeros(len(mesh.position), dtype=bool)
    for nodes in (block.nodes for block in mesh.thin):
        forced[nodes] = True
    for averaging in mesh.averaging:
        forced[averaging.nodes] = True
    for relation in mesh.relations:
        forced[relation.node] = True
    for spring in mesh.springs:
        forced[spring.node] = True
    for node in (*(rigid.reference for rigid in mesh.rigid), *(point.node for point in mesh.point_masses)):
        forced[node] = True
    return forced
