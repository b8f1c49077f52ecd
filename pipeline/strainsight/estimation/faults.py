"""What may be wrong with one channel of a record or one known load, or with two that were mistaken for each other, and how it is
undone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from strainsight.estimation.decision import SLACK
from strainsight.measurements.clock import shifted

Kind = Literal[
    "sign", "scale", "swapped", "offset", "drift", "late", "angle", "dead", "clipped", "spikes", "stuck", "shift"
]

BELIEVABLE = 1.5
"""Innovations, RMS over the claimed size, up to which a record does not contradict its model."""
MARGIN, APART = 20.0, 10.0
"""Of ln evidence, by which a fault has to beat the record as it is, odds of 5·10⁸, and the one that is named any other, of
2·10⁴: far beyond the number of faults that are tried."""
SCALES = (0.5, 2.0, 1e-3, 1e3, 1e-6, 1e6)
"""Factors on a channel: half a bridge, two arms for one, units of a thousand and of a million."""
LOAD_SCALES = (*SCALES, *(f**sense for f in (4.4482216, 9.80665, 4448.2216, 9806.65) for sense in (1, -1)))
"""Factors on a known load: also pounds, kilograms, thousands of both."""
TURN = 15.0
"""Degrees between two angles by which a gauge is tried as turned: what lies between is near enough for the tolerance of one."""
ANGLES = (*(sense * TURN * k for k in range(1, 6) for sense in (1, -1)), 90.0)
"""Degrees by which a gauge, or the grid of a rosette, may be turned; a half turn reads the same."""
MOST_LATE = 20
"""Samples that a channel may be early or late by."""
FORESEEN = -0.5 * (1 + np.log(2 * np.pi))
"""Logarithm of the density that a unit normal number has on average: what a sample counts that is left out."""
RUN, CLIPPED = 3, 0.005
"""Equal samples in a row at the largest or least value of a channel, and the share of all samples in such rows, from which the
channel may be clipped."""


PRICE = 25.0
"""Of ln evidence, for what is wrong for a time: both its ends, and its size, are those that fit best."""
STEP, DROP = 5.0, 20.0
"""Of ½z², z a residual over its σ, that is taken off at every sample; and the fall of the sum of what is left that ends a part of
a record that does not fit."""

GRID = 200
"""Instants of a record between which a shift is sought at first."""
MOST_PARTS, LONGEST_PART = 20, 0.2
"""Parts of a record in which a channel may read what it likes, and the share of it that they may be."""


@dataclass(frozen=True)
class Fault:
    """kind of what is wrong with a channel, or with a known load; amount: factor on it (scale), number of the other channel or
    load (swapped), samples that it is late by (late), degrees (angle), what its zero shifts by (shift) [unit], else 0; of_load:
    `channel` is the number of a known load; spans: channel, first sample and the one behind the last of what is wrong for a time
    (spikes, stuck, shift)."""

    kind: Kind
    channel: int
    amount: float = 0.0
    of_load: bool = False
    spans: tuple[tuple[int, int, int], ...] = ()

    def of_channel(self, channel: int) -> Fault:
        """The same fault of another channel."""
        return replace(self, channel=channel, spans=tuple((channel, first, behind) for _, first, behind in self.spans))

    def later(self, samples: int) -> Fault:
        """The same in a record that begins so many samples earlier."""
        return replace(self, spans=tuple((j, first + samples, behind + samples) for j, first, behind in self.spans))

    @property
    def factor(self) -> float:
        """By which a sign or a scale is undone."""
        return -1.0 if self.kind == "sign" else 1 / self.amount

    @property
    def neighbours(self) -> tuple[Fault, ...]:
        """Delays by a sample less and more; none of another fault."""
        amounts = (self.amount - 1, self.amount + 1) if self.kind == "late" else ()
        return tuple(replace(self, amount=amount) for amount in amounts if amount)

    @property
    def family(self) -> tuple[str, int, float, bool]:
        """The same for faults that are one and the same to whoever has to correct it: delays of one channel, turns of one."""
        amount = 0.0 if self.kind in ("late", "angle", "shift") else abs(self.amount)
        return self.kind, self.channel, amount, self.of_load

    @property
    def wrong(self) -> tuple[int, ...]:
        """All channels, or all loads, that are wrong."""
        if self.spans:
            return tuple(sorted({channel for channel, _, _ in self.spans}))
        return (self.channel, int(self.amount)) if self.kind == "swapped" else (self.channel,)

    @property
    def channels(self) -> tuple[int, ...]:
        """All channels that are wrong."""
        return () if self.of_load else self.wrong


def undone(fault: Fault, samples: np.ndarray) -> tuple[np.ndarray, float]:
    """The record (T, m) as it would be without a fault, y' = T y, and ln |det T| of the samples that are kept.

    A sample that is left out, at the end of a delayed channel, of a dead or a clipped one, is NaN. Offset, drift and angle are
    no change of the samples but one of the model.
    """
    corrected, j = samples.copy(), fault.channel
    if fault.kind in ("sign", "scale"):
        corrected[:, j] *= fault.factor
        return corrected, float(np.isfinite(samples[:, j]).sum()) * float(np.log(abs(fault.factor)))
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


def of_any_size(fault: Fault, samples: np.ndarray, noise: np.ndarray) -> float:
    """ln of the density of samples (T, m) that are left out as readings of any kind, less that of as many of noise σ (m,): they
    are as wide as they are large."""
    change = 0.0
    for channel, first, behind in fault.spans if fault.kind == "spikes" else ():
        part = samples[first:behind, channel]
        part = part[np.isfinite(part)]
        wide = float(np.sqrt(np.mean(part**2))) / noise[channel] if len(part) else 1.0
        change -= len(part) * float(np.log(max(1.0, wide)))
    return change


def misfits(z: np.ndarray) -> list[tuple[int, int]]:
    """Parts of a record, first sample and the one behind the last, in which residuals over their σ z (T,) are too large: those
    over which the sum of ½z² − STEP grows by DROP at least, up to where it is largest. NaN count for nothing."""
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


def faults_for_a_time(samples: np.ndarray, predicted: np.ndarray, std: np.ndarray, noise: float) -> list[Fault]:
    """Where samples (T,) do not fit ŷ ± σ (T,) for a time: a zero that shifts, a channel that stands still, and readings of
    any kind."""
    wide, T = np.hypot(std, noise), len(samples)
    residual = samples - predicted
    parts, faults = misfits(residual / wide), []
    first, behind, size = _step_in(residual, wide)
    if behind - first > RUN and (first >= RUN or T - behind >= RUN):
        faults.append(Fault("shift", 0, size, spans=((0, first, behind),)))
    still = _longest_still(samples)
    if still is not None and any(still[0] < behind and first < still[1] for first, behind in parts):
        faults.append(Fault("stuck", 0, 0.0, spans=((0, *still),)))
    if parts and len(parts) <= MOST_PARTS and sum(behind - first for first, behind in parts) <= LONGEST_PART * T:
        faults.append(Fault("spikes", 0, 0.0, spans=tuple((0, *part) for part in parts)))
    return faults


def _step_in(residual: np.ndarray, std: np.ndarray) -> tuple[int, int, float]:
    """Between which samples a constant explains most of residuals (T,) with σ (T,): the first, the one behind the last, and it.

    Its gain in ln p is (Σ r/σ²)²/(2 Σ 1/σ²) over the part; ends are sought on a grid, then neighbours it.
    """
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


def _longest_still(values: np.ndarray) -> tuple[int, int] | None:
    """The longest row of more than RUN equal samples of some (T,) that are not all equal."""
    edges = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0, [True]]))
    longest = int(np.argmax(np.diff(edges)))
    first, behind = int(edges[longest]), int(edges[longest + 1])
    return (first, behind) if RUN < behind - first < len(values) else None


def at_limit(values: np.ndarray) -> np.ndarray:
    """Which samples (T,) are the largest or the least of all and stand in a row of RUN equal ones or more; none where those are
    less than CLIPPED of the record, or where the channel has one value only."""
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
    """Channels against their prediction: RMS (m,) of both, RMS (m,) of the residual over its σ, correlation (m,)."""

    measured: np.ndarray
    predicted: np.ndarray
    residual: np.ndarray
    correlation: np.ndarray


def channel_check(measured: np.ndarray, predicted: np.ndarray, std: np.ndarray) -> ChannelCheck:
    """measured, predicted, std (T, m) of the residual [unit of the channel], NaN where missing. NaN of a channel without
    samples, and the correlation of one that does not move."""
    both = np.isfinite(measured) & np.isfinite(predicted)
    count = np.where(both.any(axis=0), both.sum(axis=0), np.nan)
    y, p = (np.where(both, values, 0.0) for values in (measured, predicted))

    def mean(values: np.ndarray) -> np.ndarray:
        return np.asarray(values.sum(axis=0) / count)

    z = (y - p) / np.where(both, std, 1.0)
    moving_y, moving_p = (np.where(both, values - mean(values), 0.0) for values in (y, p))
    with np.errstate(invalid="ignore", divide="ignore"):
        together = mean(moving_y * moving_p) / np.sqrt(mean(moving_y**2) * mean(moving_p**2))
    return ChannelCheck(np.sqrt(mean(y**2)), np.sqrt(mean(p**2)), np.sqrt(mean(z**2)), together)


def roughly(
    fault: Fault, samples: np.ndarray, predicted: np.ndarray, std: np.ndarray, noise: float, begin: int = 0
) -> float:
    """ln of the density of a channel's samples y (T,) under a fault of it, by what all others foresee, ŷ ± σ (T,), sample by
    sample; offsets and drifts as they fit best. noise: σ of a sample, the unit. Of a turned gauge ŷ is that of its turned row.

    begin: samples of the record before these. What the σ of different samples have in common is passed over: a number to choose
    by what is looked at closely.
    """
    y, change = undone(fault, samples[:, None])
    change += of_any_size(fault, samples[:, None], np.array([noise]))
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
    """ln of the density of samples (T,) as a constant and white noise, both as they fit best; in units of the stated noise, and
    no quieter than a tenth of it."""
    known = samples[np.isfinite(samples)]
    spread = max(float(np.std(known)) if len(known) else 0.0, 0.1 * noise)
    rest = float(np.sum((known - known.mean()) ** 2)) / spread**2 if len(known) else 0.0
    return -0.5 * rest - len(known) * float(np.log(np.sqrt(2 * np.pi) * spread / noise))


def delay(samples: np.ndarray, predicted: np.ndarray, std: np.ndarray, noise: float) -> Fault | None:
    """The delay by MOST_LATE samples at most that fits a channel (T,) best, by what the others foresee; None of a record too
    short for any. Half a period of a sine late is a change of sign: which it is stays open there."""
    most = min(MOST_LATE, len(samples) // 4)
    tried = [Fault("late", 0, n) for n in range(-most, most + 1) if n]
    return max(tried, key=lambda one: roughly(one, samples, predicted, std, noise), default=None)


@dataclass(frozen=True)
class Explained:
    """A record under one fault: evidence, ln of the density of all its samples in units of their noise; ratio of innovations to
    their claim, RMS; amount: the fault's own, or the offset, or the drift by the end of the record as found [unit], with σ;
    point: the most likely parameters."""

    fault: Fault | None
    evidence: float
    ratio: float
    amount: float = 0.0
    std: float = 0.0
    point: tuple[float, ...] = ()


def chosen(as_it_is: float, tried: Sequence[Explained]) -> tuple[Explained | None, tuple[Explained, ...]]:
    """The one fault that makes a record believable, where no other family does as well, and all that do, best first.

    as_it_is: evidence of the record without a fault. A fault is a candidate where its evidence beats that by MARGIN, its ratio
    is believable, and its evidence is within APART of the best of those. Named is one alone. Believable is a ratio within SLACK
    of what the verdict allows, 1, or of the least that any fault leaves, and at most BELIEVABLE.
    """
    well = [one for one in tried if np.isfinite(one.evidence) and one.evidence - as_it_is >= MARGIN]
    least = min((one.ratio for one in well), default=np.inf)
    limit = min(BELIEVABLE, (1 + SLACK) * max(1.0, least))
    well = sorted((one for one in well if one.ratio <= limit), key=lambda one: -one.evidence)
    families: dict[tuple[str, int, float, bool], Explained] = {}
    for one in well:
        assert one.fault is not None
        if well[0].evidence - one.evidence < APART:
            families.setdefault(one.fault.family, one)
    candidates = tuple(families.values())
    return (candidates[0] if len(candidates) == 1 else None), candidates
