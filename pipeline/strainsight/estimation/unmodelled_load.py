"""Subspace test for a load that the model does not have: one pattern of channels exceeds what innovations claim."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.estimation.consistency import whiteness_band
from strainsight.estimation.decision import SLACK

SHARE = 0.8
"""Share of the excess over the claim that lies in the one pattern, at least."""
SLOW = 0.3
"""Correlation of neighbouring samples along the pattern, at least: loads of any interest last longer than a sample."""
LARGEST = 3.0
"""Norm of a whitened sample beyond √m, to which larger ones are cut."""


@dataclass(frozen=True)
class ResidualPattern:
    """A pattern of channels in which innovations exceed their claimed covariance.

    size         their RMS along it over the claim
    correlation  of neighbouring samples along it
    share        (m,) of each channel in the pattern, by its square in units of the reading's noise
    gain         of ln p by a first-order autoregression along the pattern in place of white noise of unit variance
    """

    size: float
    correlation: float
    share: np.ndarray
    gain: float


def residual_pattern(
    whitened: np.ndarray, innovation: np.ndarray, noise: np.ndarray, least: float
) -> ResidualPattern | None:
    """The eigenvector of the innovations' covariance that alone is too large, None where none is.

        C = (1/T) Σ ν̃ₖν̃ₖᵀ = I + λ v vᵀ

    The eigenvalues of C lie below (1 + √(m/T))² for a right model (Marchenko and Pastur 1967). One more load, whose effect on
    the channels no unknown can follow, adds one dyad, and its samples resemble the ones before.

    whitened (T, m) [1] and innovation (T, m) [unit], NaN where missing; noise (m,) [unit] of a sample; least: size from which
    a pattern counts.
    Loads of the model that change faster than their process noise says leave a pattern, too: compare `gain` with theirs.
    """
    complete = np.isfinite(whitened).all(axis=1) & np.isfinite(innovation).all(axis=1)
    samples, m = whitened[complete].shape
    if samples <= m or m < 2:
        return None
    # a load that begins at once makes a few large innovations, and no pattern that lasts
    norm = np.maximum(np.linalg.norm(whitened[complete], axis=1, keepdims=True), np.finfo(float).tiny)
    white = whitened[complete] * np.minimum(1.0, (np.sqrt(m) + LARGEST) / norm)
    values, vectors = np.linalg.eigh(white.T @ white / samples)
    chance = ((1 + np.sqrt(m / samples)) * (1 + SLACK)) ** 2
    excess = np.maximum(values - 1, 0.0)
    along = white @ vectors[:, -1]
    correlation = float(along[1:] @ along[:-1] / (along @ along))
    alone = values[-2] <= chance or excess[-1] >= SHARE * excess.sum()
    if values[-1] < max(least**2, chance) or not alone or correlation < max(SLOW, whiteness_band(samples, 1)):
        return None
    # ν = L ν̃, with the factor L that all samples have on average
    factor = np.linalg.lstsq(whitened[complete], innovation[complete], rcond=None)[0].T
    share = (factor @ vectors[:, -1] / noise) ** 2
    gain = 0.5 * samples * (values[-1] - 1 - np.log(values[-1] * (1 - correlation**2)))
    return ResidualPattern(float(np.sqrt(values[-1])), correlation, share / share.sum(), float(gain))
