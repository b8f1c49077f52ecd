"""One change of the filter at a time: other time steps, process noise, wrong parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from strainsight.errors import ConfigError, NumericalError
from strainsight.estimation.filter import run_filter
from strainsight.stages.case.problem import filter_model, filter_options, sample_std
from strainsight.stages.case.studies import sample_noise
from strainsight.stages.case.trial import Trial, at_step, real_and_claimed
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


def sweeps_of(trial: Trial, settings: Any, seed: int) -> tuple[Swept, ...]:
    """Every point of `validate.sweeps`, in as many processes as `validate.workers` says.

    Other time steps have measurements of their own; the noise of a sample then is what its intensity makes of it.
    Raises ConfigError for a wrong parameter that is estimated or is none.
    """
    points = _points(trial, settings.sweeps)
    if not points:
        return ()
    duration = float(settings.duration)
    at = {p.value: at_step(trial, p.value, round(duration / p.value) * p.value) for p in points if p.key == "time_step"}
    # Only what a filter needs goes to another process: a truth may hold the whole model.
    tasks = [
        (point, _task(at.get(point.value, trial) if point.key == "time_step" else trial, point, seed))
        for point in points
    ]
    if len(points) == 1 or settings.workers == 1:
        found = [_swept(point, task) for point, task in tasks]
    else:
        from joblib import Parallel, delayed

        found = Parallel(n_jobs=int(settings.workers) or -1)(delayed(_swept)(point, task) for point, task in tasks)
    return tuple(found)


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


def _task(trial: Trial, point: Point, seed: int) -> tuple[Trial, np.ndarray, float]:
    """The trial without its truth, the layout's measurement, and the factor on process noise."""
    noise = sample_noise(seed, 0, len(trial.time) - 1, len(trial.chosen))
    measured = trial.reading(trial.chosen)[1:] + noise * sample_std(trial.problem, trial.chosen, trial.h)
    bare = replace(trial, truth=replace(trial.truth, motion=_gone), motion=None)  # type: ignore[arg-type]
    return bare, measured, point.value if point.key == "process_noise" else 1.0


def _gone(_u: np.ndarray, _h: float) -> Any:
    raise AssertionError("the truth stays in the process that simulated it")


def _swept(point: Point, task: tuple[Trial, np.ndarray, float]) -> Swept:
    trial, measured, factor = task
    model = filter_model(trial.problem, trial.chosen, trial.h)
    model = replace(model, Q=factor * model.Q)
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
