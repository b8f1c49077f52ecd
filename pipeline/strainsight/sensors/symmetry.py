"""Gauges that are mirror images of each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from strainsight.sensors.candidates import Candidates
from strainsight.sensors.surface import unit_vector

NEARLY = 1e-5
"""Largest difference of positions from mirror images, as a share of the extent of the candidates."""
ASKEW = 0.1
"""Largest difference of directions from mirror images [deg]."""


def mirror_partners(candidates: Candidates, point: Sequence[float], normal: Sequence[float]) -> np.ndarray:
    """The mirror image of every gauge at the plane through a point (3,) [m] with a normal (3,): (gauges,), −1 without any:

        x′ = x − 2 ((x − p)·n) n,     d′ = ± (d − 2 (d·n) n)

    Gauges are mirror images if their positions agree to NEARLY of the extent of the candidates, the directions of their channels
    up to sign and 0.1°, in any order, and if quantity, family, length of the grid and `bonded` are equal. A gauge on the plane
    can be its own image. Raises UserError for a normal of zero length."""
    n = unit_vector(normal, "the normal of the symmetry plane")
    first = candidates.first
    partner = np.full(len(first), -1)
    if not len(first):
        return partner
    x = candidates.position[first]
    image = x - 2 * ((x - np.asarray(point, dtype=float)) @ n)[:, None] * n
    reach = NEARLY * float(np.linalg.norm(np.ptp(x, axis=0)))
    # several gauges may share a position: all pairs there, then those with equal directions
    near = cKDTree(x).query_ball_point(image, max(reach, np.finfo(float).tiny))
    i = np.repeat(np.arange(len(first)), [len(neighbours) for neighbours in near])
    j = np.array([gauge for neighbours in near for gauge in neighbours], dtype=np.int64)
    is_mirrored = _directions_mirror(candidates, n, i, j)
    for name in ("quantity", "array", "length", "bonded"):
        value = getattr(candidates, name)[first]
        is_mirrored &= value[i] == value[j]
    i, j = i[is_mirrored], j[is_mirrored]
    distance = np.linalg.norm(image[i] - x[j], axis=1)
    order = np.lexsort((j, np.round(distance / max(reach, np.finfo(float).tiny), 3), i))
    i, j = i[order], j[order]
    lead = np.flatnonzero(np.diff(i, prepend=-1) != 0)
    partner[i[lead]] = j[lead]
    mutual = (partner >= 0) & (partner[partner] == np.arange(len(first)))
    return np.where(mutual, partner, -1)


def _directions_mirror(candidates: Candidates, n: np.ndarray, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Which pairs of gauges (k,) have the same number of channels, each with a mirrored direction of the other up to sign."""
    count = np.bincount(candidates.gauge, minlength=candidates.gauges)
    d = np.zeros((candidates.gauges, int(count.max()), 3))
    d[candidates.gauge, np.arange(len(candidates)) - candidates.first[candidates.gauge]] = candidates.direction
    mirrored = d[i] - 2 * (d[i] @ n)[..., None] * n
    # by the sine, because a cosine near 1 does not resolve small angles
    sine = np.linalg.norm(np.cross(mirrored[:, :, None], d[j][:, None]), axis=-1)
    both = np.any(d[i] != 0, axis=2)[:, :, None] & np.any(d[j] != 0, axis=2)[:, None]
    same = (sine < np.sin(np.deg2rad(ASKEW))) & both
    matched = np.all(same.any(axis=2) == np.any(d[i] != 0, axis=2), axis=1)
    matched &= np.all(same.any(axis=1) == np.any(d[j] != 0, axis=2), axis=1)
    return matched & (count[i] == count[j])
