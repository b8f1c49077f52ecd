"""Shape of the elements: how far they are from the best of their kind."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from strainsight.fem.elements import REFERENCE_NODES, SOLID_KINDS, shape_gradient
from strainsight.fem.quadrature import quadrature
from strainsight.mesh.model import CellBlock, Mesh

CHUNK = 8192
POOR = 0.1
"""Scaled Jacobian below which an element is worth a look."""


@dataclass(frozen=True)
class Quality:
    """Of the elements of one kind: ids (e,), shape (e,) scaled Jacobian of the corners [-], curvature (e,) least over
    greatest |J| among the quadrature points [-], 1 for an element with straight, parallel sides."""

    kind: str
    ids: np.ndarray
    shape: np.ndarray
    curvature: np.ndarray


def element_quality(mesh: Mesh) -> tuple[Quality, ...]:
    """Quality of every element, block by block.

    shape: the least over the corners of |J| over the product of the three sides that meet there, divided by its value in
    the regular element: 1 there, 0 where an element is flat, negative where it is turned inside out.
    Source: Knupp et al., The Verdict geometric quality library, SAND2007-1751 (2006).
    """
    return tuple(Quality(block.kind, block.ids, *_chunked(mesh, block)) for block in mesh.blocks)


def _chunked(mesh: Mesh, block: CellBlock) -> tuple[np.ndarray, np.ndarray]:
    shape, curvature = np.empty(len(block.ids)), np.empty(len(block.ids))
    slopes = shape_gradient(block.kind, quadrature(block.kind)[0])
    for start in range(0, len(block.ids), CHUNK):
        cut = slice(start, start + CHUNK)
        position = mesh.position[block.nodes[cut]]
        shape[cut] = _scaled_jacobian(block.kind, position)
        det = np.linalg.det(np.einsum("qkd,ekc->eqdc", slopes, position, optimize=True))
        largest = det.max(axis=1)
        curvature[cut] = np.divide(det.min(axis=1), largest, out=np.zeros(len(det)), where=largest > 0)
    return shape, curvature


def _scaled_jacobian(kind: str, position: np.ndarray) -> np.ndarray:
    worst = np.full(len(position), np.inf)
    for corner, others in CORNER_SIDES[kind].items():
        sides = position[:, list(others)] - position[:, [corner]]
        size = np.prod(np.linalg.norm(sides, axis=2), axis=1)
        worst = np.minimum(worst, np.linalg.det(sides) / np.where(size > 0, size, np.inf))
    return worst / REGULAR[kind]


def _corner_sides(kind: str) -> dict[int, tuple[int, int, int]]:
    """The three corners beside each corner, right-handed in the reference element."""
    nodes = REFERENCE_NODES[kind]
    corners = {"t": 4, "h": 8, "w": 6}[kind[0]]
    found = {}
    for corner in range(corners):
        if kind[0] == "t":
            beside = [i for i in range(4) if i != corner]
        elif kind[0] == "w":
            level = 3 * (corner // 3)
            beside = [level + (corner + 1) % 3, level + (corner + 2) % 3, (corner + 3) % 6]
        else:
            beside = [i for i in range(8) if np.isclose(np.abs(nodes[i] - nodes[corner]).sum(), 2.0)]
        if np.linalg.det(nodes[beside] - nodes[corner]) < 0:
            beside[0], beside[1] = beside[1], beside[0]
        found[corner] = (beside[0], beside[1], beside[2])
    return found


CORNER_SIDES: Mapping[str, Mapping[int, tuple[int, int, int]]] = {kind: _corner_sides(kind) for kind in SOLID_KINDS}
REGULAR = {kind: {"t": 0.5**0.5, "h": 1.0, "w": 0.75**0.5}[kind[0]] for kind in SOLID_KINDS}
"""|J| over the product of the sides in a regular tetrahedron, a cube, a right prism on an equilateral triangle."""
