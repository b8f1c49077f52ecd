"""Screening: which candidates are worth an exact ranking (thesis 5.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from strainsight.errors import InfeasibleError

KEPT, WEAK, NEAR = "", "snr", "spacing"


@dataclass(frozen=True)
class Screening:
    """kept (k,) candidate indices, ascending; snr (m,) [-]; reason (m,) why a candidate was dropped: "snr" (weaker
    than all that were kept), "spacing" (too near to a stronger one that was kept), "" for those kept."""

    kept: np.ndarray
    snr: np.ndarray
    reason: np.ndarray


def screen(
    rms: np.ndarray, noise_std: float, position: np.ndarray, keep: int | None, minimum_spacing: float
) -> Screening:
    """Best first by signal-to-noise, nothing within the spacing of one already kept, until `keep` are found:

        snr = rms / σ

    rms (m,) [strain] of the training response; noise_std σ [strain]; position (m, 3) [m]; keep the number wanted,
    None for all that the spacing leaves; minimum_spacing [m] (0: no thinning; gauges of one facet in several
    directions have no distance). Signals that differ by less than 1e-9 of the strongest are ties, which the lower
    index wins.
    Raises InfeasibleError where fewer than `keep` are left, for noise that is not positive and responses that are not
    finite.
    """
    rms, position = np.asarray(rms, dtype=float), np.asarray(position, dtype=float)
    if not (np.isfinite(noise_std) and noise_std > 0):
        raise InfeasibleError(f"the gauge noise is {noise_std:g} strain", remedy="give a positive standard deviation")
    if not np.isfinite(rms).all():
        raise InfeasibleError(
            f"{np.count_nonzero(~np.isfinite(rms))} candidates have no finite response",
            remedy="check the training signal",
        )
    wanted = len(rms) if keep is None else keep
    if wanted < 1:
        raise InfeasibleError(f"{wanted} of {len(rms)} candidates to keep", remedy="keep at least 1")
    # Gauges that symmetry makes equal must not be ordered by rounding error.
    order = np.argsort(-np.round(rms / (rms.max(initial=0.0) or 1.0), 9), kind="stable")
    neighbours = cKDTree(position) if minimum_spacing > 0 else None
    reason = np.full(len(rms), WEAK, dtype="<U7")
    kept: list[int] = []
    for index in order:
        if reason[index] == NEAR:
            continue
        if len(kept) == wanted:
            break
        if neighbours is not None:
            reason[neighbours.query_ball_point(position[index], minimum_spacing * (1 - 1e-9))] = NEAR
        kept.append(index)
    # What the best have crowded out stays so marked; what is weaker than the last one kept was never weighed.
    reason[kept] = KEPT
    if keep is not None and len(kept) < keep:
        raise InfeasibleError(
            f"{keep} gauges asked for, {len(kept)} of {len(rms)} candidates lie {minimum_spacing:g} m apart",
            remedy=f"keep at most {len(kept)}, or lower screen.minimum_spacing",
        )
    return Screening(np.sort(np.array(kept, dtype=np.int64)), rms / noise_std, reason)
