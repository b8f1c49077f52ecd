"""Samples of a smooth signal → its values between them, and what that misses."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
from scipy.interpolate import make_interp_spline

DEGREE = 7
"""Of the spline through samples: a sine of 0.25 of the sampling rate is off by 3e-4 of its amplitude, one of 0.3 by 2e-3."""
NODES = 8
"""Samples on each side of a gap that fill it."""


def fill_gaps(values: np.ndarray) -> np.ndarray:
    """Values (T,) with NaN between samples replaced; the first and the last are samples.

    A gap from a to b is filled by the spline through every (b − a)-th sample about it: blanks in between do not make the noise
    of samples larger, as the spline through all of them would, and a table of two rates has the band of the slower one.
    """
    filled, there = values.copy(), np.flatnonzero(np.isfinite(values))
    for a, b in pairwise(there):
        if b == a + 1:
            continue
        nodes = np.arange(-NODES, NODES + 2)
        nodes = nodes[(a + nodes * (b - a) >= 0) & (a + nodes * (b - a) < len(values))]
        nodes = nodes[np.isfinite(values[a + nodes * (b - a)])]
        filled[a + 1 : b] = _weights(int(b - a), tuple(nodes.tolist())) @ values[a + nodes * (b - a)]
    return filled


@cache
def _weights(spacing: int, nodes: tuple[int, ...]) -> np.ndarray:
    """Of samples at nodes (k,), in units of the spacing, in the values (spacing − 1, k) between nodes 0 and 1."""
    own = make_interp_spline(nodes, np.eye(len(nodes)), k=_degree(len(nodes)))
    return np.asarray(own(np.arange(1, spacing) / spacing))


def interpolate(values: np.ndarray, factor: int) -> np.ndarray:
    """The spline of DEGREE (not-a-knot) through samples (T + 1, ...), `factor` values a sample: (T·factor + 1, ...)."""
    t = np.arange(len(values))
    between = make_interp_spline(t, values, k=_degree(len(t)), axis=0)(np.arange(factor * t[-1] + 1) / factor)
    between[::factor] = values
    return np.asarray(between)


def join_by_lines(values: np.ndarray, factor: int) -> np.ndarray:
    """Straight lines between samples (T + 1,), NaN where missing, `factor` values a sample: (T·factor + 1,)."""
    there = np.flatnonzero(np.isfinite(values))
    return np.interp(np.arange(factor * (len(values) - 1) + 1) / factor, there, values[there])


def _degree(samples: int) -> int:
    return min(DEGREE, 2 * ((samples - 2) // 2) + 1)


def share_above(values: np.ndarray, frequency: float) -> float:
    """RMS above a frequency [1/sample] over that of all samples (T,), mean included; under a Hann window."""
    window = np.hanning(len(values) + 2)[1:-1]
    power = np.abs(np.fft.rfft((values - values.mean()) * window)) ** 2
    whole = len(values) * float(np.sum((values * window) ** 2))
    above = float(np.sum(power[np.fft.rfftfreq(len(values)) > frequency]))
    return float(np.sqrt(2 * above / whole)) if whole > 0 else 0.0
