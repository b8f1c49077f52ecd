"""Nodes that have rotations without being a reference node."""

from __future__ import annotations

from strainsight.mesh.model import Mesh


def followers(mesh: Mesh) -> set[int]:
    """Nodes (indices) that a RigidElement turns."""
    return {int(node) for e in mesh.rigid if max(e.components, default=0) > 2 for node in e.nodes}


def turning_nodes(mesh: Mesh) -> list[int]:
    """Nodes of shells and beams, points that springs turn, and those that a RigidElement turns where that matters: a mass or a
    spring resists it, or a load of the file has a moment there."""
    found = {point.node for point in mesh.point_masses if point.turns}
    for own in mesh.springs:
        found.update(own.turned.tolist())
    for load in mesh.loads.values():
        if load.moment is not None:
            found.update(load.nodes[load.moment.any(axis=1)].tolist())
    return sorted((found & followers(mesh)).union(mesh.turning.tolist(), mesh.turned_by_springs.tolist()))
