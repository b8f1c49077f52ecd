"""Lattices over the parameters of a bank: grown until they hold the posterior, and as fine as it asks for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.lattice import NARROW, SHARP, Lattice, lattice_about, moments
from strainsight.estimation.standing import Standing

FRESH = 0.4
"""When a lattice is laid, the variance of its highest peak is at least this share of that it is laid for."""
COLLAPSED = 0.1
"""Share below which the lattice is too coarse for the posterior's covariance."""
PATIENCE = 4
"""Layers that are added on the way uphill before a wider lattice is laid there."""
MOST_POINTS = 4000
MOST_FINE = 1000
"""Points of a lattice that is laid more finely for the sake of its peak; beyond them it stays as it is, and the posterior of a
long narrow crescent is right to a tenth of its σ."""
MOST_LAID = 60
"""Lattices on the way to one that resolves the posterior."""


S = TypeVar("S", bound=Standing[Lattice])


@dataclass(frozen=True)
class Bank(Generic[S]):
    """What lattices are laid for: the prior, mean (k,) and covariance (k, k); spacing of a lattice in standard deviations, depth
    below its largest density to which it reaches, and most of its points; at: lattice, step → the filters at its points after
    so many steps; joined: those of parts of a lattice as one; refuse_lost: raises where a point (k,) is one that nobody means.
    held (q, k): points that every lattice but the first has a node next to, whatever the samples so far say."""

    prior: tuple[np.ndarray, np.ndarray]
    spacing: float
    depth: float
    at: Callable[[Lattice, int], S]
    joined: Callable[[Lattice, Sequence[S]], S]
    refuse_lost: Callable[[np.ndarray], None]
    most: int = MOST_POINTS
    held: np.ndarray | None = None


class _TooMany(NumericalError):
    """The lattice would need more points than it may have."""


def first_lattice(bank: Bank[S]) -> S:
    """For the prior."""
    return _laid(bank, *bank.prior, 0)


def _laid(
    bank: Bank[S],
    mean: np.ndarray,
    covariance: np.ndarray,
    step: int,
    other: np.ndarray | None = None,
    most: int | None = None,
) -> S:
    """A lattice about a guess of the posterior after `step` steps, grown until it holds it, with its filters there.

    Where the largest density stays at its edge the posterior lies elsewhere: it is laid about that point, three times as wide.
    other (q, k): points of other peaks, which it is to hold as well.
    """
    bank.refuse_lost(mean)
    most = min(bank.most, most or bank.most)
    lattice = _lattice(bank, mean, covariance, other)
    parts, outside = [bank.at(lattice, step)], 0
    while True:
        log_weight, edge = np.concatenate([part.log_weight for part in parts]), lattice.edge
        heavy = edge & (log_weight > log_weight.max() - bank.depth)
        if not heavy.any():
            return parts[0] if len(parts) == 1 else bank.joined(lattice, parts)
        best = int(np.argmax(log_weight))
        outside = outside + 1 if edge[best] else 0
        if outside > PATIENCE:
            centre, covariance = lattice.point[best], 9 * covariance
            bank.refuse_lost(centre)
            lattice = _lattice(bank, centre, covariance, other)
            parts, outside = [bank.at(lattice, step)], 0
            continue
        more = replace(lattice, node=lattice.beside(heavy))
        if len(lattice.node) + len(more.node) > most:
            raise _TooMany(
                f"the posterior of the parameters spreads over more than {most} points of its lattice",
                remedy="the measurements hardly distinguish them: estimate fewer, or state a smaller initial standard deviation",
            )
        lattice = lattice.grown(more.node)
        parts.append(bank.at(more, step))


def _lattice(bank: Bank[S], mean: np.ndarray, covariance: np.ndarray, other: np.ndarray | None) -> Lattice:
    """About a guess, with the nodes next to other points (q, k)."""
    lattice = lattice_about(mean, covariance, bank.spacing, np.sqrt(2 * bank.depth))
    return lattice if other is None or not len(other) else lattice.with_nodes(lattice.nearest(other))


def next_lattice(bank: Bank[S], now: S) -> S:
    """A lattice for the posterior as it is now; where that is too narrow for the old one, by way of finer ones, for a power of
    its density. Raises NumericalError where no lattice resolves it."""
    for _ in range(MOST_LAID):
        share, lattice = 1.0, now.cover
        while True:
            top = float(now.log_weight.max())
            # beyond the digits of a logarithm no depth of a lattice is left below its largest value
            if not np.isfinite(now.log_weight).any() or not top - bank.depth < top:
                raise NumericalError(
                    "the readings are beyond what the model can make at any parameters",
                    remedy="check the units and scales of the channels",
                )
            first, *others = lattice.peaks(share * now.log_weight, bank.depth)
            mean, covariance, narrow = _spread(bank, lattice, first, share * now.log_weight[first])
            if narrow >= COLLAPSED:
                break
            share *= 0.5
        if share < 1.0:
            covariance = min(1.0, NARROW / narrow) * covariance
        other = lattice.point[np.concatenate(others)] if others else lattice.point[:0]
        if bank.held is not None:
            other = np.concatenate([other, bank.held])
        now = _laid(bank, mean, covariance, now.step, other)
        if share == 1.0:
            return _sharpened(bank, now, other)
    raise NumericalError(
        f"the posterior of the parameters is too uneven for {MOST_LAID} lattices one finer than the other",
        remedy="state a larger noise of the gauges, or a smaller initial standard deviation of the parameters",
    )


def _spread(
    bank: Bank[S], lattice: Lattice, which: np.ndarray, log_weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean and covariance to lay a lattice for, of points (q,) of this one, and the least variance in its own steps.

    The covariance is that of the density or twice that of its square, whichever is the narrower: of a normal density they are the
    same, of a curved one the second is nearer to that at its peak.
    """

    def least(covariance: np.ndarray) -> float:
        return float(lattice.spread(covariance).min(initial=np.inf) * bank.spacing**2)

    _, mean, plain = moments(lattice.point[which], log_weight)
    squared = 2 * moments(lattice.point[which], 2 * log_weight)[2]
    if COLLAPSED <= least(squared) < least(plain):
        return mean, squared, least(squared)
    return mean, plain, least(plain)


def _sharpened(bank: Bank[S], now: S, other: np.ndarray) -> S:
    """The lattice laid anew, as finely as its highest peak asks for and MOST_FINE allows."""
    for _ in range(MOST_LAID):
        narrow = now.cover.width(now.log_weight).min(initial=np.inf) * bank.spacing**2
        if narrow >= FRESH:
            return now
        frame = now.cover.frame / now.cover.spacing
        covariance = narrow / (2 * SHARP) * frame @ frame.T
        # far from the middle of a lattice that has moved on the way, or that is much too coarse
        middle = now.cover.centre if narrow >= COLLAPSED else now.cover.point[int(np.argmax(now.log_weight))]
        try:
            now = _laid(bank, middle, covariance, now.step, other, MOST_FINE)
        except _TooMany:
            break
    return replace(now, cover=replace(now.cover, sharp=min(SHARP, 0.5 * narrow)))
