"""Which solids are numbered the other way round."""

from __future__ import annotations

import numpy as np

from strainsight.mesh.kinds.kind import ElementKind
from strainsight.mesh.model import FloatArray, IntArray


def left_handed(kind: ElementKind, nodes: IntArray, position: FloatArray) -> np.ndarray:
    """Elements (n,) of nodes (n, k) whose edges a, b, c at every corner are left-handed: (a × b) · c < 0."""
    found = np.ones(len(nodes), dtype=bool)
    for a, *others in kind.sides:
        edges = np.stack([position[nodes[:, b]] - position[nodes[:, a]] for b in others], axis=1)
        with np.errstate(all="ignore"):
            found &= np.einsum("ei,ei->e", np.cross(edges[:, 0], edges[:, 1]), edges[:, 2]) < 0
    return found
