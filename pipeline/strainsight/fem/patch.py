"""Some elements of a mesh by themselves, and what their nodes have from elsewhere."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from strainsight.mesh.model import Mesh


@dataclass(frozen=True)
class Incidence:
    """Which node (n,) is in which element (e,), CSR both ways; elements in the order of the blocks."""

    elements_of: sparse.csr_array
    nodes_of: sparse.csr_array

    @classmethod
    def of(cls, mesh: Mesh) -> Incidence:
        nodes = [block.nodes.ravel() for block in mesh.blocks]
        width = np.concatenate([np.full(len(block.ids), block.nodes.shape[1]) for block in mesh.blocks])
        indptr, columns = np.r_[0, np.cumsum(width)], np.concatenate(nodes)
        shape = (len(width), len(mesh.position))
        own = sparse.csr_array((np.ones(len(columns), dtype=np.int8), columns, indptr), shape=shape)
        return cls(sparse.csr_array(own.T.tocsr()), own)


@dataclass(frozen=True)
class Patch:
    """Some elements of a mesh: a mesh of them alone; nodes (k,) their indices in the whole mesh, ascending; cut (k,): nodes that
    elements outside share."""

    mesh: Mesh
    nodes: np.ndarray
    cut: np.ndarray

    def local(self, nodes: np.ndarray) -> np.ndarray:
        """Indices here of nodes of the whole mesh, −1 for padding and for those that are not here."""
        at = np.minimum(np.searchsorted(self.nodes, nodes), len(self.nodes) - 1)
        return np.where(self.nodes[at] == nodes, at, -1)


def patch_around(mesh: Mesh, incidence: Incidence, nodes: np.ndarray, layers: int) -> Patch:
    """Elements that hold the nodes (s,), those that touch these, and so on for so many layers."""
    chosen = np.zeros(incidence.nodes_of.shape[0], dtype=bool)
    within = np.zeros(len(mesh.position), dtype=bool)
    within[nodes] = True
    for _ in range(layers):
        chosen[incidence.elements_of[np.flatnonzero(within)].indices] = True
        within[incidence.nodes_of[np.flatnonzero(chosen)].indices] = True
    own = np.flatnonzero(within)
    inside = np.asarray(incidence.nodes_of[np.flatnonzero(chosen)].sum(axis=0)).ravel()[own]
    number = np.full(len(mesh.position), -1)
    number[own] = np.arange(len(own))
    blocks, start = [], 0
    for block in mesh.blocks:
        part = np.flatnonzero(chosen[start : start + len(block.ids)])
        start += len(block.ids)
        if len(part):
            region = block.region[part]
            blocks.append(replace(block, ids=block.ids[part], nodes=number[block.nodes[part]], region=region))
    alone = Mesh(mesh.node_ids[own], mesh.position[own], tuple(blocks), source=mesh.source, **mesh.properties)
    return Patch(alone, own, inside < np.diff(incidence.elements_of.indptr)[own])


def held_components(mesh: Mesh) -> np.ndarray:
    """Which translations (n, 3) of the nodes are given from elsewhere: supports, and what rigid and averaging elements and
    relations prescribe.

    A node with axes of its own counts as held whole.
    """
    held = np.zeros((len(mesh.position), 3), dtype=bool)
    fixed = mesh.fixed.reshape(-1, 2)
    moving = fixed[fixed[:, 1] < 3]
    held[moving[:, 0], moving[:, 1]] = True
    for rigid in mesh.rigid:
        for component in rigid.components:
            held[rigid.nodes, component % 3] |= component < 3
    for averaging in mesh.averaging:
        if averaging.dependent is None:
            held[averaging.reference] |= [c in averaging.components for c in range(3)]
        else:
            own = averaging.dependent[averaging.dependent[:, 1] < 3]
            held[own[:, 0], own[:, 1]] = True
    for node, component in (relation.follower for relation in mesh.relations):
        held[node, component % 3] |= component < 3
    for node in mesh.axes:
        held[node] = held[node].any()
    return held


def forced_nodes(mesh: Mesh) -> np.ndarray:
    """Nodes (n,) bool on which ties, springs, point masses, shells and beams put forces that are concentrated there."""
    found = np.zeros(len(mesh.position), dtype=bool)
    for nodes in (block.nodes for block in mesh.thin):
        found[nodes] = True
    for averaging in mesh.averaging:
        found[averaging.nodes] = True
    for relation in mesh.relations:
        found[relation.node] = True
    for spring in mesh.springs:
        found[spring.node] = True
    for node in (*(rigid.reference for rigid in mesh.rigid), *(point.node for point in mesh.point_masses)):
        found[node] = True
    return found
