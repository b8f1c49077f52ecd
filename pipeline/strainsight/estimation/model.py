"""The discrete augmented model of the filter: what it consists of, and what its state means."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from strainsight.augmentation.linearisation import linearise
from strainsight.augmentation.unknowns import Unknowns
from strainsight.errors import ConfigError
from strainsight.estimation.discrete import input_hold, input_transition, process_covariance
from strainsight.fem.affine import NO_CHANGE, AffineOperator
from strainsight.gauges.candidates import ACCELERATION
from strainsight.rom.model import ReducedModel
from strainsight.rom.oscillator import HOLD
from strainsight.rom.schemes import Scheme


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
    free_loads: whether a bank judges parameters by what no unknown load could cause (`judge`), or by how likely readings are
    under loads that move as Q says;
    scheme of the step; every: a sample is taken at the end of every `every`-th step, at every·h, 2 every·h …
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
    quantity: np.ndarray | None = None
    scheme: Scheme = "exact"
    every: int = 1
    change: AffineOperator = NO_CHANGE
    free_loads: bool = False

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
    def sets(self) -> int:
        """How many covariances differ by their sensors or noise: 1, or B."""
        given = (self.H, self.Q)
        own = [len(a) for a in given if a.ndim == 3]
        return max([*own, self.r.shape[-2] if self.r.ndim > 1 else 1])

    @property
    def motion(self) -> slice:
        """Where [q, q̇] stand in x*."""
        return slice(0, 2 * self.model.size)

    @property
    def input_states(self) -> slice:
        """Where ζ of all inputs stands in x*; with random walks that is ũ."""
        return slice(2 * self.model.size, self.size - len(self.unknowns.parameters))

    @property
    def parameter_states(self) -> slice:
        """Where p stands in x*."""
        return slice(self.size - len(self.unknowns.parameters), self.size)

    @cached_property
    def position(self) -> np.ndarray:
        """Where every unknown stands in x* (count,): ũ of every input, then p."""
        return self.unknowns.position(self.model)

    @property
    def amplitude(self) -> np.ndarray:
        """Unit of every ũ (n_ũ,)."""
        return self.unknowns.scale[: len(self.unknowns.inputs)]

    @cached_property
    def accelerometers(self) -> np.ndarray | None:
        """Which channels read accelerations (m,) or (B, m); None where none does."""
        moving = None if self.quantity is None else np.asarray(self.quantity) == ACCELERATION
        return moving if moving is not None and moving.any() else None

    @property
    def beside_free_loads(self) -> bool:
        """Whether parameters are judged beside unknown loads that are free."""
        return self.free_loads and bool(self.unknowns.inputs and self.unknowns.parameters)

    @property
    def curved(self) -> bool:
        """Whether readings are no linear function of x* where a parameter is estimated."""
        return self.accelerometers is not None or bool(self.change.terms)

    def rows_at(self, theta: Mapping[str, Any]) -> np.ndarray:
        """H (..., m, n*) at θ [SI]; (m, n*) or (B, m, n*) where it does not change."""
        if not self.change.terms:
            return self.H
        added = np.asarray(self.change.at(theta))
        H = np.array(np.broadcast_to(self.H, (*added.shape[:-1], self.H.shape[-1])))
        H[..., : self.model.size] += added
        return H

    def of_channels(self, which: np.ndarray) -> FilterModel:
        """With some of the channels (k,), of one set."""
        return replace(
            self,
            H=self.H[which],
            change=self.change.of_terms(lambda X: X[which]),
            r=self.r[..., which],
            quantity=None if self.quantity is None else self.quantity[which],
        )

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
        """Q_h (n*, n*) or (B, n*, n*): the covariance that x* gathers in a step, at the fixed values and the guess.

        What the drift of a parameter does to the motion within one step is left out: it depends on the motion.
        """
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
    u[..., [model.model.inputs.index(name) for name in model.known_inputs]] = known
    zeta = x[..., model.input_states]
    u[..., model.unknowns.input_columns(model.model)] = np.einsum("jik,...k->...ji", model.hold, zeta)
    return u


def loads_of(model: FilterModel, x: np.ndarray, known: np.ndarray) -> np.ndarray:
    """All inputs (..., n_u) [N] at an instant: known (..., n_known) there, unknown amplitude·ũ of x* (..., n*) there."""
    u = np.zeros((*x.shape[:-1], len(model.model.inputs)))
    u[..., [model.model.inputs.index(name) for name in model.known_inputs]] = known
    u[..., model.unknowns.input_columns(model.model)] = model.amplitude * x[..., model.position[: len(model.amplitude)]]
    return u


def physical(model: FilterModel, mean: np.ndarray, std: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Value and standard deviation [SI] of every unknown: u = amplitude·ũ; θ = guess·exp(p), σ_θ = θ σ_p (first order).

    mean, std (..., n*). Returns arrays of shape (...).
    """
    values = {
        name: (a * mean[..., at], a * std[..., at])
        for name, a, at in zip(model.unknowns.inputs, model.amplitude, model.position, strict=False)
    }
    for k, name in enumerate(model.unknowns.parameters, start=model.parameter_states.start):
        theta = model.unknowns.guess[name] * np.exp(mean[..., k])
        values[name] = (theta, theta * std[..., k])
    return values
