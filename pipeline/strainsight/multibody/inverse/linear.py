"""The system about an equilibrium as a linear one: in the coordinates that its constraints leave, in modes, and in steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh

from strainsight.fem.modes import combine_repeated, signs
from strainsight.loads.observability import undetectable_directions, unknowns_in_words
from strainsight.multibody.accelerations import input_slopes, parameter_slopes
from strainsight.multibody.coupled import tangent_space
from strainsight.multibody.inverse.loads import doublings_of, step_noise
from strainsight.multibody.inverse.model import AugmentedStep
from strainsight.multibody.inverse.parameters import white_force
from strainsight.multibody.step import Method, linear_step
from strainsight.multibody.system import System


@dataclass(frozen=True)
class LinearBench:
    """η̈ + C η̇ + diag(λ) η = B u + w about an equilibrium, q + T η, and the unknown inputs u as random walks; unknown
    parameters ξ are inputs behind them, for to first order a parameter is a force that deforms the bench at rest.

    T (n, r) [unit of q per m √kg], TᵀMT = 1; C (r, r) [1/s]; stiffness λ (r,) [rad²/s²], ascending, none of them zero;
    B (r, nu) [m √kg/s² per unit of an input]; increment (nu,) σ of the change of every input in a step of h [s]; force (n,)
    variances of the generalised force on q that is drawn in every step for 1 m/s² of white acceleration; method of the step;
    corrected: whether the filter makes up for what the step leaves out (`left_out`); printed: whether its noise is the thesis's
    Q*, by which a load that changes in a step moves nothing in it."""

    T: np.ndarray
    C: np.ndarray
    stiffness: np.ndarray
    B: np.ndarray
    increment: np.ndarray
    force: np.ndarray
    h: float
    method: Method
    corrected: bool = False
    printed: bool = False

    @property
    def static(self) -> np.ndarray:
        """Change of q per unit of every input (n, nu), at rest."""
        return np.asarray(self.T @ (self.B / self.stiffness[:, None]))

    def readings(self, rows: np.ndarray) -> np.ndarray:
        """H (k, 2r + nu) on (η, η̇, u) of rows (k, n) on q."""
        return np.hstack([rows @ self.T, np.zeros((len(rows), sum(self.B.shape)))])


def linear_bench(
    system: System,
    q: np.ndarray,
    u: np.ndarray,
    theta: np.ndarray,
    inputs: Sequence[int],
    increment: np.ndarray,
    h: float,
    method: Method,
    corrected: bool = False,
    printed: bool = False,
    by_xi: np.ndarray | None = None,
) -> LinearBench:
    """The system about the equilibrium q (n,) under u (all inputs) and θ; inputs: places of the unknown ones; by_xi (nθ, p):
    ∂θ/∂ξ of the unknown parameters, whose columns B_ξ = −Tᵀ ∂f/∂θ ∂θ/∂ξ and increments follow those of the inputs."""
    T, M, C, K, B = linearise(system, q, u, theta, by_xi)
    B = np.hstack([B[:, list(inputs)], B[:, len(system.inputs) :]])
    bench = in_modes(T, M, C, K, B, np.asarray(increment, float), white_force(system, 1.0), h, method)
    return replace(bench, corrected=corrected, printed=printed)


def in_modes(
    T: np.ndarray,
    M: np.ndarray,
    C: np.ndarray,
    K: np.ndarray,
    B: np.ndarray,
    increment: np.ndarray,
    force: np.ndarray,
    h: float,
    method: Method,
) -> LinearBench:
    """M ÿ + C ẏ + K y = B u, q + T y, in its modes K φ = λ M φ. M, C, K (r, r), B (r, nu), others as in `LinearBench`. Repeated
    modes and signs are chosen by the effect of the white force on q, so that they do not depend on rounding."""
    stiffness, modes = eigh(K, M)
    felt = np.sqrt(force)[:, None] * T
    modes = modes @ combine_repeated(stiffness, felt @ modes)
    modes *= signs(felt @ modes)
    return LinearBench(T @ modes, modes.T @ C @ modes, stiffness, modes.T @ B, increment, force, h, method)


def linearise(
    system: System, q: np.ndarray, u: np.ndarray, theta: np.ndarray, by_xi: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """T (n, r), M, C, K (r, r), B_u (r, nu) of small motions about an equilibrium q (n,) under u (nu,), θ (nθ,):

        q + T y,   B(q) T = 0,      M ÿ + C ẏ + K y = B_u Δu
        M = TᵀM(q)T,   C = Tᵀ(∂f/∂v)T,   K = Tᵀ(∂f/∂q − Σ λ ∇²φ)T symmetrised,   B_u = −Tᵀ ∂f/∂u

    T orthonormal in the metric of the mass, so y is in m √kg. u holds all inputs of the system, B_u a column for each, and behind
    them for each of ξ, by_xi (nθ, p) = ∂θ/∂ξ."""
    q, still = np.asarray(q, dtype=float), np.zeros(system.size)
    tangent = tangent_space(system, q, still, u, theta)
    M, C, K = tangent.matrices
    slopes = input_slopes(system, tangent.at, q)
    if by_xi is not None:
        slopes = np.hstack([slopes, parameter_slopes(system, tangent.at, q, still) @ by_xi])
    return tangent.T, 0.5 * (M + M.T), C, 0.5 * (K + K.T), tangent.pushes(slopes)


def build_continuous_model(
    bench: LinearBench, acceleration: float, changes: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """F (n*, n*) [1/s] and the intensity Q (n*, n*) of ẋ = F x + w, x = (η, η̇, u):

        F = [0  I  0; −diag λ  −C  B; 0  0  0],   Q = diag(0, h W, increment²/h)

    W the covariance of the white force in a step, of a white acceleration [m/s²] of every body; drawn (nu,): in place of
    increment."""
    r, nu = bench.B.shape
    changes = bench.increment if changes is None else changes
    F, Q = np.zeros((2, 2 * r + nu, 2 * r + nu))
    F[:r, r : 2 * r] = np.eye(r)
    F[r : 2 * r] = np.hstack([-np.diag(bench.stiffness), -bench.C, bench.B])
    Q[r : 2 * r, r : 2 * r] = bench.h * acceleration**2 * (bench.T.T * bench.force) @ bench.T
    Q[2 * r :, 2 * r :] = np.diag(changes**2 / bench.h)
    return F, Q


def build_discrete_model(
    bench: LinearBench, acceleration: float, changes: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A (n*, n*) and N (n*, nu + n) of the filter's own step x' = A x + N · (white, σ = 1), with the stages of `advance`:

        thesis        z' = X z + b(u + δ) + b w,                      X, b of one stage of h
        second_order  z' = X (z + c (k − z)) + b(u + δ) + b w,        k = X z + b(u + γδ) + b w,   of stages of γh,  c = (1 − γ)/γ

    z = (η, η̇), u' = u + δ, the step with δ = 0 where `printed`. scale (n*,), (η, η̇, u) = scale · x: u in increments, η and η̇
    in what stores the energy that the largest increment does at rest. There no motion grows in a step, whatever the units, and
    one that no input moves has no unit of rounding. drawn (nu,): σ of the changes in a step, where it is not the increment, which
    then is a unit."""
    r, nu = bench.B.shape
    std = bench.increment if changes is None else changes
    frequency = np.sqrt(np.abs(bench.stiffness))
    energy = np.linalg.norm(bench.B * bench.increment / frequency[:, None], axis=0).max(initial=0.0) or 1.0
    scale = np.concatenate([energy / frequency, np.full(r, energy), bench.increment])
    shaken = bench.T.T * (acceleration * np.sqrt(bench.force))
    through, first, last = linear_step(np.eye(r), bench.C, np.diag(bench.stiffness), bench.h, bench.method)
    force = (first + last) @ shaken
    if bench.corrected:
        # sampled exactly, as the filter has it; the white force acts in the step as before
        F, Q = build_continuous_model(bench, 0.0, std)
        units = np.concatenate([frequency, np.ones(r + nu)])
        F, Q = units[:, None] * F / units, units[:, None] * Q * units
        parts = doublings_of(max(bench.h * float(np.linalg.norm(F[: 2 * r, : 2 * r], 2)), 1.0))
        A, gathered = step_noise(F, Q, bench.h / 2**parts, parts)
        A, gathered = A / units[:, None] * units, gathered / units[:, None] / units
        white = np.zeros((2 * r + nu, shaken.shape[1]))
        white[: 2 * r] = force
        process = scale[:, None] * _factor(gathered / scale[:, None] / scale)
        return A / scale[:, None] * scale, np.hstack([process, white]) / scale[:, None], scale
    A, N = np.eye(2 * r + nu), np.zeros((2 * r + nu, nu + shaken.shape[1]))
    A[: 2 * r, : 2 * r], A[: 2 * r, 2 * r :] = through, (first + last) @ bench.B
    N[: 2 * r, :nu], N[2 * r :, :nu], N[: 2 * r, nu:] = (
        0.0 if bench.printed else last @ bench.B * std,
        np.diag(std),
        force,
    )
    return A / scale[:, None] * scale, N / scale[:, None], scale


def _factor(P: np.ndarray) -> np.ndarray:
    """F (n, n) with F Fᵀ = P (n, n), positive semidefinite."""
    size = np.sqrt(np.where(np.diag(P) > 0, np.diag(P), 1.0))
    values, vectors = np.linalg.eigh(P / np.outer(size, size))
    return np.asarray(size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


UNKNOWN = 1e-6
"""Share of a direction that unknowns have at least where it is one of them, and not a motion that nothing damps."""

ROUNDING = 1e-12
"""Share of |T| |∂f| in the metric below which their product is none."""


def indistinct(model: AugmentedStep, x: np.ndarray, k: int, names: Sequence[str]) -> list[str]:
    """Combinations of loads and parameters, by their names (nu + p,), that no sensor separates at x (size,) in step k, in words:

        ẋ = [0 1 0 0; −M⁻¹K  −M⁻¹C  M⁻¹B  −M⁻¹∂f/∂ξ; 0; 0] x,   x = (y, ẏ, u, ξ),   y = ∂h/∂x x      undetectable at λ = 0

    of the bench linearised there. Loads are constants in it whatever their model: a stationary one dies away and is called
    detectable, and two on one line of action are no better known for that. `undetectable_directions` balances the units, readings
    count in σ of their noise."""
    system, nu = model.system, len(model.inputs)
    u = np.array(model.known[k], dtype=float)
    u[model.inputs] = x[model.u]
    theta, by_xi = model.coordinates.theta(x[model.xi])
    at = tangent_space(system, x[model.q], x[model.v], u, theta)
    T = at.T
    r, p = T.shape[1], model.coordinates.size
    loads = _pushes(system.metric, T, input_slopes(system, at.at, x[model.q])[:, model.inputs])
    parameters = _pushes(system.metric, T, parameter_slopes(system, at.at, x[model.q], x[model.v]) @ by_xi)
    M, C, K = at.matrices
    F = np.zeros((2 * r + nu + p,) * 2)
    F[:r, r : 2 * r] = np.eye(r)
    F[r : 2 * r] = np.linalg.solve(M, np.column_stack([-K, -C, loads, parameters]))
    J = model.measured_at(x, k)[1] / np.sqrt(model.R)[:, None]
    H = np.hstack([J[:, model.q] @ T, J[:, model.v] @ T, J[:, model.u], J[:, model.xi]])
    lost = undetectable_directions(F, H)
    share = np.abs(lost[2 * r :]).max(axis=0, initial=0.0) / np.abs(lost).max(axis=0, initial=1e-300)
    return [unknowns_in_words(column, names) for column in lost[:, share > UNKNOWN].T]


def _pushes(d: np.ndarray, T: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """−Tᵀ∂f (r, k); zero where constraints carry all of it and rounding is left, which balanced units would make a push of."""
    forces = -T.T @ slopes
    whole = np.linalg.norm(d[:, None] * T) * np.linalg.norm(slopes / d[:, None], axis=0)
    return np.where(np.linalg.norm(forces, axis=0) > ROUNDING * whole, forces, 0.0)
