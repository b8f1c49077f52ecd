"""Set-up and run of the filter of a record, for all channels or some of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.errors import NumericalError, blame
from strainsight.estimation.conditional import ConsideredParameters, split_by_record
from strainsight.estimation.consistency import Tuning, scale_noise, tune
from strainsight.estimation.grid_filter import GridRun, filter_records
from strainsight.estimation.grid_filter_smoother import smooth_on_grid
from strainsight.estimation.model import FilterModel
from strainsight.estimation.record import GridRecord, Settled
from strainsight.estimation.reduced import driven_with_offsets
from strainsight.estimation.run import FilterRun
from strainsight.estimation.smoother import Smoothed, WantedCovariances, smooth
from strainsight.experiment.structure.budget import Shares, budget_of
from strainsight.experiment.structure.considered import RENEWED, Tolerated, build_considered, on_average
from strainsight.experiment.structure.filtering import by_moments
from strainsight.experiment.structure.measured import Measured, in_record, settled_in
from strainsight.experiment.structure.problem import Problem, filter_model, initial_covariance
from strainsight.experiment.structure.tolerated_loads import with_interpolation_errors
from strainsight.memory import require_memory
from strainsight.records.estimated import Compared

LONGEST_COMPARED = 20_000
"""Most steps of a record with a comparison of filters and a variance budget by default."""
FILTER = 0.4
"""Share of the filter in the time of filter and smoother."""
SHORTER = (
    "Estimate parts of the record one after the other (divide the measurement file), or use a machine with more memory."
)
FEW, TRIED = 20, 1000
"""Samples of the warm-up run, and of the timed run."""
LONG = 20_000
"""Fewest steps for a forecast; shorter records take about a minute."""


@dataclass(frozen=True)
class RecordFilter:
    """Filter of one record.

    tolerances: at least of the channels of the test; start (n*, n*): covariance of x* at t = 0; settled: initial motion, None
    unless periodic; record: index among `records`, the order of filtering; birge_ratio: see `filter_records`."""

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
        """Covariance of [x*, offsets] at t = 0."""
        return np.diag(np.concatenate([np.diag(self.start), self.test.bias[self.biased] ** 2]))

    @property
    def considered(self) -> ConsideredParameters:
        """Considered parameters of all records; zero-balance errors act in this record only."""
        considered = build_considered(self.tolerances, self.model, self.test.channels, behind=True)
        return split_by_record(considered, self.records, RENEWED)[self.record]

    @property
    def grid_record(self) -> GridRecord:
        """Input of the parameter grid filter, from a start at zero."""
        start, test = self.covariance, self.test
        states = self.model, np.zeros(len(start)), start
        return GridRecord(*states, test.known, test.values, self.considered, self.biased, self.settled)

    @property
    def long(self) -> bool:
        """Whether expensive extras are omitted by default."""
        return len(self.test.known) > LONGEST_COMPARED

    @property
    def noise_std(self) -> np.ndarray:
        """σ (m,) of the noise of a sample."""
        return np.asarray(np.sqrt(self.model.noise.reshape(-1, len(self.test.labels)).mean(axis=0)))

    def with_wider_frequencies(self, factor: float) -> RecordFilter:
        """The filter with the tolerance of the natural frequencies multiplied by a factor."""
        return replace(self, tolerances=replace(self.tolerances, frequency=factor * self.tolerances.frequency))

    def of_channels(self, which: np.ndarray) -> RecordFilter:
        """Restrict the filter to some channels (k,)."""
        return replace(self, model=self.model.of_channels(which), test=self.test.of_channels(which))


@dataclass(frozen=True)
class FilteredRecord:
    """Results of one record: states [x*, channel offsets]; compared: None without a comparison of filters; grid_run: None for
    other filter methods."""

    run: FilterRun
    smoothed: Smoothed
    compared: Compared | None
    grid_run: GridRun | None

    def without_sigma(self) -> FilteredRecord:
        """Replace σ and covariance by NaN and drop the comparison of filters."""
        run = replace(self.run, std=np.nan * self.run.std)
        return replace(self, run=run, smoothed=self.smoothed.without_sigma(), compared=None)


Wants = Callable[[RecordFilter, FilterRun], WantedCovariances]
Progress = Callable[[float], None]


def record_filters(
    config: PlacementConfig, problem: Problem, tolerances: Tolerated, tests: Sequence[Measured]
) -> tuple[list[RecordFilter], Tuning | None]:
    """Filter of every record at the channels of its test, and the tuning of noise levels, None if not tuned."""
    settings = config.estimate
    assert settings is not None
    std = {**(config.validation.initial_std if config.validation else {}), **settings.initial_std}
    start = initial_covariance(problem, std, moving=settings.start != "rest")
    # sorted by name, so that results do not depend on the order in the config
    place = np.argsort(np.argsort([test.record.name for test in tests]))
    filters, tuning = [], None
    for test, record in zip(tests, place, strict=True):
        with in_record(test.record.label):
            settled = settled_in(problem, test) if settings.start == "settled" else None
            # the configured σ applies to a sample of the file
            sigma = test.std * np.sqrt(test.step / problem.h)
            model = replace(filter_model(problem, test.channels, test.h, sigma=sigma), every=test.every)
            model = with_interpolation_errors(model)
            if settings.loads_follow_model:
                model = replace(model, free_loads=False)
            if settings.tune.parts:
                with blame("estimate.tune"):
                    mean = np.zeros(model.size)
                    tuning = tune(model, mean, start, test.known, test.values, settings.tune.parts)
                model = scale_noise(model, tuning.factors)
        model = on_average(tolerances, model, test.channels)
        filters.append(RecordFilter(problem, tolerances, model, test, start, settled, int(record), len(tests)))
    return filters, tuning


def filter_together(
    filters: Sequence[RecordFilter], wanted: Wants | None = None, progress: Progress = lambda share: None
) -> tuple[FilteredRecord, ...]:
    """Filter and smooth records with common parameters and gauges: by the parameter grid filter, one record by the configured
    filter. Raises InfeasibleError if the memory is insufficient.

    wanted: covariances that the smoother keeps, None: all; progress: called with the finished share."""
    first = filters[0]
    _require_memory(filters, some=wanted is not None)
    if first.problem.method != "grid":
        known, values, biased, start = first.test.known, first.test.values, first.biased, first.covariance
        core = driven_with_offsets(first.model, known, biased)
        run = by_moments(first.problem, first.model, np.zeros(core.size), start, known, values, "all", biased)
        return (FilteredRecord(run, smooth(core, run, covariance=True), None, None),)
    grid_runs = filter_records_on_grid(filters, lambda share: progress(FILTER * share))
    records: list[FilteredRecord] = []
    for each, grid_run in zip(filters, grid_runs, strict=True):

        def smoothing(share: float, done: int = len(records)) -> None:
            progress(FILTER + (1 - FILTER) * (done + share) / len(filters))

        keep = None if wanted is None else wanted(each, grid_run.run)
        records.append(
            FilteredRecord(grid_run.run, smooth_on_grid(each.grid_record, grid_run, keep, smoothing), None, grid_run)
        )
    return tuple(records)


def filter_by_consistency(
    filters: Sequence[RecordFilter], consistent: Sequence[bool], wanted: Wants | None, progress: Progress
) -> tuple[FilteredRecord, ...]:
    """Filter the consistent records jointly and each inconsistent record separately, so that it does not distort the others."""
    parts = [[i for i, one in enumerate(consistent) if one], *([i] for i, one in enumerate(consistent) if not one)]
    results: dict[int, FilteredRecord] = {}
    for part in filter(None, parts):

        def going(share: float, done: int = len(results), part: Sequence[int] = part) -> None:
            progress((done + share * len(part)) / len(filters))

        places = np.argsort(np.argsort([filters[i].record for i in part]))
        some = [replace(filters[i], record=int(k), records=len(part)) for i, k in zip(part, places, strict=True)]
        results |= dict(zip(part, filter_together(some, wanted, going), strict=True))
    return tuple(results[i] for i in range(len(filters)))


def filter_records_on_grid(
    filters: Sequence[RecordFilter], progress: Progress = lambda share: None
) -> tuple[GridRun, ...]:
    """Run the parameter grid filter over the records in the order of `record`; progress: called with the finished share."""
    order = np.argsort([each.record for each in filters])
    ratio = max(each.birge_ratio for each in filters)
    records = [filters[i].grid_record for i in order]
    grid_runs = filter_records(records, "mean", progress=progress, birge_ratio=ratio)
    return tuple(grid_runs[i] for i in np.argsort(order))


def _require_memory(filters: Sequence[RecordFilter], some: bool) -> None:
    """Check the memory of filter and smoother; some: whether the smoother keeps only some covariances."""
    first, steps = filters[0], sum(len(each.test.known) for each in filters)
    model, m, n, k = first.model, len(first.test.labels), len(first.covariance), len(first.model.unknowns.parameters)
    # mean and σ of filter and smoother with copies, and readings, innovations and predictions of channels
    numbers = 8 * n + 12 * m
    missed = len(first.considered.load)
    if first.problem.method != "grid":
        numbers += (3 if k else 2) * n**2
    elif first.considered.learned:
        d, points = len(first.considered.sources(model.model.size)), max(1, 2 * k)
        numbers += (2 * points + 2) * (n + missed) ** 2 + d * (4 * n + 5 * m)
    elif not some:
        numbers += (n + missed) ** 2
    require_memory(8.0 * numbers * steps, f"filtering {steps} time steps of {n} states", SHORTER)


def budget_in(record: RecordFilter, result: FilteredRecord) -> tuple[Shares, tuple[str, ...]]:
    """Variance budget, and the reasons if it is missing."""
    if record.records > 1:
        return {}, ("no variance budget: it is available only for a single record",)
    if record.long:
        return {}, (f"no variance budget: the record has more than {LONGEST_COMPARED} steps",)
    if len(record.biased):
        return {}, ("no variance budget: channel offsets are estimated",)
    known = record.grid_record, record.test.channels
    return budget_of(record.problem, record.tolerances, *known, result.run, result.smoothed, result.grid_run)


def forecast_of(filters: Sequence[RecordFilter], wanted: Wants) -> float | None:
    """Forecast of the seconds of one pass of filter and smoother, timed on the first samples; None for short records."""
    steps = sum(len(each.test.known) for each in filters)
    if steps < LONG:
        return None
    few, first = (replace(filters[0], test=filters[0].test.first(count)) for count in (FEW, TRIED))
    try:
        filter_together([few], wanted)  # compiles before timing
        before = time.perf_counter()
        filter_together([first], wanted)
    except (NumericalError, np.linalg.LinAlgError):  # reported by the estimate itself
        return None
    return (time.perf_counter() - before) * steps / len(first.test.known)


def forecast_in_words(filters: Sequence[RecordFilter], seconds: float) -> str:
    """Sentence with the forecast."""
    steps = sum(len(each.test.known) for each in filters)
    size, unit = next((one for one in ((3600.0, "h"), (60.0, "min")) if seconds >= 1.5 * one[0]), (1.0, "s"))
    duration = f"{seconds / size:.2g} {unit}"
    return f"filter and smoother of {steps} time steps will run for about {duration} (extrapolated from {TRIED} steps)"
