"""Shells of another thickness than those of a mesh: where their faces lie then, and how these move."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from strainsight.mesh.model import Mesh
from strainsight.mesh.properties import value_of


@dataclass(frozen=True)
class Thickness:
    """element (k,) ids of shells, ascending; ratio (k,) of their thickness to that of the mesh; opposite (n,) indices: of a node
    on a face that across from it, of others themselves."""

    element: np.ndarray
    ratio: np.ndarray
    opposite: np.ndarray

    def ratio_of(self, element: np.ndarray) -> np.ndarray:
        """Of elements (p,) ids; 1 of all that have the thickness of the mesh."""
        at = np.minimum(np.searchsorted(self.element, element), len(self.element) - 1)
        return np.where(self.element[at] == element, self.ratio[at], 1.0)

    def moved(self, ratio: float) -> sparse.csr_array:
        """G (3n, 3n) from places and displacements in the mesh to those of faces of shells of that ratio r:

            x± + ½(r − 1)(x± − x∓),     u± + ½(r − 1)(u± − u∓)

        as x± = x + (offset ± t/2) n and u± = u + θ × (x± − x) (`mesh/shell_faces.py`); the offset is that of the mesh."""
        node = np.arange(len(self.opposite))
        half = np.where(self.opposite != node, 0.5 * (ratio - 1.0), 0.0)
        values, rows = np.concatenate([1 + half, -half]), np.concatenate([node, node])
        G = sparse.csr_array((values, (rows, np.concatenate([node, self.opposite]))), shape=(len(node),) * 2)
        return sparse.csr_array(sparse.kron(G, sparse.eye_array(3), format="csr"))


def thickness_of(mesh: Mesh, given: Sequence[tuple[Iterable[int], float]]) -> Thickness:
    """Of the shells of a mesh with faces: regions (ids) and their thickness [m], pair by pair. Raises UserError for a region that
    is not of shells."""
    ratio = {region: value / value_of(mesh, region, "thickness") for regions, value in given for region in regions}
    opposite = np.arange(len(mesh.position))
    element, own = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
    for block in mesh.shells:
        upper, lower = (block.on_faces[:, side].ravel() for side in (0, 1))
        opposite[upper], opposite[lower] = lower, upper
        there = np.isin(block.region, list(ratio))
        element.append(block.ids[there])
        own.append(np.array([ratio[int(region)] for region in block.region[there]], dtype=float))
    ids, values = np.concatenate(element), np.concatenate(own)
    order = np.argsort(ids)
    return Thickness(ids[order], values[order], opposite)
