"""What a linear bench gives placement: the system that gauges are ranked by, and what a filter on them will claim."""

from __future__ import annotations

import numpy as np

from strainsight.multibody.inverse.linear import LinearBench, in_steps, in_time
from strainsight.placement.doubling import steady_factor
from strainsight.placement.scenario import Scenario

DISTURBED = 1e-3
"""[m/s²] White acceleration of every body that gauges are ranked with where the filter has none or less: without any, motions
that nothing damps have no steady covariance."""


def scenario_of(bench: LinearBench, rows: np.ndarray, noise: float, acceleration: float) -> Scenario:
    """The bench in time with readings of intensity σ²h, without weights.

    rows (k, n): strain per coordinate of the system; noise σ [strain] of a sample every h; acceleration [m/s²] of the white
    force, `DISTURBED` at least.
    """
    F, Q = in_time(bench, max(acceleration, DISTURBED))
    return Scenario(F, Q, bench.readings(rows), np.full(len(rows), noise**2 * bench.h), np.zeros(len(F)))


def expected_std(bench: LinearBench, rows: np.ndarray, noise: float, acceleration: float) -> np.ndarray:
    """σ (nu,) [N, N m] of the inputs after an update, that the filter with these gauges comes to claim,
    where the samples begin long ago.

    rows (k, n), noise and acceleration as of `scenario_of`, here as they are; inf where the gauges do not detect all inputs.
    Raises InfeasibleError and NumericalError as `steady_factor`.
    """
    A, N, scale = in_steps(bench, acceleration)
    L = steady_factor(A, bench.readings(rows) * scale / noise, N)
    unknown = slice(len(A) - len(bench.increment), len(A))
    if L is None:
        return np.full(len(bench.increment), np.inf)
    return np.asarray(np.linalg.norm(L[unknown], axis=1) * bench.increment)
