"""Loads in time, and how the motion under them begins: from rest, periodic from the first instant, or settled before it."""

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
"""Decay times 1/(ζω₁) after which what a start from rest has set off counts as gone: 5 % of it are left."""


@dataclass(frozen=True)
class Loading:
    """Loads from t = 0 on, and before.

    held (steps, HOLD, n_u) [N] of every step of h [s]; tones: of all loads where the motion is periodic from the first
    instant; lead (k, HOLD, n_u) [N]: the steps from rest before t = 0.
    """

    held: np.ndarray
    h: float
    tones: Tones | None
    lead: np.ndarray

    @property
    def moving(self) -> bool:
        """Whether the structure moves at t = 0."""
        return self.tones is not None or len(self.lead) > 0


def loading_of(settle: Settle, signals: Sequence[Signal], h: float, steps: int) -> Loading:
    """The loads as `train.settle` wants them to begin:

    auto     periodic from the first instant where every signal is a sum of sines and constants, else from rest
    none     from rest
    seconds  from rest so long before t = 0, rounded up to whole steps, under the same signals

    signals: of every load; h [s]; steps from t = 0 on. Raises ConfigError where a signal is not known before t = 0, and
    InfeasibleError where one is not known to the end.
    """
    held = hold_coefficients(signals, 0.0, h, steps)
    lead, tones = np.zeros((0, HOLD, held.shape[-1])), None
    if settle == "auto":
        tones = tones_of(signals)
    elif settle != "none":
        lead = _lead(settle, signals, h)
    return Loading(held, h, tones, lead)


def _lead(settle: float, signals: Sequence[Signal], h: float) -> np.ndarray:
    remedy = "auto, none, or a record that begins so much earlier"
    if any(isinstance(signal, Sweep) for signal in signals):
        raise ConfigError(f"a sweep begins at t = 0, and {settle:g} s before it", key="train.settle", remedy=remedy)
    count = ceil(settle / h * (1 - 1e-9))
    try:
        return hold_coefficients(signals, -count * h, h, count)
    except UserError as error:
        raise ConfigError(error.what, key="train.settle", remedy=remedy) from None


def tones_in(held: np.ndarray, h: float, frequency: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """W (k, HOLD, n) complex, with which Σₖ Re Wₖ exp(iωₖjh) is nearest to the hold coefficients of steps j, and by how much
    the loads at their beginnings miss that, RMS over RMS (n,); held (T, HOLD, n), h [s], frequency ω (k,) [rad/s]."""
    phase = np.outer(h * np.arange(len(held)), frequency)
    columns = np.hstack([np.cos(phase), -np.sin(phase)])
    flat = held.reshape(len(held), -1)
    amplitude = np.linalg.lstsq(columns, flat, rcond=None)[0]
    off = (flat - columns @ amplitude).reshape(held.shape)[:, 0]
    real, imaginary = amplitude.reshape(2, len(frequency), *held.shape[1:])
    size = np.sqrt(np.mean(held[:, 0] ** 2, axis=0))
    return real + 1j * imaginary, np.sqrt(np.mean(off**2, axis=0)) / np.where(size > 0, size, 1.0)


def motion_of(model: ReducedModel, theta: Mapping[str, float], loading: Loading) -> np.ndarray:
    """x (steps + 1, 2n) = [q, q̇] from t = 0 on, exact for the held loads; theta: all parameters [SI]."""
    if loading.tones is not None:
        tones = loading.tones
        with blame("train.settle"):
            start = steady_start(model, theta, loading.h, tones.frequency, tones.amplitude)
        return simulate(model, theta, loading.held, loading.h, start)
    every = np.concatenate([loading.lead, loading.held])
    return simulate(model, theta, every, loading.h)[len(loading.lead) :]


def decay_left(model: ReducedModel, loading: Loading) -> float:
    """Until when [s] what the start from rest has set off counts: DECAYS/(ζω₁) of the first mode; −inf without such a start,
    inf without damping."""
    if loading.tones is not None:
        return -np.inf
    lam, _ = modal_basis(model, model.reference)
    rate = 0.5 * float(model.damping.at(model.reference).viscous(lam[:1])[0][0])
    return (DECAYS / rate if rate > 0 else np.inf) - len(loading.lead) * loading.h


def ringing_in_words(settle: Settle, loading: Loading, model: ReducedModel, instants: np.ndarray) -> str:
    """What to know where instants (k,), by their index, lie where a start from rest still rings; empty where none does, and
    where that start is asked for (`none`)."""
    until = decay_left(model, loading)
    early = int(np.sum(loading.h * np.asarray(instants) < until))
    if settle == "none" or not early:
        return ""
    how = "the training run is linearised while the start from rest still rings"
    left = (
        "which nothing damps" if np.isinf(until) else f"before {until:.3g} s, {DECAYS:g} decay times of the first mode"
    )
    return f"{early} of {len(instants)} instants lie {left}: {how}, and σ holds for that motion (train.settle)."
