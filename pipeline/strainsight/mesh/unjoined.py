"""Nodes of elements that lie in one place and that nothing joins: parts that touch, and hand on no load."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from strainsight.mesh.kinds import kind_of
from strainsight.mesh.model import CellBlock, FloatArray, IntArray, Mesh
from strainsight.mesh.thin import ShellBlock

APART = 1e-3
"""Of the shortest side of the elements there: nodes nearer than this are in one place."""


class Joints:
    """What joins nodes of a mesh beside its elements: rigid elements, relations and springs join all that they name, also one
    through another; an averaging element its reference and each of the others, and not these among each other; and the ground all
    nodes that it holds in three translations. edges (e, 2): all of these but the ground's."""

    def __init__(self, mesh: Mesh):
        n = len(mesh.position)
        edges = [np.zeros((0, 2), dtype=np.int64)]
        edges += [np.column_stack([np.full(len(e.nodes), e.reference), e.nodes]) for e in mesh.rigid]
        edges += [np.column_stack([np.full(len(own.node), own.node[0]), own.node]) for own in mesh.relations]
        for own in mesh.springs:
            first = np.full(len(own.stiffness), -1)
            first[own.spring[::-1]] = own.node[::-1]
            edges.append(np.column_stack([first[own.spring], own.node]))
        components, held = mesh.fixed.reshape(-1, 2)[:, 1], mesh.fixed.reshape(-1, 2)[:, 0]
        averaged = [np.column_stack([np.full(len(e.nodes), e.reference), e.nodes]) for e in mesh.averaging]
        self.edges: IntArray = np.concatenate([*edges, *averaged])
        ground = np.flatnonzero(np.bincount(np.unique(held[components < 3] * 3 + components[components < 3]) // 3) == 3)
        edges.append(np.column_stack([np.repeat(ground[:1], len(ground)), ground]))
        a, b = np.concatenate(edges).T
        self._group = component_labels(n, a, b)
        pairs = np.sort(np.concatenate([np.zeros((0, 2), dtype=np.int64), *averaged]), axis=1)
        self._n, self._averaged = n, np.unique(pairs @ [n, 1])

    def between(self, a: IntArray, b: IntArray) -> NDArray[np.bool_]:
        """Whether nodes a and b, arrays of one shape, are joined."""
        direct = np.isin(np.minimum(a, b) * self._n + np.maximum(a, b), self._averaged)
        return np.asarray((self._group[a] == self._group[b]) | direct)


class Coincident:
    """pairs (p, 2) of nodes (index) of elements in one place that nothing joins, the lower index first, no two of one element;
    distance (p,) [m]; place (n,): the first of the nodes that are in one place with each, whatever joins them; side (n,) [m] of
    `shortest_sides`."""

    def __init__(self, mesh: Mesh, joints: Joints):
        nodes = mesh.nodes_of_elements
        self.side = side = shortest_sides(mesh)
        found = np.zeros((0, 2), dtype=np.int64)
        if len(nodes):
            widest = APART * side[nodes].max()
            found = np.sort(nodes[cKDTree(mesh.position[nodes]).query_pairs(widest, output_type="ndarray")], axis=1)
        apart = np.linalg.norm(mesh.position[found[:, 0]] - mesh.position[found[:, 1]], axis=1)
        near = apart <= APART * side[found].min(axis=1)
        found, apart = found[near], apart[near]
        group = component_labels(len(mesh.position), *found.T)
        self.place = np.unique(group, return_index=True)[1][group]
        loose = ~joints.between(*found.T)
        order = np.lexsort(found[loose].T[::-1])
        self.pairs: IntArray = found[loose][order]
        self.distance: FloatArray = apart[loose][order]

    @cached_property
    def unjoined(self) -> IntArray:
        """Nodes in one place with another that nothing joins them to, ascending."""
        return np.unique(self.pairs)


@dataclass(frozen=True)
class Doubled:
    """Elements of a kind, count of them, that lie in one place with another: ids of the first two; whether ties or elements lead
    from each to the other, joined, or from none of them, not joined."""

    kind: str
    first: int
    second: int
    count: int
    joined: bool


def doubled(mesh: Mesh, joints: Joints, coincident: Coincident) -> Iterator[Doubled]:
    """Solids and shells that lie in one place with another of their kind, all their nodes on unjoined ones of it; first those
    whose parts nothing joins anywhere, then the others. Shells whose middles are offset against each other are two layers."""
    alone = np.zeros(len(mesh.position), dtype=bool)
    alone[coincident.unjoined] = True
    found: list[tuple[str, IntArray, IntArray]] = []
    blocks: tuple[CellBlock | ShellBlock, ...] = (*mesh.blocks, *mesh.shells)
    for block in blocks:
        likely = np.flatnonzero(alone[block.nodes].all(axis=1))
        at = np.sort(coincident.place[block.nodes[likely]], axis=1)
        order = np.lexsort(at.T)
        same = np.flatnonzero(np.all(np.diff(at[order], axis=0) == 0, axis=1))
        a, b = likely[order[same]], likely[order[same + 1]]
        if isinstance(block, ShellBlock):
            level = abs(block.offset[a] - block.offset[b]) <= APART * coincident.side[block.nodes[a]].min(axis=1)
            a, b = a[level], b[level]
        if len(a):
            nodes = np.column_stack([block.nodes[a, 0], block.nodes[b, 0]])
            found.append((block.kind, np.sort(np.column_stack([block.ids[a], block.ids[b]]), axis=1), nodes))
    part = joined_parts(mesh, joints) if found else np.zeros(0, dtype=np.int64)
    for joined in (False, True):
        for kind, ids, nodes in found:
            own = ids[(part[nodes[:, 0]] == part[nodes[:, 1]]) == joined]
            if len(own):
                first, second = own[np.argmin(own[:, 0])].tolist()
                yield Doubled(kind, first, second, len(own), joined)


def joined_parts(mesh: Mesh, joints: Joints) -> IntArray:
    """(n,): a number of the part of each node, all that elements and ties lead to from it; the ground is none."""
    links = [joints.edges]
    for nodes, _ in _corners(mesh):
        links.append(np.column_stack([np.repeat(nodes[:, 0], nodes.shape[1]), nodes.ravel()]))
    return component_labels(len(mesh.position), *np.concatenate(links).T)


def shortest_sides(mesh: Mesh) -> FloatArray:
    """(n,) [m]: the shortest distance between two corners of the elements of each node, infinite outside of them."""
    found = np.full(len(mesh.position), np.inf)
    for nodes, corners in _corners(mesh):
        x = mesh.position[corners]
        least = np.full(len(nodes), np.inf)
        for k in range(1, corners.shape[1]):
            apart = np.linalg.norm(x[:, k:] - x[:, :-k], axis=2)
            least = np.minimum(least, np.where(apart > 0, apart, np.inf).min(axis=1))
        np.minimum.at(found, nodes, np.broadcast_to(least[:, None], nodes.shape))
    return found


def _corners(mesh: Mesh) -> Iterator[tuple[IntArray, IntArray]]:
    """All nodes and the corners of the elements, by blocks."""
    for block in mesh.blocks:
        yield block.nodes, block.nodes[:, : kind_of(block.kind).corners]
    for shell in mesh.shells:
        yield shell.nodes, shell.corners
    for beam in mesh.beams:
        yield beam.nodes, beam.nodes[:, :2]


def component_labels(n: int, a: IntArray, b: IntArray) -> IntArray:
    """The connected component (n,) of every node of a graph with edges a–b."""
    graph = sparse.csr_array((np.ones(len(a), dtype=np.int8), (a, b)), shape=(n, n))
    return connected_components(graph, directed=False)[1].astype(np.int64)
