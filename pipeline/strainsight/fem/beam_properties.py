"""What the sections of straight beams resist with: checked, and as the compliance of a beam that tapers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.thin import BeamSection, FloatArray

ABSENT = 1e-13
"""Of the greater principal moment: a lesser one is rounding, and the beam does not resist bending that way."""

ONE_END = 1e-12
"""Of the mean of both ends: a resistance that is less at one of them ends there."""


@dataclass(frozen=True)
class BeamProperties:
    """Sections of e beams at their ends A and B, linear in between.

    area (e, 2) [m²]; second (e, 2, 2, 2) ∫ (y, z)ᵀ (y, z) dA [m⁴], about the centroid; torsion J (e, 2) [m⁴]; shear (e, 2)
    areas over the area along y and z [-], 0 where the beam does not shear; poisson_ratio (e,) [-]; neutral (e, 2, 2) y and z [m]
    of the neutral axis from the axis of the beam, through the shear centres, at both ends; None where they are one.
    """

    area: FloatArray
    second: FloatArray
    torsion: FloatArray
    shear: FloatArray
    poisson_ratio: FloatArray
    neutral: FloatArray | None = None


def properties_of(sections: Sequence[BeamSection], poisson_ratio: FloatArray) -> BeamProperties:
    """Properties of beams with these sections, one a beam; those at B are those at A where a section names no other.

    The areas of shear over the area are those at A. poisson_ratio (e,) [-].
    """
    ends = [(section, section.at_b or section) for section in sections]
    return BeamProperties(
        np.array([[end.area for end in pair] for pair in ends], float).reshape(-1, 2),
        np.array([[end.second for end in pair] for pair in ends], float).reshape(-1, 2, 2, 2),
        np.array([[end.torsion for end in pair] for pair in ends], float).reshape(-1, 2),
        np.array([section.shear for section in sections], float).reshape(-1, 2),
        np.asarray(poisson_ratio, float),
        np.array([[end.neutral for end in pair] for pair in ends], float).reshape(-1, 2, 2),
    )


def check_properties(own: BeamProperties, ids: np.ndarray) -> None:
    """Raises DeckError for an area that is not positive, negative moments or shear, I1 I2 < I12², and a resistance that one
    end has and the other does not."""
    I1, I2, I12 = own.second[..., 0, 0], own.second[..., 1, 1], own.second[..., 0, 1]
    require_area(own.area, ids)
    for name, value, unit in (
        ("moment of area I1", I1, "m⁴"),
        ("moment of area I2", I2, "m⁴"),
        ("torsion constant J", own.torsion, "m⁴"),
        ("shear factor", own.shear, ""),
    ):
        require(
            value >= 0, value, ids, f"has the {name} {{value:g}} {unit}".rstrip(), f"give its property a {name} ≥ 0"
        )
    excess = I12**2 - I1 * I2 * (1 + 1e-12)
    what, remedy = (
        "has I12² more than I1 I2, by {value:.3g} m⁸",
        "check I1, I2 and I12 of its property: no section has these",
    )
    require(excess <= 0, excess, ids, what, remedy)
    ends = np.concatenate([bending_axes(own.second)[1], _shares(own.torsion)[:, None]], axis=1)
    least = ends.min(axis=(1, 2))
    what = "resists bending or torsion at one of its ends and not at the other (there it has {value:.3g} of the mean)"
    require(least > ONE_END, least, ids, what, "give its property I1, I2 and J at both ends, or at neither")


def require_area(area: np.ndarray, ids: np.ndarray) -> None:
    """Raises DeckError where an area (e, …) is not positive."""
    require(area > 0, area, ids, "has the area {value:g} m²", "give its property a positive area")


def require(right: np.ndarray, value: np.ndarray, ids: np.ndarray, what: str, remedy: str) -> None:
    """Raises DeckError with the first value (e, …) that is not right."""
    if not right.all():
        at = tuple(np.argwhere(~right)[0])
        raise DeckError(
            f"element {ids[at[0]]} {what.format(value=value[at])}", remedy=remedy, entity=("element", int(ids[at[0]]))
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
    columns of Q resist (e, 2).
    """
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
"""Of a motion's stiffness before any release: what is left of it below this is rounding."""


def end_stiffness(length: np.ndarray, own: BeamProperties, released: np.ndarray) -> np.ndarray:
    """B F⁻¹ Bᵀ (e, 12, 12) of the motions of the ends, along the axes of the beam, without what is released.

    length (e,) [m]; own as `check_properties` accepts it; released (e, 2, 6). Its rows 6 to 11 are the forces on B.
    """
    F, resists, Q = _flexibility(length, own)
    B = _equilibrium(length, Q)
    # F of diagonal 1, whatever the units; what is not resisted drops out of B
    scale = np.where(resists, 1 / np.sqrt(np.where(resists, np.diagonal(F, axis1=1, axis2=2), 1.0)), 0.0)
    scaled = F * scale[:, :, None] * scale[:, None, :]
    scaled[:, np.arange(6), np.arange(6)] = 1.0
    B *= scale[:, None, :]
    K = B @ np.linalg.inv(scaled) @ B.swapaxes(1, 2)
    return _released(K, released.reshape(-1, 12))


def _flexibility(length: np.ndarray, own: BeamProperties) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F (e, 6, 6) of (N, V₁, V₂, T, m₁, m₂) at B, along the columns of Q (e, 2, 2); which of them (e, 6) are resisted."""
    v, ends, Q, present = bending_axes(own.second)
    v, L = Q.swapaxes(1, 2) @ v, length[:, None, None]
    bending = np.einsum("eij,kej,elj->keil", v, taper_integrals(ends[..., 0], ends[..., 1]), v)
    shear_modulus = 1 / (2 * (1 + own.poisson_ratio))
    of_area = taper_integrals(own.area[:, 0], own.area[:, 1])[0]
    twists = np.min(own.torsion, axis=1) > 0
    J = np.where(twists[:, None], own.torsion, 1.0)
    shears = own.shear > 0
    per_shear = np.where(shears, of_area[:, None] / np.where(shears, own.shear, 1.0), 0.0) / shear_modulus[:, None]
    F = np.zeros((len(length), 6, 6))
    F[:, 0, 0] = length * of_area
    F[:, 3, 3] = length * taper_integrals(J[:, 0], J[:, 1])[0] / shear_modulus
    F[:, 1:3, 1:3] = L**3 * bending[2] + L * np.einsum("eki,ek,ekj->eij", Q, per_shear, Q)
    F[:, 4:, 4:] = L * bending[0]
    F[:, 1:3, 4:] = F[:, 4:, 1:3] = -(L**2) * bending[1]
    if own.neutral is not None and own.neutral.any():
        F += _beside_the_axis(F, L, Q, own.neutral, F[:, 1:3, 1:3] - L**3 * bending[2])
    ones = np.ones(len(length), bool)
    return F, np.stack([ones, *present.T, twists, *present.T], axis=1), Q


def _beside_the_axis(F: np.ndarray, L: np.ndarray, Q: np.ndarray, neutral: np.ndarray, shear: np.ndarray) -> np.ndarray:
    """What F grows by where the neutral axis lies n = n_B + (1 − ξ)(n_A − n_B) from the axis: moments about it are

        m_c(ξ) = m(ξ) − N n(ξ) = (m_B − N n_B) − (1 − ξ)(L V + N (n_A − n_B)),

    so that N alone bends as m = −n_B and V = (n_A − n_B)/L do. shear (e, 2, 2): the part of F that V shears.
    """
    n = np.einsum("eji,eaj->eai", Q, neutral)
    bent = F[:, [1, 2, 4, 5]][:, :, [1, 2, 4, 5]]
    bent[:, :2, :2] -= shear
    g = np.concatenate([(n[:, 0] - n[:, 1]) / L[:, :, 0], -n[:, 1]], axis=1)
    more = np.zeros_like(F)
    more[:, 0, [1, 2, 4, 5]] = more[:, [1, 2, 4, 5], 0] = np.einsum("eij,ej->ei", bent, g)
    more[:, 0, 0] = np.einsum("ei,eij,ej->e", g, bent, g)
    return more


def _equilibrium(length: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """B (e, 12, 6): forces and moments on both ends that (N, V₁, V₂, T, m₁, m₂) at B stand for."""
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


def _released(K: np.ndarray, released: np.ndarray) -> np.ndarray:
    """K − K_r K_rr⁻¹ K_rᵀ, one motion at a time; one without stiffness is left without."""
    if not released.any():
        return K
    before = np.diagonal(K, axis1=1, axis2=2).copy()
    for i in range(12):
        own = np.flatnonzero(released[:, i])
        column, pivot = K[own, :, i], K[own, i, i]
        stiff = pivot > LOOSE * before[own, i]
        column = np.where(stiff[:, None], column / np.sqrt(np.where(stiff, pivot, 1.0))[:, None], 0.0)
        K[own] -= column[:, :, None] * column[:, None, :]
        K[own, i, :] = K[own, :, i] = 0.0
    return K


def taper_integrals(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """∫₀¹ (1 − ξ)^k / (a (1 − ξ) + b ξ) dξ for k = 0, 1, 2 of values a at A and b at B, both positive.

    With λ = b/a, 1 + (λ − 1) ξ = λˢ takes the pole away: (ln λ)/(a (λ − 1)) ∫₀¹ (1 − ξ(s))^k ds, by Gauss points.

    start, end (...,). Returns (3, ...).
    """
    points, weights = np.polynomial.legendre.leggauss(POINTS)
    s, weights = 0.5 * (points + 1), 0.5 * weights
    log = np.log(end / start)
    even = np.abs(log) < 1e-9
    grown = np.expm1(np.where(even, 1.0, log))
    factor = np.where(even, 1 - log / 2, log / grown) / start
    rest = 1 - np.where(even[..., None], s, np.expm1(np.where(even, 1.0, log)[..., None] * s) / grown[..., None])
    return np.stack([factor, factor * (rest @ weights), factor * (rest**2 @ weights)])
