"""Is the claimed standard deviation the real one? NEES, NIS, whiteness, and the starts that must agree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

SLACK = 0.1
"""A verdict speaks up only where size or correlation of the innovations is off by more than this: long records put
bands so narrow that every real model lies outside them."""


HOLDS = 0.9973
"""Share of claims that hold inside the band of `claim_of`: what ±3 σ hold of one draw."""


@dataclass(frozen=True)
class Claim:
    """Errors against the σ claimed for them: ratio √(mean (e/σ)²) of so many draws, the band in which it lies where σ holds,
    and whether it does: "as claimed", "overconfident" above the band, "cautious" below it."""

    draws: int
    ratio: float
    band: tuple[float, float]
    verdict: str


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


def chi_square_band(dimension: int, samples: int = 1, level: float = 0.95) -> tuple[float, float]:
    """Two-sided band of the mean of `samples` independent NEES or NIS, each over its dimension d: χ²(d N)/(d N).

    Runs with other seeds are independent samples; so are the instants for NIS, but not for NEES.
    """
    from scipy.stats import chi2  # a third of a second to import, which an up-to-date run need not spend

    freedom = dimension * samples
    low, high = chi2.ppf(np.array([0.5 * (1 - level), 0.5 * (1 + level)]), freedom) / freedom
    return float(low), float(high)


def claim_of(error: np.ndarray, std: np.ndarray, *, alike: float = 1.0) -> Claim | None:
    """Whether one draw or many keep to the σ that was claimed for them: RMS of e/σ inside √(χ²_n/n).

    error, std (...), or scalars, in one unit; what is not finite and what claims no σ are no draws; alike: so many of them are
    one draw, as starts of one seed or samples in time (`samples_alike`). None without a draw.
    Errors that are means over time of their own are smaller than one draw, and σ then cautious.
    """
    error, std = np.atleast_1d(error), np.atleast_1d(std)
    drawn = np.isfinite(error) & np.isfinite(std) & (std > 0)
    if not drawn.any():
        return None
    draws = max(1, int(np.count_nonzero(drawn) / alike))
    ratio = float(np.sqrt(np.mean((error[drawn] / std[drawn]) ** 2)))
    low, high = (float(np.sqrt(edge)) for edge in chi_square_band(1, draws, HOLDS))
    return Claim(
        draws, ratio, (low, high), "cautious" if ratio < low else "overconfident" if ratio > high else "as claimed"
    )


def samples_alike(scaled: np.ndarray) -> float:
    """How many samples of e/σ (T, ...) in time are worth one independent draw of its square: (1 + ρ²)/(1 − ρ²), ρ the
    correlation of neighbours. Source: Bartlett, J. Roy. Stat. Soc. Suppl. 8 (1946)."""
    power, square = np.nansum(scaled[:-1] ** 2), np.nansum(scaled[1:] * scaled[:-1]) ** 2
    return float((power**2 + square) / max(power**2 - square, np.finfo(float).eps * power**2)) if power > 0 else 1.0


def whiteness(whitened: np.ndarray) -> np.ndarray:
    """Lag-one autocorrelation of the whitened innovations, ρ₁ = Σₖ ν̃ₖ₊₁·ν̃ₖ / Σₖ |ν̃ₖ|²: about 0 if the model is true.

    whitened (T, ..., m), missing entries (NaN) left out. Returns (...); compare with `whiteness_band`.
    """
    known = np.nan_to_num(whitened)
    power = np.sum(known**2, axis=(0, -1))
    return np.sum(known[1:] * known[:-1], axis=(0, -1)) / np.where(power > 0, power, np.nan)


def whiteness_band(steps: int, gauges: int, level: float = 0.95) -> float:
    """Largest |ρ₁| to be expected of white innovations: z/√(T m), by Bartlett's formula."""
    return float(ndtri(0.5 * (1 + level)) / np.sqrt(steps * gauges))


def not_identified(estimate: np.ndarray, std: np.ndarray, factor: float = 3.0) -> np.ndarray:
    """Where the starts disagree by more than they may: (max − min over the starts) > factor · (mean σ).

    estimate, std (starts, ...): one quantity from the same measurements and other starting values; a lost start is NaN
    and counts as disagreement. Returns (...) of bool. Different measurements differ by chance: do not mix them.
    """
    spread = np.max(estimate, axis=0) - np.min(estimate, axis=0)
    return ~(spread <= factor * np.mean(std, axis=0))


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
    low, high = (float(np.sqrt(edge)) for edge in chi_square_band(1, samples))
    power = np.nansum(whitened**2)
    neighbours = np.nan_to_num(whitened[1:]) * np.nan_to_num(whitened[:-1])
    correlation, chance = float(neighbours.sum() / power), whiteness_band(samples, 1)
    large, small = ratio > max(high, 1 + SLACK), ratio < min(low, 1 / (1 + SLACK))
    alike, opposed = correlation > max(chance, SLACK), correlation < -max(chance, SLACK)
    if large:
        said = f"the innovations are {ratio:.1f} times larger than the noise you stated"
        advice = "raise Q" if alike else "raise R" if opposed else "raise R or Q"
    elif small:
        said = f"the innovations are {1 / ratio:.1f} times smaller than the noise you stated"
        advice = "lower R" if alike else "lower Q" if opposed else "lower R or Q"
    else:
        said = "the innovations are as large as the noise you stated"
        advice = "raise Q and lower R" if alike else "lower Q and raise R" if opposed else ""
    if alike:
        said += f" and each resembles the one before (correlation {correlation:.2f}): the model lags or lacks something"
    elif opposed:
        said += f" and each undoes the one before (correlation {correlation:.2f}): the filter overreacts"
    elif not advice:
        said += " and independent of one another: nothing speaks against the claimed σ"
    text = f"{said}: {advice}" if advice and not (alike or opposed) else f"{said}; {advice}" if advice else said
    return Verdict(ratio, (low, high), correlation, chance, not advice, text)
