"""Output to the user: one line per stage, tables, JSON."""

from __future__ import annotations

import math
import sys
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any

from strainsight.errors import printable
from strainsight_cli.printing import json_line

if TYPE_CHECKING:
    from strainsight.runner.output import Table
    from strainsight.runner.plan import Status
    from strainsight.runner.runner import Event

WIDTH_OF_A_FILE = 200
"""Columns of a stage table in a file or pipe."""
WIDTH_OF_A_PIPE = 100_000
"""Columns of status and doctor in a file or pipe: one line per row."""


def stage_line(event: Event, verbose: bool = False) -> str:
    """`place     done  0.3 s   100 → 4, gap 0.000 %`"""
    if event.artefact is None:
        return f"{event.stage:<9} runs: {event.reason}"
    if event.status != "done":
        return f"{event.stage:<9} {event.status}{f', {event.reason}' if event.reason else ''}"
    why = f"  ({event.reason})" if verbose else ""
    return f"{event.stage:<9} done {event.seconds:>6.1f} s   {event.artefact.message}{why}"


def stage_json(event: Event | Status, run: str = "") -> str:
    """One object of --json for a stage that ran, failed or was checked; run: its name in a suite."""
    from strainsight.runner.artefact import Artefact

    artefact = event.artefact
    summary = artefact.summary if isinstance(artefact, Artefact) else {}
    path = artefact.path if isinstance(artefact, Artefact) else artefact
    entry: dict[str, Any] = {"run": run} if run else {}
    entry |= {
        "stage": event.stage,
        "status": event.status,
        "reason": event.reason,
        "seconds": round(getattr(event, "seconds", 0.0), 3),
        "artefact": None if path is None else str(path),
        # JSON has no infinity and no NaN
        "summary": {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in summary.items()},
    }
    return json_line(entry)


def print_grid(
    head: Sequence[str],
    rows: Sequence[Sequence[Any]],
    least: Sequence[int] = (),
    right: Collection[int] = (),
    indent: int = 0,
) -> None:
    """A table of rich Texts; in files and pipes, without line breaks and trailing spaces.

    head: column names, "" for a table without header; least: minimum widths; right: right-aligned columns. rich omits colours
    without a terminal, or if NO_COLOR is set."""
    from rich.console import Console
    from rich.padding import Padding
    from rich.table import Table as RichTable
    from rich.text import Text

    at_terminal = sys.stdout.isatty()
    console = Console(width=None if at_terminal else WIDTH_OF_A_PIPE, highlight=False)
    grid = RichTable(box=None, pad_edge=False, padding=(0, 2, 0, 0), show_header=any(head), header_style="")
    for i, name in enumerate(head):
        width = least[i] if least else None
        grid.add_column(Text(name), min_width=width, justify="right" if i in right else "left", overflow="fold")
    for row in rows:
        grid.add_row(*row)
    with console.capture() as capture:
        console.print(Padding(grid, (0, 0, 0, indent), expand=False))
    text = capture.get()
    print(text if at_terminal else "\n".join(line.rstrip() for line in text.split("\n")), end="")


def print_tables(tables: Sequence[Table]) -> None:
    """The tables of the stages, with aligned columns."""
    for table in tables:
        print("", *table_lines(table), sep="\n")


def table_lines(table: Table) -> list[str]:
    """Title and rows of a table, in lines of the width of the terminal or file."""
    from rich.console import Console
    from rich.table import Table as RichTable
    from rich.text import Text

    console = Console(width=None if sys.stdout.isatty() else WIDTH_OF_A_FILE, highlight=False)
    header = any(table.columns)
    grid = RichTable(box=None, pad_edge=False, padding=(0, 2, 0, 0), show_header=header, header_style="")
    for column in table.columns:
        grid.add_column(Text(printable(column)))
    for row in table.rows:
        grid.add_row(*(Text(printable(cell)) for cell in row))
    with console.capture() as capture:
        if table.title:
            console.print(Text(printable(table.title)))
        console.print(grid)
    return [line.rstrip() for line in capture.get().rstrip("\n").split("\n")]
