"""What the user sees: one line a stage, tables, JSON."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from strainsight.workflow.artefact import Artefact
    from strainsight.workflow.output import Table
    from strainsight.workflow.plan import Status
    from strainsight.workflow.runner import Event

WIDTH_OF_A_FILE = 200
"""Columns of a table that goes to a file or a pipe."""


def stage_line(event: Event, verbose: bool = False) -> str:
    """`place     done  0.3 s   100 → 4, gap 0.000 %`"""
    if event.artefact is None:
        return f"{event.stage:<9} runs: {event.reason}"
    if event.status != "done":
        return f"{event.stage:<9} {event.status}"
    why = f"  ({event.reason})" if verbose else ""
    return f"{event.stage:<9} done {event.seconds:>6.1f} s   {event.artefact.message}{why}"


def status_line(status: Status) -> str:
    """`place     will run    place.keep 4 → 6 (configs/own.yaml:19)`"""
    return f"{status.stage:<9} {status.status:<11} {status.reason}".rstrip()


def event_json(event: Event, run: str = "") -> str:
    """One object of --json; run: its name within a suite."""
    assert event.artefact is not None
    return _object(run, event.stage, event.status, event.reason, event.seconds, event.artefact)


def status_json(status: Status, run: str = "") -> str:
    """One object of --json for a stage that was only looked at."""
    return _object(run, status.stage, status.status, status.reason, 0.0, None, str(status.artefact))


def failure_json(stage: str, reason: str, run: str = "") -> str:
    """One object of --json for a stage that failed."""
    return _object(run, stage, "failed", reason, 0.0, None)


def _object(
    run: str, stage: str, status: str, reason: str, seconds: float, artefact: Artefact | None, path: str | None = None
) -> str:
    entry: dict[str, Any] = {"run": run} if run else {}
    entry |= {
        "stage": stage,
        "status": status,
        "reason": reason,
        "seconds": round(seconds, 3),
        "artefact": str(artefact.path) if artefact else path,
        "summary": _finite(artefact.summary) if artefact else {},
    }
    return json.dumps(entry, ensure_ascii=False)


def _finite(summary: Mapping[str, Any]) -> dict[str, Any]:
    """JSON has no infinity and no NaN."""
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in summary.items()}


def print_tables(tables: Sequence[Table]) -> None:
    """The stages' tables, columns aligned."""
    if not tables:
        return
    from rich.console import Console
    from rich.table import Table as RichTable
    from rich.text import Text

    console = Console(width=None if sys.stdout.isatty() else WIDTH_OF_A_FILE, highlight=False)
    for table in tables:
        grid = RichTable(box=None, pad_edge=False, padding=(0, 2, 0, 0), title_justify="left")
        for column in table.columns:
            grid.add_column(Text(column))
        for row in table.rows:
            grid.add_row(*map(Text, row))
        console.print()
        if table.title:
            console.print(Text(table.title))
        console.print(grid)


@contextmanager
def progress_bar(wanted: bool) -> Iterator[Callable[[str, str, str, float], None]]:
    """A bar for every run at work, on a terminal only; yields the callback that moves it: (run, stage, doing, share)."""
    if not (wanted and sys.stderr.isatty()):
        yield lambda run, stage, doing, share: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.fields[run]}", markup=False),
        TextColumn("{task.fields[stage]:<9}"),
        BarColumn(),
        TextColumn("{task.description}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        tasks: dict[str, tuple[str, Any]] = {}

        def move(run: str, stage: str, doing: str, share: float) -> None:
            if not stage:
                bar.remove_task(tasks.pop(run)[1])
                return
            if run in tasks and tasks[run][0] != stage:
                bar.remove_task(tasks[run][1])
            if tasks.get(run, ("",))[0] != stage:
                tasks[run] = stage, bar.add_task("", total=1.0, stage=stage, run=run)
            bar.update(tasks[run][1], completed=min(max(share, 0.0), 1.0), description=doing.replace("[", r"\["))

        yield move
