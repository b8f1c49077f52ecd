"""Screening: preselection of candidates for the ranking."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
from scipy.spatial import cKDTree

from strainsight.errors import InfeasibleError
from strainsight.ordering import tied_order

KEPT, WEAK, NEAR, OVER_RANGE = "", "snr", "spacing", "range"
"""Reasons for dropping a gauge."""
CLEARANCE, BEND, BORE, ENCLOSED, LOADED = UNSUITABLE = "clearance", "bend", "bore", "enclosed", "loaded"
"""Reasons that are checked before: the place is unsuitable, whatever the gauge reads."""
TIE = 1e-8
"""Largest difference of equal signals, as a share of the strongest; processors, BLAS and solvers differ by up to 3e-11."""


@dataclass(frozen=True)
class Screening:
    """kept (k,) gauge numbers, ascending; snr (gauges,) [-]; reason (gauges,) for dropping a gauge: "range" (its reading exceeds
    its measuring range), "snr" (weaker than all selected ones), "spacing" (too near to a stronger selected one), "" if
    selected."""

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
    """Select bonded gauges, then the best by signal-to-noise ratio, none within the spacing of a selected one, at most `keep`:

        snr² = Σ (rms / σ)² over the channels of a gauge

    With several load cases, each in turn selects its best remaining gauge, so that a case with small readings has its share. snr
    is that of the case with the largest value.
    For every channel (m,): rms of the training response, for several load cases (cases, m), and noise_std σ in its unit (or one
    number for all); position (m, 3) [m]; gauge: number of its gauge, ascending without gaps (None: each channel is a gauge);
    bonded: whether it is installed, and so always selected; largest: peak of the training response, and limit: measuring range
    (inf: unlimited); a gauge with a channel over range is dropped. also_at: further positions (a, 3) [m], and the gauges (a,)
    there, such as arms of bridges.
    keep: maximum number, bonded ones included, None for no maximum; minimum_spacing [m] (0: no thinning; gauges of one facet
    have no distance). Of equal gauges the lower number wins.
    Raises InfeasibleError if no gauge remains or more than `keep` are bonded, for noise that is not positive and responses that
    are not finite."""
    rms, position = np.atleast_2d(np.asarray(rms, dtype=float)), np.asarray(position, dtype=float)
    std = np.broadcast_to(np.asarray(noise_std, dtype=float), rms.shape[1])
    number = np.arange(len(std)) if gauge is None else np.asarray(gauge)
    _check(rms, std)
    first = np.flatnonzero(np.diff(number, prepend=-1) != 0)
    count, positions = len(first), position[first]
    in_case = np.array([_root_of_squares(case_rms / std, first) for case_rms in rms])
    snr = in_case.max(axis=0)
    fixed = np.zeros(count, dtype=bool) if bonded is None else np.asarray(bonded, dtype=bool)[first]
    reason = np.full(count, WEAK, dtype="<U7")
    if largest is not None and limit is not None:
        over = np.asarray(largest) > np.asarray(limit)
        reason[np.bincount(number, weights=over, minlength=count) > 0] = OVER_RANGE
        reason[fixed] = WEAK
    wanted = count if keep is None else keep
    bonded_ones = int(np.count_nonzero(fixed))
    if wanted < max(1, bonded_ones):
        raise InfeasibleError(
            f"screen.keep selects only {wanted} of {count} candidate gauges"
            + (f", but the number of bonded gauges is {bonded_ones} (always selected)" if bonded_ones else ""),
            remedy=f"Set screen.keep to at least {max(1, bonded_ones)}.",
        )
    owner = np.arange(count)
    if also_at is not None:
        positions, owner = np.concatenate([positions, also_at[0]]), np.append(owner, also_at[1])
    positions_of_gauge = np.split(np.argsort(owner, kind="stable"), np.cumsum(np.bincount(owner, minlength=count))[:-1])
    neighbours = cKDTree(positions) if minimum_spacing > 0 else None
    selected: list[int] = []
    free = (reason == WEAK) & ~fixed
    for index in chain(
        np.flatnonzero(fixed).tolist(), _in_turn([strongest_first(case_snr) for case_snr in in_case], free)
    ):
        if len(selected) == wanted:
            break
        free[index] = False
        if neighbours is not None:
            hits = neighbours.query_ball_point(positions[positions_of_gauge[index]], minimum_spacing * (1 - 1e-9))
            near = owner[np.concatenate([np.asarray(hit, dtype=np.int64) for hit in hits])]
            reason[near[reason[near] == WEAK]] = NEAR
            free[near] = False
        selected.append(index)
    # gauges that are weaker than the last selected one keep the reason "snr"
    reason[selected] = KEPT
    if not selected:
        raise InfeasibleError(
            f"the readings of every candidate gauge exceed its measuring range (number of candidates: {count})",
            key="gauges.range",
            remedy="Increase the measuring range (gauges.range or gauges.type), or check the amplitude of the loads.",
        )
    return Screening(np.sort(np.array(selected, dtype=np.int64)), snr, reason)


def _in_turn(falling: Sequence[np.ndarray], free: np.ndarray) -> Iterator[int]:
    """In turn the first remaining index of each order, until none remains; free (n,) may change meanwhile."""
    rest = [iter(order.tolist()) for order in falling]
    while rest:
        for order in tuple(rest):
            if (index := next((i for i in order if free[i]), None)) is None:
                rest.remove(order)
            else:
                yield index


def strongest_first(snr: np.ndarray) -> np.ndarray:
    """Indices of the signals (m,), the strongest first, equal ones in their order."""
    return tied_order(-snr, least=TIE * float(snr.max(initial=0.0)), share=0.0)


def _check(rms: np.ndarray, std: np.ndarray) -> None:
    if (bad := ~(np.isfinite(std) & (std > 0))).any():
        raise InfeasibleError(
            f"the standard deviation of the gauge noise is {std[bad][0]:g}",
            remedy="Specify a positive `gauges.noise_std`.",
        )
    if not np.isfinite(rms).all():
        raise InfeasibleError(
            "readings of candidate gauges in the training simulation (stage `train`) are not finite (number of channels: "
            f"{np.count_nonzero(~np.isfinite(rms).all(axis=0))})",
            remedy="Check the loads of the training simulation.",
        )


def _root_of_squares(ratio: np.ndarray, first: np.ndarray) -> np.ndarray:
    """√Σ ratio² of the channels from each `first` to the next."""
    if not len(first):
        return np.zeros(0)
    scale = np.abs(ratio).max(initial=0.0) or 1.0
    return scale * np.sqrt(np.add.reduceat((ratio / scale) ** 2, first))
