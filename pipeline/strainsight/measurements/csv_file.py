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
from strainsight.measurements.records import Recording, decoded, opened, plain

BLOCK = 1 << 22
"""[bytes] read at a time."""
LONGEST = 1 << 20
"""[bytes] of a line: beyond, it is no table."""
MOST_ABOVE = 500
"""Lines that are searched for the names."""
_UTF16 = (b"\xff\xfe", b"\xfe\xff")
SIGN = b"LabVIEW Measurement"
_END = "***End_of_Header***"
_LONGEST = 1000
"""Lines of a header."""


def read_csv(
    path: Path,
    channels: Sequence[str],
    *,
    time: str | None = None,
    time_unit: str | None = None,
    rate: float | None = None,
    form: TextFormat | None = None,
) -> Recording:
    """Columns of a text table: a line of names, maybe a line of units below it, numbers from there on.

    channels: names of the header, with or without the unit behind them in brackets; time: that of the clock, whose cells are
    numbers or clock times; or rate: samples per second [Hz]. Only these columns have to be numbers. An empty cell or NaN is a
    missing sample, except in the time. Lines that are empty, or comments, are passed over; line ends of every system, UTF-8 with
    or without mark, or the code page 1252.
    Raises UserError with file:line where a line does not fit.
    """
    form = form or TextFormat()
    path = Path(path)
    with opened(path) as file:
        table = _Table(path, form, time, tuple(channels))
        for first, block in _blocks(file, path):
            try:
                table.take(first, block)
            except UserError as error:
                if table.layout is None and table.form.header_line is None and not block.startswith(SIGN):
                    _name_the_line(error, block, first, table)
                raise
    return table.recording(time_unit, rate)


def _blocks(file: BinaryIO, path: Path) -> Iterator[tuple[int, bytes]]:
    """Blocks of whole lines that end in \\n, and the number of the first line of each."""
    number, rest, start = 1, b"", True
    while block := file.read(BLOCK):
        if start and block[:2] in _UTF16:
            raise UserError("a file in UTF-16", where=str(path), remedy="save it in UTF-8")
        block = rest + (block.removeprefix(b"\xef\xbb\xbf") if start else block)
        start = False
        # A \r at the very end may be half of \r\n.
        cut = max(block.rfind(b"\n"), block.rfind(b"\r", 0, -1)) + 1
        lines, rest = _checked(block[:cut], number, path), block[cut:]
        if lines:
            yield number, lines
            number += lines.count(b"\n")
        if len(rest) > LONGEST:
            _checked(rest, number, path)
            raise UserError("a line of over 1 MiB", where=f"{path}:{number}", remedy="the file is no text table")
    if rest.strip():
        yield number, _checked(rest + b"\n", number, path)


def _checked(lines: bytes, number: int, path: Path) -> bytes:
    lines = lines.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if (at := lines.find(b"\0")) >= 0:
        line = number + lines[:at].count(b"\n")
        raise UserError(
            "a binary file, not a text table",
            where=f"{path}:{line}",
            remedy="export the test data as text, HDF5 or UFF58",
        )
    return lines


def _name_the_line(error: UserError, block: bytes, first: int, table: _Table) -> None:
    """Say in the remedy which line has the names that are wanted, or at least that of the time, if one near the top has."""
    for wanted in dict.fromkeys((table.channels, () if table.time else table.channels[:1])):
        for number, line in enumerate(block.split(b"\n", MOST_ABOVE)[:MOST_ABOVE], start=first):
            try:
                header(line, "", table.form, table.time, wanted)
            except UserError:
                continue
            if f"{table.path}:{number}" == error.where:
                return
            form = table.form
            error.remedy = f"line {number} has the name {plain(table.time or table.channels[0])}: " + form.stating(
                "header_line", str(number), "say that the names stand there"
            )
            return


class _Table:
    """The columns asked for, block by block."""

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
        """Is it the first line below names and units? Takes in names and units on the way."""
        where, form = f"{self.path}:{number}", self.form
        if self.layout is None:
            if form.header_line is not None:
                if number == form.header_line:
                    found = header(line, where, form, self.time, self.channels)
                    self.layout = self.lvm.applied(found) if self.lvm else found
            elif number == 1 and (said := stated_delimiter(line)) and form.delimiter in (None, said):
                self.form = replace(form, delimiter=said)
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
                "no line of names"
                if self.form.header_line is None
                else f"the file has no line {self.form.header_line}",
                where=str(self.path),
                remedy="write the names of the columns above the numbers",
            )
        if not self.rows:
            raise UserError("no line of numbers", where=str(self.path), remedy="export the test data again")
        layout = self.layout
        units = [layout.units[column] for column in layout.columns]
        joined = []
        for pieces in self.pieces:
            joined.append(np.concatenate(pieces))
            pieces.clear()
        found = list(zip(joined, units, strict=True))
        if rate is not None:
            found.insert(0, found[0])
        else:
            check_no_counter(found[0][0], layout.names[layout.columns[0]], found[0][1], layout.where)
            if self.clock.started:
                found[0], time_unit = (found[0][0], "s"), None
        lines = np.array(self.runs, dtype=np.int64).reshape(-1, 2)
        return recording_of(found, self.channels, self.path, layout.where, time_unit, rate, lines)


@dataclass(frozen=True)
class Header:
    """form: how the table is written; units: of the columns behind the first, "" where none is stated."""

    form: TextFormat
    units: tuple[str, ...]

    def applied(self, layout: Layout) -> Layout:
        """The layout with the units of the header, and without the column of remarks."""
        remarks = layout.names[-1] == "Comment" and len(layout.names) - 1 not in layout.columns
        count = len(layout.names) - remarks
        stated = (None, *(unit or None for unit in self.units))
        units = [own or (stated[i] if i < len(stated) else None) for i, own in enumerate(layout.units[:count])]
        return replace(layout, names=layout.names[:count], units=tuple(units), remarks=remarks)


def header_of(block: bytes, form: TextFormat, path: str) -> Header:
    """The header that a file begins with; its delimiter and decimal mark are those of the file.

    Raises UserError where it has no end, or says that the times are left out or that every channel has its own.
    """
    lines = [decoded(line).rstrip() for line in block.split(b"\n", _LONGEST)[:_LONGEST]]
    ends = [number for number, line in enumerate(lines, start=1) if line.startswith(_END)]
    if len(ends) < 2:
        raise UserError(
            f"a LabVIEW measurement file without two lines {_END}",
            where=path,
            remedy="export the test data again: it was cut short or altered",
        )
    mark = "," if any(line.lower().startswith("separator,") for line in lines[: ends[0]]) else "\t"
    said = {}
    for number, line in enumerate(lines[: ends[1]], start=1):
        word, _, rest = line.partition(mark)
        said[word] = (number, rest)
    number, columns = said.get("X_Columns", (1, "One"))
    if columns.strip() not in ("One", ""):
        raise UserError(
            f"X_Columns is {plain(columns)}: "
            + ("no times are written" if columns.strip() == "No" else "a time for every channel"),
            where=f"{path}:{number}",
            remedy="write the file with one column of times (X value columns: one column only)",
        )
    decimal = said.get("Decimal_Separator", (0, form.decimal))[1].strip() or "."
    first = form.header_line or next((n for n in range(ends[1], len(lines)) if lines[n].strip()), ends[1]) + 1
    units = tuple(cell.strip() for cell in said.get("Y_Unit_Label", (0, ""))[1].split(mark))
    return Header(replace(form, delimiter=mark, decimal=decimal, header_line=first, comment=""), units)
