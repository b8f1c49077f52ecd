"""Gauges that are mirror images of one another."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from strainsight.sensors.candidates import Candidates
from strainsight.sensors.surface import unit_vector

NEARLY = 1e-5
"""Of the extent of the candidates, by which places may differ from mirror images."""
ASKEW = 0.1
"""Degrees by which directions may differ from mirror images."""


def mirror_partners(candidates: Candidates, point: Sequence[float], normal: Sequence[float]) -> np.ndarray:
    """The mirror image of every gauge at the plane through a point (3,) [m] with a normal (3,): (gauges,), −1 where none:

        x′ = x − 2 ((x − p)·n) n,     d′ = ± (d − 2 (d·n) n)

    Gauges mirror one another if their places do, to NEARLY of the extent of the candidates, the directions of their channels do
    up to sign and 0.1°, in whatever order, and quantity, family, length of the grid and being bonded are the same. A gauge on
    the plane can be its own. Raises UserError for a normal of no length.
    """
    n = unit_vector(normal, "the plane's normal")
    first = candidates.first
    partner = np.full(len(first), -1)
    if not len(first):
        return partner
    x = candidates.position[first]
    image = x - 2 * ((x - np.asarray(point, dtype=float)) @ n)[:, None] * n
    reach = NEARLY * float(np.linalg.norm(np.ptp(x, axis=0)))
    # Several gauges may share a place: all pairs there, then those of like directions.
    near = cKDTree(x).query_ball_point(image, max(reach, np.finfo(float).tiny))
    i = np.repeat(np.arange(len(first)), [len(found) for found in near])
    j = np.array([gauge for found in near for gauge in found], dtype=np.int64)
    alike = _directions_mirror(candidates, n, i, j)
    for name in ("quantity", "array", "length", "bonded"):
        value = getattr(candidates, name)[first]
        alike &= value[i] == value[j]
    i, j = i[alike], j[alike]
    apart = np.linalg.norm(image[i] - x[j], axis=1)
    order = np.lexsort((j, np.round(apart / max(reach, np.finfo(float).tiny), 3), i))
    i, j = i[order], j[order]
    lead = np.flatnonzero(np.diff(i, prepend=-1) != 0)
    partner[i[lead]] = j[lead]
    mutual = (partner >= 0) & (partner[partner] == np.arange(len(first)))
    return np.where(mutual, partner, -1)


def _directions_mirror(candidates: Candidates, n: np.ndarray, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Which pairs of gauges (k,) have as many channels, each with one of the other's directions mirrored up to sign."""
    count = np.bincount(candidates.gauge, minlength=candidates.gauges)
    d = np.zeros((candidates.gauges, int(count.max()), 3))
    d[candidates.gauge, np.arange(len(candidates)) - candidates.first[candidates.gauge]] = candidates.direction
    mirrored = d[i] - 2 * (d[i] @ n)[..., None] * n
    # By the sine, as a cosine near 1 cannot tell small angles.
    sine = np.linalg.norm(np.cross(mirrored[:, :, None], d[j][:, None]), axis=-1)
    both = np.any(d[i] != 0, axis=2)[:, :, None] & np.any(d[j] != 0, axis=2)[:, None]
    same = (sine < np.sin(np.deg2rad(ASKEW))) & both
    matched = np.all(same.any(axis=2) == np.any(d[i] != 0, axis=2), axis=1)
    matched &= np.all(same.any(axis=1) == np.any(d[j] != 0, axis=2), axis=1)
    return matched & (count[i] == count[j])
