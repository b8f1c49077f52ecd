"""Continuous noise intensities of the augmented state and of the sensors (5.15-5.17)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from strainsight.errors import ConfigError
from strainsight.loads.input_models import WALK, RandomWalk, block_diagonal, input_intensity
from strainsight.loads.unknowns import Unknowns
from strainsight.sensors.candidates import ACCELERATION

Rule = Literal["intensity", "thesis", "as_printed"]


def process_intensity(
    size: int,
    unknowns: Unknowns,
    frequency: Mapping[str, float],
    drift: Mapping[str, float],
    *,
    kappa: float | np.ndarray = WALK,
    velocity: float | np.ndarray = 0.0,
    rule: Rule = "intensity",
    h: float | None = None,
) -> np.ndarray:
    """Process-noise intensity of x* = [q, q̇, ζ, p]; in physical units multiply by amplitude² or guess².

        intensity    q_u = κ ω,        q_p = δ²        q_u of a random walk; other input models: `input_intensity`
        thesis       q_u = (hω)²/h,    q_p = (hδ)²/h     the covariances per step (5.16-5.17) as intensities
        as_printed   q_u = (hω)²,      q_p = (hδ)²       those numbers put into (5.14) as they stand

    size n [-]; frequency: random-walk input → guessed frequency [Hz], ω = 2π·frequency; drift: parameter → δ [1/√s]
    (thesis rules: δ [1/s]); kappa κ [-], one for all inputs or (n_ũ,); velocity (n,) or scalar: intensity of the
    generalised accelerations [kg m²/s³]; h [s].
    Returns Q (n*, n*). Raises ConfigError where a frequency, a drift or the step is missing, and for the thesis's rules
    with an input that is no random walk.
    """
    if rule != "intensity" and not (h and h > 0):
        raise ConfigError(f"noise rule {rule} depends on the time step, which is {h}", remedy="state the step")
    step = h if h is not None else 0.0
    delta = np.array([_positive(drift, p, "process noise scale") for p in unknowns.parameters])
    factor = {"intensity": 1.0, "thesis": step, "as_printed": step * step}[rule]
    blocks = [np.zeros((size, size)), np.diag(np.broadcast_to(np.asarray(velocity, dtype=float), size))]
    for name, k in zip(unknowns.inputs, np.broadcast_to(kappa, len(unknowns.inputs)), strict=True):
        model, walk = unknowns.model_of(name), 0.0
        if isinstance(model, RandomWalk):
            omega = 2 * np.pi * _positive(frequency, name, "frequency")
            walk = k * omega if rule == "intensity" else factor * omega**2
        elif rule != "intensity":
            raise ConfigError(f"noise rule {rule} is that of a random walk; {name} is none", remedy="rule: intensity")
        blocks.append(input_intensity(model, walk))
    return block_diagonal([*blocks, np.diag(factor * delta**2)])


def gauge_intensity(std: np.ndarray, h: float, rule: Rule = "intensity") -> np.ndarray:
    """r = σ² h [strain² s] of gauges with noise σ = std (m,) [strain] sampled every h [s]; `as_printed`: σ² itself."""
    variance = np.asarray(std, dtype=float) ** 2
    return variance if rule == "as_printed" else variance * h


def channel_intensity(
    std: np.ndarray, h: float, rows: np.ndarray, quantity: np.ndarray, Q: np.ndarray, rule: Rule = "intensity"
) -> np.ndarray:
    """r of channels of every kind: σ²h, and for an accelerometer φ on top of it the white acceleration of the model,

        y = φ q̈ + v,   q̈ = M⁻¹(S u − C q̇ − K q) + w,   w of intensity Q_v    ⇒    r = σ²h + φ Q_v φᵀ

    Without that term the accelerometer would be taken to read the model's acceleration free of the model's error, and the
    claimed error be up to 50 times smaller than the real one (a cantilever, a chain of masses). Its correlation with w in
    the process, Q_v φᵀ, is neglected: what the accelerometer says of w itself is thrown away, so the filter is not the
    best, and the claim errs mostly to the large side, 0.96 to 1.6 times the real error there. (One mode: always to the
    large side; the Riccati residual of the best filter at the claimed covariance is −(g/r)² Q_v, g the covariance of
    reading and velocity.)

    std σ (m,) or (B, m) [unit of the channel] of a sample every h [s]; rows (m, n) or (B, m, n) on q or q̈; quantity (m,)
    or (B, m); Q (n*, n*) of x*. Returns r of the shape of std.
    """
    n = rows.shape[-1]
    process = np.einsum("...i,ij,...j->...", rows, Q[n : 2 * n, n : 2 * n], rows)
    return gauge_intensity(std, h, rule) + np.where(np.asarray(quantity) == ACCELERATION, process, 0.0)


def _positive(values: Mapping[str, float], name: str, word: str) -> float:
    value = values.get(name)
    if value is None or not 0 < value < np.inf:
        raise ConfigError(f"{word} of {name} is {value}", remedy=f"give {name} a positive {word}")
    return value
