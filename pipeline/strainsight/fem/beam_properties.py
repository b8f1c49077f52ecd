"""Section properties of straight beams: checks, and the compliance of a tapered beam."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.thin import BeamSection, FloatArray

ABSENT = 1e-13
"""Share of the greater principal moment: a smaller one is rounding, and the beam does not resist bending in that direction."""

ONE_END = 1e-12
"""Share of the mean of both ends: a resistance below it at one end counts as zero there."""


@dataclass(frozen=True)
class BeamProperties:
    """Sections of e beams at their ends A and B, linear in between.

    area (e, 2) [m²]; second (e, 2, 2, 2) ∫ (y, z)ᵀ (y, z) dA [m⁴], about the centroid; torsion J (e, 2) [m⁴]; shear (e, 2)
    areas over the area along y and z [-], 0 where the beam does not shear; poisson_ratio (e,) [-]; neutral (e, 2, 2) y and z [m]
    of the neutral axis from the axis of the beam, through the shear centres, at both ends; None where they coincide."""

    area: FloatArray
    second: FloatArray
    torsion: FloatArray
    shear: FloatArray
    poisson_ratio: FloatArray
    neutral: FloatArray | None = None


def properties_of(sections: Sequence[BeamSection], poisson_ratio: FloatArray) -> BeamProperties:
    """Properties of beams with these sections, one a beam; those at B equal those at A unless a section defines others.

    The areas of shear over the area are those at A. poisson_ratio (e,) [-]."""
    ends = [(section, section.at_b or section) for section in sections]
    return BeamProperties(
        np.array([[end.area for end in pair] for pair in ends], float).reshape(-1, 2),
        np.array([[end.second for end in pair] for pair in ends], float).reshape(-1, 2, 2, 2),
        np.array([[end.torsion for end in pair] for pair in ends], float).reshape(-1, 2),
        np.array([section.shear for section in sections], float).reshape(-1, 2),
        np.asarray(poisson_ratio, float),
        np.array([[end.neutral for end in pair] for pair in ends], float).reshape(-1, 2, 2),
    )


def check_properties(properties: BeamProperties, ids: np.ndarray) -> None:
    """Raise DeckError for an area that is not positive, negative moments or shear, I1 I2 < I12², and a resistance at one
    end only."""
    I1, I2, I12 = properties.second[..., 0, 0], properties.second[..., 1, 1], properties.second[..., 0, 1]
    require_area(properties.area, ids)
    for name, value, unit in (
        ("second moment of area I1", I1, "m⁴"),
        ("second moment of area I2", I2, "m⁴"),
        ("torsion constant J", properties.torsion, "m⁴"),
        ("shear factor", properties.shear, ""),
    ):
        require(
            value >= 0,
            value,
            ids,
            f"element {{element}} has the {name} {{value:g}} {unit}".rstrip(),
            f"Specify a {name} ≥ 0 in the beam property.",
        )
    excess = I12**2 - I1 * I2 * (1 + 1e-12)
    what, remedy = (
        "element {element} has I12² > I1 I2 (difference {value:.3g} m⁸)",
        "Correct I1, I2 or I12 of the beam property: I12² cannot exceed I1 I2.",
    )
    require(excess <= 0, excess, ids, what, remedy)
    ends = np.concatenate([bending_axes(properties.second)[1], _shares(properties.torsion)[:, None]], axis=1)
    least = ends.min(axis=(1, 2))
    what = (
        "element {element} has bending or torsional stiffness at one end only "
        "(value at the other end: {value:.3g} times the mean of both ends)"
    )
    require(
        least > ONE_END, least, ids, what, "Specify I1, I2 and J of the beam property at both ends, or at neither end."
    )


def require_area(area: np.ndarray, ids: np.ndarray) -> None:
    """Raises DeckError where an area (e, …) is not positive."""
    require(
        area > 0,
        area,
        ids,
        "element {element} has the area {value:g} m²",
        "Specify a positive area in the beam property.",
    )


def require(right: np.ndarray, value: np.ndarray, ids: np.ndarray, what: str, remedy: str) -> None:
    """Raise DeckError for the first value (e, …) that is not right."""
    if not right.all():
        at = tuple(np.argwhere(~right)[0])
        raise DeckError(
            what.format(element=ids[at[0]], value=value[at]), remedy=remedy, entity=("element", int(ids[at[0]]))
        )


def _shares(ends: np.ndarray) -> np.ndarray:
    """Values at both ends (..., 2) over their mean; 1 where they are 0."""
    mean = ends.mean(axis=-1, keepdims=True)
    return np.where(mean > 0, ends / np.where(mean > 0, mean, 1.0), 1.0)


def bending_axes(second: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Moments of area along the beam as a sum over two directions, S(ξ)⁻¹ = Σ_i v_i v_iᵀ / (a_i (1 − ξ) + b_i ξ).

    The mean of both ends is S̄ = Q diag(d) Qᵀ, and v = Q d^(−1/2) R with the eigenvectors R of d^(−1/2) Qᵀ S_A Q d^(−1/2), so
    that a = vᵀ S_A v and b = vᵀ S_B v, of the mean 1. A direction that the beam does not resist has v = 0 and a = b = 1.

    second (e, 2, 2, 2) [m⁴]. Returns v (e, 2, 2) [1/m²] in columns, (a, b) (e, 2, 2), Q (e, 2, 2) in columns, and which
    columns of Q resist (e, 2)."""
    d, Q = np.linalg.eigh(second.mean(axis=1))
    present = (d > ABSENT * d[:, 1:]) & (d > 0)
    root = Q * np.where(present, 1 / np.sqrt(np.where(present, d, 1.0)), 0.0)[:, None, :]
    v = root @ np.linalg.eigh(root.swapaxes(1, 2) @ second[:, 0] @ root)[1]
    ends = np.einsum("eji,eajk,eki->eia", v, second, v, optimize=True)
    absent = ~(ends.sum(axis=2) > 0)
    return v, np.where(absent[..., None], 1.0, ends), Q, present


POINTS = 20
"""Gauss points; `taper_integrals` are right to 1e-12 where one end has a million times the other."""

LOOSE = 1e-10
"""Share of the stiffness of a motion before any release: a remainder below it is rounding."""


def end_stiffness(length: np.ndarray, properties: BeamProperties, released: np.ndarray) -> np.ndarray:
    """B F⁻¹ Bᵀ (e, 12, 12) of the motions of the ends, along the axes of the beam, without what is released.

    length (e,) [m]; properties as `check_properties` accepts them; released (e, 2, 6). Rows 6 to 11 are the forces on B."""
    F, resists, Q = _flexibility(length, properties)
    B = _equilibrium(length, Q)
    # F of diagonal 1, whatever the units; motions without resistance drop out of B
    scale = np.where(resists, 1 / np.sqrt(np.where(resists, np.diagonal(F, axis1=1, axis2=2), 1.0)), 0.0)
    scaled = F * scale[:, :, None] * scale[:, None, :]
    scaled[:, np.arange(6), np.arange(6)] = 1.0
    B *= scale[:, None, :]
    K = B @ np.linalg.inv(scaled) @ B.swapaxes(1, 2)
    return _release(K, released.reshape(-1, 12))


def _flexibility(length: np.ndarray, properties: BeamProperties) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F (e, 6, 6) of (N, V₁, V₂, T, m₁, m₂) at B, along the columns of Q (e, 2, 2); which of them (e, 6) are resisted."""
    v, ends, Q, present = bending_axes(properties.second)
    v, L = Q.swapaxes(1, 2) @ v, length[:, None, None]
    bending = np.einsum("eij,kej,elj->keil", v, taper_integrals(ends[..., 0], ends[..., 1]), v)
    shear_modulus = 1 / (2 * (1 + properties.poisson_ratio))
    of_area = taper_integrals(properties.area[:, 0], properties.area[:, 1])[0]
    twists = np.min(properties.torsion, axis=1) > 0
    J = np.where(twists[:, None], properties.torsion, 1.0)
    shears = properties.shear > 0
    per_shear = (
        np.where(shears, of_area[:, None] / np.where(shears, properties.shear, 1.0), 0.0) / shear_modulus[:, None]
    )
    F = np.zeros((len(length), 6, 6))
    F[:, 0, 0] = length * of_area
    F[:, 3, 3] = length * taper_integrals(J[:, 0], J[:, 1])[0] / shear_modulus
    F[:, 1:3, 1:3] = L**3 * bending[2] + L * np.einsum("eki,ek,ekj->eij", Q, per_shear, Q)
    F[:, 4:, 4:] = L * bending[0]
    F[:, 1:3, 4:] = F[:, 4:, 1:3] = -(L**2) * bending[1]
    if properties.neutral is not None and properties.neutral.any():
        F += _neutral_axis_terms(F, L, Q, properties.neutral, F[:, 1:3, 1:3] - L**3 * bending[2])
    return F, np.stack([np.ones(len(length), bool), *present.T, twists, *present.T], axis=1), Q


def _neutral_axis_terms(
    F: np.ndarray, L: np.ndarray, Q: np.ndarray, neutral: np.ndarray, shear: np.ndarray
) -> np.ndarray:
    """Increase of F where the neutral axis lies n = n_B + (1 − ξ)(n_A − n_B) from the axis: moments about it are

        m_c(ξ) = m(ξ) − N n(ξ) = (m_B − N n_B) − (1 − ξ)(L V + N (n_A − n_B)),

    so that N bends the beam as m = −n_B and V = (n_A − n_B)/L do. shear (e, 2, 2): the part of F due to shear."""
    n = np.einsum("eji,eaj->eai", Q, neutral)
    bent = F[:, [1, 2, 4, 5]][:, :, [1, 2, 4, 5]]
    bent[:, :2, :2] -= shear
    g = np.concatenate([(n[:, 0] - n[:, 1]) / L[:, :, 0], -n[:, 1]], axis=1)
    more = np.zeros_like(F)
    more[:, 0, [1, 2, 4, 5]] = more[:, [1, 2, 4, 5], 0] = np.einsum("eij,ej->ei", bent, g)
    more[:, 0, 0] = np.einsum("ei,eij,ej->e", g, bent, g)
    return more


def _equilibrium(length: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """B (e, 12, 6): forces and moments on both ends in equilibrium with (N, V₁, V₂, T, m₁, m₂) at B."""
    B = np.zeros((len(length), 12, 6))
    B[:, 0, 0] = B[:, 3, 3] = -1
    B[:, 6, 0] = B[:, 9, 3] = 1
    y, z, L = Q[:, 0], Q[:, 1], length[:, None]
    B[:, 7, 1:3], B[:, 8, 1:3] = y, z
    B[:, 10, 4:], B[:, 11, 4:] = z, -y
    B[:, 1:3] -= B[:, 7:9]
    B[:, 4:6] -= B[:, 10:]
    B[:, 4, 1:3], B[:, 5, 1:3] = L * z, -L * y
    return B


def _release(K: np.ndarray, released: np.ndarray) -> np.ndarray:
    """K − K_r K_rr⁻¹ K_rᵀ, one motion at a time; a motion without stiffness stays without."""
    if not released.any():
        return K
    before = np.diagonal(K, axis1=1, axis2=2).copy()
    for i in range(12):
        elements = np.flatnonzero(released[:, i])
        column, pivot = K[elements, :, i], K[elements, i, i]
        stiff = pivot > LOOSE * before[elements, i]
        column = np.where(stiff[:, None], column / np.sqrt(np.where(stiff, pivot, 1.0))[:, None], 0.0)
        K[elements] -= column[:, :, None] * column[:, None, :]
        K[elements, i, :] = K[elements, :, i] = 0.0
    return K


def taper_integrals(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """∫₀¹ (1 − ξ)^k / (a (1 − ξ) + b ξ) dξ for k = 0, 1, 2 of values a at A and b at B, both positive.

    With λ = b/a, the substitution 1 + (λ − 1) ξ = λˢ removes the pole: (ln λ)/(a (λ − 1)) ∫₀¹ (1 − ξ(s))^k ds, by Gauss points.

    start, end (...,). Returns (3, ...)."""
    points, weights = np.polynomial.legendre.leggauss(POINTS)
    s, weights = 0.5 * (points + 1), 0.5 * weights
    log = np.log(end / start)
    even = np.abs(log) < 1e-9
    grown = np.expm1(np.where(even, 1.0, log))
    factor = np.where(even, 1 - log / 2, log / grown) / start
    rest = 1 - np.where(even[..., None], s, np.expm1(np.where(even, 1.0, log)[..., None] * s) / grown[..., None])
    return np.stack([factor, factor * (rest @ weights), factor * (rest**2 @ weights)])
