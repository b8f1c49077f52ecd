"""The filter of the config on measurements: a bank over constant parameters, the sigma-point or the extended filter."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.bank import BankRun, filter_bank
from strainsight.estimation.conditional import no_nuisances
from strainsight.estimation.filter import run_filter
from strainsight.estimation.mixture import Posterior, marginal
from strainsight.estimation.model import FilterModel, physical
from strainsight.estimation.record import BankRecord
from strainsight.estimation.run import FilterRun, Keep
from strainsight.estimation.sigma_point import run_sigma_points
from strainsight.estimation.smoother import Smoothed
from strainsight.experiment.filters_compared import filters_compared
from strainsight.experiment.structure.problem import Problem, exactly_damped
from strainsight.records.estimated import BANK, EXTENDED, SIGMA_POINT, Compared

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
) -> FilterRun:
    """The sigma-point or the extended filter of the config, which carry mean and covariance; biased: as of `run_filter`."""
    form = problem.form
    if problem.method == "sigma-point":
        return run_sigma_points(
            model, start, covariance, known, measured, keep, form=form, biased=biased, refuse=refuse
        )
    turns = problem.iterations
    return run_filter(
        model, start, covariance, known, measured, keep, form=form, iterations=turns, biased=biased, refuse=refuse
    )


def together(model: FilterModel, banks: Sequence[BankRun | None], channels: np.ndarray, steps: int) -> FilterRun:
    """Runs of many banks as one, NaN where one failed or has no channel (channels (B, m), −1 for none)."""
    if len(banks) == 1 and banks[0] is not None:
        return banks[0].run
    (runs, m), n, u = channels.shape, model.size, len(model.position)
    mean, std = np.full((2, steps + 1, runs, n), np.nan)
    unknown = np.full((steps + 1, runs, u, u), np.nan)
    of_channels = {
        key: np.full((steps, runs, m), np.nan) for key in ("gauge_mean", "gauge_std", "innovation", "whitened")
    }
    fit, last = np.full(runs, -np.inf), np.full((runs, n, n), np.nan)
    for b, bank in enumerate(banks):
        if bank is None:
            continue
        run = bank.run
        mean[:, b], std[:, b], unknown[:, b] = run.mean[:, 0], run.std[:, 0], run.unknown_covariance[:, 0]
        for key, values in of_channels.items():
            values[:, b, channels[b] >= 0] = getattr(run, key)[:, 0]
        fit[b], last[b] = run.log_likelihood[0], run.last[0]
    return FilterRun(
        time=model.h * np.arange(steps + 1),
        mean=mean,
        std=std,
        unknown_covariance=unknown,
        **of_channels,
        nis=np.nansum(of_channels["whitened"] ** 2, axis=2),
        lost=np.where([bank is None for bank in banks], 1, -1),
        log_likelihood=fit,
        last=last,
    )


def histories(model: FilterModel, run: FilterRun, smoothed: Smoothed) -> dict[str, dict[str, np.ndarray]]:
    """The unknowns of the first run in time, by filter and smoother, as `Histories` names them."""
    filtered, later = (physical(model, by.mean[:, 0], by.std[:, 0]) for by in (run, smoothed))
    return {
        "estimate": {name: value for name, (value, _) in filtered.items()},
        "std": {name: std for name, (_, std) in filtered.items()},
        "smoothed": {name: value for name, (value, _) in later.items()},
        "smoothed_std": {name: std for name, (_, std) in later.items()},
    }


def posteriors_of(problem: Problem, covariance: np.ndarray, bank: BankRun | None) -> dict[str, Posterior]:
    """Of every parameter of a bank; covariance (n*, n*) at t = 0. None by another filter, nor by columns, of which no more than
    mean and covariance is known."""
    if bank is None or bank.step is None:
        return {}
    names, guess = problem.unknowns.parameters, problem.unknowns.guess
    first = problem.unknowns.size(problem.model) - len(names)
    posteriors = {}
    for i, name in enumerate(names):
        prior = 0.0, float(np.sqrt(covariance[first + i, first + i]))
        of_log = marginal(bank.point[:, i], bank.weight, float(bank.step[i]), prior)
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
    """What a reader has to know of it: that a parameter is hardly seen, or that several values explain the samples."""
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


def compared(
    problem: Problem,
    model: FilterModel,
    covariance: np.ndarray,
    known: np.ndarray,
    measured: np.ndarray,
    biased: np.ndarray | None = None,
) -> Compared | None:
    """Every parameter at the end by a bank and by the approximate filters, with the ratio of `expected_ratio`: all of them
    without tolerances, of which the approximate ones know nothing, and with the process noise that these have.

    Arguments as of `filter_bank`, from a start at zero. A filter that diverges is NaN, and so is a bank where readings that are
    taken for exact have no posterior. None without a parameter.
    """
    if not model.unknowns.parameters:
        return None
    start, form, at = np.zeros(len(covariance)), problem.form, model.parameter_states
    model = exactly_damped(problem, model)

    def by_bank() -> FilterRun:
        record = BankRecord(model, start, covariance, known, measured, no_nuisances(model))
        return filter_bank(record if biased is None else replace(record, biased=biased), "parameters").run

    def by_extended() -> FilterRun:
        turns = problem.iterations
        return run_filter(model, start, covariance, known, measured, form=form, iterations=turns, biased=biased)

    def by_sigma_points() -> FilterRun:
        return run_sigma_points(model, start, covariance, known, measured, form=form, biased=biased)

    exact = _at_end(by_bank, at)
    ends = np.array([exact, *(_at_end(run, at) for run in (by_sigma_points, by_extended))])
    mean, std = np.zeros((2, len(ends), model.size))
    mean[:, at], std[:, at] = ends[:, 0], ends[:, 1]
    names = model.unknowns.parameters
    values = physical(model, mean, std)
    value, size = (np.stack([values[name][i] for name in names], axis=-1) for i in range(2))
    return filters_compared((BANK, SIGMA_POINT, EXTENDED), names, ends, value, size)


def _at_end(run: Callable[[], FilterRun], at: slice) -> np.ndarray:
    """Mean and σ (2, k) of p at the end, NaN of a filter that diverges."""
    try:
        result = run()
    except NumericalError:
        return np.full((2, at.stop - at.start), np.nan)
    return np.stack([result.mean[-1, 0, at], result.std[-1, 0, at]])
