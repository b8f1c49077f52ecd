"""The approximate filters beside the bank on the same samples: where their σ does not allow for what it finds."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from strainsight.cases.filters_compared import BANK, EXTENDED, SIGMA_POINT
from strainsight.cases.structure.problem import Problem, exactly_damped
from strainsight.errors import NumericalError
from strainsight.estimation.bank import filter_bank
from strainsight.estimation.filter import run_filter
from strainsight.estimation.model import FilterModel, physical
from strainsight.estimation.run import FilterRun
from strainsight.estimation.sigma_point import run_sigma_points
from strainsight.estimation.verdict import expected_ratio
from strainsight.records.estimated import Compared


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
        return filter_bank(model, start, covariance, known, measured, biased=biased).run

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


EXCLUDED = 5.0
"""Of the σ of both together: two estimates of one record that are farther apart exclude each other."""


def excluded_in_words(
    found: Mapping[str, tuple[float, float]], beside: Compared | None, settled: bool, key: str
) -> str:
    """That there is no σ as the bank without tolerances, and without a settled start, excludes the estimate; empty where it does
    not. At most one of the two can be right, and the samples do not say which.

    found: parameter → value and σ [SI]; settled: whether the start is; key: of the config, that says so.
    """
    words = []
    for name, others in ({} if beside is None else beside.estimate).items():
        assert beside is not None
        (value, std), other, other_std = found[name], others[0], beside.std[name][0]
        if abs(np.log(value / other)) > EXCLUDED * np.hypot(std / value, other_std / other):
            by = [f"{a:.4g} ± {100 * s / a:.2g} %" for a, s in ((value, std), (other, other_std))]
            words.append(f"{name} is {by[0]}, and {by[1]} without tolerances{' and with an unknown start' * settled}")
    if not words:
        return ""
    remedy = f"check {key}" if settled else "check the tolerances and the noise of the channels"
    return f"σ is withheld: two estimates exclude each other: {'; '.join(words)}: {remedy}"


def _at_end(run: Callable[[], FilterRun], at: slice) -> np.ndarray:
    """Mean and σ (2, k) of p at the end, NaN of a filter that diverges."""
    try:
        own = run()
    except NumericalError:
        return np.full((2, at.stop - at.start), np.nan)
    return np.stack([own.mean[-1, 0, at], own.std[-1, 0, at]])
