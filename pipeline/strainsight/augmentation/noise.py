"""Continuous noise intensities of the augmented state and of the gauges (5.15-5.17)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from strainsight.augmentation.linearisation import Unknowns
from strainsight.errors import ConfigError

Rule = Literal["intensity", "thesis", "as_printed"]


def process_intensity(
    size: int,
    unknowns: Unknowns,
    frequency: Mapping[str, float],
    drift: Mapping[str, float],
    *,
    kappa: float | np.ndarray = 0.1,
    velocity: float | np.ndarray = 0.0,
    rule: Rule = "intensity",
    h: float | None = None,
) -> np.ndarray:
    """Diagonal process-noise intensity of x* = [q, q̇, ũ, p]; in physical units multiply by amplitude² or guess².

        intensity    q_u = κ ω,        q_p = δ²
        thesis       q_u = (hω)²/h,    q_p = (hδ)²/h     the covariances per step (5.16-5.17) as intensities
        as_printed   q_u = (hω)²,      q_p = (hδ)²       those numbers put into (5.14) as they stand

    size n [-]; frequency: input → guessed frequency [Hz], ω = 2π·frequency; drift: parameter → δ [1/√s] (thesis rules:
    δ [1/s]); kappa κ [-], one for all inputs or (n_ũ,); velocity (n,) or scalar: intensity of the generalised
    accelerations [kg m²/s³]; h [s].
    Returns Q (n*, n*). Raises ConfigError where a frequency, a drift or the step is missing.
    """
    if rule != "intensity" and not (h and h > 0):
        raise ConfigError(f"noise rule {rule} depends on the time step, which is {h}", remedy="state the step")
    step = h if h is not None else 0.0
    q = np.zeros(2 * size + unknowns.count)
    q[size : 2 * size] = velocity
    omega = 2 * np.pi * np.array([_positive(frequency, i, "frequency") for i in unknowns.inputs])
    delta = np.array([_positive(drift, p, "process noise scale") for p in unknowns.parameters])
    factor = {"intensity": 1.0, "thesis": step, "as_printed": step * step}[rule]
    q_u = kappa * omega if rule == "intensity" else factor * omega**2
    q[2 * size :] = np.concatenate([q_u, factor * delta**2])
    return np.diag(q)


def gauge_intensity(std: np.ndarray, h: float, rule: Rule = "intensity") -> np.ndarray:
    """r = σ² h [strain² s] of gauges with noise σ = std (m,) [strain] sampled every h [s]; `as_printed`: σ² itself."""
    variance = np.asarray(std, dtype=float) ** 2
    return variance if rule == "as_printed" else variance * h


def _positive(values: Mapping[str, float], name: str, word: str) -> float:
    value = values.get(name)
    if value is None or not 0 < value < np.inf:
        raise ConfigError(f"{word} of {name} is {value}", remedy=f"give {name} a positive {word}")
    return value
