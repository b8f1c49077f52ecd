"""The gauges that are left while they leave one by one, and a layout within them as the proof that one is left."""

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
"""Nodes of the search of another layout; where they are not enough, the gauge stays while the layout at hand has it."""
REACH = 200
"""Pool rows that such a search may choose from; the rest of the layout at hand stays as it is."""


class Witness:
    """units (pool,) bool: a layout that detects every unknown, of as many gauges as the limits allow.

    Under a budget there is no such goal, and any layout that detects every unknown will do.
    """

    def __init__(self, limits: Limits, detection: Detection, worth: np.ndarray, names: Sequence[str]):
        """worth (pool,): what a gauge is about worth. Raises InfeasibleError where the limits leave no layout."""
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
        present = np.ones(len(limits.size), dtype=bool)
        layout = self._greedy(present, worth)
        if layout is None:
            size = limits.size.astype(float)
            # of more than one number, as many as are found soon will do; only that there is none at all takes a proof
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
        """Whether a layout is found without this gauge of those present (pool,) bool; it is the witness from then on.

        In turn: another gauge in its place, the gauges worth most as far as they fit, an integer program over the `REACH`
        rows around the gauge, which is a proof where no more than those are left.
        """
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
        """The rows of `rest` (pool,) bool, `REACH` at most, that share a limit with the gauge or see what is lost with it,
        or share one with those, and so on; of equals, those worth most."""
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
    """What the limits say to an elimination: whether one is still broken, who may leave for it, and who has to stay.

    there, held (pool,) bool: gauges that have not left, and those of the witness without which no other was found.
    """

    def __init__(self, limits: Limits, detection: Detection, names: Sequence[str]):
        """Raises InfeasibleError where the bonded gauges break a limit by themselves."""
        self.limits, self.names, self.detection = limits, names, detection
        self.there = np.ones(len(limits.size), dtype=bool)
        self.held = np.zeros(len(limits.size), dtype=bool)
        self._witness: Witness | None = None
        # of a limit of nothing, what the whole pool takes
        self._whole = np.where(limits.most > 0, limits.most, np.maximum(limits.used(self.there), np.finfo(float).eps))
        if np.any(limits.used(np.array(sorted(limits.fixed), dtype=int)) > limits.most):
            raise refusal(limits, detection, names)

    @property
    def excess(self) -> np.ndarray:
        """By how much every limit is broken (constraints,)."""
        return np.maximum(self.limits.used(self.there) - self.limits.most, 0.0)

    @property
    def broken(self) -> bool:
        return bool(np.any(self.excess > 0))

    @property
    def relief(self) -> np.ndarray:
        """What a rise is divided by (pool,), 0 for gauges that need not leave: see `eliminate`."""
        return np.asarray(self.limits.rows.T @ (self.excess / self._whole**2))

    def lets_go(self, gauge: int, index: np.ndarray, bounds: np.ndarray) -> bool:
        """Whether a layout is found without this gauge; index (m,), bounds (m,): what the gauges still there are worth.

        It is held where none is, and no longer when a witness without it is found: what is left holds the witness, so
        while it breaks a limit, a gauge that the limit counts is no part of the witness, and is not held.
        Raises InfeasibleError where there was no layout to begin with.
        """
        worth = self._worth(index, bounds)
        witness = self._get_witness(worth)
        spared = witness.spares(gauge, self.there, worth)
        self.held[gauge] = not spared
        self.held &= witness.units
        self.there[gauge] = not spared
        return spared

    def surplus(self, index: np.ndarray, bounds: np.ndarray) -> int:
        """The gauge worth least that a broken limit counts and the witness does without; as in `lets_go`."""
        worth = self._worth(index, bounds)
        out = np.flatnonzero(self.there & ~self._get_witness(worth).units & (self.relief > 0))
        return int(out[tied_order(worth[out])[0]])

    def _worth(self, index: np.ndarray, bounds: np.ndarray) -> np.ndarray:
        worth = np.zeros(len(self.there))
        worth[index] = np.maximum(bounds, 0.0)
        return worth

    def _get_witness(self, worth: np.ndarray) -> Witness:
        if self._witness is None:
            self._witness = Witness(self.limits, self.detection, worth, self.names)
        return self._witness


SUMMED = 256
"""G of so few gauges is summed anew at every removal; of more, after as many removals."""


class Remaining:
    """Packed rows of the gauges left, in the order of their indices; those of gauges just removed are zero until packed.

    index (m,): gauge at each place; movable (m,): still there, not fixed and not held; count: gauges still there. Columns that no
    gauge of a scenario sees, as velocities and unknowns under strain gauges, are left out of the rows.
    """

    def __init__(self, pools: Sequence[Pool], fixed: Collection[int], labels: np.ndarray | None = None):
        """fixed: gauges that stay; labels (pool,): labels, gauges of different ones are no twins whatever they read."""
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
        """Indices of the gauges still there, ascending."""
        return self.index[self._there]

    def without(self, at: int) -> np.ndarray:
        """Indices of the gauges still there but the one at this place."""
        present = self._there.copy()
        present[at] = False
        return self.index[present]

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

    def hold(self, gauges: np.ndarray) -> None:
        """These gauges (pool,) bool stay for now, beside the fixed ones, and no others."""
        self.movable = self._there & ~(self._fixed | gauges)[self.index]

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
        present = self._there
        self.index, self.movable, self._twin = self.index[present], self.movable[present], self._twin[present]
        self._rows = [rows[present] for rows in self._rows]
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
        codes = np.unique(signed.view(np.dtype((np.void, k * 8))).ravel(), return_inverse=True)[1].reshape(m, c)
        for channel in np.sort(codes, axis=1).T:
            labels = np.unique(labels * (m * c) + channel, return_inverse=True)[1]
    return labels


def _gram(rows: np.ndarray) -> np.ndarray:
    flat = rows.reshape(-1, rows.shape[2])
    return np.asarray(flat.T @ flat)
