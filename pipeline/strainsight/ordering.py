"""Order numbers independently of rounding: gauges that are equal by symmetry differ in the last digits, depending on processor,
linear algebra and threads.
A number is a tie with the lowest remaining one if it exceeds it by at most a given share; among ties, the lowest index is first.
The first number therefore exceeds the best by at most that share."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

TIE = 1e-6
"""Share of a number within which others are ties. Rises of an elimination differ by 4e-10 of themselves between the settings of
tests/portability, and by 6e-9 at most where that was measured otherwise; the metric by 2e-11."""
_LARGEST = 1e300


def tied_order(values: np.ndarray, least: float = 0.0, share: float = TIE) -> np.ndarray:
    """Places of the values (m,), ascending, ties in the order of their places; infinities are ties, no NaN.

    least: differences up to it are ties, too, where values near zero are the rounding of larger ones."""
    order = np.argsort(values, kind="stable")
    v = np.clip(values[order], -_LARGEST, _LARGEST)
    end = np.searchsorted(v, v + np.maximum(share * np.abs(v), least), side="right").tolist()
    level, at = np.zeros(len(v), dtype=int), 0
    while at < len(v):
        level[at] = 1
        at = end[at]
    return np.asarray(order[np.lexsort((order, np.cumsum(level)))])


def index_of_largest(values: np.ndarray, least: float = 0.0) -> int:
    """The lowest place of the largest of the values (m,) and its ties; infinities are ties, no NaN; least: as in `tied_order`."""
    v = np.clip(values, -_LARGEST, _LARGEST)
    largest = v.max()
    return int(np.argmax(v >= largest - max(TIE * abs(largest), least)))


def ascending_ties(values: np.ndarray, least: float = 0.0) -> Iterator[int]:
    """The places of `tied_order` one by one, of which no more are looked for than are asked for."""
    left, v = np.arange(len(values)), np.clip(values, -_LARGEST, _LARGEST)
    while len(left):
        lowest = v[left].min()
        ties = v[left] <= lowest + max(TIE * abs(lowest), least)
        yield from map(int, left[ties])
        left = left[~ties]
