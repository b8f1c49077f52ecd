"""Two masses on two springs: the small model on which filters over parameters are tested."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import patch

import numpy as np
from scipy.linalg import eigh, expm

from strainsight.estimation.model import FilterModel
from strainsight.fem.affine import AffineOperator
from strainsight.loads.input_models import Unknowns
from strainsight.rom.model import Damping, ReducedModel

KAPPA, H, STEPS, RATIO = 30.0, 0.02, 40, 0.03
REFERENCE = {"k1": 900.0, "k2": 400.0}
STIFFNESS = {"k1": np.array([[1.0, 0.0], [0.0, 0.0]]), "k2": np.array([[1.0, -1.0], [-1.0, 1.0]])}
ROWS = np.array([[1.0, 0.0], [-1.0, 1.0]])
NOISE = 2e-3
MASSES = ReducedModel(
    AffineOperator(np.eye(2), {}),
    AffineOperator(np.zeros((2, 2)), STIFFNESS),
    np.array([[0.0, 1.0], [1.0, 0.0]]),
    ("known", "unknown"),
    REFERENCE,
    Damping(ratio=RATIO),
)


def chain(noise=NOISE):
    """Two masses of one on two springs, a known force on the second and an unknown one, a random walk, on the first."""
    unknowns = Unknowns(("unknown",), ("k1", "k2"), {"unknown": 1.0}, REFERENCE, frequency={"unknown": KAPPA})
    H_star = np.hstack([ROWS, np.zeros((2, 5))])
    Q = np.diag([0, 0, 1e-4, 1e-4, KAPPA, 0, 0])
    return FilterModel(MASSES, unknowns, ("known",), {}, H_star, Q, np.full(2, noise**2 * H), H)


def loaded_chain(noise=NOISE):
    """The same with both stiffnesses known."""
    whole = chain(noise)
    unknowns = replace(whole.unknowns, parameters=())
    return replace(whole, unknowns=unknowns, fixed=REFERENCE, H=whole.H[:, :5], Q=whole.Q[:5, :5])


def driven_chain(noise=NOISE, parameters=("k1", "k2")):
    """The chain under its known force alone."""
    whole, states = chain(noise), 4 + len(parameters)
    unknowns = replace(whole.unknowns, inputs=(), parameters=parameters)
    fixed = {name: value for name, value in REFERENCE.items() if name not in parameters}
    Q = np.diag([0, 0, 1e-4, 1e-4, *[0.0] * len(parameters)])
    return replace(whole, unknowns=unknowns, fixed=fixed, H=whole.H[:, :states], Q=Q)


def forces(steps=STEPS):
    """A known force that is constant within every step (T, HOLD, 1)."""
    held = np.zeros((steps, 3, 1))
    held[:, 0, 0] = 3 * np.sin(0.7 * np.arange(steps)) + 2
    return held


def continuous(stiffness, factors=1.0):
    """Rate matrix of [q, q̇, u] and the column of the known force, from the textbook; factors on the damping of the modes."""
    K = sum(value * STIFFNESS[name] for name, value in stiffness.items())
    lam, Phi = eigh(K)
    C = (Phi * factors * 2 * RATIO * np.sqrt(lam)) @ Phi.T
    F = np.zeros((5, 5))
    F[:2, 2:4] = np.eye(2)
    F[2:4, :2], F[2:4, 2:4], F[2:4, 4] = -K, -C, [1.0, 0.0]
    return F, np.array([0, 0, 0, 1.0, 0])


def step_at(p):
    """Transition A (5, 5) and drive (5,) of a step at θ = reference·exp(p), from the textbook."""
    F, column = continuous({name: value * np.exp(log) for (name, value), log in zip(REFERENCE.items(), p, strict=True)})
    whole = expm(np.block([[F, column[:, None]], [np.zeros((1, 6))]]) * H)
    return whole[:5, :5], whole[:5, 5]


def influence(A, steps):
    """Block (k, j) is A^(k − j), zero for j > k: states (steps + 1, n) of the start and the noise of every step."""
    power = [np.eye(len(A))]
    for _ in range(steps):
        power.append(A @ power[-1])
    lag = np.subtract.outer(np.arange(steps + 1), np.arange(steps + 1))
    blocks = np.array(power)[np.maximum(lag, 0)] * (lag >= 0)[..., None, None]
    return blocks.transpose(0, 2, 1, 3)


def gathered(F, Q):
    """Van Loan's integral of the noise over a step."""
    n = len(F)
    X = expm(np.block([[-F, Q], [np.zeros((n, n)), F.T]]) * H)
    return X[n:, n:].T @ X[:n, n:]


WHITE = (0, 0, 1e-4, 1e-4, KAPPA)


def states(p, held, white=WHITE):
    """At θ = reference·exp(p), of all states (5 (T + 1)): their mean under a force (T, HOLD, 1) within every step, what unit
    start and noise of the steps make of them, and the rows (2 T, 5 (T + 1)) of the readings; Q of a step, of the guess."""
    steps, (A, drive) = len(held), step_at(p)
    O = influence(A, steps).reshape(5 * (steps + 1), 5 * (steps + 1))
    mean = O[:, 5:] @ np.concatenate([drive * own for own in held[:, 0, 0]])
    rows = np.kron(np.eye(steps + 1)[1:], np.hstack([ROWS, np.zeros((2, 3))]))
    return mean, O, rows, gathered(continuous(REFERENCE)[0], np.diag(white))


def joint(p, P0, steps=STEPS, white=WHITE):
    """Mean and covariance of all readings at θ = reference·exp(p), one Gaussian of 2·steps numbers; white (5,): intensities."""
    mean, O, rows, Q = states(p, forces(steps), white)
    read = rows @ O
    spread = (read.reshape(2 * steps, -1, 1, 5) @ [P0[:5, :5], *[Q] * steps]).reshape(read.shape)  # of start and steps
    covariance = spread @ read.T
    return rows @ mean, 0.5 * (covariance + covariance.T) + NOISE**2 * np.eye(2 * steps)


def log_normal(y, mean, covariance):
    L = np.linalg.cholesky(covariance)
    e = np.linalg.solve(L, y - mean)
    return -0.5 * (e @ e) - np.log(np.diag(L)).sum() - 0.5 * len(y) * np.log(2 * np.pi)


def start():
    return np.diag([1e-6, 1e-6, 1e-4, 1e-4, 0.5, 0.3**2, 0.2**2])


def driven_start():
    return np.delete(np.delete(start(), 4, axis=0), 4, axis=1)


def finer(spacing, depth):
    """Lattices of this spacing [σ] that reach so far below their largest density [ln]."""
    return patch.multiple("strainsight.estimation.parameter_grid", SPACING=spacing, DEPTH=depth)
