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
from strainsight.measurements.records import Recording, decode, quote

_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?|[+-]?\d+,\d*")

_SEGMENT = "the line is truncated, or a new table (segment of the recording) begins here: export one segment per file"
_COUNTED = "write the time in seconds, or as clock time: 10:00:00.01, 2024-05-03 10:00:00.01"
_DATE = re.compile(r"\d[:/]\d|\d\.\d+\.\d")
_DIGIT = re.compile(r"\d")
_SIGN_APART = re.compile(r"([+-])\s+(?=[\d.,])")
_GROUPED = re.compile(r"[+-]?\d{1,3}(?:(?P<mark>[,.'’ \u00a0\u202f])\d{3})(?:(?P=mark)\d{3})*(?P<rest>[.,]\d*)?")
"""Digits in groups of three, with thousands separators."""


@dataclass(frozen=True)
class Rows:
    """Values (rows, columns), and the line of every row, or of the first row if they are consecutive."""

    values: np.ndarray
    lines: np.ndarray


def plain_rows(block: bytes, first: int, layout: Layout, form: TextFormat) -> Rows | None:
    """A block in which every line is a full row of plain numbers or empty cells, or else None."""
    mark = layout.delimiter.encode()
    if b'"' in block:
        block = _remove_quotes(block, mark)
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
    # Twice: the first pass fills only one of two cells between three delimiters.
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


def _remove_quotes(block: bytes, mark: bytes) -> bytes:
    """The block without quotes, if each pair encloses a whole cell without delimiter and quote."""
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
    """Read a block line by line: quotes, comments, blank lines, clock times, words for missing samples, and errors
    with their line; clock: of the previous blocks."""
    clock = clock or ClockTimes()
    numbers, lines = array("d"), array("q")
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
                f"the line {quote(decode(line))} has {len(cells)} cells, but the table has {len(layout.names)} columns",
                where=where,
                remedy=_remedy_for_count(len(cells), layout),
            )
        row = [
            _time(cells[column], layout, form, where, clock)
            if column == layout.time_column
            else _number(cells[column], column, layout, form, where)
            for column in layout.columns
        ]
        if layout.timed and row[0] != row[0]:
            raise UserError(
                f"the sample has no time: {quote(decode(line))}", where=where, remedy="add the time of this sample"
            )
        numbers.extend(row)
        lines.append(number)
    return Rows(np.frombuffer(numbers, float).reshape(len(lines), len(layout.columns)), np.frombuffer(lines, np.int64))


def _remedy_for_count(count: int, layout: Layout) -> str:
    if layout.delimiter == "," and count > len(layout.names):
        return "numbers with a decimal comma need another delimiter: export the file with ';' between the columns"
    if layout.remarks:
        return _SEGMENT
    return "the line is truncated or damaged: export the test data again"


def _cells(line: bytes, layout: Layout, where: str) -> list[str]:
    text = decode(line)
    if '"' not in text:
        return [cell.strip() for cell in text.split(layout.delimiter)]
    return [cell.strip() for cell in split(text, layout.delimiter, where)]


def _time(cell: str, layout: Layout, form: TextFormat, where: str, clock: ClockTimes) -> float:
    """A number unchanged, or a clock time in seconds since the first."""
    if ":" not in cell and not clock.started:
        return _number(cell, layout.columns[0], layout, form, where)
    if (seconds := clock.seconds(cell)) is not None:
        return seconds
    raise UserError(
        f"{quote(cell)} in column {layout.names[layout.columns[0]]!r} is not a "
        + ("clock time later than that of the previous line" if clock.started else "number or clock time"),
        where=where,
        remedy=_COUNTED,
    )


def _number(cell: str, column: int, layout: Layout, form: TextFormat, where: str) -> float:
    if not cell or cell in form.missing or cell.lower().lstrip("+-") == "nan":
        return float("nan")
    name = layout.names[column]
    if (value := _value(cell, form.decimal)) is None:
        raise UserError(
            f"{quote(cell)} in column {name!r} is not a number",
            where=where,
            remedy=_remedy_for_cell(cell, column, layout, form),
        )
    if not np.isfinite(value):
        raise UserError(
            f"{quote(cell)} in column {name!r} is not a finite number",
            where=where,
            remedy="leave the cell empty for missing samples",
        )
    return value


def _value(cell: str, decimal: str) -> float | None:
    """Number in the format of loggers: "+ 0.081", "1,234.5" with a decimal point; None if it is not a number."""
    for text in (cell, _without_thousands(_SIGN_APART.sub(r"\1", cell), decimal)):
        if "_" not in text and not (decimal == "," and "." in text):
            with suppress(ValueError):
                return float(text.replace(",", ".") if decimal == "," else text)
    return None


def _without_thousands(text: str, decimal: str) -> str:
    """Text without thousands separators, if a decimal mark after them identifies them."""
    grouped = _GROUPED.fullmatch(text)
    if grouped and (grouped["rest"] or "")[:1] == decimal != grouped["mark"]:
        return text.replace(grouped["mark"], "")
    return text


def _remedy_for_cell(cell: str, column: int, layout: Layout, form: TextFormat) -> str:
    """Remedy for a cell that is not a number."""
    if grouped := _GROUPED.fullmatch(cell):
        remedy = (
            f"{quote(grouped['mark'])} may be a thousands separator or a decimal mark: export numbers without "
            "thousands separators"
        )
        if "," in (grouped["mark"], (grouped["rest"] or "")[:1]) and form.decimal == ".":
            return f"{remedy}, or " + form.remedy_setting("decimal", '","', "set the decimal mark to the comma")
        return remedy
    if form.decimal == "." and _DECIMAL_COMMA.fullmatch(cell):
        return "use decimal points, or " + form.remedy_setting("decimal", '","', "set the decimal mark to the comma")
    if column == layout.time_column and _DATE.search(cell):
        return _COUNTED
    if form.decimal == "," and "." in cell:
        return "the decimal mark is set to the comma: correct the number, or " + form.remedy_setting(
            "decimal", '"."', "correct the decimal mark"
        )
    if column == layout.time_column and layout.remarks:
        return _SEGMENT
    if column == layout.time_column:
        if not (form.key and cell[0].isalpha()):
            return _COUNTED
        begin = "".join(sign for sign in cell[:20] if sign.isprintable() and sign not in '`"\\')
        return f'{_COUNTED}; to skip text lines below the column names, set their beginning: `{form.key}.comment: "{begin}"`'
    if not cell[0].isalpha() and _DIGIT.search(cell):
        return "write plain numbers with digits, sign, decimal mark and exponent (1.5e-3), without a unit"
    word = cell if cell.isalnum() and len(cell) < 20 else "WORD"  # as an entry of a YAML list
    return (
        "write a number, or leave the cell empty for a missing sample; if the word marks missing samples, "
        + form.remedy_setting("missing", f"[{word}]", "declare it as a word for missing samples")
    )


MARKS = np.array(
    [999, 999.25, 999.99, 9999, 9999.99, 99999, 99999.99, 999999, 9999999, 9.96920996838687e36], dtype=float
)
"""Numbers of either sign that loggers write for missing samples."""
LEAST = -32768.0
"""Smallest 16-bit integer."""
BEYOND = 1e20
"""Impossible values: 1e20, 1e30, 1e38."""
ROUNDING = 1e-5
"""Relative rounding error, as of 9.96921e36 or of single precision."""
OUTSIDE, JUMPS = 0.5, 3.0
"""A marker must be outside the other values by this share of their range, or differ from a neighbour by so many
times their largest step."""


def check_marks(recording: Recording, name: str, unit: str, remedy: str = "", negative: bool = False) -> None:
    """Raise UserError, with its line, for a channel with samples that mark missing values: a marker number far
    outside all others, or far from its neighbours. negative: of positive markers, check only impossible values."""
    values = recording.channels[name]
    for mark in np.unique(values[_marks(values, negative)]):
        at = np.flatnonzero(values == mark)
        others = values[np.isfinite(values) & ~_marks(values, False)]
        if not len(others) or not _is_distinct(values, float(mark), at, others):
            continue
        raise UserError(
            f"channel {name!r} has the value {mark:g} {unit} in {len(at)} of {len(values)} samples, but "
            f"{others.min():.4g} to {others.max():.4g} in the other samples: this value marks missing samples",
            where=recording.place(int(at[0])),
            remedy=remedy
            or f'set `text: {{missing: ["{mark:g}"]}}` with this value as written in the file, or leave the samples '
            "empty (NaN)",
        )


def _marks(values: np.ndarray, negative: bool) -> np.ndarray:
    """Whether each sample equals a marker."""
    size = np.abs(values)
    nines = (np.abs(size[:, None] / MARKS - 1) < ROUNDING).any(axis=1) & ((values < 0) | (not negative))
    return nines | (values == LEAST) | (size >= BEYOND)


def _is_distinct(values: np.ndarray, mark: float, at: np.ndarray, others: np.ndarray) -> bool:
    if max(mark - others.max(), others.min() - mark) > OUTSIDE * (others.max() - others.min()):
        return True
    valid = np.where(_marks(values, False), np.nan, values)
    steps = np.abs(np.diff(valid))
    largest = np.nanmax(steps, initial=0.0) if np.isfinite(steps).any() else 0.0
    neighbours = np.concatenate([valid[at[at > 0] - 1], valid[at[at < len(valid) - 1] + 1]])
    neighbours = neighbours[np.isfinite(neighbours)]
    return bool(np.any(np.abs(neighbours - mark) > JUMPS * largest))
