"""What could be distinguished in a suite: sets of unknowns in groups, excitations in series, none of them twice."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from html import escape

from strainsight.pages.page.markup import plain, table
from strainsight.pages.placement.data import Case
from strainsight.pages.suite.data import PlacementRun, Suite
from strainsight.pages.text import listed

SINGULAR = 1e13
"""A condition number beyond which its digits are rounding."""
TRAINING = "training run"


@dataclass(frozen=True)
class Series:
    """The cases at one excitation: numbers of the runs that share it, from 1; excitation as the first of them calls it;
    label of that run; group → its case."""

    runs: tuple[int, ...]
    excitation: str
    label: str
    cases: Mapping[str, Case]

    @property
    def heading(self) -> str:
        """Which excitation, by the runs that have it: the training motion of theirs, or one that they state."""
        return numbered(self.runs) + ("" if self.excitation == TRAINING else f" at {self.excitation}")


def series_of(report: Suite) -> tuple[Series, ...]:
    """Every distinct excitation of the runs, in their order; runs with the same one and the same numbers are one series."""
    found: list[Series] = []
    loads = _loads(report)
    for index, run in report.placements:
        for excitation in dict.fromkeys(case.excitation for case in run.cases):
            cases = {_group(case, run, loads): case for case in run.cases if case.excitation == excitation}
            for place, other in enumerate(found):
                if _same(cases, other.cases):
                    found[place] = replace(other, runs=(*other.runs, index))
                    break
            else:
                found.append(Series((index,), excitation, run.label, cases))
    return tuple(found)


def groups_of(series: tuple[Series, ...]) -> tuple[str, ...]:
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
    groups = groups_of(series)
    motions = [[escape(entry.heading), escape(entry.label)] for entry in series]
    lost = {
        group: list(dict.fromkeys(entry.cases[group].lost for entry in series if group in entry.cases))
        for group in groups
    }
    listed = table("excitations", ("excitation of", "label of the first"), motions)
    missing = [[escape(group), "<br>".join(escape(text) for text in texts if text)] for group, texts in lost.items()]
    if missing := [row for row in missing if row[1]]:
        listed += '<h3 class="run">Weakly observable at one of them at least</h3>'
        listed += table("weakly observable", ("unknown together", "what"), missing)
    rows = [
        [escape(group)]
        + ["–" if group not in entry.cases else plain(entry.cases[group].condition, 3) for entry in series]
        for group in groups
    ]
    head = ["unknown together", *(escape(entry.heading) for entry in series)]
    caption = "Condition number of the scaled Popov-Belevitch-Hautus matrix at λ = 0: whole pool, median over instants."
    numbers = table("conditions", head, rows, caption=caption, numeric=range(1, len(head)))
    return (
        f'<h2>What can be distinguished</h2><div class="figures">{cards.get("pbh", "")}<div class="card">{listed}</div></div>'
        f'<details class="card below"><summary>The same in numbers</summary>{numbers}</details>'
    )


def _loads(report: Suite) -> frozenset[str]:
    """Names that are loads in any run: one that was only observed does not say which of its names are."""
    inputs = {unknown.name for _, run in report.placements for unknown in run.unknowns if unknown.kind == "input"}
    drawn = {load.name for _, run in report.placements if run.layout is not None for load in run.layout.loads}
    return frozenset(inputs | drawn)


def _group(case: Case, run: PlacementRun, loads: frozenset[str]) -> str:
    """The set of unknowns in words: all loads together are "input", as the runs differ in how many they have."""
    own = {unknown.name for unknown in run.unknowns if unknown.kind == "parameter"}
    parts = ["input" if name in loads and name not in own else name for name in case.unknowns]
    return " + ".join(dict.fromkeys(parts)) or "none"


def _same(one: Mapping[str, Case], other: Mapping[str, Case]) -> bool:
    return one.keys() == other.keys() and all(
        case.excitation == other[group].excitation and _equal(case.condition, other[group].condition)
        for group, case in one.items()
    )


def _equal(one: float, other: float) -> bool:
    return (one > SINGULAR and other > SINGULAR) or one == other or math.isclose(one, other, rel_tol=1e-6)
