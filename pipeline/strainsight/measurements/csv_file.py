"""Test data in text tables, read in blocks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

import numpy as np

from strainsight.errors import UserError
from strainsight.measurements.clock import ClockTimes, check_no_counter, recording_of
from strainsight.measurements.csv_layout import Layout, TextFormat, header, is_comment, stated_delimiter, with_units
from strainsight.measurements.csv_rows import Rows, plain_rows, rows_by_line
from strainsight.measurements.records import Recording, decode, open_file, quote

BLOCK = 1 << 22
"""Bytes read at a time."""
LONGEST = 1 << 20
"""Longest line of a table [bytes]."""
MOST_ABOVE = 500
"""Lines that are searched for the names."""
_UTF16 = (b"\xff\xfe", b"\xfe\xff")
SIGN = b"LabVIEW Measurement"
_END = "***End_of_Header***"
_LONGEST = 1000
"""Largest number of header lines."""


def read_csv(
    path: Path,
    channels: Sequence[str],
    *,
    time: str | None = None,
    time_unit: str | None = None,
    rate: float | None = None,
    form: TextFormat | None = None,
) -> Recording:
    """Columns of a text table: a line of names, optionally a line of units, then numbers.

    channels: names in the header, with or without a unit in brackets; time: name of the clock column with numbers or
    clock times; or rate: sampling rate [Hz]. Only these columns must contain numbers. An empty cell or NaN is a
    missing sample, except in the time. Empty lines and comments are skipped; all line ends, UTF-8 with or without byte
    order mark, or Windows-1252. Raises UserError with file:line for an invalid line."""
    form = form or TextFormat()
    path = Path(path)
    with open_file(path) as file:
        table = _Table(path, form, time, tuple(channels))
        for first, block in _blocks(file, path):
            try:
                table.take(first, block)
            except UserError as error:
                if table.layout is None and table.form.header_line is None and not block.startswith(SIGN):
                    _suggest_header_line(error, block, first, table)
                raise
    return table.recording(time_unit, rate)


def _blocks(file: BinaryIO, path: Path) -> Iterator[tuple[int, bytes]]:
    """Blocks of whole lines that end in \\n, and the number of the first line of each."""
    number, rest, start = 1, b"", True
    while block := file.read(BLOCK):
        if start and block[:2] in _UTF16:
            raise UserError("the file has UTF-16 encoding", where=str(path), remedy="save it in UTF-8")
        block = rest + (block.removeprefix(b"\xef\xbb\xbf") if start else block)
        start = False
        # A \r at the end may be the first half of \r\n.
        cut = max(block.rfind(b"\n"), block.rfind(b"\r", 0, -1)) + 1
        lines, rest = _check_lines(block[:cut], number, path), block[cut:]
        if lines:
            yield number, lines
            number += lines.count(b"\n")
        if len(rest) > LONGEST:
            _check_lines(rest, number, path)
            raise UserError("a line is longer than 1 MiB", where=f"{path}:{number}", remedy="write one sample per line")
    if rest.strip():
        yield number, _check_lines(rest + b"\n", number, path)


def _check_lines(lines: bytes, number: int, path: Path) -> bytes:
    lines = lines.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if (at := lines.find(b"\0")) >= 0:
        line = number + lines[:at].count(b"\n")
        raise UserError(
            "the file is binary, not a text table",
            where=f"{path}:{line}",
            remedy="export the test data as text, HDF5 or UFF58",
        )
    return lines


def _suggest_header_line(error: UserError, block: bytes, first: int, table: _Table) -> None:
    """Add to the remedy the line near the top that contains the required names, or at least the time."""
    for wanted in dict.fromkeys((table.channels, () if table.time else table.channels[:1])):
        for number, line in enumerate(block.split(b"\n", MOST_ABOVE)[:MOST_ABOVE], start=first):
            try:
                header(line, "", table.form, table.time, wanted)
            except UserError:
                continue
            if f"{table.path}:{number}" == error.where:
                return
            form = table.form
            error.remedy = (
                f"line {number} contains the column name {quote(table.time or table.channels[0])}: "
                + form.remedy_setting("header_line", str(number), "specify it as the line of column names")
            )
            return


class _Table:
    """The requested columns, block by block."""

    def __init__(self, path: Path, form: TextFormat, time: str | None, channels: tuple[str, ...]):
        self.path, self.form, self.time, self.channels = path, form, time, channels
        self.layout: Layout | None = None
        self.lvm: Header | None = None
        self.units_passed = False
        self.pieces: list[list[np.ndarray]] = [[] for _ in range((time is not None) + len(channels))]
        self.clock = ClockTimes()
        self.runs: list[tuple[int, int]] = []
        self.rows = 0
        self.next_line = -1

    def take(self, first: int, block: bytes) -> None:
        at = 0
        if first == 1 and block.startswith(SIGN):
            self.lvm = header_of(block, self.form, str(self.path))
            self.form = self.lvm.form
        while at < len(block) and not self.units_passed:
            end = block.index(b"\n", at)
            if self._is_data(block[at:end], first):
                break
            at, first = end + 1, first + 1
        if at < len(block):
            assert self.layout is not None
            rows = plain_rows(block[at:], first, self.layout, self.form)
            self._add(rows or rows_by_line(block[at:], first, self.layout, self.form, self.path, self.clock))

    def _is_data(self, line: bytes, number: int) -> bool:
        """Whether a line is the first below names and units; reads names and units on the way."""
        where, form = f"{self.path}:{number}", self.form
        if self.layout is None:
            if form.header_line is not None:
                if number == form.header_line:
                    layout = header(line, where, form, self.time, self.channels)
                    self.layout = self.lvm.applied(layout) if self.lvm else layout
            elif number == 1 and (delimiter := stated_delimiter(line)) and form.delimiter in (None, delimiter):
                self.form = replace(form, delimiter=delimiter)
            elif line.strip() and not is_comment(line, form):
                self.layout = header(line, where, form, self.time, self.channels)
            return False
        if not line.strip() or is_comment(line, form):
            return False
        self.units_passed = True
        if (below := with_units(line, where, self.layout)) is None:
            return True
        self.layout = below
        return False

    def _add(self, rows: Rows) -> None:
        if not len(rows.values):
            return
        breaks = np.flatnonzero(np.diff(rows.lines) != 1) + 1
        if rows.lines[0] != self.next_line:
            breaks = np.concatenate([[0], breaks])
        self.runs.extend((self.rows + int(i), int(rows.lines[i])) for i in breaks)
        self.rows += len(rows.values)
        self.next_line = int(rows.lines[-1]) + 1
        for column, pieces in enumerate(self.pieces):
            pieces.append(rows.values[:, column].copy())

    def recording(self, time_unit: str | None, rate: float | None) -> Recording:
        if self.layout is None:
            raise UserError(
                "the table has no line of column names"
                if self.form.header_line is None
                else f"the file has no line {self.form.header_line}, which header_line declares as the line of column names",
                where=str(self.path),
                remedy="write the names of the columns above the numbers"
                if self.form.header_line is None
                else self.form.remedy_setting("header_line", "LINE", "specify the number of the line of column names"),
            )
        if not self.rows:
            raise UserError("the table has no numbers", where=str(self.path), remedy="export the test data again")
        layout = self.layout
        units = [layout.units[column] for column in layout.columns]
        joined = []
        for pieces in self.pieces:
            joined.append(np.concatenate(pieces))
            pieces.clear()
        signals = list(zip(joined, units, strict=True))
        if rate is not None:
            signals.insert(0, signals[0])
        else:
            check_no_counter(signals[0][0], layout.names[layout.columns[0]], signals[0][1], layout.where)
            if self.clock.started:
                signals[0], time_unit = (signals[0][0], "s"), None
        lines = np.array(self.runs, dtype=np.int64).reshape(-1, 2)
        return recording_of(signals, self.channels, self.path, layout.where, time_unit, rate, lines)


@dataclass(frozen=True)
class Header:
    """form: format of the table; units: of the columns after the first, "" if missing."""

    form: TextFormat
    units: tuple[str, ...]

    def applied(self, layout: Layout) -> Layout:
        """Layout with the units of the header, without the column of remarks."""
        remarks = layout.names[-1] == "Comment" and len(layout.names) - 1 not in layout.columns
        count = len(layout.names) - remarks
        units_in_header = (None, *(unit or None for unit in self.units))
        units = [
            column_unit or (units_in_header[i] if i < len(units_in_header) else None)
            for i, column_unit in enumerate(layout.units[:count])
        ]
        return replace(layout, names=layout.names[:count], units=tuple(units), remarks=remarks)


def header_of(block: bytes, form: TextFormat, path: str) -> Header:
    """LabVIEW header of a file, which defines delimiter and decimal mark. Raises UserError if it has no end, and if times are
    omitted or separate for every channel."""
    lines = [decode(line).rstrip() for line in block.split(b"\n", _LONGEST)[:_LONGEST]]
    ends = [number for number, line in enumerate(lines, start=1) if line.startswith(_END)]
    if len(ends) < 2:
        raise UserError(
            f"the LabVIEW measurement file does not have two lines {_END}",
            where=path,
            remedy="the file is truncated or damaged: export the test data again",
        )
    mark = "," if any(line.lower().startswith("separator,") for line in lines[: ends[0]]) else "\t"
    entries = {}
    for number, line in enumerate(lines[: ends[1]], start=1):
        word, _, rest = line.partition(mark)
        entries[word] = (number, rest)
    number, columns = entries.get("X_Columns", (1, "One"))
    if columns.strip() not in ("One", ""):
        raise UserError(
            f"X_Columns is {quote(columns)}: "
            + ("times are not written" if columns.strip() == "No" else "every channel has a separate time"),
            where=f"{path}:{number}",
            remedy="export the file from LabVIEW with one column of times (X value columns: one column only)",
        )
    decimal = entries.get("Decimal_Separator", (0, form.decimal))[1].strip() or "."
    first = form.header_line or next((n for n in range(ends[1], len(lines)) if lines[n].strip()), ends[1]) + 1
    units = tuple(cell.strip() for cell in entries.get("Y_Unit_Label", (0, ""))[1].split(mark))
    return Header(replace(form, delimiter=mark, decimal=decimal, header_line=first, comment=""), units)
