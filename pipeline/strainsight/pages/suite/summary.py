"""Results of the runs of a suite by unknown, and the first screen: summary sentence and table."""

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
    result_mark,
    share,
    table,
    unfolding,
)
from strainsight.pages.page.problems import faults, no_benefit, problem_text, why
from strainsight.pages.page.sections import section
from strainsight.pages.placement.data import ObservabilityCase, Unknown
from strainsight.pages.suite.data import PlacementRun, Suite, SuiteRun, metric_name, metric_words, metrics_of
from strainsight.text import listed, quantity

SINGULAR = 1e13
"""Condition number above which its digits are rounding errors."""


@dataclass(frozen=True)
class ExcitationSeries:
    """Cases at one excitation: numbers of its runs from 1; excitation and label: of the first run; cases: group → case."""

    runs: tuple[int, ...]
    excitation: str
    label: str
    cases: Mapping[str, ObservabilityCase]

    @property
    def heading(self) -> str:
        """Name of the excitation from its runs: their training motion, or a configured excitation."""
        return numbered(self.runs) + ("" if self.excitation == "training simulation" else f" at {self.excitation}")


def series_of(report: Suite) -> tuple[ExcitationSeries, ...]:
    """Distinct excitations of the runs, in order; runs with equal excitations and numbers form one series."""
    series: list[ExcitationSeries] = []
    # a run with observability only does not contain kinds of unknowns
    loads = {unknown.name for _, run in report.placements for unknown in run.unknowns if unknown.kind == "input"}
    loads |= {load.name for _, run in report.placements if run.layout is not None for load in run.layout.loads}
    for index, run in report.placements:
        # all loads together are "input", because their number differs between runs
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
    """Occurring groups of unknowns, smallest first."""
    names = dict.fromkeys(group for entry in series for group in entry.cases)
    return tuple(sorted(names, key=lambda group: group.count(" + ")))


def numbered(runs: tuple[int, ...]) -> str:
    """Text with run numbers: "run 1", "runs 1, 3 and 5"."""
    texts = [str(run) for run in runs]
    return f"run {texts[0]}" if len(texts) == 1 else f"runs {listed(texts)}"


def observability_section(report: Suite, cards: Mapping[str, str]) -> str:
    """Observability: figure, excitations, weakly observable quantities, and numbers; cards: key of a drawing → card."""
    series = series_of(report)
    if not series:
        return ""
    motions = [[escape(entry.heading), escape(entry.label)] for entry in series]
    listed = table("excitations", ("excitation of", "label of the run (of several runs: the first)"), motions)
    missing, rows = [], []
    for group in groups_of(series):
        cases = [entry.cases.get(group) for entry in series]
        if lost := dict.fromkeys(escape(case.lost) for case in cases if case is not None and case.lost):
            missing.append([escape(group), "<br>".join(lost)])
        rows.append([escape(group), *("–" if case is None else plain(case.condition, 3) for case in cases)])
    if missing:
        listed += '<h3 class="run">Weakly observable in at least one excitation</h3>'
        listed += table("weakly observable", ("unknowns", "weakly observable"), missing)
    head = ["unknowns", *(escape(entry.heading) for entry in series)]
    caption = "Condition number of the scaled Popov-Belevitch-Hautus matrix at λ = 0 with all candidates, median over instants."
    numbers = table("conditions", head, rows, caption=caption, numeric=range(1, len(head)))
    shown = f'{cards.get("pbh", "")}<div class="card">{listed}</div>'
    more = unfolding("Condition numbers", numbers)
    return section("Observability", shown, kind="figures", more=more)


def _same(one: Mapping[str, ObservabilityCase], other: Mapping[str, ObservabilityCase]) -> bool:
    """Whether the numbers are equal, for singular matrices within rounding."""
    return one.keys() == other.keys() and all(
        case.excitation == other[group].excitation
        and (
            min(case.condition, other[group].condition) > SINGULAR
            or math.isclose(case.condition, other[group].condition, rel_tol=1e-6)
        )
        for group, case in one.items()
    )


NOT_ESTIMATED, UNKNOWN = "not estimated", "not tested"
WORDS = (*FAULTS, CONSISTENT, TOO_CAUTIOUS, UNKNOWN, NOT_ESTIMATED)
"""Possible results of a run, problems first."""


@dataclass(frozen=True)
class Result:
    """Result for one unknown of one run.

    error, std: relative, of the filtered parameter or the smoothed load (`smoothed`; else the filtered load), None without an
    estimate."""

    unknown: Unknown
    smoothed: bool
    error: float | None
    std: float | None
    problems: tuple[str, ...]

    @property
    def claim(self) -> Claim | None:
        """Decisive claim."""
        return next(iter(self.unknown.claims), None)

    @property
    def status(self) -> str:
        """Problems or consistency as text, empty without an estimate."""
        if self.error is None:
            return ""
        return ", ".join(self.problems) or (self.claim.result if self.claim else "no claim")


def results_of(run: PlacementRun) -> tuple[Result, ...]:
    """Results for all unknowns of the run, in order."""
    results = []
    for unknown in run.unknowns:
        smoothed = unknown.kind == "input" and unknown.smoothed_error is not None
        error, std = (unknown.smoothed_error, unknown.smoothed_std) if smoothed else (unknown.error, unknown.std)
        diverged = (unknown.repeats is not None and unknown.repeats.lost > 0) or not math.isfinite(error or 0.0)
        results.append(Result(unknown, smoothed, error, std, faults(unknown, diverged)))
    return tuple(results)


def counts(report: Suite) -> dict[str, list[int]]:
    """Result → numbers of runs from 1, in the order of WORDS; a run may have several problems."""
    numbers: dict[str, list[int]] = {word: [] for word in WORDS}
    for index, run in enumerate(report.runs, start=1):
        for word in _status(run):
            numbers[word].append(index)
    return {word: places for word, places in numbers.items() if places}


def without_benefit(report: Suite) -> list[int]:
    """Numbers from 1 of the runs in which random layouts estimate every unknown as accurately as the placed layout."""
    benefits = {i: {one.benefit and one.benefit.result for one in run.unknowns} for i, run in report.placements}
    return [index for index, words in benefits.items() if words == {"none"}]


def _status(run: SuiteRun) -> tuple[str, ...]:
    """Distinct problems of a run, else the consistency of σ."""
    if not run.is_estimated:
        return (NOT_ESTIMATED,)
    if isinstance(run, BenchPageRun):
        wrong, claims = run.all_faults, {run.summary.get(f"claim.{unknown.name}") for unknown in run.unknowns}
    else:
        results = results_of(run)
        wrong = tuple(dict.fromkeys(problem for result in results for problem in result.problems))
        claims = {result.claim.result for result in results if result.claim is not None}
    return wrong or (next((word for word in (TOO_CAUTIOUS, CONSISTENT) if word in claims), UNKNOWN),)


METRIC = "placement criterion"
COLUMNS = (
    "run", "unknown", "gauges", METRIC, "gap of the criterion to its lower bound", "estimation error", "claimed σ",
    "error / σ", "RMS estimation error of repeated runs", "largest estimation error of repeated runs", "consistency",
)  # fmt: skip
NUMERIC = frozenset(COLUMNS) - {"run", "unknown", "consistency"}
MEASURED = COLUMNS[5:]
"""Columns of validated runs only."""


def answer(report: Suite) -> str:
    """Numbers of runs by result, problems first."""
    counted, parts = counts(report), []
    for word, places in counted.items():
        text = f'<strong class="bad">{word}</strong>' if word in FAULTS else word
        parts.append(f"{count(len(places))} {text} ({_links(places)})")
    both = [index for index in counted.get(OVERCONFIDENT, ()) if index in counted.get(LOST, ())]
    ending = f"; {numbered(tuple(both))} both" if both else ""
    none = without_benefit(report)
    gains = f' <strong class="bad">No benefit of the placement in {_links(none)}.</strong>' if none else ""
    return f"{', '.join(parts)}{ending}.{gains}"


def headline(report: Suite) -> str:
    """Numbers of runs by problem, as the beginning of the page title; empty without problems."""
    parts = [f"{len(places)} {word}" for word, places in counts(report).items() if word in FAULTS]
    return f"✕ {', '.join(parts)} of {len(report.runs)} runs – " if parts else ""


def _links(places: Sequence[int]) -> str:
    return f"run{'s' * (len(places) > 1)} {links('run', places)}"


def runs_table(report: Suite) -> str:
    """Table with a block per run and a row per unknown."""
    metrics = metrics_of(run for _, run in report.placements)
    symbol = metric_name(metrics).replace(" ", "\u00a0")  # without line breaks
    columns = tuple(symbol if column == METRIC else column for column in COLUMNS)
    caption = f"{metric_words(metrics)}: with all candidates → with the selected gauges, and ratio of both. " * bool(
        metrics
    )
    caption += (
        "Gap of the criterion to its lower bound: no allowed layout reduces the criterion by more. "
        "Errors of parameters: filtered estimate at the end of the run (of a drifting parameter: mean over the second half), "
        "relative to the true value. Errors of loads: smoothed estimate, relative to the RMS of the load. "
        "Repeated runs: filter runs with other noise and initial values. σ is consistent if the RMS of "
        "error / claimed σ is in the 99.73 % interval of χ² (narrower for more samples). "
        "Above the interval σ is overconfident, below the interval too cautious."
    )
    bodies = [_block(index, run, len(metrics) > 1) for index, run in report.placements]
    numeric = [i for i, name in enumerate(COLUMNS) if name in NUMERIC]
    return grouped_table("runs", columns, bodies, caption=caption, numeric=numeric)


def run_answer(run: PlacementRun) -> str:
    """Problems, then number of gauges and errors of the unknowns."""
    if not run.is_estimated:
        what = " and ".join(escape(unknown.name) for unknown in run.unknowns) or "no unknowns"
        return f"<strong>Not estimated</strong>: {what}; the run ends after stage {escape(run.reached)}."
    results = results_of(run)
    gauges = "The gauges" if run.gauges is None else f"{run.gauges} of {run.pool} candidate gauges"
    parts = [
        f"<strong>{escape(result.unknown.name)}</strong> with an error of {share(result.error)}"
        + (f" (claimed σ {share(result.std)})" if result.std is not None else "")
        for result in results
    ]
    wrong = "".join(
        problem_text(
            result.unknown.name,
            [
                f"{why(fault, result.unknown)} {_lost(result) * (fault == DIVERGED)}".rstrip()
                for fault in result.problems
            ],
        )
        for result in results
    )
    return f"{wrong}{no_benefit(run.unknowns)}{gauges} estimate{'s' * (run.gauges == 1)} {', '.join(parts)}."


def link(run: SuiteRun, text: str = "page of the run", around: str = "{}") -> str:
    """Link to the page of a run, quoted as a path for safety; empty without a page."""
    return around.format(f'<a href="{escape(quote(run.page, safe="/%"))}">{text}</a>') if run.page else ""


ASIDE = '<small class="aside"><br>{}</small>'
"""Markup of a link below the label of a run."""


def _block(index: int, run: PlacementRun, mixed: bool) -> str:
    """Rows of a run; mixed: whether the runs have different metrics. Without an estimate: its last stage, note and expected σ."""
    heading = f'<a href="#run-{index}">{index}. {escape(run.label)}</a>{link(run, around=ASIDE)}'
    trend, metric = run.trend, "–"
    if trend is not None and len(trend.value):  # with all candidates, with the selected gauges, and their ratio
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
    text = f"<strong>not estimated</strong> (run ends after stage {escape(run.reached)}){': ' * bool(run.note)}{escape(run.note)}"
    known = [(one, std) for one in run.unknowns if (std := one.expected_std) is not None]
    if expected := ", ".join(
        f"{escape(one.name)} ± {share(std)} ({escape(quantity(std * one.reference, one.unit, 3))})"
        for one, std in known
    ):
        text += f"<br>expected σ: {expected}"
    return block(heading, [[cell(names), f'<td class="v" colspan="{len(MEASURED)}">{text}</td>']], once)


def _cells(result: Result) -> list[str]:
    """Row of an unknown."""
    unknown, repeats = result.unknown, result.unknown.repeats
    kind = "" if unknown.kind == "parameter" else ", load" if result.smoothed else ", load (filtered estimate)"
    name = escape(unknown.name) + kind + ", zero: in % of its amplitude" * (bool(kind) and unknown.zero)
    sigmas = plain(result.error / result.std, 2) if result.error is not None and result.std else "–"
    spread = (None, None) if repeats is None else (rms(repeats.error), repeats.worst)
    numbers = [share(result.error), share(result.std), sigmas, *map(share, spread)]
    return [cell(name), *(cell(text, right=True) for text in numbers), cell(_consistency(result))]


def _consistency(result: Result) -> str:
    if result.error is None:
        return "not estimated"
    if not result.problems:
        if result.status not in (TOO_CAUTIOUS, CONSISTENT):
            return result.status
        small = f" <small>{_claim_numbers(result)}</small>" * (result.status == TOO_CAUTIOUS)
        return f'<strong class="good">✓ {result.status}</strong>{small}'
    lines = []
    for problem in result.problems:
        text = _claim_numbers(result) if problem == OVERCONFIDENT else _lost(result) if problem == DIVERGED else ""
        lines.append(result_mark(problem, False) + (f" <small>{text}</small>" if text else ""))
    return "<br>".join(lines)


def _claim_numbers(result: Result) -> str:
    """Numbers of the decisive claim: errors in units of σ."""
    assert result.claim is not None
    return result.claim.words(plain, limit=False).removeprefix(f"{result.claim.result} ")


def _lost(result: Result) -> str:
    """Number of diverged repeats in brackets, empty without any."""
    repeats = result.unknown.repeats
    return (
        f"(in {count(repeats.lost)} of {count(len(repeats.error))} repeated runs)" if repeats and repeats.lost else ""
    )
