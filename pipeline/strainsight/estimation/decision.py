"""Decisions about an estimate, each with its numbers and its sentence. Whether σ is calibrated, whether measurements are
consistent with the model, whether σ is withheld, and the exit code."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np
from scipy.special import bdtr, gammaincinv

from strainsight.errors import InconsistentRecordError

LEVEL = 0.9973
"""Probability that a calibrated σ is found consistent, two-sided: that of ±3 σ for one normal draw."""
SLACK = 0.1
"""A σ with a smaller relative error is always consistent. Otherwise many draws would narrow the χ² band until no real model
passes."""
CONSISTENT, OVERCONFIDENT, TOO_CAUTIOUS = "consistent", "overconfident", "too cautious"
LOST, DIVERGED = "not identified", "diverged"
WEAK, SENSORS_DISAGREE = "weakly observable", "inconsistent with the sensors"
OUT_OF_RANGE, WITHHELD = "outside the range of the reduced model", "σ is withheld"
CONFIRMED, NOT_TESTED = "confirmed by held-out sensors", "no inconsistency found"
FAULTS = (DIVERGED, OUT_OF_RANGE, WITHHELD, LOST, SENSORS_DISAGREE, OVERCONFIDENT)
"""Possible deficiencies of the estimate of an unknown, most severe first."""
INCONSISTENT = "the measurements are inconsistent with the model"

T = TypeVar("T")
Shown = Callable[[float, int], str]
"""Formats a number with so many digits, for a terminal or a page."""


@dataclass(frozen=True)
class Claim:
    """Comparison of errors with the claimed σ. of: filtered estimate ("test"), smoothed one or repeats; ratio √(mean (e/σ)²)
    of so many draws; band for a calibrated σ; result: consistent, overconfident above the band, too cautious below it."""

    of: str
    draws: int
    ratio: float
    band: tuple[float, float]
    result: str

    @property
    def overconfident(self) -> bool:
        return self.result == OVERCONFIDENT

    @property
    def severity(self) -> tuple[int, float]:
        """Sort key of the claims on one unknown: the largest decides."""
        low, high = self.band
        if self.overconfident:
            return 2, self.ratio / high
        return (1, low / max(self.ratio, 1e-300)) if self.result == TOO_CAUTIOUS else (0, 0.0)

    def words(self, shown: Shown, *, limit: bool = True) -> str:
        """As "overconfident (error 6.6 times the claimed σ; at most 3.21 for a calibrated σ)"; limit: whether to print it."""
        what = {"test": "error", "smoothed": "smoothed error"}.get(self.of, "RMS error of the repeated filter runs")
        most, limit = self.band[1], limit and self.overconfident
        digits = next((k for k in range(2, 9) if f"{self.ratio:.{k}g}" != f"{most:.{k}g}"), 9) if limit else 2
        bound = f"; at most {shown(most, max(digits, 3))} for a calibrated σ" * limit
        return f"{self.result} ({what} {shown(self.ratio, digits)} times the claimed σ{bound})"


def chi_square_band(dimension: int, samples: int = 1, level: float = LEVEL) -> tuple[float, float]:
    """Two-sided band of the mean of `samples` independent NEES or NIS, each over its dimension d: χ²(d N)/(d N). Runs with
    different seeds are independent samples; instants are for NIS, but not for NEES."""
    freedom = dimension * samples
    # the quantiles of χ²_n; scipy.stats, which has them by name, takes half a second to import
    low, high = 2 * gammaincinv(freedom / 2, np.array([0.5 * (1 - level), 0.5 * (1 + level)])) / freedom
    return float(low), float(high)


def band_of(draws: int) -> tuple[float, float]:
    """Band of √(mean (e/σ)²) of n independent draws with a calibrated σ: √(χ²_n/n), and at least within SLACK of 1."""
    low, high = (float(np.sqrt(edge)) for edge in chi_square_band(1, draws))
    return min(low, 1 / (1 + SLACK)), max(high, 1 + SLACK)


def check_ratio(ratio: float, draws: int, of: str = "test") -> Claim:
    """Compare an error of `ratio` times the claimed σ (RMS of so many independent draws, at least one) with its band."""
    draws = max(draws, 1)
    band = band_of(draws)
    return Claim(of, draws, ratio, band, word_of(ratio, band))


def word_of(value: float, band: tuple[float, float]) -> str:
    """Classify a number by its band; NaN of a diverged filter is overconfident."""
    return TOO_CAUTIOUS if value < band[0] else CONSISTENT if value <= band[1] else OVERCONFIDENT


def claim_of(error: np.ndarray, std: np.ndarray, *, samples_per_draw: float = 1.0, of: str = "test") -> Claim | None:
    """Compare errors with their claimed σ by the RMS of e/σ; None without a draw. error, std (...), or scalars, in one unit;
    values that are not finite or have no σ are ignored; samples_per_draw: number of values per independent draw, such as
    starts of one seed or samples in time (`autocorrelation_time`). Time averages of errors are smaller than one draw, which
    makes σ too cautious."""
    error, std = np.atleast_1d(error), np.atleast_1d(std)
    valid = np.isfinite(error) & np.isfinite(std) & (std > 0)
    if not valid.any():
        return None
    ratio = float(np.sqrt(np.mean((error[valid] / std[valid]) ** 2)))
    return check_ratio(ratio, int(np.count_nonzero(valid) / samples_per_draw), of)


def claim_in_time(error: np.ndarray, std: np.ndarray, *, starts: int = 1, of: str = "test") -> Claim | None:
    """Compare errors (T, ...) in time with their claimed σ, with the number of draws from `autocorrelation_time`; starts: runs
    per draw."""
    scaled = np.divide(error, std, out=np.full_like(error, np.nan), where=std > 0)
    return claim_of(error, std, samples_per_draw=autocorrelation_time(scaled) * starts, of=of)


def claims_of(
    name: str, numbers: Mapping[str, float | str], repeats: tuple[np.ndarray, np.ndarray]
) -> tuple[Claim, ...]:
    """All claims on an unknown of a validation, the decisive one first: the worst overconfident one, else the most cautious.
    numbers: summary of validate; repeats: error and claimed σ (n,), one draw each. For a load the smoothed estimate counts as
    well, and errors are RMS of as many draws as the record contains."""
    tested = {"test": ("error", "std", "draws")}
    if f"zero.{name}" in numbers:
        tested["smoothed"] = ("smoothed", "smoothed_std", "smoothed_draws")
    claims = [claim_of(*repeats, of="repeats")]
    for of, keys in tested.items():
        error, std, draws = (float(numbers[f"{key}.{name}"]) for key in keys)
        claims.insert(-1, claim_of(np.full(int(draws), error), np.full(int(draws), std), of=of))
    return tuple(sorted((one for one in claims if one is not None), key=lambda one: one.severity, reverse=True))


def autocorrelation_time(scaled: np.ndarray) -> float:
    """Number of samples of e/σ (T, ...) per independent draw of its square: 1 + 2 Σ (1 − k/T) ρ_k². The sum is over all lags
    k with a correlation ρ_k that is significant (two deviations of white noise). A constant error is one draw, white noise
    has one draw per sample. NaN are ignored. Source: Bartlett, J. Roy. Stat. Soc. Suppl. 8 (1946)."""
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
"""Permitted range of the expected error of another filter's estimate over its σ."""


def expected_ratio(mean: float, std: float, posterior_mean: float, posterior_std: float) -> float:
    """Compare an approximate filter with the exact posterior of the same samples; to be classified by `word_of` and ALLOWED:

        √(E[(p − mean)² | y]) / std = √(posterior_std² + (posterior_mean − mean)²) / std

    The RMS error that the posterior expects of the estimate, over its claimed σ: 1 if the two agree. Overconfident (above 2)
    is a mean off by more than 2σ, a σ below half of the posterior's, or a combination. All in one unit; NaN of a diverged
    filter is overconfident."""
    with np.errstate(divide="ignore"):
        return float(np.hypot(posterior_std, posterior_mean - mean) / np.float64(std))


def classify_ratio(ratio: float) -> str:
    """Classify an `expected_ratio`: consistent, overconfident, too cautious or diverged."""
    return word_of(ratio, ALLOWED) if np.isfinite(ratio) else DIVERGED


def not_identified(estimate: np.ndarray, std: np.ndarray) -> np.ndarray:
    """Mask (...): whether the starts disagree by more than one draw may be off, (max − min) > upper edge of `band_of(1)` · (mean
    σ).

    estimate, std (starts, ...): one quantity from the same measurements and different starting values; a diverged start is
    NaN and counts as disagreement. Different measurements differ by chance and must not be mixed."""
    spread = np.max(estimate, axis=0) - np.min(estimate, axis=0)
    return ~(spread <= band_of(1)[1] * np.mean(std, axis=0))


FEWEST_SETS = 5
"""With fewer random layouts not even one that beats all of them shows a benefit at 5 %."""
CHANCE = 0.05
"""Probability of a false benefit over half of the random layouts."""


@dataclass(frozen=True)
class Benefit:
    """Benefit of a layout over random ones of its size: as_well of `sets` have no larger error. result: "none" if these are
    at least half, "shown" if so few are improbable (5 %) under no benefit, else "not shown"."""

    as_well: int
    sets: int
    result: str


def benefit_of(error: float, random: np.ndarray) -> Benefit | None:
    """Sign test of a layout's real error against those (sets,) of random layouts, with the same measurement noise. as_well of
    n ~ Binomial(n, p), p the share of all random layouts that do as well; shown if P(as_well or fewer | ½) is at most 5 %. A
    diverged layout (NaN) is worse than all others. None for fewer than FEWEST_SETS. Source: Conover, Practical Nonparametric
    Statistics (1999), section 3.4."""
    if len(random) < FEWEST_SETS:
        return None
    as_well = len(random) if not np.isfinite(error) else int(np.count_nonzero(random <= error))
    shown = bdtr(as_well, len(random), 0.5) <= CHANCE
    return Benefit(as_well, len(random), "shown" if shown else "none" if 2 * as_well >= len(random) else "not shown")


@dataclass(frozen=True)
class Decision:
    """Consequences of the measurements of a real or simulated test: consistency with the model, σ, and exit code.
    inconsistent: reason of an inconsistency, else empty; fault: the one that explains it, with the key that corrects it, else
    empty; accept: whether σ is reported nevertheless; reasons: other reasons to withhold σ; out_of_range: parameter → message
    (`out_of_range`); remedy of that."""

    inconsistent: str = ""
    fault: str = ""
    accept: bool = False
    reasons: tuple[str, ...] = ()
    out_of_range: Mapping[str, str] = field(default_factory=dict)
    remedy: str = ""

    @property
    def trusted(self) -> bool:
        return not self.inconsistent

    @property
    def accepted(self) -> bool:
        return self.accept and not self.trusted

    @property
    def unfounded(self) -> str:
        """Reason to withhold σ of consistent measurements; else empty. No σ contains the model error outside the
        range."""
        range_error = f"{'; '.join(self.out_of_range.values())}: {self.remedy}" if self.out_of_range else ""
        return "; ".join(filter(None, (*self.reasons, range_error)))

    @property
    def withheld(self) -> str:
        """That σ is withheld, and why; empty if it is reported. Inconsistent measurements may push a parameter out of its range,
        which then need not be widened."""
        if self.trusted or self.accepted:
            return f"{WITHHELD}: {self.unfounded}" if self.unfounded else ""
        return f"{WITHHELD}: {'; '.join((self.inconsistent, *self.out_of_range.values()))}"

    @property
    def message(self) -> str:
        """What a reader must know first; empty if nothing is wrong."""
        accepted = f"accepted: {self.inconsistent}" if self.accepted else ""
        return "; ".join(filter(None, (self.withheld, accepted)))

    @property
    def numbers(self) -> dict[str, str | bool]:
        """Entries of a summary."""
        texts = {"fault": self.fault, "withheld": self.withheld}
        return {"trusted": self.trusted, "accepted": self.accepted} | {key: text for key, text in texts.items() if text}

    @property
    def exit_code(self) -> int:
        return exit_code_in(self.numbers)


def exit_code_in(summary: Mapping[str, object]) -> int:
    """Exit code of a command that shows this summary: 3 for inconsistent measurements that are not accepted."""
    return InconsistentRecordError.exit_code * (summary.get("trusted") is False and not summary.get("accepted"))


def out_of_range(
    values: Mapping[str, float], ranges: Mapping[str, tuple[float, float]], units: Mapping[str, str], stage: str
) -> dict[str, str]:
    """Parameter → message, for parameters outside their range; ranges: [SI] of those in which the model is not exact; stage:
    that built the model."""
    return {
        name: f"{name} was estimated as {values[name]:.4g}{'' if units[name] == '1' else f' {units[name]}'}, but the stage "
        f"`{stage}` built the reduced model for values from {low:.4g} to {high:.4g}"
        for name, (low, high) in ranges.items()
        if not low <= values[name] <= high
    }


def without_sigma(result: T) -> T:
    """The result with NaN in all arrays named `std` or `…_std`, also in parts and mappings of a dataclass."""
    if isinstance(result, dict):
        return {name: without_sigma(part) for name, part in result.items()}  # type: ignore[return-value]
    if not is_dataclass(result) or isinstance(result, type):
        return result
    changed = {}
    for part in fields(result):
        value = getattr(result, part.name)
        is_sigma = part.name == "std" or part.name.endswith("_std")
        changed[part.name] = _nothing(value) if is_sigma else without_sigma(value)
    return replace(result, **changed)


def _nothing(std: Any) -> Any:
    if isinstance(std, dict):
        return {name: _nothing(each) for name, each in std.items()}
    return None if std is None else np.full_like(std, np.nan)


def summarise_record(trusted: bool, inconsistent_records: bool) -> str:
    """Result of one record: consistency with the model and with other records."""
    return CONSISTENT if trusted else f"inconsistent with {'other records' if inconsistent_records else 'the model'}"
