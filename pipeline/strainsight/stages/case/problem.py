"""What place and validate share: the unknowns, their process noise, and the filter's model of a set of gauges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from strainsight.augmentation.linearisation import Unknowns, augment_rows
from strainsight.augmentation.noise import gauge_intensity, process_intensity
from strainsight.errors import blame
from strainsight.estimation.model import FilterModel
from strainsight.rom.model import ReducedModel, damping_matrix, modal_basis
from strainsight.signals.histories import Signal, hold_coefficients
from strainsight.stages.case.settings import characteristic, signal_of, unknowns_of
from strainsight.stages.records.model import model_from
from strainsight.workflow.stage import Context

REST_SHARE = 1e-3
"""Initial σ of every state as a share of its largest training amplitude: the structure is known to be at rest."""


@dataclass(frozen=True)
class Problem:
    """One estimation problem before its gauges are chosen.

    model; unknowns; signals of all inputs by name; x (steps + 1, 2n) and u (steps, HOLD, n_u) of the training run at
    step h [s]; Q (n*, n*) process intensity; noise_std [strain] of one gauge sample at step h; rows (m, n) of all candidates.
    """

    model: ReducedModel
    unknowns: Unknowns
    signals: Mapping[str, Signal]
    x: np.ndarray
    u: np.ndarray
    h: float
    Q: np.ndarray
    noise_std: float
    rows: np.ndarray

    @property
    def known(self) -> tuple[str, ...]:
        """Inputs whose history the filter is given."""
        return tuple(name for name in self.model.inputs if name not in self.unknowns.inputs)

    def columns(self, names: Sequence[str]) -> list[int]:
        return [self.model.inputs.index(name) for name in names]


def problem_of(context: Context) -> Problem:
    """Gather the estimation problem from the artefacts of rom, train and screen and from the config."""
    config, rom, train = context.config, context.upstream["rom"], context.upstream["train"]
    model = model_from(rom)
    h, duration = float(config.train.time_step), float(config.train.duration)
    with blame("train"):
        # In the order of the reduced model: that of the config may have changed since, which is no change of the config.
        signals = {name: signal_of(name, config.loads[name].signal, context.files) for name in model.inputs}
        u = hold_coefficients(list(signals.values()), 0.0, h, round(duration / h))
    x = np.hstack([train["/coordinate"], train["/velocity"]])
    unknowns = unknowns_of(config.place.estimate, config.loads, signals, model.reference, duration)
    frequency = {name: characteristic(config.loads[name], signals[name], duration)[0] for name in unknowns.inputs}
    drift = {name: float(config.parameters[name].process_noise_scale) for name in unknowns.parameters}
    noise = config.process_noise
    with blame("process_noise"):
        Q = process_intensity(
            model.size,
            unknowns,
            frequency,
            drift,
            rule="thesis" if noise.rule == "thesis" else "intensity",
            h=h,
            kappa=np.array([config.loads[name].process_noise.kappa for name in unknowns.inputs]),
            velocity=model_error_intensity(model, x, u[:, 0], noise.model_error),
        )
    return Problem(
        model, unknowns, signals, x, u, h, Q, float(context.upstream["screen"]["/noise_std"]), train["/gauges/row"]
    )


def model_error_intensity(model: ReducedModel, x: np.ndarray, u: np.ndarray, share: float) -> np.ndarray:
    """q_v = (share · rms q̈)² / ω₁ (n,) [kg m²/s³]: a white acceleration for what the model leaves out.

    share [-] of the RMS training acceleration, correlated over 1/ω₁ of the first mode; x (T + 1, 2n); u (T, n_u) [N].
    """
    n = model.size
    M, K = model.mass.at(model.reference), model.stiffness.at(model.reference)
    C = damping_matrix(model, model.reference)
    q, v = x[: len(u), :n], x[: len(u), n:]
    acceleration = np.linalg.solve(M, (u @ model.input_shape.T - q @ K - v @ C).T)
    lam, _ = modal_basis(model, model.reference)
    return share**2 * np.mean(acceleration**2, axis=1) / np.sqrt(lam[0])


def filter_model(problem: Problem, gauges: np.ndarray, h: float, noise_factor: Any = 1.0) -> FilterModel:
    """The filter with these gauges at step h [s]: gauges (k,) or (B, k) candidate indices; noise_factor scalar or (B,)."""
    k = gauges.shape[-1]
    H = augment_rows(problem.rows[gauges.ravel()], problem.unknowns).reshape(*gauges.shape, -1)
    r = gauge_intensity(np.asarray(noise_factor)[..., None] * np.full(k, problem.noise_std), problem.h)
    fixed = {name: value for name, value in problem.model.reference.items() if name not in problem.unknowns.parameters}
    return FilterModel(problem.model, problem.unknowns, problem.known, fixed, H, problem.Q, r, h)


def initial_covariance(problem: Problem, relative_std: Mapping[str, float]) -> np.ndarray:
    """P₀ (n*, n*): at rest up to REST_SHARE of the training amplitudes; unknowns as stated, relative to amplitude and guess."""
    rest = REST_SHARE * np.abs(problem.x).max(axis=0)
    return np.diag(np.concatenate([rest, [relative_std[name] for name in problem.unknowns.names]]) ** 2)
