"""Is the claimed standard deviation the real one? NEES, NIS and whiteness, and what innovations say of the stated noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from strainsight.estimation.decision import LEVEL, OVERCONFIDENT, SLACK, TOO_CAUTIOUS, judged

PROCESS, NOISE = "process_noise", "noise_std"
"""Q and R by the keys of a config."""
CHECK = f"check channels, known loads and the model, and compare {NOISE} with the scatter of readings at rest"
"""What may be wrong where innovations are too large: more noise would hide it."""


@dataclass(frozen=True)
class Verdict:
    """Innovations against the claim: ratio of their size to the claimed one, with the band of a true model; correlation
    of neighbours, with the largest that chance explains; and what both mean."""

    ratio: float
    band: tuple[float, float]
    correlation: float
    chance: float
    consistent: bool
    text: str


def nees(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Normalised estimation error squared over its dimension, ε = eᵀP⁻¹e / d: 1 on average if P is consistent.

    error e (..., d), estimate less truth; covariance P (..., d, d) of a block without exact zeros, such as
    `FilterRun.unknown_covariance`, scaled to diag P = 1 before it is solved. Returns (...).
    Source: Bar-Shalom, Li and Kirubarajan, Estimation (2001), section 5.4.
    """
    std = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    correlation = covariance / (std[..., :, None] * std[..., None, :])
    scaled = error / std
    return np.sum(scaled * np.linalg.solve(correlation, scaled[..., None])[..., 0], axis=-1) / error.shape[-1]


def nis(whitened: np.ndarray) -> np.ndarray:
    """Normalised innovation squared over the number of gauges that measured, νᵀS⁻¹ν / m, NaN where none did.

    whitened (..., m) from `FilterRun.whitened`. Returns (...).
    """
    count = np.sum(np.isfinite(whitened), axis=-1)
    return np.where(count > 0, np.nansum(whitened**2, axis=-1) / np.maximum(count, 1), np.nan)


def whiteness(whitened: np.ndarray) -> np.ndarray:
    """Lag-one autocorrelation of the whitened innovations, ρ₁ = Σₖ ν̃ₖ₊₁·ν̃ₖ / Σₖ |ν̃ₖ|²: about 0 if the model is true.

    whitened (T, ..., m), missing entries (NaN) left out. Returns (...); compare with `whiteness_band`.
    """
    known = np.nan_to_num(whitened)
    power = np.sum(known**2, axis=(0, -1))
    return np.sum(known[1:] * known[:-1], axis=(0, -1)) / np.where(power > 0, power, np.nan)


def whiteness_band(steps: int, gauges: int, level: float = LEVEL) -> float:
    """Largest |ρ₁| to be expected of white innovations: z/√(T m), by Bartlett's formula."""
    return float(ndtri(0.5 * (1 + level)) / np.sqrt(steps * gauges))


def verdict(whitened: np.ndarray) -> Verdict:
    """What NIS and whiteness of one run or many say about the stated noise, in words.

    whitened (T, m) or (T, B, m) from `FilterRun.whitened`, NaN where nothing was measured or the run diverged. Ratio
    √(mean NIS). Too small a Q makes the gain too small and leaves neighbours alike; too small an R makes it too large, and
    neighbours differ in sign. Source: Mehra, IEEE Trans. Automatic Control 15 (1970).
    """
    samples = int(np.isfinite(whitened).sum())
    if not samples:
        return Verdict(
            np.nan, (np.nan, np.nan), np.nan, np.nan, False, "nothing was measured: there is nothing to judge"
        )
    ratio = float(np.sqrt(np.nansum(whitened**2) / samples))
    size = judged(ratio, samples)
    power = np.nansum(whitened**2)
    neighbours = np.nan_to_num(whitened[1:]) * np.nan_to_num(whitened[:-1])
    if not power:
        text = "all innovations are zero, as of channels that are not connected: check the readings of the record"
        return Verdict(0.0, size.band, 0.0, whiteness_band(samples, 1), False, text)
    correlation, chance = float(neighbours.sum() / power), whiteness_band(samples, 1)
    large, small = size.verdict == OVERCONFIDENT, size.verdict == TOO_CAUTIOUS
    alike, opposed = correlation > max(chance, SLACK), correlation < -max(chance, SLACK)
    if large:
        said = f"the innovations are {ratio:.1f} times larger than the noise you stated"
        advice = CHECK
    elif small:
        said = f"the innovations are {1 / ratio:.1f} times smaller than the noise you stated"
        advice = f"lower {NOISE if alike else PROCESS if opposed else f'{NOISE} or {PROCESS}'}"
    else:
        said = "the innovations are as large as the noise you stated"
        advice = CHECK if alike or opposed else ""
    if alike:
        said += f" and each resembles the one before (correlation {correlation:.2f}): the model lags or lacks something"
    elif opposed:
        said += f" and each undoes the one before (correlation {correlation:.2f}): the filter overreacts"
    elif not advice:
        said += " and independent of one another: nothing speaks against the claimed σ"
    text = f"{said}: {advice}" if advice and not (alike or opposed) else f"{said}; {advice}" if advice else said
    return Verdict(ratio, size.band, correlation, chance, not advice, text)
