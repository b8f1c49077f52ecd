"""Statements of a suite with the numbers that they stand or fall with: the first thing its page says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from html import escape

from strainsight.report.bench.data import CONFIRMED, CONTRADICTED, UNDECIDED, BenchClaim, BenchSuite
from strainsight.report.page.markup import count, plain, sheet
from strainsight.report.page.text import number

MARKS = {
    CONFIRMED: '<strong class="good whole">✓ confirmed</strong>',
    CONTRADICTED: '<strong class="bad whole">✕ contradicted</strong>',
    UNDECIDED: '<strong class="bad whole">– no number</strong>',
}
FEW = 3
"""Most numbers of a claim that are shown one by one."""


def answer(suite: BenchSuite) -> str:
    """How many statements hold, which do not, and how many runs that is from."""
    many, told = len(suite.runs), sum(1 for run in suite.runs if run.estimate is not None)
    runs = f"{count(many)} run{'s' * (many != 1)}, {count(told)} with an estimate"
    if not suite.claims:
        return f"<strong>{runs}</strong>."
    parts = []
    for verdict in (CONFIRMED, CONTRADICTED, UNDECIDED):
        places = [i for i, claim in enumerate(suite.claims, start=1) if claim.verdict == verdict]
        if places:
            links = ", ".join(f'<a href="#claim-{i}">{i}</a>' for i in places)
            listed = f" (statement{'s' * (len(places) > 1)} {links})" if verdict != CONFIRMED else ""
            word = f"<strong>{verdict}</strong>" if verdict != CONFIRMED else verdict
            parts.append(f"{count(len(places))} {word}{listed}")
    all_of = len(suite.claims)
    return f"<strong>{count(all_of)} statement{'s' * (all_of != 1)}</strong>: {', '.join(parts)}; from {runs}."


def claims_table(suite: BenchSuite) -> str:
    """A row a statement: what was measured where, within which bounds it would hold, and whether it does."""
    if not suite.claims:
        return ""
    head = "".join(f'<th scope="col">{name}</th>' for name in ("statement", "measured", "asked", "verdict"))
    rows = "".join(_row(suite, i, claim) for i, claim in enumerate(suite.claims, start=1))
    text = f'<table class="claims"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>'
    return f'<section id="answer" aria-label="answer" class="card">{sheet("statements", text, "<h2>Statements</h2>")}</section>'


Shown = Callable[[float], str]
"""How a number is written: `number` for people, `plain` for a page."""


def asked(claim: BenchClaim, shown: Shown = number) -> str:
    """The bounds in words."""
    unit = f" {claim.unit}" if claim.unit else ""
    if claim.equals is not None:
        return "yes" if claim.equals else "no"
    if claim.above is not None and claim.below is not None:
        return f"{shown(claim.above)} to {shown(claim.below)}{unit}"
    if claim.above is not None:
        return f"above {shown(claim.above)}{unit}"
    return f"below {shown(claim.below if claim.below is not None else float('nan'))}{unit}"


def measured(claim: BenchClaim, shown: Shown = number) -> str:
    """The numbers in words: one by one where they are few, else from which to which."""
    values = [value for _, _, value in claim.found]
    unit = f" {claim.unit}" if claim.unit else ""
    if claim.equals is not None:
        yes = sum(bool(value) for value in values)
        return ("yes" if yes else "no") if len(values) == 1 else f"{shown(yes)} of {shown(len(values))} yes"
    if len(values) <= FEW:
        return ", ".join(shown(value) for value in values) + unit
    finite = [value for value in values if value == value]
    lost = len(values) - len(finite)
    said = f"{shown(min(finite))} to {shown(max(finite))}{unit} ({shown(len(values))} numbers)" if finite else "–"
    if finite and min(finite) == max(finite):
        said = f"{shown(finite[0])}{unit} ({shown(len(values))} numbers)"
    return said + (f", {shown(lost)} without a number" if lost and finite else "")


def _row(suite: BenchSuite, index: int, claim: BenchClaim) -> str:
    names = list(dict.fromkeys(name for _, name, _ in claim.found))
    listed = escape(", ".join(names[:FEW])) + (f" and {count(len(names) - FEW)} more" if len(names) > FEW else "")
    places = list(dict.fromkeys(place for place, _, _ in claim.found))
    links = ", ".join(f'<a href="#run-{i + 1}">{escape(suite.runs[i].label)}</a>' for i in places[:FEW])
    links += f" and {count(len(places) - FEW)} more" if len(places) > FEW else ""
    compared = f" over {escape(claim.compared)}" if claim.compared else ""
    wrong = ""
    if claim.verdict != CONFIRMED and len(claim.found) > 1:
        bad = [(i, name, value) for i, name, value in claim.found if claim.holds(value) is not True]
        worst = "; ".join(
            f"{escape(suite.runs[i].label)}: {escape(name)} {plain(value)}" for i, name, value in bad[:FEW]
        )
        more = f" and {count(len(bad) - FEW)} more" if len(bad) > FEW else ""
        wrong = f"<br><small>not in {worst}{more}</small>"
    safe = replace(claim, unit=escape(claim.unit))
    return (
        f'<tr id="claim-{index}"><th scope="row">{index}. {escape(claim.text)}</th>'
        f'<td data-label="measured">{measured(safe, plain)}<br>'
        f"<small>{listed}{compared} in {links}</small></td>"
        f'<td data-label="asked">{asked(safe, plain)}</td>'
        f"<td>{MARKS[claim.verdict]}{wrong}</td></tr>"
    )
