"""Gauge weights within limits: the nearest ones to given weights, and the least of a linear cost over them."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import linprog, minimize
from scipy.sparse import csr_array, vstack

from strainsight.placement.limits import Limits


class Region:
    """{0 ≤ w ≤ 1, rows·w ≤ most, least ≤ Σ size·w, w = 1 on fixed gauges}, which holds every layout."""

    def __init__(self, limits: Limits):
        self.limits = limits
        self.fixed = np.isin(np.arange(len(limits.size)), list(limits.fixed))
        free = ~self.fixed
        unit = 1 / np.maximum(limits.rows.max(axis=1).toarray().ravel(), np.finfo(float).tiny)
        # −Σ size·w ≤ −least among the rows; each at a largest entry of one
        floor, largest = csr_array(limits.size[None, :].astype(float)), float(limits.size.max())
        rows = csr_array(vstack([limits.rows * unit[:, None], floor * (-1 / largest)]))
        self._most = np.append(limits.most * unit, -limits.least / largest) - rows @ self.fixed.astype(float)
        self._rows = csr_array(rows[:, free])
        self._across = csr_array(self._rows.T)
        self._multiplier = np.zeros(len(self._most))

    def project(self, w: np.ndarray) -> np.ndarray:
        """The nearest point: clip(w − λᵀA, 0, 1) with λ ≥ 0 of the dual, max over λ of min over 0 ≤ v ≤ 1.

            ½|v − w|² + λᵀ(A v − b)

        To the accuracy of the dual's search where there are limits beside the count.
        """
        projected = np.ones_like(w)
        free = w[~self.fixed]
        if self.limits.plain:
            projected[~self.fixed] = self._clipped(free)
            return projected

        def dual(multiplier: np.ndarray) -> tuple[float, np.ndarray]:
            v = np.clip(free - self._across @ multiplier, 0, 1)
            over = self._rows @ v - self._most
            return -float(0.5 * np.sum((v - free) ** 2) + multiplier @ over), -over

        found = minimize(
            dual,
            self._multiplier,
            jac=True,
            method="L-BFGS-B",
            bounds=[(0, None)] * len(self._most),
            options={"maxiter": 500, "ftol": 1e-15, "gtol": 1e-10, "maxcor": 20},
        )
        self._multiplier = found.x
        projected[~self.fixed] = np.clip(free - self._across @ found.x, 0, 1)
        return projected

    def least(self, slope: np.ndarray) -> tuple[float, np.ndarray]:
        """Lower bound of slope·v over the region, its least up to rounding: by sorting, or by multipliers of a program; and by
        how much it rises where a gauge is taken (pool,), v_g = 1.

            slope·v ≥ (slope + λᵀA)·v − λᵀb for any λ ≥ 0,     with v_g = 1 more by max(0, (slope + λᵀA)_g)

        The bounds do not depend on the tolerances of the program.
        """
        free = slope[~self.fixed]
        fixed = float(slope[self.fixed].sum())
        size, bonded = self.limits.size[~self.fixed], int(self.limits.size[self.fixed].sum())
        price, offset = free, 0.0
        if not self.limits.plain:
            scale = max(float(np.abs(free).max(initial=0.0)), np.finfo(float).tiny)
            rows: Any = self._rows  # HiGHS takes sparse rows; the stubs of linprog know dense ones only
            programme = linprog(free / scale, A_ub=rows, b_ub=self._most, bounds=(0, 1), method="highs")
            if programme.status == 0:
                multiplier = scale * np.maximum(-programme.ineqlin.marginals, 0.0)
                # count and floor are left to the sorting
                multiplier[[0, -1]] = 0.0
                price, offset = free + self._across @ multiplier, -float(multiplier @ self._most)
        value, theta = cheapest(price, size, self.limits.least - bonded, self.limits.keep - bonded)
        rise = np.zeros_like(slope)
        rise[~self.fixed] = np.maximum(0.0, price + theta * size)
        return fixed + offset + value, rise

    def _clipped(self, free: np.ndarray) -> np.ndarray:
        total = self.limits.keep - int(self.fixed.sum())
        low, high = free.min() - 1.0, free.max()
        for _ in range(100):
            shift = 0.5 * (low + high)
            if np.clip(free - shift, 0, 1).sum() > total:
                low = shift
            else:
                high = shift
        return np.asarray(np.clip(free - 0.5 * (low + high), 0, 1))


def cheapest(slope: np.ndarray, size: np.ndarray, least: int, most: int) -> tuple[float, float]:
    """Least of slope·v over 0 ≤ v ≤ 1, least ≤ Σ size·v ≤ most, and the multiplier θ of the sum that proves it:

        Σ min(0, slope + θ size) − θ·(most where θ > 0, else least)

    slope (k,), size (k,) ≥ 1. Infinity where the sum cannot reach `least`, or `most` is negative.
    """
    if size.sum() < least or most < 0:
        return np.inf, 0.0
    ratio = slope / size
    order = np.argsort(ratio, kind="stable")
    filled = np.cumsum(size[order])
    theta = 0.0
    if len(order) and most < filled[-1]:
        theta = max(0.0, -float(ratio[order[np.searchsorted(filled, most)]]))
    if theta == 0.0 and least > 0:
        theta = min(0.0, -float(ratio[order[np.searchsorted(filled, least)]]))
    value = float(np.minimum(0.0, slope + theta * size).sum()) - theta * (most if theta > 0 else max(least, 0))
    return value, theta
