"""Load histories u(t), their polynomial hold within a time step, and their rates as motions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.interpolate import CubicSpline, make_interp_spline

from strainsight.errors import InfeasibleError

TIME_SLACK = 1e-9
"""Share of its length by which a recorded history may be exceeded: rounding of start + k h."""


@dataclass(frozen=True)
class Sine:
    """u(t) = a sin(2πft + φ): frequency f [Hz], amplitude a [unit of the input], phase φ [rad]."""

    frequency: float
    amplitude: float
    phase: float = 0.0


@dataclass(frozen=True)
class Constant:
    """u(t) = value [unit of the input]."""

    value: float


@dataclass(frozen=True)
class Sweep:
    """u(t) = a sin(φ₀ + 2π(f₀t + (f₁ − f₀)t²/(2T))) up to the duration T, then a sine of f₁ without a jump.

    start f₀ and stop f₁ [Hz]; duration T [s]; amplitude a [unit of the input]; phase φ₀ [rad]."""

    start: float
    stop: float
    duration: float
    amplitude: float
    phase: float = 0.0


@dataclass(frozen=True)
class MultiSine:
    """u(t) = a/√N Σₖ sin(2πfₖt + φₖ): N equidistant frequencies from lowest to highest [Hz], phases sampled with the seed.

    Its power is that of one sine of amplitude a [unit of the input], for any N."""

    lowest: float
    highest: float
    count: int
    amplitude: float
    seed: int = 0


@dataclass(frozen=True)
class FromSamples:
    """u(t) by linear interpolation of recorded values: time (k,) [s] increasing, value (k,) [unit of the input]."""

    time: np.ndarray
    value: np.ndarray


@dataclass(frozen=True)
class Ramp:
    """Smooth transition between two values, continuous up to the second derivative, and constant before and after:

        u(t) = a + (b − a)(10 s³ − 15 s⁴ + 6 s⁵),     s = (t − t₀)/T within 0 and 1

    start a, end b [unit of the input]; begin t₀, duration T [s]."""

    start: float
    end: float
    begin: float
    duration: float


Signal = Constant | Ramp | Sine | Sweep | MultiSine | FromSamples
TONAL = (Constant, Sine, MultiSine)
"""Sums of tones."""


@dataclass(frozen=True)
class Tones:
    """u(t) = Σₖ Re Uₖ exp(iωₖt), for all time: frequency ω (k,) [rad/s], ascending, 0 a constant; amplitude U (k, n_u) complex
    [unit of the input]."""

    frequency: np.ndarray
    amplitude: np.ndarray


def tones_of(signals: Sequence[Signal]) -> Tones | None:
    """The tones of all signals; None if one of them is not a sum of sines and constants."""
    if not all(isinstance(signal, TONAL) for signal in signals):
        return None
    tones: dict[float, np.ndarray] = {}
    for column, signal in enumerate(signals):
        for frequency, amplitude in _lines(signal):
            tones.setdefault(2 * np.pi * frequency, np.zeros(len(signals), dtype=complex))[column] += amplitude
    ascending = sorted(tones)
    return Tones(np.array(ascending), np.array([tones[w] for w in ascending]).reshape(-1, len(signals)))


def _lines(signal: Signal) -> list[tuple[float, complex]]:
    """Frequency [Hz] and complex amplitude of every tone of a signal. Raises TypeError if it is not a sum of tones."""
    match signal:
        case Constant():
            return [(0.0, complex(signal.value))]
        case Sine():
            return [(signal.frequency, -1j * signal.amplitude * np.exp(1j * signal.phase))]
        case MultiSine():
            phase = np.random.default_rng(signal.seed).uniform(0, 2 * np.pi, signal.count)
            frequency = np.linspace(signal.lowest, signal.highest, signal.count)
            amplitude = -1j * signal.amplitude / np.sqrt(signal.count) * np.exp(1j * phase)
            return list(zip(frequency.tolist(), amplitude.tolist(), strict=True))
    raise TypeError(f"the signal must be of type constant, sine or multisine, but is {signal!r}")


def evaluate(signal: Signal, t: np.ndarray) -> np.ndarray:
    """u(t) (...) [unit of the input] at the times t (...) [s].

    Raises InfeasibleError if a recorded history does not cover t."""
    t = np.asarray(t, dtype=float)
    if not isinstance(signal, FromSamples):
        return _derivative(signal, t, 0)
    _check_covered(signal, t)
    return np.interp(t, signal.time, signal.value)


def _check_covered(signal: FromSamples, t: np.ndarray) -> None:
    first, last = signal.time[0], signal.time[-1]
    slack = TIME_SLACK * (last - first)
    if t.size and (t.min() < first - slack or t.max() > last + slack):
        raise InfeasibleError(
            f"the recorded signal covers {first:g} to {last:g} s, but the run requires {t.min():g} to {t.max():g} s",
            remedy="Reduce the duration of the run, or use a longer record.",
        )


def hold_coefficients(signals: Sequence[Signal], start: float, h: float, steps: int) -> np.ndarray:
    """Quadratic hold of every step,  u(τ) = u₀ + u₁ s + u₂ s²,  s = τ/h, through the history at s = 0, ½, 1:

        u₀ = u(0),   u₁ = −3u(0) + 4u(½) − u(1),   u₂ = 2u(0) − 4u(½) + 2u(1)

    start [s] of the first step; h [s]; steps their number. Returns (steps, 3, n_u) [unit of the input]. The relative error of the
    forced motion of a mode ω₀ under a sine ω is about (ωh)³ω₀h/720, because the interpolation error is an odd function about the
    middle of the step. Linear interpolation is held exactly if the samples are at multiples of h."""
    # products instead of running sums: step k ends bitwise where step k + 1 starts
    t = start + 0.5 * h * np.arange(2 * steps + 1)
    return quadratic_hold(
        np.stack([evaluate(signal, t) for signal in signals], axis=-1) if signals else np.zeros((len(t), 0))
    )


def quadratic_hold(u: np.ndarray) -> np.ndarray:
    """Hold coefficients (steps, 3, n_u) through u (2 steps + 1, n_u) at the ends and the middle of every step."""
    left, middle, right = u[:-1:2], u[1::2], u[2::2]
    return np.stack([left, -3 * left + 4 * middle - right, 2 * left - 4 * middle + 2 * right], axis=1)


def instant_values(coefficients: np.ndarray) -> np.ndarray:
    """u at the start of every step and at the end of the last: hold coefficients (steps, 3, n_u) → (steps + 1, n_u)."""
    return np.concatenate([coefficients[:, 0], coefficients[-1:].sum(axis=1)])


DEGREE = 7
"""Degree of the spline through samples: relative error 3e-4 for a sine at 0.25 of the sampling rate, 2e-3 at 0.3."""
NODES = 8
"""Number of samples on each side of a gap that fill it."""


def fill_gaps(values: np.ndarray) -> np.ndarray:
    """Values (T,) with NaN between samples replaced; the first and the last are samples.

    A gap from a to b is filled by the spline through every (b − a)-th sample around it. So missing samples do not amplify the
    noise, as the spline through all samples would, and a table of two rates has the band of the slower one."""
    filled, finite = values.copy(), np.flatnonzero(np.isfinite(values))
    for a, b in pairwise(finite):
        if b == a + 1:
            continue
        nodes = np.arange(-NODES, NODES + 2)
        nodes = nodes[(a + nodes * (b - a) >= 0) & (a + nodes * (b - a) < len(values))]
        nodes = nodes[np.isfinite(values[a + nodes * (b - a)])]
        filled[a + 1 : b] = _weights(int(b - a), tuple(nodes.tolist())) @ values[a + nodes * (b - a)]
    return filled


@cache
def _weights(spacing: int, nodes: tuple[int, ...]) -> np.ndarray:
    """Weights of samples at nodes (k,), in units of the spacing, in the values (spacing − 1, k) between nodes 0 and 1."""
    spline = make_interp_spline(nodes, np.eye(len(nodes)), k=_degree(len(nodes)))
    return np.asarray(spline(np.arange(1, spacing) / spacing))


def interpolate(values: np.ndarray, factor: int) -> np.ndarray:
    """The spline of DEGREE (not-a-knot) through samples (T + 1, ...), `factor` values per sample: (T·factor + 1, ...)."""
    t = np.arange(len(values))
    between = make_interp_spline(t, values, k=_degree(len(t)), axis=0)(np.arange(factor * t[-1] + 1) / factor)
    between[::factor] = values
    return np.asarray(between)


def join_by_lines(values: np.ndarray, factor: int) -> np.ndarray:
    """Linear interpolation of samples (T + 1,), NaN if missing, `factor` values per sample: (T·factor + 1,)."""
    finite = np.flatnonzero(np.isfinite(values))
    return np.interp(np.arange(factor * (len(values) - 1) + 1) / factor, finite, values[finite])


def _degree(samples: int) -> int:
    return min(DEGREE, 2 * ((samples - 2) // 2) + 1)


def share_above(values: np.ndarray, frequency: float) -> float:
    """Ratio of the RMS above a frequency [1/sample] to that of all samples (T,), mean included; with a Hann window."""
    window = np.hanning(len(values) + 2)[1:-1]
    power = np.abs(np.fft.rfft((values - values.mean()) * window)) ** 2
    whole = len(values) * float(np.sum((values * window) ** 2))
    above = float(np.sum(power[np.fft.rfftfreq(len(values)) > frequency]))
    return float(np.sqrt(2 * above / whole)) if whole > 0 else 0.0


LEAST = 16
"""Samples of the shortest segment."""
SEGMENTS = 8
"""Least number of half-overlapping segments of a record."""
LONGEST = 4096
"""Samples of the longest segment, limited by the resolution of a page."""


def density(values: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """One-sided power spectral density by Welch's method: half-overlapping Hann segments without their means.

    values (T,) [unit], NaN if a sample is missing: segments with NaN are left out; step [s]. Returns frequency (k,) [Hz] and
    density (k,) [unit²/Hz], its integral over frequency the mean square, without the line at zero. Both are empty if no segment
    of LEAST samples is complete. Source: Welch, IEEE Trans. Audio Electroacoust. 15 (1967)."""
    length = min(LONGEST, max(LEAST, 2 * len(values) // (SEGMENTS + 1)))
    while length >= LEAST:
        if len(values) >= length:
            cut = np.lib.stride_tricks.sliding_window_view(values, length)[:: length - length // 2]
            whole = cut[np.isfinite(cut).all(axis=1)]
            if len(whole):
                window = np.sin(np.pi * np.arange(length) / length) ** 2  # Hann, periodic
                lines = np.fft.rfft((whole - whole.mean(axis=1, keepdims=True)) * window)
                power = np.mean(np.abs(lines) ** 2, axis=0) * step / np.sum(window**2)
                power[1 : (length + 1) // 2] *= 2  # two-sided lines; the one at half the sampling rate has no second
                return np.fft.rfftfreq(length, step)[1:], power[1:]
        length //= 2
    return np.empty(0), np.empty(0)


def noise_density(std: float, step: float) -> float:
    """Density of white noise [unit²/Hz] of this standard deviation [unit] at this step [s]: 2 σ² h."""
    return 2 * std**2 * step


Motion = Callable[[np.ndarray], np.ndarray]
"""Times t (k,) [s] → p, ṗ, p̈ (3, k)."""


def motion(signal: Signal, of: Literal["position", "rate"], start: float = 0.0) -> Motion:
    """p(t) = u(t), or p(t) = start + ∫₀ᵗ u for the history of a rate; derivatives in closed form.

    A recorded history is the cubic spline through its samples (not-a-knot), whose acceleration is continuous; linear
    interpolation would have a discontinuous velocity. Raises InfeasibleError if a record does not cover t or has fewer than two
    samples, and for a sweep of a rate, whose integral has no closed form."""
    if isinstance(signal, FromSamples):
        return _recorded(signal, of, start)
    if of == "position":
        return lambda t: np.stack([_derivative(signal, np.asarray(t, float), order) for order in range(3)])
    if isinstance(signal, Sweep):
        raise InfeasibleError(
            "a signal of type sweep cannot define the rate (velocity) of a prescribed motion",
            remedy="Specify the position as a sweep, or the rate as a recorded signal.",
        )
    first = _integral(signal, np.zeros(1))[0]

    def at(t: np.ndarray) -> np.ndarray:
        t = np.asarray(t, dtype=float)
        return np.stack([start + _integral(signal, t) - first, _derivative(signal, t, 0), _derivative(signal, t, 1)])

    return at


def swing(signal: FromSamples) -> tuple[float, float]:
    """Largest overshoot of the spline through the samples over both neighbours, relative to the range of all samples, and its
    time [s]: about 0.05 for a sine with seven samples a period, more at a jump."""
    t, y = np.asarray(signal.time, float), np.asarray(signal.value, float)
    between = t[:-1, None] + np.diff(t)[:, None] * np.array([0.25, 0.5, 0.75])
    p = CubicSpline(t, y)(between)
    low, high = np.minimum(y[:-1], y[1:])[:, None], np.maximum(y[:-1], y[1:])[:, None]
    overshoot = np.maximum(p - high, low - p)
    worst = np.unravel_index(int(np.argmax(overshoot)), overshoot.shape)
    return max(float(overshoot[worst]), 0.0) / (float(np.ptp(y)) or 1.0), float(between[worst])


def gap(signal: FromSamples) -> tuple[float, float, float]:
    """The longest sampling interval over the median of all, and its begin and end [s]."""
    t = np.asarray(signal.time, float)
    steps = np.diff(t)
    k = int(np.argmax(steps))
    return float(steps[k] / np.median(steps)), float(t[k]), float(t[k + 1])


def _recorded(signal: FromSamples, of: str, start: float) -> Motion:
    if len(signal.time) < 2:
        raise InfeasibleError("the recorded motion has only one sample", remedy="Use a record of at least two samples.")
    spline = CubicSpline(signal.time, signal.value)
    parts = [spline, spline.derivative(1), spline.derivative(2)]
    shift = 0.0
    if of == "rate":
        parts = [spline.antiderivative(1), spline, spline.derivative(1)]
        shift = start - float(parts[0](min(max(0.0, signal.time[0]), signal.time[-1])))

    def at(t: np.ndarray) -> np.ndarray:
        t = np.asarray(t, dtype=float)
        _check_covered(signal, t)
        motions = np.stack([part(t) for part in parts])
        motions[0] += shift
        return motions

    return at


def _derivative(signal: Signal, t: np.ndarray, order: int) -> np.ndarray:
    """dᵏu/dtᵏ, k = 0, 1, 2."""
    match signal:
        case Ramp():
            s = np.clip((t - signal.begin) / signal.duration, 0.0, 1.0)
            shapes = s**3 * (10 - 15 * s + 6 * s**2), 30 * s**2 * (1 - s) ** 2, 60 * s * (1 - s) * (1 - 2 * s)
            return (order == 0) * signal.start + (signal.end - signal.start) * shapes[order] / signal.duration**order
        case Sweep():
            swept = np.minimum(t, signal.duration)
            rate = (signal.stop - signal.start) / signal.duration
            cycles = signal.start * swept + 0.5 * rate * swept**2 + signal.stop * (t - swept)
            w = 2 * np.pi * (signal.start + rate * swept)
            bend = np.where(t < signal.duration, 2 * np.pi * rate, 0.0)
            phase = 2 * np.pi * cycles + signal.phase
            waves = np.sin(phase), w * np.cos(phase), bend * np.cos(phase) - w**2 * np.sin(phase)
            return signal.amplitude * waves[order]
    # one line at a time, because a table of a long history by many lines would not fit into memory
    lines = ((2j * np.pi * f, amplitude) for f, amplitude in _lines(signal))
    return np.asarray(sum(_tone(iw, iw**order * amplitude, t) for iw, amplitude in lines))


def _tone(iw: complex, amplitude: complex, t: np.ndarray) -> np.ndarray:
    """Re U exp(iωt), as a sine that is exactly zero at its start."""
    return np.abs(amplitude) * np.sin(iw.imag * t + np.angle(1j * amplitude))


def _integral(signal: Signal, t: np.ndarray) -> np.ndarray:
    """∫u, up to a constant."""
    if isinstance(signal, Ramp):
        s = np.clip((t - signal.begin) / signal.duration, 0.0, 1.0)
        after = np.maximum(t - signal.begin - signal.duration, 0.0)
        risen = signal.duration * s**4 * (2.5 - 3 * s + s**2) + after
        return signal.start * t + (signal.end - signal.start) * risen
    lines = ((2j * np.pi * f, amplitude) for f, amplitude in _lines(signal))
    return np.asarray(sum(_tone(iw, amplitude / iw, t) if iw else amplitude.real * t for iw, amplitude in lines))
