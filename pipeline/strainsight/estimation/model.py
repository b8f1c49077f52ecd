"""Discrete augmented model of the filter: state, step, measurement, and their exact Jacobians."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import expm, matrix_balance

from strainsight.errors import ConfigError
from strainsight.fem.affine import NO_CHANGE, AffineOperator
from strainsight.loads.histories import quadratic_hold
from strainsight.loads.input_models import RandomWalk, Unknowns, line_intensity, positive_of
from strainsight.loads.linearisation import linearise
from strainsight.rom.modal_step import HOLD, ModalMap, Scheme, acceleration_map, modal_step, parameter_slopes
from strainsight.rom.model import ReducedModel
from strainsight.sensors.candidates import ACCELERATION


@dataclass(frozen=True)
class FilterModel:
    """x*⁺ = f(x*, u) + w,   w ~ N(0, Q_h);     y = h(x*, u) + v,   v ~ N(0, R)     (1.44)

    for x* = [q, q̇, ζ, p] (n* = 2n + Σk + n_p) with u = amplitude·ũ, ũ = ζ₁ of every unknown input, and θ = guess·exp(p).
    Within a step the mean of ζ follows its own dynamics, that of a random walk is constant, and so is p; what all of them
    drift within it, and the motion that causes, is in Q_h. ũ at kh is the load at that instant.
    h(x*, u) is H x* for strain and displacement, φ q̈ for an accelerometer, linear in x* unless a parameter is estimated.

    model: the reduced model (n modes); unknowns: what is estimated; known_inputs: the inputs that are given (an input
    of the model that is neither is zero); fixed: value [SI] of every parameter that is not estimated;
    H (m, n*) or (B, m, n*) rows, one set a run: of strain or displacement on x*, of an accelerometer φ on q̈ in the first
    n columns; Q (n*, n*) or (B, n*, n*) intensity [x*²/s];
    r (m,), (B, m) or, a row a step, (T, 1 or B, m) intensity [unit² s], σ²h_sample of a sensor sampled at h_sample;
    h [s] time step; quantity (m,) or (B, m): what every channel measures, STRAIN where not given;
    change (m, n) or (B, m, n): what θ adds to the first n columns of H, which is then that of the reference, where a free
    thickness moves the faces that gauges sit on;
    free_loads: whether a grid filter weighs parameters by what no unknown load could cause (`judge`), or under loads as Q says;
    scheme of the step; every: a sample is taken at every·h, 2 every·h …
    Raises ConfigError for an input both known and unknown, or a parameter neither fixed nor estimated."""

    model: ReducedModel
    unknowns: Unknowns
    known_inputs: tuple[str, ...]
    fixed: Mapping[str, float]
    H: np.ndarray
    Q: np.ndarray
    r: np.ndarray
    h: float
    quantity: np.ndarray | None = None
    scheme: Scheme = "exact"
    every: int = 1
    change: AffineOperator = NO_CHANGE
    free_loads: bool = False

    def __post_init__(self) -> None:
        for name in self.unknowns.inputs:
            if name in self.known_inputs:
                raise ConfigError(
                    f"input {name} is both known and estimated",
                    remedy="remove the input from `FilterModel.known_inputs` or from `FilterModel.unknowns.inputs`",
                )
        for name in self.model.parameters:
            if name not in self.fixed and name not in self.unknowns.parameters:
                raise ConfigError(
                    f"parameter {name} has no value",
                    remedy="add the parameter to `FilterModel.unknowns.parameters`, or set its value in `FilterModel.fixed`",
                )

    @cached_property
    def size(self) -> int:
        """n*."""
        return self.unknowns.size(self.model)

    @property
    def sets(self) -> int:
        """Number of covariances that differ by sensors or noise: 1, or B."""
        sets = [len(array) for array in (self.H, self.Q) if array.ndim == 3]
        return max([*sets, self.r.shape[-2] if self.r.ndim > 1 else 1])

    @property
    def motion(self) -> slice:
        """Slice of [q, q̇] in x*."""
        return slice(0, 2 * self.model.size)

    @property
    def input_states(self) -> slice:
        """Slice of ζ of all inputs in x*; for random walks that is ũ."""
        return slice(2 * self.model.size, self.size - len(self.unknowns.parameters))

    @property
    def parameter_states(self) -> slice:
        """Slice of p in x*."""
        return slice(self.size - len(self.unknowns.parameters), self.size)

    @cached_property
    def position(self) -> np.ndarray:
        """Index of each unknown in x* (count,): ũ of each input, then p."""
        return self.unknowns.position(self.model)

    @cached_property
    def columns(self) -> tuple[list[int], list[int]]:
        """Columns of the input shape for unknown and known inputs."""
        known = [self.model.inputs.index(name) for name in self.known_inputs]
        return self.unknowns.input_columns(self.model), known

    @property
    def amplitude(self) -> np.ndarray:
        """Unit of each ũ (n_ũ,)."""
        return self.unknowns.scale[: len(self.unknowns.inputs)]

    @cached_property
    def accelerometers(self) -> np.ndarray | None:
        """Mask of acceleration channels (m,) or (B, m); None if there are no accelerometers."""
        moving = None if self.quantity is None else np.asarray(self.quantity) == ACCELERATION
        return moving if moving is not None and moving.any() else None

    @property
    def has_free_loads(self) -> bool:
        """Whether parameters are weighted with free unknown loads."""
        return self.free_loads and bool(self.unknowns.inputs and self.unknowns.parameters)

    @property
    def curved(self) -> bool:
        """Whether readings are nonlinear in x* with estimated parameters."""
        return self.accelerometers is not None or bool(self.change.terms)

    def rows_at(self, theta: Mapping[str, Any]) -> np.ndarray:
        """H (..., m, n*) at θ [SI]; (m, n*) or (B, m, n*) if constant."""
        if not self.change.terms:
            return self.H
        added = np.asarray(self.change.at(theta))
        H = np.array(np.broadcast_to(self.H, (*added.shape[:-1], self.H.shape[-1])))
        H[..., : self.model.size] += added
        return H

    def of_channels(self, which: np.ndarray) -> FilterModel:
        """The model with some of the channels (k,), of one set."""
        return replace(
            self,
            H=self.H[which],
            change=self.change.of_terms(lambda X: X[which]),
            r=self.r[..., which],
            quantity=None if self.quantity is None else self.quantity[which],
        )

    def with_parameters(self, theta: Mapping[str, float]) -> FilterModel:
        """The model with parameters fixed at θ [SI], which are no longer states of x*."""
        n, unknowns = self.parameter_states.start, replace(self.unknowns, parameters=())
        return replace(self, unknowns=unknowns, fixed=theta, H=self.H[..., :n], Q=self.Q[..., :n, :n])

    def with_free_loads(self, steps: int) -> FilterModel:
        """The model with free loads for a record of so many steps: no unknown load is stiffer than a line of its amplitude and
        frequency requires (`line_intensity`), regardless of the configuration."""
        Q, unknowns = self.Q.copy(), self.unknowns
        for name, end in zip(unknowns.inputs, self.input_states.start + np.cumsum(unknowns.lengths), strict=True):
            frequency = positive_of(unknowns.frequency, name, "frequency")
            line = line_intensity(unknowns.model_of(name), frequency, steps * self.h)
            Q[..., end - 1, end - 1] = np.maximum(Q[..., end - 1, end - 1], line)
        return replace(self, Q=Q)

    def by_step(self, samples: np.ndarray) -> np.ndarray:
        """Samples (T, …, m) of each step, NaN between samples, from (T/every, …, m)."""
        samples = np.asarray(samples, dtype=float)
        if self.every == 1:
            return samples
        spread = np.full((len(samples) * self.every, *samples.shape[1:]), np.nan)
        spread[self.every - 1 :: self.every] = samples
        return spread

    @cached_property
    def transition(self) -> np.ndarray:
        """exp(A_u h) of ζ."""
        return input_transition(self.unknowns, self.h)

    @cached_property
    def hold(self) -> np.ndarray:
        """Hold coefficients of the unknown inputs within a step as rows on ζ (HOLD, n_ũ, k) [N]."""
        return input_hold(self.unknowns, self.h)

    @cached_property
    def process(self) -> np.ndarray:
        """Q_h (n*, n*) or (B, n*, n*): the covariance that x* gathers in a step, at the fixed values and the guess. What the
        drift of a parameter does to the motion within one step is left out: it depends on the motion."""
        rest, loads = np.zeros((1, 2 * self.model.size)), np.zeros((1, len(self.model.inputs)))
        F = linearise(self.model, self.unknowns, {**self.unknowns.guess, **self.fixed}, rest, loads)[0]
        return process_covariance(F, self.Q, self.h)

    @cached_property
    def noise(self) -> np.ndarray:
        """R = r/(every h): variances of one sample, of the shape of r."""
        return self.r / (self.every * self.h)


def theta_of(model: FilterModel, x: np.ndarray) -> dict[str, Any]:
    """θ [SI] at x* (..., n*): the fixed values, and guess·exp(p) of shape (...) for the estimated ones."""
    p = x[..., model.parameter_states]
    names, guess = model.unknowns.parameters, model.unknowns.guess
    return {**model.fixed, **{name: guess[name] * np.exp(p[..., i]) for i, name in enumerate(names)}}


def inputs_of(model: FilterModel, x: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Hold coefficients (..., HOLD, n_u) of all inputs: known (..., HOLD, n_known), unknown those of ζ in x* (..., n*)."""
    u = np.zeros((*x.shape[:-1], HOLD, len(model.model.inputs)))
    at_unknown, at_known = model.columns
    u[..., at_known] = known
    u[..., at_unknown] = np.einsum("jik,...k->...ji", model.hold, x[..., model.input_states])
    return u


def loads_of(model: FilterModel, x: np.ndarray, known: np.ndarray) -> np.ndarray:
    """All inputs (..., n_u) [N] at an instant: known (..., n_known) there, unknown amplitude·ũ of x* (..., n*) there."""
    u = np.zeros((*x.shape[:-1], len(model.model.inputs)))
    at_unknown, at_known = model.columns
    u[..., at_known] = known
    u[..., at_unknown] = model.amplitude * x[..., model.position[: len(model.amplitude)]]
    return u


def physical(model: FilterModel, mean: np.ndarray, std: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Value and standard deviation [SI] of every unknown: u = amplitude·ũ; θ = guess·exp(p), σ_θ = θ σ_p (first order). mean,
    std (..., n*). Returns arrays of shape (...)."""
    values = {
        name: (a * mean[..., at], a * std[..., at])
        for name, a, at in zip(model.unknowns.inputs, model.amplitude, model.position, strict=False)
    }
    for k, name in enumerate(model.unknowns.parameters, start=model.parameter_states.start):
        theta = model.unknowns.guess[name] * np.exp(mean[..., k])
        values[name] = (theta, theta * std[..., k])
    return values


def input_transition(unknowns: Unknowns, h: float) -> np.ndarray:
    """exp(A_u h) (k, k) of ζ of all inputs."""
    walks = all(isinstance(unknowns.model_of(name), RandomWalk) for name in unknowns.inputs)
    return np.eye(len(unknowns.inputs)) if walks else expm(unknowns.rate_matrix() * h)


def input_hold(unknowns: Unknowns, h: float) -> np.ndarray:
    """Hold coefficients of the unknown inputs within a step as rows on ζ at its start: uⱼ = Rⱼ ζ, R (HOLD, n_ũ, k) [N].

        u₀ = u(0),   u₁ = −3u(0) + 4u(½) − u(1),   u₂ = 2u(0) − 4u(½) + 2u(1),   u(s) = amplitude C_u exp(A_u s h) ζ

    Exact for both random walks; the others err by the hold's own (ωh)³ω₀h/720 of the motion they cause."""
    inputs = len(unknowns.inputs)
    first = np.cumsum([0, *unknowns.lengths])[:-1]
    left = np.zeros((inputs, sum(unknowns.lengths)))
    left[range(inputs), first] = unknowns.scale[:inputs]
    middle = left @ input_transition(unknowns, 0.5 * h)
    return quadratic_hold(np.stack([left, middle, left @ input_transition(unknowns, h)]))[0]


def process_covariance(F: np.ndarray, Q: np.ndarray, h: float) -> np.ndarray:
    """Covariance (..., n, n) that ẋ = F x + w gathers in a step, w of intensity Q:

        Q_h = ∫₀ʰ exp(F s) Q exp(F s)ᵀ ds,     by Q_2s = Q_s + Φ_s Q_s Φ_sᵀ from a part of the step in which little turns

    With Q h alone an accelerometer, which reads the load at once, would make the filter overconfident. For h → 0 it is Q h.
    F (n, n) [1/s]; Q (..., n, n) intensity; h [s]. Source: Van Loan, IEEE Trans. Automatic Control 23 (1978)."""
    n = len(F)
    balanced, (scale, _) = matrix_balance(F, permute=False, separate=True)
    turns = np.abs(np.linalg.eigvals(balanced)).max(initial=0.0) * h
    halvings = max(0, int(np.ceil(np.log2(max(turns, 1e-300) / PART))))
    part = h / 2**halvings
    units = np.outer(scale, scale)
    # Q_h is linear in Q, and a large Q would spoil the exponential of the rest
    units = units * (float(np.abs(Q / units).max(initial=0.0)) or 1.0)
    generator = np.zeros((*Q.shape[:-2], 2 * n, 2 * n))
    generator[..., :n, :n], generator[..., n:, n:], generator[..., :n, n:] = -balanced, balanced.T, Q / units
    exponential = expm(generator * part)
    turned = np.swapaxes(exponential[..., n:, n:], -1, -2)
    gathered = turned @ exponential[..., :n, n:]
    for _ in range(halvings):
        gathered = gathered + turned @ gathered @ np.swapaxes(turned, -1, -2)
        turned = turned @ turned
    gathered = gathered * units
    return np.asarray(0.5 * (gathered + np.swapaxes(gathered, -1, -2)))


PART = 0.5
"""Radians that the fastest state may turn in the part of a step that `process_covariance` begins with."""


def step(
    model: FilterModel, x: np.ndarray, known: np.ndarray, constant: ModalMap | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """One step without process noise and A* = ∂x*⁺/∂x*  (1.50-1.55):

        [q, q̇]⁺ = A(θ)[q, q̇] + Σⱼ Bⱼ(θ)uⱼ,   ζ⁺ = exp(A_u h)ζ,   p⁺ = p

    x (B, n*); known (HOLD, n_known) or (B, HOLD, n_known) hold coefficients [N]; constant: the modal step, where no parameter is
    estimated.
    Returns x*⁺ (B, n*) and A* (B, n*, n*), or (1, n*, n*) where no parameter is estimated."""
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

    x (B, n*); known (n_known,) or (B, n_known) [N] at that instant; constant: the acceleration there, as of `step`.
    Returns y (B, m) and J (B, m, n*), or (1, m, n*) where it is the same for every run."""
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
    """What other places on the surface than the channels read at x* (B, n*), and the Jacobian, as of `measure`. rows (k, n)
    of strain or displacement per coordinate at the references, change: what θ adds to them."""
    H = np.hstack([rows, np.zeros((len(rows), model.size - rows.shape[1]))])
    return measure(replace(model, H=H, change=change, quantity=None), x, np.zeros(len(model.known_inputs)))


def augmented_jacobian(
    model: FilterModel, modal: ModalMap, theta: Mapping[str, Any], state: np.ndarray, u: np.ndarray
) -> np.ndarray:
    """A* = [[A, Σⱼ BⱼRⱼ, θ ∂x⁺/∂θ], [0, exp(A_u h), 0], [0, 0, I]]  (1.55), at one or many states; R of `input_hold`. modal:
    the step at theta; state (..., 2n) [q, q̇] and u (..., HOLD, n_u) at the start of the step. Returns (..., n*, n*); without
    estimated parameters (1, n*, n*), as the state does not matter."""
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
    Returns (..., m, n*), where nothing depends on the state (1, m, n*)."""
    n, H = model.model.size, model.rows_at(theta)
    H = H if H.ndim > 2 else H[None]
    J, q = H, state[..., None, :n]
    if model.accelerometers is not None and modal is not None:
        moving, loads = model.accelerometers[..., None], len(model.amplitude)
        rows = np.zeros((1, loads, model.input_states.stop - model.input_states.start))
        rows[0, range(loads), model.position[:loads] - model.input_states.start] = model.amplitude
        J = np.where(moving, H[..., :n] @ _map_jacobian(model, modal, theta, state, u, rows), H)
        q = np.where(moving, _mapped(modal, state, u)[..., None, :], q)
    free = [name for name in model.unknowns.parameters if name in model.change.parameters]
    if free:
        J = np.array(np.broadcast_to(J, np.broadcast_shapes(J.shape, (*state.shape[:-1], 1, 1))))
    for name in free:
        column = model.parameter_states.start + model.unknowns.parameters.index(name)
        slope = np.sum(np.asarray(model.change.derivative(name, theta)) * q, axis=-1)
        J[..., column] += np.asarray(theta[name])[..., None] * slope
    return J


def _map_jacobian(
    model: FilterModel, modal: ModalMap, theta: Mapping[str, Any], state: np.ndarray, u: np.ndarray, hold: np.ndarray
) -> np.ndarray:
    """Derivative of a modal map in x*; hold (J, n_ũ, k): its input vectors as rows on ζ. Returns (..., rows, n*)."""
    names = model.unknowns.parameters
    batch = state.shape[:-1] if names else (1,)
    J = np.zeros((*batch, modal.transition.shape[-2], model.size))
    J[..., model.motion] = modal.transition
    inputs = modal.input[..., model.columns[0]]
    width = hold.shape[0] * hold.shape[1]
    J[..., model.input_states] = inputs.reshape(*inputs.shape[:-2], width) @ hold.reshape(width, -1 if width else 0)
    if names:
        slopes = parameter_slopes(model.model, modal, theta, state, u, names)
        scale = np.stack(np.broadcast_arrays(*(theta[name] for name in names)), axis=-1)
        J[..., model.parameter_states] = slopes * scale[..., None, :]
    return J


def _mapped(modal: ModalMap, state: np.ndarray, u: np.ndarray) -> np.ndarray:
    B = modal.input.reshape(*modal.input.shape[:-2], -1)
    return (modal.transition @ state[..., None] + B @ u.reshape(*u.shape[:-2], -1, 1))[..., 0]
