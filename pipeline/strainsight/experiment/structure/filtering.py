"""The filter of the config on measurements: a bank over constant parameters, the sigma-point or the extended filter."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.bank import BankRun, filter_bank
from strainsight.estimation.bank_smoother import smooth_bank
from strainsight.estimation.conditional import no_nuisances
from strainsight.estimation.decision import expected_ratio
from strainsight.estimation.filter import run_filter
from strainsight.estimation.mixture import Posterior, marginal
from strainsight.estimation.model import FilterModel, physical
from strainsight.estimation.record import BankRecord, Settled
from strainsight.estimation.run import FilterRun, Keep
from strainsight.estimation.sigma_point import run_sigma_points
from strainsight.estimation.smoother import Smoothed, smooth
from strainsight.experiment.structure.nuisances import Tolerated, nuisances_of, on_average
from strainsight.experiment.structure.problem import Problem, exactly_damped
from strainsight.records.estimated import BANK, EXTENDED, SIGMA_POINT, Compared

IDENTIFIED = 0.5
"""Share of its initial σ that the samples may leave of a parameter that they identify."""


@dataclass(frozen=True)
class Filtered:
    """run: B runs of a filter; banks: what each run's bank found, none of another filter, None for one that failed."""

    run: FilterRun
    banks: tuple[BankRun | None, ...]


def filtered(
    problem: Problem,
    tolerated: Tolerated,
    model: FilterModel,
    channels: np.ndarray,
    start: np.ndarray,
    covariance: np.ndarray,
    known: np.ndarray,
    measured: np.ndarray,
    keep: Keep = "mean",
    settled: Settled | None = None,
    refuse: bool = True,
) -> Filtered:
    """Filter the measurements (T, m) or (T, B, m) of channels (m,) or (B, m) of train.h5, −1 for none, as the config asks for.

    start (n*,) or (B, n*), covariance (n*, n*) of x* at t = 0; known (T, HOLD, n_known) [N]; keep: whether what a smoother needs
    is kept; with "mean" a bank under known loads has its parameters alone; settled: as of `filter_bank`; refuse: raise
    NumericalError where every run fails, and not mark them lost.
    """
    if problem.method != "bank":
        return Filtered(by_moments(problem, model, start, covariance, known, measured, keep, refuse=refuse), ())
    data = measured if measured.ndim == 3 else measured[:, None]
    runs = data.shape[1]
    sets = np.broadcast_to(channels, (runs, channels.shape[-1]))
    starts = np.broadcast_to(start, (runs, model.size))
    kept: Keep = "parameters" if keep == "mean" and not model.unknowns.inputs else keep
    found: list[BankRun | None] = []
    failure: NumericalError | None = None
    for b in range(runs):
        there = sets[b] >= 0
        own = on_average(tolerated, _of_run(model, b, there), sets[b][there])
        nuisances = nuisances_of(tolerated, own, sets[b][there])
        try:
            samples = data[:, b, there]
            record = BankRecord(own, starts[b], covariance, known, samples, nuisances, settled=settled)
            found.append(filter_bank(record, kept))
        except NumericalError as error:
            failure = error
            found.append(None)
    if failure is not None and refuse and all(own is None for own in found):
        raise failure
    return Filtered(_together(model, found, sets >= 0, len(known)), tuple(found))


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


def _of_run(model: FilterModel, b: int, there: np.ndarray) -> FilterModel:
    """The model of one run, with the channels that it has."""
    quantity = model.quantity
    if model.H.ndim == 3:
        model = replace(
            model,
            H=model.H[b],
            change=model.change.of_terms(lambda X: X[b]),
            r=model.r[b] if model.r.ndim == 2 else model.r,
            quantity=quantity[b] if quantity is not None and quantity.ndim == 2 else quantity,
        )
    return model.of_channels(there)


def _together(model: FilterModel, found: list[BankRun | None], there: np.ndarray, steps: int) -> FilterRun:
    """Runs of many banks as one, NaN where one failed or has no channel."""
    if len(found) == 1 and found[0] is not None:
        return found[0].run
    runs, n, u, m = len(found), model.size, len(model.position), there.shape[1]
    mean, std = np.full((2, steps + 1, runs, n), np.nan)
    unknown = np.full((steps + 1, runs, u, u), np.nan)
    gauge_mean, gauge_std, innovation, whitened = np.full((4, steps, runs, m), np.nan)
    fit, last = np.full(runs, -np.inf), np.full((runs, n, n), np.nan)
    for b, bank in enumerate(found):
        if bank is None:
            continue
        own = bank.run
        mean[:, b], std[:, b], unknown[:, b] = own.mean[:, 0], own.std[:, 0], own.unknown_covariance[:, 0]
        gauge_mean[:, b, there[b]], gauge_std[:, b, there[b]] = own.gauge_mean[:, 0], own.gauge_std[:, 0]
        innovation[:, b, there[b]], whitened[:, b, there[b]] = own.innovation[:, 0], own.whitened[:, 0]
        fit[b], last[b] = own.log_likelihood[0], own.last[0]
    return FilterRun(
        time=model.h * np.arange(steps + 1),
        mean=mean,
        std=std,
        unknown_covariance=unknown,
        gauge_mean=gauge_mean,
        gauge_std=gauge_std,
        innovation=innovation,
        whitened=whitened,
        nis=np.nansum(whitened**2, axis=2),
        lost=np.where([own is None for own in found], 1, -1),
        log_likelihood=fit,
        last=last,
    )


def smoothed(
    problem: Problem,
    tolerated: Tolerated,
    model: FilterModel,
    channels: np.ndarray,
    covariance: np.ndarray,
    known: np.ndarray,
    measured: np.ndarray,
    found: Filtered,
    settled: Settled | None = None,
) -> Smoothed:
    """What all samples say of every instant; arguments as of `filtered`, which found the one run, from a start at zero."""
    if problem.method != "bank":
        return smooth(model, found.run)
    bank = found.banks[0]
    assert bank is not None  # a bank that fails alone is refused
    start, model = np.zeros(model.size), on_average(tolerated, model, channels)
    nuisances = nuisances_of(tolerated, model, channels)
    return smooth_bank(BankRecord(model, start, covariance, known, measured, nuisances, settled=settled), bank)


def posteriors_of(problem: Problem, covariance: np.ndarray, bank: BankRun | None) -> dict[str, Posterior]:
    """Of every parameter of a bank; covariance (n*, n*) at t = 0. None by another filter, nor by columns, of which no more than
    mean and covariance is known."""
    if bank is None or bank.step is None:
        return {}
    names, guess = problem.unknowns.parameters, problem.unknowns.guess
    first = problem.unknowns.size(problem.model) - len(names)
    found = {}
    for i, name in enumerate(names):
        prior = 0.0, float(np.sqrt(covariance[first + i, first + i]))
        of_log = marginal(bank.point[:, i], bank.weight, float(bank.step[i]), prior)
        value, peak = guess[name] * np.exp(of_log.value), guess[name] * np.exp(of_log.peak)
        found[name] = replace(of_log, value=value, peak=peak)
    return found


def posterior_numbers(posterior: Mapping[str, Posterior]) -> dict[str, float | bool | int]:
    """Every number by its name."""
    numbers: dict[str, float | bool | int] = {}
    for name, own in posterior.items():
        numbers |= {f"left.{name}": own.left, f"identified.{name}": own.left <= IDENTIFIED}
        numbers[f"peaks.{name}"] = len(own.peak)
    return numbers


def posterior_doubts(posterior: Mapping[str, Posterior], units: Mapping[str, str]) -> list[str]:
    """What a reader has to know of it: that a parameter is hardly seen, or that several values explain the samples."""
    words = []
    for name, own in posterior.items():
        if own.left > IDENTIFIED:
            words.append(f"{name} is not identified: the measurements leave {100 * own.left:.0f} % of its initial σ")
        if len(own.peak) > 1:
            places = ", ".join(
                f"{peak:.4g} {units[name]} ({100 * share:.0f} %)"
                for peak, share in zip(own.peak, own.share, strict=True)
            )
            words.append(f"the measurements allow {len(own.peak)} values of {name}: {places}; its σ spans them all")
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
