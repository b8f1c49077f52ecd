"""Pieces of a structure that are stiff in themselves, and the nodes where one turns against another."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from strainsight.mesh.kinds import kind_of
from strainsight.mesh.model import FloatArray, IntArray, Mesh
from strainsight.mesh.unjoined import component_labels

IN_LINE = 1e-6
"""Nodes lie on one line where their extent across it is no more of that along it."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """node, piece (m,): pairs of a node (index) and a piece, from 0, one of whose elements has it; label (n,) the piece that a
    node moves with, −1 of nodes outside the elements: where pieces meet that of shells or beams, which resist its rotations."""

    node: IntArray
    piece: IntArray
    label: IntArray

    @property
    def count(self) -> int:
        """How many there are."""
        return int(self.piece.max()) + 1

    @cached_property
    def meeting(self) -> tuple[IntArray, IntArray]:
        """Nodes (s,), and the pieces (s,) that have them beside the one that they move with."""
        beside = self.label[self.node] != self.piece
        return self.node[beside], self.piece[beside]


def whole(mesh: Mesh) -> Pieces:
    """The structure as one."""
    nodes = mesh.nodes_of_elements
    return _apart(mesh, np.zeros(len(nodes), dtype=np.int64))


def parts(mesh: Mesh) -> Pieces:
    """Parts that share no node with each other."""
    component = _connected(len(mesh.position), mesh.connectivity)
    return _apart(mesh, np.unique(component[mesh.nodes_of_elements], return_inverse=True)[1])


def stiff_pieces(mesh: Mesh) -> Pieces:
    """Pieces that are stiff in themselves: solids joined by facets; shells and beams joined by nodes.

    Two that share three nodes which lie on no line are one. Others are hinged where they meet: solids along an edge or at a
    corner, a shell that stands on a solid along a line. Rods, and ends of beams that are released, count as joined stiffly.
    """
    n = len(mesh.position)
    thin = _connected(n, [block.nodes for block in mesh.thin])
    turning = mesh.thin_nodes
    at = [turning, *(block.nodes.ravel() for block in mesh.blocks)]
    of = [
        thin[turning],
        *(np.repeat(n + own, block.nodes.shape[1]) for own, block in zip(_solids(mesh), mesh.blocks, strict=True)),
    ]
    _, piece = np.unique(np.concatenate(of), return_inverse=True)
    node = np.concatenate(at)
    own = piece[: len(turning)]
    while True:
        count = int(piece.max()) + 1
        node, piece = np.divmod(np.unique(node * count + piece), count)
        merged = _merged(mesh.position, node, piece)
        if merged.max() == piece.max():
            break
        own, piece = merged[own], merged[piece]
    label = np.full(n, -1)
    label[node] = piece
    label[turning] = own
    return Pieces(node, piece, label)


def _apart(mesh: Mesh, piece: IntArray) -> Pieces:
    """Of one piece (m,) for every node of the elements."""
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


def _solids(mesh: Mesh) -> list[IntArray]:
    """Of every block the component (e,) of its elements, through the facets that they share."""
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


def _merged(position: FloatArray, node: IntArray, piece: IntArray) -> IntArray:
    """New numbers (pieces,) of pieces, the same for two that share nodes which lie on no line; pairs sorted by node."""
    count = int(piece.max()) + 1
    several = np.flatnonzero(np.bincount(node)[node] > 1)
    shared: dict[tuple[int, int], list[int]] = defaultdict(list)
    for group in np.split(several, np.flatnonzero(np.diff(node[several])) + 1):
        for pair in combinations(piece[group].tolist(), 2):
            shared[pair].append(int(node[group[0]]))
    joined = [pair for pair, at in shared.items() if len(at) > 2 and _spread(position[at])]
    rows, columns = np.array(joined, dtype=np.int64).reshape(-1, 2).T
    return component_labels(count, rows, columns)


def _spread(x: FloatArray) -> bool:
    """Whether points (k, 3) lie on no line."""
    extent = np.linalg.svd(x - x.mean(axis=0), compute_uv=False)
    return bool(extent[1] > IN_LINE * extent[0])


SHOWN = 3
"""How many are named."""


def hinge_warnings(mesh: Mesh) -> tuple[str, ...]:
    """A sentence on pieces that share an edge or a corner with another, where no tie or spring joins the two besides.

    The structure may be held all the same, so that nothing else would show it.
    """
    if len(mesh.elements) == 0:
        return ()
    pieces = stiff_pieces(mesh)
    node, other = pieces.meeting
    if not len(node):
        return ()
    tied = _tied(mesh, pieces.node, pieces.piece, pieces.count)
    pairs = np.sort(np.column_stack([pieces.label[node], other]), axis=1)
    found, of = np.unique(pairs, axis=0, return_inverse=True)
    free = [i for i, pair in enumerate(found.tolist()) if tuple(pair) not in tied]
    words = [_words(mesh, np.unique(node[of.ravel() == i])) for i in free[:SHOWN]]
    if not words:
        return ()
    more = f" and in {len(free) - SHOWN} more places" if len(free) > SHOWN else ""
    return (
        f"parts share no more than {'; '.join(words)}{more}: they turn against each other there as on a hinge; where that is "
        "not meant, mesh them with common facets, or tie them (docs/decks.md, where a shell meets a solid)",
    )


def _words(mesh: Mesh, nodes: IntArray) -> str:
    ids = mesh.node_ids[nodes]
    if len(ids) == 1:
        return f"node {ids[0]}"
    return f"nodes {', '.join(map(str, ids[:4]))}{', …' if len(ids) > 4 else ''}"


def _tied(mesh: Mesh, node: IntArray, piece: IntArray, count: int) -> set[tuple[int, int]]:
    """Pairs of pieces that a tie, relation or spring has nodes of."""
    found: set[tuple[int, int]] = set()
    order = np.argsort(node, kind="stable")
    node, piece = node[order], piece[order]
    for own in _joints(mesh):
        low, high = (np.searchsorted(node, own, side) for side in ("left", "right"))
        touched = sorted({int(piece[i]) for a, b in zip(low, high, strict=True) for i in range(a, b)})
        if len(touched) < count or count < 3:
            found |= {(a, b) for a in touched for b in touched if a < b}
        else:
            return {(a, b) for b in range(count) for a in range(b)}
    return found


def _joints(mesh: Mesh) -> Iterator[IntArray]:
    yield from (np.append(tie.nodes, tie.reference) for tie in mesh.rigid)
    yield from (np.append(tie.nodes, tie.reference) for tie in mesh.averaging)
    yield from (relation.node for relation in mesh.relations)
    for springs in mesh.springs:
        yield from (springs.node[springs.spring == i] for i in range(len(springs.stiffness)))
