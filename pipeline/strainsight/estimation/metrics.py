"""How far the estimate of a load is from the truth, in the number that reports quote."""

from __future__ import annotations

import numpy as np

NONE = 1e-9
"""Share of its amplitude up to which a load is zero: what rounding leaves in a file of it."""


def load_scale(truth: np.ndarray, amplitude: float, burn_in: float = 0.1) -> tuple[float, bool]:
    """What errors of a load are relative to [N], √(mean u²) after the first tenth, or its amplitude where that is zero; and
    whether it is.

    truth (T + 1,) [N]; amplitude [N], positive: what the filter takes as the size of the load; burn_in: the share left out.
    """
    rms = float(np.sqrt(np.mean(after_start(truth, burn_in) ** 2)))
    return (rms, False) if rms > NONE * amplitude else (amplitude, True)


def input_error(error: np.ndarray, scale: float, burn_in: float = 0.1) -> np.ndarray:
    """RMS of a load's error, or of its claimed σ, after the first tenth and over its scale, √(mean e²) / s.

    error (T + 1, ...), estimate less truth, or σ, and scale, of `load_scale`, in one unit. Returns (...).
    """
    return np.asarray(np.sqrt(np.mean(after_start(error, burn_in) ** 2, axis=0)) / scale)


def after_start(history: np.ndarray, burn_in: float = 0.1) -> np.ndarray:
    """A history (T + 1, ...) without its first tenth, which no error counts."""
    return history[int(np.ceil(burn_in * len(history))) :]


def settling_time(time: np.ndarray, estimate: np.ndarray, truth: float, share: float) -> float:
    """From when on an estimate stays within a share of the truth; infinite where it is outside in the end.

    time (T + 1,) [s]; estimate (T + 1,) and truth in one unit; share [-]. Returns [s].
    """
    outside = np.flatnonzero(~(np.abs(estimate - truth) <= share * abs(truth)))
    after = outside[-1] + 1 if outside.size else 0
    return float(time[after]) if after < len(time) else float("inf")
