"""Boxes of solids, alone and side by side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.mesh.model import CellBlock

from ..bodies import body


def both(*meshes):
    """Meshes side by side in one, with ids of their own."""
    shift = np.cumsum([0, *(len(mesh.position) for mesh in meshes[:-1])])
    elements = np.cumsum([0, *(sum(len(block.ids) for block in mesh.blocks) for mesh in meshes[:-1])])
    blocks = [
        replace(block, nodes=block.nodes + by, ids=block.ids + after)
        for mesh, by, after in zip(meshes, shift, elements, strict=True)
        for block in mesh.blocks
    ]
    of_kind = [[block for block in blocks if block.kind == kind] for kind in dict.fromkeys(b.kind for b in blocks)]
    joined = [
        CellBlock(
            own[0].kind, *(np.concatenate([getattr(b, name) for b in own]) for name in ("ids", "nodes", "region"))
        )
        for own in of_kind
    ]
    x = np.vstack([mesh.position for mesh in meshes])
    return replace(meshes[0], node_ids=np.arange(1, len(x) + 1), position=x, blocks=tuple(joined))


def box(kind="hex8", counts=(2, 2, 2), size=(1.0, 1.0, 1.0), at=(0.0, 0.0, 0.0)):
    step = np.array(size) / counts
    return body(kind, counts, lambda *u: np.array(at) + step * u)


TWO = both(box(), box(at=(1, 0, 0)))
"""Cubes of eight elements that touch on the face x = 1, nine nodes of each."""
FACE = np.flatnonzero(TWO.position[:, 0] == 1).reshape(2, 9)
