"""How well every unknown is known by the chosen gauges: real and claimed errors of one run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.cases.structure.studies import Rank, Studies, rank_of
from strainsight.cases.structure.trial import Trial, real_and_claimed
from strainsight.estimation.metrics import after_start, settling_time
from strainsight.estimation.model import FilterModel, physical
from strainsight.estimation.run import FilterRun
from strainsight.estimation.smoothed import Smoothed
from strainsight.estimation.verdict import Benefit, benefit_of, samples_alike

SETTLED = 0.01
"""Share of the truth that an estimate stays within once it has settled."""


@dataclass(frozen=True)
class Accuracy:
    """How well an unknown is known by the layout.

    estimate [SI]: mean over the last half of a parameter, RMS of a load; error and std: real and claimed error of the filter,
    smoothed and smoothed_std those of the smoother, all over scale [SI]; zero: whether a load is zero throughout, so that its
    scale is its amplitude; draws, smoothed_draws: how many independent draws error and smoothed are the RMS of, 1 of a
    parameter; settling_time [s]: from when on a parameter stays within SETTLED of its truth, None of a load; rank and benefit:
    among the random sets of all candidates, None for few.
    """

    estimate: float
    error: float
    std: float
    smoothed: float
    smoothed_std: float
    scale: float
    zero: bool
    draws: int
    smoothed_draws: int
    settling_time: float | None
    rank: Rank | None
    benefit: Benefit | None


def accuracies(
    trial: Trial,
    model: FilterModel,
    run: FilterRun,
    smoothed: Smoothed,
    studies: Studies,
) -> dict[str, Accuracy]:
    """Unknown → how well it is known by the layout, whose filter and smoother have run; studies: with the random sets."""
    error, std = real_and_claimed(trial, model, run.mean, run.std)
    later_error, later_std = real_and_claimed(trial, model, smoothed.mean, smoothed.std)
    found, later = {}, physical(model, smoothed.mean[:, 0], smoothed.std[:, 0])
    for name, (value, sigma) in physical(model, run.mean[:, 0], run.std[:, 0]).items():
        constant = name in trial.problem.unknowns.parameters
        scale, zero = trial.scale(name)
        found[name] = Accuracy(
            estimate=float(
                np.mean(value[trial.constant_from(len(value)) :]) if constant else np.sqrt(np.mean(value**2))
            ),
            error=float(error[name][0]),
            std=float(std[name][0]),
            smoothed=float(later_error[name][0]),
            smoothed_std=float(later_std[name][0]),
            scale=scale,
            zero=zero,
            draws=1 if constant else _draws(value - trial.history[name], sigma),
            smoothed_draws=1 if constant else _draws(later[name][0] - trial.history[name], later[name][1]),
            settling_time=settling_time(trial.time, value, trial.truth.theta[name], SETTLED) if constant else None,
            rank=rank_of(studies.all, name, float(error[name][0]), float(std[name][0])),
            benefit=benefit_of(float(error[name][0]), studies.all.real[name]),
        )
    return found


def _draws(error: np.ndarray, std: np.ndarray) -> int:
    """Independent draws that a load's error (T + 1,) is worth after the first tenth of the run."""
    scaled = after_start(np.divide(error, std, out=np.full_like(error, np.nan), where=std > 0))
    return max(1, int(np.count_nonzero(np.isfinite(scaled)) / samples_alike(scaled)))
