"""The sides of beams as facets: where gauges sit on them, and how they look."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.mesh.beam_axes import ALONG, axes_along
from strainsight.mesh.model import Mesh
from strainsight.mesh.thin import BeamBlock, BeamSection

SIDES = ((0, 1), (1, 1), (0, -1), (1, -1))
"""Axis across the beam (y, z) and sign of the normal of each side, in the order of their local numbers from 1."""


def with_sides(mesh: Mesh) -> Mesh:
    """The mesh with four nodes on each of the four sides of every beam, behind its other nodes, as arms of its ends; with eight,
    those in the middle of its length as arms of the node there, where it has one.

    The sides are those of the box about the points of its section where strain is asked for (C to F of a PBAR); without such
    points that of a square with its area. Rods, and beams that do not hand on all motions of their ends, have none, and a
    section that is open there, as between the flanges of an I, lacks that side.
    """
    if any(len(block.on_sides) for block in mesh.beams):
        return mesh
    blocks, places, references, start = [], [], [], len(mesh.position)
    for block in mesh.beams:
        count = 8 if block.nodes.shape[1] == 3 else 4
        on_sides = np.full((len(block.ids), len(SIDES), count), -1, dtype=np.int64)
        own = np.flatnonzero(~block.released.any(axis=(1, 2)) & (block.kind != "rod"))
        if len(own):
            x, nodes = _corners(mesh, block, own)
            there = np.array([_ends(mesh, int(region))[0].sides for region in block.region[own]])
            number = np.full((*there.shape, count), -1)
            number[there] = start + np.arange(count * np.count_nonzero(there)).reshape(-1, count)
            on_sides[own] = number
            places.append(x[there].reshape(-1, 3))
            references.append(nodes[there].ravel())
            start += len(places[-1])
        blocks.append(replace(block, on_sides=on_sides))
    if not places:
        return replace(mesh, beams=tuple(blocks))
    reference = np.concatenate(references)
    arms = np.column_stack([len(mesh.position) + np.arange(len(reference)), reference])
    return replace(
        mesh,
        node_ids=np.concatenate([mesh.node_ids, mesh.node_ids[reference]]),
        position=np.vstack([mesh.position, *places]),
        beams=tuple(blocks),
        arms=np.vstack([mesh.arms, arms]),
    )


def _corners(mesh: Mesh, block: BeamBlock, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (e, 4, 4 or 8, 3) of the nodes of the sides, seen from outside, and the nodes (e, 4, 4 or 8) that they follow."""
    boxes = np.array(
        [[_box(end) for end in _ends(mesh, int(region))] for region in block.region[own]]
    )  # e, end, axis, 2
    k = block.nodes.shape[1]
    line = mesh.position[block.nodes[own]] + block.offset[own]
    axes = np.repeat(block.axes[own][:, None], k, axis=1) if k == 2 else axes_along(line, block.axes[own], ALONG)[0]
    # of the node between its ends too
    boxes = np.concatenate([boxes, boxes.mean(axis=1, keepdims=True)], axis=1)[:, :k]
    count = 4 if k == 2 else 8
    x, nodes = np.empty((len(own), len(SIDES), count, 3)), np.empty((len(own), len(SIDES), count), dtype=np.int64)
    for side, (axis, sign) in enumerate(SIDES):
        other = 1 - axis
        for corner, (at, share) in enumerate(around(axis, sign)[:count]):
            out = boxes[:, at, axis, int(sign > 0)]
            along = (1 - share) * boxes[:, at, other, 0] + share * boxes[:, at, other, 1]
            across = out[:, None] * axes[:, at, :, 1 + axis] + along[:, None] * axes[:, at, :, 1 + other]
            x[:, side, corner] = line[:, at] + across
            nodes[:, side, corner] = block.nodes[own, at]
    return x, nodes


def around(axis: int, sign: int) -> list[tuple[int, float]]:
    """Of the eight nodes of a side, corners first, so that its normal points away from the beam: which node of the beam each
    follows, end A, end B or the one between, and its place across from 0 to 1."""
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
    """Least and largest y, and z (2, 2) [m]."""
    half = 0.5 * np.sqrt(section.area)
    points = section.points
    if not (len(points) and (np.ptp(points, axis=0) > 0).all()):
        points = np.array(section.neutral) + np.array([[-half, -half], [half, half]])
    return np.stack([points.min(axis=0), points.max(axis=0)], axis=1)
