"""Arrays of pages, and the history of an unknown in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class History:
    """An unknown over time: time (T,) [s]; truth, mean, smoothed (T,) [unit]; std, smoothed_std (T,) [unit] one σ."""

    name: str
    unit: str
    time: FloatArray
    truth: FloatArray | None
    mean: FloatArray
    std: FloatArray
    smoothed: FloatArray | None = None
    smoothed_std: FloatArray | None = None
