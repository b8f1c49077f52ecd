"""Rows of numbers in a block of a text table."""

from __future__ import annotations

import re
from array import array
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strainsight.errors import UserError
from strainsight.measurements.csv_layout import Layout, TextFormat, is_comment, split
from strainsight.measurements.records import decoded, plain

_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?|[+-]?\d+,\d*")

_SEGMENT = "the line was cut short, or another segment begins here: export one segment a file"
_COUNTED = "give the time as a number, counted from any instant, not as a date or the time of the day"
_DATE = re.compile(r"\d[:/]\d|\d\.\d+\.\d")
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:\.\d{3})+(?:,\d*)?")


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
    if len(values) != len(ends) or not np.isfinite(values[:, 0]).all() or np.isinf(values).any():
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


def rows_by_line(block: bytes, first: int, layout: Layout, form: TextFormat, path: Path) -> Rows:
    """A block line by line: quotes, comments, blank lines, words for missing samples, and every fault with its line."""
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
        row = [_number(cells[column], column, layout, form, where) for column in layout.columns]
        if row[0] != row[0]:
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


def _number(cell: str, column: int, layout: Layout, form: TextFormat, where: str) -> float:
    if not cell or cell in form.missing or cell.lower().lstrip("+-") == "nan":
        return float("nan")
    text, name = cell, layout.names[column]
    if form.decimal == ",":
        text = "no number" if "." in cell else cell.replace(",", ".")
    try:
        value = float(text) if "_" not in text else float("no number")
    except ValueError:
        if form.decimal == "." and _DECIMAL_COMMA.fullmatch(cell):
            remedy = "write points as decimal marks, or " + form.stating(
                "decimal", '","', "say that the decimal mark is the comma"
            )
        elif column == layout.columns[0] and _DATE.search(cell):
            remedy = _COUNTED
        elif form.decimal == "," and _THOUSANDS.fullmatch(cell):
            remedy = "export numbers without points between the thousands"
        elif form.decimal == "," and "." in cell:
            remedy = "the decimal mark is stated to be the comma: correct the number, or " + form.stating(
                "decimal", '"."', "the statement"
            )
        elif column == layout.columns[0] and layout.remarks:
            remedy = _SEGMENT
        elif column == layout.columns[0]:
            remedy = _COUNTED
            if form.key and cell[0].isalpha():
                begin = "".join(sign for sign in cell[:20] if sign.isprintable() and sign not in '`"\\')
                remedy += (
                    f'; a line of text below the names is passed over by its beginning: `{form.key}.comment: "{begin}"`'
                )
        else:
            remedy = (
                "give a number, or an empty cell where the sample is missing; where the word stands for that, "
                + form.stating("missing", f"[{_word(cell)}]", "name it as one for missing samples")
            )
        raise UserError(f"{plain(cell)} under {name!r} is no number", where=where, remedy=remedy) from None
    if not np.isfinite(value):
        raise UserError(
            f"{plain(cell)} under {name!r} is no finite number",
            where=where,
            remedy="leave the cell empty where the sample is missing",
        )
    return value


def _word(cell: str) -> str:
    """The cell as an entry of a YAML list, where it is a plain word."""
    return cell if cell.isalnum() and len(cell) < 20 else "WORD"
