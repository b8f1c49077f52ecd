"""The reduced model (5.3), its damping, and its quasi-static limit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

import numpy as np
from scipy.linalg import eigh

from strainsight.columns import Column
from strainsight.fem.affine import AffineOperator
from strainsight.ordering import TIE


@dataclass(frozen=True)
class Damping:
    """Viscous damping that commutes with the modes: each mode has c(λ) = 2ζ√λ (modal) or α + βλ (Rayleigh), λ = ω².

    The ratio does not depend on the parameters. factors [-] on c of every mode in ascending order of λ, default 1; modes of one
    frequency have the factor of the first of them, because their combinations are modes too. value θ of the parameter that
    multiplies every c [-], (..., 1) for many at once."""

    kind: Annotated[
        Literal["modal", "rayleigh"],
        Column("1", "", "damping model: modal (the same ratio in every mode) or rayleigh (αM + βK)"),
    ] = "modal"
    ratio: Annotated[float, Column("1", "", "modal damping ratio ζ")] = 0.0
    alpha: Annotated[float, Column("1/s", "", "Rayleigh coefficient α of the mass matrix")] = 0.0
    beta: Annotated[float, Column("s", "", "Rayleigh coefficient β of the stiffness matrix")] = 0.0
    factors: tuple[float, ...] = ()
    parameter: Annotated[
        str, Column("1", "", "name of the parameter that multiplies the damping; empty: no such parameter")
    ] = ""
    value: float | np.ndarray = 1.0

    def at(self, theta: Mapping[str, Any]) -> Damping:
        """The damping at θ, values of shape (...)."""
        return replace(self, value=np.asarray(theta[self.parameter])[..., None]) if self.parameter else self

    def viscous(self, lam: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """c(λ) and dc/dλ; lam (...) [rad²/s²], with factors (..., n) ascending for all n modes."""
        f = self.value * (np.array(self.factors)[first_of_equal(lam)] if self.factors else 1.0)
        if self.kind == "modal":
            c = f * 2 * self.ratio * np.sqrt(lam)
            return c, c / (2 * lam)
        return f * (self.alpha + self.beta * lam), f * np.full_like(lam, self.beta)

    def scaled(self, factor: float | Sequence[float]) -> Damping:
        """The same damping multiplied by a factor; a sequence (n,): mode by mode."""
        if isinstance(factor, Sequence):
            return replace(self, factors=tuple(factor))
        return replace(self, ratio=factor * self.ratio, alpha=factor * self.alpha, beta=factor * self.beta)


def first_of_equal(lam: np.ndarray) -> np.ndarray:
    """For each of the eigenvalues (..., n), ascending, the index of the first of those equal to it within a tie."""
    first = np.zeros(lam.shape, dtype=int)
    for j in range(1, lam.shape[-1]):
        before = first[..., j - 1]
        lowest = np.take_along_axis(lam, before[..., None], -1)[..., 0]
        first[..., j] = np.where(lam[..., j] <= lowest * (1 + TIE), before, j)
    return first


@dataclass(frozen=True)
class ReducedModel:
    """M(θ)q̈ + C(θ)q̇ + K(θ)q = S(θ) u in coordinates where M = I and K = Λ at the reference (5.3).

    mass, stiffness: dense affine operators (n, n); input_shape S (n, n_u) [1/√kg] at the reference; inputs: the names of u;
    reference: parameter name → value [SI] at which the coordinates are modal; input_slope: parameter name → ∂S/∂θ (n, n_u), for
    the densities that loads on mass are proportional to:

        S(θ) = S + Σᵢ (θᵢ − θᵢ⁰) ∂S/∂θᵢ

    frequency_factors f (..., n): of the natural frequencies in steps and accelerations (`modal_map`), None: 1."""

    mass: AffineOperator
    stiffness: AffineOperator
    input_shape: np.ndarray
    inputs: tuple[str, ...]
    reference: Mapping[str, float]
    damping: Damping
    input_slope: Mapping[str, np.ndarray] = field(default_factory=dict)
    frequency_factors: np.ndarray | None = None

    def input_shape_at(self, theta: Mapping[str, Any]) -> np.ndarray:
        """S(θ) (..., n, n_u) for values of shape (...); (n, n_u) if constant."""
        S = self.input_shape
        for name, slope in self.input_slope.items():
            S = S + (np.asarray(theta[name]) - self.reference[name])[..., None, None] * slope
        return S

    def acted_on(self, shape: np.ndarray) -> ReducedModel:
        """The same model under loads of another input shape (n, n_u), independent of θ."""
        return replace(self, input_shape=shape, input_slope={})

    def with_damping(self, name: str, value: float) -> ReducedModel:
        """The same model with an added parameter, its name and reference value [-], that multiplies the damping."""
        return replace(self, reference={**self.reference, name: value}, damping=replace(self.damping, parameter=name))

    @property
    def parameters(self) -> tuple[str, ...]:
        return tuple(self.reference)

    @property
    def size(self) -> int:
        return self.input_shape.shape[0]


def modal_basis(model: ReducedModel, theta: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Modes of K(θ)Φ = M(θ)ΦΛ with ΦᵀMΦ = I: λ (..., n) ascending [rad²/s²] and Φ (..., n, n), for values θ of shape (...)."""
    K, M = model.stiffness.at(theta), model.mass.at(theta)
    L_inverse = np.linalg.inv(np.linalg.cholesky(M))
    lam, V = np.linalg.eigh(L_inverse @ K @ np.swapaxes(L_inverse, -1, -2))
    return lam, np.swapaxes(L_inverse, -1, -2) @ V


def damping_matrix(model: ReducedModel, theta: Mapping[str, float]) -> np.ndarray:
    """C(θ) = M Φ c(Λ) ΦᵀM  (n, n) [1/s]: the modal or Rayleigh damping in the coordinates of the model."""
    lam, Phi = modal_basis(model, theta)
    M = model.mass.at(theta)
    MPhi = M @ Phi
    return (MPhi * model.damping.at(theta).viscous(lam)[0]) @ MPhi.T


def accelerations(model: ReducedModel, theta: Mapping[str, float], x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """q̈ = M⁻¹(S u − C q̇ − K q) (s, n), of states x (s, 2n) = [q, q̇] under loads u (s, n_u) [N]."""
    n = model.size
    force = (
        u @ model.input_shape_at(theta).T
        - x[:, :n] @ model.stiffness.at(theta)
        - x[:, n:] @ damping_matrix(model, theta)
    )
    return np.asarray(np.linalg.solve(model.mass.at(theta), force.T).T)


def frequency_response(
    model: ReducedModel, theta: Mapping[str, float], rows: np.ndarray, frequency: np.ndarray
) -> np.ndarray:
    """Frequency response functions H (f, m, n_u) of readings R q (rows R (m, n)), complex, at frequencies (f,) [Hz]:

        H(ω) = R (K + iωC − ω²M)⁻¹ S = R Φ (Λ + iω c(Λ) − ω²)⁻¹ Φᵀ S,     ω = 2πf

    Coordinates above the modes of interest contribute their static residual: at 0 Hz H = R K⁻¹ S."""
    lam, Phi = modal_basis(model, theta)
    omega = 2 * np.pi * frequency[:, None]
    dynamic_stiffness = lam + 1j * omega * model.damping.at(theta).viscous(lam)[0] - omega**2
    return np.asarray(((rows @ Phi) / dynamic_stiffness[:, None]) @ (Phi.T @ model.input_shape_at(theta)))


def damping_derivative(model: ReducedModel, theta: Mapping[str, float], name: str) -> np.ndarray:
    """∂C/∂θ_name (n, n), consistent with `damping_matrix`: with A = M⁻¹K and C = M c(A),

        dC = dM c(A) + M Φ [(ΦᵀM dA Φ) ∘ c[λᵢ, λⱼ]] ΦᵀM,    ΦᵀM dA Φ = Φᵀ(dK Φ − dM Φ Λ)

    c[·,·] the divided difference (Daleckii-Krein), so that repeated frequencies need no special case. For the parameter that
    multiplies the damping it is C/θ."""
    if name == model.damping.parameter:
        return damping_matrix(model, theta) / theta[name]
    K, M = model.stiffness.at(theta), model.mass.at(theta)
    lam, Phi = eigh(K, M)
    dK, dM = model.stiffness.derivative(name, theta), model.mass.derivative(name, theta)
    c, slope = model.damping.at(theta).viscous(lam)
    G = Phi.T @ (dK @ Phi - (dM @ Phi) * lam)
    MPhi = M @ Phi
    return (dM @ Phi * c) @ MPhi.T + MPhi @ (G * divided_difference(lam, c, slope)) @ MPhi.T


def divided_difference(lam: np.ndarray, f: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """f[λᵢ, λⱼ] = (f(λᵢ) − f(λⱼ))/(λᵢ − λⱼ), and the mean slope where λᵢ and λⱼ agree to 1e-5; (..., n) → (..., n, n)."""
    gap = lam[..., :, None] - lam[..., None, :]
    close = np.abs(gap) <= 1e-5 * (np.abs(lam[..., :, None]) + np.abs(lam[..., None, :]))
    quotient = (f[..., :, None] - f[..., None, :]) / np.where(close, 1.0, gap)
    return np.where(close, 0.5 * (slope[..., :, None] + slope[..., None, :]), quotient)


FASTER, IN_A_STEP = 100.0, 300.0
"""ω_s over ω of the first mode, and the largest ω_s times the time step: a higher ω_s of slow loads exceeds double precision."""
RATIO = 0.7
"""Damping ratio of the coordinates for the fastest response without oscillation."""


def quasi_static(model: ReducedModel, basis: np.ndarray, time_step: float) -> tuple[ReducedModel, np.ndarray]:
    """Quasi-static model with M = K(θ₀)/ω_s² as its mass, and its basis, in coordinates where again M = I, K(θ₀) = Λ = ω_s² I:

        Ψ′ = Ψ ω_s Λ^(−1/2),    K′(θ) = ω_s² Λ^(−1/2) K(θ) Λ^(−1/2),    S′ = ω_s Λ^(−1/2) S

    All coordinates have the frequency ω_s = 100 ω₁, at most 300 over the time step [s], and 0.7 of critical damping: under a load
    of frequency ω they lag behind their static response by 1.4 ω/ω_s (1.4e-3 at a tenth of the first mode, 3.7e-3 with 8 steps
    per period), and initial transients decay before the first sample. So filters and placement are those of a model with inertia.
    The effect of inertia, (ω/ω₁)², is neglected. model: modal
    at the reference; basis Ψ (n_free, r) [1/√kg]; densities change only their loads."""
    stiffness = np.diag(model.stiffness.at(model.reference))
    speed = min(FASTER * np.sqrt(stiffness.min()), IN_A_STEP / time_step)
    D = np.diag(speed / np.sqrt(stiffness))
    return (
        replace(
            model,
            mass=AffineOperator(np.eye(model.size), {}),
            stiffness=model.stiffness.project(D),
            input_shape=D @ model.input_shape,
            input_slope={name: D @ slope for name, slope in model.input_slope.items()},
            damping=Damping("modal", RATIO),
        ),
        basis @ D,
    )
