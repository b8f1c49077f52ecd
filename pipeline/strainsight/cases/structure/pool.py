"""The pool of a structure: its gauges, each alone or with a plane of symmetry in mirrored pairs; what they cost."""

from __future__ import annotations

import numpy as np

from strainsight.cases.layout.pool import PoolRows
from strainsight.cases.structure.channels import Channels
from strainsight.cases.structure.settings import families
from strainsight.config.placement import PlacementConfig, Symmetry
from strainsight.errors import InfeasibleError, blame
from strainsight.gauges.candidates import Candidates
from strainsight.gauges.symmetry import mirror_partners


def pool_of(kept: np.ndarray, channels: Channels, candidates: Candidates, symmetry: Symmetry | None) -> PoolRows:
    """The kept gauges as pool rows: each alone, or with a plane of symmetry in mirrored pairs.

    kept (k,) gauge numbers. Those on the plane that are their own mirror image are alone, as are bonded ones; others without
    a mirror image in the pool are left out. Raises InfeasibleError where nothing is left.
    """
    if symmetry is None:
        return PoolRows(kept[:, None], channels.of(kept), 0)
    with blame("place.symmetry"):
        partner = mirror_partners(candidates, symmetry.point, symmetry.normal)
    bonded = np.zeros(channels.gauges, dtype=bool)
    bonded[candidates.gauge[candidates.bonded]] = True
    there = np.zeros(channels.gauges, dtype=bool)
    there[kept] = True
    pairs = []
    for gauge in kept:
        other = int(partner[gauge])
        if bonded[gauge] or other == gauge:
            pairs.append((int(gauge), -1))
        elif other > gauge and there[other] and not bonded[other]:
            pairs.append((int(gauge), other))
    if not pairs:
        raise InfeasibleError(
            f"none of the {len(kept)} gauges of the pool has a mirror image in it",
            key="place.symmetry",
            remedy="check the plane, keep more candidates (screen.keep: all), or mirror the mesh",
        )
    gauges = np.array(pairs)
    first, second = channels.of(gauges[:, 0]), channels.of(np.maximum(gauges[:, 1], 0))
    second[gauges[:, 1] < 0] = -1
    return PoolRows(gauges, _left_aligned(np.hstack([first, second])), len(kept) - int((gauges >= 0).sum()))


def prices(config: PlacementConfig, pool: PoolRows, candidates: Candidates) -> np.ndarray:
    """Price of every pool row (p,); gauges already bonded cost nothing."""
    family = np.array([float(entry.price) for entry in families(config).values()])
    first = candidates.first[pool.flat[0]]
    return pool.summed(np.where(candidates.bonded[first], 0.0, family[candidates.array[first]]))


def _left_aligned(channels: np.ndarray) -> np.ndarray:
    """The channels of every row in front, −1 behind them, without columns that no row needs."""
    order = np.argsort(channels < 0, axis=1, kind="stable")
    moved = np.take_along_axis(channels, order, axis=1)
    return moved[:, (moved >= 0).any(axis=0)]
