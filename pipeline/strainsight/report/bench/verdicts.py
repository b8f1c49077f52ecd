"""Where the σ claimed for an unknown of a bench does not hold, as the pages say it."""

from __future__ import annotations

from html import escape

from strainsight.report.bench.data import BenchRun
from strainsight.report.page.markup import plain
from strainsight.report.placement.verdicts import BEYOND, CONTRADICTED, DIVERGED, LOST, OVER, WITHHELD
from strainsight.report.text import digits_apart, number


def faults(run: BenchRun, name: str) -> tuple[str, ...]:
    """What is wrong with the estimate of an unknown, empty where nothing is."""
    over, apart = run.summary.get(f"claim.{name}") == OVER, run.summary.get(f"identified.{name}") is False
    word = str(run.summary.get(f"verdict.{name}"))
    return (*[OVER] * over, *[LOST] * apart, *[word] * (word in (CONTRADICTED, BEYOND, WITHHELD)))


def run_faults(run: BenchRun) -> tuple[str, ...]:
    """What is wrong with a run, each once."""
    found = [DIVERGED] * bool(run.number("lost"))
    return tuple(dict.fromkeys([*found, *(fault for own in run.unknowns for fault in faults(run, own.name))]))


def leading(run: BenchRun) -> str:
    """What the page of a run begins with, as HTML: what does not hold."""
    text, lost = "", run.number("lost")
    if lost:
        text += f'<strong class="bad">{number(lost)} run{"s" * (lost != 1)} lost.</strong> '
    for unknown in run.unknowns:
        if wrong := faults(run, unknown.name):
            said = ", ".join(_why(run, unknown.name, fault) for fault in wrong)
            text += f'<strong class="bad">{escape(unknown.name)}: {said}.</strong> '
    return text


def _why(run: BenchRun, name: str, fault: str) -> str:
    ratio, most = (run.number(f"claim_{key}.{name}") for key in ("ratio", "most"))
    if fault != OVER or ratio is None or most is None:
        return fault
    digits = digits_apart(ratio, most, 2)
    return f"{OVER} (error {plain(ratio, digits)} times the claimed σ, at most {plain(most, max(digits, 3))} where it holds)"
