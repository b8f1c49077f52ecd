"""The approximate filters beside the bank on the same samples: where their σ does not allow for what it finds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from strainsight.cases.structure.problem import Problem, exactly_damped
from strainsight.errors import NumericalError
from strainsight.estimation.bank import filter_bank
from strainsight.estimation.filter import run_filter
from strainsight.estimation.model import FilterModel, physical
from strainsight.estimation.run import FilterRun
from strainsight.estimation.sigma_point import run_sigma_points
from strainsight.estimation.verdict import ALLOWED, OVERCONFIDENT, expected_ratio, word_of
from strainsight.records.estimated import Compared
from strainsight.workflow.output import Scalar, Table

BANK, SIGMA_POINT, EXTENDED = "bank", "sigma-point", "extended"
DIVERGED = "diverged"


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


def _at_end(run: Callable[[], FilterRun], at: slice) -> np.ndarray:
    """Mean and σ (2, k) of p at the end, NaN of a filter that diverges."""
    try:
        own = run()
    except NumericalError:
        return np.full((2, at.stop - at.start), np.nan)
    return np.stack([own.mean[-1, 0, at], own.std[-1, 0, at]])


def _posterior(own: Compared) -> bool:
    """Whether the bank has one, with which the others are compared."""
    return all(np.isfinite(own.estimate[name][own.filter.index(BANK)]) for name in own.estimate)


def comparison_verdict(ratio: float) -> str:
    """consistent, overconfident, too cautious or diverged."""
    return word_of(ratio, ALLOWED) if np.isfinite(ratio) else DIVERGED


def disagreements(own: Compared) -> Iterator[tuple[str, str, float]]:
    """(filter, parameter, ratio) of every claim that does not allow for what the bank finds; none where it finds nothing."""
    if not _posterior(own):
        return
    for name, ratio in own.ratio.items():
        for i, filter_ in enumerate(own.filter):
            if filter_ != BANK and comparison_verdict(float(ratio[i])) in (OVERCONFIDENT, DIVERGED):
                yield filter_, name, float(ratio[i])


def disagreements_in_words(own: Compared | None) -> list[str]:
    """One sentence each, without a full stop."""
    if own is not None and not _posterior(own):
        return ["filters are not compared: without tolerances the readings leave no posterior of the parameters"]
    return [
        f"the {filter_} filter "
        + (
            f"is overconfident of {name}: the bank expects an error of {ratio:.2g} times its σ"
            if np.isfinite(ratio)
            else f"diverges, of {name} it says nothing"
        )
        for filter_, name, ratio in (disagreements(own) if own is not None else ())
    ]


def ratios(own: Compared | None) -> dict[str, Scalar]:
    """Numbers by name: "ratio.extended.E"."""
    if own is None or not _posterior(own):
        return {}
    return {
        f"ratio.{filter_}.{name}": float(value)
        for name, ratio in own.ratio.items()
        for filter_, value in zip(own.filter, ratio, strict=True)
        if filter_ != BANK
    }


def comparison_table(own: Compared, units: Mapping[str, str]) -> Table:
    """A row a parameter: value ± σ by every filter, and the verdict on the approximate ones where the bank has a posterior."""
    rows, exact = [], _posterior(own)
    for name, estimate in own.estimate.items():
        std, ratio = own.std[name], own.ratio[name]
        cells = [name]
        for i, filter_ in enumerate(own.filter):
            value, size = f"{estimate[i]:.5g}", f"± {100 * std[i] / estimate[i]:.2g} %"
            if filter_ == BANK:
                cells.append(f"{value} {units[name]} {size}" if exact else "no posterior")
            elif not exact:
                cells.append(f"{value} {units[name]} {size}" if np.isfinite(estimate[i]) else DIVERGED)
            else:
                said = f"{value} {size}, {comparison_verdict(float(ratio[i]))} ({ratio[i]:.2g})"
                cells.append(said if np.isfinite(ratio[i]) else DIVERGED)
        rows.append(tuple(cells))
    return Table(TITLE, ("parameter", *own.filter), tuple(rows))


TITLE = "filters compared, σ without tolerances; in brackets: the error that the bank expects over the claimed σ"
