"""A validation set up: the truth and its motion, and what the filter is given."""

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
    """run: B runs of a filter; grid_runs: what each run's grid filter found, none of another filter, None for one that failed."""

    run: FilterRun
    grid_runs: tuple[GridRun | None, ...]


@dataclass(frozen=True)
class Trial:
    """problem; h [s] and time (T + 1,) [s] of the validation; known (T, HOLD, n_known) [N], loads that the filter is given;
    truth and its motion; history: unknown's name → (T + 1,) [SI]; gauges: numbers of those of the layout, chosen (k,) their
    channels, stopped: how many of them a sharp edge has kept from being misplaced as far as stated; covariance P₀ (n*, n*);
    settled: how the motion of a grid filter begins where that is known;
    units: unknown's name → unit; tolerated: what σ allows of the channels that are filtered;
    again: number of a realisation → what the layout reads without noise (T + 1, k) where the truth is drawn anew, None where
    nothing is drawn."""

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
        """The unknowns."""
        return self.problem.unknowns.names

    def constant_from(self, instants: int) -> int:
        """The instant from which a parameter's estimate is averaged: the last, as all samples are in that of a constant."""
        return instants // 2 if self.problem.drifting else instants - 1

    def scale(self, name: str) -> tuple[float, bool]:
        """What errors of an unknown are relative to [SI]: the true value of a parameter, a load's own RMS, or its amplitude
        where it is zero throughout; and whether it is."""
        if name in self.problem.unknowns.parameters:
            return self.truth.theta[name], False
        return load_scale(self.history[name], self.problem.unknowns.amplitude[name])

    def reading(self, channels: np.ndarray) -> np.ndarray:
        """What channels (...) read without noise (T + 1, ...) [unit of the channel], NaN where there is none (−1)."""
        needed, place = np.unique(channels, return_inverse=True)
        read = self.motion(needed)[:, place.reshape(channels.shape)]
        return np.where(channels >= 0, read, np.nan)

    def measured(self, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """What the layout reads with noise, and without (T, k)."""
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
        """The filter of the config on measurements (T, m) or (T, B, m) of channels (m,) or (B, m) of train.h5, −1 for none.

        start (B, n*) of x* at t = 0, None: zero; keep: whether what a smoother needs is kept; with "mean" a grid filter under
        known loads has its parameters alone; refuse: raise NumericalError where every run fails, and not mark them lost."""
        P, mean = self.covariance, np.zeros(model.size) if start is None else start
        if self.problem.method != "bank":
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
        """What all samples (T, k) of the layout's channels say of every instant, from a start at zero."""
        if self.problem.method != "bank":
            return smooth(model, filtered.run)
        grid_run = filtered.grid_runs[0]
        assert grid_run is not None  # a grid filter that fails alone is refused
        model, considered = self._with_tolerances(model, self.chosen)
        samples = self.covariance, self.known, measured, considered
        return smooth_on_grid(GridRecord(model, np.zeros(model.size), *samples, settled=self.settled), grid_run)

    def _with_tolerances(self, model: FilterModel, channels: np.ndarray) -> tuple[FilterModel, ConsideredParameters]:
        model = on_average(self.tolerated, model, channels)
        return model, build_considered(self.tolerated, model, channels)


def _of_run(model: FilterModel, b: int) -> FilterModel:
    """The model of one run."""
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
    """What a filter needs, and its errors: a truth may hold the whole model, which is not sent to other processes."""
    return replace(trial, truth=replace(trial.truth, motion=_gone, again=None, field=None), motion=_gone, again=None)


def _gone(_of: object) -> NoReturn:
    raise AssertionError("the truth stays in the process that simulated it")


def trial_of(
    config: PlacementConfig, problem: Problem, truth: SimulatedTruth, tolerated: Tolerated, gauges: np.ndarray
) -> Trial:
    """Simulate the truth at the time step of `validate`; gauges (k,): numbers of the layout's gauges."""
    settings, channels = config.validation, problem.channels.of(gauges)
    P = initial_covariance(problem, settings.initial_std, problem.loading.moving)
    chosen = channels[channels >= 0]
    with blame("validate.duration"):
        return Trial(
            problem=problem,
            truth=truth,
            gauges=gauges,
            chosen=chosen,
            stopped=int(truth.held[gauges].sum()),
            covariance=P,
            units=unknown_units(config),
            tolerated=tolerated,
            **_in_time(problem, truth, gauges, len(chosen), settings.time_step, settings.duration),
        )


def at_step(trial: Trial, h: float, duration: float) -> Trial:
    """The same trial with the truth simulated, and sampled, at another time step [s]."""
    return replace(trial, **_in_time(trial.problem, trial.truth, trial.gauges, len(trial.chosen), h, duration))


def _in_time(
    problem: Problem, truth: SimulatedTruth, gauges: np.ndarray, count: int, h: float, duration: float
) -> dict[str, Any]:
    """Fields of a trial that its time step decides; count: channels of the gauges."""
    unknowns, steps = problem.unknowns, round(duration / h)
    loading = loading_of(problem.run.settle, list(problem.run.signals.values()), h, steps)
    load = instant_values(loading.held)
    history = {name: load[:, problem.columns([name])[0]] for name in unknowns.inputs}
    history |= {name: np.full(steps + 1, truth.theta[name]) for name in unknowns.parameters}
    return {
        "h": h,
        "time": h * np.arange(steps + 1),
        "known": loading.held[:, :, problem.columns(problem.known)],
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
    drawn = truth.again

    def reading(realisation: int) -> np.ndarray:
        return drawn(realisation, gauges).motion(loading)(np.arange(count))

    return reading


def sample_noise(seed: int, realisation: int, samples: int, gauges: int) -> np.ndarray:
    """Unit white noise (samples, gauges); realisation 0 is that of the layout's own measurement."""
    return np.random.default_rng([seed, realisation]).standard_normal((samples, gauges))


def real_and_claimed(
    trial: Trial, model: FilterModel, mean: np.ndarray, std: np.ndarray
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Real and claimed error of every unknown for each run: two mappings name → (B,), relative.

    A parameter: |estimate at the end − truth| and σ there; of a filter that lets it drift, their means over the last half.
    An input: RMS error and RMS σ after the first tenth. All over the unknown's own `Trial.scale`.
    mean, std (T + 1, B, n*) of x*.
    """
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
    """Error of the unknowns in the states of x*, ũ and p = log(θ/guess): mean (T + 1, B, n*) → (T + 1, B, unknowns)."""
    return mean[:, :, trial.problem.unknowns.position(trial.problem.model)] - scaled_truth(trial)[:, None]


def scaled_truth(trial: Trial) -> np.ndarray:
    """The unknowns as they are (T + 1, unknowns), in the states of x*."""
    unknowns = trial.problem.unknowns
    true = [trial.history[name] / unknowns.amplitude[name] for name in unknowns.inputs]
    true += [np.log(trial.history[name] / unknowns.guess[name]) for name in unknowns.parameters]
    return np.stack(true, axis=-1)
