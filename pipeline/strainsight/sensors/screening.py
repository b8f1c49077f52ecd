"""Screening: which candidates are worth an exact ranking (thesis 5.2)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
from scipy.spatial import cKDTree

from strainsight.errors import InfeasibleError
from strainsight.ordering import tied_order

KEPT, WEAK, NEAR, BEYOND, CLEARANCE, BEND = "", "snr", "spacing", "range", "clearance", "bend"
"""Why a gauge was dropped; that it is too near to an edge, a support or a load, and that the surface bends too tightly for it, is
found before."""
TIE = 1e-8
"""Signals within this share of the strongest are ties; between processors, BLAS and solvers they differ by up to 3e-11 of it."""


@dataclass(frozen=True)
class Screening:
    """kept (k,) gauge numbers, ascending; snr (gauges,) [-]; reason (gauges,) why a gauge was dropped: "range" (its reading
    goes beyond what it can measure), "snr" (weaker than all that were kept), "spacing" (too near to a stronger one that was
    kept), "" for those kept."""

    kept: np.ndarray
    snr: np.ndarray
    reason: np.ndarray


def screen(
    rms: np.ndarray,
    noise_std: np.ndarray | float,
    position: np.ndarray,
    keep: int | None,
    minimum_spacing: float,
    *,
    gauge: np.ndarray | None = None,
    bonded: np.ndarray | None = None,
    largest: np.ndarray | None = None,
    limit: np.ndarray | None = None,
    also_at: tuple[np.ndarray, np.ndarray] | None = None,
) -> Screening:
    """Bonded gauges, then best first by signal-to-noise, nothing within the spacing of one already kept, `keep` at most:

        snr² = Σ (rms / σ)² over the channels of a gauge

    Of several load cases each takes in turn the best in it that is still free: one of quiet readings has its share of those that
    are kept. snr is that of the case where it is largest.
    Of every channel (m,): rms of the training response, of several load cases (cases, m), and noise_std σ in its unit (σ may be
    one number for all); position (m, 3) [m]; gauge number of its gauge, ascending without holes (None: each channel its own);
    bonded, whether it is already in place: kept whatever it reads; largest, the peak of the training response, and limit, what
    it can measure at most (inf: anything): a gauge with a channel beyond is dropped. also_at: further places (a, 3) [m], and the
    gauges (a,) that sit there too, as arms of bridges do.
    keep: how many at most, bonded ones included, None for all that are left; minimum_spacing [m] (0: no thinning;
    gauges of one facet have no distance). Of ties the lower number wins.
    Raises InfeasibleError where none is left or more than `keep` are bonded, for noise that is not positive and responses that
    are not finite.
    """
    rms, position = np.atleast_2d(np.asarray(rms, dtype=float)), np.asarray(position, dtype=float)
    std = np.broadcast_to(np.asarray(noise_std, dtype=float), rms.shape[1])
    number = np.arange(len(std)) if gauge is None else np.asarray(gauge)
    _check(rms, std)
    first = np.flatnonzero(np.diff(number, prepend=-1) != 0)
    count, place = len(first), position[first]
    in_case = np.array([_root_of_squares(own / std, first) for own in rms])
    snr = in_case.max(axis=0)
    fixed = np.zeros(count, dtype=bool) if bonded is None else np.asarray(bonded, dtype=bool)[first]
    reason = np.full(count, WEAK, dtype="<U7")
    if largest is not None and limit is not None:
        over = np.asarray(largest) > np.asarray(limit)
        reason[np.bincount(number, weights=over, minlength=count) > 0] = BEYOND
        reason[fixed] = WEAK
    wanted = count if keep is None else keep
    bonded_ones = int(np.count_nonzero(fixed))
    if wanted < max(1, bonded_ones):
        raise InfeasibleError(
            f"{wanted} of {count} candidates to keep" + (f", {bonded_ones} are already bonded" if bonded_ones else ""),
            remedy=f"keep at least {max(1, bonded_ones)}",
        )
    owner = np.arange(count)
    if also_at is not None:
        place, owner = np.concatenate([place, also_at[0]]), np.append(owner, also_at[1])
    places = np.split(np.argsort(owner, kind="stable"), np.cumsum(np.bincount(owner, minlength=count))[:-1])
    neighbours = cKDTree(place) if minimum_spacing > 0 else None
    kept: list[int] = []
    free = (reason == WEAK) & ~fixed
    for index in chain(np.flatnonzero(fixed).tolist(), _in_turn([strongest_first(own) for own in in_case], free)):
        if len(kept) == wanted:
            break
        free[index] = False
        if neighbours is not None:
            found = neighbours.query_ball_point(place[places[index]], minimum_spacing * (1 - 1e-9))
            near = owner[np.concatenate([np.asarray(own, dtype=np.int64) for own in found])]
            reason[near[reason[near] == WEAK]] = NEAR
            free[near] = False
        kept.append(index)
    # What the best have crowded out stays so marked; what is weaker than the last one kept was never weighed.
    reason[kept] = KEPT
    if not kept:
        raise InfeasibleError(
            f"all {count} candidates read more than their range",
            key="gauges.range",
            remedy="choose gauges of a larger range (gauges.range, or that of gauges.type), or check the amplitude of the loads",
        )
    return Screening(np.sort(np.array(kept, dtype=np.int64)), snr, reason)


def _in_turn(falling: Sequence[np.ndarray], free: np.ndarray) -> Iterator[int]:
    """Of every order of places in turn the first that is still free, until none is; free (n,) may change meanwhile."""
    rest = [iter(own.tolist()) for own in falling]
    while rest:
        for own in tuple(rest):
            index = next((i for i in own if free[i]), None)
            if index is None:
                rest.remove(own)
            else:
                yield index


def strongest_first(snr: np.ndarray) -> np.ndarray:
    """Places of the signals (m,), the strongest first, ties in the order of their places."""
    return tied_order(-snr, least=TIE * float(snr.max(initial=0.0)), share=0.0)


def _check(rms: np.ndarray, std: np.ndarray) -> None:
    bad = ~(np.isfinite(std) & (std > 0))
    if bad.any():
        raise InfeasibleError(f"the gauge noise is {std[bad][0]:g}", remedy="give a positive standard deviation")
    if not np.isfinite(rms).all():
        raise InfeasibleError(
            f"{np.count_nonzero(~np.isfinite(rms).all(axis=0))} candidates have no finite response",
            remedy="check the training signal",
        )


def _root_of_squares(ratio: np.ndarray, first: np.ndarray) -> np.ndarray:
    """√Σ ratio² of the channels from each `first` to the next."""
    if not len(first):
        return np.zeros(0)
    scale = np.abs(ratio).max(initial=0.0) or 1.0
    return scale * np.sqrt(np.add.reduceat((ratio / scale) ** 2, first))
