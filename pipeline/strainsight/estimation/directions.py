"""Directions of the considered constants that samples can distinguish: of some fifty constants a dozen or two."""

from __future__ import annotations

import numpy as np

from strainsight.estimation.parallel_filters import LinearModels

LEAST = 1e-6
"""Least information on a direction of ν that is not left out: its prior is one."""


def distinguished_directions(models: LinearModels, left: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Orthonormal directions Q (d, r) of ν that samples distinguish.

        M = Λ⁻¹ − 1,     Q the eigenvectors of M with eigenvalues above LEAST, and the mean of ν

    A direction q without them changes ln p of the samples by about qᵀMq. Groups of ν with and without an effect on the motion,
    and with and without a fixed slope, are not mixed, nor those of the truncated displacements or `kept` (d,). left Λ (d, d):
    covariance of ν after the samples."""
    d, e = len(left), models.moving
    information, number = np.linalg.inv(left) - np.eye(d), np.arange(d)
    single = kept | ((number >= e - len(models.U)) & (number < e))

    def group(which: np.ndarray) -> np.ndarray:
        at = np.flatnonzero(which & ~single)
        size, axes = np.linalg.eigh(information[np.ix_(at, at)])
        basis, triangle = np.linalg.qr(np.column_stack([axes[:, size > LEAST], models.about[at]]))
        Q = np.zeros((d, basis.shape[1]))
        Q[at] = basis
        return Q[:, np.abs(np.diag(triangle)) > LEAST]

    moves, fixed = number < e, models.fixed_slope
    alone = [np.eye(d)[:, single & which] for which in (moves, ~moves)]
    moving, reading = ([group(which & fixed), group(which & ~fixed)] for which in (moves, ~moves))
    return np.column_stack([*moving, alone[0], *reading, alone[1]])
