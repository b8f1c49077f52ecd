"""Fatigue damage of stress histories: rainflow cycles, S-N curve, Miner's sum, and its interval over draws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.compiled import njit

NONE, GOODMAN, FKM = 0, 1, 2
"""Mean stress corrections."""
SIGNED_VON_MISES, PRINCIPAL = 0, 1
"""Scalar stress measures."""


@njit(cache=True, nogil=True)
def _reversals(signal, out):  # type: ignore[no-untyped-def]
    """Write first sample, peaks, valleys and last sample to out (T,); return their number."""
    n = 0
    for value in signal:
        if n and value == out[n - 1]:
            continue
        if n > 1 and (out[n - 1] - out[n - 2]) * (value - out[n - 1]) > 0:
            out[n - 1] = value
        else:
            out[n] = value
            n += 1
    return n


@njit(cache=True, nogil=True)
def _count(signal, work, cycles):  # type: ignore[no-untyped-def]
    """Write the cycles of a signal (T,) to cycles (T, 3): range, mean, ½ or 1; return their number. work (2, T).

    Reversals are the first sample, peaks and valleys, and the last sample. A range that the next one is not smaller than is a
    cycle, or half of one where it begins at the first reversal that is left; what remains at the end are half cycles.
    Peaks between samples are not seen: of a sine of n samples a period a range is up to 1 − cos(π/n) too small.
    Source: ASTM E1049-85 (2017), 5.4.4."""
    turns = _reversals(signal, work[0])
    stack, height, count = work[1], 0, 0
    for i in range(turns):
        stack[height] = work[0, i]
        height += 1
        while height >= 3:
            last, before = abs(stack[height - 1] - stack[height - 2]), abs(stack[height - 2] - stack[height - 3])
            if last < before:
                break
            first, second = stack[height - 3], stack[height - 2]
            cycles[count, 0], cycles[count, 1] = before, 0.5 * (first + second)
            if height == 3:
                cycles[count, 2] = 0.5
                stack[0], stack[1] = stack[1], stack[2]
                height = 2
            else:
                cycles[count, 2] = 1.0
                stack[height - 3] = stack[height - 1]
                height -= 2
            count += 1
    for i in range(height - 1):
        cycles[count, 0], cycles[count, 1] = abs(stack[i + 1] - stack[i]), 0.5 * (stack[i] + stack[i + 1])
        cycles[count, 2] = 0.5
        count += 1
    return count


@njit(cache=True, nogil=True)
def _correct(range_, mean, rule, constant):  # type: ignore[no-untyped-def]
    """Equivalent range at zero mean stress; constant: tensile strength, or sensitivity M."""
    if rule == NONE or range_ <= 0.0:
        return range_
    if rule == GOODMAN:
        if mean <= 0.0:
            return range_
        return range_ / (1.0 - mean / constant) if mean < constant else np.inf
    amplitude, M = 0.5 * range_, constant
    if mean <= -amplitude:
        return range_ * (1.0 - M)
    if mean <= amplitude:
        return 2.0 * (amplitude + M * mean)
    if mean <= 3.0 * amplitude:
        return 2.0 * (1.0 + M) * (amplitude + M / 3.0 * mean) / (1.0 + M / 3.0)
    return range_ * (1.0 + M) ** 2 / (1.0 + M / 3.0)


@njit(cache=True, nogil=True)
def _cycle_damage(range_, curve):  # type: ignore[no-untyped-def]
    """1/N of one cycle; curve: range at one cycle's damage 1/cycles, cycles, slope, range at the knee, second slope, range at the
    cut-off."""
    reference, cycles, slope, knee, second, cut_off = curve
    if range_ <= cut_off:
        return 0.0
    if range_ >= knee:
        return (range_ / reference) ** slope / cycles
    return (knee / reference) ** slope / cycles * (range_ / knee) ** second


@njit(cache=True, nogil=True)
def _sums(signals, curve, rule, constant, out):  # type: ignore[no-untyped-def]
    """Miner's sum and Σ n (ΔS/reference)^slope of each signal (p, T), to out (p, 2)."""
    steps = signals.shape[1]
    work, cycles = np.empty((2, steps)), np.empty((steps, 3))
    for p in range(len(signals)):
        count = _count(signals[p], work, cycles)
        miner, moment = 0.0, 0.0
        for i in range(count):
            corrected = _correct(cycles[i, 0], cycles[i, 1], rule, constant)
            power = (corrected / curve[0]) ** curve[2]
            moment += cycles[i, 2] * power
            if corrected >= curve[3] and corrected > curve[5]:
                miner += cycles[i, 2] * power / curve[1]
            else:
                miner += cycles[i, 2] * _cycle_damage(corrected, curve)
        out[p, 0], out[p, 1] = miner, moment


@njit(cache=True, nogil=True)
def _one_number(stress, kind, out):  # type: ignore[no-untyped-def]
    """Of stress (p, 6, T), shears last: principal stress of the largest size, or von Mises' with its sign, into out (p, T)."""
    for p in range(len(stress)):
        for t in range(stress.shape[2]):
            x, y, z = stress[p, 0, t], stress[p, 1, t], stress[p, 2, t]
            a, b, c = stress[p, 3, t], stress[p, 4, t], stress[p, 5, t]
            middle = (x + y + z) / 3.0
            x, y, z = x - middle, y - middle, z - middle
            J2 = 0.5 * (x * x + y * y + z * z) + a * a + b * b + c * c
            if J2 <= 0.0:
                out[p, t] = middle if kind == PRINCIPAL else 0.0
                continue
            J3 = x * y * z + 2.0 * a * b * c - x * b * b - y * c * c - z * a * a
            radius = 2.0 * np.sqrt(J2 / 3.0)
            cosine = 4.0 * J3 / (radius * radius * radius)
            angle = np.arccos(min(1.0, max(-1.0, cosine))) / 3.0
            highest = middle + radius * np.cos(angle)
            lowest = middle + radius * np.cos(angle + 2.0 * np.pi / 3.0)
            positive = highest + lowest >= 0.0
            if kind == PRINCIPAL:
                out[p, t] = highest if positive else lowest
            else:
                out[p, t] = np.sqrt(3.0 * J2) if positive else -np.sqrt(3.0 * J2)


@dataclass(frozen=True)
class Curve:
    """N = N_ref (Δσ_ref/Δσ)^m down to the knee, N = N_k (Δσ_k/Δσ)^m₂ below it, and no damage at all below the cut-off.
    reference: Δσ_ref [Pa], a range (twice the amplitude), at N_ref = cycles; slope m [-]; knee N_k cycles, infinite for one
    line; second m₂ [-], infinite for none of the damage below the knee; cut_off N cycles, infinite for none. Two slopes and a
    cut-off are the curves of EN 1993-1-9 (3, 5; knee at 5e6, cut-off at 1e8)."""

    reference: float
    cycles: float
    slope: float
    knee: float = np.inf
    second: float = np.inf
    cut_off: float = np.inf

    @property
    def knee_range(self) -> float:
        """Δσ_k [Pa], zero for one line."""
        return 0.0 if np.isinf(self.knee) else self.reference * float((self.cycles / self.knee) ** (1 / self.slope))

    @property
    def cut_off_range(self) -> float:
        """Δσ [Pa] below which there is no damage."""
        if np.isinf(self.second) and np.isfinite(self.knee):
            # the range of the knee itself does damage
            return float(np.nextafter(self.knee_range, 0.0))
        if np.isinf(self.cut_off):
            return 0.0
        if self.cut_off <= self.knee:
            return self.reference * float((self.cycles / self.cut_off) ** (1 / self.slope))
        return self.knee_range * float((self.knee / self.cut_off) ** (1 / self.second))

    @property
    def numbers(self) -> tuple[float, ...]:
        """Arguments of the compiled loops."""
        second = self.slope if np.isinf(self.second) else self.second
        return (self.reference, self.cycles, self.slope, self.knee_range, second, self.cut_off_range)


@dataclass(frozen=True)
class MeanStress:
    """Which range at mean zero does the damage of Δσ = 2σ_a about σ_m.

    none      Δσ
    goodman   Δσ/(1 − σ_m/R_m), R_m the tensile strength; Δσ where σ_m < 0, infinite from R_m on
    fkm       2(σ_a + M σ_m) for |σ_m| ≤ σ_a;   2σ_a (1 − M) below;   2(1 + M)(σ_a + M σ_m/3)/(1 + M/3) up to σ_m = 3σ_a;
              2σ_a (1 + M)²/(1 + M/3) beyond, with the mean stress sensitivity M

    rule; constant: R_m [Pa], or M [-]. The S-N curve is then that of mean zero.
    Sources: Goodman (1899); FKM guideline, 6th edition (2012), 4.4.2."""

    rule: int = NONE
    constant: float = 0.0


KINDS = {"signed_von_mises": SIGNED_VON_MISES, "principal": PRINCIPAL}


@dataclass(frozen=True)
class Damage:
    """miner (p,) [-]; moment (p,): Σ nᵢ (Δσᵢ/Δσ_ref)^m [-], of which the equivalent range is made."""

    miner: np.ndarray
    moment: np.ndarray


def damage_of(signals: np.ndarray, curve: Curve, mean: MeanStress | None = None) -> Damage:
    """Of histories of stress (p, T) [Pa]:

        D = Σᵢ nᵢ/Nᵢ

    over the cycles of each by rainflow. NaN of a history with NaN in it. Sources: Palmgren (1924); Miner, J. Applied Mechanics 12
    (1945)."""
    histories, rule = np.ascontiguousarray(signals, dtype=float), MeanStress() if mean is None else mean
    out, whole = np.empty((len(histories), 2)), np.isfinite(histories).all(axis=1)
    if not whole.all():
        histories = np.where(whole[:, None], histories, 0.0)
    _sums(histories, curve.numbers, rule.rule, rule.constant, out)
    out[~whole] = np.nan
    return Damage(out[:, 0], out[:, 1])


def equivalent_range(moment: np.ndarray, curve: Curve, cycles: float) -> np.ndarray:
    """Δσ_eq [Pa] of which N_eq = cycles do the same damage on a line of slope m without knee or cut-off: Δσ_eq = (Σ nᵢ Δσᵢ^m
    / N_eq)^(1/m)"""
    return np.asarray(curve.reference * (moment / cycles) ** (1 / curve.slope))


def scalar_stress(stress: np.ndarray, kind: str) -> np.ndarray:
    """Of stress (p, 6, T) [Pa], [xx yy zz xy yz zx], one history (p, T) each:

    principal          the principal stress of the largest size
    signed_von_mises   von Mises' stress with the sign of that

    In pure shear the principal stresses of the largest size are two of opposite sign, and either is taken."""
    components = np.ascontiguousarray(stress, dtype=float)
    out = np.empty((components.shape[0], components.shape[2]))
    _one_number(components, KINDS[kind], out)
    return out


FEWEST = 40
"""Draws of which an interval of 95 % lies within the smallest and the largest."""


@dataclass(frozen=True)
class Interval:
    """median, low, high (...): 50, 2.5 and 97.5 % of draws."""

    median: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def widened(self, factor: float) -> Interval:
        """The interval with the same median and `factor` times the width in logarithms."""
        if factor == 1:
            return self
        D, positive = self.median, (self.median > 0) & np.isfinite(self.median)
        low, high = (
            np.where(positive, D * np.divide(end, D, out=np.ones_like(D), where=positive) ** factor, end)
            for end in (self.low, self.high)
        )
        return Interval(D, low, high)


def interval_of(draws: np.ndarray) -> Interval:
    """Of draws (N, ...), N ≥ FEWEST, by the order statistics of place q (N + 1). Where the draws and the truth come from one
    distribution the truth lies below the k-th smallest of N draws with probability k/(N + 1), whatever that is: the interval
    is exact for any N. Infinite draws are the largest there are; NaN stays NaN. Raises ValueError for fewer draws. Source:
    Weibull (1939); Hyndman and Fan, The American Statistician 50 (1996), type 6."""
    if len(draws) < FEWEST:
        raise ValueError(
            f"{len(draws)} random samples of the fatigue damage are too few for a 95 % interval; at least {FEWEST} are needed"
        )
    ordered = np.sort(draws, axis=0)
    return Interval(*(_between(ordered, q) for q in (0.5, 0.025, 0.975)))


def _between(ordered: np.ndarray, q: float) -> np.ndarray:
    place = q * (len(ordered) + 1) - 1
    below = min(max(int(np.floor(place)), 0), len(ordered) - 2)
    low, high = ordered[below], ordered[below + 1]
    share = place - below
    # an infinite draw above makes it infinite, and two make no difference of infinities
    finite = np.isfinite(high) & np.isfinite(low)
    step = np.where(finite, high, 0.0) - np.where(finite, low, 0.0)
    return np.asarray(np.where(finite, low + share * step, high if share > 0 else low))
