"""Consistency of the claimed standard deviation: NEES, NIS, whiteness, and tuning of the noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.special import ndtri

from strainsight.errors import ConfigError, NumericalError
from strainsight.estimation.decision import LEVEL, OVERCONFIDENT, SLACK, TOO_CAUTIOUS, check_ratio
from strainsight.estimation.filter import run_filter
from strainsight.estimation.model import FilterModel

PROCESS, NOISE = "process_noise", "noise_std"
"""Config keys of Q and R."""
CHECK = (
    f"check channels, known loads and the model, and compare {NOISE} of the gauges with the scatter of readings at rest"
)
"""Possible causes of large innovations, which a larger noise would hide."""


@dataclass(frozen=True)
class InnovationCheck:
    """Innovations compared with the claim: ratio of their size, with the band of a correct model; lag-one correlation, with its
    limit; and the conclusion."""

    ratio: float
    band: tuple[float, float]
    correlation: float
    chance: float
    consistent: bool
    text: str


def nees(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Normalised estimation error squared over its dimension, ε = eᵀP⁻¹e / d: 1 on average if P is consistent. error e (...,
    d), estimate minus truth; covariance P (..., d, d) without exact zeros, such as `FilterRun.unknown_covariance`, scaled to
    diag P = 1 before it is solved. Returns (...). Source: Bar-Shalom, Li and Kirubarajan, Estimation (2001), section 5.4."""
    std = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    correlation = covariance / (std[..., :, None] * std[..., None, :])
    scaled = error / std
    return np.sum(scaled * np.linalg.solve(correlation, scaled[..., None])[..., 0], axis=-1) / error.shape[-1]


def nis(whitened: np.ndarray) -> np.ndarray:
    """Normalised innovation squared over the number of gauges that measured, νᵀS⁻¹ν / m, NaN where none did. whitened (...,
    m) from `FilterRun.whitened`. Returns (...)."""
    count = np.sum(np.isfinite(whitened), axis=-1)
    return np.where(count > 0, np.nansum(whitened**2, axis=-1) / np.maximum(count, 1), np.nan)


def whiteness(whitened: np.ndarray) -> np.ndarray:
    """Lag-one autocorrelation of the whitened innovations, ρ₁ = Σₖ ν̃ₖ₊₁·ν̃ₖ / Σₖ |ν̃ₖ|²: about 0 if the model is true.
    whitened (T, ..., m), missing entries (NaN) left out. Returns (...); compare with `whiteness_band`."""
    known = np.nan_to_num(whitened)
    power = np.sum(known**2, axis=(0, -1))
    return np.sum(known[1:] * known[:-1], axis=(0, -1)) / np.where(power > 0, power, np.nan)


def whiteness_band(steps: int, gauges: int, level: float = LEVEL) -> float:
    """Largest |ρ₁| to be expected of white innovations: z/√(T m), by Bartlett's formula."""
    return float(ndtri(0.5 * (1 + level)) / np.sqrt(steps * gauges))


def check_innovations(whitened: np.ndarray) -> InnovationCheck:
    """Compare NIS and whiteness of one or many runs with the configured noise, in words. whitened (T, m) or (T, B, m) from
    `FilterRun.whitened`, NaN if missing or diverged. Ratio √(mean NIS). Too small a Q makes the gain too small and successive
    innovations similar; too small an R makes it too large, and they alternate. Source: Mehra, IEEE Trans. Automatic Control
    15 (1970)."""
    samples = int(np.isfinite(whitened).sum())
    if not samples:
        text = "the innovations cannot be checked, because no channel has a measured sample"
        return InnovationCheck(np.nan, (np.nan, np.nan), np.nan, np.nan, False, text)
    power, chance = np.nansum(whitened**2), whiteness_band(samples, 1)
    ratio = float(np.sqrt(power / samples))
    size = check_ratio(ratio, samples)
    if not power:
        text = "all innovations are exactly zero: check whether the channels are connected"
        return InnovationCheck(0.0, size.band, 0.0, chance, False, text)
    correlation = float(whiteness(whitened.reshape(len(whitened), -1)))
    large, small = size.result == OVERCONFIDENT, size.result == TOO_CAUTIOUS
    positive, negative = correlation > max(chance, SLACK), correlation < -max(chance, SLACK)
    if small:
        lower = NOISE if positive else PROCESS if negative else f"{NOISE} or {PROCESS}"
        text = (
            f"σ is cautious: the innovations are {1 / ratio:.1f} times smaller than expected from the configured noise, so "
            f"σ may be too large by up to this factor. The measurements are consistent with the model; to reduce σ, lower {lower}"
        )
        return InnovationCheck(ratio, size.band, correlation, chance, True, text)
    by = f"{ratio:.1f} times as large as" if large else "as large as"
    finding = f"the innovations are {by} expected from the configured noise"
    advice = CHECK if large or positive or negative else ""
    if positive:
        finding += (
            f", and successive innovations are correlated ({correlation:.2f}): the estimates follow the measurements too slowly, "
            "or the finite-element model is incomplete"
        )
    elif negative:
        finding += f", and successive innovations alternate in sign (correlation {correlation:.2f}): the filter gain is too large"
    elif not advice:
        finding += ", and successive innovations are uncorrelated: consistent with the claimed σ"
    text = ("; " if positive or negative else ": ").join(filter(None, (finding, advice)))
    return InnovationCheck(ratio, size.band, correlation, chance, not advice, text)


NONE = 1e-9
"""Share of its amplitude up to which a load counts as zero."""


def load_scale(truth: np.ndarray, amplitude: float) -> tuple[float, bool]:
    """Scale of load errors [N], √(mean u²) after the first tenth, or the amplitude if that is zero; and whether it is. truth
    (T + 1,) [N]; amplitude [N], positive: size of the load assumed by the filter."""
    rms = float(np.sqrt(np.mean(after_start(truth) ** 2)))
    return (rms, False) if rms > NONE * amplitude else (amplitude, True)


def input_error(error: np.ndarray, scale: float) -> np.ndarray:
    """RMS of a load's error, or of its claimed σ, after the first tenth and over its scale, √(mean e²) / s. error (T + 1,
    ...), estimate less truth, or σ, and scale, of `load_scale`, in one unit. Returns (...)."""
    return np.asarray(np.sqrt(np.mean(after_start(error) ** 2, axis=0)) / scale)


def after_start(history: np.ndarray) -> np.ndarray:
    """A history (T + 1, ...) without its first tenth, which is excluded from errors."""
    return history[int(np.ceil(0.1 * len(history))) :]


def settling_time(time: np.ndarray, estimate: np.ndarray, truth: float, share: float) -> float:
    """From when on an estimate stays within a share of the truth; infinite where it is outside in the end. time (T + 1,) [s];
    estimate (T + 1,) and truth in one unit; share [-]. Returns [s]."""
    outside = np.flatnonzero(~(np.abs(estimate - truth) <= share * abs(truth)))
    after = outside[-1] + 1 if outside.size else 0
    return float(time[after]) if after < len(time) else float("inf")


Part = Literal["process", "inputs", "model_error", "parameters", "noise"]
DIFFERENCE = 0.02
"""Step of the central differences in the logarithm of a factor."""


@dataclass(frozen=True)
class Tuning:
    """factors by part; undecided: parts whose factor reached its limit."""

    factors: Mapping[str, float]
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
    Source: Schweppe, IEEE Trans. Information Theory 11 (1965)."""
    from scipy.optimize import minimize  # a third of a second to import, which an up-to-date run need not spend

    for part in parts:
        if part != "noise" and not np.any(_block(model, part)):
            raise ConfigError(
                f"the process noise of {part} is zero and cannot be tuned",
                remedy=f"set `process_noise` of {part} greater than zero, or remove {part} from estimate.tune.parts",
            )
    count = len(parts)
    data = measurement if measurement.ndim == 3 else measurement[:, None, :]
    probes = np.concatenate([np.zeros((1, count)), DIFFERENCE * np.eye(count), -DIFFERENCE * np.eye(count)])

    def likelihood(logarithms: np.ndarray) -> np.ndarray:
        """Log-likelihood at the factors and at the probes around them (1 + 2 count,)."""
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
            "the filter diverges with the configured noise levels, so estimate.tune cannot start from these levels",
            remedy="choose guesses of the parameters closer to the true values, a smaller estimate.initial_std or a smaller "
            "estimate.time_step",
        )
    # worse than anywhere on the way, and no more: the search interpolates, and next to infinity would leave it no step
    hopeless = abs(first) - first + 1.0
    best = minimize(negative, start, jac=True, method="L-BFGS-B", bounds=[(-bound, bound)] * count)
    logarithms = {str(part): float(value) for part, value in zip(parts, best.x, strict=True)}
    at_limit = tuple(part for part, value in logarithms.items() if abs(value) > bound - 1e-6)
    return Tuning({part: float(np.exp(value)) for part, value in logarithms.items()}, at_limit)


def _lost(value: np.ndarray, count: int) -> bool:
    """Whether the slope is undefined: the run itself diverged, or both probes of some factor; value as in `_slope`."""
    return not np.isfinite(value[0]) or bool(np.any(~np.isfinite(value[1:].reshape(2, count)).any(axis=0)))


def _slope(value: np.ndarray, count: int) -> np.ndarray:
    """Central differences (count,) of value (1 + 2 count,): at a point and at the probes on both sides; one-sided where a run
    diverged."""
    probes = value[1:].reshape(2, count)
    finite = np.isfinite(probes)
    above, below = np.where(finite, probes, value[0])
    return np.asarray((above - below) / (DIFFERENCE * finite.sum(axis=0)))


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
    """The part's block of Q, zero elsewhere."""
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
