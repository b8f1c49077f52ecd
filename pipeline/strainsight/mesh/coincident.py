"""Coincident nodes and elements that nothing connects, and connected parts of a mesh."""

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
"""Largest distance of coincident nodes, as a share of the shortest side of the elements there."""


class Joints:
    """Joints between nodes of a mesh in addition to elements. Rigid elements, relations and springs connect all their nodes, also
    through each other; an averaging element connects its reference to each other node, but not these to each other; the ground
    connects all nodes with three clamped translations. edges (e, 2): all joints except those of the ground."""

    def __init__(self, mesh: Mesh):
        n = len(mesh.position)
        edges = [np.zeros((0, 2), dtype=np.int64)]
        edges += [np.column_stack([np.full(len(e.nodes), e.reference), e.nodes]) for e in mesh.rigid]
        edges += [np.column_stack([np.full(len(tie.node), tie.node[0]), tie.node]) for tie in mesh.relations]
        for spring in mesh.springs:
            first = np.full(len(spring.stiffness), -1)
            first[spring.spring[::-1]] = spring.node[::-1]
            edges.append(np.column_stack([first[spring.spring], spring.node]))
        components, clamped = mesh.fixed.reshape(-1, 2)[:, 1], mesh.fixed.reshape(-1, 2)[:, 0]
        averaged = [np.column_stack([np.full(len(e.nodes), e.reference), e.nodes]) for e in mesh.averaging]
        self.edges: IntArray = np.concatenate([*edges, *averaged])
        ground = np.flatnonzero(
            np.bincount(np.unique(clamped[components < 3] * 3 + components[components < 3]) // 3) == 3
        )
        edges.append(np.column_stack([np.repeat(ground[:1], len(ground)), ground]))
        a, b = np.concatenate(edges).T
        self._group = component_labels(n, a, b)
        pairs = np.sort(np.concatenate([np.zeros((0, 2), dtype=np.int64), *averaged]), axis=1)
        self._n, self._averaged = n, np.unique(pairs @ [n, 1])

    def between(self, a: IntArray, b: IntArray) -> NDArray[np.bool_]:
        """Whether nodes a and b, arrays of equal shape, are connected."""
        direct = np.isin(np.minimum(a, b) * self._n + np.maximum(a, b), self._averaged)
        return np.asarray((self._group[a] == self._group[b]) | direct)


class Coincident:
    """pairs (p, 2) of coincident nodes (index) of elements without connection, the lower index first, no two of one element;
    distance (p,) [m]; place (n,): the first of the nodes that coincide with each, connected or not; side (n,) [m] of
    `shortest_sides`."""

    def __init__(self, mesh: Mesh, joints: Joints):
        nodes = mesh.nodes_of_elements
        self.side = side = shortest_sides(mesh)
        pairs = np.zeros((0, 2), dtype=np.int64)
        if len(nodes):
            widest = APART * side[nodes].max()
            pairs = np.sort(nodes[cKDTree(mesh.position[nodes]).query_pairs(widest, output_type="ndarray")], axis=1)
        distance = np.linalg.norm(mesh.position[pairs[:, 0]] - mesh.position[pairs[:, 1]], axis=1)
        near = distance <= APART * side[pairs].min(axis=1)
        pairs, distance = pairs[near], distance[near]
        group = component_labels(len(mesh.position), *pairs.T)
        self.place = np.unique(group, return_index=True)[1][group]
        loose = ~joints.between(*pairs.T)
        order = np.lexsort(pairs[loose].T[::-1])
        self.pairs: IntArray = pairs[loose][order]
        self.distance: FloatArray = distance[loose][order]

    @cached_property
    def unjoined(self) -> IntArray:
        """Nodes that coincide with another without connection, ascending."""
        return np.unique(self.pairs)


@dataclass(frozen=True)
class Doubled:
    """Coincident elements of a kind: their count, ids of the first two; joined: whether ties or elements connect their parts
    elsewhere."""

    kind: str
    first: int
    second: int
    count: int
    joined: bool


def doubled(mesh: Mesh, joints: Joints, coincident: Coincident) -> Iterator[Doubled]:
    """Solids and shells that coincide with another of their kind, with all nodes unconnected to those of the other. First pairs
    whose parts are not connected anywhere, then the others. Shells with different offsets of their middles are two layers."""
    alone = np.zeros(len(mesh.position), dtype=bool)
    alone[coincident.unjoined] = True
    candidates: list[tuple[str, IntArray, IntArray]] = []
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
            candidates.append((block.kind, np.sort(np.column_stack([block.ids[a], block.ids[b]]), axis=1), nodes))
    part = joined_parts(mesh, joints) if candidates else np.zeros(0, dtype=np.int64)
    for joined in (False, True):
        for kind, ids, nodes in candidates:
            pairs = ids[(part[nodes[:, 0]] == part[nodes[:, 1]]) == joined]
            if len(pairs):
                first, second = pairs[np.argmin(pairs[:, 0])].tolist()
                yield Doubled(kind, first, second, len(pairs), joined)


def joined_parts(mesh: Mesh, joints: Joints) -> IntArray:
    """(n,): number of the part of each node, connected through elements and ties, but not through the ground."""
    links = [joints.edges]
    for nodes, _ in _corners(mesh):
        links.append(np.column_stack([np.repeat(nodes[:, 0], nodes.shape[1]), nodes.ravel()]))
    return component_labels(len(mesh.position), *np.concatenate(links).T)


def shortest_sides(mesh: Mesh) -> FloatArray:
    """(n,) [m]: the shortest distance between two corners of the elements of each node, infinite outside of elements."""
    result = np.full(len(mesh.position), np.inf)
    for nodes, corners in _corners(mesh):
        x = mesh.position[corners]
        least = np.full(len(nodes), np.inf)
        for k in range(1, corners.shape[1]):
            distance = np.linalg.norm(x[:, k:] - x[:, :-k], axis=2)
            least = np.minimum(least, np.where(distance > 0, distance, np.inf).min(axis=1))
        np.minimum.at(result, nodes, np.broadcast_to(least[:, None], nodes.shape))
    return result


def _corners(mesh: Mesh) -> Iterator[tuple[IntArray, IntArray]]:
    """All nodes, and the corner nodes, of the elements by block."""
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
