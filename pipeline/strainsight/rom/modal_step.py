"""Steps and accelerations of the reduced model with exact derivatives, other time schemes, and steady states."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from strainsight.errors import InfeasibleError, NumericalError
from strainsight.rom.model import Damping, ReducedModel, divided_difference, modal_basis

HOLD = 3
"""Coefficients of the force within a step: g(τ) = g₀ + g₁(τ/h) + g₂(τ/h)²."""
TERMS = 19
"""Number of terms of the series of a φ function."""
Along = Literal["eigenvalue", "damping"]
"""Variable of a derivative: λ, including c(λ); or ln c at fixed λ."""
INVERSE = np.array([1 / math.factorial(i) for i in range(TERMS + HOLD + 1)])
"""1/i! for i below TERMS + HOLD + 1, the highest φ function of a step."""


def oscillator_step(
    lam: np.ndarray, damping: Damping, h: float, along: Along = "eigenvalue"
) -> tuple[np.ndarray, np.ndarray]:
    """Propagator of  z̈ + c(λ)ż + λz = Σⱼ gⱼ (τ/h)ʲ  over one step of length h, and its derivative in λ, or in ln c.

        [z, ż](h) = T · [z, ż, g₀, g₁, g₂],   with s± the roots of s² + cs + λ = 0 and D[F] = (F(s₊) − F(s₋))/(s₊ − s₋):
        ∂z/∂ż₀ = D[eˢʰ],  ∂ż/∂ż₀ = D[s eˢʰ],  ∂z/∂gⱼ = D[wⱼ],  ∂ż/∂gⱼ = D[s wⱼ],  wⱼ = h j! φⱼ₊₁(sh)
        ∂z/∂z₀ = ∂ż/∂ż₀ + c ∂z/∂ż₀,   ∂ż/∂z₀ = −λ ∂z/∂ż₀

    lam (...) [rad²/s²] > 0; h [s]. Returns T and dT, both (2, 2 + HOLD, ...).
    Raises NumericalError at critical damping, where the two roots coincide.
    Source: variation of constants; φ functions as in Hochbruck and Ostermann, Acta Numerica 19 (2010)."""
    c, lam_slope, c_slope = slopes_along(lam, damping, along)
    half_gap = np.sqrt((0.25 * c * c - lam).astype(complex))
    if np.any(np.abs(half_gap) < 1e-6 * np.sqrt(lam)):
        raise NumericalError(
            "the damping ratio of a mode is 1 (critical damping)",
            remedy="Specify a damping ratio that is not exactly 1.",
        )
    roots = np.stack([-0.5 * c + half_gap, -0.5 * c - half_gap])
    gap = 2 * half_gap
    sign = np.array([1.0, -1.0]).reshape(2, *([1] * lam.ndim))
    roots_slope = -sign * (lam_slope + c_slope * roots) / gap
    phi = phi_functions(roots * h, HOLD + 1)

    def conjugate_difference(F: np.ndarray, F_slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value = (F[0] - F[1]) / gap
        slope = F_slope * roots_slope
        return value.real, ((slope[0] - slope[1] - value * (roots_slope[0] - roots_slope[1])) / gap).real

    T = np.empty((2, 2 + HOLD, *lam.shape))
    dT = np.empty_like(T)
    e = phi[0]
    T[0, 1], dT[0, 1] = conjugate_difference(e, h * e)
    T[1, 1], dT[1, 1] = conjugate_difference(roots * e, e + roots * h * e)
    T[0, 0], dT[0, 0] = T[1, 1] + c * T[0, 1], dT[1, 1] + c_slope * T[0, 1] + c * dT[0, 1]
    T[1, 0], dT[1, 0] = -lam * T[0, 1], -lam_slope * T[0, 1] - lam * dT[0, 1]
    for j in range(HOLD):
        w = h * math.factorial(j) * phi[j + 1]
        w_slope = h * h * math.factorial(j) * (phi[j + 1] - (j + 1) * phi[j + 2])
        T[0, 2 + j], dT[0, 2 + j] = conjugate_difference(w, w_slope)
        T[1, 2 + j], dT[1, 2 + j] = conjugate_difference(roots * w, w + roots * w_slope)
    return T, dT


def oscillator_acceleration(
    lam: np.ndarray, damping: Damping, along: Along = "eigenvalue"
) -> tuple[np.ndarray, np.ndarray]:
    """z̈ = T · [z, ż, g],  T = [−λ, −c(λ), 1], and dT/dλ or dT/d ln c; lam (...) [rad²/s²]. Returns two arrays (1, 3, ...)."""
    c, lam_slope, c_slope = slopes_along(lam, damping, along)
    return np.stack([-lam, -c, np.ones_like(lam)])[None], np.stack([-lam_slope, -c_slope, 0 * lam])[None]


def slopes_along(lam: np.ndarray, damping: Damping, along: Along) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """c(λ), and the derivatives of λ and c by λ, or by ln c; each (...)."""
    c, slope = damping.viscous(lam)
    return (c, np.ones_like(lam), slope) if along == "eigenvalue" else (c, np.zeros_like(lam), c)


def phi_functions(z: np.ndarray, order: int) -> list[np.ndarray]:
    """φ₀ = eᶻ,  φₖ₊₁(z) = (φₖ(z) − 1/k!)/z, by their series for |z| < 1; z (...) complex.

    order: the highest k, at most HOLD + 1. Returns order + 1 arrays (...)."""
    small = np.abs(z) < 1
    near, far = np.where(small, z, 0), np.where(small, 1, z)
    series = np.zeros((order + 1, *z.shape), near.dtype)
    for i in range(TERMS - 1, -1, -1):
        series = series * near + INVERSE[i : i + order + 1].reshape(-1, *(1,) * z.ndim)
    recursion = [np.exp(far)]
    for k in range(order):
        recursion.append((recursion[-1] - 1 / math.factorial(k)) / far)
    return [np.where(small, a, b) for a, b in zip(series, recursion, strict=True)]


Scheme = Literal["exact", "trapezoidal", "implicit_euler"]


def scheme_step(
    lam: np.ndarray, damping: Damping, h: float, scheme: Scheme = "exact", along: Along = "eigenvalue"
) -> tuple[np.ndarray, np.ndarray]:
    """Propagator T of a damped oscillator over one step by the scheme, and its derivative, as in `oscillator_step`.

        trapezoidal      z⁺ = z + h(ż + ż⁺)/2,   ż⁺ = ż + h(z̈ + z̈⁺)/2         (Newmark with β = ¼, γ = ½)
        implicit Euler   z⁺ = z + hż⁺,           ż⁺ = ż + hz̈⁺

    with z̈ = g − c(λ)ż − λz. lam (...) [rad²/s²]; h [s]. Returns two arrays (2, 2 + HOLD, ...)."""
    if scheme == "exact":
        return oscillator_step(lam, damping, h, along)
    c, lam_slope, c_slope = slopes_along(lam, damping, along)
    # both are ż⁺ = (a ż − hλz + hḡ)/d with ḡ the mean of the force at both ends, or the force at the end
    s, at_end = (0.5 * h, 0.5) if scheme == "trapezoidal" else (h, 1.0)
    d, d_slope = 1 + s * c + s * s * lam, s * c_slope + s * s * lam_slope
    a, a_slope = (2 - d, -d_slope) if scheme == "trapezoidal" else (np.ones_like(lam), np.zeros_like(lam))
    force = [np.full_like(lam, h * (1.0 if j == 0 else at_end)) for j in range(HOLD)]
    over = np.stack([-h * lam, a, *force])
    over_slope = np.stack([-h * lam_slope, a_slope, *([np.zeros_like(lam)] * HOLD)])
    T, dT = np.zeros((2, 2 + HOLD, *lam.shape)), np.zeros((2, 2 + HOLD, *lam.shape))
    T[1] = over / d
    dT[1] = (over_slope - T[1] * d_slope) / d
    T[0], dT[0] = s * T[1], s * dT[1]
    T[0, 0] += 1
    if scheme == "trapezoidal":
        T[0, 1] += s
    return T, dT


def scheme_bias(lam: np.ndarray, damping: Damping, h: float, scheme: Scheme) -> tuple[np.ndarray, np.ndarray]:
    """Period elongation and added damping of every mode:

        μ = eigenvalue of the step,   ln μ / h = −ζ′ω′ ± iω_d′;    elongation ω_d/ω_d′ − 1,    gain ζ′ − ζ

    lam (n,) [rad²/s²]; h [s]. Undamped and for small ωh: (ωh)²/12 and 0 for the trapezoidal rule, (ωh)²/3 and ωh/2 for
    implicit Euler; 0 and 0 for the exact step. A modulus estimated with the scheme has an error of about twice the elongation.
    Returns elongation (n,) and gain (n,); NaN for a mode that does not oscillate.
    Source: Hughes, The Finite Element Method (1987), section 9.3."""
    if scheme == "exact":
        return np.zeros_like(lam), np.zeros_like(lam)
    block = np.moveaxis(scheme_step(lam, damping, h, scheme)[0][:, :2], -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = np.log(np.linalg.eigvals(block).astype(complex)) / h
        rate = rate[np.arange(len(lam)), np.argmax(rate.imag, axis=1)]
        c = damping.viscous(lam)[0]
        swing = np.sqrt(np.where(lam > 0.25 * c * c, lam - 0.25 * c * c, np.nan))
        numerical = np.where(rate.imag > 0, rate.imag, np.nan)
        return swing / numerical - 1, -rate.real / np.abs(rate) - 0.5 * c / np.sqrt(lam)


@dataclass(frozen=True)
class ModalMap:
    """y = A x + Σⱼ Bⱼ uⱼ of x = [q, q̇] and J input vectors, every block of A and B a function of M⁻¹K. For a step, y = x⁺,
    J = HOLD and u(τ) = u₀ + u₁(τ/h) + u₂(τ/h)² within the step; for the acceleration, y = q̈ and J = 1.

    transition A (..., i n, 2n); input B (..., i n, J, n_u), i = 2 for a step and 1 for the acceleration. The other fields are
    used by the derivatives: shape S(θ) (..., n, n_u), without (...) if constant; eigenvalue λ (..., n), modes Φ (..., n, n), dual
    ΦᵀM (..., n, n), table T (i, 2 + J, ..., n) of every mode, dT/dλ, and dT/d ln c, which is (0,) if no parameter multiplies
    the damping."""

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
    """Step of (5.3) over h [s] at θ (values of shape (...) [SI]): every mode in closed form, exact or by a scheme.

    Raises NumericalError at critical damping (exact only)."""
    damping = model.damping.at(theta)
    return modal_map(model, theta, lambda lam, along: scheme_step(lam, damping, h, scheme, along))


def acceleration_map(model: ReducedModel, theta: Mapping[str, Any]) -> ModalMap:
    """q̈ = M⁻¹(S u − C q̇ − K q) at θ (values of shape (...) [SI]): z̈ = −λz − c(λ)ż + g of every mode."""
    damping = model.damping.at(theta)
    return modal_map(model, theta, lambda lam, along: oscillator_acceleration(lam, damping, along))


def modal_map(model: ReducedModel, theta: Mapping[str, Any], table: Table) -> ModalMap:
    """The map with T and its derivative (i, 2 + J, ..., n) from `table` for the eigenvalue λ (..., n) of every mode.

    A frequency factor f divides the mass of its mode by f² without changing the stiffness, so that static responses are the same:
    λ → f²λ, Φ → fΦ."""
    lam, Phi = modal_basis(model, theta)
    dual = np.swapaxes(Phi, -1, -2) @ model.mass.at(theta)
    if model.damping.parameter:  # the modes do not depend on the damping
        lam = np.broadcast_to(lam, (*np.shape(theta[model.damping.parameter]), model.size)) if lam.ndim == 1 else lam
        Phi, dual = (np.broadcast_to(array, (*lam.shape[:-1], *array.shape[-2:])) for array in (Phi, dual))
    if model.frequency_factors is not None:
        f = model.frequency_factors
        lam, Phi, dual = lam * f**2, Phi * f[..., None, :], dual / f[..., :, None]
    T, dT = table(lam, "eigenvalue")
    damping_slope = table(lam, "damping")[1] if model.damping.parameter else np.zeros(0)
    S = model.input_shape_at(theta)
    return ModalMap(*modal_blocks(S, Phi, dual, T), S, lam, Phi, dual, T, dT, damping_slope)


def modal_blocks(S: np.ndarray, Phi: np.ndarray, dual: np.ndarray, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A (..., i n, 2n) and B (..., i n, J, n_u) of a modal map from its table T (i, 2 + J, ..., n).

    S (n, n_u) or (..., n, n_u) input shape; Phi (..., n, n), dual ΦᵀM (..., n, n)."""
    n, n_u = S.shape[-2:]
    blocks, inputs = T.shape[0], T.shape[1] - 2
    batch = Phi.shape[:-2]
    A = np.empty((*batch, blocks * n, 2 * n))
    B = np.empty((*batch, blocks * n, inputs, n_u))
    forces = np.swapaxes(Phi, -1, -2) @ S
    for i in range(blocks):
        rows = slice(i * n, (i + 1) * n)
        for j in range(2):
            A[..., rows, j * n : (j + 1) * n] = (Phi * T[i, j][..., None, :]) @ dual
        for j in range(inputs):
            B[..., rows, j, :] = (Phi * T[i, 2 + j][..., None, :]) @ forces
    return A, B


def parameter_slopes(
    model: ReducedModel, step: ModalMap, theta: Mapping[str, Any], x: np.ndarray, u: np.ndarray, names: Sequence[str]
) -> np.ndarray:
    """∂y/∂θᵢ of a modal map at fixed x and u: every block of A is a function f(M⁻¹K), so that with the divided differences of f

        df = Φ [G ∘ f[λᵢ, λⱼ]] ΦᵀM,   G = Φᵀ(dK Φ − dM Φ Λ),   d(M⁻¹S) = ΦΦᵀ(dS − dM ΦΦᵀS)

    and Φ [dT/d ln c]/θ ΦᵀM for the parameter that multiplies the damping.
    theta: parameters of the map; x (..., 2n) = [q, q̇]; u (..., J, n_u) hold coefficients; names: the parameters.
    Returns (..., i n, len(names)).
    Source: Daleckii and Krein; Higham, Functions of Matrices, theorem 3.11."""
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
    """Response, exact for the held input; u (steps, HOLD, n_u) hold coefficients; start x(0) (2n,), default rest.

    Returns x (steps + 1, 2n)."""
    step = modal_step(model, theta, h)
    drive = np.einsum("aju,kju->ka", step.input, u)
    x = np.zeros((len(u) + 1, 2 * model.size))
    if start is not None:
        x[0] = start
    for k in range(len(u)):
        x[k + 1] = step.transition @ x[k] + drive[k]
    return x


RESONANT = 1e-9
"""Share of the stiffness below which the dynamic stiffness of a mode counts as zero."""


def steady_start(
    model: ReducedModel, theta: Mapping[str, float], h: float, frequency: np.ndarray, amplitude: np.ndarray
) -> np.ndarray:
    """x(0) of the steady-state motion of `simulate` under u(t) = Σ Re U exp(iωt).

    For one tone the quadratic hold is  uⱼ(kh) = Re cⱼ U zᵏ,  z = exp(iωh),  and so

        x(kh) = Re X zᵏ,    (zI − A) X = Σⱼ Bⱼ cⱼ U                  for every mode

    with c of `hold_of_tones` and A, B of `modal_step`: the motion under the held load, periodic to rounding, instead of the sine.
    The two differ by the error of the hold, (ωh)³ω₀h/720; for h → 0 both are (K − ω²M + iωC) q = S U.
    theta: all parameters [SI]; h [s]; frequency ω (k,) [rad/s]; amplitude U (k, n_u) complex [N]. Returns x (2n,) = [q, q̇].
    Raises InfeasibleError if an undamped mode has the frequency of a tone."""
    step, n = modal_step(model, theta, h), model.size
    forces = amplitude @ (step.modes.T @ step.shape).T
    stiffness = (
        step.eigenvalue
        - frequency[:, None] ** 2
        + 1j * frequency[:, None] * model.damping.at(theta).viscous(step.eigenvalue)[0]
    )
    resonant, still = np.abs(stiffness) <= RESONANT * step.eigenvalue, forces == 0
    if (resonant & ~still).any():
        tone, mode = np.argwhere(resonant & ~still)[0]
        raise InfeasibleError(
            f"a load at {frequency[tone] / (2 * np.pi):.6g} Hz excites the undamped mode {mode + 1}: no periodic motion exists",
            remedy="Specify damping, or start from rest with train.settle: none.",
        )
    z = np.exp(1j * frequency * h)
    A = np.moveaxis(step.table[:, :2], -1, 0)
    drive = np.einsum("ijm,kj,km->kmi", step.table[:, 2:], hold_of_tones(frequency, h), forces)
    # an undamped mode at the frequency of a load that does not excite it stays at zero
    lhs = np.where(still[..., None, None], np.eye(2), z[:, None, None, None] * np.eye(2) - A)
    X = np.linalg.solve(lhs, drive[..., None])[..., 0]
    motion = X.real.sum(axis=0).reshape(n, 2)
    return np.concatenate([step.modes @ motion[:, 0], step.modes @ motion[:, 1]])


def hold_of_tones(frequency: np.ndarray, h: float) -> np.ndarray:
    """c (k, HOLD) = (1, −3 + 4√z − z, 2 − 4√z + 2z), z = exp(iωh): the quadratic hold of exp(iωt) over a step of h [s];
    frequency ω (k,) [rad/s]."""
    half = np.exp(0.5j * frequency * h)
    z = half**2
    return np.stack([np.ones_like(z), -3 + 4 * half - z, 2 - 4 * half + 2 * z], axis=1)
