"""Hertz's point contact of a ball in a groove, from the exact elliptic integrals."""

from __future__ import annotations

import math

import numpy as np

from strainsight.compiled import inner, kept


@kept()
def point_contact(along: float, across: float, modulus: float) -> tuple[float, float]:
    """Contact constant K and the share of the first axis in the approach, from the two relative curvatures.

        Q = K δ^1.5,   a_i² = 2 sᵢ δ/ρᵢ,   s₁ + s₂ = 1,   K = (2π E*/3 K(m)) √(2 s/ρ)  of the long axis,   m = 1 − (b/a)²
        the ellipse from the curvatures:   ρ_short/ρ_long = (1 − s)/(s (b/a)²),   s(m) = (1 − E(m)/K(m))/m
        ∂ ln K/∂ρᵢ = −sᵢ/(2 ρᵢ)

    The slopes follow without another elliptic integral because 0.4 K δ^2.5 is the least elastic energy under a given
    approach: a change of the gap ρᵢ xᵢ²/2 does the work of the pressure on it, and ⟨xᵢ²⟩ = aᵢ²/5 under half an ellipsoid.

    along, across [1/m] > 0: relative principal curvatures; modulus E* [Pa]: 1/E* = Σ (1 − ν²)/E of the two bodies.
    Returns K [N/m^1.5] and s₁ of `along`. Source: Johnson, Contact Mechanics, section 4.2; Hertz 1881.
    """
    long, short = min(along, across), max(along, across)
    ratio = _axis_ratio(short / long)
    integral, share = _elliptic(ratio)
    constant = 2 * math.pi * modulus / (3 * integral) * math.sqrt(2 * share / long)
    return constant, share if along <= across else 1 - share


@inner
def _elliptic(k: float) -> tuple[float, float]:
    """K(m) and s(m) = (1 − E(m)/K(m))/m at m = 1 − k², by the arithmetic-geometric mean, to round-off for 0 < k ≤ 1.

    c₁² = m (1 − k)/(4 (1 + k)) is divided by m beforehand, so that the circle m = 0 is no special case.
    """
    a, b = 0.5 * (1 + k), math.sqrt(k)
    c = 0.5 * (1 - k)
    term = 0.25 * (1 - k) / (1 + k)
    share, weight = 0.5 + term, 1.0
    while c > 1e-17 * a:
        mean = 0.5 * (a + b)
        b = math.sqrt(a * b)
        term *= c * c / (16 * mean * mean)
        c *= 0.25 * c / mean
        a = mean
        weight *= 2
        share += weight * term
    return 0.5 * math.pi / a, share


@inner
def _axis_ratio(curvatures: float) -> float:
    """b/a ≤ 1 of the contact ellipse at ρ_short/ρ_long ≥ 1, by the secant rule in logarithms."""
    goal = math.log(curvatures)
    x = -2 / math.pi * goal
    before, f_before = 0.0, -goal
    for _ in range(40):
        _, s = _elliptic(math.exp(x))
        f = math.log((1 - s) / s) - 2 * x - goal
        if f == f_before or x == before:
            break
        step = -f * (x - before) / (f - f_before)
        before, f_before = x, f
        x = min(x + step, 0.0)
        if abs(step) < 1e-15:
            break
    return math.exp(x)


@kept()
def groove_curvatures(ball: float, groove: float, pitch: float, cosine: float, side: float) -> tuple[float, float]:
    """Relative curvatures along and across the raceway of a ball in a groove.

        ρ_along = 2/(D (1 ∓ D cos α/d_m)),   upper sign at the inner ring,      ρ_across = 2/D − 1/r

    ball D, groove r, pitch d_m [m]; cosine: cos α at the free angle; side: +1 inner, −1 outer ring. Returns two [1/m].
    Source: Harris, Rolling Bearing Analysis, chapter 2 (curvature sum and difference).
    """
    return 2 / (ball * (1 - side * ball * cosine / pitch)), 2 / ball - 1 / groove


@kept()
def groove_contact(
    ball: float, groove: float, pitch: float, cosine: float, side: float, modulus: float
) -> tuple[float, float, float]:
    """K of a ball in a groove, ∂K/∂D and ∂K/∂r by the chain rule of `point_contact` over `groove_curvatures`.

    Arguments as in `groove_curvatures`; modulus E* [Pa]. Returns [N/m^1.5], [N/m^2.5], [N/m^2.5].
    """
    along, across = groove_curvatures(ball, groove, pitch, cosine, side)
    constant, share = point_contact(along, across, modulus)
    gamma = side * ball * cosine / pitch
    along_slope = -0.5 * along * along * (1 - 2 * gamma)
    by_along, by_across = -0.5 * constant * share / along, -0.5 * constant * (1 - share) / across
    by_ball = by_along * along_slope - by_across * 2 / (ball * ball)
    return constant, by_ball, by_across / (groove * groove)


def contact_ellipse(along: float, across: float, modulus: float, approach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Semi-axes of the contact ellipse along and across, a_i = √(2 sᵢ δ/ρᵢ); approach δ (...) [m] ≥ 0. Returns [m], [m]."""
    _, share = point_contact(along, across, modulus)
    return np.sqrt(2 * share / along * approach), np.sqrt(2 * (1 - share) / across * approach)


def peak_pressure(force: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """p₀ = 3Q/(2π a b), zero without contact; force (...) [N], semi-axes (...) [m]. Returns (...) [Pa]."""
    area = np.pi * a * b
    return np.divide(1.5 * force, area, out=np.zeros_like(area), where=area > 0)
