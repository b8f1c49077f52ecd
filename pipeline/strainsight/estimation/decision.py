"""Every decision about an estimate: whether σ is calibrated, whether measurements are consistent with the model, whether σ is
withheld, and the exit code; each with the numbers it stands on and its sentence. Whoever shows one prints it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np
from scipy.special import bdtr, gammaincinv

from strainsight.errors import ContradictionError

LEVEL = 0.9973
"""Share of statements about a σ that holds which find it consistent, two-sided: what ±3 σ hold of one normal draw."""
SLACK = 0.1
"""A σ that is off by less than this is consistent whatever the number of draws: many draws make the band of χ² so narrow
that every real model lies outside it."""
CONSISTENT, OVERCONFIDENT, TOO_CAUTIOUS = "consistent", "overconfident", "too cautious"
LOST, DIVERGED = "not identified", "diverged"
WEAK, SENSORS_DISAGREE = "weakly observable", "inconsistent with the sensors"
OUT_OF_RANGE, WITHHELD = "outside the range of the reduced model", "σ is withheld"
CONFIRMED, NOT_TESTED = "confirmed by held-out sensors", "no inconsistency found"
FAULTS = (DIVERGED, OUT_OF_RANGE, WITHHELD, LOST, SENSORS_DISAGREE, OVERCONFIDENT)
"""What may be wrong with the estimate of an unknown, the gravest first."""
NOT_TRUSTED = "σ is not reliable"
INCONSISTENT = "the measurements are inconsistent with the model"

T = TypeVar("T")
Shown = Callable[[float, int], str]
"""How a number is written with so many digits: for a terminal or a page."""


@dataclass(frozen=True)
class Claim:
    """Errors against the σ claimed for them, of the filtered estimate ("test"), the smoothed one or repeats: ratio √(mean (e/σ)²)
    of so many draws, the band in which it lies where σ holds, and the verdict: consistent, overconfident above the band, too
    cautious below it."""

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
        """Orders claims on one unknown: that of the largest decides."""
        low, high = self.band
        if self.overconfident:
            return 2, self.ratio / high
        return (1, low / max(self.ratio, 1e-300)) if self.result == TOO_CAUTIOUS else (0, 0.0)

    def words(self, shown: Shown, *, limit: bool = True) -> str:
        """As "overconfident (error 6.6 times the claimed σ, at most 3.21 where it holds)"; limit: whether the most is named."""
        what = {"test": "error", "smoothed": "smoothed error"}.get(self.of, "RMS error of the repeats")
        most, limit = self.band[1], limit and self.overconfident
        digits = next((k for k in range(2, 9) if f"{self.ratio:.{k}g}" != f"{most:.{k}g}"), 9) if limit else 2
        bound = f"; at most {shown(most, max(digits, 3))} if calibrated" * limit
        return f"{self.result} ({what} {shown(self.ratio, digits)} times the claimed σ{bound})"


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


def check_ratio(ratio: float, draws: int, of: str = "test") -> Claim:
    """The verdict on an error of `ratio` times the claimed σ (RMS over so many independent draws, at least one)."""
    draws = max(draws, 1)
    band = band_of(draws)
    return Claim(of, draws, ratio, band, word_of(ratio, band))


def word_of(value: float, band: tuple[float, float]) -> str:
    """The verdict on a number beside its band; what diverged (NaN) is overconfident."""
    return TOO_CAUTIOUS if value < band[0] else CONSISTENT if value <= band[1] else OVERCONFIDENT


def claim_of(error: np.ndarray, std: np.ndarray, *, samples_per_draw: float = 1.0, of: str = "test") -> Claim | None:
    """Whether one draw or many keep to the σ that was claimed for them: `check_ratio` RMS of e/σ.

    error, std (...), or scalars, in one unit; what is not finite and what claims no σ are no draws; samples_per_draw: so many
    of them are one draw, as starts of one seed or samples in time (`autocorrelation_time`). None without a draw.
    Errors that are means over time of their own are smaller than one draw, and σ then too cautious.
    """
    error, std = np.atleast_1d(error), np.atleast_1d(std)
    valid = np.isfinite(error) & np.isfinite(std) & (std > 0)
    if not valid.any():
        return None
    ratio = float(np.sqrt(np.mean((error[valid] / std[valid]) ** 2)))
    return check_ratio(ratio, int(np.count_nonzero(valid) / samples_per_draw), of)


def claim_in_time(error: np.ndarray, std: np.ndarray, *, starts: int = 1, of: str = "test") -> Claim | None:
    """Whether errors (T, ...) in time keep to the σ claimed for them: as many draws as they are worth (`autocorrelation_time`).

    starts: so many runs of one seed are one draw.
    """
    scaled = np.divide(error, std, out=np.full_like(error, np.nan), where=std > 0)
    return claim_of(error, std, samples_per_draw=autocorrelation_time(scaled) * starts, of=of)


def claims_of(
    name: str, numbers: Mapping[str, float | str], repeats: tuple[np.ndarray, np.ndarray]
) -> tuple[Claim, ...]:
    """All claims on an unknown of a validation, first the one that decides: the worst overconfident one, else the most cautious.

    numbers: the summary of validate; repeats: error and claimed σ (n,) of them, one draw each. Of a load the smoothed estimate
    counts, too, and errors are RMS of as many draws as the record in time is worth.
    """
    tested = {"test": ("error", "std", "draws")}
    if f"zero.{name}" in numbers:
        tested["smoothed"] = ("smoothed", "smoothed_std", "smoothed_draws")
    claims = [claim_of(*repeats, of="repeats")]
    for of, keys in tested.items():
        error, std, draws = (float(numbers[f"{key}.{name}"]) for key in keys)
        claims.insert(-1, claim_of(np.full(int(draws), error), np.full(int(draws), std), of=of))
    return tuple(sorted((one for one in claims if one is not None), key=lambda one: one.severity, reverse=True))


def autocorrelation_time(scaled: np.ndarray) -> float:
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
    """An approximate filter's claim against the exact posterior of the same samples, to be check_ratio by `word_of` and ALLOWED:

        √(E[(p − mean)² | y]) / std = √(posterior_std² + (posterior_mean − mean)²) / std

    the RMS error that the posterior expects of the estimate, over the σ claimed for it: 1 where the two agree. Overconfident
    (above 2) is every claim whose mean is off by more than 2σ of its own, every σ of less than half the posterior's, and what
    is both in part. All four in one unit; NaN of a filter that diverged is overconfident.
    """
    with np.errstate(divide="ignore"):
        return float(np.hypot(posterior_std, posterior_mean - mean) / np.float64(std))


def classify_ratio(ratio: float) -> str:
    """On an `expected_ratio`: consistent, overconfident, too cautious or diverged."""
    return word_of(ratio, ALLOWED) if np.isfinite(ratio) else DIVERGED


def not_identified(estimate: np.ndarray, std: np.ndarray) -> np.ndarray:
    """Where the starts disagree by more than one draw may be off: (max − min over the starts) > the upper edge of
    `band_of(1)` · (mean σ).

    estimate, std (starts, ...): one quantity from the same measurements and other starting values; a lost start is NaN
    and counts as disagreement. Returns (...) of bool. Different measurements differ by chance: do not mix them.
    """
    spread = np.max(estimate, axis=0) - np.min(estimate, axis=0)
    return ~(spread <= band_of(1)[1] * np.mean(std, axis=0))


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
    result: str


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


@dataclass(frozen=True)
class Decision:
    """What the measurements of a test, or a simulated one, allow: whether they are consistent with the model, whether σ is given,
    and the exit code.

    inconsistent: why they are not, empty where they are; fault: the one that explains it, with the key that undoes it, empty
    where none or several do; accept: whether σ is given all the same; reasons: why else there is none; beyond: parameter → that
    it left the range of the reduced model (`out_of_range`); remedy of that.
    """

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
        """Why there is no σ even of consistent measurements; empty where there is one. What the model is off by beyond its range
        is in no σ."""
        range_error = f"{'; '.join(self.out_of_range.values())}: {self.remedy}" if self.out_of_range else ""
        return "; ".join(filter(None, (*self.reasons, range_error)))

    @property
    def withheld(self) -> str:
        """That there is no σ, and why; empty where there is one. Where measurements are inconsistent they are to blame for a
        parameter beyond its range, and nothing is to be widened."""
        if self.trusted or self.accepted:
            return f"{WITHHELD}: {self.unfounded}" if self.unfounded else ""
        return f"{NOT_TRUSTED}: {'; '.join((self.inconsistent, *self.out_of_range.values()))}"

    @property
    def message(self) -> str:
        """What a reader has to know before any number; empty where nothing is wrong."""
        accepted = f"accepted: {self.inconsistent}" if self.accepted else ""
        return "; ".join(filter(None, (self.withheld, accepted)))

    @property
    def cell(self) -> str:
        """What stands in place of σ in a table."""
        return "withheld" if self.trusted else "not reliable"

    @property
    def numbers(self) -> dict[str, str | bool]:
        """By the names of a summary."""
        texts = {"fault": self.fault, "withheld": self.withheld}
        return {"trusted": self.trusted, "accepted": self.accepted} | {key: text for key, text in texts.items() if text}

    @property
    def exit_code(self) -> int:
        return exit_code_in(self.numbers)


def exit_code_in(summary: Mapping[str, object]) -> int:
    """Of a command that shows a stage with these numbers: 3 where measurements are inconsistent with the model and that is not
    accepted."""
    return ContradictionError.exit_code * (summary.get("trusted") is False and not summary.get("accepted"))


def out_of_range(
    values: Mapping[str, float], ranges: Mapping[str, tuple[float, float]], units: Mapping[str, str], stage: str
) -> dict[str, str]:
    """Parameter → that its value lies beyond its range, for those that do; ranges: of those that the model is not exact in [SI];
    stage: which has made the model."""
    return {
        name: f"{name} was estimated as {values[name]:.4g}{'' if units[name] == '1' else f' {units[name]}'}, but {stage} built "
        f"the model for {low:.4g} to {high:.4g}"
        for name, (low, high) in ranges.items()
        if not low <= values[name] <= high
    }


def without_sigma(result: T) -> T:
    """With NaN for every array that is a σ by its name, `std` or `…_std`, in parts and mappings of a dataclass, too."""
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


def summarise_record(trusted: bool, inconsistent_records: bool, noise_fits: bool) -> str:
    """On one record: whether it is consistent with the model and, if so, with other records (apart: it is not) and its noise."""
    if not trusted:
        return f"inconsistent with {'other records' if inconsistent_records else 'the model'}"
    return "fits" if noise_fits else "innovations disagree with the noise"
