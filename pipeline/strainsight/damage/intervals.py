"""Median and interval of draws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FEWEST = 40
"""Draws of which an interval of 95 % lies within the smallest and the largest."""


@dataclass(frozen=True)
class Interval:
    """median, low, high (...): 50, 2.5 and 97.5 % of draws."""

    median: np.ndarray
    low: np.ndarray
    high: np.ndarray


def interval_of(draws: np.ndarray) -> Interval:
    """Of draws (N, ...), N ≥ FEWEST, by the order statistics of place q (N + 1).

    Where the draws and the truth come from one distribution the truth lies below the k-th smallest of N draws with probability
    k/(N + 1), whatever that is: the interval is exact for any N. Infinite draws are the largest there are; NaN stays NaN.
    Raises ValueError for fewer draws. Source: Weibull (1939); Hyndman and Fan, The American Statistician 50 (1996), type 6.
    """
    if len(draws) < FEWEST:
        raise ValueError(f"{len(draws)} draws for an interval of 95 %, fewer than {FEWEST}")
    ordered = np.sort(draws, axis=0)
    return Interval(*(_between(ordered, q) for q in (0.5, 0.025, 0.975)))


def _between(ordered: np.ndarray, q: float) -> np.ndarray:
    place = q * (len(ordered) + 1) - 1
    below = min(max(int(np.floor(place)), 0), len(ordered) - 2)
    low, high = ordered[below], ordered[below + 1]
    share = place - below
    # an infinite draw above makes it infinite, and two make no difference of infinities
    apart = np.isfinite(high) & np.isfinite(low)
    step = np.where(apart, high, 0.0) - np.where(apart, low, 0.0)
    return np.asarray(np.where(apart, low + share * step, high if share > 0 else low))
