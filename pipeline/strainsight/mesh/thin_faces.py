"""Nodes on faces of shells and sides of beams, for gauges; axes along beams of three nodes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.mesh.coincident import component_labels
from strainsight.mesh.kinds import facet_of
from strainsight.mesh.kinds.kind import Kind
from strainsight.mesh.model import FloatArray, IntArray, Mesh
from strainsight.mesh.thin import BeamBlock, BeamSection, ShellBlock

ALONG = np.array([-1.0, 1.0, 0.0])
"""ξ of the nodes: end A, end B and the middle node."""


def beam_shape(xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """N (q, 3) and ∂N/∂ξ (q, 3) of the nodes A, B and the middle node, at ξ (q,)."""
    N = np.stack([xi * (xi - 1) / 2, xi * (xi + 1) / 2, 1 - xi**2], axis=-1)
    return N, np.stack([xi - 0.5, xi + 0.5, -2 * xi], axis=-1)


def axes_along(position: np.ndarray, axes: np.ndarray, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axes (e, q, 3, 3) of beams at ξ (q,), one in a column, and ∂s/∂ξ (e, q) [m].

    x is along the beam, z perpendicular to it and to y of the beam axes.

    position (e, 3, 3) [m] of the beam at its nodes; axes (e, 3, 3), x from end A to end B."""
    _, slope = beam_shape(xi)
    x = np.einsum("qk,ekc->eqc", slope, position)
    size = np.linalg.norm(x, axis=2)
    x = x / size[..., None]
    z = np.cross(x, axes[:, None, :, 1])
    z /= np.linalg.norm(z, axis=2)[..., None]
    return np.stack([x, np.cross(z, x), z], axis=3), size


SIDES = ((0, 1), (1, 1), (0, -1), (1, -1))
"""Axis across the beam (y, z) and sign of the normal of each side, in the order of their local numbers from 1."""


def with_sides(mesh: Mesh) -> Mesh:
    """The mesh with four nodes on each of the four sides of every beam, after its other nodes, as arms of its ends; with eight,
    including those at mid-length as arms of the middle node, if it has one.

    The sides are those of the box about the stress recovery points of its section (C to F of a PBAR); without such points, of a
    square with its area. Rods, and beams with released ends, have no sides; sections that are open on a side, such as
    between the flanges of an I, lack that side."""
    if any(len(block.on_sides) for block in mesh.beams):
        return mesh
    blocks, places, references, start = [], [], [], len(mesh.position)
    for block in mesh.beams:
        count = 8 if block.nodes.shape[1] == 3 else 4
        on_sides = np.full((len(block.ids), len(SIDES), count), -1, dtype=np.int64)
        selected = np.flatnonzero(~block.released.any(axis=(1, 2)) & (block.kind != "rod"))
        if len(selected):
            x, nodes = _corners(mesh, block, selected)
            has_side = np.array([_ends(mesh, int(region))[0].sides for region in block.region[selected]])
            number = np.full((*has_side.shape, count), -1)
            number[has_side] = start + np.arange(count * np.count_nonzero(has_side)).reshape(-1, count)
            on_sides[selected] = number
            places.append(x[has_side].reshape(-1, 3))
            references.append(nodes[has_side].ravel())
            start += len(places[-1])
        blocks.append(replace(block, on_sides=on_sides))
    if not places:
        return replace(mesh, beams=tuple(blocks))
    return replace(_with_arms(mesh, np.concatenate(references), np.vstack(places)), beams=tuple(blocks))


NO_SIDES = "rods and beams with released ends (pin flags) have no surface"
WITH_SIDES = "Model the members to be measured with beams without pin flags, with shells or with solids"
"""Why line elements carry no gauges, and the remedy."""
NAMED = 3
"""Most elements of a region that a message names."""


def lines_without_sides(mesh: Mesh, ids: IntArray | None = None) -> str:
    """Line elements without sides after `with_sides`, among some elements, by region: "3 line elements (PROD 1: 11, 12, 13)";
    empty without any."""
    count, regions = 0, []
    for block in mesh.beams:
        bare = (block.on_sides < 0).all(axis=(1, 2)) & (True if ids is None else np.isin(block.ids, ids))
        count += int(bare.sum())
        for number in np.unique(block.region[bare]).tolist():
            of_region = block.ids[bare & (block.region == number)]
            more = ", …" * (len(of_region) > NAMED)
            regions.append(f"{mesh.regions[number].name}: {', '.join(map(str, of_region[:NAMED]))}{more}")
    return f"{count} line element{'s' * (count != 1)} ({'; '.join(regions)})" * (count > 0)


def _with_arms(mesh: Mesh, reference: np.ndarray, position: np.ndarray) -> Mesh:
    """The mesh with additional nodes at its end, at positions (a, 3) [m], that follow nodes (a,) as rigid arms."""
    arms = np.column_stack([len(mesh.position) + np.arange(len(reference)), reference])
    return replace(
        mesh,
        node_ids=np.concatenate([mesh.node_ids, mesh.node_ids[reference]]),
        position=np.vstack([mesh.position, position]),
        arms=np.vstack([mesh.arms, arms]),
    )


def _corners(mesh: Mesh, block: BeamBlock, selected: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (e, 4, 4 or 8, 3) of the nodes of the sides, seen from outside, and the nodes (e, 4, 4 or 8) that they follow."""
    boxes = np.array(
        [[_box(end) for end in _ends(mesh, int(region))] for region in block.region[selected]]
    )  # e, end, axis, 2
    k = block.nodes.shape[1]
    line = mesh.position[block.nodes[selected]] + block.offset[selected]
    axes = (
        np.repeat(block.axes[selected][:, None], k, axis=1)
        if k == 2
        else axes_along(line, block.axes[selected], ALONG)[0]
    )
    # including the middle node
    boxes = np.concatenate([boxes, boxes.mean(axis=1, keepdims=True)], axis=1)[:, :k]
    count = 4 if k == 2 else 8
    x, nodes = (
        np.empty((len(selected), len(SIDES), count, 3)),
        np.empty((len(selected), len(SIDES), count), dtype=np.int64),
    )
    for side, (axis, sign) in enumerate(SIDES):
        other = 1 - axis
        for corner, (at, share) in enumerate(around(axis, sign)[:count]):
            out = boxes[:, at, axis, int(sign > 0)]
            along = (1 - share) * boxes[:, at, other, 0] + share * boxes[:, at, other, 1]
            across = out[:, None] * axes[:, at, :, 1 + axis] + along[:, None] * axes[:, at, :, 1 + other]
            x[:, side, corner] = line[:, at] + across
            nodes[:, side, corner] = block.nodes[selected, at]
    return x, nodes


def around(axis: int, sign: int) -> list[tuple[int, float]]:
    """For the eight nodes of a side, corners first, with an outward normal: the node of the beam that each follows, end A, end B
    or the middle one, and its transverse position from 0 to 1."""
    turn = -sign if axis == 0 else sign
    corners = [(0, 0), (1, 0), (1, 1), (0, 1)] if turn > 0 else [(0, 0), (0, 1), (1, 1), (1, 0)]
    after = [*corners[1:], corners[0]]
    between = [(a if a == b else 2, 0.5 * (p + q)) for (a, p), (b, q) in zip(corners, after, strict=True)]
    return [*((at, float(high)) for at, high in corners), *between]


def _ends(mesh: Mesh, region: int) -> tuple[BeamSection, BeamSection]:
    section = mesh.sections[region]
    assert isinstance(section, BeamSection)
    return section, section.at_b or section


def _box(section: BeamSection) -> np.ndarray:
    """Bounds of y, and of z (2, 2) [m]."""
    half = 0.5 * np.sqrt(section.area)
    points = section.points
    if not (len(points) and (np.ptp(points, axis=0) > 0).all()):
        points = np.array(section.neutral) + np.array([[-half, -half], [half, half]])
    return np.stack([points.min(axis=0), points.max(axis=0)], axis=1)


def normals_at_nodes(kind: Kind, position: FloatArray) -> FloatArray:
    """Unit normals (e, k, 3) at the nodes of facets of one kind, x,ξ × x,η, NaN where that is zero; position (e, k, 3) [m]."""
    x_a = np.matmul(kind.gradient(kind.nodes).swapaxes(1, 2), position[:, None])
    normal = np.cross(x_a[:, :, 0], x_a[:, :, 1])
    length = np.linalg.norm(normal, axis=2)[:, :, None]
    return np.asarray(np.divide(normal, length, out=np.full_like(normal, np.nan), where=length > 0))


SMOOTH = np.cos(np.deg2rad(20.0))
"""Cosine of the largest angle between normals of shells with a common face at a node; at larger angles the shell is folded."""
SAME_HEIGHT = 1e-6
"""Largest difference of equal heights of a face, as a share of the thickness."""


def with_faces(mesh: Mesh) -> Mesh:
    """The mesh with nodes on the faces of its shells, after its other nodes, as arms of these:

        x± = x + h± n,     h± = offset ± t/2,     u± = u + θ × h± n

    n is the mean normal of the shells around the node that are smoothly connected, with either orientation, and whose faces have
    the same height; otherwise each shell has separate face nodes. The strain of u± on such a face is the strain of the
    shell at that height, membrane and bending."""
    if not mesh.shells or len(mesh.arms):
        return mesh
    node, normal, low, high = (
        np.concatenate(parts) for parts in zip(*(_faces_at_nodes(mesh, b) for b in mesh.shells), strict=True)
    )
    group, side = _smooth_groups(node, normal, low, high)
    count = int(group.max()) + 1
    first = np.unique(group, return_index=True)[1]
    director = np.zeros((count, 3))
    np.add.at(director, group, side[:, None] * normal)
    director /= np.linalg.norm(director, axis=1)[:, None]
    # heights along the director of the group: those of its first corner
    heights = np.stack([high[first], low[first]], axis=1)
    node_count = len(mesh.position)
    reference = np.repeat(node[first], 2)
    place = mesh.position[reference] + (heights[:, :, None] * director[:, None]).reshape(-1, 3)
    above = node_count + 2 * group + (side < 0)
    below = node_count + 2 * group + (side > 0)
    shells, start = [], 0
    for block in mesh.shells:
        cut = slice(start, start + block.nodes.size)
        faces = np.stack([above[cut].reshape(block.nodes.shape), below[cut].reshape(block.nodes.shape)], axis=1)
        shells.append(replace(block, on_faces=faces))
        start = cut.stop
    return replace(_with_arms(mesh, reference, place), shells=tuple(shells))


def _faces_at_nodes(mesh: Mesh, block: ShellBlock) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """For every node of the shells (e k,): its index, the normal of the shell there (, 3), the heights of both faces."""
    k = block.nodes.shape[1]
    normal = normals_at_nodes(facet_of(block.kind), mesh.position[block.nodes])
    thickness = {
        number: section.thickness for number, section in mesh.sections.items() if not isinstance(section, BeamSection)
    }
    half = 0.5 * np.array([thickness[int(region)] for region in block.region])
    low, high = block.offset - half, block.offset + half
    return block.nodes.ravel(), normal.reshape(-1, 3), np.repeat(low, k), np.repeat(high, k)


def _smooth_groups(
    node: np.ndarray, normal: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Corners and mid-sides (c,) → group of smoothly connected ones around a node, and ±1: whether the normal of each is that of
    the first of its group or its opposite."""
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
    is_opposite = same < 0
    other_low = np.where(is_opposite, -high[second], low[second])
    other_high = np.where(is_opposite, -low[second], high[second])
    near = SAME_HEIGHT * (high - low)[first]
    same_height = (np.abs(other_low - low[first]) < near) & (np.abs(other_high - high[first]) < near)
    joined = (np.abs(same) > SMOOTH) & same_height
    group = component_labels(len(node), first[joined], second[joined])
    lead = np.unique(group, return_index=True)[1][group]
    return group, np.where(np.sum(normal * normal[lead], axis=1) < 0, -1.0, 1.0)
