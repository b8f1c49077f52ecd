"""A layout within the remaining gauges, as a proof that one exists while gauges are removed one by one."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import partial

import numpy as np

from strainsight.ordering import tied_order
from strainsight.placement.layouts import NODES, Detection, best_layout, refusal
from strainsight.placement.limits import BUDGET, Limits
from strainsight.placement.riccati import Information
from strainsight.placement.scenario import Pool

EFFORT = 20
"""Nodes of the search for another layout; if they are not enough, the gauge stays while the current layout contains it."""
REACH = 200
"""Largest number of pool rows of such a search; the rest of the current layout is unchanged."""


class Witness:
    """units (pool,) bool: a layout that detects every unknown, with as many gauges as the limits permit. Under a budget there
    is no target size, and any layout that detects every unknown is accepted."""

    def __init__(self, limits: Limits, detection: Detection, worth: np.ndarray, names: Sequence[str]):
        """worth (pool,): approximate worth of each gauge. Raises InfeasibleError if no layout is within the limits."""
        self.limits, self.detection = limits, detection
        # what a gauge takes of the whole of count and budget
        self._dear = np.zeros(len(limits.size))
        for at, name in enumerate(limits.names):
            if (at == 0 or name == BUDGET) and limits.most[at] > 0:
                self._dear += limits.rows[[at]].toarray().ravel() / limits.most[at]
        # through a budget all rows hang together, and through the count
        local = [at > 0 and name != BUDGET for at, name in enumerate(limits.names)]
        self._local = limits.rows[np.array(local)]
        self._goal = 0 if BUDGET in limits.names else limits.keep
        if (layout := self._greedy(np.ones(len(limits.size), dtype=bool), worth)) is None:
            size = limits.size.astype(float)
            # with a range of sizes any size found quickly is enough; only infeasibility needs a proof
            for nodes in (NODES,) if limits.least == limits.keep else (EFFORT, NODES):
                layout = detection.layout(limits, size, floor=limits.least, nodes=nodes).gauges
                if layout is not None:
                    break
            if layout is None:
                raise refusal(limits, detection, names)
            if self._goal:
                self._goal = int(limits.size[layout].sum())
        self.units = np.isin(np.arange(len(limits.size)), layout)

    def spares(self, gauge: int, present: np.ndarray, worth: np.ndarray) -> bool:
        """Whether a layout without this gauge exists in present (pool,) bool; it becomes the witness. Tried in turn: another
        gauge in its place, the most valuable gauges that fit, an integer program over the `REACH` rows around the gauge,
        which is a proof if no more rows remain."""
        if not self.units[gauge]:
            return True
        rest = present.copy()
        rest[gauge] = False
        layout = self._checked(self.limits.packed(self._order(rest & ~self.units, worth), self.units & rest))
        if layout is None:
            layout = self._greedy(rest, worth)
        if layout is None:
            layout = self._programmed(gauge, rest, worth)
        if layout is None:
            return False
        self.units = np.isin(np.arange(len(rest)), layout)
        return True

    def _greedy(self, rest: np.ndarray, worth: np.ndarray) -> np.ndarray | None:
        return self._checked(
            self.limits.packed(self._order(rest, worth), np.array(sorted(self.limits.fixed), dtype=int))
        )

    def _programmed(self, gauge: int, rest: np.ndarray, worth: np.ndarray) -> np.ndarray | None:
        value = np.where(rest, worth, 0.0)
        around = self._around(gauge, rest, worth)
        stays = self.units & rest & ~around
        while True:
            layout = best_layout(
                self.limits,
                value,
                allowed=around | stays,
                required=stays,
                floor=self._goal,
                hits=self.detection.hits,
                nodes=EFFORT,
                gap=0.05,
            ).gauges
            if layout is None or not self.detection.loses(layout):
                return layout

    def _around(self, gauge: int, rest: np.ndarray, worth: np.ndarray) -> np.ndarray:
        """At most `REACH` rows of `rest` (pool,) bool that share a limit with the gauge, detect what is lost with it, or are
        connected to those; of equals, the most valuable."""
        if rest.sum() <= REACH:
            return rest
        left = self.units & rest
        self.detection.loses(np.flatnonzero(left))
        reached = np.isin(np.arange(len(rest)), gauge)
        steps = np.where(reached, 0.0, np.inf)
        present = rest | reached
        touched = present & np.any([reached, *(hit for hit in self.detection.hits if not hit[left].any())], axis=0)
        step = 1.0
        while True:
            touched = touched | (present & (self._local.T @ (self._local @ reached.astype(float)) > 0))
            if np.all(reached[touched]) or reached[rest].sum() >= REACH:
                break
            steps[touched & ~reached] = step
            reached, step = touched, step + 1
        order = self._order(rest, worth)
        around = np.zeros_like(rest)
        around[order[np.argsort(steps[order], kind="stable")][:REACH]] = True
        return around

    def _order(self, rest: np.ndarray, worth: np.ndarray) -> np.ndarray:
        places = np.flatnonzero(rest)
        return places[tied_order(-worth[places] / self._dear[places])]

    def _checked(self, layout: np.ndarray) -> np.ndarray | None:
        full = int(self.limits.size[layout].sum()) >= self._goal
        return layout if full and not self.detection.loses(layout) else None


class Guard:
    """Interface of the limits to an elimination: broken limits, gauges that may leave for them, and gauges that have to stay.
    remaining, held (pool,) bool: remaining gauges, and those of the witness that cannot be replaced."""

    def __init__(self, limits: Limits, detection: Detection, names: Sequence[str]):
        """Raises InfeasibleError if the bonded gauges alone break a limit."""
        self.limits, self.names, self.detection = limits, names, detection
        self.remaining = np.ones(len(limits.size), dtype=bool)
        self.held = np.zeros(len(limits.size), dtype=bool)
        self._witness: Witness | None = None
        # of a limit of nothing, what the whole pool takes
        self._whole = np.where(
            limits.most > 0, limits.most, np.maximum(limits.used(self.remaining), np.finfo(float).eps)
        )
        if np.any(limits.used(np.array(sorted(limits.fixed), dtype=int)) > limits.most):
            raise refusal(limits, detection, names)

    @property
    def excess(self) -> np.ndarray:
        """Excess over each limit (constraints,)."""
        return np.maximum(self.limits.used(self.remaining) - self.limits.most, 0.0)

    @property
    def broken(self) -> bool:
        return bool(np.any(self.excess > 0))

    @property
    def relief(self) -> np.ndarray:
        """Divisor of a rise (pool,), 0 for gauges that need not leave: see `eliminate`."""
        return np.asarray(self.limits.rows.T @ (self.excess / self._whole**2))

    def lets_go(self, gauge: int, index: np.ndarray, bounds: np.ndarray) -> bool:
        """Whether a layout without this gauge exists; index (m,), bounds (m,): worth of the remaining gauges. Otherwise the
        gauge is held until a witness without it is found. The remaining gauges contain the witness; while they break a limit,
        a gauge counted by that limit is not part of the witness. Raises InfeasibleError if no layout existed initially."""
        worth = self._worth(index, bounds)
        witness = self._get_witness(worth)
        spared = witness.spares(gauge, self.remaining, worth)
        self.held[gauge] = not spared
        self.held &= witness.units
        self.remaining[gauge] = not spared
        return spared

    def surplus(self, index: np.ndarray, bounds: np.ndarray) -> int:
        """The least valuable gauge that a broken limit counts and the witness does not need; as in `lets_go`."""
        worth = self._worth(index, bounds)
        out = np.flatnonzero(self.remaining & ~self._get_witness(worth).units & (self.relief > 0))
        return int(out[tied_order(worth[out])[0]])

    def _worth(self, index: np.ndarray, bounds: np.ndarray) -> np.ndarray:
        worth = np.zeros(len(self.remaining))
        worth[index] = np.maximum(bounds, 0.0)
        return worth

    def _get_witness(self, worth: np.ndarray) -> Witness:
        if self._witness is None:
            self._witness = Witness(self.limits, self.detection, worth, self.names)
        return self._witness


SUMMED = 256
"""G of so few gauges is summed again at each removal; of more, after as many removals."""


class Remaining:
    """Packed rows of the remaining gauges in index order; rows of removed gauges are zero until packed. index (m,): gauge at
    each place; movable (m,): remaining, neither fixed nor held; count: remaining gauges. Columns without response in any
    scenario, such as velocities under strain gauges, are omitted."""

    def __init__(self, pools: Sequence[Pool], fixed: Collection[int], labels: np.ndarray | None = None):
        """fixed: gauges that stay; labels (pool,): gauges with different labels are no twins."""
        self.index = np.arange(len(pools[0].rows))
        self.count = len(self.index)
        self._fixed = np.isin(self.index, list(fixed))
        self.movable = ~self._fixed
        self._there = np.ones(self.count, dtype=bool)
        self._columns = [np.flatnonzero(p.rows.any(axis=(0, 1))) for p in pools]
        self._rows = [np.ascontiguousarray(p.rows[:, :, c]) for p, c in zip(pools, self._columns, strict=True)]
        self._twin = twin_groups(self._rows)
        if labels is not None:
            self._twin = np.unique(self._twin * len(labels) + labels, return_inverse=True)[1]
        self._has_twins = len(np.unique(self._twin)) < self.count
        self._pools = pools
        self._size = [p.rows.shape[2] for p in pools]
        self._G = [_gram(rows) for rows in self._rows]
        self._summed = [np.diag(G).copy() for G in self._G]
        self._since = 0

    @property
    def gauges(self) -> np.ndarray:
        """Indices of the remaining gauges, ascending."""
        return self.index[self._there]

    def without(self, at: int) -> np.ndarray:
        """Indices of the remaining gauges except the one at this place."""
        present = self._there.copy()
        present[at] = False
        return self.index[present]

    def product(self, scenario: int, factor: np.ndarray) -> np.ndarray:
        """rows · factor (m, c, k) of a scenario; factor (n, k)."""
        rows = self._rows[scenario]
        flat = rows.reshape(-1, rows.shape[2]) @ factor[self._columns[scenario]]
        return np.asarray(flat.reshape(len(rows), rows.shape[1], -1))

    def gram(self, scenario: int) -> np.ndarray:
        """G = HᵀR⁻¹H (n, n) of the remaining gauges."""
        G = np.zeros((self._size[scenario],) * 2)
        G[np.ix_(self._columns[scenario], self._columns[scenario])] = self._G[scenario]
        return G

    def information(self, scenario: int) -> Information:
        """G with the rows of which it is the sum."""
        return Information(self.gram(scenario), partial(self._pools[scenario].stacked, self.gauges))

    def twins(self, at: int) -> np.ndarray:
        """Places of the movable gauges with the same rows as that at this place, itself included."""
        return np.flatnonzero((self._twin == self._twin[at]) & self.movable) if self._has_twins else np.array([at])

    def one_of_each(self, places: np.ndarray) -> np.ndarray:
        """First of each set of twins among the places."""
        return places[np.unique(self._twin[places], return_index=True)[1]] if self._has_twins else places

    def hold(self, gauges: np.ndarray) -> None:
        """Keep these gauges (pool,) bool for now, in addition to the fixed ones, and no others."""
        self.movable = self._there & ~(self._fixed | gauges)[self.index]

    def remove(self, at: int) -> None:
        """Remove the gauge at this place."""
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
        present = self._there
        self.index, self.movable, self._twin = self.index[present], self.movable[present], self._twin[present]
        self._rows = [rows[present] for rows in self._rows]
        self._there = np.ones(self.count, dtype=bool)


def twin_groups(rows: Sequence[np.ndarray]) -> np.ndarray:
    """Number of each gauge (m,), the same if their channels (m, c, k) agree in all scenarios, up to sign and order."""
    labels = np.zeros(len(rows[0]), dtype=np.int64)
    for part in rows:
        m, c, k = part.shape
        flat = part.reshape(m * c, k)
        leading = flat[np.arange(m * c), np.argmax(flat != 0, axis=1)]
        # adding zero turns −0 into 0: the bytes are compared
        signed = np.ascontiguousarray(flat * np.where(leading < 0, -1.0, 1.0)[:, None] + 0.0)
        codes = np.unique(signed.view(np.dtype((np.void, k * 8))).ravel(), return_inverse=True)[1].reshape(m, c)
        for channel in np.sort(codes, axis=1).T:
            labels = np.unique(labels * (m * c) + channel, return_inverse=True)[1]
    return labels


def _gram(rows: np.ndarray) -> np.ndarray:
    flat = rows.reshape(-1, rows.shape[2])
    return np.asarray(flat.T @ flat)
