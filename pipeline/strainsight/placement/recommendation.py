"""What an engineer can act on: how many gauges are worth it, and which ones read alike."""

from __future__ import annotations

import numpy as np
from scipy.sparse.csgraph import connected_components

WORTH = 0.05
"""A gauge more is worth it where it lowers σ by this share."""
ALIKE = 0.99
"""Two gauges read alike where the cosine between their rows is above this."""


def gains(trace: np.ndarray) -> np.ndarray:
    """By what share one gauge more lowers σ = √tr(W P), from the smallest set on: 1 − √(T(n + 1)/T(n)).

    trace (s,) of an elimination, the whole pool first. Returns (s − 1,) for n = keep, keep + 1, …, pool − 1.
    """
    T = np.asarray(trace, dtype=float)[::-1]
    return 1 - np.sqrt(T[1:] / T[:-1])


def worth_keeping(trace: np.ndarray, keep: int) -> int:
    """The elbow of the trend: fewest gauges n ≥ keep from which no further one lowers σ by 5 % or more.

    trace (pool − keep + 1,) of an elimination, the whole pool first.
    """
    worth = np.flatnonzero(gains(trace) >= WORTH)
    return keep + (int(worth[-1]) + 1 if worth.size else 0)


def alike(rows: np.ndarray) -> list[tuple[int, ...]]:
    """Groups of strain rows (k, n) that point the same way, each within 0.99 of another of its group.

    Rows in coordinates of unit training amplitude, so that the cosine is the correlation of what they read: such gauges
    average noise and stand in for each other.
    """
    length = np.linalg.norm(rows, axis=1)
    unit = rows / np.where(length > 0, length, 1.0)[:, None]
    _, group = connected_components(np.abs(unit @ unit.T) > ALIKE, directed=False)
    members = [tuple(np.flatnonzero(group == number).tolist()) for number in dict.fromkeys(group.tolist())]
    return [found for found in members if len(found) > 1]
