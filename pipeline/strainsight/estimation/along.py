"""The filter's model along a known motion: what every step does to a small error of the state, and to one of a constant."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from strainsight.estimation.conditional import Nuisances, discrepancy, known_ends, linear_models
from strainsight.estimation.model import FilterModel, theta_of
from strainsight.estimation.motion import augmented_jacobian, measured_jacobian
from strainsight.rom.modal_step import acceleration_map, modal_step

CHUNK = 256
"""Steps whose Jacobians are held at once."""


@dataclass(frozen=True)
class Step:
    """From one instant to the next, for errors of x* and of constants ν, of unit size each:

        x*⁺ = A x* + pushed ν,   y = H x* + read ν + noise

    A (n*, n*); pushed (d, n*); at its end, [s], H (m, n*) or (B, m, n*), read (d, m) and variance (B, m) of the samples;
    sampled: whether one is taken.
    """

    instant: float
    A: np.ndarray
    pushed: np.ndarray
    H: np.ndarray
    read: np.ndarray
    variance: np.ndarray
    sampled: bool


def steps_along(
    model: FilterModel, trajectory: np.ndarray, u: np.ndarray, nuisances: Nuisances | None, sets: int
) -> Iterator[Step]:
    """A* and the rows at the motion and θ = guess (p = 0), step by step; with `discrepancy` in the variance of the samples.

    trajectory (T + 1, 2n) [q, q̇]; u (T, HOLD, n_u) hold coefficients of all inputs of the model [N], unknown ones too; sets B,
    which with nuisances differ by their noise alone.
    """
    constants = None if nuisances is None else _Constants(model, nuisances, u)
    R = np.broadcast_to(model.noise, (*model.noise.shape[:-2], sets, model.H.shape[-2]))
    if nuisances is not None and constants is not None:
        R = R + discrepancy(model, nuisances, constants.reading(trajectory[1:], u))
    theta = theta_of(model, np.zeros(model.size))
    modal = modal_step(model.model, theta, model.h, model.scheme)
    sensed = None if model.accelerometers is None else acceleration_map(model.model, theta)
    for first in range(0, len(u), CHUNK):
        span = slice(first, min(first + CHUNK, len(u)))
        A = augmented_jacobian(model, modal, theta, trajectory[span], u[span])
        ends = trajectory[1:][span, None], u[span].sum(axis=1)[:, None, None]
        H = measured_jacobian(model, sensed, theta, *ends)
        if constants is None:
            pushed, read = np.zeros((len(A), 0, model.size)), np.zeros((len(A), 0, model.H.shape[-2]))
        else:
            pushed, read = constants.along(span, trajectory[span], trajectory[1:][span], u[span])
        for k in range(span.start, span.stop):
            yield Step(
                (k + 1) * model.h,
                A[(k - first) % len(A)],
                pushed[(k - first) % len(pushed)],
                # rows vary along the motion where accelerometers feel an estimated parameter
                H[k - first] if H.ndim == 4 else H,
                read[(k - first) % len(read)],
                R[k] if R.ndim == 3 else R,
                (k + 1) % model.every == 0,
            )


class _Constants:
    """What one of every nuisance does to the motion and to the readings, at the guess."""

    def __init__(self, model: FilterModel, nuisances: Nuisances, u: np.ndarray):
        at_guess = np.zeros((1, len(model.unknowns.parameters)))
        self.model, self.linear = model, linear_models(model, at_guess, nuisances)
        self.unknown = model.unknowns.input_columns(model.model)
        self.known = [model.model.inputs.index(name) for name in model.known_inputs]
        self.ends = known_ends(u[:, :, self.known], nuisances)

    def along(self, span: slice, start: np.ndarray, end: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A_ν x + G_ν w (L, d, n*) and D x + E w₁ + o (L, d, m) of a span of L steps from and to [q, q̇] (L, 2n),
        u (L, HOLD, n_u)."""
        own, states, last = self.linear, self.model.parameter_states.start, u.sum(axis=1)
        pushed = np.zeros((len(u), own.nuisances, self.model.size))
        w = u[:, :, self.known].reshape(len(u), -1)
        moving = own.moving
        pushed[:, :moving, :states] = np.einsum("eij,tj->tei", own.A_nu[0], self._states(start, u[:, 0]), optimize=True)
        pushed[:, :moving, :states] += np.einsum("eij,tj->tei", own.G_nu[0], w, optimize=True)
        read = np.einsum("dmj,tj->tdm", own.D, self._states(end, last), optimize=True) + own.offset
        return pushed, read + np.einsum("dmj,tj->tdm", own.E, self.ends[span], optimize=True)

    def reading(self, end: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Of the channels (T, m) at the ends [q, q̇] (T, 2n) of all steps, u (T, HOLD, n_u)."""
        states = self._states(end, u.sum(axis=1))
        return np.asarray(states @ self.linear.H[0].T + self.ends @ self.linear.F[0].T)

    def _states(self, motion: np.ndarray, loads: np.ndarray) -> np.ndarray:
        """[q, q̇, ζ] (L, n) at instants with loads (L, n_u) [N]."""
        model = self.model
        x = np.zeros((len(motion), model.parameter_states.start))
        x[:, model.motion] = motion
        x[:, model.position[: len(self.unknown)]] = loads[:, self.unknown] / model.amplitude
        return x
