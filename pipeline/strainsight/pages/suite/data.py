"""Everything the page of a suite shows; whoever has the artefacts fills it in.

Errors and standard deviations of placements are relative (0.01 is one per cent), as in `report.placement.data`; numbers of
a stage's summary are in SI units, under the names that the stage gives them ("error.Fz").
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from strainsight.pages.arrays import History
from strainsight.pages.bench.data import BenchRun, Run
from strainsight.pages.picture.layout import Layout
from strainsight.pages.placement.data import Case, Metric, Trend, Unknown

SEEDS_ASIDE = 0.1
"""Share of seeds in which a statement may not hold."""
CONFIRMED, CONTRADICTED, UNDECIDED = "confirmed", "contradicted", "no number"
HOLDS, THEIRS_ONLY, OURS_ONLY, UNMEASURED = (
    "holds",
    "holds under its settings only",
    "holds under ours only",
    "not measured",
)


@dataclass(frozen=True)
class PlacementRun(Run):
    """A placement.

    unknowns: what was to be estimated, with numbers where it was validated; pool: how many gauges there were to choose from, None
    before `place`, as are trend and layout; histories, cases, frequencies [Hz] and truth_description as in `PlacementReport`.
    """

    unknowns: tuple[Unknown, ...] = ()
    pool: int | None = None
    trend: Trend | None = None
    layout: Layout | None = None
    histories: tuple[History, ...] = ()
    cases: tuple[Case, ...] = ()
    frequencies: tuple[float, ...] = ()
    truth_description: str = ""

    @property
    def gauges(self) -> int | None:
        """How many gauges its layout has."""
        return None if self.layout is None else len(self.layout.gauges)


SuiteRun = PlacementRun | BenchRun


@dataclass(frozen=True)
class Study:
    """A question that several runs answer: name, note; over: the key they vary or None; numbers that are drawn over it, or
    none for the errors; runs: their places in the suite, from 0."""

    name: str
    note: str
    over: str | None
    numbers: tuple[str, ...]
    runs: tuple[int, ...]


@dataclass(frozen=True)
class Statement:
    """A statement and the numbers that it stands or falls with: found, (place of the run, name of the number, value), once a seed
    where there are several; above and below: bounds or None; equals: what a number that is true or false has to be; compared:
    what it was divided by; why: in words."""

    text: str
    found: tuple[tuple[int, str, float], ...]
    above: float | None = None
    below: float | None = None
    equals: bool | None = None
    unit: str = ""
    compared: str = ""
    why: str = ""

    @property
    def seeds(self) -> dict[tuple[int, str], list[float]]:
        """(Place of the run, name of the number) → its value of every seed."""
        found: dict[tuple[int, str], list[float]] = {}
        for place, name, value in self.found:
            found.setdefault((place, name), []).append(value)
        return found

    @property
    def verdict(self) -> str:
        """Confirmed where every number is within the bounds, in nine of ten seeds where there are several; no number where one
        is none and the others are."""
        verdicts = [self.holds_over(values) for values in self.seeds.values()]
        if not all(verdict is not False for verdict in verdicts):
            return CONTRADICTED
        return UNDECIDED if None in verdicts or not verdicts else CONFIRMED

    def holds_over(self, values: Sequence[float]) -> bool | None:
        """Whether a number holds over its seeds; None for one that is none in more than a tenth of them."""
        verdicts = [self.holds(value) for value in values]
        most = SEEDS_ASIDE * len(values)
        if verdicts.count(False) > most:
            return False
        return None if verdicts.count(None) + verdicts.count(False) > most else True

    def holds(self, value: float) -> bool | None:
        """Whether a number is within the bounds; None for what is no number."""
        if math.isnan(value):
            return None
        if self.equals is not None:
            return bool(value) == self.equals
        return (self.above is None or value > self.above) and (self.below is None or value < self.below)


@dataclass(frozen=True)
class Comparison:
    """What a source says, where and with which number; as_printed and ours: the same measured under its settings and under ours,
    None where it is not; why: in words."""

    source: str
    says: str
    printed: str
    as_printed: Statement | None
    ours: Statement | None
    why: str = ""

    @property
    def verdict(self) -> str:
        """Holds where every side that is measured is confirmed; no number where one has none and the other is not against it."""
        found = [None if side is None else side.verdict for side in (self.as_printed, self.ours)]
        measured = [verdict for verdict in found if verdict is not None]
        if not measured:
            return UNMEASURED
        if UNDECIDED in measured and CONTRADICTED not in measured:
            return UNDECIDED
        if CONTRADICTED not in measured:
            return HOLDS
        return {CONFIRMED: THEIRS_ONLY}.get(found[0] or "", OURS_ONLY if CONFIRMED in measured else CONTRADICTED)


def unexplained(verdict: str, why: str) -> bool:
    """Whether a verdict stands without the reason that it owes; what holds owes none."""
    return verdict not in (CONFIRMED, HOLDS) and not why


@dataclass(frozen=True)
class Suite:
    """All that the page of a suite shows: its name, a title for people, the runs in order; provenance: versions, digests."""

    name: str
    title: str
    runs: tuple[SuiteRun, ...]
    studies: tuple[Study, ...] = ()
    statements: tuple[Statement, ...] = ()
    comparisons: tuple[Comparison, ...] = ()
    provenance: Mapping[str, str] = field(default_factory=dict)

    @property
    def placements(self) -> tuple[tuple[int, PlacementRun], ...]:
        """The runs that are placements, with their numbers from 1."""
        return tuple((i, run) for i, run in enumerate(self.runs, start=1) if isinstance(run, PlacementRun))

    @property
    def benches(self) -> tuple[tuple[int, BenchRun], ...]:
        """The runs of benches, with their numbers from 1."""
        return tuple((i, run) for i, run in enumerate(self.runs, start=1) if isinstance(run, BenchRun))


def metrics_of(runs: Iterable[PlacementRun]) -> tuple[Metric, ...]:
    """What the layouts of these runs were chosen by, each once."""
    return tuple(dict.fromkeys(run.trend.metric for run in runs if run.trend is not None))


def metric_name(metrics: Sequence[Metric]) -> str:
    """What a column of them is called: by its formula where they are all one."""
    return metrics[0].symbol if len(metrics) == 1 else "metric"


def metric_words(metrics: Sequence[Metric]) -> str:
    """What they are, as the beginning of a sentence."""
    return "; ".join(f"{metric.symbol}: {metric.meaning}" for metric in metrics)
