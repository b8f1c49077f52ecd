"""The filter of a test: what it is given, and what it makes of the samples, of all channels or of some."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from strainsight.cases.structure.compared import compared
from strainsight.cases.structure.filtering import by_moments
from strainsight.cases.structure.measured import Measured
from strainsight.cases.structure.nuisances import Tolerated, nuisances_of
from strainsight.cases.structure.problem import Problem, filter_model
from strainsight.cases.structure.variance import Shares, budget_of
from strainsight.config.estimate import Estimate
from strainsight.errors import blame
from strainsight.estimation.bank import BankRun, filter_bank
from strainsight.estimation.bank_smoother import smooth_bank
from strainsight.estimation.biased import driven_with_offsets
from strainsight.estimation.conditional import Nuisances
from strainsight.estimation.model import FilterModel
from strainsight.estimation.run import FilterRun
from strainsight.estimation.settled import Settled
from strainsight.estimation.smoothed import Smoothed, Wanted
from strainsight.estimation.smoother import smooth
from strainsight.estimation.tuning import Tuning, scale_noise, tune
from strainsight.fem.memory import require_memory
from strainsight.records.estimated import Compared

LONGEST_COMPARED = 20_000
"""Steps of a record that is filtered by the other methods, too, and has a budget, without being asked for."""
SHORTER = "give a part of the record at a time, or a larger machine"


@dataclass(frozen=True)
class Filtering:
    """problem; tolerances, at least of the channels of the test; model at these; test; start (n*, n*) covariance of x* at t = 0;
    settled: the motion that it begins in, None where it is not known to be periodic."""

    problem: Problem
    tolerances: Tolerated
    model: FilterModel
    test: Measured
    start: np.ndarray
    settled: Settled | None

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
        return nuisances_of(self.tolerances, self.model, self.test.channels)

    @property
    def long(self) -> bool:
        """Whether what takes several times as long as the estimate is left out unless it is asked for."""
        return len(self.test.known) > LONGEST_COMPARED

    def by(self, which: np.ndarray) -> Filtering:
        """With some of the channels (k,)."""
        quantity = None if self.model.quantity is None else self.model.quantity[which]
        model = replace(self.model, H=self.model.H[which], r=self.model.r[which], quantity=quantity)
        return replace(self, model=model, test=self.test.by(which))


@dataclass(frozen=True)
class Filtered:
    """run and smoothed; compared: by other filters, where they were asked for; bank: where it is one. Offsets of channels stand
    behind x*."""

    run: FilterRun
    smoothed: Smoothed
    compared: Compared | None
    bank: BankRun | None

    def without_sigma(self) -> Filtered:
        """NaN for σ and covariance, so that whatever is computed from them is NaN too."""
        run = replace(self.run, std=np.nan * self.run.std)
        return replace(self, run=run, smoothed=self.smoothed.without_sigma())


def model_of(
    problem: Problem, test: Measured, settings: Estimate, start: np.ndarray
) -> tuple[FilterModel, Tuning | None]:
    """The filter's model at the channels of the test, its noises tuned where the config says so."""
    # A stated σ is that of a sample of the file.
    stated = test.std * np.sqrt(test.h * test.every / problem.h)
    model = replace(filter_model(problem, test.channels, test.h, stated=stated), every=test.every)
    if not settings.tune.parts:
        return model, None
    with blame("estimate.tune"):
        tuning = tune(model, np.zeros(model.size), start, test.known, test.values, settings.tune.parts)
    return scale_noise(model, tuning.factors), tuning


def filtered(
    given: Filtering,
    compare: bool = False,
    wanted: Callable[[FilterRun], Wanted] | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Filtered:
    """Filter and smoother; compare: other filters on the same samples, too. Raises where the memory does not hold them.

    wanted: covariances that a bank's smoother keeps, by what its filter found, None: all of every instant; progress: called with
    the share of the way.
    """
    problem, model, test, at = given.problem, given.model, given.test, given.biased
    core, covariance = driven_with_offsets(model, test.known, at), given.covariance
    steps = len(test.known)
    require_memory(_memory(given, wanted is not None), f"{steps} steps of {core.size} states", SHORTER)
    if problem.method == "bank":
        nuisances, rest, settled = given.nuisances, np.zeros(len(covariance)), given.settled
        data = model, rest, covariance, test.known, test.values, nuisances

        def going(begin: float, length: float) -> Callable[[float], None]:
            return lambda share: progress(begin + length * share)

        bank = filter_bank(*data, biased=at, settled=settled, keep="mean", progress=going(0.0, 0.4))
        which = None if wanted is None else wanted(bank.run)
        later = smooth_bank(*data, bank, at, settled, which, going(0.4, 0.6))
        beside = compared(problem, model, covariance, test.known, test.values, at) if compare else None
        return Filtered(bank.run, later, beside, bank)
    run = by_moments(problem, model, np.zeros(core.size), covariance, test.known, test.values, "all", at)
    return Filtered(run, smooth(core, run, covariance=True), None, None)


def _memory(given: Filtering, some: bool) -> float:
    """What filter and smoother take at most [bytes]; some: whether a bank's smoother keeps some covariances alone."""
    model, m = given.model, len(given.test.labels)
    n, k = len(given.covariance), len(model.unknowns.parameters)
    # mean and σ of filter and smoother with copies of them, and what channels read, innovate and are expected to
    numbers = 8 * n + 12 * m
    if given.problem.method != "bank":
        numbers += (2 if not k else 3) * n**2
    elif given.nuisances.learned:
        d, points = len(given.nuisances.sources(model.model.size)), max(1, 2 * k)
        numbers += (2 * points + 2) * n**2 + d * (4 * n + 5 * m)
    elif not some:
        numbers += n**2
    return 8.0 * numbers * len(given.test.known)


def budget_in(given: Filtering, found: Filtered) -> tuple[Shares, tuple[str, ...]]:
    """What the variances are made of, and why there is none."""
    if given.long:
        return {}, (f"more than {LONGEST_COMPARED} steps: no budget of the variance",)
    if len(given.biased):
        return {}, ("no budget of the variance where offsets of channels are unknown",)
    test = given.test
    samples = test.channels, given.start, test.known, test.values
    return budget_of(given.problem, given.tolerances, given.model, *samples, found.run, found.smoothed, given.settled)
