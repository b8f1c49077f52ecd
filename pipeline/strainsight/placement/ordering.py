"""The smallest of many numbers first, where rarely more than a few are asked for."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

HEAD = 64


def lowest_first(values: np.ndarray) -> Iterator[int]:
    """Places of the values (m,), ascending, ties in their order: np.argsort(values, kind="stable"), of which only the head is
    sorted until more is asked for. No NaN."""
    if len(values) <= 4 * HEAD:
        yield from map(int, np.argsort(values, kind="stable"))
        return
    limit = np.partition(values, HEAD)[HEAD]
    for part in (np.flatnonzero(values <= limit), np.flatnonzero(values > limit)):
        yield from map(int, part[np.argsort(values[part], kind="stable")])
