"""The whole strain tensor on the surface, as rows for displacements: [εxx εyy εzz γxy γyz γzx] at every point."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from strainsight.fem.element_matrices import bubble_gradients, gradients, jacobians
from strainsight.mesh.facets import Facets
from strainsight.mesh.kinds import FACETS, kind_of
from strainsight.mesh.kinds.kind import ElementKind
from strainsight.mesh.model import CellBlock, Mesh

COMPONENTS = ("xx", "yy", "zz", "xy", "yz", "zx")
"""Shears are γ = 2ε; VTK's order of a symmetric tensor."""
SHEARS = ((0, 1), (1, 2), (2, 0))
CHUNK = 2048


@dataclass(frozen=True)
class StrainRows:
    """matrix CSR (6p, 3n): row 6·point + component for displacements of the nodes, column 3·node + component.

    region (p,) ids; node (p,) index, −1 at the centre of a facet; corner (f, 8): the points on the nodes of every facet,
    padded with −1, where points are at nodes; None where they are the facets' centres, in their order.
    """

    matrix: sparse.csr_array
    region: np.ndarray
    node: np.ndarray
    corner: np.ndarray | None = None


def facet_strain(mesh: Mesh, facets: Facets) -> StrainRows:
    """Strain at the centre of every facet, of the solid it belongs to:  ε = Σ_a sym(z_a ⊗ g_a),  g_a = J⁻ᵀ ∂N_a/∂ξ.

    Incompatible modes of a kind count too, at the amplitudes to which the assembly condenses them (α = −K_aa⁻¹K_au z) and
    with their own gradients −2ξᵢ J⁻ᵀeᵢ. At a facet's centre these are along its normal: they add to the strain across the
    facet, and nothing to that along it, which is the gauges'.
    facets (f) of this mesh. Raises DeckError where |J| ≤ 0 at a facet's centre, ids named.
    """
    rows = _rows(mesh, facets, nodal=False)
    return StrainRows(rows, facets.region, np.full(len(facets.region), -1))


def node_strain(mesh: Mesh, facets: Facets) -> StrainRows:
    """Strain at the nodes of the facets: the mean of what every facet on the node says there, region by region.

    A node between two regions is one point in each, so that what jumps from material to material is not smeared.
    Otherwise as `facet_strain`.
    """
    facet, local = np.nonzero(facets.nodes >= 0)
    key = np.column_stack([facets.region[facet], facets.nodes[facet, local]])
    points, point = np.unique(key, axis=0, return_inverse=True)
    point = point.ravel()
    share = 1.0 / np.bincount(point)[point]
    mean = sparse.csr_array((share, (point, np.arange(len(point)))), shape=(len(points), len(point)))
    corner = np.full(facets.nodes.shape, -1)
    corner[facet, local] = point
    rows = sparse.csr_array(sparse.kron(mean, sparse.eye_array(6), format="csr") @ _rows(mesh, facets, nodal=True))
    return StrainRows(rows, points[:, 0], points[:, 1], corner)


def _rows(mesh: Mesh, facets: Facets, nodal: bool) -> sparse.csr_array:
    """Rows at the centre of every facet, or at each of its nodes, facet by facet."""
    count = np.sum(facets.nodes >= 0, axis=1) if nodal else np.ones(len(facets.kind), dtype=np.int64)
    first = np.r_[0, np.cumsum(count)]
    value, row, column = [], [], []
    for block, local, which, element in _groups(mesh, facets):
        kind = FACETS[facets.kind[which[0]]]
        xi = kind.shape(kind.nodes if nodal else kind.centre) @ kind_of(block.kind).nodes[list(local)]
        nodes = block.nodes[element]
        B = _strain(mesh, block, element, xi)
        at = first[which][:, None] + np.arange(len(xi))
        rows = 6 * at[:, :, None, None, None] + np.arange(6)[:, None, None]
        columns = 3 * nodes[:, None, None, :, None] + np.arange(3)
        there = np.nonzero(B)
        value.append(B[there])
        row.append(np.broadcast_to(rows, B.shape)[there])
        column.append(np.broadcast_to(columns, B.shape)[there])
    shape_ = (6 * int(first[-1]), 3 * len(mesh.position))
    if not value:
        return sparse.csr_array(shape_)
    entries = (np.concatenate(value), (np.concatenate(row), np.concatenate(column)))
    return sparse.csr_array(sparse.coo_array(entries, shape=shape_))


def _groups(mesh: Mesh, facets: Facets) -> Iterator[tuple[CellBlock, tuple[int, ...], np.ndarray, np.ndarray]]:
    """(block, local nodes of the facet, which facets (m,), their elements' rows in the block (m,)), CHUNK at most."""
    for block in mesh.blocks:
        order = np.argsort(block.ids)
        place = np.searchsorted(block.ids, facets.element_id, sorter=order)
        row = order[np.minimum(place, len(order) - 1)] if len(order) else np.zeros(len(place), dtype=np.int64)
        own = np.flatnonzero(block.ids[row] == facets.element_id) if len(order) else row[:0]
        for number, (_, local) in enumerate(kind_of(block.kind).facets, start=1):
            which = own[facets.facet[own] == number]
            for start in range(0, len(which), CHUNK):
                part = which[start : start + CHUNK]
                yield block, local, part, row[part]


def _strain(mesh: Mesh, block: CellBlock, element: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """B (e, q, 6, k, 3) of elements at their reference points ξ (q, 3)."""
    kind, position, ids = kind_of(block.kind), mesh.position[block.nodes[element]], block.ids[element]
    g, _ = gradients(kind, position, xi, ids)
    B = _symmetric_gradient(g)
    if kind.bubble_gradient is None:
        return B
    J, _ = jacobians(kind, position, xi, ids)
    bubble = np.matmul(kind.bubble_gradient(xi), np.linalg.inv(J).swapaxes(2, 3))
    nu = np.array(
        [mesh.materials[mesh.regions[int(region)].material].poisson_ratio for region in block.region[element]]
    )
    amplitude = bubble_amplitudes(kind, position, nu, ids)
    added = _symmetric_gradient(bubble).reshape(len(element), -1, amplitude.shape[1]) @ amplitude
    return B + added.reshape(B.shape)


def bubble_amplitudes(kind: ElementKind, position: np.ndarray, nu: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """α = −K_aa⁻¹K_au z of the incompatible modes of a kind, with the gradients of `element_stiffnesses`.

    position (e, k, 3) [m]; nu (e,); ids for the error message. Returns (e, 3p, 3k), rows 3·mode + component.
    """
    xi, w = kind.stiffness
    g, det = gradients(kind, position, xi, ids)
    own = bubble_gradients(kind, position, xi, det)
    weight = (w * det)[:, :, None, None]
    Bu, Ba = (_symmetric_gradient(part).reshape(len(ids), len(w), 6, -1) for part in (g, own))
    DBa = np.swapaxes(weight * isotropic(Ba, *(part[:, None, None] for part in lame(nu))), 2, 3)
    return -np.linalg.solve((DBa @ Ba).sum(axis=1), (DBa @ Bu).sum(axis=1))


def lame(nu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """λ = ν/((1 + ν)(1 − 2ν)) and μ = 1/(2(1 + ν)) of unit modulus."""
    return nu / ((1 + nu) * (1 - 2 * nu)), 0.5 / (1 + nu)


def isotropic(strain: np.ndarray, lam: np.ndarray, mu: np.ndarray) -> np.ndarray:
    """σ = λ tr(ε) I + 2με: strain (..., 6, w) with shears γ, lam and mu that broadcast with (..., w) → stress (..., 6, w)."""
    stress = np.asarray(mu)[..., None, :] * strain
    stress[..., :3, :] *= 2
    stress[..., :3, :] += (lam * strain[..., :3, :].sum(axis=-2))[..., None, :]
    return stress


def _symmetric_gradient(g: np.ndarray) -> np.ndarray:
    """[εxx εyy εzz γxy γyz γzx] per component of the displacement of each node: g (e, q, k, 3) → (e, q, 6, k, 3)."""
    B = np.zeros((*g.shape[:2], 6, *g.shape[2:]))
    for i in range(3):
        B[:, :, i, :, i] = g[..., i]
    for row, (i, j) in enumerate(SHEARS, start=3):
        B[:, :, row, :, i] = g[..., j]
        B[:, :, row, :, j] = g[..., i]
    return B
