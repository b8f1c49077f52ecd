"""Which stages are up to date, and why the others are not: a table, or JSON."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from strainsight.errors import printable
from strainsight_cli import render
from strainsight_cli.clock import seconds_for
from strainsight_cli.printing import say
from strainsight_cli.work import Work, elsewhere, note, refuse_taken, show_warnings

if TYPE_CHECKING:
    from strainsight.runner.plan import Status

HEAD = ("stage", "status", "took", "what came out, or why it runs")
LEAST = (9, 11, 8, 0)
"""Least widths of the columns, so that those of a suite's runs stand below each other."""
COLOURS = {"up to date": "green", "will run": "yellow"}


def show_plan(work: Work, forced: Collection[str], as_json: bool, verbose: bool = False) -> None:
    """What would run and why; verbose: every reason, not only the first three."""
    from strainsight.runner.artefact import Artefact
    from strainsight.runner.plan import WILL_RUN, plan
    from strainsight_cli.forecast import forecast

    refuse_taken(work)
    if text := elsewhere(work):
        note(text)
    statuses = plan(work.stages, work.job, forced)
    show_warnings(work, statuses)
    if as_json:
        for status in statuses:
            say(render.status_json(status, work.run))
    else:
        print_statuses(statuses, verbose)
        say("", f"{sum_of(statuses)}")
        pending = [status.stage for status in statuses if status.status == WILL_RUN]
        imported = next((status.artefact for status in statuses if status.stage == "import"), None)
        if imported is not None and (
            line := forecast(work, pending, None if "import" in pending else Artefact(imported))
        ):
            say(line)


def print_statuses(statuses: Sequence[Status], verbose: bool = False, indent: int = 0, head: bool = True) -> None:
    """A row a stage: its status, how long it took when it was last computed, and the reasons or its message."""
    from rich.text import Text

    rows = []
    for status in statuses:
        cells = (status.stage, status.status, _took(status), _why(status, verbose))
        rows.append([Text(printable(cell), style=COLOURS.get(cell, "")) for cell in cells])
    render.print_grid(HEAD if head else ("",) * len(HEAD), rows, LEAST, (2,), indent)


def sum_of(statuses: Sequence[Status]) -> str:
    """`5 of 9 stages up to date; the other 4 took 12.3 s when last run`"""
    from strainsight.runner.plan import UP_TO_DATE

    pending = [status for status in statuses if status.status != UP_TO_DATE]
    text = f"{len(statuses) - len(pending)} of {len(statuses)} stages up to date"
    seconds = [seconds_for(status.artefact) for status in pending]
    known = [value for value in seconds if value is not None]
    if not known:
        return text
    others = f"the other {len(pending)}" if len(pending) > 1 else "the other"
    which = others if len(known) == len(pending) else f"{len(known)} of {others}"
    return f"{text}; {which} took {sum(known):.1f} s when last run"


def _took(status: Status) -> str:
    seconds = seconds_for(status.artefact)
    return "" if seconds is None else f"{seconds:.1f} s"


def _why(status: Status, verbose: bool) -> str:
    from strainsight.runner.artefact import Artefact

    if status.reasons:
        return ", ".join(status.reasons) if verbose else status.reason
    return Artefact(status.artefact).message
