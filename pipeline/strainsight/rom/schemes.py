"""Other ways to step the reduced model than the exact one, and what they do to its frequencies."""

from __future__ import annotations

from typing import Literal

import numpy as np

from strainsight.rom.model import Damping
from strainsight.rom.oscillator import HOLD, Along, oscillator_step, slopes_along

Scheme = Literal["exact", "trapezoidal", "implicit_euler"]


def scheme_step(
    lam: np.ndarray, damping: Damping, h: float, scheme: Scheme = "exact", along: Along = "eigenvalue"
) -> tuple[np.ndarray, np.ndarray]:
    """Propagator T of a damped oscillator over one step by the scheme, and its slope, as `oscillator_step` gives them.

        trapezoidal      z⁺ = z + h(ż + ż⁺)/2,   ż⁺ = ż + h(z̈ + z̈⁺)/2         (Newmark with β = ¼, γ = ½)
        implicit Euler   z⁺ = z + hż⁺,           ż⁺ = ż + hz̈⁺

    with z̈ = g − c(λ)ż − λz. lam (...) [rad²/s²]; h [s]. Returns two arrays (2, 2 + HOLD, ...).
    """
    if scheme == "exact":
        return oscillator_step(lam, damping, h, along)
    c, lam_slope, c_slope = slopes_along(lam, damping, along)
    # both are ż⁺ = (a ż − hλz + hḡ)/d with ḡ the mean of the force over both ends or the force at the end
    s, at_end = (0.5 * h, 0.5) if scheme == "trapezoidal" else (h, 1.0)
    d, d_slope = 1 + s * c + s * s * lam, s * c_slope + s * s * lam_slope
    a, a_slope = (2 - d, -d_slope) if scheme == "trapezoidal" else (np.ones_like(lam), np.zeros_like(lam))
    force = [np.full_like(lam, h * (1.0 if j == 0 else at_end)) for j in range(HOLD)]
    over = np.stack([-h * lam, a, *force])
    over_slope = np.stack([-h * lam_slope, a_slope, *([np.zeros_like(lam)] * HOLD)])
    T, dT = np.zeros((2, 2 + HOLD, *lam.shape)), np.zeros((2, 2 + HOLD, *lam.shape))
    T[1] = over / d
    dT[1] = (over_slope - T[1] * d_slope) / d
    T[0], dT[0] = s * T[1], s * dT[1]
    T[0, 0] += 1
    if scheme == "trapezoidal":
        T[0, 1] += s
    return T, dT


def scheme_bias(lam: np.ndarray, damping: Damping, h: float, scheme: Scheme) -> tuple[np.ndarray, np.ndarray]:
    """How much longer the period of every mode becomes, and how much damping it gains:

        μ = eigenvalue of the step,   ln μ / h = −ζ′ω′ ± iω_d′;    elongation ω_d/ω_d′ − 1,    gain ζ′ − ζ

    lam (n,) [rad²/s²]; h [s]. Undamped and for small ωh: (ωh)²/12 and 0 for the trapezoidal rule, (ωh)²/3 and ωh/2 for
    implicit Euler; 0 and 0 for the exact step. A modulus estimated with the scheme errs by about twice the elongation.
    Returns elongation (n,) and gain (n,); NaN for a mode that does not swing.
    Source: Hughes, The Finite Element Method (1987), section 9.3.
    """
    if scheme == "exact":
        return np.zeros_like(lam), np.zeros_like(lam)
    block = np.moveaxis(scheme_step(lam, damping, h, scheme)[0][:, :2], -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = np.log(np.linalg.eigvals(block).astype(complex)) / h
        rate = rate[np.arange(len(lam)), np.argmax(rate.imag, axis=1)]
        c = damping.viscous(lam)[0]
        swing = np.sqrt(np.where(lam > 0.25 * c * c, lam - 0.25 * c * c, np.nan))
        numerical = np.where(rate.imag > 0, rate.imag, np.nan)
        return swing / numerical - 1, -rate.real / np.abs(rate) - 0.5 * c / np.sqrt(lam)
