"""The whole strain tensor on the surface, as rows for displacements: [εxx εyy εzz γxy γyz γzx] at every point, γ = 2ε.

The order is that of a symmetric tensor in VTK.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from strainsight.fem.affine import Parameter
from strainsight.fem.elasticity import FacetLaws, anisotropic_regions, by_rule, elasticities, facet_laws
from strainsight.fem.element_matrices import (
    SHEARS,
    bubble_gradients,
    gradients,
    jacobians,
    symmetric_gradient,
)
from strainsight.mesh.facets import Facets, on_solids
from strainsight.mesh.kinds import FACETS, kind_of
from strainsight.mesh.kinds.kind import ElementKind, Kind, Rule
from strainsight.mesh.model import CellBlock, Mesh
from strainsight.mesh.properties import Thickness


@dataclass(frozen=True)
class StrainRows:
    """matrix CSR (6p, 3n): row 6·point + component for displacements of the nodes, column 3·node + component; region (p,) ids;
    laws: those of the points on laminates, anisotropic and composite solids, None without one."""

    matrix: sparse.csr_array
    region: np.ndarray
    laws: FacetLaws | None = None


def facet_strain(mesh: Mesh, facets: Facets, parameters: Sequence[Parameter] = ()) -> StrainRows:
    """Strain at the centre of every facet, of the solid it belongs to:  ε = Σ_a sym(z_a ⊗ g_a),  g_a = J⁻ᵀ ∂N_a/∂ξ,
    and on a face of a shell or a side of a beam that along it, with what plane stress has across:

        ε = Σ_a sym(P z_a ⊗ g_a) − ν/(1 − ν) (Σ_a g_a·z_a) n nᵀ,     P = I − n nᵀ,   g_a along the face

    On a face of a laminate that across is of the ply at the face, see `FacetLaws`.
    Incompatible modes of a kind count too, at the amplitudes to which the assembly condenses them (α = −K_aa⁻¹K_au z) and
    with their own gradients −2ξᵢ J⁻ᵀeᵢ. At a facet's centre these are along its normal: they add to the strain across the
    facet, and nothing to that along it, which is the gauges'.
    facets (f) of this mesh; parameters: moduli of plies among them stay free in the plies.
    Raises DeckError where |J| ≤ 0 at a facet's centre, ids named.
    """
    laws = facet_laws(mesh, facets, parameters)
    return StrainRows(strain_matrix(mesh, facets, laws), facets.region, laws)


def strain_matrix(
    mesh: Mesh, facets: Facets, laws: FacetLaws | None, thickness: Thickness | None = None
) -> sparse.csr_array:
    """The matrix of `StrainRows`; thickness: of shells that are thicker than those of the mesh, whose displacements these are."""
    if thickness is not None:
        found = sparse.csr_array((6 * len(facets.kind), 3 * len(mesh.position)))
        ratio = thickness.ratio_of(facets.element_id)
        for own in np.unique(ratio):
            G, of = thickness.moved(own), np.repeat(ratio == own, 6)
            moved = replace(mesh, position=(G @ mesh.position.ravel()).reshape(mesh.position.shape))
            found = found + sparse.diags_array(of.astype(float)) @ strain_matrix(moved, facets, laws) @ G
        return sparse.csr_array(found)
    value, row, column = [], [], []
    for block, local, which, element in on_solids(mesh, facets):
        kind = FACETS[facets.kind[which[0]]]
        xi = kind.shape(kind.centre) @ kind_of(block.kind).nodes[list(local)]
        nodes = block.nodes[element]
        B = _strain(mesh, block, element, xi)
        rows = 6 * which[:, None, None, None, None] + np.arange(6)[:, None, None]
        columns = 3 * nodes[:, None, None, :, None] + np.arange(3)
        there = np.nonzero(B)
        value.append(B[there])
        row.append(np.broadcast_to(rows, B.shape)[there])
        column.append(np.broadcast_to(columns, B.shape)[there])
    for which, nodes, B in _of_shells(mesh, facets, laws):
        rows = 6 * which[:, None, None, None] + np.arange(6)[:, None, None]
        columns = 3 * nodes[:, None, :, None] + np.arange(3)
        value.append(B.ravel())
        row.append(np.broadcast_to(rows, B.shape).ravel())
        column.append(np.broadcast_to(columns, B.shape).ravel())
    shape_ = (6 * len(facets.kind), 3 * len(mesh.position))
    if not value:
        return sparse.csr_array(shape_)
    entries = (np.concatenate(value), (np.concatenate(row), np.concatenate(column)))
    return sparse.csr_array(sparse.coo_array(entries, shape=shape_))


def _of_shells(
    mesh: Mesh, facets: Facets, laws: FacetLaws | None
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """(which facets (m,), their nodes (m, k), B (m, 6, k, 3)) of the faces of shells and the sides of beams."""
    own = np.flatnonzero(facets.of(mesh.thin))
    for code in np.unique(facets.kind[own]):
        kind, which = FACETS[code], own[facets.kind[own] == code]
        nodes = facets.nodes[which, : len(kind.nodes)]
        n, within = _along(kind, mesh.position[nodes], kind.centre)
        if len(kind.read_at):
            within = _read(kind, mesh.position[nodes], n)
        along = np.eye(3) - n[:, :, None] * n[:, None]
        # ε_nn = −contraction : ε
        material = [mesh.material_of(int(region)) for region in facets.region[which]]
        ratio = np.array([0.0 if own is None else own.poisson_ratio / (1 - own.poisson_ratio) for own in material])
        contraction = ratio[:, None, None] * along
        if laws is not None:
            _, mine, of = np.intersect1d(which, laws.facet, return_indices=True)
            contraction[mine] = laws.contraction[of]
        across = np.einsum("mij,maijc->mac", contraction, within)
        strain = within - n[:, None, :, None, None] * n[:, None, None, :, None] * across[:, :, None, None]
        parts = [strain[:, :, i, i] for i in range(3)] + [2 * strain[:, :, i, j] for i, j in SHEARS]
        yield which, nodes, np.stack(parts, axis=1)


def _along(kind: Kind, corners: np.ndarray, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normal (m, 3) of facets with nodes at corners (m, k, 3) at xi (2,), and ε_ij along them there of component c of the
    displacement of node a (m, k, 3, 3, 3), sym(g_a ⊗ P)."""
    slope = kind.gradient(xi[None])[0]
    J = np.einsum("ka,mkc->mca", slope, corners)
    g = np.einsum("ka,mac->mkc", slope, np.linalg.pinv(J))
    n = np.cross(J[:, :, 0], J[:, :, 1])
    n /= np.linalg.norm(n, axis=1)[:, None]
    half = 0.5 * np.einsum("mai,mjc->maijc", g, np.eye(3) - n[:, :, None] * n[:, None])
    return n, half + half.swapaxes(2, 3)


def _read(kind: Kind, corners: np.ndarray, n: np.ndarray) -> np.ndarray:
    """ε_ij at the centre as `_along`, from the points where the facets' strain is read, turned the shortest way onto the tangent
    plane with the normals n (m, 3)."""
    found = np.zeros((*corners.shape[:2], 3, 3, 3))
    J = np.einsum("ka,mkc->mca", kind.gradient(kind.centre[None])[0], corners)
    r, s = np.moveaxis(J, 2, 0)
    a, b = np.moveaxis(np.linalg.pinv(J), 1, 0)
    both = 0.5 * (a[:, :, None] * b[:, None] + b[:, :, None] * a[:, None])
    sides = np.stack([r, s, s - r], axis=1)
    # strain by those along the sides
    dyads = np.stack([a[:, :, None] * a[:, None] + both, b[:, :, None] * b[:, None] + both, -both], axis=1)
    places = zip(kind.read_at, kind.reading(kind.centre[None])[0], kind.read_along or [None] * 4, strict=True)
    for point, weight, side in places:
        own, strain = _along(kind, corners, point)
        halfway = (own + n) / (1 + np.sum(own * n, axis=1))[:, None]
        R = np.eye(3) + 2 * n[:, :, None] * own[:, None] - halfway[:, :, None] * (own + n)[:, None]
        turned = np.einsum("mip,mjq,mapqc->maijc", R, R, strain, optimize=True)
        if side is not None:
            turned = np.einsum(
                "mi,mj,maijc,mkl->maklc", sides[:, side], sides[:, side], turned, dyads[:, side], optimize=True
            )
        found += weight * turned
    return found


def _strain(mesh: Mesh, block: CellBlock, element: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """B (e, q, 6, k, 3) of elements at their reference points ξ (q, 3)."""
    kind, position, ids = kind_of(block.kind), mesh.position[block.nodes[element]], block.ids[element]
    g, _ = gradients(kind, position, xi, ids)
    B = symmetric_gradient(g)
    if kind.bubble_gradient is None:
        return B
    J, _ = jacobians(kind, position, xi, ids)
    bubble = np.matmul(kind.bubble_gradient(xi), np.linalg.inv(J).swapaxes(2, 3))
    amplitude = _amplitudes(mesh, kind, position, block.region[element], ids)
    added = symmetric_gradient(bubble).reshape(len(element), -1, amplitude.shape[1]) @ amplitude
    return B + added.reshape(B.shape)


def _amplitudes(mesh: Mesh, kind: ElementKind, position: np.ndarray, region: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """`bubble_amplitudes` (e, 3p, 3k) of elements in regions (e,)."""
    own = np.isin(region, anisotropic_regions(mesh))
    nu = np.array([mesh.materials[mesh.regions[int(number)].material].poisson_ratio for number in region[~own]])
    if not own.any():
        return bubble_amplitudes(kind, position, nu, ids)
    assert kind.bubble_gradient is not None
    modes = kind.bubble_gradient(kind.centre[None]).shape[1]
    found = np.empty((len(ids), 3 * modes, 3 * len(kind.nodes)))
    for which, rule in by_rule(mesh, kind, region):
        C = elasticities(mesh, kind, position[which], region[which], rule[0])
        found[which] = bubble_amplitudes(kind, position[which], C, ids[which], rule)
    if len(nu):
        found[~own] = bubble_amplitudes(kind, position[~own], nu, ids[~own])
    return found


def bubble_amplitudes(
    kind: ElementKind, position: np.ndarray, law: np.ndarray, ids: np.ndarray, rule: Rule | None = None
) -> np.ndarray:
    """α = −K_aa⁻¹K_au z of the incompatible modes of a kind, with the gradients of `element_stiffnesses`.

    position (e, k, 3) [m]; law (e,) Poisson's ratio, or C (e, q or 1, 6, 6) as `anisotropic_stiffnesses` has it; ids for the
    error message; rule: None that of the kind. Returns (e, 3p, 3k), rows 3·mode + component.
    """
    xi, w = kind.stiffness if rule is None else rule
    g, det = gradients(kind, position, xi, ids)
    own = bubble_gradients(kind, position, xi, det)
    weight = (w * det)[:, :, None, None]
    Bu, Ba = (symmetric_gradient(part).reshape(len(ids), len(w), 6, -1) for part in (g, own))
    stress = law @ Ba if law.ndim == 4 else isotropic(Ba, *(part[:, None, None] for part in lame(law)))
    DBa = np.swapaxes(weight * stress, 2, 3)
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
