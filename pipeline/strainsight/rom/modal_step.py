"""The exact step of the reduced model and its exact derivatives, for many parameter values at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from strainsight.rom.model import ReducedModel, divided_difference, modal_basis
from strainsight.rom.oscillator import HOLD, oscillator_step


@dataclass(frozen=True)
class ModalStep:
    """x⁺ = A x + Σⱼ Bⱼ uⱼ for x = [q, q̇] and an input u(τ) = u₀ + u₁(τ/h) + u₂(τ/h)² within the step.

    transition A (..., 2n, 2n); input B (..., 2n, HOLD, n_u). The rest is what the derivatives need:
    eigenvalue λ (..., n), modes Φ (..., n, n), dual ΦᵀM (..., n, n), table T (2, 2 + HOLD, ..., n) and dT/dλ.
    """

    transition: np.ndarray
    input: np.ndarray
    eigenvalue: np.ndarray
    modes: np.ndarray
    dual: np.ndarray
    table: np.ndarray
    table_slope: np.ndarray


def modal_step(model: ReducedModel, theta: Mapping[str, Any], h: float) -> ModalStep:
    """Exact step of (5.3) over h [s] at θ (values of shape (...) [SI]): every mode by its own closed form.

    Raises NumericalError at critical damping.
    """
    lam, Phi = modal_basis(model, theta)
    dual = np.swapaxes(Phi, -1, -2) @ model.mass.at(theta)
    T, dT = oscillator_step(lam, model.damping, h)
    n, n_u = model.input_shape.shape
    batch = lam.shape[:-1]
    A = np.empty((*batch, 2 * n, 2 * n))
    B = np.empty((*batch, 2 * n, HOLD, n_u))
    forces = np.swapaxes(Phi, -1, -2) @ model.input_shape
    for i in range(2):
        rows = slice(i * n, (i + 1) * n)
        for j in range(2):
            A[..., rows, j * n : (j + 1) * n] = (Phi * T[i, j][..., None, :]) @ dual
        for j in range(HOLD):
            B[..., rows, j, :] = (Phi * T[i, 2 + j][..., None, :]) @ forces
    return ModalStep(A, B, lam, Phi, dual, T, dT)


def parameter_slopes(
    model: ReducedModel, step: ModalStep, x: np.ndarray, u: np.ndarray, names: Sequence[str]
) -> np.ndarray:
    """∂x⁺/∂θᵢ at fixed x and u: every block of A is a function f(M⁻¹K), so with the divided differences of f

        df = Φ [G ∘ f[λᵢ, λⱼ]] ΦᵀM,   G = Φᵀ(dK Φ − dM Φ Λ),   d(M⁻¹S) = −Φ(Φᵀ dM Φ)ΦᵀS

    x (..., 2n) = [q, q̇]; u (..., HOLD, n_u) hold coefficients; names: the parameters. Returns (..., 2n, len(names)).
    Source: Daleckii and Krein; Higham, Functions of Matrices, theorem 3.11.
    """
    n = model.size
    Phi, lam = step.modes, step.eigenvalue
    PhiT = np.swapaxes(Phi, -1, -2)
    state = np.swapaxes(x.reshape(*x.shape[:-1], 2, n), -1, -2)
    forces = (PhiT @ model.input_shape) @ np.swapaxes(u, -1, -2)
    modal = np.concatenate([step.dual @ state, forces], axis=-1)
    differences = divided_difference(lam, step.table, step.table_slope)
    columns = []
    for name in names:
        dK, dM = model.stiffness.derivative(name), model.mass.derivative(name)
        PhiT_dM_Phi = PhiT @ dM @ Phi
        G = PhiT @ dK @ Phi - PhiT_dM_Phi * lam[..., None, :]
        by_block = np.einsum("ij...ab,...ab,...bj->i...a", differences, G, modal, optimize=True)
        by_mass = np.einsum("ij...a,...aj->i...a", step.table[:, 2:], PhiT_dM_Phi @ forces)
        change = np.moveaxis(by_block - by_mass, 0, -1)
        columns.append(np.swapaxes(Phi @ change, -1, -2).reshape(x.shape))
    return np.stack(columns, axis=-1) if columns else np.zeros((*x.shape, 0))


def simulate(model: ReducedModel, theta: Mapping[str, float], u: np.ndarray, h: float) -> np.ndarray:
    """Response from rest, exact for the held input; u (steps, HOLD, n_u) hold coefficients. Returns x (steps + 1, 2n)."""
    step = modal_step(model, theta, h)
    drive = np.einsum("aju,kju->ka", step.input, u)
    x = np.zeros((len(u) + 1, 2 * model.size))
    for k in range(len(u)):
        x[k + 1] = step.transition @ x[k] + drive[k]
    return x
