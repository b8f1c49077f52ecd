"""Rainflow counting: which closed and half cycles a history of stress is made of."""

from __future__ import annotations

import numpy as np

from strainsight.damage import loops


def rainflow(signal: np.ndarray) -> np.ndarray:
    """Cycles (c, 3) of a signal (T,): range, mean [both in its unit] and count, ½ or 1 [-].

    Reversals are the first sample, peaks and valleys, and the last sample. A range that the next one is not smaller than is a
    cycle, or half of one where it begins at the first reversal that is left; what remains at the end are half cycles.
    Peaks between samples are not seen: of a sine of n samples a period a range is up to 1 − cos(π/n) too small.
    Raises ValueError for NaN. Source: ASTM E1049-85 (2017), 5.4.4.
    """
    own = np.ascontiguousarray(signal, dtype=float)
    if not np.isfinite(own).all():
        raise ValueError("a signal with NaN has no cycles")
    cycles = np.empty((len(own), 3))
    return cycles[: loops.count(own, np.empty((2, len(own))), cycles)]
