"""Noise levels from the measurements themselves: maximum likelihood of the innovations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from strainsight.errors import ConfigError, NumericalError
from strainsight.estimation.filter import run_filter
from strainsight.estimation.model import FilterModel

Part = Literal["process", "inputs", "model_error", "parameters", "noise"]
DIFFERENCE = 0.02
"""Step of the central differences in the logarithm of a factor."""


@dataclass(frozen=True)
class Tuning:
    """factors by part; gained: rise of the log-likelihood over factors of 1; undecided: parts whose factor ran to its
    limit, about which the measurements say nothing."""

    factors: Mapping[str, float]
    gained: float
    undecided: tuple[str, ...]


def tune(
    model: FilterModel,
    mean: np.ndarray,
    covariance: np.ndarray,
    known: np.ndarray,
    measurement: np.ndarray,
    parts: Sequence[Part] = ("process", "noise"),
    limit: float = 1e4,
) -> Tuning:
    """Factors f of the parts of Q and of r at which the innovations of the filter itself are most likely:

        max Σₖ −½(νᵀS⁻¹ν + log det S + m log 2π),   Q → f Q or a block of it,   r → f r

    parts: "process" all of Q; "inputs", "model_error", "parameters" its blocks on ζ, q̇, p; "noise" r. Model with one set
    of sensors; mean (n*,), covariance (n*, n*); known (T, HOLD, n_known); measurement (T/every, m) or (T/every, B, m):
    runs add up. limit: factors stay within 1/limit and limit. All differences of a gradient run as one batch.
    Raises ConfigError for a part that is zero, and NumericalError where the filter diverges at the start.
    Source: Schweppe, IEEE Trans. Information Theory 11 (1965).
    """
    from scipy.optimize import minimize  # a third of a second to import, which an up-to-date run need not spend

    for part in parts:
        if part != "noise" and not np.any(_block(model, part)):
            raise ConfigError(f"there is no process noise of {part} to tune", remedy="state some, or leave it out")
    count = len(parts)
    data = measurement if measurement.ndim == 3 else measurement[:, None, :]
    probes = np.concatenate([np.zeros((1, count)), DIFFERENCE * np.eye(count), -DIFFERENCE * np.eye(count)])

    def likelihood(logarithms: np.ndarray) -> np.ndarray:
        """At the factors themselves and at every probe beside them (1 + 2 count,)."""
        scaled = [scale_noise(model, dict(zip(parts, np.exp(logarithms + probe), strict=True))) for probe in probes]
        runs = data.shape[1]
        Q = np.repeat([each.Q for each in scaled], runs, axis=0)
        r = np.repeat(np.concatenate([np.atleast_2d(each.r) for each in scaled], axis=-2), runs, axis=-2)
        run = run_filter(replace(model, Q=Q, r=r), mean, covariance, known, np.tile(data, (1, len(probes), 1)))
        return run.log_likelihood.reshape(len(probes), runs).sum(axis=1)

    def negative(logarithms: np.ndarray) -> tuple[float, np.ndarray]:
        try:
            value = likelihood(logarithms)
        except NumericalError:  # every run lost: a place the search must leave
            value = np.full(len(probes), -np.inf)
        if _lost(value, count):
            return hopeless, np.zeros(count)
        return -float(value[0]), -_slope(value, count)

    start, bound = np.zeros(count), np.log(limit)
    around = likelihood(start)
    first = around[0]
    if _lost(around, count):
        raise NumericalError(
            "the filter diverges with the noise as stated: there is nothing to tune from",
            remedy="choose a guess nearer to the truth, a smaller initial standard deviation or a smaller time step",
        )
    # worse than anywhere on the way, and no more: the search interpolates, and next to infinity would leave it no step
    hopeless = abs(first) - first + 1.0
    found = minimize(negative, start, jac=True, method="L-BFGS-B", bounds=[(-bound, bound)] * count)
    factors = {str(part): float(np.exp(value)) for part, value in zip(parts, found.x, strict=True)}
    at_limit = tuple(str(part) for part, value in zip(parts, found.x, strict=True) if abs(value) > bound - 1e-6)
    return Tuning(factors, float(-found.fun - first), at_limit)


def _lost(value: np.ndarray, count: int) -> bool:
    """Whether there is no slope: the run itself is lost, or both beside it in some factor; value as of `_slope`."""
    return not np.isfinite(value[0]) or bool(np.any(~np.isfinite(value[1:].reshape(2, count)).any(axis=0)))


def _slope(value: np.ndarray, count: int) -> np.ndarray:
    """Central differences (count,) of value (1 + 2 count,): at a point, beside it, and on the other side; of one side only
    where the run on the other is lost."""
    beside = value[1:].reshape(2, count)
    there = np.isfinite(beside)
    above, below = np.where(there, beside, value[0])
    return np.asarray((above - below) / (DIFFERENCE * there.sum(axis=0)))


def scale_noise(model: FilterModel, factors: Mapping[str, float]) -> FilterModel:
    """The model with the parts of its noise multiplied by their factors."""
    Q, r = model.Q.copy(), model.r
    for part, factor in factors.items():
        if part == "noise":
            r = factor * r
        else:
            Q += (factor - 1) * _block(replace(model, Q=Q), part)
    return replace(model, Q=Q, r=r)


def _block(model: FilterModel, part: str) -> np.ndarray:
    """Q where the part has its noise, zero elsewhere."""
    n = model.model.size
    where = {
        "process": slice(0, model.size),
        "model_error": slice(n, 2 * n),
        "inputs": model.input_states,
        "parameters": model.parameter_states,
    }[part]
    block = np.zeros_like(model.Q)
    block[..., where, where] = model.Q[..., where, where]
    return block
