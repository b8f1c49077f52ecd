"""What a smoother found, and which of its covariances are kept: those of every instant of a long record are too many."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strainsight.estimation.update import output_std


@dataclass(frozen=True)
class Wanted:
    """Covariances that are kept of a smoother: rows (r, n*), or (T + 1, r, n*) where they change, of which σ is wanted at every
    instant; states (k,), their
    covariance with one another at every instant; instants (i,), all of it there."""

    rows: np.ndarray
    states: np.ndarray
    instants: np.ndarray


@dataclass(frozen=True)
class Kept:
    """What was wanted: std (T + 1, r), covariance (T + 1, k, k) and then (i, n*, n*)."""

    wanted: Wanted
    std: np.ndarray
    covariance: np.ndarray
    then: np.ndarray


@dataclass(frozen=True)
class Smoothed:
    """mean, std (T + 1, B, n*) of x* given all measurements; covariance (T + 1, b, n*, n*) where all of it was asked for, kept
    where some was; time [s]."""

    time: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    covariance: np.ndarray | None
    kept: Kept | None = None

    def std_of(self, rows: np.ndarray) -> np.ndarray:
        """σ (T + 1, r) of rows (r, n*) or (T + 1, r, n*) of x* in the first run. Raises ValueError where it was not kept."""
        if self.covariance is not None:
            return output_std(rows, self.covariance[:, 0])
        own = self._kept()
        if own.wanted.rows.ndim > 2:
            if not np.array_equal(rows, own.wanted.rows):
                raise ValueError("the smoother has not kept the variance of these rows")
            return own.std
        at = [np.flatnonzero((own.wanted.rows == row).all(axis=1)) for row in rows]
        if not all(len(found) for found in at):
            raise ValueError("the smoother has not kept the variance of this row")
        return own.std[:, [found[0] for found in at]]

    def covariance_of(self, states: np.ndarray) -> np.ndarray:
        """Of some states (k,) in the first run: (T + 1, k, k). Raises ValueError where it was not kept."""
        if self.covariance is not None:
            return self.covariance[:, 0][:, states[:, None], states]
        own = self._kept()
        at = _places(states, own.wanted.states)
        return own.covariance[:, at[:, None], at]

    def covariance_at(self, k: int) -> np.ndarray:
        """Of x* (n*, n*) at instant k in the first run. Raises ValueError where it was not kept."""
        if self.covariance is not None:
            return np.asarray(self.covariance[k, 0])
        own = self._kept()
        return np.asarray(own.then[_places(np.array([k]), own.wanted.instants)[0]])

    def without_sigma(self) -> Smoothed:
        """NaN for σ and covariance, so that whatever is computed from them is NaN too."""
        none = np.nan
        kept, whole = self.kept, self.covariance
        if kept is not None:
            kept = replace(kept, std=none * kept.std, covariance=none * kept.covariance, then=none * kept.then)
        return replace(self, std=none * self.std, covariance=None if whole is None else none * whole, kept=kept)

    def _kept(self) -> Kept:
        if self.kept is None:
            raise ValueError("the smoother has kept no covariance")
        return self.kept


def _places(wanted: np.ndarray, there: np.ndarray) -> np.ndarray:
    at = [np.flatnonzero(there == one) for one in wanted]
    if not all(len(found) for found in at):
        raise ValueError("the smoother has not kept this covariance")
    return np.array([found[0] for found in at], dtype=int)


class Keeping:
    """The arrays of the covariances that are kept while a smoother runs over T + 1 instants of n* states."""

    def __init__(self, wanted: Wanted | None, instants: int, n: int):
        self.covariance = np.zeros((instants, 1, n, n)) if wanted is None else None
        self.kept: Kept | None = None
        if wanted is not None:
            r, k, i = wanted.rows.shape[-2], len(wanted.states), len(wanted.instants)
            self.kept = Kept(wanted, np.zeros((instants, r)), np.zeros((instants, k, k)), np.zeros((i, n, n)))

    def take(self, at: slice, covariance: np.ndarray) -> None:
        """covariance (L, n*, n*) of a piece."""
        if self.covariance is not None:
            self.covariance[at, 0] = covariance
        if (own := self.kept) is not None:
            states, instants = own.wanted.states, own.wanted.instants
            rows = own.wanted.rows
            own.std[at] = output_std(rows[at] if rows.ndim > 2 else rows, covariance)
            own.covariance[at] = covariance[:, states[:, None], states]
            here = np.flatnonzero((at.start <= instants) & (instants < at.stop))
            own.then[here] = covariance[instants[here] - at.start]
