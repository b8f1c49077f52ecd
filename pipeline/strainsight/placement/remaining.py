"""The gauges that are left while they leave one by one: their rows, their sum HᵀR⁻¹H and their twins."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import partial

import numpy as np

from strainsight.placement.information import Information
from strainsight.placement.scenario import Pool

SUMMED = 256
"""G of so few gauges is summed anew at every removal; of more, after as many removals."""


class Remaining:
    """Packed rows of the gauges left, in the order of their indices; those of gauges just removed are zero until packed.

    index (m,): gauge at each place; movable (m,): still there, not fixed and not held; count: gauges still there. Columns that no
    gauge of a scenario sees, as velocities and unknowns under strain gauges, are left out of the rows.
    """

    def __init__(self, pools: Sequence[Pool], fixed: Collection[int], apart: np.ndarray | None = None):
        """fixed: gauges that stay; apart (pool,): labels, gauges of different ones are no twins whatever they read."""
        self.index = np.arange(len(pools[0].rows))
        self.count = len(self.index)
        self._fixed = np.isin(self.index, list(fixed))
        self.movable = ~self._fixed
        self._there = np.ones(self.count, dtype=bool)
        self._columns = [np.flatnonzero(p.rows.any(axis=(0, 1))) for p in pools]
        self._rows = [np.ascontiguousarray(p.rows[:, :, c]) for p, c in zip(pools, self._columns, strict=True)]
        self._twin = twin_groups(self._rows)
        if apart is not None:
            self._twin = np.unique(self._twin * len(apart) + apart, return_inverse=True)[1]
        self._has_twins = len(np.unique(self._twin)) < self.count
        self._pools = pools
        self._size = [p.rows.shape[2] for p in pools]
        self._G = [_gram(rows) for rows in self._rows]
        self._summed = [np.diag(G).copy() for G in self._G]
        self._since = 0

    @property
    def gauges(self) -> np.ndarray:
        """Indices of the gauges still there, ascending."""
        return self.index[self._there]

    def without(self, at: int) -> np.ndarray:
        """Indices of the gauges still there but the one at this place."""
        there = self._there.copy()
        there[at] = False
        return self.index[there]

    def product(self, scenario: int, factor: np.ndarray) -> np.ndarray:
        """rows · factor (m, c, k) of a scenario; factor (n, k)."""
        rows = self._rows[scenario]
        flat = rows.reshape(-1, rows.shape[2]) @ factor[self._columns[scenario]]
        return np.asarray(flat.reshape(len(rows), rows.shape[1], -1))

    def gram(self, scenario: int) -> np.ndarray:
        """G = HᵀR⁻¹H (n, n) of the gauges still there."""
        G = np.zeros((self._size[scenario],) * 2)
        G[np.ix_(self._columns[scenario], self._columns[scenario])] = self._G[scenario]
        return G

    def information(self, scenario: int) -> Information:
        """The same G with the rows it is the sum of, as they are now."""
        return Information(self.gram(scenario), partial(self._pools[scenario].stacked, self.gauges))

    def twins(self, at: int) -> np.ndarray:
        """Places of the movable gauges that say the same as the one at this place, itself among them."""
        return np.flatnonzero((self._twin == self._twin[at]) & self.movable) if self._has_twins else np.array([at])

    def one_of_each(self, places: np.ndarray) -> np.ndarray:
        """The first of every set of twins among the places."""
        return places[np.unique(self._twin[places], return_index=True)[1]] if self._has_twins else places

    def hold(self, held: np.ndarray) -> None:
        """These gauges (pool,) bool stay for now, beside the fixed ones, and no others."""
        self.movable = self._there & ~(self._fixed | held)[self.index]

    def remove(self, at: int) -> None:
        """Take the gauge at this place away."""
        self._there[at] = self.movable[at] = False
        self.count -= 1
        self._since += 1
        anew = self.count <= SUMMED or self._since >= SUMMED
        for i, rows in enumerate(self._rows):
            block = rows[at].copy()
            rows[at] = 0.0
            G = self._G[i] - block.T @ block
            # what is left of a sum of which most has gone would be its rounding
            if anew or np.any(np.diag(G) < 0.5 * self._summed[i]):
                G = _gram(rows)
                self._summed[i] = np.diag(G).copy()
            self._G[i] = G
        self._since = 0 if anew else self._since
        if self.count < 0.875 * len(self.index):
            self._pack()

    def _pack(self) -> None:
        there = self._there
        self.index, self.movable, self._twin = self.index[there], self.movable[there], self._twin[there]
        self._rows = [rows[there] for rows in self._rows]
        self._there = np.ones(self.count, dtype=bool)


def twin_groups(rows: Sequence[np.ndarray]) -> np.ndarray:
    """A number for every gauge (m,): the same for gauges whose channels (m, c, k) agree in every scenario.

    Up to the sign and the order of the channels, which change nothing in hᵀh.
    """
    labels = np.zeros(len(rows[0]), dtype=np.int64)
    for part in rows:
        m, c, k = part.shape
        flat = part.reshape(m * c, k)
        leading = flat[np.arange(m * c), np.argmax(flat != 0, axis=1)]
        # adding zero turns −0 into 0: the bytes are compared
        signed = np.ascontiguousarray(flat * np.where(leading < 0, -1.0, 1.0)[:, None] + 0.0)
        own = np.unique(signed.view(np.dtype((np.void, k * 8))).ravel(), return_inverse=True)[1].reshape(m, c)
        for channel in np.sort(own, axis=1).T:
            labels = np.unique(labels * (m * c) + channel, return_inverse=True)[1]
    return labels


def _gram(rows: np.ndarray) -> np.ndarray:
    flat = rows.reshape(-1, rows.shape[2])
    return np.asarray(flat.T @ flat)
