"""Rational approximations of the exponential for stiff linear systems, as sums over their poles."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import ceil, comb, factorial

import numpy as np

DEGREES = (2, 4, 6)
RADIUS = 0.95
TOLERANCE = 1e-4
"""What a scheme may do to a mode it is meant to resolve: relative error of the period, and damping ratio it adds."""


@dataclass(frozen=True)
class Scheme:
    """e^z ≈ R(z) = R∞ + Σ_k 2 Re c_k/(z − p_k), for real z; every pole stands for itself and its conjugate.

    degree s: R agrees with e^z up to z^(2s−1). pole p (s/2,), all with Re p > 0; residue c (s/2,); infinity R∞;
    reach: largest y to which R(iy) keeps TOLERANCE.
    """

    degree: int
    pole: np.ndarray
    residue: np.ndarray
    infinity: float
    reach: float

    def at(self, z: np.ndarray) -> np.ndarray:
        """R(z), z (...) complex."""
        z = np.asarray(z, dtype=complex)[..., None]
        pairs = self.residue / (z - self.pole) + self.residue.conj() / (z - self.pole.conj())
        return self.infinity + pairs.sum(axis=-1)

    def errors(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """R(iy) = e^{−ζ'y + iy/(1 + e)} of an undamped mode, y = ωh (...) from near 0 on in small steps: e and ζ'."""
        y = np.asarray(y, dtype=float)
        R = self.at(1j * y)
        return y / np.unwrap(np.angle(R)) - 1, -np.log(np.abs(R)) / y

    def load_weights(self, coefficients: int, substeps: int) -> np.ndarray:
        """W_ikj = Σ_l l! p_k^{−l−1} [coefficient of σˡ in τʲ],  τ = (i + σ)/substeps: what pole k makes in substep i of a
        force τʲ that runs over the whole step. Returns (substeps, s/2, coefficients)."""
        shift = np.zeros((substeps, coefficients, coefficients))
        for j in range(coefficients):
            for low in range(j + 1):
                # (i + σ)ʲ / substepsʲ
                shift[:, low, j] = comb(j, low) * np.arange(substeps) ** float(j - low) / float(substeps) ** j
        own = np.array([[factorial(low) / p ** (low + 1) for low in range(coefficients)] for p in self.pole])
        return np.einsum("kl,ilj->ikj", own, shift)


@cache
def pade(degree: int) -> Scheme:
    """The Padé approximations (s, s) and (s − 1, s), mixed as  P = ρP₁ + (1 − ρ)P₂,  Q = ρQ₁ + (1 − ρ)Q₂,  ρ = RADIUS:

    order 2s − 1, |R(iy)| ≤ 1, and |R∞| < 1, so that motions far too fast for the step die out within some tens of steps.
    Source: Song, Eisenträger and Zhang, Computer Methods in Applied Mechanics and Engineering 390 (2022) 114436.
    """
    over = RADIUS * _numerator(degree, degree) + (1 - RADIUS) * np.append(_numerator(degree - 1, degree), 0.0)
    under = RADIUS * _denominator(degree, degree) + (1 - RADIUS) * _denominator(degree - 1, degree)
    P, Q = (np.polynomial.Polynomial(power.astype(np.clongdouble)) for power in (over, under))
    slope = Q.deriv()
    pole = np.polynomial.Polynomial(under).roots().astype(np.clongdouble)
    pole = pole[pole.imag > 0]
    # the residues of degree 6 are some thousands: every digit of the poles counts
    for _ in range(3):
        pole = pole - Q(pole) / slope(pole)
    residue = (P(pole) / slope(pole)).astype(complex)
    found = Scheme(degree, pole.astype(complex), residue, float((P.coef[-1] / Q.coef[-1]).real), 0.0)
    y = np.linspace(0.05, 2.0 * degree, 2000)
    period, damping = found.errors(y)
    bad = np.flatnonzero((np.abs(period) > TOLERANCE) | (np.abs(damping) > TOLERANCE))
    return Scheme(found.degree, found.pole, found.residue, found.infinity, float(y[bad[0] - 1]))


def choose(y: float) -> tuple[Scheme, int]:
    """The scheme and the number of substeps that resolve ωh = y with the fewest solves; among equals, the highest degree."""
    plans = [(pade(degree), max(1, ceil(y / pade(degree).reach))) for degree in DEGREES]
    return min(plans, key=lambda plan: (plan[1] * plan[0].degree, plan[1]))


def _numerator(j: int, k: int) -> np.ndarray:
    """Of the Padé approximation of degrees j over k, lowest power first."""
    terms = [factorial(j) * factorial(j + k - i) / (factorial(i) * factorial(j - i)) for i in range(j + 1)]
    return np.array(terms) / factorial(j + k)


def _denominator(j: int, k: int) -> np.ndarray:
    return _numerator(k, j) * (-1.0) ** np.arange(k + 1)
