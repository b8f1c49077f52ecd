"""One change of the filter at a time: other time steps, process noise, wrong parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.validation import Sweeps, Validate
from strainsight.errors import ConfigError, NumericalError
from strainsight.experiment.structure.problem import filter_model
from strainsight.experiment.structure.trial import Trial, at_step, real_and_claimed, without_truth
from strainsight.parallel.sweep import Sweep, serial
from strainsight.records.validated import SweepTable
from strainsight.runner.output import Table


@dataclass(frozen=True)
class Point:
    """One change: key "time_step", "process_noise" or the name of a parameter; its value [s] or factor [-]."""

    key: str
    value: float


def sweeps_of(trial: Trial, settings: Validate, seed: int, sweep: Sweep = serial) -> SweepTable | None:
    """Every point of `validate.sweeps`, None without one; errors are NaN where the filter diverged.

    Other time steps have measurements of their own; the noise of a sample then is what its intensity makes of it.
    Raises ConfigError for a wrong parameter that is estimated or is none.
    """
    points = _points(trial, settings.sweeps)
    if not points:
        return None
    duration = settings.duration
    at = {p.value: at_step(trial, p.value, round(duration / p.value) * p.value) for p in points if p.key == "time_step"}
    own = _Task(None, trial.measured(seed)[0])
    tasks = [
        (
            point,
            _Task(without_truth(at[point.value]), at[point.value].measured(seed)[0])
            if point.key == "time_step"
            else own,
        )
        for point in points
    ]
    found = sweep(_swept, tasks, without_truth(trial))
    return SweepTable(
        key=tuple(point.key for point in points),
        value=np.array([point.value for point in points]),
        error={name: np.array([real[name] for real, _ in found]) for name in trial.names},
        std={name: np.array([claimed[name] for _, claimed in found]) for name in trial.names},
    )


def _points(trial: Trial, sweeps: Sweeps) -> list[Point]:
    points = [Point("time_step", h) for h in sweeps.time_steps]
    points += [Point("process_noise", factor) for factor in sweeps.process_noise]
    for name, factors in sweeps.wrong_parameters.items():
        key = f"validate.sweeps.wrong_parameters.{name}"
        if name not in trial.problem.model.parameters:
            known = ", ".join(trial.problem.model.parameters) or "none"
            raise ConfigError(f"no parameter is named '{name}'", key=key, remedy=f"parameters: {known}")
        if name in trial.problem.unknowns.parameters:
            raise ConfigError(
                f"'{name}' is estimated, so the filter takes no value of it for known",
                key=key,
                remedy="name a parameter that is not estimated",
            )
        points += [Point(name, factor) for factor in factors]
    return points


@dataclass(frozen=True)
class _Task:
    """The trial at another time step, None: the layout's own; measured (T, k) by the layout."""

    trial: Trial | None
    measured: np.ndarray


def _swept(own: Trial, changed: tuple[Point, _Task]) -> tuple[dict[str, float], dict[str, float]]:
    """Real and claimed error of every unknown."""
    point, task = changed
    trial, measured = task.trial or own, task.measured
    model = filter_model(trial.problem, trial.chosen, trial.h)
    if point.key == "process_noise":
        model = replace(model, Q=point.value * model.Q)
    if point.key in model.fixed:
        truth = trial.truth.theta[point.key]
        model = replace(model, fixed={**model.fixed, point.key: point.value * truth})
    try:
        run = trial.filtered(model, trial.chosen, measured).run
    except NumericalError:
        diverged = dict.fromkeys(trial.names, float("nan"))
        return diverged, diverged
    real, claimed = real_and_claimed(trial, model, run.mean, run.std)
    return {n: float(v[0]) for n, v in real.items()}, {n: float(v[0]) for n, v in claimed.items()}


def sweep_table(swept: SweepTable) -> Table:
    """Real beside claimed error at every point."""
    words = {"time_step": "time step {:g} s", "process_noise": "process noise × {:g}"}
    rows = tuple(
        (
            words.get(key, f"{key} taken {{:g}} of the truth").format(value),
            *(f"{100 * swept.error[n][i]:.3g} % (claims {100 * swept.std[n][i]:.2g} %)" for n in swept.error),
        )
        for i, (key, value) in enumerate(zip(swept.key, swept.value, strict=True))
    )
    columns = ("change", *(f"error of {name}" for name in swept.error))
    return Table("one change of the filter at a time", columns, rows)
