"""The motion of the filter's model: one step, what is measured at its end, and both Jacobians, all exact."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from strainsight.estimation.model import FilterModel, inputs_of, loads_of, theta_of
from strainsight.fem.affine import AffineOperator
from strainsight.rom.modal_step import ModalMap, acceleration_map, modal_step, parameter_slopes


def constant_step(model: FilterModel) -> ModalMap | None:
    """The modal step once and for all where no parameter is estimated; otherwise None."""
    return None if model.unknowns.parameters else modal_step(model.model, model.fixed, model.h, model.scheme)


def constant_acceleration(model: FilterModel) -> ModalMap | None:
    """The acceleration once and for all where no parameter is estimated and an accelerometer measures."""
    wanted = model.accelerometers is not None and not model.unknowns.parameters
    return acceleration_map(model.model, model.fixed) if wanted else None


def step(
    model: FilterModel, x: np.ndarray, known: np.ndarray, constant: ModalMap | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """One step without process noise and A* = ∂x*⁺/∂x*  (1.50-1.55):

        [q, q̇]⁺ = A(θ)[q, q̇] + Σⱼ Bⱼ(θ)uⱼ,   ζ⁺ = exp(A_u h)ζ,   p⁺ = p

    x (B, n*); known (HOLD, n_known) or (B, HOLD, n_known) hold coefficients [N]; constant: `constant_step(model)`.
    Returns x*⁺ (B, n*) and A* (B, n*, n*), or (1, n*, n*) where no parameter is estimated.
    """
    theta = theta_of(model, x)
    modal = constant or modal_step(model.model, theta, model.h, model.scheme)
    state, u = x[..., model.motion], inputs_of(model, x, known)
    forward = x.copy()
    forward[..., model.motion] = _mapped(modal, state, u)
    forward[..., model.input_states] = x[..., model.input_states] @ model.transition.T
    return forward, augmented_jacobian(model, modal, theta, state, u)


def measure(
    model: FilterModel, x: np.ndarray, known: np.ndarray, constant: ModalMap | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """What the channels read at x* without noise, and the Jacobian:

        strain, displacement   H(θ) x*
        acceleration           φ(θ) M(θ)⁻¹(S u − C(θ)q̇ − K(θ)q)

    x (B, n*); known (n_known,) or (B, n_known) [N] at that instant; constant: `constant_acceleration(model)`.
    Returns y (B, m) and J (B, m, n*), or (1, m, n*) where it is the same for every run.
    """
    if not model.curved:
        return (model.H @ x[..., None])[..., 0], model.H if model.H.ndim == 3 else model.H[None]
    theta = theta_of(model, x)
    H, state, u = model.rows_at(theta), x[..., model.motion], loads_of(model, x, known)[..., None, :]
    y, modal = (H @ x[..., None])[..., 0], None
    if model.accelerometers is not None:
        modal = constant or acceleration_map(model.model, theta)
        read = (H[..., : model.model.size] @ _mapped(modal, state, u)[..., None])[..., 0]
        y = np.where(model.accelerometers, read, y)
    return y, measured_jacobian(model, modal, theta, state, u)


def surface_reading(
    model: FilterModel, rows: np.ndarray, change: AffineOperator, x: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What other places on the surface than the channels read at x* (B, n*), and the Jacobian, as of `measure`.

    rows (k, n) of strain or displacement per coordinate at the references, change: what θ adds to them.
    """
    H = np.hstack([rows, np.zeros((len(rows), model.size - rows.shape[1]))])
    return measure(replace(model, H=H, change=change, quantity=None), x, np.zeros(len(model.known_inputs)))


def augmented_jacobian(
    model: FilterModel, modal: ModalMap, theta: Mapping[str, Any], state: np.ndarray, u: np.ndarray
) -> np.ndarray:
    """A* = [[A, Σⱼ BⱼRⱼ, θ ∂x⁺/∂θ], [0, exp(A_u h), 0], [0, 0, I]]  (1.55), at one or many states; R of `input_hold`.

    modal: the step at theta; state (..., 2n) [q, q̇] and u (..., HOLD, n_u) at the start of the step.
    Returns (..., n*, n*); without estimated parameters (1, n*, n*), as the state does not matter.
    """
    upper = _map_jacobian(model, modal, theta, state, u, model.hold)
    J = np.zeros((*upper.shape[:-2], model.size, model.size))
    J[..., model.motion, :] = upper
    J[..., model.input_states, model.input_states] = model.transition
    parameters = range(model.parameter_states.start, model.size)
    J[..., parameters, parameters] = 1.0
    return J


def measured_jacobian(
    model: FilterModel, modal: ModalMap | None, theta: Mapping[str, Any], state: np.ndarray, u: np.ndarray
) -> np.ndarray:
    """∂y/∂x* at one or many states: H(θ), and for accelerometers φ(θ) [−M⁻¹K, −M⁻¹C, M⁻¹S a C_u, θ ∂q̈/∂θ]; where a thickness is
    free its column has θ ∂H/∂θ q, of accelerometers θ ∂φ/∂θ q̈, too.

    modal: the acceleration at theta, None where no channel reads one; state (..., 2n) and u (..., 1, n_u) at the instant.
    Returns (..., m, n*), where nothing depends on the state (1, m, n*).
    """
    n, H = model.model.size, model.rows_at(theta)
    H = H if H.ndim > 2 else H[None]
    J, q = H, state[..., None, :n]
    if model.accelerometers is not None and modal is not None:
        moving = model.accelerometers[..., None]
        J = np.where(moving, H[..., :n] @ _rates(model, modal, theta, state, u), H)
        q = np.where(moving, _mapped(modal, state, u)[..., None, :], q)
    free = [name for name in model.unknowns.parameters if name in model.change.parameters]
    if free:
        J = np.array(np.broadcast_to(J, np.broadcast_shapes(J.shape, (*state.shape[:-1], 1, 1))))
    for name in free:
        column = model.parameter_states.start + model.unknowns.parameters.index(name)
        slope = np.sum(np.asarray(model.change.derivative(name, theta)) * q, axis=-1)
        J[..., column] += np.asarray(theta[name])[..., None] * slope
    return J


def _rates(
    model: FilterModel, modal: ModalMap, theta: Mapping[str, Any], state: np.ndarray, u: np.ndarray
) -> np.ndarray:
    """∂q̈/∂x* (..., n, n*)."""
    inputs = np.zeros((1, len(model.amplitude), model.input_states.stop - model.input_states.start))
    own = model.position[: len(model.amplitude)] - model.input_states.start
    inputs[0, range(len(own)), own] = model.amplitude
    return _map_jacobian(model, modal, theta, state, u, inputs)


def _map_jacobian(
    model: FilterModel,
    modal: ModalMap,
    theta: Mapping[str, Any],
    state: np.ndarray,
    u: np.ndarray,
    hold: np.ndarray,
) -> np.ndarray:
    """Derivative of a modal map in x*; hold (J, n_ũ, k): its input vectors as rows on ζ. Returns (..., rows, n*)."""
    names = model.unknowns.parameters
    batch = state.shape[:-1] if names else (1,)
    J = np.zeros((*batch, modal.transition.shape[-2], model.size))
    J[..., model.motion] = modal.transition
    inputs = modal.input[..., model.unknowns.input_columns(model.model)]
    held = hold.shape[0] * hold.shape[1]
    J[..., model.input_states] = inputs.reshape(*inputs.shape[:-2], held) @ hold.reshape(held, -1 if held else 0)
    if names:
        slopes = parameter_slopes(model.model, modal, theta, state, u, names)
        scale = np.stack(np.broadcast_arrays(*(theta[name] for name in names)), axis=-1)
        J[..., model.parameter_states] = slopes * scale[..., None, :]
    return J


def _mapped(modal: ModalMap, state: np.ndarray, u: np.ndarray) -> np.ndarray:
    B = modal.input.reshape(*modal.input.shape[:-2], -1)
    return (modal.transition @ state[..., None] + B @ u.reshape(*u.shape[:-2], -1, 1))[..., 0]
