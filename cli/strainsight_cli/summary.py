"""Summary at the end of `run`: the answers, in at most `LINES` lines together with the lines of the stages."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from strainsight_cli import render
from strainsight_cli.printing import printed_rows, rows_of, say

if TYPE_CHECKING:
    from strainsight.runner.artefact import Artefact
    from strainsight.runner.output import Table

LINES = 30
"""Lines of `run`: stages, warnings and summary; after more stages and warnings, of the summary alone."""


def print_summary(artefacts: Sequence[Artefact], folder: Path, *more: str) -> None:
    """Print the answers of the stages, without answers the tables of the last stage with tables; then the pages.

    folder: of the results; more: lines to add."""
    answers = [table for artefact in artefacts for table in artefact.tables if table.answer]
    if not answers:
        answers = list(next((artefact.tables for artefact in reversed(artefacts) if artefact.tables), ()))
    command = f"strainsight show {shlex.quote(str(folder))}"
    pages = [artefact.path.parent / name for artefact in artefacts for name in artefact.header.side_files or {}]
    last = [
        *(f"{path.stem}: {path}" for path in pages if path.suffix == ".html"),
        f"all tables and files: {command}",
        *more,
    ]
    for lines in shortened(answers, LINES - sum(map(rows_of, last)), printed_rows(), command):
        say("", *lines)
    say(*last)


def shortened(tables: Sequence[Table], room: int, printed: int, command: str) -> list[list[str]]:
    """Lines of the tables, less than `room`: rows are omitted from the end of the last table, then from the one before, down to
    one row, and a line has their number and the `command` that prints them. Of the sentences more are omitted, so that the lines
    `printed` before have room, too."""
    count = [min(len(table.rows), room) for table in tables]
    lines = [_first_rows(*each, command) for each in zip(tables, count, strict=True)]
    sentences = [i for i, table in enumerate(tables) if not any(table.columns)]
    for available, some in ((room - printed, sentences), (room, range(len(tables)))):
        for i in reversed(some):
            while count[i] > 1 and sum(map(len, lines)) + len(lines) > available:
                count[i] -= 1
                lines[i] = _first_rows(tables[i], count[i], command)
    return lines


def _first_rows(table: Table, count: int, command: str) -> list[str]:
    lines = render.table_lines(replace(table, rows=table.rows[:count]))
    missing = len(table.rows) - count
    return [*lines, *[f"… {missing} more: {command} {shlex.quote(table.name)}"] * (missing > 0)]
