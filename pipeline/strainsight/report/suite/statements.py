"""Statements of a suite with the numbers that they stand or fall with: the first thing its page says."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from html import escape

import numpy as np

from strainsight.report.page.markup import count, plain, sheet
from strainsight.report.suite.data import CONFIRMED, CONTRADICTED, UNDECIDED, Statement, Suite, unexplained
from strainsight.report.suite.results import is_estimated
from strainsight.report.text import number

MARKS = {
    CONFIRMED: '<strong class="good whole">✓ confirmed</strong>',
    CONTRADICTED: '<strong class="bad whole">✕ contradicted</strong>',
    UNDECIDED: '<strong class="bad whole">– no number</strong>',
}
FEW = 3
"""Most numbers of a claim that are shown one by one."""


def answer(suite: Suite) -> str:
    """How many statements hold, which do not, and how many runs that is from."""
    many, estimated = len(suite.runs), sum(map(is_estimated, suite.runs))
    runs = f"{count(many)} run{'s' * (many != 1)}, {count(estimated)} with an estimate"
    if not suite.statements:
        return f"<strong>{runs}</strong>."
    parts = []
    for verdict in (CONFIRMED, CONTRADICTED, UNDECIDED):
        places = [i for i, statement in enumerate(suite.statements, start=1) if statement.verdict == verdict]
        if places:
            links = ", ".join(f'<a href="#claim-{i}">{i}</a>' for i in places)
            listed = f" (statement{'s' * (len(places) > 1)} {links})" if verdict != CONFIRMED else ""
            word = f"<strong>{verdict}</strong>" if verdict != CONFIRMED else verdict
            parts.append(f"{count(len(places))} {word}{listed}")
    all_of = len(suite.statements)
    return f"<strong>{count(all_of)} statement{'s' * (all_of != 1)}</strong>: {', '.join(parts)}; from {runs}."


def statements_table(suite: Suite) -> str:
    """A row a statement: what was measured where, within which bounds it would hold, and whether it does."""
    if not suite.statements:
        return ""
    head = "".join(f'<th scope="col">{name}</th>' for name in ("statement", "measured", "target", "verdict"))
    rows = "".join(_row(suite, i, statement) for i, statement in enumerate(suite.statements, start=1))
    text = f'<table class="claims"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>'
    return sheet("statements", text, "<h2>Statements</h2>")


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
    seeds = list(statement.seeds.values())
    if most(statement) > 1:
        return _spread(seeds, shown, f" {statement.unit}" if statement.unit else "")
    unit = f" {statement.unit}" if statement.unit else ""
    if statement.equals is not None:
        yes = sum(bool(value) for value in values)
        return ("yes" if yes else "no") if len(values) == 1 else f"{shown(yes)} of {shown(len(values))} yes"
    if len(values) <= FEW:
        return ", ".join(shown(value) for value in values) + unit
    finite = [value for value in values if value == value]
    lost = len(values) - len(finite)
    text = f"{shown(min(finite))} to {shown(max(finite))}{unit} ({shown(len(values))} numbers)" if finite else "–"
    if finite and min(finite) == max(finite):
        text = f"{shown(finite[0])}{unit} ({shown(len(values))} numbers)"
    return text + (f", {shown(lost)} without a number" if lost and finite else "")


def most(statement: Statement) -> int:
    """Seeds of the number that has most."""
    return max((len(values) for values in statement.seeds.values()), default=0)


def _spread(seeds: Sequence[Sequence[float]], shown: Shown, unit: str) -> str:
    """Of every number, or of all where they are many: the median of its seeds, with their 10 and 90 %."""
    with np.errstate(invalid="ignore"):
        low, middle, high = (np.array([_share(values, q) for values in seeds]) for q in (0.1, 0.5, 0.9))
    if len(seeds) <= FEW:
        listed = zip(low, middle, high, strict=True)
        return ", ".join(f"{shown(b)} ({shown(a)} to {shown(c)})" for a, b, c in listed) + unit
    medians = f"{shown(float(np.nanmin(middle)))} to {shown(float(np.nanmax(middle)))}"
    around = f"{shown(float(np.nanmin(low)))} to {shown(float(np.nanmax(high)))}"
    return f"{medians} ({around}){unit}, {shown(len(seeds))} numbers"


def _share(values: Sequence[float], q: float) -> float:
    """The value that this share of the finite ones does not exceed; NaN of none."""
    finite = np.array(values)[np.isfinite(values)]
    return float(np.quantile(finite, q)) if len(finite) else float("nan")


def _row(suite: Suite, index: int, statement: Statement) -> str:
    names = list(dict.fromkeys(name for _, name, _ in statement.found))
    listed = escape(", ".join(names[:FEW])) + (f" and {count(len(names) - FEW)} more" if len(names) > FEW else "")
    places = list(dict.fromkeys(place for place, _, _ in statement.found))
    links = ", ".join(f'<a href="#run-{i + 1}">{escape(suite.runs[i].label)}</a>' for i in places[:FEW])
    links += f" and {count(len(places) - FEW)} more" if len(places) > FEW else ""
    compared = f" over {escape(statement.compared)}" if statement.compared else ""
    wrong = ""
    if statement.verdict != CONFIRMED and len(statement.found) > 1:
        bad = [(key, values) for key, values in statement.seeds.items() if statement.holds_over(values) is not True]
        worst = "; ".join(
            f"{escape(suite.runs[i].label)}: {escape(name)} {_failed(statement, values)}"
            for (i, name), values in bad[:FEW]
        )
        more = f" and {count(len(bad) - FEW)} more" if len(bad) > FEW else ""
        wrong = f"<br><small>not in {worst}{more}</small>"
    wrong += reason(statement.verdict, statement.why)
    seeds = most(statement)
    compared += f", median and 10 to 90 % of {count(seeds)} seeds," if seeds > 1 else ""
    safe = replace(statement, unit=escape(statement.unit))
    return (
        f'<tr id="claim-{index}"><th scope="row">{index}. {escape(statement.text)}</th>'
        f'<td data-label="measured">{measured(safe, plain)}<br>'
        f"<small>{listed}{compared} in {links}</small></td>"
        f'<td data-label="target">{target(safe, plain)}</td>'
        f"<td>{MARKS[statement.verdict]}{wrong}</td></tr>"
    )


def _failed(statement: Statement, values: Sequence[float]) -> str:
    """The number, or in how many of its seeds it holds."""
    if len(values) == 1:
        return plain(values[0])
    return f"holds in {sum(statement.holds(value) is True for value in values)} of {len(values)} seeds"
