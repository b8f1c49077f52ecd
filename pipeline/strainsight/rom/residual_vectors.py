"""What a body's own inertia does to it beyond its kept modes: residual vectors."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.linalg import eigh

from strainsight.fem.factorisation import Factor
from strainsight.fem.model import FiniteElementModel
from strainsight.fem.modes import signs, turned
from strainsight.fem.point_masses import point_mass_matrix
from strainsight.fem.ties import rigid_rows
from strainsight.rom.inertia import scalar_mass

DEPENDENT = 1e-9
"""Least share of a static response, in the energy norm, that modes and other vectors must leave for a vector of its own: a
body whose modes are all kept leaves at most 1e-12 by rounding, and what is dropped changes no response by more than this."""


def rigid_field(model: FiniteElementModel) -> np.ndarray:
    """Three translations and three rotations of everything, held or not, r (3n + 3r, 6) on the rows of z [m or rad per m]:

    about the middle of the elements' nodes, rotations divided by its radius, so that all six are of one size.
    """
    constraint, x = model.constraint, model.mesh.position
    used = model.mesh.nodes_of_elements
    arm = x - x[used].mean(axis=0)
    r = np.zeros((constraint.transform.shape[0], 6))
    r[: 3 * len(x)] = rigid_rows(arm).reshape(-1, 6)
    for row in constraint.reference_rows.values():
        r[row : row + 3, 3:] = np.eye(3)
    r[:, 3:] /= np.linalg.norm(arm[used], axis=1).max()
    return r


def inertia_loads(model: FiniteElementModel) -> np.ndarray:
    """F = Tᵀ(m ⊗ I₃ + M_p) r  (n_free, 6) [N per m/s²]: weight along x, y, z, and the inertia of three angular accelerations.

    m the mass of all nodes and M_p that of the points: the mass that hangs on held nodes by its elements pulls on the
    others too, and is not in the mass of the free motions. r of `rigid_field`.
    """
    r, n = rigid_field(model), len(model.mesh.position)
    f = np.zeros_like(r)
    f[: 3 * n] = (scalar_mass(model.mesh) @ r[: 3 * n].reshape(n, -1)).reshape(3 * n, -1)
    if model.mesh.point_masses:
        f += point_mass_matrix(model.mesh, model.constraint.reference_rows) @ r
    return np.asarray(model.constraint.transform.T @ f)


def residual_vectors(
    F: np.ndarray, M: sparse.csr_array, factor: Factor, frequency: np.ndarray, U: np.ndarray
) -> np.ndarray:
    """Shapes V that add the static responses K⁻¹F to modes U, KU = MUΩ² and UᵀMU = I, as modes of their own:

        R = K⁻¹(F − MUUᵀF) = K⁻¹F − UΩ⁻²UᵀF      span V = span R,     VᵀMV = I,   VᵀKV diagonal,   VᵀMU = VᵀKU = 0

    F (n, k) [N per m/s²], M (n, n), factor of K, frequency (m,) [Hz] and U (n, m) [1/√kg] → V (n, ≤ k) [1/√kg], by rising
    Rayleigh quotient; fewer where a response is in the modes and the vectors before it but for `DEPENDENT`.
    Source: Rose, MSC World Users' Conference (1991); Dickens, Nakagawa and Wittbrodt, Computers and Structures 62 (1997).
    """
    P = U.T @ F
    # solving for what is left of the load, not taking modes off the response, keeps small vectors accurate
    left = F - M @ (U @ P)
    R = factor.solve(left)
    R -= U @ (U.T @ (M @ R))
    energy = np.einsum("ij,ij->j", R, left) + ((P / (2 * np.pi * frequency[:, None])) ** 2).sum(axis=0)  # diag FᵀK⁻¹F
    shapes: list[np.ndarray] = []
    loads: list[np.ndarray] = []
    for x, f, whole in zip(R.T, left.T, energy, strict=True):
        for _ in range(2):  # once more, for what rounding leaves
            for y, g in zip(shapes, loads, strict=True):
                share = y @ f
                x, f = x - share * y, f - share * g
        own = float(x @ f)
        if own > DEPENDENT**2 * whole:
            shapes.append(x / np.sqrt(own))
            loads.append(f / np.sqrt(own))
    if not shapes:
        return np.zeros((len(F), 0))
    Y = np.column_stack(shapes)  # YᵀKY = I
    inverse, W = eigh(Y.T @ (M @ Y))
    inverse, W = inverse[::-1], W[:, ::-1]
    W = W @ turned(inverse, Y @ W)
    V = Y @ (W / np.sqrt(inverse))
    return V * signs(V)
