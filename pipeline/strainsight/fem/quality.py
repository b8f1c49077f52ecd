"""Shape of the elements: how far they are from the best of their kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.kinds import kind_of
from strainsight.mesh.kinds.kind import ElementKind
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
    the regular element: 1 there, 0 where an element is flat, negative where it is inverted.
    Source: Knupp et al., The Verdict geometric quality library, SAND2007-1751 (2006).
    """
    return tuple(Quality(block.kind, block.ids, *_chunked(mesh, block)) for block in mesh.blocks)


def check_inverted(quality: Sequence[Quality]) -> None:
    """Raise DeckError, with how many there are in the whole mesh, where elements have |J| ≤ 0 at points of their stiffness."""
    found = {own.kind: own.ids[own.curvature <= 0] for own in quality if (own.curvature <= 0).any()}
    if not found:
        return
    ids = np.concatenate([*found.values()])
    kinds = " and ".join(f"{len(own)} {kind}" for kind, own in found.items())
    names = ", ".join(str(number) for number in ids[:5]) + (", …" if len(ids) > 5 else "")
    raise DeckError(
        f"of {sum(len(own.ids) for own in quality)} solid elements {kinds} are flat or inverted: {names}",
        remedy="check the order of their nodes and how far their mid-side nodes are off the middle",
        entity=("element", int(ids[0])),
    )


def _chunked(mesh: Mesh, block: CellBlock) -> tuple[np.ndarray, np.ndarray]:
    shape, curvature = np.empty(len(block.ids)), np.empty(len(block.ids))
    kind = kind_of(block.kind)
    slopes = kind.gradient(kind.stiffness[0])
    for start in range(0, len(block.ids), CHUNK):
        cut = slice(start, start + CHUNK)
        position = mesh.position[block.nodes[cut]]
        shape[cut] = _scaled_jacobian(kind, position)
        det = np.linalg.det(np.einsum("qkd,ekc->eqdc", slopes, position, optimize=True))
        largest = det.max(axis=1)
        curvature[cut] = np.divide(det.min(axis=1), largest, out=np.zeros(len(det)), where=largest > 0)
    return shape, curvature


def _scaled_jacobian(kind: ElementKind, position: np.ndarray) -> np.ndarray:
    worst = np.full(len(position), np.inf)
    for corner, *others in kind.sides:
        sides = position[:, others] - position[:, [corner]]
        size = np.prod(np.linalg.norm(sides, axis=2), axis=1)
        worst = np.minimum(worst, np.linalg.det(sides) / np.where(size > 0, size, np.inf))
    return worst / kind.regular
