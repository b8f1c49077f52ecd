"""Record of measurements for the grid filter, and the motion at its start."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from strainsight.estimation.conditional import (
    DIFFERENCE,
    ConsideredParameters,
    conditional_states,
    discrepancy,
    known_ends,
    linear_models,
    theta_at,
)
from strainsight.estimation.model import FilterModel
from strainsight.estimation.noise_bias import NoiseBias, noise_alone
from strainsight.estimation.parallel_filters import Data, LinearModels

NODE, FARTHEST = 2.0, 2.0
"""Distance of the nodes of the noise bias in prior standard deviations, and the farthest point in these distances."""


@dataclass(frozen=True)
class Settled:
    """Stationary start: the known loads have been sums of tones long enough for transients to vanish at t = 0. frequency ω
    (k,) [rad/s]; hold W (k, HOLD, n_known) complex [N]: the hold coefficients of the step at jh are Σₖ Re Wₖ exp(iωₖjh); std
    (2n,): σ of [q, q̇] about that motion."""

    frequency: np.ndarray
    hold: np.ndarray
    std: np.ndarray


def periodic_start(model: FilterModel, models: LinearModels, settled: Settled) -> tuple[np.ndarray, np.ndarray]:
    """[q, q̇] at t = 0 (B, 2n), and its derivative (B, e, 2n) in the ν that change the motion.

    The periodic solution of the discrete filter step, x(jh) = Re X zʲ with z = exp(iωh), and its derivative:

        (zI − A) X = G W,     (zI − A) X_ν = A_ν X + G_ν W

    With an unknown start, the grid filter would interpret noise as a free vibration, whose frequency biases the parameters."""
    moving, e = 2 * model.model.size, models.moving
    z, w = np.exp(1j * settled.frequency * model.h), settled.hold.reshape(len(settled.hold), -1)
    # B points, k tones
    lhs = z[:, None, None] * np.eye(moving) - models.A[:, None, :moving, :moving]
    X = np.linalg.solve(lhs, np.einsum("bap,kp->bka", models.G[:, :moving], w)[..., None])
    pushed = np.einsum("beac,bkc->bkae", models.A_nu[:, :, :moving, :moving], X[..., 0], optimize=True)
    pushed += np.einsum("beap,kp->bkae", models.G_nu[:, :, :moving], w, optimize=True)
    slope = np.linalg.solve(lhs, pushed) if e else pushed
    return X[..., 0].real.sum(axis=1), np.swapaxes(slope.real.sum(axis=1), 1, 2)


def start_filters(
    model: FilterModel, models: LinearModels, mean: np.ndarray, covariance: np.ndarray, settled: Settled | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Filters at t = 0: x (B, n), P (n, n), and V (B, d, n), the error x̂ − x per unit ν. mean (n,), covariance (n, n): of
    the states if the motion is not settled."""
    B, n = models.count, len(mean)
    x, P, V = np.tile(mean, (B, 1)), covariance.copy(), np.zeros((B, models.considered_count, n))
    if settled is None:
        return x, P, V
    moving = slice(0, 2 * model.model.size)
    start, slope = periodic_start(model, models, settled)
    x[:, moving], V[:, : slope.shape[1], moving] = start, -slope
    return x, _about(P, settled), V


def start_errors(
    model: FilterModel, considered: ConsideredParameters, covariance: np.ndarray, settled: Settled | None
) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (n*, n*) of x* at t = 0 at the guess, with exact constants, and V (d + k, n). V: error of the states before
    the parameters, per unit of each considered and estimated parameter."""
    n = model.parameter_states.start
    k = model.size - n
    ends = DIFFERENCE * np.concatenate([np.zeros((1, k)), *(step * np.eye(k) for step in (-2, -1, 1, 2))])
    x, _, V = start_filters(model, linear_models(model, ends, considered), np.zeros(n), covariance[:n, :n], settled)
    far, near, nearer, farther = x[1:].reshape(4, k, n)
    by_parameters = (8 * (nearer - near) - (farther - far)) / (12 * DIFFERENCE)
    P = covariance if settled is None else _about(covariance, settled)
    return P, np.concatenate([V[0], -by_parameters])


def _about(covariance: np.ndarray, settled: Settled) -> np.ndarray:
    """The covariance with that of the motion about the periodic one."""
    P, moving = covariance.copy(), np.arange(len(settled.std))
    P[moving], P[:, moving] = 0.0, 0.0
    P[moving, moving] = settled.std**2
    return P


@dataclass(frozen=True)
class GridRecord:
    """A record and the prior of the grid filter. model: one set of channels, parameters without drift; mean (n*,), covariance
    (n*, n*) at t = 0, parameters uncertain and uncorrelated with the states; known (T, HOLD, n_known) [N]; samples (T/every,
    m), NaN if missing; biased (b,): channels with an unknown offset, behind x* in mean and covariance; settled: periodic
    motion at t = 0 for all parameters and ν, in place of that in mean and covariance."""

    model: FilterModel
    mean: np.ndarray
    covariance: np.ndarray
    known: np.ndarray
    samples: np.ndarray
    considered: ConsideredParameters
    biased: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    settled: Settled | None = None

    @property
    def steps(self) -> int:
        return len(self.known)

    @property
    def sampled(self) -> slice:
        """Steps that end with a sample."""
        return slice(self.model.every - 1, None, self.model.every)

    @property
    def known_at_instants(self) -> np.ndarray:
        """Known loads (T + 1, n_known) at the instants [N]."""
        return np.concatenate([self.known[:1, 0], self.known.sum(axis=1)])

    @cached_property
    def data(self) -> Data:
        """Filter inputs of each step."""
        noise = self.model.noise
        noise = noise[:, 0] if noise.ndim == 3 else np.broadcast_to(noise, (self.steps, noise.shape[-1]))
        known = self.known.reshape(self.steps, self.known.shape[1] * self.known.shape[2])
        more = discrepancy(self.model, self.considered, self.samples)
        samples = self.model.by_step(self.samples)
        return Data(known, known_ends(self.known, self.considered), samples, np.ascontiguousarray(noise), more)

    @property
    def prior(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (k,) and covariance (k, k) of the parameters at t = 0."""
        at = self.model.parameter_states
        return self.mean[at], self.covariance[at, at]

    @property
    def start(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (n,) and covariance (n, n) at t = 0 of [q, q̇, ζ, offsets]."""
        at = conditional_states(self.model, len(self.biased))
        return self.mean[at], self.covariance[np.ix_(at, at)]

    def begun(self, models: LinearModels) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As `start_filters`."""
        return start_filters(self.model, models, *self.start, self.settled)

    def known_at(self, point: np.ndarray) -> GridRecord:
        """The record with parameters fixed at a point (k,)."""
        theta = {name: float(value[0]) for name, value in theta_at(self.model, point[None]).items()}
        mean, covariance = self.start
        return replace(self, model=self.model.with_parameters(theta), mean=mean, covariance=covariance)

    def with_lacking_mass(self) -> GridRecord:
        """The record with one σ of the masses that the model lacks in the model."""
        rom, considered = self.model.model, self.considered
        mass = replace(rom.mass, constant=rom.mass.constant + considered.lacking)
        model = replace(self.model, model=replace(rom, mass=mass))
        return replace(self, model=model, considered=replace(considered, lacking=np.zeros((0, 0))))

    @cached_property
    def free(self) -> tuple[FilterModel, FilterModel]:
        """Models with free unknown loads: with all process noise, and with that of the loads alone. Their `process` is a
        matrix exponential of twice the number of states."""
        free, loads = self.model.with_free_loads(self.steps), np.zeros(self.model.size, dtype=bool)
        loads[free.input_states] = True
        return free, replace(free, Q=np.where(np.outer(loads, loads), free.Q, 0.0))

    def with_free_loads(self, models: LinearModels) -> LinearModels:
        """The models with free loads in place of the configured ones."""
        free, states = self.free[0], self.free[0].parameter_states.start
        Q = np.pad(free.process[:states, :states], (0, len(self.biased)))
        return replace(models, Q=np.broadcast_to(Q, models.Q.shape))

    @cached_property
    def noise_bias(self) -> tuple[NoiseBias, ...]:
        """`noise_alone` for all ν at the mean of the parameters, and NODE standard deviations below and above along each."""
        mean, covariance = self.prior
        steps = NODE * np.diag(np.sqrt(np.diag(covariance)))
        models = linear_models(
            self.model, np.concatenate([mean[None], mean - steps, mean + steps]), self.considered, self.biased
        )
        models, noise = self.with_free_loads(models), np.where(np.isnan(self.data.samples), np.inf, self.data.noise)
        start = self.start[1], noise, self.model.every
        return tuple(noise_alone(models.of(slice(b, b + 1)), *start) for b in range(models.count))

    def bias_shares(self, point: np.ndarray) -> np.ndarray:
        """Weights (B, j) of the nodes of `noise_bias` at points (B, k): quadratic along each parameter, without cross terms."""
        mean, covariance = self.prior
        x = np.clip((point - mean) / (NODE * np.sqrt(np.diag(covariance))), -FARTHEST, FARTHEST)
        return np.concatenate([1 - np.sum(x**2, axis=1, keepdims=True), 0.5 * x * (x - 1), 0.5 * x * (x + 1)], axis=1)
