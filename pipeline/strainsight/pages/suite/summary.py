"""What every run of a suite comes to, unknown by unknown, and the first screen: one sentence on all runs, one table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from urllib.parse import quote

from strainsight.estimation.decision import CONSISTENT, DIVERGED, FAULTS, LOST, OVERCONFIDENT, TOO_CAUTIOUS, Claim
from strainsight.pages.arrays import rms
from strainsight.pages.bench.data import BenchPageRun
from strainsight.pages.page.markup import (
    block,
    cell,
    count,
    grouped_table,
    links,
    plain,
    share,
    table,
    unfolding,
    verdict_mark,
)
from strainsight.pages.page.sections import section
from strainsight.pages.page.verdicts import accused, faults, no_benefit, why
from strainsight.pages.placement.data import ObservabilityCase, Unknown
from strainsight.pages.suite.data import PlacementRun, Suite, SuiteRun, metric_name, metric_words, metrics_of
from strainsight.text import listed

SINGULAR = 1e13
"""A condition number beyond which its digits are rounding."""
TRAINING = "training run"


@dataclass(frozen=True)
class ExcitationSeries:
    """The cases at one excitation: numbers of the runs that share it, from 1; excitation as the first of them calls it;
    label of that run; group → its case."""

    runs: tuple[int, ...]
    excitation: str
    label: str
    cases: Mapping[str, ObservabilityCase]

    @property
    def heading(self) -> str:
        """Which excitation, by the runs that have it: the training motion of theirs, or one that they state."""
        return numbered(self.runs) + ("" if self.excitation == TRAINING else f" at {self.excitation}")


def series_of(report: Suite) -> tuple[ExcitationSeries, ...]:
    """Every distinct excitation of the runs, in their order; runs with the same one and the same numbers are one series."""
    series: list[ExcitationSeries] = []
    # one that was only observed does not say which of its names are loads
    loads = {unknown.name for _, run in report.placements for unknown in run.unknowns if unknown.kind == "input"}
    loads |= {load.name for _, run in report.placements if run.layout is not None for load in run.layout.loads}
    for index, run in report.placements:
        # all loads together are "input", as the runs differ in how many they have
        inputs = loads - {unknown.name for unknown in run.unknowns if unknown.kind == "parameter"}
        for excitation in dict.fromkeys(case.excitation for case in run.cases):
            cases = {}
            for case in run.cases:
                if case.excitation == excitation:
                    names = dict.fromkeys("input" if name in inputs else name for name in case.unknowns)
                    cases[" + ".join(names) or "none"] = case
            same = next((i for i, other in enumerate(series) if _same(cases, other.cases)), None)
            if same is None:
                series.append(ExcitationSeries((index,), excitation, run.label, cases))
            else:
                series[same] = replace(series[same], runs=(*series[same].runs, index))
    return tuple(series)


def groups_of(series: tuple[ExcitationSeries, ...]) -> tuple[str, ...]:
    """Sets of unknowns that occur, fewest unknowns first."""
    names = dict.fromkeys(group for entry in series for group in entry.cases)
    return tuple(sorted(names, key=lambda group: group.count(" + ")))


def numbered(runs: tuple[int, ...]) -> str:
    """Runs by their numbers: "run 1", "runs 1, 3 and 5"."""
    texts = [str(run) for run in runs]
    return f"run {texts[0]}" if len(texts) == 1 else f"runs {listed(texts)}"


def observability_section(report: Suite, cards: Mapping[str, str]) -> str:
    """HTML: the figure beside its excitations and what is lost; the numbers below. cards: drawing's key → its card."""
    series = series_of(report)
    if not series:
        return ""
    motions = [[escape(entry.heading), escape(entry.label)] for entry in series]
    listed = table("excitations", ("excitation of", "label of the first"), motions)
    missing, rows = [], []
    for group in groups_of(series):
        cases = [entry.cases.get(group) for entry in series]
        if lost := dict.fromkeys(escape(case.lost) for case in cases if case is not None and case.lost):
            missing.append([escape(group), "<br>".join(lost)])
        rows.append([escape(group), *("–" if case is None else plain(case.condition, 3) for case in cases)])
    if missing:
        listed += '<h3 class="run">Weakly observable at one of them at least</h3>'
        listed += table("weakly observable", ("unknown together", "what"), missing)
    head = ["unknown together", *(escape(entry.heading) for entry in series)]
    caption = "Condition number of the scaled Popov-Belevitch-Hautus matrix at λ = 0: whole pool, median over instants."
    numbers = table("conditions", head, rows, caption=caption, numeric=range(1, len(head)))
    shown = f'{cards.get("pbh", "")}<div class="card">{listed}</div>'
    more = unfolding("The same in numbers", numbers)
    return section("What can be distinguished", shown, kind="figures", more=more)


def _same(one: Mapping[str, ObservabilityCase], other: Mapping[str, ObservabilityCase]) -> bool:
    """Whether the numbers are the same, of singular matrices but for rounding."""
    return one.keys() == other.keys() and all(
        case.excitation == other[group].excitation
        and (
            min(case.condition, other[group].condition) > SINGULAR
            or math.isclose(case.condition, other[group].condition, rel_tol=1e-6)
        )
        for group, case in one.items()
    )


NOT_ESTIMATED, UNKNOWN = "not estimated", "not judged"
WORDS = (*FAULTS, CONSISTENT, TOO_CAUTIOUS, UNKNOWN, NOT_ESTIMATED)
"""What a run may come to, what does not hold first."""


@dataclass(frozen=True)
class Result:
    """One unknown of one run.

    error, std: relative, of the filtered parameter, of the smoothed load (`smoothed`; the filtered one where no smoothed is
    known), None where it was not estimated; verdicts: what is wrong with it, empty where nothing is.
    """

    unknown: Unknown
    smoothed: bool
    error: float | None
    std: float | None
    verdicts: tuple[str, ...]

    @property
    def claim(self) -> Claim | None:
        """The claim that decides."""
        return next(iter(self.unknown.claims), None)

    @property
    def verdict(self) -> str:
        """All of them in words; "" where it was not estimated."""
        if self.error is None:
            return ""
        return ", ".join(self.verdicts) or (self.claim.result if self.claim else "no claim")


def results_of(run: PlacementRun) -> tuple[Result, ...]:
    """Every unknown of the run, in its order."""
    results = []
    for unknown in run.unknowns:
        smoothed = unknown.kind == "input" and unknown.smoothed_error is not None
        error, std = (unknown.smoothed_error, unknown.smoothed_std) if smoothed else (unknown.error, unknown.std)
        diverged = (unknown.repeats is not None and unknown.repeats.lost > 0) or not math.isfinite(error or 0.0)
        results.append(Result(unknown, smoothed, error, std, faults(unknown, diverged)))
    return tuple(results)


def counts(report: Suite) -> dict[str, list[int]]:
    """Numbers of the runs, from 1, by what they came to, in the order of WORDS; a run may have several faults."""
    numbers: dict[str, list[int]] = {word: [] for word in WORDS}
    for index, run in enumerate(report.runs, start=1):
        for word in _words(run):
            numbers[word].append(index)
    return {word: places for word, places in numbers.items() if places}


def without_benefit(report: Suite) -> list[int]:
    """Numbers of the runs, from 1, in which random layouts estimate every unknown as well as the placed one."""
    verdicts = {i: {one.benefit and one.benefit.result for one in run.unknowns} for i, run in report.placements}
    return [index for index, words in verdicts.items() if words == {"none"}]


def _words(run: SuiteRun) -> tuple[str, ...]:
    """What is wrong with a run, each once; else whether its σ hold."""
    if not run.is_estimated:
        return (NOT_ESTIMATED,)
    if isinstance(run, BenchPageRun):
        wrong, held = run.all_faults, {run.summary.get(f"claim.{unknown.name}") for unknown in run.unknowns}
    else:
        results = results_of(run)
        wrong = tuple(dict.fromkeys(verdict for result in results for verdict in result.verdicts))
        held = {result.claim.result for result in results if result.claim is not None}
    return wrong or (next((word for word in (TOO_CAUTIOUS, CONSISTENT) if word in held), UNKNOWN),)


METRIC = "metric"
COLUMNS = (
    "run", "unknown", "gauges", METRIC, "at most above the best set", "error", "claimed σ", "error / σ",
    "repeats: RMS", "worst", "verdict",
)  # fmt: skip
NUMERIC = frozenset(COLUMNS) - {"run", "unknown", "verdict"}
MEASURED = COLUMNS[5:]
"""The columns that only a validated run has."""


def answer(report: Suite) -> str:
    """What the runs came to, what does not hold first."""
    counted, parts = counts(report), []
    for word, places in counted.items():
        text = f'<strong class="bad">{word}</strong>' if word in FAULTS else word
        parts.append(f"{count(len(places))} {text} ({_links(places)})")
    both = [index for index in counted.get(OVERCONFIDENT, ()) if index in counted.get(LOST, ())]
    ending = f"; {numbered(tuple(both))} both" if both else ""
    none = without_benefit(report)
    gains = f' <strong class="bad">Placement brings no benefit in {_links(none)}.</strong>' if none else ""
    return f"{', '.join(parts)}{ending}.{gains}"


def headline(report: Suite) -> str:
    """How many runs have which fault, as the beginning of the page's title; empty where none has."""
    parts = [f"{len(places)} {word}" for word, places in counts(report).items() if word in FAULTS]
    return f"✕ {', '.join(parts)} of {len(report.runs)} runs – " if parts else ""


def _links(places: Sequence[int]) -> str:
    return f"run{'s' * (len(places) > 1)} {links('run', places)}"


def runs_table(report: Suite) -> str:
    """A block a run, a row an unknown."""
    metrics = metrics_of(run for _, run in report.placements)
    symbol = metric_name(metrics).replace(" ", "\u00a0")  # which no end of a line may take apart
    columns = tuple(symbol if column == METRIC else column for column in COLUMNS)
    caption = f"{metric_words(metrics)}, with the whole pool → with the chosen gauges, and their ratio. " * bool(
        metrics
    )
    caption += (
        "Parameters: the filtered estimate, mean over the last half, of the true value; loads: the smoothed one, of the RMS of "
        "that load. The repeats have other noise and other starting values and are filtered. σ is consistent where the RMS of "
        "error over claimed σ lies in the band of χ² that 99.73 % of σ that hold keep to, the narrower the more draws; above it "
        "overconfident, below it too cautious."
    )
    bodies = [_block(index, run, len(metrics) > 1) for index, run in report.placements]
    numeric = [i for i, name in enumerate(COLUMNS) if name in NUMERIC]
    return grouped_table("runs", columns, bodies, caption=caption, numeric=numeric)


def run_answer(run: PlacementRun) -> str:
    """What does not hold, then how many gauges tell what."""
    if not run.is_estimated:
        what = " and ".join(escape(unknown.name) for unknown in run.unknowns) or "nothing"
        return f"<strong>Not estimated</strong>: {what}; the run ends after {escape(run.reached)}."
    gauges, results = "The gauges", results_of(run)
    if run.gauges is not None:
        gauges = f"{run.gauges} gauge{'s' * (run.gauges != 1)} of {run.pool}"
    parts = [
        f"<strong>{escape(result.unknown.name)}</strong> to {share(result.error)}"
        + (f" at a claimed σ of {share(result.std)}" if result.std is not None else "")
        for result in results
    ]
    wrong = "".join(
        accused(
            result.unknown.name,
            [
                f"{why(fault, result.unknown)} {_lost(result) * (fault == DIVERGED)}".rstrip()
                for fault in result.verdicts
            ],
        )
        for result in results
    )
    return f"{wrong}{no_benefit(run.unknowns)}{gauges} tell {', '.join(parts)}."


def link(run: SuiteRun, text: str = "its page", around: str = "{}") -> str:
    """A link to a run's own page, a path, so that nothing in it can act as a scheme; nothing where it has none."""
    return around.format(f'<a href="{escape(quote(run.page, safe="/%"))}">{text}</a>') if run.page else ""


ASIDE = '<small class="aside"><br>{}</small>'
"""Around a link below a run's label."""


def _block(index: int, run: PlacementRun, mixed: bool) -> str:
    """All rows of a run, its own cells once beside those of its unknowns; mixed: runs differ in their metric. Where there is no
    estimate: why, and what placement expects as far as it went."""
    heading = f'<a href="#run-{index}">{index}. {escape(run.label)}</a>{link(run, around=ASIDE)}'
    trend, metric = run.trend, "–"
    if trend is not None and len(trend.value):  # from the whole pool to the chosen gauges, and how many times that is
        first = float(trend.value[0])
        metric = f"{escape(trend.metric.symbol)}: " * mixed + f"{plain(first, 3)} → {plain(trend.final, 3)}"
        metric += f"<br>× {plain(trend.final / first, 3)}" if first > 0 else ""
    once = (
        f"{count(run.gauges)} of {count(run.pool)}" if run.gauges is not None and run.pool is not None else "–",
        metric,
        "–" if trend is None or trend.gap is None else share(max(trend.gap, 0.0)),
    )
    if run.is_estimated:
        return block(heading, list(map(_cells, results_of(run))), once)
    names = ", ".join(escape(unknown.name) for unknown in run.unknowns) or "–"
    text = f"<strong>not estimated</strong> (ends after {escape(run.reached)}){': ' * bool(run.note)}{escape(run.note)}"
    known = [unknown for unknown in run.unknowns if unknown.expected_std is not None]
    if expected := ", ".join(f"{escape(unknown.name)} ± {share(unknown.expected_std)}" for unknown in known):
        text += f"<br>expected when placed: {expected}"
    return block(heading, [[cell(names), f'<td class="v" colspan="{len(MEASURED)}">{text}</td>']], once)


def _cells(result: Result) -> list[str]:
    """The row of an unknown."""
    unknown, repeats = result.unknown, result.unknown.repeats
    kind = "" if unknown.kind == "parameter" else ", load" if result.smoothed else ", load, filtered"
    name = escape(unknown.name) + kind + ", zero: in % of its amplitude" * (bool(kind) and unknown.zero)
    sigmas = plain(result.error / result.std, 2) if result.error is not None and result.std else "–"
    spread = (None, None) if repeats is None else (rms(repeats.error), repeats.worst)
    numbers = [share(result.error), share(result.std), sigmas, *map(share, spread)]
    return [cell(name), *(cell(text, right=True) for text in numbers), cell(_verdict(result))]


def _verdict(result: Result) -> str:
    if result.error is None:
        return "not estimated"
    if not result.verdicts:
        if result.verdict not in (TOO_CAUTIOUS, CONSISTENT):
            return result.verdict
        small = f" <small>{_measured(result)}</small>" * (result.verdict == TOO_CAUTIOUS)
        return f'<strong class="good">✓ {result.verdict}</strong>{small}'
    lines = []
    for verdict in result.verdicts:
        text = _measured(result) if verdict == OVERCONFIDENT else _lost(result) if verdict == DIVERGED else ""
        lines.append(verdict_mark(verdict, False) + (f" <small>{text}</small>" if text else ""))
    return "<br>".join(lines)


def _measured(result: Result) -> str:
    """What decides: the errors that were held against σ, in units of it."""
    assert result.claim is not None
    return result.claim.words(plain, limit=False).removeprefix(f"{result.claim.result} ")


def _lost(result: Result) -> str:
    """How many repeats diverged, in brackets; empty where none did."""
    repeats = result.unknown.repeats
    return f"({count(repeats.lost)} of {count(len(repeats.error))} repeats)" if repeats and repeats.lost else ""
