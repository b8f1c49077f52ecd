"""Lines and points by which solids hang together: hinges, in words for a warning."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from strainsight.fem.pieces import stiff_pieces
from strainsight.mesh.model import IntArray, Mesh

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
    yield from (own.node for own in mesh.relations)
    for springs in mesh.springs:
        yield from (springs.node[springs.spring == i] for i in range(len(springs.stiffness)))
