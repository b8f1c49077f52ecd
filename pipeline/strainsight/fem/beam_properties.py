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
    ends = [(own, own.at_b or own) for own in sections]
    return BeamProperties(
        np.array([[end.area for end in pair] for pair in ends], float).reshape(-1, 2),
        np.array([[end.second for end in pair] for pair in ends], float).reshape(-1, 2, 2, 2),
        np.array([[end.torsion for end in pair] for pair in ends], float).reshape(-1, 2),
        np.array([own.shear for own in sections], float).reshape(-1, 2),
        np.asarray(poisson_ratio, float),
        np.array([[end.neutral for end in pair] for pair in ends], float).reshape(-1, 2, 2),
    )


def check_properties(own: BeamProperties, ids: np.ndarray) -> None:
    """Raises DeckError for an area that is not positive, negative moments or shear, I1 I2 < I12², and a resistance that one
    end has and the other does not."""
    I1, I2, I12 = own.second[..., 0, 0], own.second[..., 1, 1], own.second[..., 0, 1]
    require_positive("area", own.area, ids, "m²")
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


def require_positive(name: str, value: np.ndarray, ids: np.ndarray, unit: str) -> None:
    """Raises DeckError where a value (e, …) is not positive."""
    require(value > 0, value, ids, f"has the {name} {{value:g}} {unit}", f"give its property a positive {name}")


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
