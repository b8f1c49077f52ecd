"""Errors of the filter states along a known motion, step by step."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from strainsight.estimation.conditional import ConsideredParameters, discrepancy, known_ends, linear_models
from strainsight.estimation.model import FilterModel, augmented_jacobian, measured_jacobian, theta_of
from strainsight.rom.modal_step import acceleration_map, modal_step

CHUNK = 256
"""Steps whose Jacobians are stored at once."""


@dataclass(frozen=True)
class ErrorStep:
    """Error propagation over one step, for errors of x* and unit constants ν:

        x*⁺ = A x* + pushed ν,   y = H x* + read ν + noise

    A (n*, n*); pushed (d, n*); at its end, [s], H (m, n*) or (B, m, n*), read (d, m) and variance (B, m) of the samples;
    sampled: whether the step ends with a sample."""

    instant: float
    A: np.ndarray
    pushed: np.ndarray
    H: np.ndarray
    read: np.ndarray
    variance: np.ndarray
    sampled: bool


def steps_along(
    model: FilterModel, trajectory: np.ndarray, u: np.ndarray, considered: ConsideredParameters | None, sets: int
) -> Iterator[ErrorStep]:
    """A* and the rows along the motion at θ = guess (p = 0), step by step; with the `discrepancy` in the variance of the
    samples.

    trajectory (T + 1, 2n) [q, q̇]; u (T, HOLD, n_u): hold coefficients of all inputs [N], unknown ones too; sets B, which
    with considered parameters differ by their noise only."""
    constants = None if considered is None else _Constants(model, considered, u)
    R = np.broadcast_to(model.noise, (*model.noise.shape[:-2], sets, model.H.shape[-2]))
    if considered is not None and constants is not None:
        R = R + discrepancy(model, considered, constants.reading(trajectory[1:], u))
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
            yield ErrorStep(
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
    """Effects of each unit ν on motion and readings, at the guess."""

    def __init__(self, model: FilterModel, considered: ConsideredParameters, u: np.ndarray):
        at_guess = np.zeros((1, len(model.unknowns.parameters)))
        self.model, self.linear = model, linear_models(model, at_guess, considered)
        self.known = model.columns[1]
        self.ends = known_ends(u[:, :, self.known], considered)

    def along(self, span: slice, start: np.ndarray, end: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A_ν x + G_ν w (L, d, n*) and D x + E w₁ + o (L, d, m) of a span; start, end [q, q̇] (L, 2n), u (L, HOLD, n_u)."""
        linear, states, last = self.linear, self.model.parameter_states.start, u.sum(axis=1)
        pushed, moving = np.zeros((len(u), linear.considered_count, self.model.size)), linear.moving
        x, w = states_at(self.model, start, u[:, 0]), u[:, :, self.known].reshape(len(u), -1)
        pushed[:, :moving, :states] = np.einsum("eij,tj->tei", linear.A_nu[0], x, optimize=True)
        pushed[:, :moving, :states] += np.einsum("eij,tj->tei", linear.G_nu[0], w, optimize=True)
        read = np.einsum("dmj,tj->tdm", linear.D, states_at(self.model, end, last), optimize=True) + linear.offset
        return pushed, read + np.einsum("dmj,tj->tdm", linear.E, self.ends[span], optimize=True)

    def reading(self, end: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Readings (T, m) at the ends [q, q̇] (T, 2n) of all steps, u (T, HOLD, n_u)."""
        states = states_at(self.model, end, u.sum(axis=1))
        return np.asarray(states @ self.linear.H[0].T + self.ends @ self.linear.F[0].T)


def states_at(model: FilterModel, motion: np.ndarray, loads: np.ndarray) -> np.ndarray:
    """[q, q̇, ζ] (L, n) at instants with motion [q, q̇] (L, 2n) and loads (L, n_u) [N]."""
    unknown, x = model.columns[0], np.zeros((len(motion), model.parameter_states.start))
    x[:, model.motion] = motion
    x[:, model.position[: len(unknown)]] = loads[:, unknown] / model.amplitude
    return x
