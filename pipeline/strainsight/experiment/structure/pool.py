"""Pool of a placement: candidates as single rows or as mirrored pairs, and their prices."""

from __future__ import annotations

import numpy as np

from strainsight.config.placement import PlacementConfig, Symmetry
from strainsight.errors import InfeasibleError, blame
from strainsight.experiment.layout.task import PoolRows
from strainsight.experiment.structure.candidates import CandidateChannels
from strainsight.experiment.structure.references import families
from strainsight.sensors.candidates import Candidates
from strainsight.sensors.symmetry import mirror_partners


def pool_of(
    selected: np.ndarray, channels: CandidateChannels, candidates: Candidates, symmetry: Symmetry | None
) -> PoolRows:
    """Screened gauges (k,) as pool rows: single, or with a symmetry plane as mirrored pairs.

    Bonded gauges and gauges on the plane stay single; others without a mirror image in the pool are omitted. Raises
    InfeasibleError if nothing is left."""
    if symmetry is None:
        return PoolRows(selected[:, None], channels.of(selected), 0)
    with blame("place.symmetry"):
        partner = mirror_partners(candidates, symmetry.point, symmetry.normal)
    bonded, in_pool, pairs = candidates.bonded[candidates.first], np.isin(np.arange(channels.gauges), selected), []
    for gauge in selected:
        other = int(partner[gauge])
        if bonded[gauge] or other == gauge:
            pairs.append((int(gauge), -1))
        elif other > gauge and in_pool[other] and not bonded[other]:
            pairs.append((int(gauge), other))
    if not pairs:
        raise InfeasibleError(
            f"none of the {len(selected)} candidates selected by the stage `screen` has a mirror image among these candidates",
            key="place.symmetry",
            remedy="Check the symmetry plane, keep more candidates (screen.keep: all), or use a mirrored mesh.",
        )
    gauges = np.array(pairs)
    first, second = channels.of(gauges[:, 0]), channels.of(np.maximum(gauges[:, 1], 0))
    second[gauges[:, 1] < 0] = -1
    return PoolRows(gauges, _left_aligned(np.hstack([first, second])), len(selected) - int((gauges >= 0).sum()))


def prices(config: PlacementConfig, pool: PoolRows, candidates: Candidates) -> np.ndarray:
    """Price of every pool row (p,); bonded gauges cost nothing."""
    family = np.array([float(entry.price) for entry in families(config).values()])
    first = candidates.first[pool.flat[0]]
    return pool.summed(np.where(candidates.bonded[first], 0.0, family[candidates.array[first]]))


def _left_aligned(channels: np.ndarray) -> np.ndarray:
    """Move the channels of every row to the front, −1 behind, and drop unused columns."""
    moved = np.take_along_axis(channels, np.argsort(channels < 0, axis=1, kind="stable"), axis=1)
    return moved[:, (moved >= 0).any(axis=0)]
