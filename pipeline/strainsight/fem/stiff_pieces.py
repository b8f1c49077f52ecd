"""Stiff parts of a structure, and the nodes where they are hinged to each other."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from strainsight.mesh.coincident import component_labels
from strainsight.mesh.kinds import kind_of
from strainsight.mesh.model import FloatArray, IntArray, Mesh

IN_LINE = 1e-6
"""Largest ratio of the extents across and along a line of nodes that counts as straight."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """node, piece (m,): pairs of a node (index) and a piece, from 0, that contains it; label (n,): the piece that a node moves
    with (at a connection that of shells or beams, which resist its rotations), −1 for nodes outside the elements."""

    node: IntArray
    piece: IntArray
    label: IntArray

    @property
    def count(self) -> int:
        """Number of pieces."""
        return int(self.piece.max()) + 1

    @cached_property
    def meeting(self) -> tuple[IntArray, IntArray]:
        """Nodes (s,), and the pieces (s,) that contain them in addition to the piece that they move with."""
        is_other = self.label[self.node] != self.piece
        return self.node[is_other], self.piece[is_other]


def single_piece(mesh: Mesh) -> Pieces:
    """The structure as one piece."""
    return _disjoint_pieces(mesh, np.zeros(len(mesh.nodes_of_elements), dtype=np.int64))


def parts(mesh: Mesh) -> Pieces:
    """Parts that share no node with each other."""
    component = _connected(len(mesh.position), mesh.connectivity)
    return _disjoint_pieces(mesh, np.unique(component[mesh.nodes_of_elements], return_inverse=True)[1])


def stiff_pieces(mesh: Mesh) -> Pieces:
    """Stiff pieces: solids joined by facets; shells and beams joined by nodes.

    Pieces that share three nodes not on one line are merged. Other pieces are hinged where they meet: solids along an edge
    or at a corner, a shell that meets a solid along a line. Rods and released ends of beams count as joined stiffly."""
    n = len(mesh.position)
    thin = _connected(n, [block.nodes for block in mesh.thin])
    turning = mesh.thin_nodes
    at = [turning, *(block.nodes.ravel() for block in mesh.blocks)]
    of = [
        thin[turning],
        *(
            np.repeat(n + solid, block.nodes.shape[1])
            for solid, block in zip(_solid_components(mesh), mesh.blocks, strict=True)
        ),
    ]
    _, piece = np.unique(np.concatenate(of), return_inverse=True)
    node = np.concatenate(at)
    thin_piece = piece[: len(turning)]
    while True:
        count = int(piece.max()) + 1
        node, piece = np.divmod(np.unique(node * count + piece), count)
        merged_piece = _merge(mesh.position, node, piece)
        if merged_piece.max() == piece.max():
            break
        thin_piece, piece = merged_piece[thin_piece], merged_piece[piece]
    label = np.full(n, -1)
    label[node] = piece
    label[turning] = thin_piece
    return Pieces(node, piece, label)


def _disjoint_pieces(mesh: Mesh, piece: IntArray) -> Pieces:
    """Pieces that share no node: piece (m,) of every node of the elements."""
    nodes = mesh.nodes_of_elements
    label = np.full(len(mesh.position), -1)
    label[nodes] = piece
    return Pieces(nodes, piece, label)


def _connected(n: int, connectivity: Sequence[IntArray]) -> IntArray:
    """Component (n,) of each node, through the elements that share nodes."""
    rows, columns = (
        np.concatenate([np.zeros(0, dtype=np.int64), *(nodes[:, some].ravel() for nodes in connectivity)])
        for some in (slice(None, -1), slice(1, None))
    )
    return component_labels(n, rows, columns)


def _solid_components(mesh: Mesh) -> list[IntArray]:
    """Component (e,) of the elements of each block, connected through shared facets."""
    keys, elements, count = [], [], 0
    for block in mesh.blocks:
        for kind, local in kind_of(block.kind).facets:
            key = np.full((len(block.ids), 4), -1, dtype=np.int64)
            key[:, : kind.corners] = block.nodes[:, local[: kind.corners]]
            keys.append(np.sort(key, axis=1))
            elements.append(count + np.arange(len(block.ids)))
        count += len(block.ids)
    if not keys:
        return []
    key, element = np.concatenate(keys), np.concatenate(elements)
    order = np.lexsort(key.T)
    same = np.all(key[order[1:]] == key[order[:-1]], axis=1)
    component = component_labels(count, element[order[:-1][same]], element[order[1:][same]])
    return np.split(component, np.cumsum([len(block.ids) for block in mesh.blocks])[:-1])


def _merge(position: FloatArray, node: IntArray, piece: IntArray) -> IntArray:
    """New numbers (pieces,) of pieces, equal for two that share nodes not on one line; pairs sorted by node."""
    count = int(piece.max()) + 1
    several = np.flatnonzero(np.bincount(node)[node] > 1)
    shared: dict[tuple[int, int], list[int]] = defaultdict(list)
    for group in np.split(several, np.flatnonzero(np.diff(node[several])) + 1):
        for pair in combinations(piece[group].tolist(), 2):
            shared[pair].append(int(node[group[0]]))
    joined = [pair for pair, at in shared.items() if len(at) > 2 and _is_not_collinear(position[at])]
    rows, columns = np.array(joined, dtype=np.int64).reshape(-1, 2).T
    return component_labels(count, rows, columns)


def _is_not_collinear(x: FloatArray) -> bool:
    """Whether points (k, 3) do not lie on one line."""
    extent = np.linalg.svd(x - x.mean(axis=0), compute_uv=False)
    return bool(extent[1] > IN_LINE * extent[0])


SHOWN = 3
"""Number of hinges in the warning."""


def hinge_warnings(mesh: Mesh) -> tuple[str, ...]:
    """Warning about pieces that share only an edge or a corner, and that no tie or spring connects.

    The supports may still prevent their motion, so that no other check detects the hinge."""
    if len(mesh.elements) == 0:
        return ()
    pieces = stiff_pieces(mesh)
    node, other = pieces.meeting
    if not len(node):
        return ()
    tied = _tied_pairs(mesh, pieces.node, pieces.piece, pieces.count)
    pairs = np.sort(np.column_stack([pieces.label[node], other]), axis=1)
    pairs_found, pair_of_node = np.unique(pairs, axis=0, return_inverse=True)
    free = [i for i, pair in enumerate(pairs_found.tolist()) if tuple(pair) not in tied]
    words = [_node_names(mesh, np.unique(node[pair_of_node.ravel() == i])) for i in free[:SHOWN]]
    if not words:
        return ()
    more = f" (number of further hinges: {len(free) - SHOWN})" if len(free) > SHOWN else ""
    return (
        f"parts of the mesh share only {'; '.join(words)}{more} and are hinged there. If no hinge is intended, let the parts "
        'share element faces or tie them (docs/decks.md, "Where a shell meets a solid").',
    )


def _node_names(mesh: Mesh, nodes: IntArray) -> str:
    ids = mesh.node_ids[nodes]
    if len(ids) == 1:
        return f"node {ids[0]}"
    return f"nodes {', '.join(map(str, ids[:4]))}{', …' if len(ids) > 4 else ''}"


def _tied_pairs(mesh: Mesh, node: IntArray, piece: IntArray, count: int) -> set[tuple[int, int]]:
    """Pairs of pieces that a tie, relation or spring connects."""
    tied: set[tuple[int, int]] = set()
    order = np.argsort(node, kind="stable")
    node, piece = node[order], piece[order]
    for joint_nodes in _joints(mesh):
        low, high = (np.searchsorted(node, joint_nodes, side) for side in ("left", "right"))
        touched = sorted({int(piece[i]) for a, b in zip(low, high, strict=True) for i in range(a, b)})
        if len(touched) < count or count < 3:
            tied |= {(a, b) for a in touched for b in touched if a < b}
        else:
            return {(a, b) for b in range(count) for a in range(b)}
    return tied


def _joints(mesh: Mesh) -> Iterator[IntArray]:
    yield from (np.append(tie.nodes, tie.reference) for tie in mesh.rigid)
    yield from (np.append(tie.nodes, tie.reference) for tie in mesh.averaging)
    yield from (relation.node for relation in mesh.relations)
    for springs in mesh.springs:
        yield from (springs.node[springs.spring == i] for i in range(len(springs.stiffness)))
