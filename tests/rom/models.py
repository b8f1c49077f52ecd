"""Reduced models of random matrices, in which nothing commutes, and their first-order form without modes."""

from __future__ import annotations

import numpy as np
from scipy.linalg import sqrtm

from strainsight.fem.affine import AffineOperator
from strainsight.rom.model import Damping, ReducedModel

DAMPINGS = [Damping(), Damping("modal", ratio=0.02), Damping("rayleigh", alpha=0.5, beta=1e-4)]
IDS = ["none", "modal", "rayleigh"]


def positive(rng: np.random.Generator, n: int) -> np.ndarray:
    X = rng.standard_normal((n, n))
    return X @ X.T / n + 0.2 * np.eye(n)


def two_materials(seed: int, damping: Damping, n: int = 4, omega: float = 100.0, on_mass: bool = False) -> ReducedModel:
    """Both operators have a constant part and a part that follows a parameter: nothing commutes. on_mass: loads follow too."""
    rng = np.random.default_rng(seed)
    stiffness = AffineOperator(omega**2 * positive(rng, n), {"E": 0.5 * omega**2 * positive(rng, n)})
    mass = AffineOperator(positive(rng, n), {"rho": 0.5 * positive(rng, n)})
    S = rng.standard_normal((n, 2))
    slope = {"rho": rng.standard_normal((n, 2))} if on_mass else {}
    return ReducedModel(mass, stiffness, S, ("Fx", "Fz"), {"E": 1.0, "rho": 1.0}, damping, slope)


def shape(model: ReducedModel, theta) -> np.ndarray:
    return sum((slope * (theta[name] - 1.0) for name, slope in model.input_slope.items()), model.input_shape)


def system(model: ReducedModel, theta) -> tuple[np.ndarray, np.ndarray]:
    """First-order form ẋ = A x + B u with the damping by a matrix root: no modes anywhere."""
    K, M, S = model.stiffness.at(theta), model.mass.at(theta), shape(model, theta)
    n = model.size
    X = np.linalg.solve(M, K)
    d = model.damping
    c = 2 * d.ratio * sqrtm(X).real if d.kind == "modal" else d.alpha * np.eye(n) + d.beta * X
    return np.block([[np.zeros((n, n)), np.eye(n)], [-X, -c]]), np.vstack([np.zeros_like(S), np.linalg.solve(M, S)])


def scales(model: ReducedModel, theta, n_u: int = 2) -> np.ndarray:
    """Displacement and velocity made alike (by a typical ω), so that one tolerance serves both."""
    omega = np.sqrt(np.trace(np.linalg.solve(model.mass.at(theta), model.stiffness.at(theta))) / model.size)
    return np.concatenate([np.full(model.size, omega), np.ones(model.size)])
