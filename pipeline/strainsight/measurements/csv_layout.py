"""Columns of a text table: delimiter, names, units."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from strainsight.errors import UserError, did_you_mean
from strainsight.measurements.records import decode, known_unit, quote, seconds_in, spelling
from strainsight.text import plain_cell

DELIMITERS = (",", ";", "\t")
_QUOTED = re.compile(r'"[^"]*"')
_BRACKETS = re.compile(r"(.*\S)\s*(\[[^\[\]]*\]|\([^()]*\))")
_NUMBERS = re.compile(r'[-+\s0-9.,;eE"]*[0-9][-+\s0-9.,;eE"]*')
NO_TIME = "; if none of them is the time, specify the sampling rate instead: `time: {rate: 100, unit: Hz}`"
_DIGIT = re.compile(r"\d")
_SPREADSHEET = re.compile(r"sep=(.)")


@dataclass(frozen=True)
class TextFormat:
    """Format of a text table; None if it is detected.

    delimiter: one character; decimal: "." or ","; comment: beginning of lines to skip; header_line: line of the
    names, from 1, if other text is above them; missing: words for missing samples, in addition to an empty cell and
    NaN; key: config key of these settings, for remedies."""

    delimiter: str | None = None
    decimal: str = "."
    comment: str = "#"
    header_line: int | None = None
    missing: tuple[str, ...] = ()
    key: str | None = None

    def __post_init__(self) -> None:
        if self.delimiter == self.decimal:
            raise UserError(
                "the comma cannot be both delimiter and decimal mark",
                remedy="export the file with ';' between the columns, and set `delimiter: \";\"`",
            )

    def remedy_setting(self, name: str, value: str, otherwise: str) -> str:
        """Remedy that sets a config key, or, without a key, other words."""
        return f"set `{self.key}.{name}: {value}`" if self.key else otherwise


@dataclass(frozen=True)
class Layout:
    """delimiter; names as in the header without brackets; units, None if missing; columns: time, then channels;
    timed: whether the first column is the time; remarks: a line may end with an additional cell."""

    delimiter: str
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    columns: tuple[int, ...]
    where: str
    timed: bool = True
    remarks: bool = False

    @property
    def time_column(self) -> int | None:
        return self.columns[0] if self.timed else None


def is_comment(line: bytes, form: TextFormat) -> bool:
    return bool(form.comment) and line.lstrip().startswith(form.comment.encode())


def stated_delimiter(line: bytes) -> str | None:
    """Delimiter in the first line of a spreadsheet export, sep=;"""
    match = _SPREADSHEET.fullmatch(decode(line).strip(' "'))
    return match[1] if match else None


def header(line: bytes, where: str, form: TextFormat, time: str | None, channels: Sequence[str]) -> Layout:
    """Layout from the line of names; time: name of the time column, None for a table without time.

    The delimiter is the only one of `, ; tab` outside quotes; it must be set if the line has two of them. Raises
    UserError if there is no delimiter, and for missing or repeated names."""
    text = decode(line)
    if form.comment and text.lstrip().startswith(form.comment):
        text = text.lstrip().removeprefix(form.comment)
    delimiter = form.delimiter or ("" if _NUMBERS.fullmatch(text) else _delimiter(text, where, form, time is None))
    cells = [plain_cell(cell.strip()) for cell in split(text, delimiter, where)] if delimiter else []
    if all(_number_like(cell) for cell in cells):
        raise UserError(
            f"the columns have no names: the first line is {quote(text)}",
            where=where,
            remedy="write a line of column names above the numbers, or "
            + form.remedy_setting("header_line", "LINE", "specify the number of this line"),
        )
    names, units = zip(*(_name_and_unit(cell, time) for cell in cells), strict=True)
    columns = [_column(name, cells, names, where) for name in channels]
    if time is not None:
        columns.insert(0, _column(time, cells, names, where, NO_TIME))
    return Layout(delimiter, names, units, tuple(columns), where, time is not None)


def with_units(line: bytes, where: str, layout: Layout) -> Layout | None:
    """Layout with the units of a line of units, or None if the line is not one: its time cell is neither a unit of
    time, nor has it no digits and known units in the other cells."""
    try:
        cells = [cell.strip() for cell in split(decode(line), layout.delimiter, where)]
    except UserError:
        return None
    read = [cells[column] if column < len(cells) else None for column in layout.columns]
    time, others = (read[0], read[1:]) if layout.timed else ("", read)
    numbers = all(_number_like(cell or "") for cell in others)
    known = all(map(known_unit, others)) and not (numbers or _DIGIT.search(time or ""))
    if time is None or (seconds_in(time) is None and not known):
        return None
    if len(cells) != len(layout.names):
        raise UserError(
            f"the line of units has {len(cells)} cells, but the table has {len(layout.names)} columns",
            where=where,
            remedy="write a unit, or an empty cell, for every column",
        )
    units = []
    for name, above, cell in zip(layout.names, layout.units, cells, strict=True):
        unit = cell[1:-1].strip() if cell[:1] + cell[-1:] in ("[]", "()") else cell
        unit = "" if unit == "-" else unit
        if above and unit and spelling(above) != spelling(unit):
            raise UserError(
                f"the unit of column {name!r} is {above} in the line of column names, but {unit} in the line of units",
                where=where,
                remedy="correct the wrong unit",
            )
        units.append(above or unit or None)
    return replace(layout, units=tuple(units))


def split(text: str, delimiter: str, where: str) -> list[str]:
    try:
        return next(csv.reader([text], delimiter=delimiter, strict=True), [])
    except csv.Error as error:
        raise UserError(
            f"{quote(text)} is not a valid table row: {error}",
            where=where,
            remedy="enclose only whole cells in quotation marks, and close them in the same line",
        ) from None


def _delimiter(text: str, where: str, form: TextFormat, single: bool) -> str:
    """Delimiter in the line of names; single: a table with one column needs no delimiter."""
    bare = _QUOTED.sub("", text)
    delimiters = [sign for sign in DELIMITERS if sign in bare]
    if len(delimiters) == 1:
        return delimiters[0]
    delimiter_names = {",": "commas", ";": "semicolons", "\t": "tabs"}
    if delimiters:
        raise UserError(
            f"the line of column names contains {' and '.join(delimiter_names[sign] for sign in delimiters)}, "
            f"so the delimiter is ambiguous: {quote(text)}",
            where=where,
            remedy=form.remedy_setting("delimiter", f'"{delimiters[-1]}"', "specify the delimiter")
            + (", or the correct delimiter" if form.key else ""),
        )
    if single:
        return "\t"
    raise UserError(
        f"the line of column names contains no comma, semicolon or tab: {quote(text)}",
        where=where,
        remedy="the names of the columns are expected in the first line that is not a comment; "
        + form.remedy_setting("header_line", "LINE", "specify another line")
        + ", or export the table with ';' between the columns",
    )


def _name_and_unit(cell: str, time: str | None) -> tuple[str, str | None]:
    """'ch1 [um/m]' → 'ch1', 'um/m'; 't (-)' → 't', None. Text in round brackets is a unit only if it is a known one."""
    if not (match := _BRACKETS.fullmatch(cell)):
        return cell, None
    name, unit = match[1], match[2][1:-1].strip()
    if unit == "-":
        return name, None
    if match[2][0] == "[":
        holds = bool(unit) and not unit.isdigit()
    else:
        holds = known_unit(unit) is not None or (seconds_in(unit) is not None and time in (name, cell))
    return (name, unit) if holds else (cell, None)


def _column(wanted: str, cells: Sequence[str], names: Sequence[str], where: str, otherwise: str = "") -> int:
    matches = [i for i, pair in enumerate(zip(cells, names, strict=True)) if wanted in pair]
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise UserError(
            f"the columns {', '.join(str(i + 1) for i in matches)} have the same name {wanted!r}",
            where=where,
            remedy="use a unique name for every column",
        )
    shown = [quote(name) for name in names if name]
    raise UserError(
        f"column {wanted!r} not found",
        where=where,
        key=wanted,
        remedy=did_you_mean(
            wanted, names, f"the file contains {', '.join(shown[:20])}{' …' if len(shown) > 20 else ''}{otherwise}"
        ),
    )


def _number_like(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return not cell
    return True
