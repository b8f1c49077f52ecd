"""The filter of a test: what it is given, and what it makes of the samples, of all channels or of some."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.estimate import Estimate
from strainsight.errors import blame
from strainsight.estimation.bank import BankRun, filter_records
from strainsight.estimation.bank_smoother import smooth_bank
from strainsight.estimation.conditional import Nuisances, each_its_own
from strainsight.estimation.consistency import Tuning, scale_noise, tune
from strainsight.estimation.model import FilterModel
from strainsight.estimation.record import BankRecord, Settled
from strainsight.estimation.reduced import driven_with_offsets
from strainsight.estimation.run import FilterRun
from strainsight.estimation.smoother import Smoothed, WantedCovariances, smooth
from strainsight.experiment.structure.filtering import by_moments, compared
from strainsight.experiment.structure.measured import Measured
from strainsight.experiment.structure.nuisances import RENEWED, Shares, Tolerated, budget_of, nuisances_of
from strainsight.experiment.structure.problem import Problem, filter_model
from strainsight.experiment.structure.tolerated_loads import with_interpolation_errors
from strainsight.memory import require_memory
from strainsight.records.estimated import Compared

LONGEST_COMPARED = 20_000
"""Steps of a record that is filtered by the other methods, too, and has a budget, without being asked for."""
FILTER = 0.4
"""Share of the time of filter and smoother that the filter takes."""
SHORTER = "give a part of the record at a time, or a larger machine"


@dataclass(frozen=True)
class Filtering:
    """problem; tolerances, at least of the channels of the test; model at these; test; start (n*, n*) covariance of x* at t = 0;
    settled: the motion that it begins in, None where it is not known to be periodic; record: its place among `records`,
    which are filtered in that order; birge_ratio: as of `filter_records`, of a record that is inconsistent with the model."""

    problem: Problem
    tolerances: Tolerated
    model: FilterModel
    test: Measured
    start: np.ndarray
    settled: Settled | None
    record: int = 0
    records: int = 1
    birge_ratio: float = 1.0

    @property
    def biased(self) -> np.ndarray:
        """Channels with an unknown offset (b,)."""
        return np.flatnonzero(self.test.bias > 0)

    @property
    def covariance(self) -> np.ndarray:
        """That of x* at t = 0, the offsets behind it."""
        return np.diag(np.concatenate([np.diag(self.start), self.test.bias[self.biased] ** 2]))

    @property
    def nuisances(self) -> Nuisances:
        """Of all records; what is zeroed anew acts in this one alone."""
        own = nuisances_of(self.tolerances, self.model, self.test.channels, behind=True)
        return each_its_own(own, self.records, RENEWED)[self.record]

    @property
    def bank_record(self) -> BankRecord:
        """What the bank is given, from a start at zero."""
        start, test = self.covariance, self.test
        states = self.model, np.zeros(len(start)), start
        return BankRecord(*states, test.known, test.values, self.nuisances, self.biased, self.settled)

    @property
    def smoothed_states(self) -> int:
        """How many states the smoother has: x*, offsets, and z where it is a bank's."""
        return len(self.covariance) + (len(self.nuisances.load) if self.problem.method == "bank" else 0)

    @property
    def long(self) -> bool:
        """Whether what takes several times as long as the estimate is left out unless it is asked for."""
        return len(self.test.known) > LONGEST_COMPARED

    def by(self, which: np.ndarray) -> Filtering:
        """With some of the channels (k,)."""
        return replace(self, model=self.model.of_channels(which), test=self.test.by(which))


@dataclass(frozen=True)
class Filtered:
    """run and smoothed; compared: by other filters, where they were asked for; bank: where it is one. Offsets of channels stand
    behind x*."""

    run: FilterRun
    smoothed: Smoothed
    compared: Compared | None
    bank: BankRun | None

    def without_sigma(self) -> Filtered:
        """NaN for σ and covariance, so that what is computed from them is NaN; other filters are not compared by theirs."""
        run = replace(self.run, std=np.nan * self.run.std)
        return replace(self, run=run, smoothed=self.smoothed.without_sigma(), compared=None)


Wants = Callable[[Filtering, FilterRun], WantedCovariances]
Progress = Callable[[float], None]


def model_of(
    problem: Problem, test: Measured, settings: Estimate, start: np.ndarray
) -> tuple[FilterModel, Tuning | None]:
    """The filter's model at the channels of the test, its noises tuned where the config says so."""
    # A stated σ is that of a sample of the file.
    stated = test.std * np.sqrt(test.h * test.every / problem.h)
    model = replace(filter_model(problem, test.channels, test.h, stated=stated), every=test.every)
    model = with_interpolation_errors(model)
    if settings.loads_as_stated:
        model = replace(model, free_loads=False)
    if not settings.tune.parts:
        return model, None
    with blame("estimate.tune"):
        tuning = tune(model, np.zeros(model.size), start, test.known, test.values, settings.tune.parts)
    return scale_noise(model, tuning.factors), tuning


def filtered(
    given: Filtering, compare: bool = False, wanted: Wants | None = None, progress: Progress = lambda share: None
) -> Filtered:
    """Filter and smoother; compare: other filters on the same samples, too; others as of `filtered_together`."""
    problem, model, test, at = given.problem, given.model, given.test, given.biased
    if problem.method == "bank":
        (found,) = filtered_together([given], wanted, progress)
        beside = compared(problem, model, given.covariance, test.known, test.values, at) if compare else None
        return replace(found, compared=beside)
    _require_memory([given], some=False)
    core, covariance = driven_with_offsets(model, test.known, at), given.covariance
    run = by_moments(problem, model, np.zeros(core.size), covariance, test.known, test.values, "all", at)
    return Filtered(run, smooth(core, run, covariance=True), None, None)


def filtered_together(
    each: Sequence[Filtering], wanted: Wants | None = None, progress: Progress = lambda share: None
) -> tuple[Filtered, ...]:
    """Filter and smoother of records that share their parameters and what is bonded, by the bank, whatever their order here.
    Raises where the memory does not hold them.

    wanted: covariances that the smoother keeps of a record, by what the filter found, None: all of every instant; progress:
    called with the share of the way.
    """
    places = [own.record for own in each]
    if places != sorted(places):
        by_place = filtered_together(sorted(each, key=lambda own: own.record), wanted, progress)
        return tuple(by_place[place] for place in places)
    _require_memory(each, some=wanted is not None)

    def going(begin: float, length: float) -> Progress:
        return lambda share: progress(begin + length * share)

    found: list[Filtered] = []
    banks = banks_of(each, going(0.0, FILTER))
    for own, bank in zip(each, banks, strict=True):
        which = None if wanted is None else wanted(own, bank.run)
        length = (1 - FILTER) / len(each)
        done = going(FILTER + length * len(found), length)
        record = replace(own.bank_record, covariance=each[0].covariance, biased=each[0].biased)
        later = smooth_bank(record, bank, which, done)
        found.append(Filtered(bank.run, later, None, bank))
    return tuple(found)


def filtered_by_verdict(
    each: Sequence[Filtering], agrees: Sequence[bool], wanted: Wants | None, progress: Progress
) -> tuple[Filtered, ...]:
    """Those records that agree with the model together, each of the others by itself: one that contradicts it tells the others
    nothing of their parameters, and the lattice of all would follow it to wherever no parameters explain it."""
    parts = [[i for i, own in enumerate(agrees) if own], *([i] for i, own in enumerate(agrees) if not own)]
    found: dict[int, Filtered] = {}
    for part in filter(None, parts):

        def going(share: float, done: int = len(found), part: Sequence[int] = part) -> None:
            progress((done + share * len(part)) / len(each))

        places = np.argsort(np.argsort([each[i].record for i in part]))
        own = [replace(each[i], record=int(k), records=len(part)) for i, k in zip(part, places, strict=True)]
        found |= dict(zip(part, filtered_together(own, wanted, going), strict=True))
    return tuple(found[i] for i in range(len(each)))


def banks_of(each: Sequence[Filtering], progress: Progress = lambda share: None) -> tuple[BankRun, ...]:
    """The bank over the records, in the order of their places; progress: called with the share of the way."""
    covariance, biased = each[0].covariance, each[0].biased
    in_place = sorted(each, key=lambda own: own.record)
    records = [replace(own.bank_record, covariance=covariance, biased=biased) for own in in_place]
    ratio = max(own.birge_ratio for own in each)
    found = filter_records(records, "mean", progress=progress, birge_ratio=ratio)
    return tuple(found[own.record] for own in each)


def _require_memory(each: Sequence[Filtering], some: bool) -> None:
    """Of what filter and smoother take at most; some: whether a bank's smoother keeps some covariances alone."""
    given, steps = each[0], sum(len(own.test.known) for own in each)
    model, m, n, k = given.model, len(given.test.labels), len(given.covariance), len(given.model.unknowns.parameters)
    # mean and σ of filter and smoother with copies of them, and what channels read, innovate and are expected to
    numbers = 8 * n + 12 * m
    beyond = len(given.nuisances.load)
    if given.problem.method != "bank":
        numbers += (3 if k else 2) * n**2
    elif given.nuisances.learned:
        d, points = len(given.nuisances.sources(model.model.size)), max(1, 2 * k)
        numbers += (2 * points + 2) * (n + beyond) ** 2 + d * (4 * n + 5 * m)
    elif not some:
        numbers += (n + beyond) ** 2
    require_memory(8.0 * numbers * steps, f"{steps} steps of {n} states", SHORTER)


def budget_in(given: Filtering, found: Filtered) -> tuple[Shares, tuple[str, ...]]:
    """What the variances are made of, and why there is none."""
    if given.records > 1:
        return {}, ("several records: no budget of the variance",)
    if given.long:
        return {}, (f"more than {LONGEST_COMPARED} steps: no budget of the variance",)
    if len(given.biased):
        return {}, ("no budget of the variance where offsets of channels are unknown",)
    test = given.test
    samples = test.channels, given.start, test.known, test.values
    return budget_of(given.problem, given.tolerances, given.model, *samples, found.run, found.smoothed, given.settled)
