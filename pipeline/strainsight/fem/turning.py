"""Nodes that turn with a reference node without being one."""

from __future__ import annotations

import numpy as np

from strainsight.mesh.model import Mesh


def followers(mesh: Mesh) -> set[int]:
    """Nodes (indices) that a RigidElement turns."""
    return {int(node) for e in mesh.rigid if max(e.components, default=0) > 2 for node in e.nodes}


def turning_nodes(mesh: Mesh) -> list[int]:
    """Those of them whose rotation matters: a mass or a spring resists it, or a load of the file has a moment there."""
    found = {point.node for point in mesh.point_masses if np.any(point.offset) or np.any(point.inertia)}
    for own in mesh.springs:
        found.update(own.node[(own.component > 2) & (own.value != 0)].tolist())
    for load in mesh.loads.values():
        if load.moment is not None:
            found.update(load.nodes[load.moment.any(axis=1)].tolist())
    return sorted(found & followers(mesh))
