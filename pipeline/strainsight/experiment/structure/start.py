"""Load histories and initial motion: from rest, periodic, or after a settling time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np

from strainsight.config.loads import Settle
from strainsight.errors import ConfigError, UserError, blame
from strainsight.loads.histories import Signal, Sweep, Tones, hold_coefficients, tones_of
from strainsight.rom.modal_step import HOLD, simulate, steady_start
from strainsight.rom.model import ReducedModel, modal_basis

DECAYS = 3.0
"""Decay times 1/(ζω₁) after which the initial transient counts as decayed (5 % left)."""


@dataclass(frozen=True)
class Loading:
    """Loads from t = 0, and during the settling time before.

    coefficients (steps, HOLD, n_u) [N]: hold coefficients at every step h [s]; tones: of all loads if the motion is periodic
    from the start; lead (k, HOLD, n_u) [N]: steps from rest before t = 0."""

    coefficients: np.ndarray
    h: float
    tones: Tones | None
    lead: np.ndarray

    @property
    def moving(self) -> bool:
        """Whether the structure moves at t = 0."""
        return self.tones is not None or len(self.lead) > 0


def loading_of(settle: Settle, signals: Sequence[Signal], h: float, steps: int) -> Loading:
    """Build the loads with the start set by `train.settle`:

    auto     periodic from the start if every signal is a sum of sines and constants, else from rest
    none     from rest
    seconds  from rest this time before t = 0, rounded up to whole steps, under the same signals

    h [s]; steps: from t = 0. Raises ConfigError if a signal is unknown before t = 0, InfeasibleError if it ends too early."""
    coefficients = hold_coefficients(signals, 0.0, h, steps)
    lead, tones = np.zeros((0, HOLD, coefficients.shape[-1])), None
    if settle == "auto":
        tones = tones_of(signals)
    elif settle != "none":
        lead = _lead(settle, signals, h)
    return Loading(coefficients, h, tones, lead)


def _lead(settle: float, signals: Sequence[Signal], h: float) -> np.ndarray:
    if any(isinstance(signal, Sweep) for signal in signals):
        raise ConfigError(
            f"a sweep begins at t = 0, so a settling time of {settle:g} s before it is not possible",
            key="train.settle",
            remedy="Set train.settle to auto or none.",
        )
    count = ceil(settle / h * (1 - 1e-9))
    try:
        return hold_coefficients(signals, -count * h, h, count)
    except UserError as error:
        remedy = "Set train.settle to auto or none, or use a record of the load that begins earlier."
        raise ConfigError(error.what, key="train.settle", remedy=remedy) from None


def tones_in(coefficients: np.ndarray, h: float, frequency: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fit W (k, HOLD, n) complex: Σₖ Re Wₖ exp(iωₖjh) approximates the hold coefficients of step j (least squares).

    coefficients (T, HOLD, n); h [s]; frequency ω (k,) [rad/s]. Returns W and the relative RMS residual of the loads (n,)."""
    phase = np.outer(h * np.arange(len(coefficients)), frequency)
    columns = np.hstack([np.cos(phase), -np.sin(phase)])
    flat = coefficients.reshape(len(coefficients), -1)
    amplitude = np.linalg.lstsq(columns, flat, rcond=None)[0]
    off = (flat - columns @ amplitude).reshape(coefficients.shape)[:, 0]
    real, imaginary = amplitude.reshape(2, len(frequency), *coefficients.shape[1:])
    size = np.sqrt(np.mean(coefficients[:, 0] ** 2, axis=0))
    return real + 1j * imaginary, np.sqrt(np.mean(off**2, axis=0)) / np.where(size > 0, size, 1.0)


def motion_of(model: ReducedModel, theta: Mapping[str, float], loading: Loading) -> np.ndarray:
    """Motion x (steps + 1, 2n) = [q, q̇] from t = 0, exact for the held loads; theta: all parameters [SI]."""
    if loading.tones is not None:
        tones = loading.tones
        with blame("train.settle"):
            start = steady_start(model, theta, loading.h, tones.frequency, tones.amplitude)
        return simulate(model, theta, loading.coefficients, loading.h, start)
    all_steps = np.concatenate([loading.lead, loading.coefficients])
    return simulate(model, theta, all_steps, loading.h)[len(loading.lead) :]


def decay_left(model: ReducedModel, loading: Loading) -> float:
    """End of the initial transient [s], DECAYS/(ζω₁) of the first mode; −inf for a periodic start, inf without damping."""
    if loading.tones is not None:
        return -np.inf
    lam, _ = modal_basis(model, model.reference)
    rate = 0.5 * float(model.damping.at(model.reference).viscous(lam[:1])[0][0])
    return (DECAYS / rate if rate > 0 else np.inf) - len(loading.lead) * loading.h


def ringing_in_words(settle: Settle, loading: Loading, model: ReducedModel, instants: np.ndarray) -> str:
    """Warning if instants (k,) lie in the initial transient, else empty; empty for `none`."""
    until = decay_left(model, loading)
    early = int(np.sum(loading.h * np.asarray(instants) < until))
    if settle == "none" or not early:
        return ""
    until_words = "is undamped" if np.isinf(until) else f"lasts {until:.3g} s, {DECAYS:g} decay times of the first mode"
    return (
        f"{early} of {len(instants)} linearisation instants lie in the initial transient, which {until_words}. Expected σ "
        "includes this transient. Set train.settle to a longer time, or to none to accept the transient."
    )
