"""Arms of Wheatstone bridges: grids at several places that one channel reads together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from strainsight.sensors.candidates import Candidates


@dataclass(frozen=True)
class Arms:
    """Arms of bridges, a of them, but for the first of every bridge, the sign of which is 1.

    channel (a,) that each belongs to, ascending; sign (a,) sₖ of its strain εₖ in ε_B = Σₖ sₖ εₖ; grid (a): where it is, each a
    gauge of one grid, as arms are bonded one by one.
    """

    channel: np.ndarray
    sign: np.ndarray
    grid: Candidates

    def index_of(self, channels: np.ndarray) -> np.ndarray:
        """Those of some channels (k,), one channel's behind the other's."""
        first, last = (np.searchsorted(self.channel, channels, side=side) for side in ("left", "right"))
        return np.concatenate(
            [np.arange(a, b) for a, b in zip(first, last, strict=True)] or [np.zeros(0, dtype=np.int64)]
        )

    def of(self, channels: np.ndarray) -> Arms | None:
        """Those of some channels (k,), which are then numbered in their order; None where none of them is a bridge."""
        index = self.index_of(channels)
        if not len(index):
            return None
        count = np.searchsorted(self.channel, channels, side="right") - np.searchsorted(self.channel, channels)
        return Arms(np.repeat(np.arange(len(channels)), count), self.sign[index], self.grid.take(index))


def concatenated(
    parts: Sequence[Arms | None], channels: Sequence[int], concatenate: Callable[[Sequence[Candidates]], Candidates]
) -> Arms | None:
    """Those of pools with so many channels each, one behind the other; concatenate: of their grids."""
    start = np.cumsum([0, *channels])
    there = [(own, int(first)) for own, first in zip(parts, start[:-1], strict=True) if own is not None]
    if not there:
        return None
    return Arms(
        np.concatenate([own.channel + first for own, first in there]),
        np.concatenate([own.sign for own, _ in there]),
        concatenate([own.grid for own, _ in there]),
    )
