"""The approximate filters beside the bank on the same samples: where their σ does not allow for what it finds."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.bank import filter_bank
from strainsight.estimation.decision import expected_ratio
from strainsight.estimation.filter import run_filter
from strainsight.estimation.model import FilterModel, physical
from strainsight.estimation.run import FilterRun
from strainsight.estimation.sigma_point import run_sigma_points
from strainsight.experiment.structure.problem import Problem, exactly_damped
from strainsight.records.estimated import BANK, EXTENDED, SIGMA_POINT, Compared


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
        return filter_bank(model, start, covariance, known, measured, biased=biased, keep="parameters").run

    def by_extended() -> FilterRun:
        turns = problem.iterations
        return run_filter(model, start, covariance, known, measured, form=form, iterations=turns, biased=biased)

    def by_sigma_points() -> FilterRun:
        return run_sigma_points(model, start, covariance, known, measured, form=form, biased=biased)

    exact = _at_end(by_bank, at)
    found = np.array([exact, *(_at_end(run, at) for run in (by_sigma_points, by_extended))])
    mean, std = np.zeros((2, len(found), model.size))
    mean[:, at], std[:, at] = found[:, 0], found[:, 1]
    values, names = physical(model, mean, std), model.unknowns.parameters
    ratio = {
        name: np.array([expected_ratio(*own, *found[0, :, i]) for own in found[:, :, i]])
        for i, name in enumerate(names)
    }
    return Compared(
        filter=(BANK, SIGMA_POINT, EXTENDED),
        estimate={name: values[name][0] for name in names},
        std={name: values[name][1] for name in names},
        ratio=ratio,
    )


def _at_end(run: Callable[[], FilterRun], at: slice) -> np.ndarray:
    """Mean and σ (2, k) of p at the end, NaN of a filter that diverges."""
    try:
        own = run()
    except NumericalError:
        return np.full((2, at.stop - at.start), np.nan)
    return np.stack([own.mean[-1, 0, at], own.std[-1, 0, at]])
