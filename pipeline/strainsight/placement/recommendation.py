"""What an engineer can act on: how many gauges are worth it, and which ones are redundant."""

from __future__ import annotations

import numpy as np
from scipy.sparse.csgraph import connected_components

WORTH = 0.05
"""A gauge more is worth it where it lowers σ by this share."""
ALIKE = 0.99
"""Two gauges are redundant where the cosine between their rows is above this."""
NOTHING = 1e-6
"""A gauge of several channels does not read a motion to which it answers with less than this share of its most."""


def gains(cost: np.ndarray) -> np.ndarray:
    """By what share one gauge more lowers σ = √c, from the smallest set on: 1 − √(c(n + 1)/c(n)).

    cost (s,) of an elimination, the whole pool first. Returns (s − 1,) for n = keep, keep + 1, …, pool − 1.
    """
    c = np.asarray(cost, dtype=float)[::-1]
    return 1 - np.sqrt(c[1:] / c[:-1])


def worth_keeping(cost: np.ndarray, keep: int) -> int:
    """The elbow of the trend: fewest gauges n ≥ keep from which no further one lowers σ by 5 % or more.

    cost (pool − keep + 1,) of an elimination, the whole pool first.
    """
    worth = np.flatnonzero(gains(cost) >= WORTH)
    return keep + (int(worth[-1]) + 1 if worth.size else 0)


def alike(rows: np.ndarray) -> list[tuple[int, ...]]:
    """Groups of gauges whose rows (k, n), or (k, c, n) of up to c channels each, span the same space: each within 0.99 of
    another of its group by the smallest cosine of the principal angles between the two, for one channel |cos| of the rows.

    Rows in coordinates of unit training amplitude, so that the cosine is the correlation of what they read: such gauges
    are redundant and only average noise. Spaces of unlike dimension, as of a rosette and a single gauge, never agree.
    """
    blocks = np.reshape(rows, (len(rows), -1, rows.shape[-1]))
    _, sigma, basis = np.linalg.svd(blocks, full_matrices=False)
    rank = np.sum(sigma > NOTHING * sigma[:, :1], axis=1)
    near = np.zeros((len(blocks),) * 2, dtype=bool)
    for r in np.unique(rank[rank > 0]):
        same = np.flatnonzero(rank == r)
        span = basis[same, :r]
        cosines = np.linalg.svd(np.einsum("ain,bjn->abij", span, span), compute_uv=False)
        near[np.ix_(same, same)] = cosines[..., -1] > ALIKE
    _, group = connected_components(near, directed=False)
    members = [tuple(np.flatnonzero(group == number).tolist()) for number in dict.fromkeys(group.tolist())]
    return [found for found in members if len(found) > 1]
