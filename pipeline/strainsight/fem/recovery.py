"""Strain operator (matrix H) of the full tensor on the surface: [εxx εyy εzz γxy γyz γzx] at every point, γ = 2ε.

The order is that of a symmetric tensor in VTK."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from strainsight.errors import DeckError
from strainsight.fem.affine import NO_CHANGE, AffineOperator, Parameter, from_entries, scales_stiffness
from strainsight.fem.by_region import poisson_ratios
from strainsight.fem.elasticity import (
    SHEARS,
    FacetLaws,
    anisotropic_regions,
    bubble_gradients,
    by_rule,
    elasticities,
    facet_laws,
    gradients,
    jacobians,
    lame,
    symmetric_gradient,
)
from strainsight.mesh.facets import Facets, by_kind, on_solids
from strainsight.mesh.kinds import FACETS, kind_of
from strainsight.mesh.kinds.kind import ElementKind, Kind, Rule
from strainsight.mesh.model import CellBlock, Mesh
from strainsight.mesh.properties import Thickness, shapes


@dataclass(frozen=True)
class StrainRows:
    """matrix CSR (6p, 3n): row 6·point + component for displacements of the nodes, column 3·node + component; region (p,) ids;
    laws: those of the points on laminates, anisotropic and composite solids, None without any."""

    matrix: sparse.csr_array
    region: np.ndarray
    laws: FacetLaws | None = None


def facet_strain(mesh: Mesh, facets: Facets, parameters: Sequence[Parameter] = ()) -> StrainRows:
    """Strain at the centre of every facet, of the solid it belongs to:  ε = Σ_a sym(z_a ⊗ g_a),  g_a = J⁻ᵀ ∂N_a/∂ξ.
    On a face of a shell or a side of a beam: the strain along it, and across it that of plane stress:

        ε = Σ_a sym(P z_a ⊗ g_a) − ν/(1 − ν) (Σ_a g_a·z_a) n nᵀ,     P = I − n nᵀ,   g_a along the face

    On a face of a laminate the strain across is that of the ply at the face, see `FacetLaws`.
    Incompatible modes of a kind count too, at the amplitudes to which the assembly condenses them (α = −K_aa⁻¹K_au z), with
    their gradients −2ξᵢ J⁻ᵀeᵢ. At the centre of a facet these are along its normal: they add to the strain across the facet,
    but not to that along it, which gauges measure.
    facets (f) of this mesh; parameters: moduli of plies among them stay free.
    Raises DeckError where |J| ≤ 0 at a facet's centre, ids named."""
    laws = facet_laws(mesh, facets, parameters)
    return StrainRows(strain_matrix(mesh, facets, laws), facets.region, laws)


def strain_matrix(
    mesh: Mesh, facets: Facets, laws: FacetLaws | None, thickness: Thickness | None = None
) -> sparse.csr_array:
    """The matrix of `StrainRows`; thickness: of shells that are thicker than those of the mesh with these displacements."""
    if thickness is not None:
        total = sparse.csr_array((6 * len(facets.kind), 3 * len(mesh.position)))
        ratio = thickness.ratio_of(facets.element_id)
        for value in np.unique(ratio):
            G, has_ratio = thickness.moved(value), np.repeat(ratio == value, 6)
            moved = replace(mesh, position=(G @ mesh.position.ravel()).reshape(mesh.position.shape))
            total = total + sparse.diags_array(has_ratio.astype(float)) @ strain_matrix(moved, facets, laws) @ G
        return sparse.csr_array(total)
    entries = []
    for block, local, which, element in on_solids(mesh, facets):
        kind = FACETS[facets.kind[which[0]]]
        xi = kind.shape(kind.centre) @ kind_of(block.kind).nodes[list(local)]
        nodes = block.nodes[element]
        B = _strain(mesh, block, element, xi)
        rows = 6 * which[:, None, None, None, None] + np.arange(6)[:, None, None]
        columns = 3 * nodes[:, None, None, :, None] + np.arange(3)
        entries.append((B, rows, columns))
    for which, nodes, B in _on_thin(mesh, facets, laws):
        rows = 6 * which[:, None, None, None] + np.arange(6)[:, None, None]
        columns = 3 * nodes[:, None, :, None] + np.arange(3)
        entries.append((B, rows, columns))
    return from_entries(entries, (6 * len(facets.kind), 3 * len(mesh.position)))


def _on_thin(mesh: Mesh, facets: Facets, laws: FacetLaws | None) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """(which facets (m,), their nodes (m, k), B (m, 6, k, 3)) of the faces of shells and the sides of beams."""
    thin_facets = np.flatnonzero(facets.of(mesh.thin))
    for kind, rows, nodes in by_kind(facets.kind[thin_facets], facets.nodes[thin_facets]):
        which = thin_facets[rows]
        n, within = _along(kind, mesh.position[nodes], kind.centre)
        if len(kind.read_at):
            within = _strain_from_reading_points(kind, mesh.position[nodes], n)
        along = np.eye(3) - n[:, :, None] * n[:, None]
        # ε_nn = −contraction : ε
        material = [mesh.material_of(int(region)) for region in facets.region[which]]
        ratio = np.array([0.0 if m is None else m.poisson_ratio / (1 - m.poisson_ratio) for m in material])
        contraction = ratio[:, None, None] * along
        if laws is not None:
            _, with_law, of = np.intersect1d(which, laws.facet, return_indices=True)
            contraction[with_law] = laws.contraction[of]
        across = np.einsum("mij,maijc->mac", contraction, within)
        strain = within - n[:, None, :, None, None] * n[:, None, None, :, None] * across[:, :, None, None]
        parts = [strain[:, :, i, i] for i in range(3)] + [2 * strain[:, :, i, j] for i, j in SHEARS]
        yield which, nodes, np.stack(parts, axis=1)


def _along(kind: Kind, corners: np.ndarray, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normal (m, 3) at xi (2,) of facets with nodes at corners (m, k, 3), and the strain ε_ij along them there per component c
    of the displacement of node a (m, k, 3, 3, 3), sym(g_a ⊗ P)."""
    slope = kind.gradient(xi[None])[0]
    J = np.einsum("ka,mkc->mca", slope, corners)
    g = np.einsum("ka,mac->mkc", slope, np.linalg.pinv(J))
    n = np.cross(J[:, :, 0], J[:, :, 1])
    n /= np.linalg.norm(n, axis=1)[:, None]
    half = 0.5 * np.einsum("mai,mjc->maijc", g, np.eye(3) - n[:, :, None] * n[:, None])
    return n, half + half.swapaxes(2, 3)


def _strain_from_reading_points(kind: Kind, corners: np.ndarray, n: np.ndarray) -> np.ndarray:
    """ε_ij at the centre as `_along`, from the points where the strain of the facet is evaluated, rotated the shortest way onto
    the tangent plane with the normals n (m, 3)."""
    total = np.zeros((*corners.shape[:2], 3, 3, 3))
    J = np.einsum("ka,mkc->mca", kind.gradient(kind.centre[None])[0], corners)
    r, s = np.moveaxis(J, 2, 0)
    a, b = np.moveaxis(np.linalg.pinv(J), 1, 0)
    both = 0.5 * (a[:, :, None] * b[:, None] + b[:, :, None] * a[:, None])
    sides = np.stack([r, s, s - r], axis=1)
    # strain by those along the sides
    dyads = np.stack([a[:, :, None] * a[:, None] + both, b[:, :, None] * b[:, None] + both, -both], axis=1)
    places = zip(kind.read_at, kind.reading(kind.centre[None])[0], kind.read_along or [None] * 4, strict=True)
    for point, weight, side in places:
        normal, strain = _along(kind, corners, point)
        halfway = (normal + n) / (1 + np.sum(normal * n, axis=1))[:, None]
        R = np.eye(3) + 2 * n[:, :, None] * normal[:, None] - halfway[:, :, None] * (normal + n)[:, None]
        rotated = np.einsum("mip,mjq,mapqc->maijc", R, R, strain, optimize=True)
        if side is not None:
            rotated = np.einsum(
                "mi,mj,maijc,mkl->maklc", sides[:, side], sides[:, side], rotated, dyads[:, side], optimize=True
            )
        total += weight * rotated
    return total


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
    anisotropic = np.isin(region, anisotropic_regions(mesh))
    nu = poisson_ratios(mesh, region[~anisotropic])
    if not anisotropic.any():
        return bubble_amplitudes(kind, position, nu, ids)
    assert kind.bubble_gradient is not None
    modes = kind.bubble_gradient(kind.centre[None]).shape[1]
    amplitudes = np.empty((len(ids), 3 * modes, 3 * len(kind.nodes)))
    for which, rule in by_rule(mesh, kind, region):
        C = elasticities(mesh, kind, position[which], region[which], rule[0])
        amplitudes[which] = bubble_amplitudes(kind, position[which], C, ids[which], rule)
    if len(nu):
        amplitudes[~anisotropic] = bubble_amplitudes(kind, position[~anisotropic], nu, ids[~anisotropic])
    return amplitudes


def bubble_amplitudes(
    kind: ElementKind, position: np.ndarray, law: np.ndarray, ids: np.ndarray, rule: Rule | None = None
) -> np.ndarray:
    """α = −K_aa⁻¹K_au z of the incompatible modes of a kind, with the gradients of `element_stiffnesses`.

    position (e, k, 3) [m]; law (e,) Poisson's ratio, or C (e, q or 1, 6, 6) as in `anisotropic_stiffnesses`; ids for the
    error message; rule: None that of the kind. Returns (e, 3p, 3k), rows 3·mode + component."""
    xi, w = kind.stiffness if rule is None else rule
    g, det = gradients(kind, position, xi, ids)
    bubble = bubble_gradients(kind, position, xi, det)
    weight = (w * det)[:, :, None, None]
    Bu, Ba = (symmetric_gradient(part).reshape(len(ids), len(w), 6, -1) for part in (g, bubble))
    stress = law @ Ba if law.ndim == 4 else isotropic(Ba, *(part[:, None, None] for part in lame(law)))
    DBa = np.swapaxes(weight * stress, 2, 3)
    return -np.linalg.solve((DBa @ Ba).sum(axis=1), (DBa @ Bu).sum(axis=1))


def isotropic(strain: np.ndarray, lam: np.ndarray, mu: np.ndarray) -> np.ndarray:
    """σ = λ tr(ε) I + 2με: strain (..., 6, w) with shears γ, lam and mu that broadcast with (..., w) → stress (..., 6, w)."""
    stress = np.asarray(mu)[..., None, :] * strain
    stress[..., :3, :] *= 2
    stress[..., :3, :] += (lam * strain[..., :3, :].sum(axis=-2))[..., None, :]
    return stress


CHUNK = 2048
"""Points at a time, so that their data fits the cache of the processor."""


@dataclass(frozen=True)
class SurfaceModel:
    """ε = B q and σ = E(θ) C(ν) ε of p points: strain B (p, 6, r), shears γ; lam and mu (p,) Lamé's constants of unit
    modulus; modulus E(θ) (p,) [Pa], affine in the free moduli and stiffness factors. At the points of laws.facet (laminates
    and anisotropic solids) C(θ) is that of `FacetLaws` [Pa], and E its factor [-].
    change (p, 6, r): the change of B with θ where a shell thickness is free."""

    strain: np.ndarray
    lam: np.ndarray
    mu: np.ndarray
    modulus: AffineOperator
    laws: FacetLaws | None = None
    change: AffineOperator = NO_CHANGE

    def unit_stress(
        self, strain: np.ndarray, law: np.ndarray | None, start: int = 0, factor: np.ndarray | float = 1.0
    ) -> np.ndarray:
        """factor × C ε (k, 6, w) of strain (k, 6, w), shears γ, at the points from `start` on; factor (k,) or scalar; law: C
        (m, 6, 6) of the points with laws."""
        here = slice(start, start + len(strain))
        column = np.broadcast_to(factor, len(strain))[:, None]
        stress = isotropic(strain, column * self.lam[here, None], column * self.mu[here, None])
        if self.laws is not None and law is not None:
            law_rows = np.flatnonzero((self.laws.facet >= start) & (self.laws.facet < start + len(strain)))
            at = self.laws.facet[law_rows] - start
            stress[at] = column[at, :, None] * (law[law_rows] @ strain[at])
        return stress

    def law_stress(self, strain: np.ndarray, law: np.ndarray) -> np.ndarray:
        """C ε (p, 6, w) of strain (p, 6, w) at points with laws, zero elsewhere; law C (m, 6, 6)."""
        stress = np.zeros_like(strain)
        if self.laws is not None:
            stress[self.laws.facet] = law @ strain[self.laws.facet]
        return stress


@dataclass(frozen=True)
class SurfaceState:
    """strain (p, 6), shears γ; stress (p, 6) [Pa]; von_mises (p,) [Pa]; principal (p, 3) [Pa], largest first; and their
    standard deviations, None without a covariance."""

    strain: np.ndarray
    stress: np.ndarray
    von_mises: np.ndarray
    principal: np.ndarray
    strain_std: np.ndarray | None = None
    stress_std: np.ndarray | None = None
    von_mises_std: np.ndarray | None = None


def surface_model(
    mesh: Mesh, rows: StrainRows, field: np.ndarray, parameters: Sequence[Parameter] = ()
) -> SurfaceModel:
    """The strain operator applied to a displacement field per coordinate, field (3n, r), with the materials of the regions.

    parameters: those of the stiffness stay free. Raises DeckError for a region without a material."""
    numbers, where = np.unique(rows.region, return_inverse=True)
    for number in numbers:
        if int(number) not in mesh.regions or mesh.density_of(int(number)) is None:
            raise DeckError(
                f"region {number} has no material",
                remedy="Specify a material under mesh.materials: stresses require a material.",
            )
    if rows.laws is not None and (without_stress := np.isnan(rows.laws.stiffness.constant[:, 0, 0])).any():
        region = mesh.regions[int(rows.region[rows.laws.facet[np.argmax(without_stress)]])]
        raise DeckError(
            f"{region} has different materials for membrane and bending, or membrane-bending coupling: stress cannot be "
            "computed from surface strain in this region",
            remedy="Assign one material (MID1 = MID2, no MID4) or plies (PCOMP), or request no stress and damage in this region.",
        )
    materials = [mesh.material_of(int(number)) for number in numbers]
    lam, mu = lame(np.array([0.0 if material is None else material.poisson_ratio for material in materials])[where])
    E = np.array([1.0 if material is None else material.youngs_modulus for material in materials])[where]
    terms = {}
    for p in parameters:
        if scales_stiffness(p.property):
            in_regions = np.isin(rows.region, [number for number in p.regions if not shapes(mesh, number, p.property)])
            terms[p.name] = in_regions * (E if p.property == "stiffness_factor" else 1.0)
            E = np.where(in_regions, 0.0, E)
    strain = rows.matrix @ np.asarray(field).reshape(3 * len(mesh.position), -1)
    return SurfaceModel(strain.reshape(len(E), 6, -1), lam, mu, AffineOperator(E, terms), rows.laws)


def surface_state(
    model: SurfaceModel,
    theta: Mapping[str, float],
    q: np.ndarray,
    covariance: np.ndarray | None = None,
    free: Sequence[str] = (),
) -> SurfaceState:
    """Fields at the coordinates q (r,) and parameters theta [SI], and their standard deviations to first order:

        std(gᵀx) = √(gᵀPg),   x = [q, θ_free],   ∂σ/∂q = E C B,   ∂σ_v/∂σ = 3 dev(σ)/2σ_v
        ∂σ/∂θ_i = (C ∂E/∂θ_i + E ∂C/∂θ_i) B q + E C ∂B/∂θ_i q

    covariance P (r + k, r + k) of q and the k parameters named by free, these in SI units: derivatives by p = ln θ are θ times
    those by θ. Where σ_v is zero it has no derivative; there √tr(VP_σ), the root mean square of σ_v = √(σᵀVσ), is used."""
    r = model.strain.shape[2]
    assert covariance is None or np.shape(covariance) == (r + len(free),) * 2
    B = np.asarray(model.strain + model.change.at(theta))
    strain = (B.reshape(-1, r) @ q).reshape(-1, 6)
    E = np.asarray(model.modulus.at(theta))
    law = None if model.laws is None else np.asarray(model.laws.stiffness.at(theta))
    unit = model.unit_stress(strain[..., None], law)[..., 0]
    stress = E[:, None] * unit
    mises = von_mises(stress)
    state = SurfaceState(strain, stress, mises, principal(stress))
    if covariance is None:
        return state
    slopes = np.stack([np.asarray(model.modulus.derivative(name, theta)) for name in free], axis=1) if free else None
    thicker = _thickness_slopes(model, theta, free, q)
    of_plies = _ply_slopes(model, theta, free, E[:, None, None] * strain[..., None])
    root = _root(covariance)
    strain_std, stress_std, mises_std = np.empty_like(strain), np.empty_like(stress), np.empty_like(mises)
    for start in range(0, len(E), CHUNK):
        here = slice(start, start + CHUNK)
        spread = (B[here].reshape(-1, r) @ root[:r]).reshape(-1, 6, root.shape[1])
        if thicker is not None:
            spread += thicker[here] @ root[r:]
        strain_std[here] = _length(spread)
        spread = model.unit_stress(spread, law, start, E[here])
        if slopes is not None:
            spread += unit[here, :, None] * (slopes[here] @ root[r:])[:, None, :]
        if of_plies is not None:
            spread += of_plies[here] @ root[r:]
        stress_std[here] = _length(spread)
        mises_std[here] = _mises_std(stress[here], mises[here], spread)
    return replace(state, strain_std=strain_std, stress_std=stress_std, von_mises_std=mises_std)


def _thickness_slopes(
    model: SurfaceModel, theta: Mapping[str, float], free: Sequence[str], q: np.ndarray
) -> np.ndarray | None:
    """∂B/∂θ q (p, 6, k) of the k parameters; None if none of them is a thickness."""
    if not set(free) & set(model.change.parameters):
        return None
    slopes = [np.broadcast_to(model.change.derivative(name, theta), model.strain.shape) @ q for name in free]
    return np.stack(slopes, axis=2)


def _ply_slopes(
    model: SurfaceModel, theta: Mapping[str, float], free: Sequence[str], strain: np.ndarray
) -> np.ndarray | None:
    """∂C/∂θ ε (p, 6, k) of strain (p, 6, 1) and the k parameters; None if none of them is a modulus of plies."""
    if model.laws is None or not set(free) & set(model.laws.stiffness.parameters):
        return None
    slopes = [model.law_stress(strain, model.laws.stiffness.derivative(name, theta)) for name in free]
    return np.concatenate(slopes, axis=2)


def von_mises(stress: np.ndarray) -> np.ndarray:
    """σ_v = √(½[(σx − σy)² + (σy − σz)² + (σz − σx)²] + 3(τxy² + τyz² + τzx²)): stress (..., 6) → (...)."""
    x, y, z = stress[..., 0], stress[..., 1], stress[..., 2]
    shear = np.einsum("...i,...i->...", stress[..., 3:], stress[..., 3:])
    return np.sqrt(0.5 * ((x - y) ** 2 + (y - z) ** 2 + (z - x) ** 2) + 3 * shear)


def principal(stress: np.ndarray) -> np.ndarray:
    """σ₁ ≥ σ₂ ≥ σ₃: stress (..., 6) → (..., 3)."""
    tensor = np.zeros((*stress.shape[:-1], 3, 3))
    for i in range(3):
        tensor[..., i, i] = stress[..., i]
    for place, (i, j) in enumerate(SHEARS, start=3):
        tensor[..., i, j] = tensor[..., j, i] = stress[..., place]
    return np.linalg.eigvalsh(tensor)[..., ::-1]


def _root(P: np.ndarray) -> np.ndarray:
    """L with P = LLᵀ and as many columns as the rank of P; eigenvalues made negative by rounding are dropped."""
    # scaled to a unit diagonal: moduli [Pa] and coordinates differ by twenty orders of magnitude
    std = np.sqrt(np.maximum(np.diagonal(P), 0.0))
    scale = np.where(std > 0, std, 1.0)
    lam, V = np.linalg.eigh(P / np.outer(scale, scale))
    keep = lam > 0
    return scale[:, None] * V[:, keep] * np.sqrt(lam[keep])


def _length(spread: np.ndarray) -> np.ndarray:
    return np.sqrt(np.einsum("...i,...i->...", spread, spread))


def _mises_std(stress: np.ndarray, mises: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """std of σ_v; stress (p, 6), mises (p,), spread (p, 6, w) with covariance of the stress = spread · spreadᵀ."""
    gradient = 3.0 * stress
    gradient[:, :3] -= stress[:, :3].sum(axis=1, keepdims=True)
    gradient[:, :3] *= 0.5
    none = mises == 0
    gradient /= np.where(none, 1.0, mises)[:, None]
    std = np.linalg.norm(np.matmul(gradient[:, None, :], spread)[:, 0], axis=1)
    if none.any():
        std[none] = np.sqrt((von_mises(np.swapaxes(spread[none], 1, 2)) ** 2).sum(axis=1))
    return std
