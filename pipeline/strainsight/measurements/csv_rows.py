"""Rows of numbers in a block of a text table."""

from __future__ import annotations

import re
from array import array
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strainsight.errors import UserError
from strainsight.measurements.clock import ClockTimes
from strainsight.measurements.csv_layout import Layout, TextFormat, is_comment, split
from strainsight.measurements.records import Recording, decoded, plain

_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?|[+-]?\d+,\d*")

_SEGMENT = "the line was cut short, or another segment begins here: export one segment a file"
_COUNTED = "write the time in seconds, or as a clock time: 10:00:00.01, 2024-05-03 10:00:00.01"
_DATE = re.compile(r"\d[:/]\d|\d\.\d+\.\d")
_DIGIT = re.compile(r"\d")
_SIGN_APART = re.compile(r"([+-])\s+(?=[\d.,])")
_GROUPED = re.compile(r"[+-]?\d{1,3}(?:(?P<mark>[,.'’ \u00a0\u202f])\d{3})(?:(?P=mark)\d{3})*(?P<rest>[.,]\d*)?")
"""Digits in groups of three, as thousands are marked."""


@dataclass(frozen=True)
class Rows:
    """Values (rows, columns), and the line of every row, or of the first where they are neighbours."""

    values: np.ndarray
    lines: np.ndarray


def plain_rows(block: bytes, first: int, layout: Layout, form: TextFormat) -> Rows | None:
    """A block in which every line is a full row of plain numbers or empty cells, or None where it is not."""
    mark = layout.delimiter.encode()
    if b'"' in block:
        block = _unquoted(block, mark)
    odd = ['"', *form.missing, form.comment, "." if form.decimal == "," else ""]
    if any(sign and sign.encode() in block for sign in odd):
        return None
    signs = np.frombuffer(block, np.uint8)
    ends = np.flatnonzero(signs == ord("\n"))
    marks = np.flatnonzero(signs == mark[0])
    if np.any(np.diff(np.searchsorted(marks, ends), prepend=0) != len(layout.names) - 1):
        return None
    if form.decimal == ",":
        block = block.replace(b",", b".")
    # Twice: of three marks in a row the first pass fills one cell of the two.
    for _ in range(2):
        block = block.replace(mark + mark, mark + b"nan" + mark)
    block = block.replace(b"\n" + mark, b"\nnan" + mark).replace(mark + b"\n", mark + b"nan\n")
    try:
        values = np.loadtxt(
            block.decode("latin-1").split("\n")[:-1],
            delimiter=layout.delimiter,
            usecols=layout.columns,
            comments=None,
            ndmin=2,
        )
    except ValueError:
        return None
    if len(values) != len(ends) or np.isinf(values).any() or (layout.timed and np.isnan(values[:, 0]).any()):
        return None
    return Rows(values, first + np.arange(len(values)))


def _unquoted(block: bytes, mark: bytes) -> bytes:
    """The block without its quotes, where each pair stands around a whole cell that holds neither a delimiter nor a quote."""
    signs = np.frombuffer(block, np.uint8)
    quotes = np.flatnonzero(signs == ord('"'))
    edge = (signs == mark[0]) | (signs == ord("\n"))
    if len(quotes) % 2:
        return block
    opened, closed = quotes[::2], quotes[1::2]
    within = np.diff(np.searchsorted(np.flatnonzero(edge), quotes))[::2]
    whole = (opened == 0) | edge[opened - 1]
    return block.replace(b'"', b"") if whole.all() and edge[closed + 1].all() and not within.any() else block


def rows_by_line(
    block: bytes, first: int, layout: Layout, form: TextFormat, path: Path, clock: ClockTimes | None = None
) -> Rows:
    """A block line by line: quotes, comments, blank lines, clock times, words for missing samples, and every fault with its
    line; clock: of the blocks before."""
    clock = clock or ClockTimes()
    found, lines = array("d"), array("q")
    for number, line in enumerate(block.removesuffix(b"\n").split(b"\n"), start=first):
        if not line.strip(b" ") or is_comment(line, form):
            continue
        where = f"{path}:{number}"
        cells = _cells(line, layout, where)
        if not any(cells):
            continue
        if len(cells) == len(layout.names) + 1 and (layout.remarks or not (cells[-1] or layout.delimiter == ",")):
            cells.pop()
        if len(cells) != len(layout.names):
            raise UserError(
                f"{len(cells)} cells where the names are {len(layout.names)}: {plain(decoded(line))}",
                where=where,
                remedy=_why(len(cells), layout),
            )
        row = [
            _time(cells[column], layout, form, where, clock)
            if column == layout.time_column
            else _number(cells[column], column, layout, form, where)
            for column in layout.columns
        ]
        if layout.timed and row[0] != row[0]:
            raise UserError(
                f"a sample without time: {plain(decoded(line))}", where=where, remedy="give its time, or drop the line"
            )
        found.extend(row)
        lines.append(number)
    return Rows(np.frombuffer(found, float).reshape(len(lines), len(layout.columns)), np.frombuffer(lines, np.int64))


def _why(count: int, layout: Layout) -> str:
    if layout.delimiter == "," and count > len(layout.names):
        return "numbers with a decimal comma need another delimiter: write the file with ';'"
    if layout.remarks:
        return _SEGMENT
    return "the line was cut short or altered: export the test data again"


def _cells(line: bytes, layout: Layout, where: str) -> list[str]:
    text = decoded(line)
    if '"' not in text:
        return [cell.strip() for cell in text.split(layout.delimiter)]
    return [cell.strip() for cell in split(text, layout.delimiter, where)]


def _time(cell: str, layout: Layout, form: TextFormat, where: str, clock: ClockTimes) -> float:
    """Of a number as it stands, of a clock time [s] since the first."""
    if ":" not in cell and not clock.started:
        return _number(cell, layout.columns[0], layout, form, where)
    if (seconds := clock.seconds(cell)) is not None:
        return seconds
    raise UserError(
        f"{plain(cell)} under {layout.names[layout.columns[0]]!r} is no "
        + ("time that follows the lines before" if clock.started else "number and no clock time"),
        where=where,
        remedy=_COUNTED,
    )


def _number(cell: str, column: int, layout: Layout, form: TextFormat, where: str) -> float:
    if not cell or cell in form.missing or cell.lower().lstrip("+-") == "nan":
        return float("nan")
    name = layout.names[column]
    if (value := _value(cell, form.decimal)) is None:
        raise UserError(
            f"{plain(cell)} under {name!r} is no number", where=where, remedy=_no_number(cell, column, layout, form)
        )
    if not np.isfinite(value):
        raise UserError(
            f"{plain(cell)} under {name!r} is no finite number",
            where=where,
            remedy="leave the cell empty where the sample is missing",
        )
    return value


def _value(cell: str, decimal: str) -> float | None:
    """Of a number as loggers write it: "+ 0.081", "1,234.5" where the point is the decimal mark; None of what is none."""
    for text in (cell, _without_thousands(_SIGN_APART.sub(r"\1", cell), decimal)):
        if "_" not in text and not (decimal == "," and "." in text):
            with suppress(ValueError):
                return float(text.replace(",", ".") if decimal == "," else text)
    return None


def _without_thousands(text: str, decimal: str) -> str:
    """Without the marks of thousands where a decimal mark behind them says that they are."""
    grouped = _GROUPED.fullmatch(text)
    if grouped and (grouped["rest"] or "")[:1] == decimal != grouped["mark"]:
        return text.replace(grouped["mark"], "")
    return text


def _no_number(cell: str, column: int, layout: Layout, form: TextFormat) -> str:
    """What to do about a cell that is no number."""
    if grouped := _GROUPED.fullmatch(cell):
        remedy = f"{plain(grouped['mark'])} marks thousands or decimals: export numbers without marks between thousands"
        if "," in (grouped["mark"], (grouped["rest"] or "")[:1]) and form.decimal == ".":
            return f"{remedy}, or " + form.stating("decimal", '","', "say that the decimal mark is the comma")
        return remedy
    if form.decimal == "." and _DECIMAL_COMMA.fullmatch(cell):
        return "write points as decimal marks, or " + form.stating(
            "decimal", '","', "say that the decimal mark is the comma"
        )
    if column == layout.time_column and _DATE.search(cell):
        return _COUNTED
    if form.decimal == "," and "." in cell:
        return "the decimal mark is stated to be the comma: correct the number, or " + form.stating(
            "decimal", '"."', "the statement"
        )
    if column == layout.time_column and layout.remarks:
        return _SEGMENT
    if column == layout.time_column:
        if not (form.key and cell[0].isalpha()):
            return _COUNTED
        begin = "".join(sign for sign in cell[:20] if sign.isprintable() and sign not in '`"\\')
        return f'{_COUNTED}; a line of text below the names is passed over by its beginning: `{form.key}.comment: "{begin}"`'
    if not cell[0].isalpha() and _DIGIT.search(cell):
        return "write plain numbers: digits, sign, decimal mark and exponent (1.5e-3), without a unit"
    return (
        "give a number, or an empty cell where the sample is missing; where the word stands for that, "
        + form.stating("missing", f"[{_word(cell)}]", "name it as one for missing samples")
    )


def _word(cell: str) -> str:
    """The cell as an entry of a YAML list, where it is a plain word."""
    return cell if cell.isalnum() and len(cell) < 20 else "WORD"


MARKS = np.array(
    [999, 999.25, 999.99, 9999, 9999.99, 99999, 99999.99, 999999, 9999999, 9.96920996838687e36], dtype=float
)
"""What a logger puts where it has no sample, of either sign."""
LEAST = -32768.0
"""The least whole number of 16 bits."""
BEYOND = 1e20
"""No reading of anything: 1e20, 1e30, 1e38."""
ROUNDING = 1e-5
"""Of itself: as of 9.96921e36, or of a number in single precision."""
OUTSIDE, JUMPS = 0.5, 3.0
"""A mark is beyond the others by this share of their range; or it jumps from a neighbour by so many times their largest step."""


def check_marks(recording: Recording, name: str, unit: str, remedy: str = "", negative: bool = False) -> None:
    """Raises UserError, at its line, for a channel with samples that are a mark of a missing value: the very number, far beyond
    all others, or between neighbours from which it jumps. negative: of the positive ones only those that no reading reaches."""
    values = recording.channels[name]
    for mark in np.unique(values[_marks(values, negative)]):
        at = np.flatnonzero(values == mark)
        others = values[np.isfinite(values) & ~_marks(values, False)]
        if not len(others) or not _apart(values, float(mark), at, others):
            continue
        raise UserError(
            f"{name!r} reads {mark:g} {unit} in {len(at)} of {len(values)} samples, and {others.min():.4g} to "
            f"{others.max():.4g} in others: it stands for a missing value",
            where=recording.place(int(at[0])),
            remedy=remedy
            or f'name it as the file writes it, `text: {{missing: ["{mark:g}"]}}`, or leave the samples empty (NaN)',
        )


def _marks(values: np.ndarray, negative: bool) -> np.ndarray:
    """Which samples are the very number."""
    size = np.abs(values)
    nines = (np.abs(size[:, None] / MARKS - 1) < ROUNDING).any(axis=1) & ((values < 0) | (not negative))
    return nines | (values == LEAST) | (size >= BEYOND)


def _apart(values: np.ndarray, mark: float, at: np.ndarray, others: np.ndarray) -> bool:
    if max(mark - others.max(), others.min() - mark) > OUTSIDE * (others.max() - others.min()):
        return True
    there = np.where(_marks(values, False), np.nan, values)
    steps = np.abs(np.diff(there))
    largest = np.nanmax(steps, initial=0.0) if np.isfinite(steps).any() else 0.0
    beside = np.concatenate([there[at[at > 0] - 1], there[at[at < len(there) - 1] + 1]])
    beside = beside[np.isfinite(beside)]
    return bool(np.any(np.abs(beside - mark) > JUMPS * largest))
