"""The loads of a bench by all its samples, also the later ones: the first run of an extended filter, smoothed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.estimation.filter import FilterRun
from strainsight.estimation.model import StepModel
from strainsight.estimation.run import Keep
from strainsight.estimation.smoother import smooth_first
from strainsight.multibody.inverse.model import AugmentedStep

LARGEST = 1e9
"""Bytes that a smoother may keep of a filter."""


@dataclass(frozen=True)
class SmoothedLoads:
    """mean, std (T + 1, nu) of the unknown loads of the first run, by all samples [N, N m]; std NaN where it is withheld."""

    mean: np.ndarray
    std: np.ndarray


def keep_for(model: AugmentedStep, steps: int) -> tuple[Keep, tuple[str, ...]]:
    """What a filter of so many steps has to keep for `smoothed_loads`, and a note where that is too much."""
    if not len(model.inputs):
        return "mean", ()
    # covariance, Jacobian and process noise, and the rows of the measurement
    size = 8.0 * steps * model.size * (3 * model.size + model.channels)
    if size <= LARGEST:
        return "first", ()
    return "mean", (
        f"loads are not smoothed: {steps} steps of {model.size} states take {size / 1e9:.3g} GB, at most {LARGEST / 1e9:.3g}; "
        "loads.csv has the filter's; a shorter estimate.duration or a longer estimate.time_step has them smoothed",
    )


def smoothed_loads(model: AugmentedStep, whole: StepModel, run: FilterRun) -> SmoothedLoads | None:
    """None where nothing was kept, or the first run diverged; whole: the model of the run, with offsets behind its states.

    σ is withheld of loads that are smooth where the filter allows for what its step leaves out: of that it takes every step's
    share for new, and the smoother of a smooth load averages what comes again and again as if it went out. Against another
    integrator errors were up to twice σ.
    """
    if run.covariance is None or run.jacobian is None or run.lost[0] >= 0:
        return None
    if not (np.isfinite(run.covariance).all() and np.isfinite(run.jacobian).all()):
        return None
    found = smooth_first(whole, run)
    std = found.std[:, 0, model.u]
    if model.corrected:
        std[:, has_rates(model)] = np.nan
    return SmoothedLoads(found.mean[:, 0, model.u], std)


def has_rates(model: AugmentedStep) -> np.ndarray:
    """Which unknown loads (nu,) are smooth: those with more states than the load itself."""
    ends = np.append(model.loads.first, model.loads.size)
    return np.asarray(np.diff(ends) > 1)
