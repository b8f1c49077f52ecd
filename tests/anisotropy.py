"""Anisotropic elasticity for tests, by tensors with four indices and closed forms, without the product's 6 × 6 matrices."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

OURS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
CONSTANTS = (1.4e11, 1.0e10, 0.7e10), (0.3, 0.25, 0.4), (5.0e9, 4.0e9, 3.0e9)
"""E₁, E₂, E₃; ν₁₂, ν₁₃, ν₂₃; G₁₂, G₁₃, G₂₃."""
TURN = Rotation.from_euler("zyx", [25.0, -40.0, 70.0], degrees=True).as_matrix()
"""Axes of a material, one in a column."""


def triclinic():
    """C (6, 6) of a material without any symmetry, in the order of `OURS`."""
    X = np.random.default_rng(7).normal(size=(6, 6))
    return 1e10 * (X @ X.T + 4 * np.eye(6))


def tensor(C, order=OURS):
    """C_ijkl (3, 3, 3, 3) of C (6, 6) in an order of pairs of indices."""
    found = np.zeros((3, 3, 3, 3))
    for a, (i, j) in enumerate(order):
        for b, (k, l) in enumerate(order):
            for p, q in {(i, j), (j, i)}:
                for r, s in {(k, l), (l, k)}:
                    found[p, q, r, s] = C[a, b]
    return found


def turned(C, axes):
    """C'_ijkl = a_ip a_jq a_kr a_ls C_pqrs of a tensor along axes (3, 3), one in a column."""
    return np.einsum("ip,jq,kr,ls,pqrs->ijkl", axes, axes, axes, axes, C)


def work(C, strain):
    """½ ε : C : ε."""
    return 0.5 * np.einsum("ij,ijkl,kl->", strain, C, strain)


def flexibility(moduli, ratios, shear):
    """S_ijkl of engineering constants: ε = S σ, a stress at a time."""
    (e1, e2, e3), (nu12, nu13, nu23), (g12, g13, g23) = moduli, ratios, shear
    S = np.zeros((3, 3, 3, 3))
    S[0, 0, 0, 0], S[1, 1, 1, 1], S[2, 2, 2, 2] = 1 / e1, 1 / e2, 1 / e3
    S[1, 1, 0, 0] = S[0, 0, 1, 1] = -nu12 / e1
    S[2, 2, 0, 0] = S[0, 0, 2, 2] = -nu13 / e1
    S[2, 2, 1, 1] = S[1, 1, 2, 2] = -nu23 / e2
    for (i, j), g in {(0, 1): g12, (0, 2): g13, (1, 2): g23}.items():
        S[i, j, i, j] = S[i, j, j, i] = S[j, i, i, j] = S[j, i, j, i] = 1 / (4 * g)
    return S


def strains():
    """Tensors of strain (6, 3, 3), one component each, and a general one."""
    found = []
    for i, j in OURS:
        own = np.zeros((3, 3))
        own[i, j] = own[j, i] = 1e-3
        found.append(own)
    X = 1e-3 * np.random.default_rng(2).normal(size=(3, 3))
    return [*found, X + X.T]


def works_of(K, position):
    """½ zᵀKz of a body whose displacement is each of `strains` times x."""
    return np.array([0.5 * z @ (K @ z) for z in ((position @ own).ravel() for own in strains())])
