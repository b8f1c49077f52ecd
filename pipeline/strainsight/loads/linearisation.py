"""Augmented linearised systems for any set of unknown inputs and parameters (5.18-5.34, A.1-A.8)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.linalg import solve_triangular

from strainsight.errors import ConfigError
from strainsight.loads.unknowns import Unknowns
from strainsight.rom.model import ReducedModel, accelerations, damping_derivative, damping_matrix

__all__ = ["Unknowns", "augment_rows", "linearisation_instants", "linearise", "parameter_forces"]


def linearise(
    model: ReducedModel,
    unknowns: Unknowns,
    theta: Mapping[str, float],
    x: np.ndarray,
    u: np.ndarray,
    damping_slope: bool = True,
) -> np.ndarray:
    """Augmented state matrix at given instants of a known motion.

        F* = [[0, I, 0, 0], [−M⁻¹K, −M⁻¹C, M⁻¹S a C_u, c], [0, 0, A_u, 0], [0, 0, 0, 0]]
        cᵢ = −θᵢ M⁻¹(∂K/∂θᵢ q + ∂C/∂θᵢ q̇ + ∂M/∂θᵢ q̈ − ∂S/∂θᵢ u),      q̈ = M⁻¹(S u − C q̇ − K q)

    theta: all parameters of the model [SI]; x (s, 2n) = [q, q̇]; u (s, n_u) [N] all inputs of the model, known ones too;
    a: amplitudes of the unknown inputs; A_u, C_u: their models in time, u = a C_u ζ with C_u = [1, 0, …] for each (a
    random walk has A_u = 0); damping_slope: whether c has ∂C/∂θ, which is not in the printed columns.
    Returns F* (s, n*, n*) [1/s].
    Source: (5.30), (5.32), appendix A in one formula; (A.7), (5.30) and (5.34) as printed lack terms.
    """
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

    Returns (s, n, len(parameters)) in the generalised force of the model.
    """
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


def augment_rows(rows: np.ndarray, unknowns: Unknowns) -> np.ndarray:
    """H* = [H, 0, 0, 0] (m, n*): strain rows (m, n) on x*; at given q nothing else enters."""
    m, n = rows.shape
    return np.hstack([rows, np.zeros((m, n + len(unknowns.state_names)))])


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
