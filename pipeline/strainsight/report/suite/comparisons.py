"""What a source says beside what comes out here, under its settings and under ours: a row a sentence or figure of it."""

from __future__ import annotations

from dataclasses import replace
from html import escape

from strainsight.report.page.markup import count, plain, sheet
from strainsight.report.suite.data import (
    CONTRADICTED,
    HOLDS,
    OURS_ONLY,
    THEIRS_ONLY,
    UNDECIDED,
    UNMEASURED,
    Comparison,
    Statement,
    Suite,
)
from strainsight.report.suite.statements import Shown, measured, reason, target
from strainsight.report.text import number

VERDICTS = (HOLDS, THEIRS_ONLY, OURS_ONLY, CONTRADICTED, UNDECIDED, UNMEASURED)
GOOD = (HOLDS, THEIRS_ONLY, OURS_ONLY)
COLUMNS = ("source", "it says", "printed", "as printed, here", "ours", "verdict")


def comparisons_answer(suite: Suite) -> str:
    """How many rows came to which verdict."""
    found = {
        verdict: [i for i, row in enumerate(suite.comparisons, 1) if row.verdict == verdict] for verdict in VERDICTS
    }
    parts = []
    for verdict, places in found.items():
        if places:
            links = ", ".join(f'<a href="#comparison-{i}">{i}</a>' for i in places)
            word = verdict if len(places) == 1 else verdict.replace("holds", "hold")
            parts.append(f"{count(len(places))} {word}" + (f" ({links})" if verdict != HOLDS else ""))
    rows = len(suite.comparisons)
    return f"<strong>{count(rows)} comparison{'s' * (rows != 1)}</strong>: {', '.join(parts)}." if parts else ""


def comparisons_table(suite: Suite) -> str:
    """A row a comparison, in the order of the source."""
    if not suite.comparisons:
        return ""
    head = "".join(f'<th scope="col">{name}</th>' for name in COLUMNS)
    rows = "".join(_row(suite, i, row) for i, row in enumerate(suite.comparisons, start=1))
    text = f'<table class="claims comparisons"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>'
    return sheet("comparisons", text, "<h2>Said and measured</h2>")


def side(own: Statement | None, shown: Shown = number) -> str:
    """What one side measures, and the bounds that it is held against."""
    return "–" if own is None else f"{measured(own, shown)} ({target(own, shown)})"


def _row(suite: Suite, index: int, row: Comparison) -> str:
    cells = "".join(
        f'<td data-label="{label}">{_side(suite, own)}</td>'
        for label, own in ((COLUMNS[3], row.as_printed), (COLUMNS[4], row.ours))
    )
    return (
        f'<tr id="comparison-{index}"><td data-label="{COLUMNS[0]}">{index}. {escape(row.source)}</td>'
        f'<th scope="row">{escape(row.says)}</th><td data-label="{COLUMNS[2]}">{escape(row.printed) or "–"}</td>'
        f"{cells}<td>{_mark(row.verdict)}{reason(row.verdict, row.why)}</td></tr>"
    )


def _mark(verdict: str) -> str:
    if verdict in GOOD:
        return f'<strong class="good whole">✓ {verdict}</strong>'
    sign = "✕" if verdict == CONTRADICTED else "–"
    return f"– {verdict}" if verdict == UNMEASURED else f'<strong class="bad whole">{sign} {verdict}</strong>'


def _side(suite: Suite, own: Statement | None) -> str:
    if own is None:
        return "–"
    places = list(dict.fromkeys(place for place, _, _ in own.found))
    links = ", ".join(f'<a href="#run-{i + 1}">{escape(suite.runs[i].label)}</a>' for i in places[:3])
    links += f" and {count(len(places) - 3)} more" if len(places) > 3 else ""
    return f"{side(replace(own, unit=escape(own.unit)), plain)}<br><small>{links}</small>"
