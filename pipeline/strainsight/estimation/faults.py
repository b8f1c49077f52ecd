"""Faults of a channel, a known load, or two swapped ones, and their corrections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from strainsight.estimation.decision import SLACK
from strainsight.measurements.clock import shifted

ModelKind = Literal["frequency", "mass", "damping", "direction", "warming", "gain", "hum"]
Kind = (
    Literal[
        "sign", "scale", "swapped", "offset", "drift", "late", "angle", "dead", "clipped", "spikes", "stuck", "shift"
    ]
    | ModelKind
)

BELIEVABLE = 1.5
"""RMS of the innovations over the claim up to which a record is consistent with its model."""
RELIEF = 0.99
"""Share of the excess of squared innovations whose explanation makes a fault plausible in a record with other model errors."""
MARGIN, APART = 20.0, 10.0
"""Margins in ln evidence: of a fault over no fault, odds of 5·10⁸, and of the named fault over all others, odds of 2·10⁴. Both
are far larger than the number of tried faults."""
SCALES = (0.5, 2.0, 1e-3, 1e3, 1e-6, 1e6)
"""Factors on a channel: half a bridge, two arms for one, units of a thousand and of a million."""
FEWEST_FACTOR, SAME_FACTOR = 0.1, 0.03
"""Smallest logarithm of a fitted factor on a channel, and difference from one of SCALES that is not resolved."""
FITTED = 5.0
"""Penalty in ln evidence of a fitted factor: its prior density over its accuracy."""
LOAD_SCALES = (*SCALES, *(f**sense for f in (4.4482216, 9.80665, 4448.2216, 9806.65) for sense in (1, -1)))
"""Factors on a known load: also pounds, kilograms, thousands of both."""
TURN = 15.0
"""Step in degrees of the tried rotations of a gauge; the tolerance of a gauge covers the values between."""
ANGLES = (*(sense * TURN * k for k in range(1, 6) for sense in (1, -1)), 90.0)
"""Tried rotations in degrees of a gauge, or of the grid of a rosette; a half turn reads the same."""
MOST_LATE = 20
"""Largest delay of a channel in samples."""
FORESEEN = -0.5 * (1 + np.log(2 * np.pi))
"""Mean log-density of a unit normal number: the contribution of an omitted sample."""
RUN, CLIPPED = 3, 0.005
"""A channel may be clipped if RUN equal samples in a row are its maximum or minimum, and such rows exceed this share of the
record."""


PRICE = 25.0
"""Penalty in ln evidence of a temporary fault, whose two ends and size are fitted."""
STEP, DROP = 5.0, 20.0
"""Subtracted from ½z² at each sample, z the residual over its σ; and the decrease of the sum that ends a misfitting part."""

NORMAL_MEDIAN = 0.6745
"""Median of the absolute value of a normal number."""
GRID = 200
"""Instants at which a shift is first searched."""
MOST_PARTS, LONGEST_PART = 20, 0.2
"""Most outlier parts of a channel, and their largest share of the record."""


@dataclass(frozen=True)
class Fault:
    """A fault of a channel, a known load or the model. channel: number of the channel, of the load, or of the mode (frequency).
    amount: factor (scale, frequency, damping), number of the other channel or load (swapped), delay in samples (late), degrees
    (angle), shift of the zero (shift) [unit], mass [kg], frequency [Hz] (hum), else 0; of_load: whether `channel` is the number
    of a known load; spans: channel, first sample and end of temporary faults (spikes, stuck, shift)."""

    kind: Kind
    channel: int
    amount: float = 0.0
    of_load: bool = False
    spans: tuple[tuple[int, int, int], ...] = ()

    def of_channel(self, channel: int) -> Fault:
        """The same fault of another channel."""
        return replace(self, channel=channel, spans=tuple((channel, first, behind) for _, first, behind in self.spans))

    def later(self, samples: int) -> Fault:
        """The fault relative to a start so many samples earlier."""
        return replace(self, spans=tuple((j, first + samples, behind + samples) for j, first, behind in self.spans))

    @property
    def factor(self) -> float:
        """Factor that corrects a sign or a scale."""
        return -1.0 if self.kind == "sign" else 1 / self.amount

    @property
    def neighbours(self) -> tuple[Fault, ...]:
        """Delays one sample shorter and longer; none for other faults."""
        amounts = (self.amount - 1, self.amount + 1) if self.kind == "late" else ()
        return tuple(replace(self, amount=amount) for amount in amounts if amount)

    @property
    def family(self) -> tuple[str, int, float, bool]:
        """Key of faults that need the same correction: delays of one channel, rotations of one."""
        sized = self.of_model or self.kind in ("late", "angle", "shift") or self.fitted
        amount = 0.0 if sized else abs(self.amount)
        return self.kind, self.channel, amount, self.of_load

    @property
    def fitted(self) -> bool:
        """Whether this is a factor that was fitted to the record."""
        return self.kind == "scale" and all(abs(self.amount / s - 1) > 1e-9 for s in LOAD_SCALES)

    @property
    def of_model(self) -> bool:
        """Whether this is an error of the model, not of a channel or a known load."""
        return self.kind in get_args(ModelKind)

    @property
    def wrong(self) -> tuple[int, ...]:
        """All channels, or all loads, that are wrong."""
        if self.spans:
            return tuple(sorted({channel for channel, _, _ in self.spans}))
        return (self.channel, int(self.amount)) if self.kind == "swapped" else (self.channel,)

    @property
    def channels(self) -> tuple[int, ...]:
        """All channels that are wrong."""
        return () if self.of_load or self.of_model else self.wrong


def undo_fault(fault: Fault, samples: np.ndarray) -> tuple[np.ndarray, float]:
    """The record (T, m) without a fault, y' = T y, and ln |det T| of the remaining samples. Omitted samples, at the end of a
    delayed channel or of a dead or clipped one, are NaN. Offset, drift and angle change the model instead."""
    corrected, j = samples.copy(), fault.channel
    if fault.kind in ("sign", "scale"):
        corrected[:, j] *= fault.factor
        change = float(np.isfinite(samples[:, j]).sum()) * float(np.log(abs(fault.factor)))
        return corrected, change - FITTED * fault.fitted
    if fault.kind == "swapped":
        corrected[:, fault.channels] = samples[:, fault.channels[::-1]]
    elif fault.kind == "late":
        corrected[:, j] = shifted(samples[:, j], int(fault.amount))
    elif fault.kind == "dead":
        corrected[:, j] = np.nan
    elif fault.kind == "clipped":
        corrected[at_limit(samples[:, j]), j] = np.nan
    for channel, first, behind in fault.spans:
        span = slice(first, behind), channel
        corrected[span] = samples[span] - fault.amount if fault.kind == "shift" else np.nan
    return corrected, -PRICE * len(fault.spans)


def outlier_density(fault: Fault, samples: np.ndarray, noise: np.ndarray) -> float:
    """ln of the density of outlier samples (T, m), relative to that of noise σ (m,): they are as wide as they are large."""
    change = 0.0
    for channel, first, behind in fault.spans if fault.kind == "spikes" else ():
        part = samples[first:behind, channel]
        part = part[np.isfinite(part)]
        wide = float(np.sqrt(np.mean(part**2))) / noise[channel] if len(part) else 1.0
        change -= len(part) * float(np.log(max(1.0, wide)))
    return change


def find_misfits(z: np.ndarray) -> list[tuple[int, int]]:
    """Parts (first sample, end) in which the normalised residuals z (T,) are too large. There the sum of ½z² − STEP grows by
    at least DROP, up to its maximum. NaN are ignored."""
    score = np.where(np.isfinite(z), 0.5 * np.nan_to_num(z) ** 2 - STEP, 0.0)
    parts: list[tuple[int, int]] = []
    total, most, first, best = 0.0, 0.0, 0, 0
    for k, value in enumerate([*score.tolist(), -np.inf]):
        total += value
        if total > most:
            most, best = total, k
        elif total <= 0 or total < most - DROP:
            if most >= DROP:
                parts.append((first, best + 1))
            total, most, first = 0.0, 0.0, k + 1
    return parts


def find_temporary_faults(samples: np.ndarray, predicted: np.ndarray, std: np.ndarray, noise: float) -> list[Fault]:
    """Faults of samples (T,) that temporarily deviate from ŷ ± σ (T,): a shifted zero, a stuck channel, outliers."""
    wide, T = np.hypot(std, noise), len(samples)
    residual = samples - predicted
    z = residual / wide
    parts, faults = find_misfits(z), []
    first, behind, size = _find_shift(residual, wide)
    if behind - first > RUN and (first >= RUN or T - behind >= RUN):
        faults.append(Fault("shift", 0, size, spans=((0, first, behind),)))
    still = _longest_constant(samples)
    if still is not None and any(still[0] < behind and first < still[1] for first, behind in parts):
        faults.append(Fault("stuck", 0, 0.0, spans=((0, *still),)))
    # spikes stand out from what tolerances leave of the other samples
    other = np.ones(T, dtype=bool)
    for begin, end in parts if _are_few(parts, T) else ():
        other[begin:end] = False
    usual = float(np.nanmedian(np.abs(z[other]))) / NORMAL_MEDIAN if np.isfinite(z[other]).any() else 1.0
    parts = find_misfits(z / max(1.0, usual))
    if parts and _are_few(parts, T):
        faults.append(Fault("spikes", 0, 0.0, spans=tuple((0, *part) for part in parts)))
    return faults


def _are_few(parts: Sequence[tuple[int, int]], samples: int) -> bool:
    return len(parts) <= MOST_PARTS and sum(behind - first for first, behind in parts) <= LONGEST_PART * samples


def _find_shift(residual: np.ndarray, std: np.ndarray) -> tuple[int, int, float]:
    """First sample, end and size of the constant that explains most of the residuals (T,) with σ (T,). Its gain in ln p is (Σ
    r/σ²)²/(2 Σ 1/σ²) over the part; its ends are searched on a grid, then around it."""
    measured = np.isfinite(residual)
    weight = np.where(measured, 1 / std**2, 0.0)
    moment = weight * np.where(measured, residual, 0.0)
    sums, weights = (np.concatenate([[0.0], np.cumsum(values)]) for values in (moment, weight))

    def best(begins: np.ndarray, ends: np.ndarray) -> tuple[int, int]:
        total, over = (values[ends] - values[begins][:, None] for values in (sums, weights))
        gain = np.where((ends > begins[:, None]) & (over > 0), total**2 / np.where(over > 0, over, 1.0), 0.0)
        i, k = np.unravel_index(int(np.argmax(gain)), gain.shape)
        return int(begins[i]), int(ends[k])

    T = len(residual)
    step = max(1, T // GRID)
    grid = np.append(np.arange(0, T, step), T)
    near = (np.arange(max(0, at - step), min(T, at + step) + 1) for at in best(grid, grid))
    first, behind = best(*near)
    return first, behind, float((sums[behind] - sums[first]) / max(weights[behind] - weights[first], 1e-300))


def _longest_constant(values: np.ndarray) -> tuple[int, int] | None:
    """The longest run of more than RUN equal samples (T,); None if all are equal."""
    edges = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0, [True]]))
    longest = int(np.argmax(np.diff(edges)))
    first, behind = int(edges[longest]), int(edges[longest + 1])
    return (first, behind) if RUN < behind - first < len(values) else None


def at_limit(values: np.ndarray) -> np.ndarray:
    """Mask (T,) of samples at the extremes in runs of at least RUN equal ones; empty if fewer than CLIPPED of the record, or for
    a constant channel."""
    none = np.zeros(len(values), dtype=bool)
    known = values[np.isfinite(values)]
    if not len(known) or known.min() == known.max():
        return none
    limited = none.copy()
    for limit in (known.min(), known.max()):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], values == limit, [False]]).astype(int)))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            limited[begin:end] = end - begin >= RUN
    return limited if limited.sum() >= CLIPPED * len(known) else none


@dataclass(frozen=True)
class ChannelCheck:
    """Channels against their prediction: RMS (m,) of both, RMS (m,) of the residual over its σ, correlation (m,); by_others:
    each is predicted from all other channels, else one step ahead from all channels."""

    measured: np.ndarray
    predicted: np.ndarray
    residual: np.ndarray
    correlation: np.ndarray
    by_others: bool


def check_channels(
    measured: np.ndarray, predicted: np.ndarray, std: np.ndarray, by_others: bool = True
) -> ChannelCheck:
    """Compare channels with their prediction; measured, predicted, std (T, m) of the residual [unit of the channel], NaN if
    missing; by_others: see `ChannelCheck`.

    NaN for a channel without samples, and for the correlation of a constant one."""
    both = np.isfinite(measured) & np.isfinite(predicted)
    count = np.where(both.any(axis=0), both.sum(axis=0), np.nan)
    y, p = (np.where(both, values, 0.0) for values in (measured, predicted))

    def mean(values: np.ndarray) -> np.ndarray:
        return np.asarray(values.sum(axis=0) / count)

    z = (y - p) / np.where(both, std, 1.0)
    moving_y, moving_p = (np.where(both, values - mean(values), 0.0) for values in (y, p))
    with np.errstate(invalid="ignore", divide="ignore"):
        together = mean(moving_y * moving_p) / np.sqrt(mean(moving_y**2) * mean(moving_p**2))
    return ChannelCheck(np.sqrt(mean(y**2)), np.sqrt(mean(p**2)), np.sqrt(mean(z**2)), together, by_others)


def approximate_density(
    fault: Fault, samples: np.ndarray, predicted: np.ndarray, std: np.ndarray, noise: float, begin: int = 0
) -> float:
    """Approximate ln density of a channel's samples y (T,) under a fault, given the prediction ŷ ± σ (T,) by all others.
    Offsets and drifts are fitted. noise: σ of a sample, the unit; begin: samples of the record before these. For a rotated
    gauge ŷ is that of the rotated row. Correlations between samples are ignored: the value serves to select faults for
    evaluation."""
    y, change = undo_fault(fault, samples[:, None])
    change += outlier_density(fault, samples[:, None], np.array([noise]))
    if fault.kind == "dead":
        return dead_density(samples, noise)
    both = np.isfinite(y[:, 0]) & np.isfinite(predicted)
    missing = int(np.isfinite(samples).sum() - both.sum())
    residual, wide = (y[:, 0] - predicted)[both], np.hypot(std, noise)[both]
    if fault.kind in ("offset", "drift"):
        shape = np.ones(len(samples)) if fault.kind == "offset" else begin + np.arange(1.0, len(samples) + 1)
        shape = shape[both] / wide
        residual = residual - shape * wide * (shape @ (residual / wide)) / max(float(shape @ shape), 1e-300)
    fit = -0.5 * np.sum((residual / wide) ** 2 + np.log(2 * np.pi * (wide / noise) ** 2))
    return float(fit + change + missing * FORESEEN)


def dead_density(samples: np.ndarray, noise: float) -> float:
    """ln density of samples (T,) as a fitted constant and white noise, in units of the noise, of which at least a tenth is
    assumed."""
    known = samples[np.isfinite(samples)]
    spread = max(float(np.std(known)) if len(known) else 0.0, 0.1 * noise)
    rest = float(np.sum((known - known.mean()) ** 2)) / spread**2 if len(known) else 0.0
    return -0.5 * rest - len(known) * float(np.log(np.sqrt(2 * np.pi) * spread / noise))


def find_delay(samples: np.ndarray, predicted: np.ndarray, std: np.ndarray, noise: float) -> Fault | None:
    """The delay of at most MOST_LATE samples that fits a channel (T,) best, given the prediction by the others; None for a short
    record.

    For a sine, half a period late is equivalent to a change of sign."""
    most = min(MOST_LATE, len(samples) // 4)
    tried = [Fault("late", 0, n) for n in range(-most, most + 1) if n]
    return max(tried, key=lambda one: approximate_density(one, samples, predicted, std, noise), default=None)


def find_factor(samples: np.ndarray, predicted: np.ndarray, std: np.ndarray, noise: float) -> Fault | None:
    """The factor a > 0 of a channel (T,) that is most likely by the prediction ŷ ± σ; None if it is nearly 1 or one of SCALES.

    b = 1/a maximises −½ Σ ((b y − ŷ)/σ)² + n ln b"""
    both = np.isfinite(samples) & np.isfinite(predicted)
    y, p = (values[both] / np.hypot(std, noise)[both] for values in (samples, predicted))
    power, product = float(y @ y), float(y @ p)
    if not power > 0:
        return None
    factor = 2 * power / (product + np.hypot(product, 2 * np.sqrt(len(y) * power)))
    return as_factor(0, float(factor))


def as_factor(channel: int, amount: float) -> Fault | None:
    """The fault of a fitted factor, rounded; None if it is nearly 1 or one of SCALES."""
    near = abs(np.log(amount)) < FEWEST_FACTOR or any(abs(np.log(amount / s)) < SAME_FACTOR for s in SCALES)
    return None if near else Fault("scale", channel, float(f"{amount:.4g}"))


@dataclass(frozen=True)
class Explained:
    """Result for one fault: evidence, ln density of all samples in units of their noise; ratio of innovations to their claim,
    RMS.

    amount: of the fault, or the estimated offset or drift at the end of the record [unit], with σ; point: the most likely
    parameters."""

    fault: Fault | None
    evidence: float
    ratio: float
    amount: float = 0.0
    std: float = 0.0
    point: tuple[float, ...] = ()

    @property
    def of_channel(self) -> bool:
        return self.fault is not None and bool(self.fault.channels)

    @property
    def turned(self) -> bool:
        return self.fault is not None and self.fault.kind == "angle"


def relieves(ratio: float, before: float) -> bool:
    """Whether innovations that are `before` times the claim without a fault lose RELIEF of their excess ratio² − 1."""
    return bool(ratio**2 - 1 <= (1 - RELIEF) * (before**2 - 1)) if np.isfinite(before) else False


def choose_fault(
    as_it_is: float, tried: Sequence[Explained], margin: float = MARGIN, before: float = np.inf
) -> tuple[Explained | None, tuple[Explained, ...]]:
    """The one fault that makes the innovations plausible, if no other family does as well, and all that do, best first, but
    rotations last. as_it_is: evidence without a fault; before: ratio without a fault. The evidence of a candidate exceeds that
    by `margin`, its ratio is plausible, and its evidence is within APART of the best. Plausible is a ratio within SLACK of 1 or
    of the least of all faults, and at most BELIEVABLE unless it `relieves` the record. Rotations exclude no other fault by
    their ratio, because they fit by chance most easily."""
    well = [one for one in tried if np.isfinite(one.evidence) and one.evidence - as_it_is >= margin]
    well = [one for one in well if one.ratio <= BELIEVABLE or relieves(one.ratio, before)]
    least = min((one.ratio for one in well if not one.turned), default=min((one.ratio for one in well), default=np.inf))
    well = [one for one in well if one.ratio <= (1 + SLACK) * max(1.0, least)]
    highest = max((one.evidence for one in well), default=-np.inf)
    families: dict[tuple[str, int, float, bool], Explained] = {}
    for one in sorted(well, key=lambda one: (one.turned, -one.evidence)):
        assert one.fault is not None
        if highest - one.evidence < APART:
            families.setdefault(one.fault.family, one)
    candidates = tuple(families.values())
    return (candidates[0] if len(candidates) == 1 else None), candidates
