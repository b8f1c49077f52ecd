"""The filter of the config on measurements: a grid filter over constant parameters, the sigma-point or the extended filter."""

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
"""Share of its initial σ that the samples may leave of a parameter that they identify."""


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
    """The sigma-point or the extended filter, which carry mean and covariance; biased: as of `run_filter`; method: by default
    that of the config."""
    by_points = (method or problem.method) == "sigma-point"
    options = {"by_points": True} if by_points else {"iterations": problem.iterations}
    return run_filter(
        model, start, covariance, known, measured, keep, form=problem.form, biased=biased, refuse=refuse, **options
    )


def together(model: FilterModel, grid_runs: Sequence[GridRun | None], channels: np.ndarray, steps: int) -> FilterRun:
    """Runs of many grid filters as one, NaN where one failed or has no channel (channels (B, m), −1 for none)."""
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
    """The unknowns of the first run in time, by filter and smoother, as `UnknownHistories` names them."""
    filtered, later = (physical(model, by.mean[:, 0], by.std[:, 0]) for by in (run, smoothed))
    return {
        "estimate": {name: value for name, (value, _) in filtered.items()},
        "std": {name: std for name, (_, std) in filtered.items()},
        "smoothed": {name: value for name, (value, _) in later.items()},
        "smoothed_std": {name: std for name, (_, std) in later.items()},
    }


def posteriors_of(problem: Problem, covariance: np.ndarray, grid_run: GridRun | None) -> dict[str, Posterior]:
    """Of every parameter of a grid filter; covariance (n*, n*) at t = 0. None by another filter, nor by columns, of which no
    more than mean and covariance is known."""
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
    """Every number by its name."""
    numbers: dict[str, float | bool | int] = {}
    for name, one in posterior.items():
        numbers |= {f"left.{name}": one.left, f"identified.{name}": one.left <= IDENTIFIED}
        numbers[f"peaks.{name}"] = len(one.peak)
    return numbers


def posterior_doubts(posterior: Mapping[str, Posterior], units: Mapping[str, str]) -> list[str]:
    """That a parameter is hardly measured, or that several values explain the samples."""
    words = []
    for name, one in posterior.items():
        if one.left > IDENTIFIED:
            words.append(f"{name} is not identified: the measurements leave {100 * one.left:.0f} % of its initial σ")
        if len(one.peak) > 1:
            places = ", ".join(
                f"{peak:.4g} {units[name]} ({100 * share:.0f} %)"
                for peak, share in zip(one.peak, one.share, strict=True)
            )
            words.append(f"the measurements allow {len(one.peak)} values of {name}: {places}; its σ spans them all")
    return words


def compared(problem: Problem, record: GridRecord) -> Compared | None:
    """Every parameter at the end by a grid filter and by the approximate filters, with the ratio of `expected_ratio`: all of them
    without tolerances, of which the approximate ones know nothing, and with the process noise that these have.

    A filter that diverges is NaN, and so is a grid filter where readings that are taken for exact have no posterior. None
    without a parameter.
    """
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


def beyond_ranges(config: PlacementConfig, problem: Problem, values: Mapping[str, float]) -> dict[str, str]:
    """Parameter → a sentence, of those whose values [SI] are beyond `parameters.*.range`.

    Modes and static responses of `rom` span the range; a damping factor multiplies C within the reduced model and is exact
    anywhere.
    """
    free = [name for name in problem.unknowns.parameters if name != problem.model.damping.parameter]
    ranges = {name: config.parameters[name].range for name in free}
    return out_of_range(values, ranges, unknown_units(config), "rom")


def widen(beyond: Mapping[str, str]) -> str:
    """What to do about parameters beyond their ranges."""
    return f"widen {' and '.join(f'parameters.{name}.range' for name in beyond)}"


EXCLUDED = 5.0
"""Of the σ of both together: two estimates that are farther apart exclude each other."""
Values = Mapping[str, tuple[float, float]]
"""Parameter → value and σ [SI]."""


def last_values(model: FilterModel, run: FilterRun | Smoothed) -> Values:
    """Of the unknowns at the end of the first run."""
    values = physical(model, run.mean[-1, 0], run.std[-1, 0])
    return {name: (float(value), float(std)) for name, (value, std) in values.items()}


def grid_filter_values(comparison: Compared | None) -> dict[str, tuple[float, float]]:
    """By the grid filter of a comparison; empty where nothing was compared."""
    if comparison is None:
        return {}
    return {name: (float(value[0]), float(comparison.std[name][0])) for name, value in comparison.estimate.items()}


def excluded(estimate: Values, other: Values) -> str:
    """Which parameters two estimates give values that exclude each other, in words; empty where none."""
    words = []
    for name, (b, t) in other.items():
        a, s = estimate[name]
        if abs(np.log(a / b)) > EXCLUDED * np.hypot(s / a, t / b):
            words.append(f"{name} is {a:.4g} ± {100 * s / a:.2g} % or {b:.4g} ± {100 * t / b:.2g} %")
    return "; ".join(words)


def excluded_in_words(words: str, settled: bool, key: str) -> str:
    """Why there is no σ, by the words of `excluded`; settled: whether the start of the estimate is, as `key` says."""
    remedy = (
        f"with a settled and with an unknown start: check {key}" if settled else "by two searches: report this record"
    )
    return f"two estimates exclude each other: {words}, {remedy}" if words else ""
