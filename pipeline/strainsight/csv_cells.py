"""Tables as CSV: cells in quotes where they need it, and no text that a spreadsheet takes for a formula."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Sequence
from types import SimpleNamespace

FORMULA = "=+-@\t\r\n＝＋－＠"
"""What a formula begins with, in one spreadsheet or another. Source: OWASP, "CSV injection"."""
MARK = "'"
"""In front of a text that begins like a formula, or with a mark: spreadsheets take the cell for text."""
_NUMBER = re.compile(r"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|inf|nan)", re.ASCII)


def csv_bytes(rows: Iterable[Sequence[str]]) -> bytes:
    """The lines of a table in UTF-8; `plain_cell` undoes what is done to a cell."""
    lines: list[str] = []
    # a cell that holds a sign of the end of lines is put in quotes
    writer = csv.writer(SimpleNamespace(write=lines.append), lineterminator="\r\n")
    writer.writerows([safe_cell(cell) for cell in row] for row in rows)
    return "".join(line.removesuffix("\r\n") + "\n" for line in lines).encode(errors="replace")


def safe_cell(cell: str) -> str:
    """A text as it is written; numbers are left as they are."""
    marked = cell[:1] in FORMULA + MARK and cell and not _NUMBER.fullmatch(cell)
    return MARK + cell if marked else cell


def plain_cell(cell: str) -> str:
    """A text as it was before `safe_cell`."""
    return cell[1:] if cell[:1] == MARK and cell[1:2] and cell[1] in FORMULA + MARK else cell
