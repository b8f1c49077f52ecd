"""Signals for pages: histories of unknowns and channels, their largest value and RMS."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class History:
    """An unknown over time: time (T,) [s]; truth, mean, smoothed (T,) [unit]; std, smoothed_std (T,) [unit] one σ."""

    name: str
    unit: str
    time: FloatArray
    truth: FloatArray | None
    mean: FloatArray
    std: FloatArray
    smoothed: FloatArray | None = None
    smoothed_std: FloatArray | None = None


@dataclass(frozen=True)
class Reading:
    """A channel over time.

    label: "G1", or "G1 45°" of a rosette; time (T,) [s]; measured (T,): without the estimated offset, NaN if missing; estimated
    (T,): or predicted from the other channels, std (T,) [unit]; gauge: its index in the picture; truth (T,): without noise, if
    known; noise_std [unit]: of a sample; offset: estimated value and σ [unit], None if not estimated."""

    label: str
    unit: str
    time: FloatArray
    measured: FloatArray
    estimated: FloatArray
    std: FloatArray
    gauge: int = 0
    truth: FloatArray | None = None
    noise_std: float = float("nan")
    offset: tuple[float, float] | None = None

    @property
    def residual(self) -> FloatArray:
        """Measured − estimated (T,) [unit]."""
        return self.measured - self.estimated

    @property
    def missing(self) -> int:
        """Number of missing samples on the clock of the filter, without the first sample of the record."""
        return int(np.count_nonzero(np.isnan(self.measured)))


def largest(*signals: FloatArray) -> float:
    """Largest finite absolute value, 0 without any."""
    return max((float(np.max(np.abs(signal[np.isfinite(signal)]), initial=0.0)) for signal in signals), default=0.0)


def round_factor(value: float) -> float:
    """Largest of 1, 2, 5 · 10^k not above a value > 0."""
    power = 10.0 ** math.floor(math.log10(value) + 1e-9)
    return next(step * power for step in (5.0, 2.0, 1.0) if step * power <= value * (1 + 1e-9))


def rms(values: FloatArray) -> float:
    """Root mean square of the finite values, NaN without any."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if len(finite) else float("nan")
