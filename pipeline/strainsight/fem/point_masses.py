"""Point masses with offset and inertia on the motions of their nodes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import sparse

from strainsight.errors import DeckError
from strainsight.fem.ties import rigid_rows
from strainsight.mesh.joins import PointMass
from strainsight.mesh.model import Mesh


def point_mass_matrix(mesh: Mesh, rotation_rows: Mapping[int, int]) -> sparse.csr_array:
    """Mass of the point masses on z (3n + 3r)², rotations of node i from row rotation_rows[i] [kg, kg m, kg m²]:

        M = [m I, −m d×; m d×, J − m d×d×],   d offset of the centre, J inertia about it

    or the matrix that it states. At a node without rotations only its part of translations counts.
    Raises DeckError for a negative mass and for an inertia or a matrix that is not symmetric.
    """
    rows, columns, values = [], [], []
    for point in mesh.point_masses:
        M = block(point)
        at = 3 * point.node + np.arange(3)
        if point.node in rotation_rows:
            at = np.concatenate([at, rotation_rows[point.node] + np.arange(3)])
        i, j = np.meshgrid(at, at, indexing="ij")
        rows.append(i.ravel())
        columns.append(j.ravel())
        values.append(M[: len(at), : len(at)].ravel())
    size = 3 * len(mesh.position) + 3 * len(rotation_rows)
    if not rows:
        return sparse.csr_array((size, size))
    places = np.concatenate(rows), np.concatenate(columns)
    found = sparse.csr_array((np.concatenate(values), places), shape=(size, size))
    found.eliminate_zeros()
    return found


def block(point: PointMass) -> np.ndarray:
    """M (6, 6) of one point mass on the translations and rotations of its node."""
    check(point)
    if point.matrix is not None:
        return np.asarray(point.matrix)
    D = rigid_rows(np.asarray(point.offset, dtype=float)[None, :])[0]  # motion of the centre
    M = point.mass * D.T @ D
    M[3:, 3:] += point.inertia
    return M


def check(point: PointMass) -> None:
    """Raise DeckError for a negative mass and for an inertia or a matrix that is not symmetric."""
    if not point.mass >= 0:
        raise DeckError(f"point mass {point.id} is {point.mass:g} kg", remedy="it must not be negative")
    J = np.asarray(point.inertia)
    if not np.abs(J - J.T).max() <= 1e-9 * np.abs(J).max():
        raise DeckError(f"the inertia of point mass {point.id} is not symmetric", remedy="give six moments")
    M = np.zeros((6, 6)) if point.matrix is None else point.matrix
    if not np.abs(M - M.T).max() <= 1e-9 * np.abs(M).max():
        raise DeckError(f"the matrix of point mass {point.id} is not symmetric", remedy="give one triangle of it")


def weighed(point: PointMass, x: np.ndarray) -> tuple[float, np.ndarray]:
    """Mass m [kg] of a point mass on a node at x, and m times its centre (3,) [kg m].

    Of a matrix from the momentum of unit translations t and its moment, as of shells and beams:  m c × e = Σ (x × f + moment).
    """
    check(point)
    if point.matrix is None:
        return point.mass, point.mass * (x + point.offset)
    L = np.cross(x[:, None], point.matrix[:3, :3], axis=0) + point.matrix[3:, :3]
    return point.mass, 0.5 * np.array([L[2, 1] - L[1, 2], L[0, 2] - L[2, 0], L[1, 0] - L[0, 1]])
