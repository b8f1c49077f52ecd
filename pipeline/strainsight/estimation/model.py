"""The discrete augmented model of the filter: one exact step, and its Jacobian from the discretised equation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from strainsight.augmentation.linearisation import Unknowns
from strainsight.errors import ConfigError
from strainsight.rom.modal_step import ModalStep, modal_step, parameter_slopes
from strainsight.rom.model import ReducedModel
from strainsight.rom.oscillator import HOLD


@dataclass(frozen=True)
class FilterModel:
    """x*⁺ = f(x*, u) + w,   w ~ N(0, Q h);     y = H x* + v,   v ~ N(0, r/h)     (1.44)

    for x* = [q, q̇, ũ, p] (n* = 2n + n_ũ + n_p) with u = amplitude·ũ and θ = guess·exp(p): unknown inputs are constant
    within a step, as parameters are, and walk at random between steps: ũ at kh is the load from kh to (k + 1)h.

    model: the reduced model (n modes); unknowns: what is estimated; known_inputs: the inputs that are given (an input
    of the model that is neither is zero); fixed: value [SI] of every parameter that is not estimated;
    H (m, n*) or (B, m, n*) strain rows, one set a run; Q (n*, n*) or (B, n*, n*) intensity [x*²/s];
    r (m,) or (B, m) intensity [strain² s], σ²h_sample of a gauge sampled at h_sample; h [s] time step.
    Raises ConfigError for an input both known and unknown, or a parameter neither fixed nor estimated.
    """

    model: ReducedModel
    unknowns: Unknowns
    known_inputs: tuple[str, ...]
    fixed: Mapping[str, float]
    H: np.ndarray
    Q: np.ndarray
    r: np.ndarray
    h: float

    def __post_init__(self) -> None:
        for name in self.unknowns.inputs:
            if name in self.known_inputs:
                raise ConfigError(f"input {name} is both known and estimated", remedy="choose one")
        for name in self.model.parameters:
            if name not in self.fixed and name not in self.unknowns.parameters:
                raise ConfigError(f"parameter {name} has no value", remedy="estimate it or give its value")

    @property
    def size(self) -> int:
        """n*."""
        return self.unknowns.size(self.model)

    @property
    def input_states(self) -> slice:
        """Where ũ stands in x*."""
        return slice(2 * self.model.size, 2 * self.model.size + len(self.unknowns.inputs))

    @property
    def parameter_states(self) -> slice:
        """Where p stands in x*."""
        return slice(2 * self.model.size + len(self.unknowns.inputs), self.size)

    @property
    def amplitude(self) -> np.ndarray:
        """Unit of every ũ (n_ũ,)."""
        return self.unknowns.scale[: len(self.unknowns.inputs)]


def theta_of(model: FilterModel, x: np.ndarray) -> dict[str, Any]:
    """θ [SI] at x* (..., n*): the fixed values, and guess·exp(p) of shape (...) for the estimated ones."""
    p = x[..., model.parameter_states]
    names, guess = model.unknowns.parameters, model.unknowns.guess
    return {**model.fixed, **{name: guess[name] * np.exp(p[..., i]) for i, name in enumerate(names)}}


def inputs_of(model: FilterModel, x: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Hold coefficients (..., HOLD, n_u) of all inputs: known (..., HOLD, n_known), constant those in x* (..., n*)."""
    column = {name: i for i, name in enumerate(model.model.inputs)}
    u = np.zeros((*x.shape[:-1], HOLD, len(column)))
    u[..., [column[name] for name in model.known_inputs]] = known
    u[..., 0, [column[name] for name in model.unknowns.inputs]] = model.amplitude * x[..., model.input_states]
    return u


def constant_step(model: FilterModel) -> ModalStep | None:
    """The modal step once and for all where no parameter is estimated; otherwise None."""
    return None if model.unknowns.parameters else modal_step(model.model, model.fixed, model.h)


def step(
    model: FilterModel, x: np.ndarray, known: np.ndarray, constant: ModalStep | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """One step without process noise, [q, q̇]⁺ = A(θ)[q, q̇] + B(θ)u, ũ⁺ = ũ, p⁺ = p, and A* = ∂x*⁺/∂x* (1.50-1.55).

    x (B, n*); known (HOLD, n_known) or (B, HOLD, n_known) hold coefficients [N]; constant: `constant_step(model)`.
    Returns x*⁺ (B, n*) and A* (B, n*, n*), or (1, n*, n*) where no parameter is estimated.
    """
    theta = theta_of(model, x)
    modal = constant or modal_step(model.model, theta, model.h)
    state, u = x[..., : 2 * model.model.size], inputs_of(model, x, known)
    forward = x.copy()
    B = modal.input.reshape(*modal.input.shape[:-2], -1)
    drive = B @ u.reshape(*u.shape[:-2], -1, 1)
    forward[..., : state.shape[-1]] = (modal.transition @ state[..., None] + drive)[..., 0]
    return forward, augmented_jacobian(model, modal, theta, state, u)


def augmented_jacobian(
    model: FilterModel, modal: ModalStep, theta: Mapping[str, Any], state: np.ndarray, u: np.ndarray
) -> np.ndarray:
    """A* = [[A, B₀ amplitude, θ ∂x⁺/∂θ], [0, I]]  (1.55), at one or many states.

    modal: the step at theta; state (..., 2n) [q, q̇] and u (..., HOLD, n_u) at the start of the step.
    Returns (..., n*, n*); without estimated parameters (1, n*, n*), as the state does not matter.
    """
    names = model.unknowns.parameters
    motion = slice(0, state.shape[-1])
    batch = state.shape[:-1] if names else (1,)
    J = np.zeros((*batch, model.size, model.size))
    J[..., range(model.size), range(model.size)] = 1.0
    J[..., motion, motion] = modal.transition
    columns = [model.model.inputs.index(name) for name in model.unknowns.inputs]
    J[..., motion, model.input_states] = modal.input[..., 0, columns] * model.amplitude
    if names:
        slopes = parameter_slopes(model.model, modal, state, u, names)
        scale = np.stack(np.broadcast_arrays(*(theta[name] for name in names)), axis=-1)
        J[..., motion, model.parameter_states] = slopes * scale[..., None, :]
    return J


def physical(model: FilterModel, mean: np.ndarray, std: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Value and standard deviation [SI] of every unknown: u = amplitude·ũ; θ = guess·exp(p), σ_θ = θ σ_p (first order).

    mean, std (..., n*). Returns arrays of shape (...).
    """
    i, j = model.input_states.start, model.parameter_states.start
    values = {
        name: (a * mean[..., i + k], a * std[..., i + k])
        for k, (name, a) in enumerate(zip(model.unknowns.inputs, model.amplitude, strict=True))
    }
    for k, name in enumerate(model.unknowns.parameters):
        theta = model.unknowns.guess[name] * np.exp(mean[..., j + k])
        values[name] = (theta, theta * std[..., j + k])
    return values
