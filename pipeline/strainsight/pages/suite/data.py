"""What the page of a suite shows: runs and studies; statements and comparisons with their verdicts, sentences and tables.

Errors and standard deviations of placements are relative (0.01 is one per cent), as in `pages.placement.data`; numbers of
a stage's summary are in SI units, under the names that the stage gives them ("error.Fz").
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape

import numpy as np

from strainsight.pages.arrays import History
from strainsight.pages.bench.data import BenchPageRun, PageRun
from strainsight.pages.page.markup import count, links, plain, sheet, verdict_mark
from strainsight.pages.picture.layout import PictureLayout
from strainsight.pages.placement.data import MetricWords, ObservabilityCase, Trend, Unknown
from strainsight.text import number

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
class PlacementRun(PageRun):
    """A placement.

    unknowns: what was to be estimated, with numbers where it was validated; pool: how many gauges there were to choose from, None
    before `place`, as are trend and layout; histories, cases, frequencies [Hz] and truth_description as in `PlacementReport`.
    """

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
        """Whether any of its unknowns has an estimate."""
        return any(unknown.error is not None for unknown in self.unknowns)

    @property
    def gauges(self) -> int | None:
        """How many gauges its layout has."""
        return None if self.layout is None else len(self.layout.gauges)


SuiteRun = PlacementRun | BenchPageRun


@dataclass(frozen=True)
class SuiteStudy:
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
        names = dict.fromkeys((place, name) for place, name, _ in self.found)
        return {key: [value for *other, value in self.found if tuple(other) == key] for key in names}

    @property
    def verdict(self) -> str:
        """Confirmed where every number is within the bounds, in nine of ten seeds where there are several; no number where one
        is none and the others are."""
        verdicts = [self.holds_over(values) for values in self.seeds.values()]
        if False in verdicts:
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
class SourceComparison:
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
        verdicts = [None if side is None else side.verdict for side in (self.as_printed, self.ours)]
        measured = [verdict for verdict in verdicts if verdict is not None]
        if not measured:
            return UNMEASURED
        if UNDECIDED in measured and CONTRADICTED not in measured:
            return UNDECIDED
        if CONTRADICTED not in measured:
            return HOLDS
        return {CONFIRMED: THEIRS_ONLY}.get(verdicts[0] or "", OURS_ONLY if CONFIRMED in measured else CONTRADICTED)


def unexplained(verdict: str, why: str) -> bool:
    """Whether a verdict stands without the reason that it owes; what holds owes none."""
    return verdict not in (CONFIRMED, HOLDS) and not why


@dataclass(frozen=True)
class Suite:
    """All that the page of a suite shows: its name, a title for people, the runs in order; provenance: versions, digests."""

    name: str
    title: str
    runs: tuple[SuiteRun, ...]
    studies: tuple[SuiteStudy, ...] = ()
    statements: tuple[Statement, ...] = ()
    comparisons: tuple[SourceComparison, ...] = ()
    provenance: Mapping[str, str] = field(default_factory=dict)

    @property
    def placements(self) -> tuple[tuple[int, PlacementRun], ...]:
        """The runs that are placements, with their numbers from 1."""
        return tuple((i, run) for i, run in enumerate(self.runs, start=1) if isinstance(run, PlacementRun))

    @property
    def benches(self) -> tuple[tuple[int, BenchPageRun], ...]:
        """The runs of benches, with their numbers from 1."""
        return tuple((i, run) for i, run in enumerate(self.runs, start=1) if isinstance(run, BenchPageRun))


def metrics_of(runs: Iterable[PlacementRun]) -> tuple[MetricWords, ...]:
    """What the layouts of these runs were chosen by, each once."""
    return tuple(dict.fromkeys(run.trend.metric for run in runs if run.trend is not None))


def metric_name(metrics: Sequence[MetricWords]) -> str:
    """What a column of them is called: by its formula where they are all one."""
    return metrics[0].symbol if len(metrics) == 1 else "metric"


def metric_words(metrics: Sequence[MetricWords]) -> str:
    """What they are, as the beginning of a sentence."""
    return "; ".join(f"{metric.symbol}: {metric.meaning}" for metric in metrics)


VERDICTS = (HOLDS, THEIRS_ONLY, OURS_ONLY, CONTRADICTED, UNDECIDED, UNMEASURED)
"""On a comparison."""
GOOD = (CONFIRMED, HOLDS, THEIRS_ONLY, OURS_ONLY)
STATED = ("statement", "measured", "target", "verdict")
COMPARED = ("source", "it says", "printed", "as printed, here", "ours", "verdict")
"""Heads of both tables."""
FEW = 3
"""Most numbers of a claim that are shown one by one."""


def answer(suite: Suite) -> str:
    """How many statements hold, which do not, and how many runs that is from."""
    many, estimated = len(suite.runs), sum(run.is_estimated for run in suite.runs)
    runs = f"{count(many)} run{'s' * (many != 1)}, {count(estimated)} with an estimate"
    if not suite.statements:
        return f"<strong>{runs}</strong>."
    parts = []
    for verdict, places in _by_verdict(suite.statements, (CONFIRMED, CONTRADICTED, UNDECIDED)):
        listed = f"<strong>{verdict}</strong> (statement{'s' * (len(places) > 1)} {links('claim', places)})"
        parts.append(f"{count(len(places))} {verdict if verdict == CONFIRMED else listed}")
    return f"{_many(suite.statements, 'statement')}: {', '.join(parts)}; from {runs}."


def comparisons_answer(suite: Suite) -> str:
    """How many comparisons came to which verdict."""
    parts = []
    for verdict, places in _by_verdict(suite.comparisons, VERDICTS):
        word = verdict if len(places) == 1 else verdict.replace("holds", "hold")
        listed = f" ({links('comparison', places)})" if verdict != HOLDS else ""
        parts.append(f"{count(len(places))} {word}{listed}")
    return f"{_many(suite.comparisons, 'comparison')}: {', '.join(parts)}." if parts else ""


def _many(rows: Sequence[object], name: str) -> str:
    return f"<strong>{count(len(rows))} {name}{'s' * (len(rows) != 1)}</strong>"


def _by_verdict(rows: Sequence[Statement | SourceComparison], verdicts: Sequence[str]) -> list[tuple[str, list[int]]]:
    """Verdicts that occur, in this order, with the numbers of their rows from 1."""
    counted = [(verdict, [i for i, row in enumerate(rows, 1) if row.verdict == verdict]) for verdict in verdicts]
    return [(verdict, places) for verdict, places in counted if places]


def statements_table(suite: Suite) -> str:
    """A row a statement: what was measured where, within which bounds it would hold, and whether it does."""
    rows = [_row(suite, i, statement) for i, statement in enumerate(suite.statements, start=1)]
    return _table("statements", "claims", STATED, rows, "Statements")


def comparisons_table(suite: Suite) -> str:
    """A row a comparison, in the order of the source: what it says, and what comes out under its settings and under ours."""

    def measured_side(statement: Statement | None) -> str:
        if statement is None:
            return "–"
        words = side(replace(statement, unit=escape(statement.unit)), plain)
        return f"{words}<br><small>{_runs(suite, statement)}</small>"

    rows = [
        f'<tr id="comparison-{i}"><td data-label="{COMPARED[0]}">{i}. {escape(row.source)}</td>'
        f'<th scope="row">{escape(row.says)}</th><td data-label="{COMPARED[2]}">{escape(row.printed) or "–"}</td>'
        f'<td data-label="{COMPARED[3]}">{measured_side(row.as_printed)}</td>'
        f'<td data-label="{COMPARED[4]}">{measured_side(row.ours)}</td>'
        f"<td>{_mark(row.verdict)}{reason(row.verdict, row.why)}</td></tr>"
        for i, row in enumerate(suite.comparisons, start=1)
    ]
    return _table("comparisons", "claims comparisons", COMPARED, rows, "Said and measured")


def _table(name: str, kind: str, heads: Sequence[str], rows: Sequence[str], title: str) -> str:
    if not rows:
        return ""
    head = "".join(f'<th scope="col">{text}</th>' for text in heads)
    text = f'<table class="{kind}"><thead><tr>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table>'
    return sheet(name, text, f"<h2>{title}</h2>")


def reason(verdict: str, why: str) -> str:
    """Why a verdict is what it is; a mark where it owes a reason and none is stated."""
    if unexplained(verdict, why):
        return '<p class="why"><strong class="bad">no reason is given</strong>: say <code>why</code> in the suite</p>'
    return f'<p class="why">{escape(why)}</p>' if why else ""


Shown = Callable[[float], str]
"""How a number is written: `number` for people, `plain` for a page."""


def target(statement: Statement, shown: Shown = number) -> str:
    """The bounds in words."""
    unit = f" {statement.unit}" if statement.unit else ""
    if statement.equals is not None:
        return "yes" if statement.equals else "no"
    if statement.above is not None and statement.below is not None:
        return f"{shown(statement.above)} to {shown(statement.below)}{unit}"
    if statement.above is not None:
        return f"above {shown(statement.above)}{unit}"
    return f"below {shown(statement.below if statement.below is not None else float('nan'))}{unit}"


def measured(statement: Statement, shown: Shown = number) -> str:
    """The numbers in words: one by one where they are few, else from which to which; of several seeds the median, and from where
    to where nine tenths of them but the lowest lie."""
    values = [value for _, _, value in statement.found]
    unit = f" {statement.unit}" if statement.unit else ""
    if most(statement) > 1:
        return _spread(list(statement.seeds.values()), shown, unit)
    if statement.equals is not None:
        yes = sum(bool(value) for value in values)
        return ("yes" if yes else "no") if len(values) == 1 else f"{shown(yes)} of {shown(len(values))} yes"
    if len(values) <= FEW:
        return ", ".join(shown(value) for value in values) + unit
    finite = [value for value in values if value == value]
    if not finite:
        return "–"
    low, high, lost = min(finite), max(finite), len(values) - len(finite)
    span = shown(low) if low == high else f"{shown(low)} to {shown(high)}"
    return f"{span}{unit} ({shown(len(values))} numbers)" + f", {shown(lost)} without a number" * bool(lost)


def most(statement: Statement) -> int:
    """Seeds of the number that has most."""
    return max((len(values) for values in statement.seeds.values()), default=0)


def _spread(seeds: Sequence[Sequence[float]], shown: Shown, unit: str) -> str:
    """Of every number, or of all where they are many: the median of its seeds, with their 10 and 90 %."""
    finite = [np.array(values)[np.isfinite(values)] for values in seeds]
    shares = [np.quantile(values, [0.1, 0.5, 0.9]) if len(values) else np.full(3, np.nan) for values in finite]
    if len(seeds) <= FEW:
        return ", ".join(f"{shown(b)} ({shown(a)} to {shown(c)})" for a, b, c in np.array(shares).tolist()) + unit
    low, high = np.nanmin(shares, axis=0).tolist(), np.nanmax(shares, axis=0).tolist()
    medians, around = (f"{shown(a)} to {shown(b)}" for a, b in ((low[1], high[1]), (low[0], high[2])))
    return f"{medians} ({around}){unit}, {shown(len(seeds))} numbers"


def side(statement: Statement | None, shown: Shown = number) -> str:
    """What one side of a comparison measures, and the bounds that it is held against."""
    return "–" if statement is None else f"{measured(statement, shown)} ({target(statement, shown)})"


def _few(texts: Sequence[str], between: str = ", ") -> str:
    """The first few, and how many more there are."""
    more = f" and {count(len(texts) - FEW)} more" if len(texts) > FEW else ""
    return between.join(texts[:FEW]) + more


def _runs(suite: Suite, statement: Statement) -> str:
    """Links to the runs that a statement is measured in."""
    places = dict.fromkeys(place for place, _, _ in statement.found)
    return _few([f'<a href="#run-{i + 1}">{escape(suite.runs[i].label)}</a>' for i in places])


def _mark(verdict: str) -> str:
    if verdict == UNMEASURED:
        return f"– {verdict}"
    return verdict_mark(verdict, verdict in GOOD, "✕" if verdict == CONTRADICTED else "–")


def _row(suite: Suite, index: int, statement: Statement) -> str:
    names = _few(list(dict.fromkeys(escape(name) for _, name, _ in statement.found)))
    compared = f" over {escape(statement.compared)}" if statement.compared else ""
    wrong = ""
    if statement.verdict != CONFIRMED and len(statement.found) > 1:
        bad = [
            f"{escape(suite.runs[i].label)}: {escape(name)} "
            + (plain(values[0]) if len(values) == 1 else f"holds in {held.count(True)} of {len(values)} seeds")
            for (i, name), values in statement.seeds.items()
            if (held := [*map(statement.holds, values)]) and statement.holds_over(values) is not True
        ]
        wrong = f"<br><small>not in {_few(bad, '; ')}</small>"
    wrong += reason(statement.verdict, statement.why)
    seeds = most(statement)
    compared += f", median and 10 to 90 % of {count(seeds)} seeds," if seeds > 1 else ""
    safe = replace(statement, unit=escape(statement.unit))
    return (
        f'<tr id="claim-{index}"><th scope="row">{index}. {escape(statement.text)}</th>'
        f'<td data-label="measured">{measured(safe, plain)}<br>'
        f"<small>{names}{compared} in {_runs(suite, statement)}</small></td>"
        f'<td data-label="target">{target(safe, plain)}</td>'
        f"<td>{_mark(statement.verdict)}{wrong}</td></tr>"
    )
