"""The standard deviation that the filter will claim along a known motion, without any measurement, and what it is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from strainsight.estimation.conditional import Nuisances, discrepancy, linear_models
from strainsight.estimation.model import FilterModel, theta_of
from strainsight.estimation.motion import augmented_jacobian, measured_jacobian
from strainsight.estimation.update import corrected, gain, predict, standard_deviation, transposed
from strainsight.rom.modal_step import acceleration_map, modal_step

CHUNK = 256
"""Steps whose Jacobians are held at once."""

NOISE, PROCESS, START = "noise", "process noise", "start"
"""Sources of what the filter knows to be uncertain; those of what it takes as exact are named by its nuisances."""


@dataclass(frozen=True)
class Claim:
    """std (T + 1, B, n*) of x* for B sets of sensors; budget: source → its part (T + 1, n*) of the variance of the first set, the
    sum of which over the sources is that variance."""

    std: np.ndarray
    budget: Mapping[str, np.ndarray]


def covariance_recursion(
    model: FilterModel,
    trajectory: np.ndarray,
    u: np.ndarray,
    covariance: np.ndarray,
    nuisances: Nuisances | None = None,
) -> Claim:
    """Standard deviation of x* that the filter will claim along a given motion, for B sets of sensors at once.

    The covariance recursion of `run_filter`, which needs no measurement, with A* and the rows at the motion and θ = guess
    (p = 0); beside it, with the same gains, the error that one of every nuisance ν makes, as `parallel_filters.advance`, and
    the parts of P, each the same recursion of one source alone:

        V⁻ = A* V − (A_ν x + G_ν w),   V = V⁻ + K(D x + E w₁ + o − H* V⁻),   σ² = diag P + Σₖ Vₖ²
        P = P_R + P_Q + P_0,           P_s⁺ = (I − KH)(A* P_s A*ᵀ + Q_s)(I − KH)ᵀ + K R_s Kᵀ

    trajectory (T + 1, 2n) [q, q̇]; u (T, HOLD, n_u) hold coefficients of all inputs of the model [N], unknown ones too;
    covariance (n*, n*) or (B, n*, n*) of x* at t = 0; nuisances of a model the sets of which differ by their noise alone: a
    channel of infinite noise has none.
    Sources: Schmidt, Advances in Control Systems 3 (1966); JCGM 100:2008 (GUM), section 5.1 (parts of a variance).
    """
    b = max(model.sets, len(covariance) if covariance.ndim == 3 else 1)
    P = np.broadcast_to(covariance, (b, model.size, model.size)).astype(float)
    constants = None if nuisances is None else _Constants(model, nuisances)
    R = np.broadcast_to(model.noise, (*model.noise.shape[:-2], b, model.H.shape[-2]))
    if nuisances is not None and constants is not None:
        R = R + discrepancy(model, nuisances, constants.reading(trajectory[1:], u))
    V = np.zeros((b, 0 if constants is None else len(constants.source), model.size))
    first_set = np.zeros((3, model.size, model.size))
    first_set[2] = P[0]
    Q = np.zeros_like(first_set)
    Q[1] = model.process if model.process.ndim == 2 else model.process[0]
    theta = theta_of(model, np.zeros(model.size))
    modal = modal_step(model.model, theta, model.h, model.scheme)
    sensed = None if model.accelerometers is None else acceleration_map(model.model, theta)
    variance, parts = np.empty((len(u) + 1, b, model.size)), np.empty((len(u) + 1, 3, model.size))
    shift = np.zeros((len(u) + 1, *V.shape[1:]))
    variance[0], parts[0] = standard_deviation(P) ** 2, standard_deviation(first_set) ** 2
    for first in range(0, len(u), CHUNK):
        span = slice(first, min(first + CHUNK, len(u)))
        A = augmented_jacobian(model, modal, theta, trajectory[span], u[span])
        ends = trajectory[1:][span, None], u[span].sum(axis=1)[:, None, None]
        H = measured_jacobian(model, sensed, theta, *ends)
        if constants is not None:
            pushed, read = constants.along(trajectory[span], trajectory[1:][span], u[span])
        for k in range(span.start, span.stop):
            own = A[(k - first) % len(A)]
            P, first_set = predict(P, own, model.process), predict(first_set, own, Q)
            if constants is not None:
                V = V @ own.T - pushed[k - first]
            if (k + 1) % model.every == 0:
                # rows vary along the motion where accelerometers feel an estimated parameter
                rows, noise = (H[k - first] if H.ndim == 4 else H), (R[k] if R.ndim == 3 else R)
                if constants is None:
                    rows, noise = few(rows, noise)
                K, _ = gain(P, rows, noise, (k + 1) * model.h)
                P = corrected(P, K, rows, noise)
                first_set = corrected(first_set, K[:1], rows[:1], noise[0] * np.eye(3)[:, :1])
                if constants is not None:
                    V = V + (read[k - first] - V @ transposed(rows)) @ transposed(K)
            variance[k + 1] = standard_deviation(P) ** 2 + np.sum(V**2, axis=1)
            parts[k + 1], shift[k + 1] = standard_deviation(first_set) ** 2, V[0]
    budget = {source: parts[:, i] for i, source in enumerate((NOISE, PROCESS, START))}
    return Claim(np.sqrt(variance), budget | by_source(() if constants is None else constants.source, shift))


def by_source(source: tuple[str, ...], shift: np.ndarray) -> dict[str, np.ndarray]:
    """Variance (T, n*) that the nuisances of every source add together; source (d,), shift (T, d, n*) of one of each."""
    named = np.array(source)
    return {name: np.sum(shift[:, named == name] ** 2, axis=1) for name in dict.fromkeys(source)}


class _Constants:
    """What one of every nuisance does to the motion and to the readings, at the guess."""

    def __init__(self, model: FilterModel, nuisances: Nuisances):
        at_guess = np.zeros((1, len(model.unknowns.parameters)))
        self.model, self.linear = model, linear_models(model, at_guess, nuisances)
        self.source = nuisances.sources(model.model.size)
        self.unknown = model.unknowns.input_columns(model.model)
        self.known = [model.model.inputs.index(name) for name in model.known_inputs]

    def along(self, start: np.ndarray, end: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A_ν x + G_ν w (L, d, n*) and D x + E w₁ + o (L, d, m) of L steps from and to [q, q̇] (L, 2n), u (L, HOLD, n_u)."""
        own, states, last = self.linear, self.model.parameter_states.start, u.sum(axis=1)
        pushed = np.zeros((len(u), own.nuisances, self.model.size))
        w = u[:, :, self.known].reshape(len(u), -1)
        moving = own.A_nu.shape[1]
        pushed[:, :moving, :states] = np.einsum("eij,tj->tei", own.A_nu[0], self._states(start, u[:, 0]), optimize=True)
        pushed[:, :moving, :states] += np.einsum("eij,tj->tei", own.G_nu[0], w, optimize=True)
        read = np.einsum("dmj,tj->tdm", own.D, self._states(end, last), optimize=True) + own.offset
        return pushed, read + np.einsum("dmj,tj->tdm", own.E, last[:, self.known], optimize=True)

    def reading(self, end: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Of the channels (L, m) at the ends [q, q̇] (L, 2n) of L steps, u (L, HOLD, n_u)."""
        last = u.sum(axis=1)
        return np.asarray(self._states(end, last) @ self.linear.H[0].T + last[:, self.known] @ self.linear.F[0].T)

    def _states(self, motion: np.ndarray, loads: np.ndarray) -> np.ndarray:
        """[q, q̇, ζ] (L, n) at instants with loads (L, n_u) [N]."""
        model = self.model
        x = np.zeros((len(motion), model.parameter_states.start))
        x[:, model.motion] = motion
        x[:, model.position[: len(self.unknown)]] = loads[:, self.unknown] / model.amplitude
        return x


def few(H: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As few rows of unit noise as states that say the same, HᵀR⁻¹H = CᵀC, where there are more channels than that.

    H (m, n) or (b, m, n); R (b, m). Without measurements the channels matter by that product only.
    """
    if H.shape[-2] <= 2 * H.shape[-1]:
        return H, R
    whitened = H / np.sqrt(R)[..., None]
    C = np.asarray(np.linalg.qr(whitened, mode="r"))
    return C, np.ones(C.shape[:-1])
