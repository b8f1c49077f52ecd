"""Result of a filter, and the arrays in which it is collected."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.reduced import StepModel
from strainsight.estimation.update import output_std, standard_deviation

Keep = Literal["parameters", "readings", "mean", "first", "all"]
"""Whether smoother inputs are stored for no run, the first or all; "parameters" stores only those of the grid filter,
"readings" no σ of states in a model without parameters."""


@dataclass(frozen=True)
class FilterRun:
    """What B runs over T steps estimated; index k of a measured quantity is the instant (k + 1)h.

    time (T + 1,) [s]; mean, std (T + 1, B, n*) of x* after the update (index 0: the initial state);
    unknown_covariance (T + 1, b, k, k) of the unknowns, ũ of every input and p;
    gauge_mean, gauge_std (T, B, m) of the readings h(x*) after the update [unit of the channel];
    innovation (T, B, m) y − h(x̂⁻); whitened (T, B, m) L⁻¹(y − h(x̂⁻)), unit white noise if the model is true;
    nis (T, B) its square sum; log_likelihood (B,) of all measurements, −∞ for a diverged run, and fit (T, B) of those of every
    step; of an iterated update by Laplace's rule at the most probable state, −½‖adjusted‖² − ½ ln |2πS|;
    lost (B,) index of the step that lost the run (NaN from there on), −1 for none;
    last (b, n*, n*) covariance at the end, from which a next run may go on;
    only where kept: covariance (T + 1, b, n*, n*), jacobian (T, b, n*, n*) of the step, rows (T, b, m, n*) of the
    measurement, adjusted (T, B, m) the whitened innovation of the linear model along these; b is 1 where runs share them, or
    where the first one's alone are kept;
    process (T, b, n*, n*) and noise (T, b, m, m): covariances of step and measurement where what the filter found decides on
    them, else None.
    A missing measurement (NaN) leaves NaN in innovation and whitened and adds nothing to nis."""

    time: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    unknown_covariance: np.ndarray
    gauge_mean: np.ndarray
    gauge_std: np.ndarray
    innovation: np.ndarray
    whitened: np.ndarray
    nis: np.ndarray
    lost: np.ndarray
    log_likelihood: np.ndarray
    last: np.ndarray
    covariance: np.ndarray | None = None
    jacobian: np.ndarray | None = None
    rows: np.ndarray | None = None
    adjusted: np.ndarray | None = None
    process: np.ndarray | None = None
    noise: np.ndarray | None = None
    fit: np.ndarray | None = None


class RunArrays:
    """Arrays of a FilterRun: B runs, b covariances, T steps of a model; iterating: whether innovations of the last linearisation
    differ from the first; regressed: whether to store the noises; each: whether to store the process noise."""

    def __init__(
        self,
        model: StepModel,
        steps: int,
        runs: int,
        b: int,
        keep: Keep,
        iterating: bool = False,
        regressed: bool = False,
        each: bool = False,
    ):
        n, m, k = model.size, model.channels, len(model.position)
        self.model, self.steps = model, steps
        self.mean, self.std = np.empty((steps + 1, runs, n)), np.empty((steps + 1, b, n))
        self.unknown_covariance = np.empty((steps + 1, b, k, k))
        self.gauge_mean, self.gauge_std = np.empty((steps, runs, m)), np.empty((steps, b, m))
        self.innovation, self.whitened = (np.full((steps, runs, m), np.nan) for _ in range(2))
        self.adjusted = np.full((steps, runs, m), np.nan) if iterating else self.whitened
        self.spread = np.ones((steps, b, m))
        self.lost = np.full(runs, -1)
        # what is the same in every step is kept once
        once = 1 if model.linear else steps
        keeps = keep in ("first", "all")
        self.first = slice(1 if keep == "first" else None)
        b = 1 if keep == "first" else b
        self.covariance = np.empty((steps + 1, b, n, n)) if keeps else None
        self.jacobian = np.empty((once, b, n, n)) if keeps else None
        self.rows = np.zeros((once, b, m, n)) if keeps else None
        self.process = np.empty((steps, b, n, n)) if keeps and (regressed or each) else None
        self.noise = np.empty((steps, b, m, m)) if keeps and regressed else None

    def state(self, k: int, x: np.ndarray, P: np.ndarray | None) -> None:
        """Store x (B, n) and P (b, n, n) at instant k; P None: unchanged."""
        self.mean[k] = x
        if P is None:
            self.std[k], self.unknown_covariance[k] = self.std[k - 1], self.unknown_covariance[k - 1]
        else:
            at = self.model.position
            self.std[k], self.unknown_covariance[k] = standard_deviation(P), P[:, at[:, None], at]
        if self.covariance is not None:
            self.covariance[k] = self.covariance[k - 1] if P is None else P[self.first]

    def readings(self, k: int, y: np.ndarray, C: np.ndarray, P: np.ndarray | None) -> None:
        """Store y (B, m) after step k, with its standard deviation by C (b, m, n); P None: unchanged."""
        self.gauge_mean[k] = y
        self.gauge_std[k] = self.gauge_std[k - 1] if P is None else output_std(C, P)

    def linearised(
        self,
        k: int,
        A: np.ndarray,
        H: np.ndarray | None,
        adjusted: np.ndarray | None,
        process: np.ndarray,
        R: np.ndarray,
    ) -> None:
        """Store the Jacobians of step k, H None without samples, and covariances (b, n, n) of it and (b, m, m), or variances (b,
        m), of its measurement."""
        if self.jacobian is not None and self.rows is not None:
            if k < len(self.jacobian):
                self.jacobian[k] = A[self.first]
            if H is not None:
                self.rows[min(k, len(self.rows) - 1)] = H[self.first]
        if adjusted is not None and self.adjusted is not self.whitened:
            self.adjusted[k] = adjusted
        if self.process is not None:
            self.process[k] = process if process.ndim == 2 else process[self.first]
        if self.noise is not None:
            self.noise[k] = R if R.ndim == 3 else R[:, None, :] * np.eye(R.shape[1])

    def astray(self, k: int, x: np.ndarray, refuse: bool) -> np.ndarray:
        """Mask (B,) of runs that diverged in step k, x (B, n) after it; they are marked. Raises NumericalError if none remains,
        and `refuse`."""
        lost = self.model.lost(x)
        self.lost[lost & (self.lost < 0)] = k + 1
        if refuse and np.all(self.lost >= 0):
            raise all_lost(self.model, self.lost)
        return lost

    def finished(self, P: np.ndarray, measured: np.ndarray) -> FilterRun:
        """The run; P: last covariance, measured (T, b, m): samples; a diverged run is NaN from its divergence on."""
        steps, missing = self.steps, np.isnan(self.innovation)
        self.whitened[missing] = self.adjusted[missing] = np.nan
        nis = np.nansum(self.whitened**2, axis=2)
        spread = np.where(measured, np.log(2 * np.pi) + 2 * np.log(self.spread), 0.0)
        fit = -0.5 * (np.nansum(self.adjusted**2, axis=2) + spread.sum(axis=2))
        for run in np.flatnonzero(self.lost >= 0):
            first = self.lost[run]
            self.mean[first:, run] = np.nan
            for record in (self.gauge_mean, self.innovation, self.whitened, self.adjusted, nis):
                record[first - 1 :, run] = np.nan
            fit[first - 1 :, run] = -np.inf
        keeps = self.covariance is not None
        return FilterRun(
            time=self.model.h * np.arange(steps + 1),
            mean=self.mean,
            std=np.broadcast_to(self.std, self.mean.shape),
            unknown_covariance=self.unknown_covariance,
            gauge_mean=self.gauge_mean,
            gauge_std=np.broadcast_to(self.gauge_std, self.gauge_mean.shape),
            innovation=self.innovation,
            whitened=self.whitened,
            nis=nis,
            lost=self.lost,
            log_likelihood=fit.sum(axis=0),
            last=P,
            covariance=self.covariance,
            jacobian=_every_step(self.jacobian, steps),
            rows=_every_step(self.rows, steps),
            adjusted=self.adjusted if keeps else None,
            process=self.process,
            noise=self.noise,
            fit=fit,
        )


def _every_step(array: np.ndarray | None, steps: int) -> np.ndarray | None:
    return None if array is None else np.broadcast_to(array, (steps, *array.shape[1:]))


def all_lost(model: StepModel, lost: np.ndarray) -> NumericalError:
    """Error if all runs diverge; lost (B,): steps at which they diverged."""
    return NumericalError(
        f"the filter diverged: {model.loss}, in every run (number of runs: {len(lost)}), first at t = {lost.min() * model.h:g} s",
        remedy="choose guesses of the parameters closer to the true values, a smaller initial standard deviation or a smaller "
        "time step",
    )
