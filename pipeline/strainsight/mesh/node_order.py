"""Order of the nodes of second-order elements, by where their mid-side nodes lie."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.kinds import facet_of, kind_of
from strainsight.mesh.kinds.kind import Edges
from strainsight.mesh.model import CellBlock, Mesh
from strainsight.mesh.thin import ShellBlock

OFF = 0.3
"""Distance of a mid-side node from the middle of its edge, over the length of that, that no shape of an element explains."""
SEEN = 1000
"""Elements of which it is asked whether their mid-side nodes lie on other edges."""


def check_node_order(mesh: Mesh) -> None:
    """Raise DeckError where in every element of a kind mid-side nodes lie in the middles of other edges than their own."""
    for kind, edges, blocks in _kinds(mesh):
        nodes = np.concatenate([block.nodes for block in blocks])
        a, b = (mesh.position[nodes[:, ends]] for ends in np.transpose(edges))
        middle, half = mesh.position[nodes[:, -len(edges) :]], 0.5 * (a + b)
        length = np.maximum(np.linalg.norm(b - a, axis=2), np.finfo(float).tiny)
        off = (np.linalg.norm(middle - half, axis=2) / length).max(axis=1)
        if not off.min() > OFF:
            continue
        apart = np.linalg.norm(middle[:SEEN, :, None] - half[:SEEN, None], axis=3) / length[:SEEN, None]
        if apart.min(axis=2).max() <= OFF and (np.sort(apart.argmin(axis=2), axis=1) == np.arange(len(edges))).all():
            raise DeckError(
                f"mid-side nodes lie off the middles of their edges in all {len(off)} {kind} elements, by {off.min():.2g} of "
                "the length of the edge and more, and in the middles of other edges: the order of the nodes is another one",
                remedy="write the nodes of these elements in the order that the format of the file has",
                entity=("element", int(blocks[0].ids[0])),
            )


def _kinds(mesh: Mesh) -> Iterator[tuple[str, Edges, list[CellBlock | ShellBlock]]]:
    """Name, edges with a node between, and blocks of each kind of second-order solids and shells."""
    of_kind: dict[str, list[CellBlock | ShellBlock]] = {}
    second: list[CellBlock | ShellBlock] = [*mesh.blocks, *mesh.shells]
    for block in second:
        of_kind.setdefault(block.kind, []).append(block)
    for kind, blocks in of_kind.items():
        edges = (kind_of(kind) if isinstance(blocks[0], CellBlock) else facet_of(kind)).edges
        if edges and any(len(block.nodes) for block in blocks):
            yield kind, edges, blocks
