"""Steps and accelerations of the reduced model and their exact derivatives, for many parameter values at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from strainsight.rom.model import ReducedModel, divided_difference, modal_basis
from strainsight.rom.oscillator import Along, oscillator_acceleration
from strainsight.rom.schemes import Scheme, scheme_step


@dataclass(frozen=True)
class ModalMap:
    """y = A x + Σⱼ Bⱼ uⱼ of x = [q, q̇] and J input vectors, every block of A and B a function of M⁻¹K. Of a step, y = x⁺,
    J = HOLD and u(τ) = u₀ + u₁(τ/h) + u₂(τ/h)² within the step; of the acceleration, y = q̈ and J = 1.

    transition A (..., i n, 2n); input B (..., i n, J, n_u), i = 2 of a step and 1 of the acceleration. The rest is what
    the derivatives need: shape S(θ) (..., n, n_u), without (...) where it is the same at any θ; eigenvalue λ (..., n), modes
    Φ (..., n, n), dual ΦᵀM (..., n, n), table T (i, 2 + J, ..., n) of every mode for itself, dT/dλ, and dT/d ln c, of a model
    whose damping no parameter multiplies the same as none: (0,).
    """

    transition: np.ndarray
    input: np.ndarray
    shape: np.ndarray
    eigenvalue: np.ndarray
    modes: np.ndarray
    dual: np.ndarray
    table: np.ndarray
    table_slope: np.ndarray
    table_damped: np.ndarray


Table = Callable[[np.ndarray, Along], tuple[np.ndarray, np.ndarray]]


def modal_step(model: ReducedModel, theta: Mapping[str, Any], h: float, scheme: Scheme = "exact") -> ModalMap:
    """Step of (5.3) over h [s] at θ (values of shape (...) [SI]): every mode by its own closed form, exact or by a scheme.

    Raises NumericalError at critical damping (exact only).
    """
    own = model.damping.at(theta)
    return modal_map(model, theta, lambda lam, along: scheme_step(lam, own, h, scheme, along))


def acceleration_map(model: ReducedModel, theta: Mapping[str, Any]) -> ModalMap:
    """q̈ = M⁻¹(S u − C q̇ − K q) at θ (values of shape (...) [SI]): z̈ = −λz − c(λ)ż + g of every mode."""
    own = model.damping.at(theta)
    return modal_map(model, theta, lambda lam, along: oscillator_acceleration(lam, own, along))


def modal_map(model: ReducedModel, theta: Mapping[str, Any], table: Table) -> ModalMap:
    """The map that does to every mode what `table` says of its eigenvalue λ (..., n): T and a slope of it (i, 2 + J, ..., n).

    A frequency factor f divides the mass of its mode by f² and leaves the stiffness, so that static responses are the same:
    λ → f²λ, Φ → fΦ.
    """
    lam, Phi = modal_basis(model, theta)
    dual = np.swapaxes(Phi, -1, -2) @ model.mass.at(theta)
    if model.damping.parameter:  # the modes are the same at any damping
        lam = np.broadcast_to(lam, (*np.shape(theta[model.damping.parameter]), model.size)) if lam.ndim == 1 else lam
        Phi, dual = (np.broadcast_to(own, (*lam.shape[:-1], *own.shape[-2:])) for own in (Phi, dual))
    if model.frequency_factors is not None:
        f = model.frequency_factors
        lam, Phi, dual = lam * f**2, Phi * f[..., None, :], dual / f[..., :, None]
    T, dT = table(lam, "eigenvalue")
    damped = table(lam, "damping")[1] if model.damping.parameter else np.zeros(0)
    S = model.input_shape_at(theta)
    return ModalMap(*modal_blocks(S, Phi, dual, T), S, lam, Phi, dual, T, dT, damped)


def modal_blocks(S: np.ndarray, Phi: np.ndarray, dual: np.ndarray, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A (..., i n, 2n) and B (..., i n, J, n_u) of a modal map by its table T (i, 2 + J, ..., n).

    S (n, n_u) or (..., n, n_u) input shape; Phi (..., n, n), dual ΦᵀM (..., n, n).
    """
    n, n_u = S.shape[-2:]
    blocks, held = T.shape[0], T.shape[1] - 2
    batch = Phi.shape[:-2]
    A = np.empty((*batch, blocks * n, 2 * n))
    B = np.empty((*batch, blocks * n, held, n_u))
    forces = np.swapaxes(Phi, -1, -2) @ S
    for i in range(blocks):
        rows = slice(i * n, (i + 1) * n)
        for j in range(2):
            A[..., rows, j * n : (j + 1) * n] = (Phi * T[i, j][..., None, :]) @ dual
        for j in range(held):
            B[..., rows, j, :] = (Phi * T[i, 2 + j][..., None, :]) @ forces
    return A, B


def parameter_slopes(
    model: ReducedModel,
    step: ModalMap,
    theta: Mapping[str, Any],
    x: np.ndarray,
    u: np.ndarray,
    names: Sequence[str],
) -> np.ndarray:
    """∂y/∂θᵢ of a modal map at fixed x and u: every block of A is a function f(M⁻¹K), so with the divided differences of f

        df = Φ [G ∘ f[λᵢ, λⱼ]] ΦᵀM,   G = Φᵀ(dK Φ − dM Φ Λ),   d(M⁻¹S) = ΦΦᵀ(dS − dM ΦΦᵀS)

    and Φ [dT/d ln c]/θ ΦᵀM of the parameter that multiplies the damping.
    theta: where the map was made; x (..., 2n) = [q, q̇]; u (..., J, n_u) hold coefficients; names: the parameters.
    Returns (..., i n, len(names)).
    Source: Daleckii and Krein; Higham, Functions of Matrices, theorem 3.11.
    """
    n = model.size
    Phi, lam = step.modes, step.eigenvalue
    PhiT = np.swapaxes(Phi, -1, -2)
    state = np.swapaxes(x.reshape(*x.shape[:-1], 2, n), -1, -2)
    forces = (PhiT @ step.shape) @ np.swapaxes(u, -1, -2)
    modal = np.concatenate([step.dual @ state, forces], axis=-1)
    differences = divided_difference(lam, step.table, step.table_slope)
    columns = []
    for name in names:
        if name == model.damping.parameter:
            slope = step.table_damped / np.asarray(theta[name])[..., None]
            change = np.moveaxis(np.einsum("ij...a,...aj->i...a", slope, modal), 0, -1)
            columns.append(np.swapaxes(Phi @ change, -1, -2).reshape(*x.shape[:-1], -1))
            continue
        dK, dM = model.stiffness.derivative(name, theta), model.mass.derivative(name, theta)
        PhiT_dM_Phi = PhiT @ dM @ Phi
        G = PhiT @ dK @ Phi - PhiT_dM_Phi * lam[..., None, :]
        by_block = np.einsum("ij...ab,...ab,...bj->i...a", differences, G, modal, optimize=True)
        inertia = PhiT_dM_Phi @ forces
        if name in model.input_slope:
            inertia = inertia - (PhiT @ model.input_slope[name]) @ np.swapaxes(u, -1, -2)
        by_mass = np.einsum("ij...a,...aj->i...a", step.table[:, 2:], inertia)
        change = np.moveaxis(by_block - by_mass, 0, -1)
        columns.append(np.swapaxes(Phi @ change, -1, -2).reshape(*x.shape[:-1], -1))
    rows = len(step.table) * n
    return np.stack(columns, axis=-1) if columns else np.zeros((*x.shape[:-1], rows, 0))


def simulate(
    model: ReducedModel, theta: Mapping[str, float], u: np.ndarray, h: float, start: np.ndarray | None = None
) -> np.ndarray:
    """Response, exact for the held input; u (steps, HOLD, n_u) hold coefficients; start x(0) (2n,), rest where not given.

    Returns x (steps + 1, 2n).
    """
    step = modal_step(model, theta, h)
    drive = np.einsum("aju,kju->ka", step.input, u)
    x = np.zeros((len(u) + 1, 2 * model.size))
    if start is not None:
        x[0] = start
    for k in range(len(u)):
        x[k + 1] = step.transition @ x[k] + drive[k]
    return x
