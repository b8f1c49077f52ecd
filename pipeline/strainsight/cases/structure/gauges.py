"""The gauges of a layout on a structure, with what they read in the training run."""

from __future__ import annotations

import numpy as np

from strainsight.cases.layout.gauge_list import GaugeList, gauge_list
from strainsight.records.training import Screened, Training


def listed_gauges(gauges: np.ndarray, training: Training, screened: Screened) -> GaugeList:
    """Gauges (k,) by their numbers, as a layout lists them."""
    candidates = training.candidates
    used, peak = candidates.channels(gauges), np.full(len(candidates), np.nan)
    peak[used] = np.abs(training.reading[:, used]).max(axis=0)
    return gauge_list(candidates, gauges, screened.family, peak, screened.range)
