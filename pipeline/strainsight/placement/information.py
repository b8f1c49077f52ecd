"""What a set of gauges tells of the states, HᵀR⁻¹H, as a sum and as the factor that keeps the digits of a sharp one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

CANCELLED = 10.0
"""Where Σ PᵢᵢGᵢᵢ > CANCELLED tr(P G), the sum G has lost digits that P G P needs: the ratio is 1 to 3 with strain gauges,
6e3 where an accelerometer reads a load and a modulus at once, each far better than anything distinguishes them."""


@dataclass(frozen=True)
class Information:
    """G = HᵀR⁻¹H = RᵀR (n, n) of a set of gauges: their sum, and a factor R (k, n) where that is asked for.

    What a gauge of extreme precision reads is known so well that ‖P h‖ is a small share ε of ‖P‖‖h‖. A relative rounding
    u of the entries of G, which no way of summing avoids, then changes P G P by u/ε² of itself, that of R by u/ε. rows:
    gives H at unit noise (m, n), called where that matters; None where only the sum is known.
    """

    G: np.ndarray
    rows: Callable[[], np.ndarray] | None = None

    @cached_property
    def factor(self) -> np.ndarray | None:
        """R (k, n), k ≤ n; None where only the sum is known. Triangular where there are more rows than states."""
        if self.rows is None:
            return None
        rows = self.rows()
        return np.asarray(np.linalg.qr(rows, mode="r")) if len(rows) > len(self.G) else rows

    def needed(self, P: np.ndarray) -> np.ndarray | None:
        """The factor where P (n, n) asks for it, None where the sum has the digits."""
        if self.rows is None or P.diagonal() @ self.G.diagonal() <= CANCELLED * np.vdot(P, self.G):
            return None
        return self.factor

    def squared(self, P: np.ndarray) -> np.ndarray:
        """P G P (n, n), of symmetric P."""
        R = self.needed(P)
        if R is None:
            return np.asarray(P @ self.G @ P)
        B = P @ R.T
        return B @ B.T

    def scaled(self, d: np.ndarray) -> Information:
        """The same for x*/d; d (n,)."""
        rows = None if self.rows is None else lambda: np.asarray(self.factor) * d
        return Information(self.G * d[:, None] * d, rows)

    def with_rows(self, block: np.ndarray) -> Information:
        """The same with a gauge more; block (c, n) at unit noise."""
        rows = self.rows
        return Information(self.G + block.T @ block, None if rows is None else lambda: np.vstack([rows(), block]))


def information(rows: np.ndarray) -> Information:
    """`Information` of rows at unit noise (m, n)."""
    return Information(rows.T @ rows, lambda: rows)


def as_information(G: Information | np.ndarray) -> Information:
    return G if isinstance(G, Information) else Information(G)
