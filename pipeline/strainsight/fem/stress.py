"""Strain and stress of the surface at one instant of a reduced motion, with the standard deviations they inherit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.errors import DeckError
from strainsight.fem.affine import NO_CHANGE, AffineOperator, Parameter, scales_stiffness
from strainsight.fem.elasticity import FacetLaws
from strainsight.fem.element_matrices import SHEARS
from strainsight.fem.recovery import StrainRows, isotropic, lame
from strainsight.mesh.model import Mesh
from strainsight.mesh.properties import shapes

CHUNK = 2048
"""Points at a time: what belongs to them stays in the processor's cache."""


@dataclass(frozen=True)
class SurfaceModel:
    """ε = B q and σ = E(θ) C(ν) ε of p points: strain B (p, 6, r), shears γ; lam and mu (p,) Lamé's constants of unit
    modulus; modulus E(θ) (p,) [Pa], affine in the free moduli and factors of the stiffness. On a face of a laminate, and of
    an anisotropic solid, C(θ) is that of `FacetLaws` there [Pa], and E its factor [-]: points that laws.facet names.
    change (p, 6, r): what θ adds to B where a thickness of shells is free."""

    strain: np.ndarray
    lam: np.ndarray
    mu: np.ndarray
    modulus: AffineOperator
    laws: FacetLaws | None = None
    change: AffineOperator = NO_CHANGE

    def strain_at(self, theta: Mapping[str, float]) -> np.ndarray:
        """B(θ) (p, 6, r)."""
        return np.asarray(self.strain + self.change.at(theta))

    def unit_stress(
        self, strain: np.ndarray, law: np.ndarray | None, start: int = 0, factor: np.ndarray | float = 1.0
    ) -> np.ndarray:
        """factor × C ε (k, 6, w) of strain (k, 6, w), shears γ, at the points from `start` on; factor (k,) or one; law: C
        (m, 6, 6) where there are laws."""
        here = slice(start, start + len(strain))
        column = np.broadcast_to(factor, len(strain))[:, None]
        stress = isotropic(strain, column * self.lam[here, None], column * self.mu[here, None])
        if self.laws is not None and law is not None:
            own = np.flatnonzero((self.laws.facet >= start) & (self.laws.facet < start + len(strain)))
            at = self.laws.facet[own] - start
            stress[at] = column[at, :, None] * (law[own] @ strain[at])
        return stress

    def law_stress(self, strain: np.ndarray, law: np.ndarray) -> np.ndarray:
        """C ε (p, 6, w) of strain (p, 6, w) where there are laws, zero elsewhere; law C (m, 6, 6)."""
        stress = np.zeros_like(strain)
        if self.laws is not None:
            stress[self.laws.facet] = law @ strain[self.laws.facet]
        return stress


@dataclass(frozen=True)
class SurfaceState:
    """strain (p, 6), shears γ; stress (p, 6) [Pa]; von_mises (p,) [Pa]; principal (p, 3) [Pa], largest first; and their
    standard deviations, None where no covariance is given."""

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
    """The rows on a displacement field per coordinate, field (3n, r), with the materials of their regions.

    parameters: those of the stiffness stay free in their regions. Raises DeckError where a region has no
    material.
    """
    numbers, where = np.unique(rows.region, return_inverse=True)
    for number in numbers:
        if int(number) not in mesh.regions or mesh.density_of(int(number)) is None:
            raise DeckError(
                f"region {number} has no material", remedy="stresses need one: state it under mesh.materials"
            )
    if rows.laws is not None and (lost := np.isnan(rows.laws.stiffness.constant[:, 0, 0])).any():
        region = mesh.regions[int(rows.region[rows.laws.facet[np.argmax(lost)]])]
        raise DeckError(
            f"{region} has one material in its membrane and another in bending, or coupling: strain on its faces makes no stress",
            remedy="give it one material (MID1 = MID2, no MID4) or plies (PCOMP), or do without stress and damage there",
        )
    materials = [mesh.material_of(int(number)) for number in numbers]
    lam, mu = lame(np.array([0.0 if own is None else own.poisson_ratio for own in materials])[where])
    E = np.array([1.0 if own is None else own.youngs_modulus for own in materials])[where]
    terms = {}
    for p in parameters:
        if scales_stiffness(p.property):
            own = np.isin(rows.region, [number for number in p.regions if not shapes(mesh, number, p.property)])
            terms[p.name] = own * (E if p.property == "stiffness_factor" else 1.0)
            E = np.where(own, 0.0, E)
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

    covariance P (r + k, r + k) of q and the k parameters named by free, these in SI units: of p = ln θ they are θ times p.
    Where σ_v is zero it has no slope; √tr(VP_σ), the root mean square of σ_v = √(σᵀVσ), stands for it there.
    """
    r = model.strain.shape[2]
    if covariance is not None and np.shape(covariance) != (r + len(free),) * 2:
        raise ValueError(f"covariance {np.shape(covariance)} of {r} coordinates and {len(free)} parameters")
    B = model.strain_at(theta)
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
    """∂B/∂θ q (p, 6, k) of the k parameters; None where none of them is a thickness."""
    if not set(free) & set(model.change.parameters):
        return None
    slopes = [np.broadcast_to(model.change.derivative(name, theta), model.strain.shape) @ q for name in free]
    return np.stack(slopes, axis=2)


def _ply_slopes(
    model: SurfaceModel, theta: Mapping[str, float], free: Sequence[str], strain: np.ndarray
) -> np.ndarray | None:
    """∂C/∂θ ε (p, 6, k) of strain (p, 6, 1) and the k parameters; None where none of them is a modulus of plies."""
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
    """L with P = LLᵀ, of as many columns as P has rank; what rounding has made negative is zero."""
    # to a unit diagonal first: moduli [Pa] beside coordinates lie twenty orders of magnitude apart
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
