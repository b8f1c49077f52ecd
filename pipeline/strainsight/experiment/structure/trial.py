"""Set-up of a validation: simulated truth, its motion, and the data of the filter."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NoReturn

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.errors import NumericalError, blame
from strainsight.estimation.conditional import ConsideredParameters
from strainsight.estimation.consistency import input_error, load_scale
from strainsight.estimation.grid_filter import GridRun, filter_on_grid
from strainsight.estimation.grid_filter_smoother import smooth_on_grid
from strainsight.estimation.model import FilterModel, physical
from strainsight.estimation.record import GridRecord, Settled
from strainsight.estimation.run import FilterRun, Keep
from strainsight.estimation.smoother import Smoothed, smooth
from strainsight.experiment.structure.considered import Tolerated, build_considered, on_average
from strainsight.experiment.structure.filtering import by_moments, together
from strainsight.experiment.structure.problem import Problem, initial_covariance, sample_std, settled_under
from strainsight.experiment.structure.references import unknown_units
from strainsight.experiment.structure.start import Loading, loading_of
from strainsight.experiment.structure.truth import SimulatedMotion, SimulatedTruth
from strainsight.loads.histories import instant_values


@dataclass(frozen=True)
class TrialRuns:
    """run: B filter runs; grid_runs: their grid filter results, empty for other filters, None for a failed run."""

    run: FilterRun
    grid_runs: tuple[GridRun | None, ...]


@dataclass(frozen=True)
class Trial:
    """A validation.

    h [s], time (T + 1,) [s]; known (T, HOLD, n_known) [N]: known loads; truth, motion: simulated; history: unknown →
    (T + 1,) [SI]; gauges: numbers of the layout, chosen (k,): their channels; stopped: number of gauges whose position error was
    limited by a sharp edge; covariance P₀ (n*, n*); settled: initial motion if known; units: by unknown; tolerated: tolerances of
    the channels; again: realisation → readings without noise (T + 1, k) of a resampled truth, None without sampling."""

    problem: Problem
    h: float
    time: np.ndarray
    known: np.ndarray
    truth: SimulatedTruth
    motion: SimulatedMotion
    history: Mapping[str, np.ndarray]
    gauges: np.ndarray
    chosen: np.ndarray
    stopped: int
    covariance: np.ndarray
    settled: Settled | None
    units: Mapping[str, str]
    tolerated: Tolerated
    again: Callable[[int], np.ndarray] | None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return self.problem.unknowns.names

    def constant_from(self, instants: int) -> int:
        """First instant of the average of a parameter estimate: the last instant for a constant parameter."""
        return instants // 2 if self.problem.drifting else instants - 1

    def scale(self, name: str) -> tuple[float, bool]:
        """Scale of errors of an unknown [SI]: true parameter, RMS of a load, or its amplitude if it is zero; and whether it is
        zero."""
        if name in self.problem.unknowns.parameters:
            return self.truth.theta[name], False
        return load_scale(self.history[name], self.problem.unknowns.amplitude[name])

    def reading(self, channels: np.ndarray) -> np.ndarray:
        """Readings (T + 1, ...) of channels (...) without noise [unit of the channel], NaN for channel −1."""
        needed, place = np.unique(channels, return_inverse=True)
        read = self.motion(needed)[:, place.reshape(channels.shape)]
        return np.where(channels >= 0, read, np.nan)

    def measured(self, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Readings of the layout with noise, and without (T, k)."""
        true = self.reading(self.chosen)[1:]
        return true + sample_noise(seed, 0, *true.shape) * sample_std(self.problem, self.chosen, self.h), true

    def filtered(
        self,
        model: FilterModel,
        channels: np.ndarray,
        measured: np.ndarray,
        start: np.ndarray | None = None,
        keep: Keep = "mean",
        refuse: bool = True,
    ) -> TrialRuns:
        """Run the configured filter on measurements (T, m) or (T, B, m) of channels (m,) or (B, m) of train.h5, −1 for none.

        start (B, n*): x* at t = 0, None: zero; keep: data kept for a smoother; with "mean" and known loads the grid filter keeps
        parameters only; refuse: raise NumericalError if every run fails, instead of marking them as diverged."""
        P, mean = self.covariance, np.zeros(model.size) if start is None else start
        if self.problem.method != "grid":
            run = by_moments(self.problem, model, mean, P, self.known, measured, keep, refuse=refuse)
            return TrialRuns(run, ())
        samples = measured if measured.ndim == 3 else measured[:, None]
        runs = samples.shape[1]
        sets, starts = np.broadcast_to(channels, (runs, channels.shape[-1])), np.broadcast_to(mean, (runs, model.size))
        keep = "parameters" if keep == "mean" and not model.unknowns.inputs else keep
        grid_runs: list[GridRun | None] = []
        failure: NumericalError | None = None
        for b in range(runs):
            has = sets[b] >= 0
            alone, considered = self._with_tolerances(_of_run(model, b).of_channels(has), sets[b][has])
            try:
                known_to_it = P, self.known, samples[:, b, has], considered
                grid_runs.append(filter_on_grid(GridRecord(alone, starts[b], *known_to_it, settled=self.settled), keep))
            except NumericalError as error:
                failure = error
                grid_runs.append(None)
        if failure is not None and refuse and all(grid_run is None for grid_run in grid_runs):
            raise failure
        return TrialRuns(together(model, grid_runs, sets, len(self.known)), tuple(grid_runs))

    def smoothed(self, model: FilterModel, measured: np.ndarray, filtered: TrialRuns) -> Smoothed:
        """Smooth all samples (T, k) of the layout's channels, from a start at zero."""
        if self.problem.method != "grid":
            return smooth(model, filtered.run)
        grid_run = filtered.grid_runs[0]
        assert grid_run is not None  # a single failed run raises
        model, considered = self._with_tolerances(model, self.chosen)
        samples = self.covariance, self.known, measured, considered
        return smooth_on_grid(GridRecord(model, np.zeros(model.size), *samples, settled=self.settled), grid_run)

    def _with_tolerances(self, model: FilterModel, channels: np.ndarray) -> tuple[FilterModel, ConsideredParameters]:
        model = on_average(self.tolerated, model, channels)
        return model, build_considered(self.tolerated, model, channels)


def _of_run(model: FilterModel, b: int) -> FilterModel:
    """Model of run b."""
    if model.H.ndim != 3:
        return model
    r, quantity = model.r, model.quantity
    return replace(
        model,
        H=model.H[b],
        change=model.change.of_terms(lambda X: X[b]),
        r=r[b] if r.ndim == 2 else r,
        quantity=quantity[b] if quantity is not None and quantity.ndim == 2 else quantity,
    )


def without_truth(trial: Trial) -> Trial:
    """Remove the simulated truth, which may contain the full model, before sending a trial to other processes."""
    return replace(
        trial, truth=replace(trial.truth, motion=_removed, again=None, field=None), motion=_removed, again=None
    )


def _removed(_argument: object) -> NoReturn:
    raise AssertionError("the simulated test is available only in the process that simulated the test")


def trial_of(
    config: PlacementConfig, problem: Problem, truth: SimulatedTruth, tolerated: Tolerated, gauges: np.ndarray
) -> Trial:
    """Simulate the truth at the time step of `validate`; gauges (k,): numbers of the layout."""
    settings, channels = config.validation, problem.channels.of(gauges)
    P = initial_covariance(problem, settings.initial_std, problem.loading.moving)
    chosen = channels[channels >= 0]
    with blame("validate.duration"):
        return Trial(
            problem=problem,
            truth=truth,
            gauges=gauges,
            chosen=chosen,
            stopped=int(truth.limited[gauges].sum()),
            covariance=P,
            units=unknown_units(config),
            tolerated=tolerated,
            **_in_time(problem, truth, gauges, len(chosen), settings.time_step, settings.duration),
        )


def at_step(trial: Trial, h: float, duration: float) -> Trial:
    """Repeat a trial with the truth simulated and sampled at another time step [s]."""
    return replace(trial, **_in_time(trial.problem, trial.truth, trial.gauges, len(trial.chosen), h, duration))


def _in_time(
    problem: Problem, truth: SimulatedTruth, gauges: np.ndarray, count: int, h: float, duration: float
) -> dict[str, Any]:
    """Fields of a trial that depend on its time step; count: channels of the gauges."""
    unknowns, steps = problem.unknowns, round(duration / h)
    loading = loading_of(problem.run.settle, list(problem.run.signals.values()), h, steps)
    load = instant_values(loading.coefficients)
    history = {name: load[:, problem.columns([name])[0]] for name in unknowns.inputs}
    history |= {name: np.full(steps + 1, truth.theta[name]) for name in unknowns.parameters}
    return {
        "h": h,
        "time": h * np.arange(steps + 1),
        "known": loading.coefficients[:, :, problem.columns(problem.known)],
        "motion": truth.motion(loading),
        "history": history,
        "settled": settled_under(problem, loading),
        "again": _again(truth, gauges, count, loading),
    }


def _again(
    truth: SimulatedTruth, gauges: np.ndarray, count: int, loading: Loading
) -> Callable[[int], np.ndarray] | None:
    if truth.again is None:
        return None
    resample = truth.again

    def reading(realisation: int) -> np.ndarray:
        return resample(realisation, gauges).motion(loading)(np.arange(count))

    return reading


def sample_noise(seed: int, realisation: int, samples: int, gauges: int) -> np.ndarray:
    """Unit white noise (samples, gauges); realisation 0 is used for the layout."""
    return np.random.default_rng([seed, realisation]).standard_normal((samples, gauges))


def real_and_claimed(
    trial: Trial, model: FilterModel, mean: np.ndarray, std: np.ndarray
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Real and claimed relative error of every unknown: two mappings name → (B,).

    Parameter: |estimate − truth| and σ at the end, for drifting parameters their means over the last half. Load: RMS error and
    RMS σ after the first tenth. All relative to `Trial.scale`. mean, std (T + 1, B, n*): of x*."""
    values = physical(model, mean, std)
    real, claimed = {}, {}
    for name in trial.names:
        (value, sigma), (scale, _), truth = values[name], trial.scale(name), trial.history[name]
        if name in trial.problem.unknowns.parameters:
            late = trial.constant_from(len(value))
            real[name] = np.abs(np.mean(value[late:], axis=0) - truth[0]) / scale
            claimed[name] = np.mean(sigma[late:], axis=0) / scale
        else:
            real[name], claimed[name] = input_error(value - truth[:, None], scale), input_error(sigma, scale)
    return real, claimed


def scaled_error(trial: Trial, mean: np.ndarray) -> np.ndarray:
    """Error (T + 1, B, unknowns) of the unknowns in the states ũ and p = log(θ/guess) of x*; mean (T + 1, B, n*)."""
    return mean[:, :, trial.problem.unknowns.position(trial.problem.model)] - scaled_truth(trial)[:, None]


def scaled_truth(trial: Trial) -> np.ndarray:
    """True unknowns (T + 1, unknowns) in the states of x*."""
    unknowns = trial.problem.unknowns
    true = [trial.history[name] / unknowns.amplitude[name] for name in unknowns.inputs]
    true += [np.log(trial.history[name] / unknowns.guess[name]) for name in unknowns.parameters]
    return np.stack(true, axis=-1)
