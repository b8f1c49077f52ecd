"""Histories as motions: a position with its rate and its acceleration."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from scipy.interpolate import CubicSpline

from strainsight.errors import InfeasibleError
from strainsight.loads.histories import (
    TIME_SLACK,
    Constant,
    FromSamples,
    MultiSine,
    Ramp,
    Signal,
    Sine,
    Sweep,
    multisine,
)

Motion = Callable[[np.ndarray], np.ndarray]
"""Times t (k,) [s] → p, ṗ, p̈ (3, k)."""


def motion(signal: Signal, of: Literal["position", "rate"], start: float = 0.0) -> Motion:
    """p(t) = u(t), or p(t) = start + ∫₀ᵗ u where the history is that of a rate; derivatives in closed form.

    A recorded history is the cubic spline through its samples (not-a-knot), whose acceleration does not jump: straight lines
    would have a velocity that does. Raises InfeasibleError where a record does not cover t, or has fewer than two samples, and
    for a sweep of a rate, whose integral has no closed form.
    """
    if isinstance(signal, FromSamples):
        return _recorded(signal, of, start)
    if of == "position":
        return lambda t: np.stack([_derivative(signal, np.asarray(t, float), order) for order in range(3)])
    if isinstance(signal, Sweep):
        raise InfeasibleError("a sweep of a rate", remedy="give a sweep of the position, or a recorded rate")
    first = _integral(signal, np.zeros(1))[0]
    return lambda t: np.stack(
        [
            start + _integral(signal, np.asarray(t, float)) - first,
            *(_derivative(signal, np.asarray(t, float), order) for order in range(2)),
        ]
    )


def swing(signal: FromSamples) -> tuple[float, float]:
    """How far the spline through the samples goes beyond both neighbours, over the range of all samples, and the time of it [s]:
    about 0.05 where a sine is sampled seven times a period, more about a jump."""
    t, y = np.asarray(signal.time, float), np.asarray(signal.value, float)
    between = t[:-1, None] + np.diff(t)[:, None] * np.array([0.25, 0.5, 0.75])
    p = CubicSpline(t, y)(between)
    low, high = np.minimum(y[:-1], y[1:])[:, None], np.maximum(y[:-1], y[1:])[:, None]
    beyond = np.maximum(p - high, low - p)
    worst = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
    return max(float(beyond[worst]), 0.0) / (float(np.ptp(y)) or 1.0), float(between[worst])


def gap(signal: FromSamples) -> tuple[float, float, float]:
    """The longest time without a sample over the median of all, and where it begins and ends [s]."""
    t = np.asarray(signal.time, float)
    steps = np.diff(t)
    k = int(np.argmax(steps))
    return float(steps[k] / np.median(steps)), float(t[k]), float(t[k + 1])


def _recorded(signal: FromSamples, of: str, start: float) -> Motion:
    if len(signal.time) < 2:
        raise InfeasibleError("a record of one sample is no motion", remedy="record at least two instants")
    spline = CubicSpline(signal.time, signal.value)
    parts = [spline, spline.derivative(1), spline.derivative(2)]
    shift = 0.0
    if of == "rate":
        parts = [spline.antiderivative(1), spline, spline.derivative(1)]
        shift = start - float(parts[0](min(max(0.0, signal.time[0]), signal.time[-1])))
    first, last = signal.time[0], signal.time[-1]
    slack = TIME_SLACK * (last - first)

    def at(t: np.ndarray) -> np.ndarray:
        t = np.asarray(t, dtype=float)
        if t.size and (t.min() < first - slack or t.max() > last + slack):
            raise InfeasibleError(
                f"the record covers {first:g} to {last:g} s, asked for {t.min():g} to {t.max():g} s",
                remedy="shorten the run or record longer",
            )
        found = np.stack([part(t) for part in parts])
        found[0] += shift
        return found

    return at


def _derivative(signal: Signal, t: np.ndarray, order: int) -> np.ndarray:
    """dᵏu/dtᵏ, k = 0, 1, 2."""
    match signal:
        case Constant():
            return np.full_like(t, signal.value if order == 0 else 0.0)
        case Ramp():
            s = np.clip((t - signal.begin) / signal.duration, 0.0, 1.0)
            shape = (
                s**3 * (10 - 15 * s + 6 * s**2),
                30 * s**2 * (1 - s) ** 2,
                60 * s * (1 - s) * (1 - 2 * s),
            )[order]
            return (order == 0) * signal.start + (signal.end - signal.start) * shape / signal.duration**order
        case Sine():
            w = 2 * np.pi * signal.frequency
            return signal.amplitude * _of_phase(w * t + signal.phase, w + 0 * t, 0 * t, order)
        case Sweep():
            swept = np.minimum(t, signal.duration)
            rate = (signal.stop - signal.start) / signal.duration
            cycles = signal.start * swept + 0.5 * rate * swept**2 + signal.stop * (t - swept)
            w = 2 * np.pi * (signal.start + rate * swept)
            bend = np.where(t < signal.duration, 2 * np.pi * rate, 0.0)
            return signal.amplitude * _of_phase(2 * np.pi * cycles + signal.phase, w, bend, order)
        case MultiSine():
            frequency, phase = multisine(signal)
            lines = (
                _of_phase(2 * np.pi * f * t + shift, 2 * np.pi * f + 0 * t, 0 * t, order)
                for f, shift in zip(frequency, phase, strict=True)
            )
            return signal.amplitude / np.sqrt(signal.count) * np.asarray(sum(lines))
    raise TypeError(f"not a signal in closed form: {signal!r}")


def _of_phase(phase: np.ndarray, rate: np.ndarray, bend: np.ndarray, order: int) -> np.ndarray:
    """Derivatives of sin Φ(t)."""
    if order == 0:
        return np.sin(phase)
    if order == 1:
        return rate * np.cos(phase)
    return bend * np.cos(phase) - rate**2 * np.sin(phase)


def _integral(signal: Signal, t: np.ndarray) -> np.ndarray:
    """∫u, of any constant."""
    match signal:
        case Constant():
            return signal.value * t
        case Ramp():
            s = np.clip((t - signal.begin) / signal.duration, 0.0, 1.0)
            after = np.maximum(t - signal.begin - signal.duration, 0.0)
            risen = signal.duration * s**4 * (2.5 - 3 * s + s**2) + after
            return signal.start * t + (signal.end - signal.start) * risen
        case Sine():
            w = 2 * np.pi * signal.frequency
            return -signal.amplitude / w * np.cos(w * t + signal.phase)
        case MultiSine():
            frequency, phase = multisine(signal)
            lines = (
                -np.cos(2 * np.pi * f * t + shift) / (2 * np.pi * f) for f, shift in zip(frequency, phase, strict=True)
            )
            return signal.amplitude / np.sqrt(signal.count) * np.asarray(sum(lines))
    raise TypeError(f"no integral in closed form: {signal!r}")
