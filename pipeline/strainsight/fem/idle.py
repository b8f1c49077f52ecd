"""Rotations of single nodes of shells and beams that nothing resists."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from strainsight.fem.constraints import Constraint
from strainsight.mesh.model import Mesh

IDLE = 1e-11
"""Of the strongest resistance that a node has to rotations: one below it is rounding."""


def idle_rotations(mesh: Mesh, constraint: Constraint, K: sparse.csr_array) -> sparse.csr_array:
    """Stiffness (n_free, n_free) for rotations v of single nodes that nothing resists:  Σ k v vᵀ  over vᵀKv = 0.

    K is positive semidefinite, so that Kv = 0 too: what is added there changes no other motion. So bars without torsion, and a
    truss of beams without bending, leave no mechanism (AUTOSPC in Nastran, here along any direction).
    K (n_free, n_free) on the free motions.
    """
    column = np.full(constraint.transform.shape[0], -1)
    column[constraint.free_rows] = np.arange(len(constraint.free_rows))
    at = column[constraint.rotations(mesh.turning)]
    rows, columns = (np.broadcast_to(own, (len(at), 3, 3)) for own in (at[:, :, None], at[:, None, :]))
    free = (rows >= 0) & (columns >= 0)
    if not free.any():
        return sparse.csr_array(K.shape)
    B = np.zeros(free.shape)
    B[free] = K[rows[free], columns[free]]
    largest = np.linalg.eigvalsh(B)[:, -1]
    k = np.where(largest > 0, largest, float(K.diagonal().mean()))
    # motions that are held, or follow others, are resisted
    B += k[:, None, None] * np.eye(3) * (at < 0)[:, :, None]
    strength, v = np.linalg.eigh(B)
    idle = strength <= IDLE * k[:, None]
    added = np.einsum("n,ni,nai,nbi->nab", k, idle, v, v)
    kept = free & (added != 0)
    return sparse.csr_array((added[kept], (rows[kept], columns[kept])), shape=K.shape)
