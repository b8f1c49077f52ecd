"""Power spectral densities of records that may lack samples."""

from __future__ import annotations

import numpy as np

LEAST = 16
"""Samples of the shortest segment."""
SEGMENTS = 8
"""Half-overlapping segments that a record is cut into at least."""
LONGEST = 4096
"""Samples of the longest segment: more lines than a page can show."""


def density(values: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """One-sided power spectral density by Welch's method: half-overlapping Hann segments without their means.

    values (T,) [unit], NaN where a sample is missing: segments with one are left out; step [s]. Returns frequency (k,) [Hz] and
    density (k,) [unit²/Hz], its integral over frequency the mean square; without the line at zero, which the means took away.
    Both are empty where no stretch of LEAST samples is whole. Source: Welch, IEEE Trans. Audio Electroacoust. 15 (1967).
    """
    from scipy import signal  # half a second to import, which a run that draws no page need not spend

    length = min(LONGEST, max(LEAST, 2 * len(values) // (SEGMENTS + 1)))
    while length >= LEAST:
        if len(values) >= length:
            cut = np.lib.stride_tricks.sliding_window_view(values, length)[:: length - length // 2]
            whole = cut[np.isfinite(cut).all(axis=1)]
            if len(whole):
                f, powers = signal.periodogram(whole, 1 / step, window="hann", detrend="constant", axis=-1)
                return f[1:], powers.mean(axis=0)[1:]
        length //= 2
    return np.empty(0), np.empty(0)


def noise_density(std: float, step: float) -> float:
    """The same of white noise [unit²/Hz] of this standard deviation [unit] at this step [s]: 2 σ² h."""
    return 2 * std**2 * step
