"""What a set of gauges is worth after each failure, and the swaps that lower the largest loss."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from strainsight.errors import NumericalError
from strainsight.ordering import TIE, tied_order
from strainsight.placement.increment import gauge_gradients
from strainsight.placement.limits import Limits, Swaps
from strainsight.placement.scenario import Aggregate, Pool, aggregated, loop_of
from strainsight.placement.score import cost_of, covariances_of


class LossSearch:
    """Losses of a set {gauge: cost when it fails, NaN where not solved} and the swap that lowers the largest, within a number
    of solves."""

    def __init__(self, pools: Sequence[Pool], aggregate: Aggregate, limits: Limits, limit: int):
        self.pools, self.aggregate, self.limits, self.limit, self.solves = pools, aggregate, limits, limit, 0

    def reduced(self, chosen: list[int]) -> list[int]:
        """A layout of gauges of `chosen`, too many or too dear: the one whose removal leaves the least measure goes first,
        the lower index on a tie."""
        while True:
            broken = self.limits.used(np.array(chosen)) > self.limits.most
            if not broken.any():
                break
            part = self.limits.rows[broken].sum(axis=0)
            least, rest = (len(chosen), np.inf), chosen
            for out in (g for g in chosen if g not in self.limits.fixed and part[g] > 0):
                others = [g for g in chosen if g != out]
                loss = self.losses(others, (least[0], least[1] * (1 - TIE)))
                if loss:
                    least, rest = measure(loss), others
            chosen = rest
        return chosen

    def swapped(self, chosen: list[int]) -> tuple[list[int], dict[int, float], tuple[tuple[int, int], ...]]:
        """The set after every swap that helped, its losses, and the swaps (out, in)."""
        swaps: list[tuple[int, int]] = []
        loss = self.losses(chosen, (len(chosen), np.inf))
        swap = self.first_gain(chosen, loss)
        while swap is not None:
            out, into, loss = swap
            chosen = sorted({*chosen, into} - {out})
            swaps.append((out, into))
            swap = self.first_gain(chosen, loss)
        return chosen, loss, tuple(swaps)

    def losses(
        self,
        chosen: Sequence[int],
        below: tuple[int, float],
        order: Sequence[int] | None = None,
        known: dict[int, float] | None = None,
    ) -> dict[int, float]:
        """All losses of a set, those of `order` first; {} as soon as they are seen not to be below (fatal, largest)."""
        loss = dict(known or {})
        for g in chosen if order is None else order:
            if g not in loss:
                rest = [other for other in chosen if other != g]
                try:
                    loss[g] = cost_of(covariances_of(self.pools, rest), self.pools, self.aggregate)
                except NumericalError:
                    loss[g] = float("nan")
                self.solves += len(self.pools)
            fatal, largest = measure(loss)
            if fatal > below[0] or (fatal == below[0] and largest >= below[1]):
                return {}
        return loss

    def first_gain(self, chosen: list[int], loss: dict[int, float]) -> tuple[int, int, dict[int, float]] | None:
        """The swap (out, in) of the least bound that helps, with the losses after it; None where no swap does."""
        fatal, largest = measure(loss)
        enough = largest * (1 - TIE)
        others = [g for g in range(len(self.pools[0].rows)) if g not in set(chosen)]
        swaps = Swaps(self.limits, np.array(chosen), np.array(chosen))
        added = self._first_addition(chosen, [g for g in others if swaps.room[g]], loss)
        if added is not None:
            return added
        bounds = self._bounds(chosen, others, loss)
        movable = np.array([g not in self.limits.fixed for g in chosen])
        may = np.array([swaps.out(g) for g in others], dtype=bool).reshape(len(others), len(chosen)).T
        least = np.where(movable[:, None] & may, bounds.max(axis=0), np.inf)
        for at in tied_order(least.ravel()):
            i, j = divmod(int(at), len(others))
            if least[i, j] >= enough or self.solves >= self.limit:
                break
            out, into = chosen[i], others[j]
            swapped = sorted({*chosen, into} - {out})
            likely = [chosen[g] for g in tied_order(-bounds[:, i, j]) if g != i]
            new = self.losses(swapped, (fatal, enough), [into, *likely], {into: loss[out]})
            if new:
                return out, into, new
        return None

    def _first_addition(
        self, chosen: list[int], room: list[int], loss: dict[int, float]
    ) -> tuple[int, int, dict[int, float]] | None:
        """The gauge that fits beside all of the set and helps, as a swap for −1: L ≥ f(S − g + j) ≥ agg(f_s − φᵍ_j)."""
        if not room:
            return None
        fatal, largest = measure(loss)
        enough = largest * (1 - TIE)
        least = np.full(len(room), -np.inf)
        for f, phi in self._failed(chosen) if measure(loss)[0] == 0 else ():
            least = np.maximum(least, aggregated(f[:, None] - phi[:, room], self.aggregate))
        for at in tied_order(least):
            if least[at] >= enough or self.solves >= self.limit:
                break
            new = self.losses(sorted([*chosen, room[at]]), (fatal, enough))
            if new:
                return -1, room[at], new
        return None

    def _bounds(self, chosen: list[int], others: list[int], loss: dict[int, float]) -> np.ndarray:
        """(k, k, others): the least cost when g fails after i was swapped for j; g = i stands for the failure of j."""
        k = len(chosen)
        bounds = np.full((k, k, len(others)), -np.inf)
        # where a failure is fatal, another gauge's may become so: no loss bounds the largest of the others
        if measure(loss)[0]:
            return bounds
        for g, (f, phi) in enumerate(self._failed(chosen)):
            bounds[g] = aggregated(f[:, None, None] + phi[:, chosen, None] - phi[:, None, others], self.aggregate)
            bounds[g, g] = loss[chosen[g]]
        return bounds

    def _failed(self, chosen: list[int]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """f (s,) and φ (s, pool) of the set without each of its gauges."""
        for failing in chosen:
            rest = [other for other in chosen if other != failing]
            level, slope = [], []
            for pool, P in zip(self.pools, covariances_of(self.pools, rest) or (), strict=True):
                loop = loop_of(pool, rest, P)
                level.append(pool.metric.value(P))
                slope.append(gauge_gradients(loop, pool.rows, pool.metric.gradient(P)))
            self.solves += len(self.pools)
            yield np.array(level), np.array(slope)


def measure(loss: dict[int, float]) -> tuple[int, float]:
    """How many failures lose an unknown or are not solved, and the largest loss of the others."""
    finite = [value for value in loss.values() if value < np.inf]
    return len(loss) - len(finite), max(finite, default=0.0)
