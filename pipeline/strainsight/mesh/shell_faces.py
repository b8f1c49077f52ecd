"""The two faces of shells as a surface of their own: where gauges sit, and what moves there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from strainsight.mesh.kinds import facet_of
from strainsight.mesh.model import Mesh
from strainsight.mesh.shell_normals import normals_at_nodes
from strainsight.mesh.thin import BeamSection, ShellBlock

SMOOTH = np.cos(np.deg2rad(20.0))
"""Of the angle between normals of shells that share a face around their node; beyond it the shell is folded there."""
ALIKE = 1e-6
"""Of the thickness: heights of a face that are the same."""


def with_faces(mesh: Mesh) -> Mesh:
    """The mesh with nodes on the faces of its shells, behind its own nodes, as arms of these:

        x± = x + h± n,     h± = offset ± t/2,     u± = u + θ × h± n

    n is the mean normal of the shells around the node that go on smoothly into each other, whichever side each takes for its
    upper one, with faces at the same height; where they do not, each has nodes of its own. What a gauge reads of u± on
    such a face is the strain of the shell at that height, membrane and bending.
    """
    if not mesh.shells or len(mesh.arms):
        return mesh
    node, normal, low, high = (
        np.concatenate(parts) for parts in zip(*(_around(mesh, b) for b in mesh.shells), strict=True)
    )
    group, side = _smooth(node, normal, low, high)
    count = int(group.max()) + 1
    first = np.unique(group, return_index=True)[1]
    director = np.zeros((count, 3))
    np.add.at(director, group, side[:, None] * normal)
    director /= np.linalg.norm(director, axis=1)[:, None]
    # heights along the director of the group: those of its first corner, whose side is its own
    heights = np.stack([high[first], low[first]], axis=1)
    own = len(mesh.position)
    reference = np.repeat(node[first], 2)
    place = mesh.position[reference] + (heights[:, :, None] * director[:, None]).reshape(-1, 3)
    above = own + 2 * group + (side < 0)
    below = own + 2 * group + (side > 0)
    shells, start = [], 0
    for block in mesh.shells:
        cut = slice(start, start + block.nodes.size)
        faces = np.stack([above[cut].reshape(block.nodes.shape), below[cut].reshape(block.nodes.shape)], axis=1)
        shells.append(replace(block, on_faces=faces))
        start = cut.stop
    arms = np.column_stack([own + np.arange(2 * count), reference])
    return replace(
        mesh,
        node_ids=np.concatenate([mesh.node_ids, mesh.node_ids[reference]]),
        position=np.vstack([mesh.position, place]),
        shells=tuple(shells),
        arms=arms,
    )


def _around(mesh: Mesh, block: ShellBlock) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of every node of the shells (e k,): its index, the normal of the shell there (, 3), the heights of both its faces."""
    k = block.nodes.shape[1]
    kind = facet_of(block.kind)
    normal = normals_at_nodes(kind, mesh.position[block.nodes])
    half = 0.5 * np.array([_thickness(mesh, int(region)) for region in block.region])
    low, high = block.offset - half, block.offset + half
    return block.nodes.ravel(), normal.reshape(-1, 3), np.repeat(low, k), np.repeat(high, k)


def _thickness(mesh: Mesh, region: int) -> float:
    section = mesh.sections[region]
    assert not isinstance(section, BeamSection)
    return section.thickness


def _smooth(node: np.ndarray, normal: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners and mid-sides (c,) → group of those around one node that go on smoothly into each other, and ±1: whether the
    normal of each is that of the first of its group or against it."""
    order = np.argsort(node, kind="stable")
    start = np.flatnonzero(np.diff(node[order], prepend=-1))
    size = np.diff(np.append(start, len(order)))
    a, b = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for k in np.unique(size[size > 1]):
        members = order[start[size == k][:, None] + np.arange(k)]
        i, j = np.triu_indices(k, 1)
        a.append(members[:, i].ravel())
        b.append(members[:, j].ravel())
    first, second = np.concatenate(a), np.concatenate(b)
    same = np.sum(normal[first] * normal[second], axis=1)
    turned = same < 0
    other_low = np.where(turned, -high[second], low[second])
    other_high = np.where(turned, -low[second], high[second])
    near = ALIKE * (high - low)[first]
    alike = (np.abs(other_low - low[first]) < near) & (np.abs(other_high - high[first]) < near)
    joined = (np.abs(same) > SMOOTH) & alike
    c = len(node)
    graph = sparse.csr_array((np.ones(joined.sum()), (first[joined], second[joined])), shape=(c, c))
    _, group = connected_components(graph, directed=False)
    lead = np.unique(group, return_index=True)[1][group]
    return group, np.where(np.sum(normal * normal[lead], axis=1) < 0, -1.0, 1.0)
