"""Refinement of a mesh by subdivision of all elements at the middle of their edges."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy import sparse

from strainsight.mesh.anisotropic import CompositeSolid
from strainsight.mesh.kinds import kind_of
from strainsight.mesh.kinds.kind import Kind, with_midsides
from strainsight.mesh.model import CellBlock, Mesh, Region

UNIT = 2**20
"""Scale of integer weights: at halves and quarters of edges all weights are multiples of 2⁻⁸."""


@dataclass(frozen=True)
class Refined:
    """mesh with the parts as elements, without supports, ties and sets; interpolation P, CSR (m, n): values at its nodes from
    those at the n nodes of the coarse mesh; code (n,) of the coarse nodes, keys: to find fine nodes."""

    mesh: Mesh
    interpolation: sparse.csr_array
    code: np.ndarray
    keys: np.ndarray

    def nodes_at(self, kind: Kind, nodes: np.ndarray, xi: np.ndarray) -> np.ndarray:
        """Fine nodes (e, q) at points ξ (q, d) of coarse elements or facets (e, k), each a node of the fine mesh."""
        return np.asarray(np.searchsorted(self.keys, _keys(self.code, nodes, kind.shape(xi))))


def refined(mesh: Mesh) -> Refined:
    """Subdivide every element into the `split` of its kind, with nodes on its shape functions:

        x_f = P x,    P_fa = N_a(ξ_f)

    A straight mesh, linear or quadratic, is nested in it; curved elements keep their shape. Nodes are merged if they are the
    same mean of the same coarse nodes, so that parts which only touch stay separate."""
    code = np.random.default_rng(0).integers(0, 2**63, len(mesh.position), dtype=np.uint64)
    raw: list[tuple[str, np.ndarray, np.ndarray]] = []
    entries: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    halves = _Halves(mesh)
    for block in mesh.blocks:
        kind = kind_of(block.kind)
        for name, corners in kind.split:
            N = kind.shape(with_midsides(corners, kind_of(name).edges))
            key = _keys(code, block.nodes, N)
            raw.append((name, key, halves.regions(block.region, corners)))
            entries.append((key, block.nodes, N))
    keys = np.unique(np.concatenate([key.ravel() for _, key, _ in raw]))
    blocks, number = [], 0
    for name in dict.fromkeys(kind_name for kind_name, *_ in raw):
        parts = [part for part in raw if part[0] == name]
        nodes = np.concatenate([np.searchsorted(keys, key) for _, key, _ in parts])
        ids = np.arange(number + 1, number + 1 + len(nodes))
        number += len(nodes)
        blocks.append(CellBlock(name, ids, nodes, np.concatenate([region for *_, region in parts])))
    P = _interpolation(keys, entries, len(mesh.position))
    properties = mesh.properties
    properties["regions"] = {**mesh.regions, **halves.split_regions}
    properties["composites"] = {**mesh.composites, **halves.composites}
    ids = np.arange(1, len(keys) + 1)
    fine = Mesh(ids, P @ mesh.position, tuple(blocks), lumped=mesh.lumped, source=mesh.source, **properties)
    return Refined(fine, P, code, keys)


@dataclass
class _Halves:
    """Regions of the parts of composite solids, with only the layers of their half: split_regions, composites."""

    mesh: Mesh
    split_regions: dict[int, Region] = field(default_factory=dict)
    composites: dict[int, CompositeSolid] = field(default_factory=dict)
    _number: dict[tuple[int, float], int] = field(default_factory=dict)

    def regions(self, region: np.ndarray, corners: np.ndarray) -> np.ndarray:
        """Regions (e,) of the parts with corners (c, 3) of elements in regions (e,)."""
        result = region.copy()
        for number in np.unique(region[np.isin(region, list(self.mesh.composites))]).tolist():
            composite = self.mesh.composites[number]
            extent = corners[:, composite.direction].tolist()
            low, high = min(extent), max(extent)
            half = self._number.setdefault((number, low), max(self.mesh.regions) + 1 + len(self._number))
            self.split_regions[half] = replace(self.mesh.regions[number], id=half)
            self.composites[half] = composite.between(low, high)
            result[region == number] = half
        return result


def _keys(code: np.ndarray, nodes: np.ndarray, N: np.ndarray) -> np.ndarray:
    """(e, q): a number that is equal for the same mean of the same nodes; nodes (e, k), weights N (q, k)."""
    weight = np.rint(N * UNIT).astype(np.int64).astype(np.uint64)
    return np.asarray((weight[None] * code[nodes][:, None, :]).sum(axis=2, dtype=np.uint64))


def _interpolation(
    keys: np.ndarray, entries: list[tuple[np.ndarray, np.ndarray, np.ndarray]], nodes: int
) -> sparse.csr_array:
    """P from the shape functions of every element, each node once."""
    first = np.full(len(keys), -1)
    rows, columns, values = [], [], []
    for key, nodes_of_element, N in entries:
        place = np.searchsorted(keys, key)
        element, point = np.nonzero(first[place] < 0)
        fresh, once = np.unique(place[element, point], return_index=True)
        first[fresh] = 0
        e, q = element[once], point[once]
        rows.append(np.repeat(fresh, N.shape[1]))
        columns.append(nodes_of_element[e].ravel())
        values.append((np.rint(N * UNIT) / UNIT)[q].ravel())
    matrix = sparse.coo_array(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(len(keys), nodes)
    )
    P = sparse.csr_array(matrix)
    P.eliminate_zeros()
    return P
