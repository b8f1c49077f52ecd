"""Contents of the page of a suite: runs, studies, statements and comparisons with their results, sentences and tables.

Errors and standard deviations of placements are relative, as in `pages.placement.data`; numbers of stage summaries have SI
units and the names of the stages ("error.Fz")."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape

import numpy as np

from strainsight.pages.arrays import History
from strainsight.pages.bench.data import BenchPageRun, PageRun
from strainsight.pages.page.markup import count, links, plain, result_mark, sheet
from strainsight.pages.picture.layout import PictureLayout
from strainsight.pages.placement.data import MetricWords, ObservabilityCase, Trend, Unknown
from strainsight.text import number

SEEDS_ASIDE = 0.1
"""Share of seeds that may violate a confirmed statement."""
CONFIRMED, CONTRADICTED, UNDECIDED = "confirmed", "contradicted", "no number"
HOLDS, PUBLISHED_ONLY, OTHER_ONLY, UNMEASURED = (
    "holds",
    "holds with the published settings only",
    "holds with other settings only",
    "not measured",
)


@dataclass(frozen=True)
class PlacementRun(PageRun):
    """Run of a placement.

    unknowns: with numbers after `validate`; pool: number of candidates, None before `place`, as are trend and layout;
    histories, cases, frequencies [Hz] and truth_description: as in `PlacementReport`."""

    unknowns: tuple[Unknown, ...] = ()
    pool: int | None = None
    trend: Trend | None = None
    layout: PictureLayout | None = None
    histories: tuple[History, ...] = ()
    cases: tuple[ObservabilityCase, ...] = ()
    frequencies: tuple[float, ...] = ()
    truth_description: str = ""

    @property
    def is_estimated(self) -> bool:
        """Whether any unknown has an estimate."""
        return any(unknown.error is not None for unknown in self.unknowns)

    @property
    def gauges(self) -> int | None:
        """Number of gauges of the layout."""
        return None if self.layout is None else len(self.layout.gauges)


SuiteRun = PlacementRun | BenchPageRun


@dataclass(frozen=True)
class SuiteStudy:
    """Comparison of several runs: name, note; over: the varied key or None; numbers: shown over the key, empty for errors;
    runs: indices of runs in the suite."""

    name: str
    note: str
    over: str | None
    numbers: tuple[str, ...]
    runs: tuple[int, ...]


@dataclass(frozen=True)
class Statement:
    """Statement about numbers of runs.

    numbers: (index of the run, name of the number, value), one per seed if there are several; above, below: bounds or None;
    equals: required value of a true or false number; compared: name of the divisor; why: explanation."""

    text: str
    numbers: tuple[tuple[int, str, float], ...]
    above: float | None = None
    below: float | None = None
    equals: bool | None = None
    unit: str = ""
    compared: str = ""
    why: str = ""

    @property
    def seeds(self) -> dict[tuple[int, str], list[float]]:
        """(Index of the run, name of the number) → values of all seeds."""
        names = dict.fromkeys((place, name) for place, name, _ in self.numbers)
        return {key: [value for *other, value in self.numbers if tuple(other) == key] for key in names}

    @property
    def result(self) -> str:
        """Result: confirmed if every number is within the bounds, for several seeds in at least 90 % of them; undecided if only
        NaN prevents this."""
        results = [self.holds_over(values) for values in self.seeds.values()]
        if False in results:
            return CONTRADICTED
        return UNDECIDED if None in results or not results else CONFIRMED

    def holds_over(self, values: Sequence[float]) -> bool | None:
        """Whether a number is within the bounds for at least 90 % of the seeds; None if only NaN prevents this."""
        results = [self.holds(value) for value in values]
        most = SEEDS_ASIDE * len(values)
        if results.count(False) > most:
            return False
        return None if results.count(None) + results.count(False) > most else True

    def holds(self, value: float) -> bool | None:
        """Whether a number is within the bounds; None for NaN."""
        if math.isnan(value):
            return None
        if self.equals is not None:
            return bool(value) == self.equals
        return (self.above is None or value > self.above) and (self.below is None or value < self.below)


@dataclass(frozen=True)
class SourceComparison:
    """Statement of a source with its published number; published_settings, other_settings: results, None if not
    computed; why: explanation."""

    source: str
    statement: str
    published: str
    published_settings: Statement | None
    other_settings: Statement | None
    why: str = ""

    @property
    def result(self) -> str:
        """Result: holds if every computed side is confirmed; undecided if one is undecided and none is refuted."""
        results = [None if side is None else side.result for side in (self.published_settings, self.other_settings)]
        measured = [result for result in results if result is not None]
        if not measured:
            return UNMEASURED
        if UNDECIDED in measured and CONTRADICTED not in measured:
            return UNDECIDED
        if CONTRADICTED not in measured:
            return HOLDS
        return {CONFIRMED: PUBLISHED_ONLY}.get(results[0] or "", OTHER_ONLY if CONFIRMED in measured else CONTRADICTED)


@dataclass(frozen=True)
class Suite:
    """Contents of the page of a suite: name, title, runs in order; provenance: versions, digests."""

    name: str
    title: str
    runs: tuple[SuiteRun, ...]
    studies: tuple[SuiteStudy, ...] = ()
    statements: tuple[Statement, ...] = ()
    comparisons: tuple[SourceComparison, ...] = ()
    provenance: Mapping[str, str] = field(default_factory=dict)

    @property
    def placements(self) -> tuple[tuple[int, PlacementRun], ...]:
        """Placement runs with their numbers from 1."""
        return tuple((i, run) for i, run in enumerate(self.runs, start=1) if isinstance(run, PlacementRun))

    @property
    def benches(self) -> tuple[tuple[int, BenchPageRun], ...]:
        """Bench runs with their numbers from 1."""
        return tuple((i, run) for i, run in enumerate(self.runs, start=1) if isinstance(run, BenchPageRun))


def metrics_of(runs: Iterable[PlacementRun]) -> tuple[MetricWords, ...]:
    """Distinct placement metrics of these runs."""
    return tuple(dict.fromkeys(run.trend.metric for run in runs if run.trend is not None))


def metric_name(metrics: Sequence[MetricWords]) -> str:
    """Heading of a metric column: the formula of a single metric, else "placement criterion"."""
    return metrics[0].symbol if len(metrics) == 1 else "placement criterion"


def metric_words(metrics: Sequence[MetricWords]) -> str:
    """Symbols and meanings of metrics, as the beginning of a sentence."""
    return "; ".join(f"{metric.symbol}: {metric.meaning}" for metric in metrics)


RESULTS = (HOLDS, PUBLISHED_ONLY, OTHER_ONLY, CONTRADICTED, UNDECIDED, UNMEASURED)
"""Possible results of a comparison."""
GOOD = (CONFIRMED, HOLDS, PUBLISHED_ONLY, OTHER_ONLY)
STATEMENT_HEAD = ("statement", "computed", "target", "result")
COMPARISON_HEAD = ("source", "statement", "published", "published settings", "other settings", "result")
"""Headings of both tables."""
FEW = 3
"""Most numbers of a statement that are listed individually."""


def answer(suite: Suite) -> str:
    """Number of confirmed statements, the other statements, and number of runs."""
    many, estimated = len(suite.runs), sum(run.is_estimated for run in suite.runs)
    runs = f"{count(many)} run{'s' * (many != 1)}, {count(estimated)} with an estimate"
    if not suite.statements:
        return f"<strong>{runs}</strong>."
    parts = []
    for result, places in _by_result(suite.statements, (CONFIRMED, CONTRADICTED, UNDECIDED)):
        listed = f"<strong>{result}</strong> (statement{'s' * (len(places) > 1)} {links('claim', places)})"
        parts.append(f"{count(len(places))} {result if result == CONFIRMED else listed}")
    return f"{_many(suite.statements, 'statement')}: {', '.join(parts)}; from {runs}."


def comparisons_answer(suite: Suite) -> str:
    """Number of comparisons by result."""
    parts = []
    for result, places in _by_result(suite.comparisons, RESULTS):
        word = result if len(places) == 1 else result.replace("holds", "hold")
        listed = f" ({links('comparison', places)})" if result != HOLDS else ""
        parts.append(f"{count(len(places))} {word}{listed}")
    return f"{_many(suite.comparisons, 'comparison')}: {', '.join(parts)}." if parts else ""


def _many(rows: Sequence[object], name: str) -> str:
    return f"<strong>{count(len(rows))} {name}{'s' * (len(rows) != 1)}</strong>"


def _by_result(rows: Sequence[Statement | SourceComparison], results: Sequence[str]) -> list[tuple[str, list[int]]]:
    """Occurring results in this order, with row numbers from 1."""
    counted = [(result, [i for i, row in enumerate(rows, 1) if row.result == result]) for result in results]
    return [(result, places) for result, places in counted if places]


def statements_table(suite: Suite) -> str:
    """Table of statements: numbers, runs, bounds and results."""
    rows = [_row(suite, i, statement) for i, statement in enumerate(suite.statements, start=1)]
    return _table("statements", "claims", STATEMENT_HEAD, rows, "Statements")


def comparisons_table(suite: Suite) -> str:
    """Table of comparisons in the order of the source: its statement, and results with its settings and with ours."""

    def measured_side(statement: Statement | None) -> str:
        if statement is None:
            return "–"
        words = side(replace(statement, unit=escape(statement.unit)), plain)
        return f"{words}<br><small>{_runs(suite, statement)}</small>"

    rows = [
        f'<tr id="comparison-{i}"><td data-label="{COMPARISON_HEAD[0]}">{i}. {escape(row.source)}</td>'
        f'<th scope="row">{escape(row.statement)}</th><td data-label="{COMPARISON_HEAD[2]}">{escape(row.published) or "–"}</td>'
        f'<td data-label="{COMPARISON_HEAD[3]}">{measured_side(row.published_settings)}</td>'
        f'<td data-label="{COMPARISON_HEAD[4]}">{measured_side(row.other_settings)}</td>'
        f"<td>{_mark(row.result)}{reason(row.result, row.why)}</td></tr>"
        for i, row in enumerate(suite.comparisons, start=1)
    ]
    return _table("comparisons", "claims comparisons", COMPARISON_HEAD, rows, "Comparisons with published results")


def _table(name: str, kind: str, heads: Sequence[str], rows: Sequence[str], title: str) -> str:
    if not rows:
        return ""
    head = "".join(f'<th scope="col">{text}</th>' for text in heads)
    text = f'<table class="{kind}"><thead><tr>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table>'
    return sheet(name, text, f"<h2>{title}</h2>")


def reason(result: str, why: str) -> str:
    """Explanation of a result; a mark if it is missing and the result is not a confirmation, which needs none."""
    if result not in (CONFIRMED, HOLDS) and not why:
        return '<p class="why"><strong class="bad">no explanation</strong>: add <code>why</code> in the suite</p>'
    return f'<p class="why">{escape(why)}</p>' if why else ""


Shown = Callable[[float], str]
"""Format of a number: `number` for the terminal, `plain` for a page."""


def target(statement: Statement, shown: Shown = number) -> str:
    """Bounds as text."""
    unit = f" {statement.unit}" if statement.unit else ""
    if statement.equals is not None:
        return "yes" if statement.equals else "no"
    if statement.above is not None and statement.below is not None:
        return f"{shown(statement.above)} to {shown(statement.below)}{unit}"
    if statement.above is not None:
        return f"above {shown(statement.above)}{unit}"
    return f"below {shown(statement.below if statement.below is not None else float('nan'))}{unit}"


def measured(statement: Statement, shown: Shown = number) -> str:
    """Numbers as text: a few individually, more as a range; for several seeds the median and the 10 to 90 % range."""
    values = [value for _, _, value in statement.numbers]
    unit = f" {statement.unit}" if statement.unit else ""
    if most(statement) > 1:
        return _spread(list(statement.seeds.values()), shown, unit)
    if statement.equals is not None:
        yes = sum(bool(value) for value in values)
        return ("yes" if yes else "no") if len(values) == 1 else f"yes for {shown(yes)} of {shown(len(values))} results"
    if len(values) <= FEW:
        return ", ".join(shown(value) for value in values) + unit
    finite = [value for value in values if value == value]
    if not finite:
        return "–"
    low, high, lost = min(finite), max(finite), len(values) - len(finite)
    span = shown(low) if low == high else f"{shown(low)} to {shown(high)}"
    return f"{span}{unit} ({shown(len(values))} numbers)" + f", {shown(lost)} of them undefined" * bool(lost)


def most(statement: Statement) -> int:
    """Largest number of seeds."""
    return max((len(values) for values in statement.seeds.values()), default=0)


def _spread(seeds: Sequence[Sequence[float]], shown: Shown, unit: str) -> str:
    """Median of the seeds with 10 and 90 % quantiles, of a few numbers individually, else as ranges."""
    finite = [np.array(values)[np.isfinite(values)] for values in seeds]
    shares = [np.quantile(values, [0.1, 0.5, 0.9]) if len(values) else np.full(3, np.nan) for values in finite]
    if len(seeds) <= FEW:
        return ", ".join(f"{shown(b)} ({shown(a)} to {shown(c)})" for a, b, c in np.array(shares).tolist()) + unit
    low, high = np.nanmin(shares, axis=0).tolist(), np.nanmax(shares, axis=0).tolist()
    medians, quantiles = (f"{shown(a)} to {shown(b)}" for a, b in ((low[1], high[1]), (low[0], high[2])))
    return f"{medians} ({quantiles}){unit}, {shown(len(seeds))} numbers"


def side(statement: Statement | None, shown: Shown = number) -> str:
    """Numbers and bounds of one side of a comparison."""
    return "–" if statement is None else f"{measured(statement, shown)} ({target(statement, shown)})"


def _few(texts: Sequence[str], between: str = ", ") -> str:
    """First texts and number of the others."""
    more = f" and {count(len(texts) - FEW)} more" if len(texts) > FEW else ""
    return between.join(texts[:FEW]) + more


def _runs(suite: Suite, statement: Statement) -> str:
    """Links to the runs of a statement."""
    places = dict.fromkeys(place for place, _, _ in statement.numbers)
    return _few([f'<a href="#run-{i + 1}">{escape(suite.runs[i].label)}</a>' for i in places])


def _mark(result: str) -> str:
    if result == UNMEASURED:
        return f"– {result}"
    return result_mark(result, result in GOOD, "✕" if result == CONTRADICTED else "–")


def _row(suite: Suite, index: int, statement: Statement) -> str:
    names = _few(list(dict.fromkeys(escape(name) for _, name, _ in statement.numbers)))
    compared = f" over {escape(statement.compared)}" if statement.compared else ""
    wrong = ""
    if statement.result != CONFIRMED and len(statement.numbers) > 1:
        bad = [
            f"{escape(suite.runs[i].label)}: {escape(name)} "
            + (
                plain(values[0])
                if len(values) == 1
                else f"within the bounds of the claim for {inside.count(True)} of {len(values)} random seeds"
            )
            for (i, name), values in statement.seeds.items()
            if (inside := [*map(statement.holds, values)]) and statement.holds_over(values) is not True
        ]
        wrong = f"<br><small>except {_few(bad, '; ')}</small>"
    wrong += reason(statement.result, statement.why)
    seeds = most(statement)
    compared += f", median and 10 to 90 % quantiles of {count(seeds)} random seeds," if seeds > 1 else ""
    safe = replace(statement, unit=escape(statement.unit))
    return (
        f'<tr id="claim-{index}"><th scope="row">{index}. {escape(statement.text)}</th>'
        f'<td data-label="computed">{measured(safe, plain)}<br>'
        f"<small>{names}{compared} in {_runs(suite, statement)}</small></td>"
        f'<td data-label="target">{target(safe, plain)}</td>'
        f"<td>{_mark(statement.result)}{wrong}</td></tr>"
    )
