"""Normals of facets and shells at their nodes."""

from __future__ import annotations

import numpy as np

from strainsight.mesh.kinds.kind import Kind
from strainsight.mesh.model import FloatArray


def normals_at_nodes(kind: Kind, position: FloatArray) -> FloatArray:
    """Unit normals (e, k, 3) at the nodes of facets of one kind, x,ξ × x,η, not a number where that is zero; position
    (e, k, 3) [m]."""
    x_a = np.matmul(kind.gradient(kind.nodes).swapaxes(1, 2), position[:, None])
    normal = np.cross(x_a[:, :, 0], x_a[:, :, 1])
    length = np.linalg.norm(normal, axis=2)[:, :, None]
    return np.asarray(np.divide(normal, length, out=np.full_like(normal, np.nan), where=length > 0))
