"""The sides of beams as facets: where gauges sit on them, and how they look."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.mesh.model import Mesh
from strainsight.mesh.thin import BeamBlock, BeamSection

SIDES = ((0, 1), (1, 1), (0, -1), (1, -1))
"""Axis across the beam (y, z) and sign of the normal of each side, in the order of their local numbers from 1."""


def with_sides(mesh: Mesh) -> Mesh:
    """The mesh with four nodes on each of the four sides of every beam, behind its other nodes, as arms of its ends.

    The sides are those of the box about the points of its section where strain is asked for (C to F of a PBAR); without such
    points that of a square with its area. Rods, and beams that do not hand on all motions of their ends, have none, and a
    section that is open there, as between the flanges of an I, lacks that side.
    """
    if any(len(block.on_sides) for block in mesh.beams):
        return mesh
    blocks, places, references, start = [], [], [], len(mesh.position)
    for block in mesh.beams:
        on_sides = np.full((len(block.ids), len(SIDES), 4), -1, dtype=np.int64)
        own = np.flatnonzero(~block.released.any(axis=(1, 2)) & (block.kind != "rod"))
        if len(own):
            x, nodes = _corners(mesh, block, own)
            there = np.array([_ends(mesh, int(region))[0].sides for region in block.region[own]])
            number = np.full((*there.shape, 4), -1)
            number[there] = start + np.arange(4 * np.count_nonzero(there)).reshape(-1, 4)
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
    """Places (e, 4, 4, 3) of the corners of the sides, seen from outside, and the nodes (e, 4, 4) whose ends they are at."""
    boxes = np.array(
        [[_box(end) for end in _ends(mesh, int(region))] for region in block.region[own]]
    )  # e, end, axis, 2
    axes, ends = block.axes[own], mesh.position[block.nodes[own]] + block.offset[own]
    x, nodes = np.empty((len(own), len(SIDES), 4, 3)), np.empty((len(own), len(SIDES), 4), dtype=np.int64)
    for side, (axis, sign) in enumerate(SIDES):
        other = 1 - axis
        # around the side so that its normal points away from the beam
        turn = -sign if axis == 0 else sign
        around = [(0, 0), (1, 0), (1, 1), (0, 1)] if turn > 0 else [(0, 0), (0, 1), (1, 1), (1, 0)]
        for corner, (end, high) in enumerate(around):
            out = boxes[:, end, axis, int(sign > 0)]
            along = boxes[:, end, other, high]
            x[:, side, corner] = (
                ends[:, end] + out[:, None] * axes[:, :, 1 + axis] + along[:, None] * axes[:, :, 1 + other]
            )
            nodes[:, side, corner] = block.nodes[own, end]
    return x, nodes


def _ends(mesh: Mesh, region: int) -> tuple[BeamSection, BeamSection]:
    section = mesh.sections[region]
    assert isinstance(section, BeamSection)
    return section, section.at_b or section


def _box(section: BeamSection) -> np.ndarray:
    """Least and largest y, and z (2, 2) [m]."""
    half = 0.5 * np.sqrt(section.area)
    points = section.points
    if not (len(points) and (np.ptp(points, axis=0) > 0).all()):
        points = np.array([[-half, -half], [half, half]])
    return np.stack([points.min(axis=0), points.max(axis=0)], axis=1)
