"""The sum of the variances of the weighed unknowns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.placement.criteria.criterion import Criterion


@dataclass(frozen=True)
class Trace(Criterion):
    """c = tr M = tr(W P): A-optimality."""

    name = "trace"
    title = "trace"
    symbol = "tr(W P)"
    sigma = "the weighted RMS of the steady-state σ"
    meaning = "sum of the scaled error variances of the unknowns"

    def value(self, M: np.ndarray) -> float:
        return float(M.trace())

    def gradient(self, M: np.ndarray) -> np.ndarray:
        return np.eye(len(M))

    def rise(self, M: np.ndarray, D: np.ndarray) -> float:
        return float(D.trace())

    def least_rise(self, M: np.ndarray, t: float) -> float:
        return t
