"""Motions of nodes that another program found, on all rows of a mesh: what is tied to these nodes follows them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from strainsight.fem.constraints import Constraint, constraint_transform
from strainsight.fem.equations import turning_nodes
from strainsight.mesh.model import Mesh

LOOSE = 1e-10
"""Eigenvalue of the normal equations of unit columns below which the motions do not say how a reference node moves."""


@dataclass(frozen=True)
class GivenMotion:
    """constraint: ties of the mesh, no supports; field (3n + 3r, k) on the rows of its z, zero where known (3n + 3r,) says no."""

    constraint: Constraint
    field: np.ndarray
    known: np.ndarray


def given_motion(mesh: Mesh, motion: np.ndarray) -> GivenMotion:
    """Motions (k, n, 3 or 6) of the nodes, NaN of those without → rows of z.

        z = data at the nodes that have some,     z = T z_free elsewhere,     z_free by least squares of T z_free = data

    so that the reference node of a rigid element, which results of solids lack, moves as the nodes that it leads, that of an
    averaging element as their mean, and what lies on faces of shells with their nodes. A row that follows from no data is not
    known. Supports of the mesh do not count: what does not move in the results is held. Raises the errors of
    `constraint_transform`.
    """
    n = len(mesh.position)
    loose = replace(mesh, fixed=np.zeros((0, 2), dtype=np.int64))
    constraint = constraint_transform(loose, rotations=turning_nodes(mesh))
    T = constraint.transform
    z = np.full((T.shape[0], len(motion)), np.nan)
    z[: 3 * n] = motion[:, :, :3].reshape(len(motion), 3 * n).T
    if motion.shape[2] == 6 and constraint.reference_rows:
        nodes = np.array(list(constraint.reference_rows), dtype=np.int64)
        z[constraint.rotations(nodes).ravel()] = motion[:, nodes, 3:].reshape(len(motion), -1).T
    known = np.isfinite(z).all(axis=1)
    z[~known] = 0.0
    free, determined = _free_motions(constraint, z, known)
    rows = np.flatnonzero(~known)
    reached = np.diff(T[rows].indptr) > 0
    open_ = abs(T[rows]) @ (~determined).astype(float) > 0
    rows = rows[reached & ~open_]
    z[rows] = T[rows] @ free
    known[rows] = True
    return GivenMotion(constraint, z, known)


def _free_motions(constraint: Constraint, z: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """z_free (n_free, k), and which (n_free,) of them the known rows of z determine."""
    T, Q = constraint.transform, constraint.turn
    own, there = (z, known) if Q is None else (Q.T @ z, abs(Q).T @ (~known).astype(float) == 0)
    free, determined = own[constraint.free_rows].copy(), there[constraint.free_rows].copy()
    free[~determined] = 0.0
    data = T[np.flatnonzero(known)]
    unknown = np.flatnonzero(~determined)
    unknown = unknown[np.diff(data[:, unknown].tocsc().indptr) > 0]
    if not unknown.size:
        return free, determined
    A = sparse.csr_array(data[:, unknown])
    touched = np.flatnonzero(np.diff(A.indptr) > 0)
    A, left = A[touched], z[known][touched] - data[touched] @ free
    scale = 1 / np.sqrt(np.asarray(A.multiply(A).sum(axis=0)).ravel())
    A = sparse.csr_array(A @ sparse.diags_array(scale))
    strength, U = np.linalg.eigh((A.T @ A).toarray())
    kept = strength > LOOSE
    free[unknown] = scale[:, None] * (U[:, kept] @ ((U[:, kept].T @ (A.T @ left)) / strength[kept, None]))
    determined[unknown] = np.linalg.norm(U[:, ~kept], axis=1) < np.sqrt(LOOSE)
    return free, determined
