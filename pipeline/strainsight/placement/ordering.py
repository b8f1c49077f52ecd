"""Numbers in order where rounding must not decide: gauges that symmetry makes equal differ by the last digits, and these by
the number of threads.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

TIE = 1e-9
"""Two numbers closer than this share of themselves are a tie, which the lower index wins."""
HEAD = 64
_LARGEST = 1e300


def tied_order(values: np.ndarray, least: float = 0.0) -> np.ndarray:
    """Places of the values (m,), ascending, ties in the order of their places; infinities are ties, no NaN.

    least: differences below it are ties, too, where values near zero are the rounding of larger ones.
    """
    order = np.argsort(values, kind="stable")
    v = np.clip(values[order], -_LARGEST, _LARGEST)
    apart = np.diff(v) > np.maximum(TIE * np.maximum(np.abs(v[1:]), np.abs(v[:-1])), least)
    level = np.concatenate([[0], np.cumsum(apart)]) if len(v) else np.zeros(0, dtype=int)
    return np.asarray(order[np.lexsort((order, level))])


def first_of_largest(values: np.ndarray) -> int:
    """The lowest place of the largest of the values (m,); infinities are ties, no NaN."""
    v = np.clip(values, -_LARGEST, _LARGEST)
    largest = v.max()
    return int(np.argmax(v >= largest - TIE * abs(largest)))


def lowest_first(values: np.ndarray, least: float = 0.0) -> Iterator[int]:
    """The places of `tied_order`, of which only the head is sorted until more is asked for."""
    if len(values) <= 4 * HEAD:
        yield from map(int, tied_order(values, least))
        return
    limit = np.partition(values, HEAD)[HEAD]
    limit += max(2 * TIE * abs(limit), 2 * least) if np.isfinite(limit) else 0.0
    for part in (np.flatnonzero(values <= limit), np.flatnonzero(values > limit)):
        yield from map(int, part[tied_order(values[part], least)])
