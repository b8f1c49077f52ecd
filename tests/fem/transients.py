"""Small systems and their motion by the exponential of a dense matrix."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.linalg import expm

from strainsight.fem.affine import AffineOperator
from strainsight.fem.constraints import Constraint
from strainsight.fem.model import FiniteElementModel
from strainsight.fem.viscous import ViscousDamping
from strainsight.signals.histories import instant_values

NONE = ViscousDamping()


def model_of(K, M) -> FiniteElementModel:
    """A model of given matrices; it has no mesh."""
    K, M = sparse.csr_array(np.asarray(K, float)), sparse.csr_array(np.asarray(M, float))
    free = sparse.csr_array(sparse.eye_array(K.shape[0], format="csr"))
    constraint = Constraint(free, {}, np.arange(K.shape[0]))
    return FiniteElementModel(None, constraint, AffineOperator(K, {}), AffineOperator(M, {}))


def chain(n, stiffness=4e4, mass=1.0, coupling=0.1):
    """n masses in a row, the first on a spring to the ground; a mass matrix that is not diagonal."""
    K = stiffness * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    K[-1, -1] = stiffness
    return K, mass * (np.eye(n) + coupling * (np.eye(n, k=1) + np.eye(n, k=-1)))


def dense_damping(K, M, damping):
    C = damping.alpha * M + damping.beta * K
    for i, c in enumerate(damping.rate):
        m = M @ damping.shapes[:, i]
        C = C + c * np.outer(m, m)
    return C


def exact(K, M, C, S, held, h, x0=None):
    """[z, ż, z̈] (T + 1, 3, n) by the exponential of the system and its polynomial load together."""
    n, J = len(K), held.shape[1]
    inverse = np.linalg.inv(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ K, -inverse @ C]])
    B = np.vstack([np.zeros_like(S), inverse @ S])
    width = S.shape[1]
    full = np.zeros((2 * n + J * width,) * 2)
    full[: 2 * n, : 2 * n] = A
    full[: 2 * n, 2 * n : 2 * n + width] = B
    for j in range(J - 1):
        full[2 * n + j * width : 2 * n + (j + 1) * width, 2 * n + (j + 1) * width : 2 * n + (j + 2) * width] = np.eye(
            width
        )
    E = expm(full * h)
    factor = np.array([1.0, 1.0 / h, 2.0 / h**2])[:J, None]
    x = np.zeros(2 * n) if x0 is None else np.concatenate(x0)
    states = [x]
    for u in held:
        x = E[: 2 * n] @ np.concatenate([x, (factor * u).ravel()])
        states.append(x)
    states = np.array(states)
    u = instant_values(held)
    z, v = states[:, :n], states[:, n:]
    return np.stack([z, v, (u @ S.T - z @ K - v @ C) @ inverse], axis=1)


def random_load(T, width, J=3, seed=0):
    return np.random.default_rng(seed).standard_normal((T, J, width))


# ---- the scheme
