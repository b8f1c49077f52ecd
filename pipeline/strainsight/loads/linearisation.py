"""Augmented linearised systems for any set of unknown inputs and parameters (5.18-5.34, A.1-A.8)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import block_diag, solve_triangular

from strainsight.errors import ConfigError
from strainsight.fem.affine import NO_CHANGE, AffineOperator
from strainsight.loads.input_models import WALK, RandomWalk, Unknowns, input_intensity, positive_of
from strainsight.rom.model import ReducedModel, accelerations, damping_derivative, damping_matrix
from strainsight.sensors.candidates import ACCELERATION


def linearise(
    model: ReducedModel,
    unknowns: Unknowns,
    theta: Mapping[str, float],
    x: np.ndarray,
    u: np.ndarray,
    damping_slope: bool = True,
) -> np.ndarray:
    """Augmented state matrix at instants of a known motion.

        F* = [[0, I, 0, 0], [−M⁻¹K, −M⁻¹C, M⁻¹S a C_u, c], [0, 0, A_u, 0], [0, 0, 0, 0]]
        cᵢ = −θᵢ M⁻¹(∂K/∂θᵢ q + ∂C/∂θᵢ q̇ + ∂M/∂θᵢ q̈ − ∂S/∂θᵢ u),      q̈ = M⁻¹(S u − C q̇ − K q)

    theta: all parameters of the model [SI]; x (s, 2n) = [q, q̇]; u (s, n_u) [N] all inputs of the model, including known ones;
    a: amplitudes of the unknown inputs; A_u, C_u: their time models, u = a C_u ζ with C_u = [1, 0, …] for each (A_u = 0 for a
    random walk); damping_slope: whether c includes ∂C/∂θ, which the printed columns omit.
    Returns F* (s, n*, n*) [1/s].
    Source: (5.30), (5.32), appendix A in one formula; (A.7), (5.30) and (5.34) as printed lack terms."""
    n, n_u = model.size, len(unknowns.inputs)
    M, K, C = model.mass.at(theta), model.stiffness.at(theta), damping_matrix(model, theta)
    inputs, parameters = unknowns.position(model)[:n_u], unknowns.size(model) - len(unknowns.parameters)
    F = np.zeros((len(x), unknowns.size(model), unknowns.size(model)))
    F[:, :n, n : 2 * n] = np.eye(n)
    F[:, n : 2 * n, : 2 * n] = -np.linalg.solve(M, np.hstack([K, C]))
    if n_u:
        S = model.input_shape_at(theta)[:, unknowns.input_columns(model)]
        F[:, n : 2 * n, inputs] = np.linalg.solve(M, S * unknowns.scale[:n_u])
        F[:, 2 * n : parameters, 2 * n : parameters] = unknowns.rate_matrix()
    forces = parameter_forces(model, unknowns, theta, x, u, damping_slope)
    F[:, n : 2 * n, parameters:] = -np.linalg.solve(M, forces)
    return F


def parameter_forces(
    model: ReducedModel,
    unknowns: Unknowns,
    theta: Mapping[str, float],
    x: np.ndarray,
    u: np.ndarray,
    damping_slope: bool = True,
) -> np.ndarray:
    """θᵢ ∂r/∂θᵢ of r = M q̈ + C q̇ + K q − S u, for the unknown parameters; arguments as in `linearise`.

    Returns (s, n, len(parameters)) in the generalised force of the model."""
    n = model.size
    q, v = x[:, :n], x[:, n:]
    a = accelerations(model, theta, x, u)
    forces = np.zeros((len(x), n, len(unknowns.parameters)))
    for i, name in enumerate(unknowns.parameters):
        dK, dM = model.stiffness.derivative(name, theta), model.mass.derivative(name, theta)
        forces[:, :, i] = theta[name] * (q @ dK + a @ dM)
        if damping_slope or name == model.damping.parameter:
            forces[:, :, i] += theta[name] * (v @ damping_derivative(model, theta, name))
        if name in model.input_slope:
            forces[:, :, i] -= theta[name] * (u @ model.input_slope[name].T)
    return forces


def linearisation_instants(
    model: ReducedModel,
    unknowns: Unknowns,
    theta: Mapping[str, float],
    x: np.ndarray,
    u: np.ndarray,
    count: int,
    seed: int,
    share: float = 0.5,
) -> np.ndarray:
    """Seeded, stratified instants at which every unknown parameter affects the motion.

        z(t) = minᵢ ‖fᵢ(t)‖ / max_t ‖fᵢ‖,   fᵢ = θᵢ ∂r/∂θᵢ,  ‖f‖² = fᵀK⁻¹f;   eligible: z(t) ≥ share · max z

    The eligible instants, in time order, are divided into `count` equal strata and one is sampled from each. A parameter is
    unobservable where its force vanishes, so that the nearest of such instants would dominate a plain sample.
    x (s, 2n), u (s, n_u): the whole training simulation. `count=1, share=0` is the thesis: one random instant.
    Returns indices, ascending; fewer than `count` if fewer are eligible; [0] without unknown parameters (F* is then
    constant). Raises ConfigError if a parameter never affects the motion."""
    if not unknowns.parameters:
        return np.array([0])
    forces = parameter_forces(model, unknowns, theta, x, u)
    L = np.linalg.cholesky(model.stiffness.at(theta))
    flat = np.moveaxis(forces, 1, 0).reshape(model.size, -1)
    size = np.linalg.norm(solve_triangular(L, flat, lower=True), axis=0).reshape(len(x), -1)
    largest = size.max(axis=0)
    for name, peak in zip(unknowns.parameters, largest, strict=True):
        if peak <= 0:
            raise ConfigError(
                f"the motion in the training simulation (stage `train`) does not depend on {name}",
                remedy="Apply a load that deforms the regions of this parameter, or remove the parameter.",
            )
    act = (size / largest).min(axis=1)
    eligible = np.flatnonzero(act >= share * act.max())
    rng = np.random.default_rng(seed)
    strata = np.array_split(eligible, min(count, len(eligible)))
    return np.array([rng.choice(stratum) for stratum in strata])


@dataclass(frozen=True)
class Sensed:
    """rows (m, n): strain operator at the references, strain or displacement of a channel per coordinate, for an accelerometer
    the displacement along its axis; quantity (m,); change (m, n): change of the rows with θ."""

    rows: np.ndarray
    quantity: np.ndarray
    change: AffineOperator = NO_CHANGE

    def linearised(
        self,
        model: ReducedModel,
        unknowns: Unknowns,
        theta: Mapping[str, float],
        x: np.ndarray,
        u: np.ndarray,
        F: np.ndarray,
    ) -> np.ndarray:
        """H* (s, m, n*) of `measurement_rows` at instants of a known motion, and in the column of a parameter that the rows
        depend on

            strain, displacement   θᵢ ∂row/∂θᵢ q,     acceleration   θᵢ ∂row/∂θᵢ q̈

        arguments, and F (s, n*, n*), of `linearise`."""
        H = measurement_rows(np.asarray(self.rows + self.change.at(theta)), self.quantity, F)
        moving, first = np.asarray(self.quantity) == ACCELERATION, unknowns.size(model) - len(unknowns.parameters)
        for i, name in enumerate(unknowns.parameters):
            if name in self.change.parameters:
                slope = theta[name] * np.asarray(self.change.derivative(name, theta))
                read = x[:, : model.size] @ slope.T
                if moving.any():
                    read[:, moving] = accelerations(model, theta, x, u) @ slope[moving].T
                H[..., first + i] += read
        return H


def measurement_rows(rows: np.ndarray, quantity: np.ndarray, F: np.ndarray) -> np.ndarray:
    """H* of the linearised measurement y = H* x*:

        strain, displacement   [row, 0, 0, 0]
        acceleration           row · F*[n:2n, :]     q̈ of the linearised system: inputs and parameters enter directly

    rows (m, n), quantity (m,) as of `Sensed`, at θ; F (n*, n*) or (s, n*, n*) [1/s] from `linearise`. Returns (m, n*) or
    (s, m, n*)."""
    n, n_star = rows.shape[1], F.shape[-1]
    H = np.zeros((*F.shape[:-2], len(rows), n_star))
    H[..., :n] = rows
    moving = np.asarray(quantity) == ACCELERATION
    H[..., moving, :] = rows[moving] @ F[..., n : 2 * n, :]
    return H


Rule = Literal["intensity", "thesis", "as_printed"]


def process_intensity(
    size: int,
    unknowns: Unknowns,
    frequency: Mapping[str, float],
    drift: Mapping[str, float],
    *,
    kappa: float | np.ndarray = WALK,
    velocity: float | np.ndarray = 0.0,
    rule: Rule = "intensity",
    h: float | None = None,
) -> np.ndarray:
    """Process-noise intensity of x* = [q, q̇, ζ, p]; in physical units multiply by amplitude² or guess².

        intensity    q_u = κ ω,        q_p = δ²        q_u of a random walk; other input models: `input_intensity`
        thesis       q_u = (hω)²/h,    q_p = (hδ)²/h     the covariances per step (5.16-5.17) as intensities
        as_printed   q_u = (hω)²,      q_p = (hδ)²       those values used in (5.14) without conversion

    size n [-]; frequency: random-walk input → assumed frequency [Hz], ω = 2π·frequency; drift: parameter → δ [1/√s]
    (thesis rules: δ [1/s]); kappa κ [-], one for all inputs or (n_ũ,); velocity (n,) or scalar: intensity of the
    generalised accelerations [kg m²/s³]; h [s].
    Returns Q (n*, n*). Raises ConfigError if a frequency, a drift or the step is missing, and for the rules of the thesis
    with an input that is not a random walk."""
    if rule != "intensity" and not (h and h > 0):
        what = f"process noise rule {rule} requires a positive time step, but the time step h is {h}"
        raise ConfigError(what, remedy="Specify a positive time step h [s].")
    step = h if h is not None else 0.0
    delta = np.array([positive_of(drift, p, "process noise scale") for p in unknowns.parameters])
    factor = {"intensity": 1.0, "thesis": step, "as_printed": step * step}[rule]
    blocks = [np.zeros((size, size)), np.diag(np.broadcast_to(np.asarray(velocity, dtype=float), size))]
    for name, k in zip(unknowns.inputs, np.broadcast_to(kappa, len(unknowns.inputs)), strict=True):
        model, walk = unknowns.model_of(name), 0.0
        if isinstance(model, RandomWalk):
            omega = 2 * np.pi * positive_of(frequency, name, "frequency")
            walk = k * omega if rule == "intensity" else factor * omega**2
        elif rule != "intensity":
            raise ConfigError(
                f"process noise rule {rule} requires the load model random_walk, but load {name} has another model",
                remedy="Set process_noise.rule: continuous (in Python: rule='intensity'), or use random_walk for this load.",
            )
        blocks.append(input_intensity(model, walk))
    return np.asarray(block_diag(*blocks, np.diag(factor * delta**2)))


def gauge_intensity(std: np.ndarray, h: float, rule: Rule = "intensity") -> np.ndarray:
    """r = σ² h [strain² s] of gauges with noise σ = std (m,) [strain] sampled every h [s]; `as_printed`: σ²."""
    variance = np.asarray(std, dtype=float) ** 2
    return variance if rule == "as_printed" else variance * h


def channel_intensity(
    std: np.ndarray, h: float, rows: np.ndarray, quantity: np.ndarray, Q: np.ndarray, rule: Rule = "intensity"
) -> np.ndarray:
    """r of channels of every kind: σ²h, and for an accelerometer φ also the white acceleration of the model,

        y = φ q̈ + v,   q̈ = M⁻¹(S u − C q̇ − K q) + w,   w of intensity Q_v    ⇒    r = σ²h + φ Q_v φᵀ

    Without that term the claimed error is up to 50 times too small (a cantilever, a chain of masses). Its correlation with w in
    the process, Q_v φᵀ, is neglected: the claimed error is 0.96 to 1.6 times the real one there.

    std σ (m,) or (B, m) [unit of the channel] of a sample every h [s]; rows (m, n) or (B, m, n) on q or q̈; quantity (m,)
    or (B, m); Q (n*, n*) of x*. Returns r of the shape of std."""
    n = rows.shape[-1]
    process = np.einsum("...i,ij,...j->...", rows, Q[n : 2 * n, n : 2 * n], rows)
    return gauge_intensity(std, h, rule) + np.where(np.asarray(quantity) == ACCELERATION, process, 0.0)
