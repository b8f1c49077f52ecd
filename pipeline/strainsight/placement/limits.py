"""Limits of a layout: number of gauges, fixed gauges, spacing, zones, and budget."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import linprog, minimize
from scipy.sparse import csc_array, csr_array, vstack

from strainsight.errors import ConfigError

KEEP, FIXED, SPACING, BUDGET = "place.keep", "gauges.fixed", "place.minimum_spacing", "place.budget"
"""Config keys of the limits; zones have their own keys."""
ROUNDED = 1e-9
"""Relative excess of prices over the budget that counts as rounding."""


@dataclass(frozen=True)
class Limits:
    """Layouts v ∈ {0, 1}^pool with rows·v ≤ most, least ≤ Σ size·v, v = 1 on fixed rows of the pool. rows (constraints, pool)
    ≥ 0; most (constraints,); names: dotted config key of every constraint, the same for all of one key; size (pool,): gauges
    in every pool row, 2 in a mirrored pair; keep: most gauges, rows[0] = size; least: 0 under a budget, else keep, less what
    a row of more than one gauge may leave over; key: config key of the fixed ones. A part of a layout breaks no limit."""

    rows: csr_array
    most: np.ndarray
    names: tuple[str, ...]
    fixed: frozenset[int]
    size: np.ndarray
    keep: int
    least: int
    key: str = FIXED

    @property
    def plain(self) -> bool:
        """Whether any `keep` rows of the pool that contain the fixed ones are a layout."""
        return len(self.most) == 1 and self.least == self.keep and bool(np.all(self.size == 1))

    @cached_property
    def columns(self) -> csc_array:
        """The same constraints, gauge by gauge."""
        return csc_array(self.rows)

    @cached_property
    def labels(self) -> np.ndarray:
        """Label of each pool row (pool,), the same if the limits do not distinguish two rows."""
        c = self.columns
        labels: dict[tuple[bytes, bytes], int] = {}
        keys = [(c.indices[a:b].tobytes(), c.data[a:b].tobytes()) for a, b in zip(c.indptr, c.indptr[1:], strict=False)]
        return np.array([labels.setdefault(key, len(labels)) for key in keys])

    def column(self, gauge: int) -> tuple[np.ndarray, np.ndarray]:
        """Constraints of a gauge, and its amount in each."""
        part = slice(self.columns.indptr[gauge], self.columns.indptr[gauge + 1])
        return self.columns.indices[part], self.columns.data[part]

    def used(self, gauges: np.ndarray) -> np.ndarray:
        """Amount of each limit (constraints,) used by a set, given by index or as a mask (pool,)."""
        chosen = np.zeros(len(self.size))
        chosen[gauges] = 1.0
        return np.asarray(self.rows @ chosen)

    def allows(self, gauges: np.ndarray) -> bool:
        """Whether a set, by index or as a mask, is a layout."""
        chosen = np.zeros(len(self.size), dtype=bool)
        chosen[gauges] = True
        complete = bool(chosen[list(self.fixed)].all()) and int(self.size[chosen].sum()) >= self.least
        return complete and bool(np.all(self.used(chosen) <= self.most))

    def fits(self, used: np.ndarray, gauge: int) -> bool:
        """Whether a set that uses `used` of the limits may contain this gauge, too."""
        at, part = self.column(gauge)
        return bool(np.all(used[at] + part <= self.most[at]))

    def too_large(self, used: np.ndarray) -> np.ndarray:
        """Mask (pool,) of the rows that do not fit in addition to a set that uses `used` of the limits."""
        room = np.repeat(self.most - used, np.diff(self.rows.indptr))
        excluded = np.zeros(len(self.size), dtype=bool)
        excluded[self.rows.indices[self.rows.data > room]] = True
        return excluded

    def packed(self, order: Iterable[int], start: np.ndarray) -> np.ndarray:
        """start, by index or as a mask, then each gauge of `order` that still fits; ascending indices."""
        chosen = np.zeros(len(self.size), dtype=bool)
        chosen[start] = True
        used = self.used(chosen)
        for gauge in order:
            if used[0] >= self.keep:
                break
            if not chosen[gauge] and self.fits(used, gauge):
                at, part = self.column(gauge)
                used[at] += part
                chosen[gauge] = True
        return np.flatnonzero(chosen)


def limits_of(
    pool: int,
    keep: int,
    *,
    fixed: Collection[int] = (),
    size: np.ndarray | None = None,
    price: np.ndarray | None = None,
    budget: float | None = None,
    near: np.ndarray | None = None,
    zones: Sequence[tuple[str, np.ndarray, int]] = (),
    key: str = FIXED,
) -> Limits:
    """The `Limits` of a pool of so many rows. fixed: rows that stay and count; size (pool,): gauges in each, 1 where not
    given; price (pool,) ≥ 0 and budget: with a budget `keep` is an upper limit; near (p, 2): rows that may not both be kept,
    of which two fixed ones are as they are, and with twice the same a row that may not be kept at all; zones: (config key,
    members (pool,), at most so many), members bool, or how many gauges of the row lie inside; key: dotted config key of the
    fixed ones. Raises ConfigError where the pool is smaller than `keep` or the fixed gauges are more."""
    sizes = np.ones(pool, dtype=int) if size is None else np.asarray(size, dtype=int)
    fixed_rows = frozenset(int(g) for g in fixed)
    bonded, total = int(sizes[list(fixed_rows)].sum()), int(sizes.sum())
    if not max(1, bonded) <= keep <= total:
        raise ConfigError(
            f"cannot keep {keep} of the {total} candidate gauges, of which {bonded} are bonded",
            remedy=f"keep between {max(1, bonded)} and {total} gauges (place.keep)",
        )
    entries: list[tuple[str, np.ndarray, float]] = [(KEEP, sizes, keep), *zones]
    if budget is not None:
        entries.append((BUDGET, np.ones(pool) if price is None else price, budget * (1 + ROUNDED)))
    names, rows, most = zip(*entries, strict=True)
    parts = [csr_array(np.array(rows, dtype=float))]
    pairs = np.zeros((0, 2), dtype=int) if near is None else np.asarray(near, dtype=int).reshape(-1, 2)
    alone = np.unique(pairs[pairs[:, 0] == pairs[:, 1], 0])
    groups = [*_groups(pairs[~np.isin(pairs, list(fixed_rows)).all(axis=1)]), *alone[:, None]]
    if groups:
        at = np.concatenate([np.full(len(group), i) for i, group in enumerate(groups)])
        parts.append(csr_array((np.ones(len(at)), (at, np.concatenate(groups))), shape=(len(groups), pool)))
    matrix = csr_array(vstack(parts))
    matrix.sort_indices()
    loose = np.delete(sizes, list(fixed_rows))
    return Limits(
        rows=matrix,
        most=np.concatenate([most, np.ones(len(groups) - len(alone)), np.zeros(len(alone))]),
        names=(*names, *[SPACING] * len(groups)),
        fixed=fixed_rows,
        size=sizes,
        keep=keep,
        least=0 if budget is not None else max(bonded, keep + 1 - int(loose.max(initial=1))),
        key=key,
    )


class Swaps:
    """Swaps permitted by the limits. room (pool,) bool: gauges that fit in addition to the whole set."""

    def __init__(self, limits: Limits, chosen: np.ndarray, movable: np.ndarray):
        self.limits = limits
        self.used = limits.used(chosen)
        self.room = ~limits.too_large(self.used)
        self.room[chosen] = False
        self._parts = limits.columns[:, movable].toarray()
        self._size = limits.size[movable]

    def out(self, into: int) -> np.ndarray:
        """Mask (k,) of the movable gauges that may leave for this one."""
        at, part = self.limits.column(into)
        over = self.used[at] + part - self.limits.most[at]
        enough = self.used[0] + self.limits.size[into] - self._size >= self.limits.least
        return np.asarray(enough & np.all(self._parts[at] >= over[:, None], axis=0))


def as_limits(pool: int, keep: int | Limits) -> Limits:
    """Limits of a plain count, or the given limits."""
    if isinstance(keep, Limits):
        if len(keep.size) != pool:
            raise ValueError(f"the limits are for {len(keep.size)} candidate gauges, but the problem has {pool}")
        return keep
    return limits_of(pool, keep)


def _groups(pairs: np.ndarray) -> list[np.ndarray]:
    """Sets of rows of which at most one may be selected, covering all pairs: larger sets give tighter bounds."""
    neighbours: dict[int, set[int]] = {}
    for a, b in pairs.tolist():
        if a != b:
            neighbours.setdefault(a, set()).add(b)
            neighbours.setdefault(b, set()).add(a)
    missing = {a: set(others) for a, others in neighbours.items()}
    groups = []
    for a in sorted(neighbours):
        while missing[a]:
            b = min(missing[a])
            group, common = {a, b}, neighbours[a] & neighbours[b]
            while common:
                new = min(common & missing[a] or common)
                group.add(new)
                common = common & neighbours[new]
            for g in group:
                missing[g] -= group
            groups.append(np.array(sorted(group)))
    return groups


class Polytope:
    """{0 ≤ w ≤ 1, rows·w ≤ most, least ≤ Σ size·w, w = 1 on fixed gauges}, which contains every layout."""

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

        To the accuracy of the dual's search if there are limits other than the count."""
        projected = np.ones_like(w)
        free = w[~self.fixed]
        if self.limits.plain:
            projected[~self.fixed] = self._clipped(free)
            return projected

        def dual(multiplier: np.ndarray) -> tuple[float, np.ndarray]:
            v = np.clip(free - self._across @ multiplier, 0, 1)
            over = self._rows @ v - self._most
            return -float(0.5 * np.sum((v - free) ** 2) + multiplier @ over), -over

        solution = minimize(
            dual,
            self._multiplier,
            jac=True,
            method="L-BFGS-B",
            bounds=[(0, None)] * len(self._most),
            options={"maxiter": 500, "ftol": 1e-15, "gtol": 1e-10, "maxcor": 20},
        )
        self._multiplier = solution.x
        projected[~self.fixed] = np.clip(free - self._across @ solution.x, 0, 1)
        return projected

    def least(self, slope: np.ndarray) -> tuple[float, np.ndarray]:
        """Lower bound of slope·v over the region, its least up to rounding: by sorting, or by multipliers of a program; and by
        how much it rises where a gauge is taken (pool,), v_g = 1.

            slope·v ≥ (slope + λᵀA)·v − λᵀb for any λ ≥ 0,     with v_g = 1 more by max(0, (slope + λᵀA)_g)

        The bounds do not depend on the tolerances of the program."""
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

    slope (k,), size (k,) ≥ 1. Infinity where the sum cannot reach `least`, or `most` is negative."""
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
