"""The one rule for verdicts: whether errors keep to the σ claimed for them, and whether a layout beats random ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import bdtr, gammaincinv

LEVEL = 0.9973
"""Share of statements about a σ that holds which find it consistent, two-sided: what ±3 σ hold of one normal draw."""
SLACK = 0.1
"""A σ that is off by less than this is consistent whatever the number of draws: many draws make the band of χ² so narrow
that every real model lies outside it."""
CONSISTENT, OVERCONFIDENT, TOO_CAUTIOUS = "consistent", "overconfident", "too cautious"
DIVERGED = "diverged"


@dataclass(frozen=True)
class Claim:
    """Errors against the σ claimed for them: ratio √(mean (e/σ)²) of so many draws, the band in which it lies where σ holds,
    and the verdict: consistent, overconfident above the band, too cautious below it; of: which errors these are, where there
    are several kinds ("test", "smoothed", "repeats")."""

    draws: int
    ratio: float
    band: tuple[float, float]
    verdict: str
    of: str = ""

    @property
    def weight(self) -> tuple[int, float]:
        """How much it decides beside other claims on an unknown: the worst overconfident one most, then the most cautious one."""
        low, high = self.band
        if self.verdict == OVERCONFIDENT:
            return 2, self.ratio / high
        return (1, low / max(self.ratio, 1e-300)) if self.verdict == TOO_CAUTIOUS else (0, 0.0)


def chi_square_band(dimension: int, samples: int = 1, level: float = LEVEL) -> tuple[float, float]:
    """Two-sided band of the mean of `samples` independent NEES or NIS, each over its dimension d: χ²(d N)/(d N).

    Runs with other seeds are independent samples; so are the instants for NIS, but not for NEES.
    """
    freedom = dimension * samples
    # the quantiles of χ²_n; scipy.stats, which has them by name, takes half a second to import
    low, high = 2 * gammaincinv(freedom / 2, np.array([0.5 * (1 - level), 0.5 * (1 + level)])) / freedom
    return float(low), float(high)


def band_of(draws: int) -> tuple[float, float]:
    """Where √(mean (e/σ)²) of n independent draws lies if σ holds: √(χ²_n/n), and at least within SLACK of 1."""
    low, high = (float(np.sqrt(edge)) for edge in chi_square_band(1, draws))
    return min(low, 1 / (1 + SLACK)), max(high, 1 + SLACK)


def judged(ratio: float, draws: int) -> Claim:
    """The verdict on an error of `ratio` times the claimed σ (RMS over so many independent draws, at least one)."""
    draws = max(draws, 1)
    band = band_of(draws)
    return Claim(draws, ratio, band, word_of(ratio, band))


def word_of(value: float, band: tuple[float, float]) -> str:
    """The verdict on a number beside its band; what diverged (NaN) is overconfident."""
    return TOO_CAUTIOUS if value < band[0] else CONSISTENT if value <= band[1] else OVERCONFIDENT


def claim_of(error: np.ndarray, std: np.ndarray, *, alike: float = 1.0) -> Claim | None:
    """Whether one draw or many keep to the σ that was claimed for them: `judged` RMS of e/σ.

    error, std (...), or scalars, in one unit; what is not finite and what claims no σ are no draws; alike: so many of them are
    one draw, as starts of one seed or samples in time (`samples_alike`). None without a draw.
    Errors that are means over time of their own are smaller than one draw, and σ then too cautious.
    """
    error, std = np.atleast_1d(error), np.atleast_1d(std)
    drawn = np.isfinite(error) & np.isfinite(std) & (std > 0)
    if not drawn.any():
        return None
    ratio = float(np.sqrt(np.mean((error[drawn] / std[drawn]) ** 2)))
    return judged(ratio, int(np.count_nonzero(drawn) / alike))


def samples_alike(scaled: np.ndarray) -> float:
    """How many samples of e/σ (T, ...) in time are worth one independent draw of its square: 1 + 2 Σ (1 − k/T) ρ_k², over all
    lags k, ρ_k the correlation at that lag, as far as it stands out of chance (two deviations of white noise).

    A constant error is one draw, white noise as many as it has samples. NaN are left out.
    Source: Bartlett, J. Roy. Stat. Soc. Suppl. 8 (1946).
    """
    known = np.nan_to_num(scaled)
    power, T = np.sum(known**2), len(known)
    if not power > 0:
        return 1.0
    spectrum = np.abs(np.fft.rfft(known, 2 * T, axis=0)) ** 2
    products = np.fft.irfft(spectrum.reshape(len(spectrum), -1).sum(axis=1), 2 * T)[1:T] / power
    late = 1 - np.arange(1, T) / T
    chance = 4 / np.count_nonzero(known)
    return float(1 + 2 * np.sum(np.maximum(products**2 - chance, 0.0) / late))


ALLOWED = (0.5, 2.0)
"""Where the error that a posterior expects of another filter's estimate lies over that filter's σ, if the σ allows for it."""


def expected_ratio(mean: float, std: float, posterior_mean: float, posterior_std: float) -> float:
    """An approximate filter's claim against the exact posterior of the same samples, to be judged by `word_of` and ALLOWED:

        √(E[(p − mean)² | y]) / std = √(posterior_std² + (posterior_mean − mean)²) / std

    the RMS error that the posterior expects of the estimate, over the σ claimed for it: 1 where the two agree. Overconfident
    (above 2) is every claim whose mean is off by more than 2σ of its own, every σ of less than half the posterior's, and what
    is both in part. All four in one unit; NaN of a filter that diverged is overconfident.
    """
    with np.errstate(divide="ignore"):
        return float(np.hypot(posterior_std, posterior_mean - mean) / np.float64(std))


def comparison_verdict(ratio: float) -> str:
    """On an `expected_ratio`: consistent, overconfident, too cautious or diverged."""
    return word_of(ratio, ALLOWED) if np.isfinite(ratio) else DIVERGED


def not_identified(estimate: np.ndarray, std: np.ndarray, factor: float | None = None) -> np.ndarray:
    """Where the starts disagree by more than one draw may be off: (max − min over the starts) > factor · (mean σ).

    estimate, std (starts, ...): one quantity from the same measurements and other starting values; a lost start is NaN
    and counts as disagreement; factor: by default the upper edge of `band_of(1)`. Returns (...) of bool. Different
    measurements differ by chance: do not mix them.
    """
    factor = band_of(1)[1] if factor is None else factor
    spread = np.max(estimate, axis=0) - np.min(estimate, axis=0)
    return ~(spread <= factor * np.mean(std, axis=0))


FEWEST_SETS = 5
"""Random layouts below which not even one that beats all of them shows a benefit at 5 %."""
CHANCE = 0.05
"""Of calling a layout better than half of the random ones that is not."""


@dataclass(frozen=True)
class Benefit:
    """What a layout gains over random ones of its size: as_well of so many `sets` have an error no larger than its own;
    verdict: "none" where these are half of them or more, "shown" where so few are improbable (5 %) if half of all random
    layouts did as well, else "not shown"."""

    as_well: int
    sets: int
    verdict: str


def benefit_of(error: float, random: np.ndarray) -> Benefit | None:
    """The sign test of a layout's real error against those (sets,) of random layouts, on the same measurements' noise.

    as_well of n ~ Binomial(n, p), p the share of all random layouts that do as well; shown where P(as_well or fewer | ½) is at
    most 5 %. One that diverged (NaN) does worse than any that did not. None for fewer than FEWEST_SETS.
    Source: Conover, Practical Nonparametric Statistics (1999), section 3.4.
    """
    if len(random) < FEWEST_SETS:
        return None
    as_well = len(random) if not np.isfinite(error) else int(np.count_nonzero(random <= error))
    shown = bdtr(as_well, len(random), 0.5) <= CHANCE
    return Benefit(as_well, len(random), "shown" if shown else "none" if 2 * as_well >= len(random) else "not shown")
