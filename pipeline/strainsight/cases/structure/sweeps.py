"""One change of the filter at a time: other time steps, process noise, wrong parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from strainsight.cases.structure.problem import filter_model, filter_options, sample_std
from strainsight.cases.structure.studies import sample_noise
from strainsight.cases.structure.trial import Trial, at_step, real_and_claimed, without_truth
from strainsight.errors import ConfigError, NumericalError
from strainsight.estimation.filter import run_filter
from strainsight.sweep.sweep import Sweep, serial
from strainsight.workflow.output import Dataset, Table


@dataclass(frozen=True)
class Point:
    """One change: key "time_step", "process_noise" or the name of a parameter; its value [s] or factor [-]."""

    key: str
    value: float


@dataclass(frozen=True)
class Swept:
    """A point and the real and claimed errors of every unknown there, NaN where the filter was lost."""

    point: Point
    real: dict[str, float]
    claimed: dict[str, float]


def sweeps_of(trial: Trial, settings: Any, seed: int, sweep: Sweep = serial) -> tuple[Swept, ...]:
    """Every point of `validate.sweeps`.

    Other time steps have measurements of their own; the noise of a sample then is what its intensity makes of it.
    Raises ConfigError for a wrong parameter that is estimated or is none.
    """
    points = _points(trial, settings.sweeps)
    if not points:
        return ()
    duration = float(settings.duration)
    at = {p.value: at_step(trial, p.value, round(duration / p.value) * p.value) for p in points if p.key == "time_step"}
    own = _Task(None, _measured(trial, seed))
    tasks = [
        (
            point,
            _Task(without_truth(at[point.value]), _measured(at[point.value], seed))
            if point.key == "time_step"
            else own,
        )
        for point in points
    ]
    return tuple(sweep(_swept, tasks, without_truth(trial)))


def _points(trial: Trial, sweeps: Any) -> list[Point]:
    points = [Point("time_step", float(h)) for h in sweeps.time_steps]
    points += [Point("process_noise", float(factor)) for factor in sweeps.process_noise]
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
        points += [Point(name, float(factor)) for factor in factors]
    return points


@dataclass(frozen=True)
class _Task:
    """The trial at another time step, None: the layout's own; measured (T, k) by the layout."""

    trial: Trial | None
    measured: np.ndarray


def _measured(trial: Trial, seed: int) -> np.ndarray:
    """By the layout, with noise (T, k)."""
    noise = sample_noise(seed, 0, len(trial.time) - 1, len(trial.chosen))
    return np.asarray(trial.reading(trial.chosen)[1:] + noise * sample_std(trial.problem, trial.chosen, trial.h))


def _swept(own: Trial, changed: tuple[Point, _Task]) -> Swept:
    point, task = changed
    trial, measured = task.trial or own, task.measured
    model = filter_model(trial.problem, trial.chosen, trial.h)
    if point.key == "process_noise":
        model = replace(model, Q=point.value * model.Q)
    if point.key in model.fixed:
        truth = trial.truth.theta[point.key]
        model = replace(model, fixed={**model.fixed, point.key: point.value * truth})
    try:
        run = run_filter(
            model, np.zeros(model.size), trial.covariance, trial.known, measured, **filter_options(trial.problem)
        )
    except NumericalError:
        lost = dict.fromkeys(trial.names, float("nan"))
        return Swept(point, lost, lost)
    real, claimed = real_and_claimed(trial, model, run.mean, run.std)
    return Swept(point, {n: float(v[0]) for n, v in real.items()}, {n: float(v[0]) for n, v in claimed.items()})


def sweep_datasets(swept: Sequence[Swept], names: Sequence[str]) -> dict[str, Dataset]:
    """Points and errors of all sweeps."""
    if not swept:
        return {}
    scales = ("/sweep/key",)
    return {
        "/sweep/key": Dataset(
            np.array([s.point.key for s in swept], dtype=np.str_), "1", "time_step, process_noise, or a wrong parameter"
        ),
        "/sweep/value": Dataset(
            np.array([s.point.value for s in swept]), "1", "the time step [s], or the factor", scales
        ),
        **{
            f"/sweep/error/{name}": Dataset(
                np.array([s.real[name] for s in swept]), "1", f"real error of {name}", scales
            )
            for name in names
        },
        **{
            f"/sweep/std/{name}": Dataset(
                np.array([s.claimed[name] for s in swept]), "1", f"claimed error of {name}", scales
            )
            for name in names
        },
    }


def sweep_table(swept: Sequence[Swept], names: Sequence[str]) -> Table:
    """Real beside claimed error at every point."""
    words = {"time_step": "time step {:g} s", "process_noise": "process noise × {:g}"}
    rows = tuple(
        (
            words.get(s.point.key, f"{s.point.key} taken {{:g}} of the truth").format(s.point.value),
            *(f"{100 * s.real[n]:.3g} % (claims {100 * s.claimed[n]:.2g} %)" for n in names),
        )
        for s in swept
    )
    return Table("one change of the filter at a time", ("change", *(f"error of {name}" for name in names)), rows)
