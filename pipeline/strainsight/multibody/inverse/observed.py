"""What sensors of a bench cannot separate where it is: unknown loads and parameters that stay as they are (PBH)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.loads.observability import direction_in_words, undetectable_directions
from strainsight.multibody.equations import input_slopes, parameter_slopes
from strainsight.multibody.inverse.model import AugmentedStep
from strainsight.multibody.spectrum import tangent_space

UNKNOWN = 1e-6
"""Share of a direction that unknowns have at least where it is one of them, and not a motion that nothing damps."""

ROUNDING = 1e-12
"""Share of |T| |∂f| in the metric below which their product is none."""


def indistinct(model: AugmentedStep, x: np.ndarray, k: int, names: Sequence[str]) -> list[str]:
    """Combinations of loads and parameters, by their names (nu + p,), that no sensor separates at x (size,) in step k, in words:

        ẋ = [0 1 0 0; −M⁻¹K  −M⁻¹C  M⁻¹B  −M⁻¹∂f/∂ξ; 0; 0] x,   x = (y, ẏ, u, ξ),   y = ∂h/∂x x      undetectable at λ = 0

    of the bench linearised there. Loads are constants in it whatever their model: a stationary one dies away and is called
    detectable, and two on one line of action are no better known for that. `undetectable_directions` balances the units, readings
    count in σ of their noise.
    """
    system, nu = model.system, len(model.inputs)
    u = np.array(model.known[k], dtype=float)
    u[model.inputs] = x[model.u]
    theta, by_xi = model.coordinates.theta(x[model.xi])
    at = tangent_space(system, x[model.q], x[model.v], u, theta)
    T = at.T
    r, p = T.shape[1], model.coordinates.size
    loads = _pushes(system.metric, T, input_slopes(system, at.at, x[model.q])[:, model.inputs])
    parameters = _pushes(system.metric, T, parameter_slopes(system, at.at, x[model.q], x[model.v]) @ by_xi)
    pushed = np.column_stack([-at.project(at.at.stiffness), -at.project(at.at.damping), loads, parameters])
    F = np.zeros((2 * r + nu + p,) * 2)
    F[:r, r : 2 * r] = np.eye(r)
    F[r : 2 * r] = np.linalg.solve(at.project(at.at.mass), pushed)
    J = model.measured_at(x, k)[1] / np.sqrt(model.R)[:, None]
    H = np.hstack([J[:, model.q] @ T, J[:, model.v] @ T, J[:, model.u], J[:, model.xi]])
    lost = undetectable_directions(F, H)
    share = np.abs(lost[2 * r :]).max(axis=0, initial=0.0) / np.abs(lost).max(axis=0, initial=1e-300)
    return [direction_in_words(column, names) for column in lost[:, share > UNKNOWN].T]


def _pushes(d: np.ndarray, T: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """−Tᵀ∂f (r, k); zero where constraints carry all of it and rounding is left, which balanced units would make a push of."""
    found = -T.T @ slopes
    whole = np.linalg.norm(d[:, None] * T) * np.linalg.norm(slopes / d[:, None], axis=0)
    return np.where(np.linalg.norm(found, axis=0) > ROUNDING * whole, found, 0.0)
