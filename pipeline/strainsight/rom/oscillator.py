"""The exact step of a damped oscillator under a polynomial force and its acceleration, with slopes in the eigenvalue."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from strainsight.errors import NumericalError
from strainsight.rom.model import Damping

HOLD = 3
"""Coefficients of the force within a step: g(τ) = g₀ + g₁(τ/h) + g₂(τ/h)²."""
TERMS = 19
"""Of the series of a φ function."""
Along = Literal["eigenvalue", "damping"]
"""What a slope is in: λ, with c(λ); or ln c at fixed λ."""
INVERSE = np.array([1 / math.factorial(i) for i in range(TERMS + HOLD + 1)])
"""1/i!, i below TERMS + HOLD + 1, the highest φ function that a step takes."""


def oscillator_step(
    lam: np.ndarray, damping: Damping, h: float, along: Along = "eigenvalue"
) -> tuple[np.ndarray, np.ndarray]:
    """Propagator of  z̈ + c(λ)ż + λz = Σⱼ gⱼ (τ/h)ʲ  over one step of length h, and its derivative in λ, or in ln c.

        [z, ż](h) = T · [z, ż, g₀, g₁, g₂],   with s± the roots of s² + cs + λ = 0 and D[F] = (F(s₊) − F(s₋))/(s₊ − s₋):
        ∂z/∂ż₀ = D[eˢʰ],  ∂ż/∂ż₀ = D[s eˢʰ],  ∂z/∂gⱼ = D[wⱼ],  ∂ż/∂gⱼ = D[s wⱼ],  wⱼ = h j! φⱼ₊₁(sh)
        ∂z/∂z₀ = ∂ż/∂ż₀ + c ∂z/∂ż₀,   ∂ż/∂z₀ = −λ ∂z/∂ż₀

    lam (...) [rad²/s²] > 0; h [s]. Returns T and dT, both (2, 2 + HOLD, ...).
    Raises NumericalError at critical damping, where the two roots meet.
    Source: variation of constants; φ functions as in Hochbruck and Ostermann, Acta Numerica 19 (2010).
    """
    c, lam_slope, c_slope = slopes_along(lam, damping, along)
    half_gap = np.sqrt((0.25 * c * c - lam).astype(complex))
    if np.any(np.abs(half_gap) < 1e-6 * np.sqrt(lam)):
        raise NumericalError("a mode is critically damped", remedy="change the damping slightly")
    roots = np.stack([-0.5 * c + half_gap, -0.5 * c - half_gap])
    gap = 2 * half_gap
    sign = np.array([1.0, -1.0]).reshape(2, *([1] * lam.ndim))
    roots_slope = -sign * (lam_slope + c_slope * roots) / gap
    phi = phi_functions(roots * h, HOLD + 1)

    def conjugate_difference(F: np.ndarray, F_slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value = (F[0] - F[1]) / gap
        slope = F_slope * roots_slope
        return value.real, ((slope[0] - slope[1] - value * (roots_slope[0] - roots_slope[1])) / gap).real

    T = np.empty((2, 2 + HOLD, *lam.shape))
    dT = np.empty_like(T)
    e = phi[0]
    T[0, 1], dT[0, 1] = conjugate_difference(e, h * e)
    T[1, 1], dT[1, 1] = conjugate_difference(roots * e, e + roots * h * e)
    T[0, 0], dT[0, 0] = T[1, 1] + c * T[0, 1], dT[1, 1] + c_slope * T[0, 1] + c * dT[0, 1]
    T[1, 0], dT[1, 0] = -lam * T[0, 1], -lam_slope * T[0, 1] - lam * dT[0, 1]
    for j in range(HOLD):
        w = h * math.factorial(j) * phi[j + 1]
        w_slope = h * h * math.factorial(j) * (phi[j + 1] - (j + 1) * phi[j + 2])
        T[0, 2 + j], dT[0, 2 + j] = conjugate_difference(w, w_slope)
        T[1, 2 + j], dT[1, 2 + j] = conjugate_difference(roots * w, w + roots * w_slope)
    return T, dT


def oscillator_acceleration(
    lam: np.ndarray, damping: Damping, along: Along = "eigenvalue"
) -> tuple[np.ndarray, np.ndarray]:
    """z̈ = T · [z, ż, g],  T = [−λ, −c(λ), 1], and dT/dλ or dT/d ln c; lam (...) [rad²/s²]. Returns two arrays (1, 3, ...)."""
    c, lam_slope, c_slope = slopes_along(lam, damping, along)
    return np.stack([-lam, -c, np.ones_like(lam)])[None], np.stack([-lam_slope, -c_slope, 0 * lam])[None]


def slopes_along(lam: np.ndarray, damping: Damping, along: Along) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """c(λ), and what λ and c change by along λ, or along ln c; each (...)."""
    c, slope = damping.viscous(lam)
    return (c, np.ones_like(lam), slope) if along == "eigenvalue" else (c, np.zeros_like(lam), c)


def phi_functions(z: np.ndarray, order: int) -> list[np.ndarray]:
    """φ₀ = eᶻ,  φₖ₊₁(z) = (φₖ(z) − 1/k!)/z, by their series where |z| < 1; z (...) complex.

    order: the highest k, HOLD + 1 at most. Returns order + 1 arrays (...).
    """
    small = np.abs(z) < 1
    near, far = np.where(small, z, 0), np.where(small, 1, z)
    series = np.zeros((order + 1, *z.shape), near.dtype)
    for i in range(TERMS - 1, -1, -1):
        series = series * near + INVERSE[i : i + order + 1].reshape(-1, *(1,) * z.ndim)
    recursion = [np.exp(far)]
    for k in range(order):
        recursion.append((recursion[-1] - 1 / math.factorial(k)) / far)
    return [np.where(small, a, b) for a, b in zip(series, recursion, strict=True)]
