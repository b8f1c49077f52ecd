"""Filters on measurements: parameter grid filter, sigma-point filter or extended filter."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.errors import NumericalError
from strainsight.estimation.conditional import none_considered
from strainsight.estimation.decision import out_of_range
from strainsight.estimation.filter import run_filter
from strainsight.estimation.grid_filter import GridRun, filter_on_grid
from strainsight.estimation.mixture import Posterior, marginal
from strainsight.estimation.model import FilterModel, physical
from strainsight.estimation.record import GridRecord
from strainsight.estimation.run import FilterRun, Keep
from strainsight.estimation.smoother import Smoothed
from strainsight.experiment.filters_compared import filters_compared
from strainsight.experiment.structure.problem import Method, Problem, exactly_damped
from strainsight.experiment.structure.references import unknown_units
from strainsight.records.estimated import EXTENDED, GRID_FILTER, SIGMA_POINT, Compared

IDENTIFIED = 0.5
"""Largest ratio of final and initial σ of an identified parameter."""


def by_moments(
    problem: Problem,
    model: FilterModel,
    start: np.ndarray,
    covariance: np.ndarray,
    known: np.ndarray,
    measured: np.ndarray,
    keep: Keep = "mean",
    biased: np.ndarray | None = None,
    refuse: bool = True,
    method: Method | None = None,
) -> FilterRun:
    """Run the sigma-point or the extended filter; biased: see `run_filter`; method: default from the config."""
    by_points = (method or problem.method) == "sigma-point"
    options = {"by_points": True} if by_points else {"iterations": problem.iterations}
    return run_filter(
        model, start, covariance, known, measured, keep, form=problem.form, biased=biased, refuse=refuse, **options
    )


def together(model: FilterModel, grid_runs: Sequence[GridRun | None], channels: np.ndarray, steps: int) -> FilterRun:
    """Combine grid filter runs, with NaN for failed runs and missing channels; channels (B, m), −1 for none."""
    if len(grid_runs) == 1 and grid_runs[0] is not None:
        return grid_runs[0].run
    (runs, m), n, u, has = channels.shape, model.size, len(model.position), channels >= 0
    by_state = {name: np.full((steps + 1, runs, n), np.nan) for name in ("mean", "std")}
    by_channel = {
        name: np.full((steps, runs, m), np.nan) for name in ("gauge_mean", "gauge_std", "innovation", "whitened")
    }
    unknown = np.full((steps + 1, runs, u, u), np.nan)
    fit, last = np.full(runs, -np.inf), np.full((runs, n, n), np.nan)
    for b, grid_run in enumerate(grid_runs):
        if grid_run is None:
            continue
        for name, values in by_state.items():
            values[:, b] = getattr(grid_run.run, name)[:, 0]
        for name, values in by_channel.items():
            values[:, b, has[b]] = getattr(grid_run.run, name)[:, 0]
        unknown[:, b], fit[b], last[b] = (
            grid_run.run.unknown_covariance[:, 0],
            grid_run.run.log_likelihood[0],
            grid_run.run.last[0],
        )
    return FilterRun(
        time=model.h * np.arange(steps + 1),
        **by_state,
        **by_channel,
        unknown_covariance=unknown,
        nis=np.nansum(by_channel["whitened"] ** 2, axis=2),
        lost=np.where([grid_run is None for grid_run in grid_runs], 1, -1),
        log_likelihood=fit,
        last=last,
    )


def histories(model: FilterModel, run: FilterRun, smoothed: Smoothed) -> dict[str, dict[str, np.ndarray]]:
    """Histories of the unknowns of the first run from filter and smoother, named as in `UnknownHistories`."""
    filtered, later = (physical(model, by.mean[:, 0], by.std[:, 0]) for by in (run, smoothed))
    return {
        "estimate": {name: value for name, (value, _) in filtered.items()},
        "std": {name: std for name, (_, std) in filtered.items()},
        "smoothed": {name: value for name, (value, _) in later.items()},
        "smoothed_std": {name: std for name, (_, std) in later.items()},
    }


def posteriors_of(problem: Problem, covariance: np.ndarray, grid_run: GridRun | None) -> dict[str, Posterior]:
    """Posterior of every parameter from the parameter grid filter, else empty; covariance (n*, n*) at t = 0."""
    if grid_run is None or grid_run.step is None:
        return {}
    names, guess = problem.unknowns.parameters, problem.unknowns.guess
    first = problem.unknowns.size(problem.model) - len(names)
    posteriors = {}
    for i, name in enumerate(names):
        prior = 0.0, float(np.sqrt(covariance[first + i, first + i]))
        of_log = marginal(grid_run.point[:, i], grid_run.weight, float(grid_run.step[i]), prior)
        value, peak = guess[name] * np.exp(of_log.value), guess[name] * np.exp(of_log.peak)
        posteriors[name] = replace(of_log, value=value, peak=peak)
    return posteriors


def posterior_numbers(posterior: Mapping[str, Posterior]) -> dict[str, float | bool | int]:
    """Summary numbers of the posteriors."""
    numbers: dict[str, float | bool | int] = {}
    for name, one in posterior.items():
        numbers |= {f"left.{name}": one.left, f"identified.{name}": one.left <= IDENTIFIED}
        numbers[f"peaks.{name}"] = len(one.peak)
    return numbers


def posterior_doubts(posterior: Mapping[str, Posterior], units: Mapping[str, str]) -> list[str]:
    """Warnings about parameters that are weakly identified or have several likely values."""
    words = []
    for name, one in posterior.items():
        if one.left > IDENTIFIED:
            words.append(f"{name} is not identified: its σ is still {100 * one.left:.0f} % of the initial σ")
        if len(one.peak) > 1:
            places = ", ".join(
                f"{peak:.4g} {units[name]} (probability {100 * share:.0f} %)"
                for peak, share in zip(one.peak, one.share, strict=True)
            )
            words.append(
                f"the measurements allow {len(one.peak)} values of {name}, namely {places}; σ of {name} covers all of them"
            )
    return words


def compared(problem: Problem, record: GridRecord) -> Compared | None:
    """Final parameters from the grid filter and the approximate filters, with `expected_ratio`.

    All run without tolerances and with the same process noise. Filters that diverge are NaN. None without parameters."""
    names, at = record.model.unknowns.parameters, record.model.parameter_states
    if not names:
        return None
    model = exactly_damped(problem, record.model)
    record = replace(record, model=model, considered=none_considered(model), settled=None)
    data, biased = (model, record.mean, record.covariance, record.known, record.samples), record.biased
    filters: dict[str, Callable[[], FilterRun]] = {
        GRID_FILTER: lambda: filter_on_grid(record, "parameters").run,
        SIGMA_POINT: lambda: by_moments(problem, *data, biased=biased, method="sigma-point"),
        EXTENDED: lambda: by_moments(problem, *data, biased=biased, method="extended"),
    }
    mean, std = np.full((2, len(filters), model.size), np.nan)
    for i, run_of in enumerate(filters.values()):
        with suppress(NumericalError):
            run = run_of()
            mean[i], std[i] = run.mean[-1, 0, : model.size], run.std[-1, 0, : model.size]
    values, ends = physical(model, mean, std), np.stack([mean[:, at], std[:, at]], axis=1)
    value, sigma = (np.stack([values[name][i] for name in names], axis=-1) for i in range(2))
    return filters_compared(tuple(filters), names, ends, value, sigma)


def out_of_ranges(config: PlacementConfig, problem: Problem, values: Mapping[str, float]) -> dict[str, str]:
    """Parameter → sentence for values [SI] outside `parameters.*.range`, where the reduced model is not valid.

    A damping factor is exact everywhere and is omitted."""
    free = [name for name in problem.unknowns.parameters if name != problem.model.damping.parameter]
    ranges = {name: config.parameters[name].range for name in free}
    return out_of_range(values, ranges, unknown_units(config), "rom")


def ranges_in_words(parameters: Mapping[str, str]) -> str:
    """Keys of the ranges of parameters."""
    return " and ".join(f"parameters.{name}.range" for name in parameters)


EXCLUDED = 5.0
"""Two estimates disagree if they differ by more than this times their combined σ."""
Values = Mapping[str, tuple[float, float]]
"""Parameter → value and σ [SI]."""


def last_values(model: FilterModel, run: FilterRun | Smoothed) -> Values:
    """Final values of the unknowns of the first run."""
    values = physical(model, run.mean[-1, 0], run.std[-1, 0])
    return {name: (float(value), float(std)) for name, (value, std) in values.items()}


def by_grid(comparison: Compared | None) -> dict[str, tuple[float, float]]:
    """Results of the grid filter in a comparison; empty without one."""
    if comparison is None:
        return {}
    return {name: (float(value[0]), float(comparison.std[name][0])) for name, value in comparison.estimate.items()}


def excluded(estimate: Values, other: Values) -> str:
    """Describe parameters with two estimates that disagree; empty without any."""
    words = []
    for name, (b, t) in other.items():
        a, s = estimate[name]
        if abs(np.log(a / b)) > EXCLUDED * np.hypot(s / a, t / b):
            words.append(f"{name} = {a:.4g} ± {100 * s / a:.2g} % or {b:.4g} ± {100 * t / b:.2g} %")
    return "; ".join(words)


def excluded_in_words(words: str, settled: bool, key: str) -> str:
    """Reason to withhold σ, from `excluded`; settled: whether the estimate starts settled (`key`)."""
    by = (
        f"first estimate: periodic initial motion, second: unknown initial motion; check {key}"
        if settled
        else "both by the same model; report a bug"
    )
    return f"two estimates of the same parameters disagree: {words} ({by})" if words else ""
