"""Augmented linearised systems for any set of unknown inputs and parameters (5.18-5.34, A.1-A.8)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from strainsight.errors import ConfigError
from strainsight.rom.model import ReducedModel, damping_derivative, damping_matrix


@dataclass(frozen=True)
class Unknowns:
    """What is estimated beside the states: x* = [q, q̇, ũ, p] with uᵢ = amplitudeᵢ ũᵢ and θᵢ = guessᵢ exp(pᵢ).

    inputs, parameters: names in the order of ũ and p; amplitude: input → [N]; guess: parameter → [SI], positive.
    Both may hold more names than are unknown. Raises ConfigError where a scale is missing or not positive.
    """

    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    amplitude: Mapping[str, float]
    guess: Mapping[str, float]

    def __post_init__(self) -> None:
        for names, scales, word in (
            (self.inputs, self.amplitude, "amplitude"),
            (self.parameters, self.guess, "guess"),
        ):
            for name in names:
                value = scales.get(name)
                if value is None or not 0 < value < np.inf:
                    raise ConfigError(f"{word} of {name} is {value}", remedy=f"give {name} a positive {word}")

    @property
    def names(self) -> tuple[str, ...]:
        """Inputs, then parameters, in the order of the last states of x*."""
        return self.inputs + self.parameters

    @property
    def count(self) -> int:
        return len(self.inputs) + len(self.parameters)

    @property
    def scale(self) -> np.ndarray:
        """Amplitudes, then guesses (count,) [N and SI]: a small change of the i-th unknown is scaleᵢ dx*."""
        return np.array([self.amplitude[i] for i in self.inputs] + [self.guess[p] for p in self.parameters])

    def size(self, model: ReducedModel) -> int:
        """n* = 2n + count."""
        return 2 * model.size + self.count

    def input_columns(self, model: ReducedModel) -> list[int]:
        """Columns of the model's input shape that belong to the unknown inputs, in their order."""
        return [model.inputs.index(name) for name in self.inputs]


def linearise(
    model: ReducedModel, unknowns: Unknowns, theta: Mapping[str, float], x: np.ndarray, u: np.ndarray
) -> np.ndarray:
    """Augmented state matrix at given instants of a known motion.

        F* = [[0, I, 0, 0], [−M⁻¹K, −M⁻¹C, M⁻¹S a, c], [0, 0, 0, 0], [0, 0, 0, 0]]
        cᵢ = −θᵢ M⁻¹(∂K/∂θᵢ q + ∂C/∂θᵢ q̇ + ∂M/∂θᵢ q̈),      q̈ = M⁻¹(S u − C q̇ − K q)

    theta: all parameters of the model [SI]; x (s, 2n) = [q, q̇]; u (s, n_u) [N] all inputs of the model, known ones too;
    a: amplitudes of the unknown inputs. Returns F* (s, n*, n*) [1/s].
    Source: (5.30), (5.32), appendix A in one formula; (A.7), (5.30) and (5.34) as printed lack terms.
    """
    n, n_u = model.size, len(unknowns.inputs)
    M, K, C = model.mass.at(theta), model.stiffness.at(theta), damping_matrix(model, theta)
    amplitude = unknowns.scale[:n_u]
    F = np.zeros((len(x), unknowns.size(model), unknowns.size(model)))
    F[:, :n, n : 2 * n] = np.eye(n)
    F[:, n : 2 * n, : 2 * n] = -np.linalg.solve(M, np.hstack([K, C]))
    if n_u:
        S = model.input_shape[:, unknowns.input_columns(model)]
        F[:, n : 2 * n, 2 * n : 2 * n + n_u] = np.linalg.solve(M, S * amplitude)
    forces = parameter_forces(model, unknowns, theta, x, u)
    F[:, n : 2 * n, 2 * n + n_u :] = -np.linalg.solve(M, forces)
    return F


def parameter_forces(
    model: ReducedModel, unknowns: Unknowns, theta: Mapping[str, float], x: np.ndarray, u: np.ndarray
) -> np.ndarray:
    """θᵢ ∂r/∂θᵢ of r = M q̈ + C q̇ + K q − S u, for the unknown parameters; arguments as in `linearise`.

    Returns (s, n, len(parameters)) in the generalised force of the model.
    """
    n = model.size
    M, K, C = model.mass.at(theta), model.stiffness.at(theta), damping_matrix(model, theta)
    q, v = x[:, :n], x[:, n:]
    a = np.linalg.solve(M, (u @ model.input_shape.T - v @ C - q @ K).T).T
    forces = np.zeros((len(x), n, len(unknowns.parameters)))
    for i, name in enumerate(unknowns.parameters):
        dK, dC, dM = (
            model.stiffness.derivative(name),
            damping_derivative(model, theta, name),
            model.mass.derivative(name),
        )
        forces[:, :, i] = theta[name] * (q @ dK + v @ dC + a @ dM)
    return forces


def augment_rows(rows: np.ndarray, unknowns: Unknowns) -> np.ndarray:
    """H* = [H, 0, 0, 0] (m, n*): strain rows (m, n) on x*; at given q nothing else enters."""
    m, n = rows.shape
    return np.hstack([rows, np.zeros((m, n + unknowns.count))])


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
    """Seeded, stratified instants at which every unknown parameter acts on the motion.

        z(t) = minᵢ ‖fᵢ(t)‖ / max_t ‖fᵢ‖,   fᵢ = θᵢ ∂r/∂θᵢ,  ‖f‖² = fᵀK⁻¹f;   eligible: z(t) ≥ share · max z

    The eligible instants, in time order, are cut into `count` equal strata and one is drawn from each. A parameter is
    unobservable where its force vanishes, so a plain draw is ruled by the instants nearest to that.
    x (s, 2n), u (s, n_u): the whole training run. `count=1, share=0` is the thesis: one random instant.
    Returns indices, ascending; fewer than `count` where fewer are eligible; [0] where no parameter is unknown (F* is
    then the same everywhere). Raises ConfigError where a parameter never acts.
    """
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
                f"the training motion never depends on {name}", remedy="load the structure, or do not estimate it"
            )
    act = (size / largest).min(axis=1)
    eligible = np.flatnonzero(act >= share * act.max())
    rng = np.random.default_rng(seed)
    strata = np.array_split(eligible, min(count, len(eligible)))
    return np.array([rng.choice(stratum) for stratum in strata])
