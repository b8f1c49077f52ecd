"""A validation set up: the truth, what every candidate would read, and what the filter is told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from strainsight.errors import blame
from strainsight.estimation.metrics import input_error, parameter_error
from strainsight.estimation.model import FilterModel, physical
from strainsight.signals.histories import hold_coefficients, step_means
from strainsight.stages.case.problem import Problem, initial_covariance, problem_of
from strainsight.stages.case.truth import Truth, truth_of
from strainsight.stages.records.gauges import candidates_from
from strainsight.stages.records.mesh import mesh_from
from strainsight.workflow.stage import Context


@dataclass(frozen=True)
class Trial:
    """problem; h [s] and time (T + 1,) [s] of the validation; known (T, HOLD, n_known) [N] what the filter is told;
    truth and strain (T + 1, candidates) of every candidate, misplaced as it is glued; history: unknown's name →
    (T + 1,) [SI], of an input the mean over the step that follows, which is what its state stands for;
    chosen (k,) candidates of the layout; covariance P₀ (n*, n*); units: unknown's name → unit."""

    problem: Problem
    h: float
    time: np.ndarray
    known: np.ndarray
    truth: Truth
    strain: np.ndarray
    history: Mapping[str, np.ndarray]
    chosen: np.ndarray
    covariance: np.ndarray
    units: Mapping[str, str]

    @property
    def names(self) -> tuple[str, ...]:
        """The unknowns."""
        return self.problem.unknowns.names


def trial_of(context: Context) -> Trial:
    """Simulate the truth of the config and read it at every candidate."""
    config, problem = context.config, problem_of(context)
    settings, names = config.validate, problem.unknowns.names
    h = float(settings.time_step)
    steps = round(settings.duration / h)
    with blame("validate.duration"):
        held = hold_coefficients(list(problem.signals.values()), 0.0, h, steps)
    mesh = mesh_from(context.upstream["import"])
    truth = truth_of(context, problem, mesh, held, h)
    with blame("validate.truth.gauge_offset"):
        strain = truth.strain(mesh, candidates_from(context.upstream["train"]), context.seed)
    load = step_means(held)
    inputs, place = problem.unknowns.inputs, context.upstream["place"]
    return Trial(
        problem=problem,
        h=h,
        time=h * np.arange(steps + 1),
        known=held[:, :, problem.columns(problem.known)],
        truth=truth,
        strain=strain,
        history={name: load[:, problem.columns([name])[0]] for name in inputs}
        | {name: np.full(steps + 1, truth.theta[name]) for name in problem.unknowns.parameters},
        chosen=place["/pool/candidate"][place["/selected/final/gauge"]],
        covariance=initial_covariance(problem, {name: float(settings.initial_std[name]) for name in names}),
        units={name: "N" if name in inputs else UNITS[config.parameters[name].property] for name in names},
    )


UNITS = {"youngs_modulus": "Pa", "density": "kg/m^3"}


def real_and_claimed(
    trial: Trial, model: FilterModel, mean: np.ndarray, std: np.ndarray
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Real and claimed error of every unknown for each run: two mappings name → (B,), relative.

    A parameter: |mean over the last half − truth| and mean σ there, both over the truth. An input: RMS error and RMS σ after
    the first tenth, both over the RMS of the load vector. mean, std (T + 1, B, n*) of x*.
    """
    values = physical(model, mean, std)
    inputs = trial.problem.unknowns.inputs
    real, claimed = {}, {}
    if inputs:
        load = np.stack([trial.history[name] for name in inputs], axis=-1)
        estimate, sigma = (np.stack([values[name][i] for name in inputs], axis=-1) for i in (0, 1))
        # σ is measured by the same rule: an estimate that is off by σ at every instant.
        off, claim = input_error(estimate, load), input_error(load[:, None] + sigma, load)
        for i, name in enumerate(inputs):
            real[name], claimed[name] = off[:, i], claim[:, i]
    for name in trial.problem.unknowns.parameters:
        value, sigma = values[name]
        real[name] = parameter_error(value, trial.truth.theta[name])
        claimed[name] = np.mean(sigma[len(sigma) // 2 :], axis=0) / trial.truth.theta[name]
    return real, claimed


def scaled_error(trial: Trial, mean: np.ndarray) -> np.ndarray:
    """Error of the unknowns in the states of x*, ũ and p = log(θ/guess): mean (T + 1, B, n*) → (T + 1, B, unknowns)."""
    unknowns = trial.problem.unknowns
    true = [trial.history[name] / unknowns.amplitude[name] for name in unknowns.inputs]
    true += [np.log(trial.history[name] / unknowns.guess[name]) for name in unknowns.parameters]
    return mean[:, :, 2 * trial.problem.model.size :] - np.stack(true, axis=-1)[:, None]
