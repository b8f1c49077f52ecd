"""A validation set up: the truth and its motion, and what the filter is told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from strainsight.cases.structure.problem import Problem, initial_covariance, problem_of
from strainsight.cases.structure.truth import Motion, ReadMotion, Truth, truth_of
from strainsight.errors import blame
from strainsight.estimation.metrics import input_error, load_scale, parameter_error
from strainsight.estimation.model import FilterModel, physical
from strainsight.records.mesh import mesh_from
from strainsight.records.record import read
from strainsight.records.reduced import Reduced
from strainsight.records.training import Screened, Training
from strainsight.signals.histories import hold_coefficients, instant_values
from strainsight.workflow.stage import Context


@dataclass(frozen=True)
class Trial:
    """problem; h [s] and time (T + 1,) [s] of the validation; known (T, HOLD, n_known) [N] what the filter is told;
    truth and its motion; history: unknown's name → (T + 1,) [SI]; chosen (k,) channels of the layout, stopped: how many of
    its gauges a sharp edge has kept from being misplaced as far as asked; covariance P₀ (n*, n*); units: unknown's name →
    unit."""

    problem: Problem
    h: float
    time: np.ndarray
    known: np.ndarray
    truth: Truth
    motion: Motion
    history: Mapping[str, np.ndarray]
    chosen: np.ndarray
    stopped: int
    covariance: np.ndarray
    units: Mapping[str, str]

    @property
    def names(self) -> tuple[str, ...]:
        """The unknowns."""
        return self.problem.unknowns.names

    def scale(self, name: str) -> tuple[float, bool]:
        """What errors of an unknown are relative to [SI]: the true value of a parameter, a load's own RMS, or its amplitude
        where it is zero throughout; and whether it is."""
        if name in self.problem.unknowns.parameters:
            return self.truth.theta[name], False
        return load_scale(self.history[name], self.problem.unknowns.amplitude[name])

    def reading(self, channels: np.ndarray) -> np.ndarray:
        """What channels (...) read without noise (T + 1, ...) [unit of the channel], NaN where there is none (−1)."""
        needed, place = np.unique(channels, return_inverse=True)
        read = self.motion.reading(needed)[:, place.reshape(channels.shape)]
        return np.where(channels >= 0, read, np.nan)


def without_truth(trial: Trial) -> Trial:
    """What a filter needs, and its errors: a truth may hold the whole model, which is not sent to other processes."""
    gone = ReadMotion(np.zeros((0, 0)))
    return replace(trial, truth=replace(trial.truth, motion=_gone), motion=gone)


def _gone(_u: np.ndarray, _h: float) -> Motion:
    raise AssertionError("the truth stays in the process that simulated it")


def trial_of(context: Context) -> Trial:
    """Simulate the truth of the config at the time step of `validate`."""
    config = context.config
    reduced, training = read(Reduced, context.upstream["rom"]), read(Training, context.upstream["train"])
    problem = problem_of(config, context.files, reduced, training, read(Screened, context.upstream["screen"]))
    settings, names = config.validation, problem.unknowns.names
    truth = truth_of(context, problem, mesh_from(context.upstream["import"]))
    place = context.upstream["place"]
    chosen = place["/selected/final/channel"]
    own = np.zeros(0)
    trial = Trial(
        problem=problem,
        h=0.0,
        time=own,
        known=own,
        truth=truth,
        motion=ReadMotion(own),
        history={},
        chosen=chosen[chosen >= 0],
        stopped=int(truth.held[place["/selected/final/number"]].sum()),
        covariance=initial_covariance(problem, {name: float(settings.initial_std[name]) for name in names}),
        units={
            name: "N" if name in problem.unknowns.inputs else PARAMETER_UNITS[config.parameters[name].property]
            for name in names
        },
    )
    with blame("validate.duration"):
        return at_step(trial, float(settings.time_step), float(settings.duration))


def at_step(trial: Trial, h: float, duration: float) -> Trial:
    """The same trial with the truth simulated, and sampled, at another time step [s]."""
    problem, unknowns = trial.problem, trial.problem.unknowns
    steps = round(duration / h)
    held = hold_coefficients(list(problem.signals.values()), 0.0, h, steps)
    load = instant_values(held)
    history = {name: load[:, problem.columns([name])[0]] for name in unknowns.inputs}
    history |= {name: np.full(steps + 1, trial.truth.theta[name]) for name in unknowns.parameters}
    return replace(
        trial,
        h=h,
        time=h * np.arange(steps + 1),
        known=held[:, :, problem.columns(problem.known)],
        motion=trial.truth.motion(held, h),
        history=history,
    )


PARAMETER_UNITS = {"youngs_modulus": "Pa", "density": "kg/m^3"}


def real_and_claimed(
    trial: Trial, model: FilterModel, mean: np.ndarray, std: np.ndarray
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Real and claimed error of every unknown for each run: two mappings name → (B,), relative.

    A parameter: |mean over the last half − truth| and mean σ there. An input: RMS error and RMS σ after the first tenth.
    All over the unknown's own `Trial.scale`. mean, std (T + 1, B, n*) of x*.
    """
    values = physical(model, mean, std)
    real, claimed = {}, {}
    for name in trial.names:
        (value, sigma), (scale, _), truth = values[name], trial.scale(name), trial.history[name]
        if name in trial.problem.unknowns.parameters:
            real[name] = parameter_error(value, truth[0])
            claimed[name] = np.mean(sigma[len(sigma) // 2 :], axis=0) / scale
        else:
            real[name], claimed[name] = input_error(value - truth[:, None], scale), input_error(sigma, scale)
    return real, claimed


def scaled_error(trial: Trial, mean: np.ndarray) -> np.ndarray:
    """Error of the unknowns in the states of x*, ũ and p = log(θ/guess): mean (T + 1, B, n*) → (T + 1, B, unknowns)."""
    unknowns = trial.problem.unknowns
    true = [trial.history[name] / unknowns.amplitude[name] for name in unknowns.inputs]
    true += [np.log(trial.history[name] / unknowns.guess[name]) for name in unknowns.parameters]
    return mean[:, :, unknowns.position(trial.problem.model)] - np.stack(true, axis=-1)[:, None]
