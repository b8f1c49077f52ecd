"""Where the columns of a text table are: delimiter, names, units."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from strainsight.errors import UserError, did_you_mean
from strainsight.measurements.records import decoded, known_unit, plain, seconds_in, spelling
from strainsight.text import plain_cell

DELIMITERS = (",", ";", "\t")
_QUOTED = re.compile(r'"[^"]*"')
_BRACKETS = re.compile(r"(.*\S)\s*(\[[^\[\]]*\]|\([^()]*\))")
_NUMBERS = re.compile(r'[-+\s0-9.,;eE"]*[0-9][-+\s0-9.,;eE"]*')
NO_TIME = "; where none of them is the time, state the sampling rate in its place: `time: {rate: 100, unit: Hz}`"
_DIGIT = re.compile(r"\d")
_SPREADSHEET = re.compile(r"sep=(.)")


@dataclass(frozen=True)
class TextFormat:
    """How a text table is written; None where it shows from the file.

    delimiter: one sign; decimal: "." or ","; comment: what lines to pass over begin with; header_line: from 1, where lines
    without a comment sign stand above the names; missing: words that stand for no sample, beside an empty cell and NaN; key:
    of the config, where these are stated, for remedies.
    """

    delimiter: str | None = None
    decimal: str = "."
    comment: str = "#"
    header_line: int | None = None
    missing: tuple[str, ...] = ()
    key: str | None = None

    def __post_init__(self) -> None:
        if self.delimiter == self.decimal:
            raise UserError(
                "the comma is both delimiter and decimal mark", remedy="write the file with ';' between the columns"
            )

    def stating(self, name: str, value: str, otherwise: str) -> str:
        """A remedy: which key takes which value, or in other words where no key is known."""
        return f"state `{self.key}.{name}: {value}`" if self.key else otherwise


@dataclass(frozen=True)
class Layout:
    """delimiter; names as in the header, its brackets off; units, None where not stated; columns: time, then channels;
    timed: whether the first of the columns is the time; remarks: a line may have one more cell, with a remark."""

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
    """The delimiter of a spreadsheet's first line, sep=;"""
    found = _SPREADSHEET.fullmatch(decoded(line).strip(' "'))
    return found[1] if found else None


def header(line: bytes, where: str, form: TextFormat, time: str | None, channels: Sequence[str]) -> Layout:
    """The layout that the line of names says; time: name of its column, None of a table that has none.

    The delimiter is the one of `, ; tab` in it, outside quotes; two kinds are refused unless one is stated.
    Raises UserError where there is none, names are missing, or stand twice.
    """
    text = decoded(line)
    if form.comment and text.lstrip().startswith(form.comment):
        text = text.lstrip().removeprefix(form.comment)
    delimiter = form.delimiter or ("" if _NUMBERS.fullmatch(text) else _delimiter(text, where, form, time is None))
    cells = [plain_cell(cell.strip()) for cell in split(text, delimiter, where)] if delimiter else []
    if all(_number_like(cell) for cell in cells):
        raise UserError(
            f"the columns have no names: the first line is {plain(text)}",
            where=where,
            remedy="write a line of names above the numbers, or "
            + form.stating("header_line", "LINE", "say in which line it is"),
        )
    names, units = zip(*(_name_and_unit(cell, time) for cell in cells), strict=True)
    columns = [_column(name, cells, names, where) for name in channels]
    if time is not None:
        columns.insert(0, _column(time, cells, names, where, NO_TIME))
    return Layout(delimiter, names, units, tuple(columns), where, time is not None)


def with_units(line: bytes, where: str, layout: Layout) -> Layout | None:
    """The layout with the units of a line of units, or None where it is none: neither does its time cell hold a unit of time, nor
    the others known units, beside a time cell without digits."""
    try:
        cells = [cell.strip() for cell in split(decoded(line), layout.delimiter, where)]
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
            f"{len(cells)} units for {len(layout.names)} names",
            where=where,
            remedy="give every column its unit, an empty one where it has none",
        )
    units = []
    for name, above, cell in zip(layout.names, layout.units, cells, strict=True):
        unit = cell[1:-1].strip() if cell[:1] + cell[-1:] in ("[]", "()") else cell
        unit = "" if unit == "-" else unit
        if above and unit and spelling(above) != spelling(unit):
            raise UserError(
                f"{name!r} is in {above} in the line of names, in {unit} in the line of units",
                where=where,
                remedy="correct the one that is wrong",
            )
        units.append(above or unit or None)
    return replace(layout, units=tuple(units))


def split(text: str, delimiter: str, where: str) -> list[str]:
    try:
        return next(csv.reader([text], delimiter=delimiter, strict=True), [])
    except csv.Error as error:
        raise UserError(
            f"{plain(text)} is no line of a table: {error}",
            where=where,
            remedy="close the quotes in the line they open in",
        ) from None


def _delimiter(text: str, where: str, form: TextFormat, single: bool) -> str:
    """The one in the line of names; single: there may be one column and none."""
    bare = _QUOTED.sub("", text)
    found = [sign for sign in DELIMITERS if sign in bare]
    if len(found) == 1:
        return found[0]
    said = {",": "commas", ";": "semicolons", "\t": "tabs"}
    if found:
        raise UserError(
            f"the line of names has {' and '.join(said[sign] for sign in found)}: {plain(text)}",
            where=where,
            remedy=form.stating("delimiter", f'"{found[-1]}"', "say which of them is the delimiter")
            + (", or the one that it is" if form.key else ""),
        )
    if single:
        return "\t"
    raise UserError(
        f"no comma, semicolon or tab in the line of names: {plain(text)}",
        where=where,
        remedy="the first line that is no comment holds the names of the columns: "
        + form.stating("header_line", "LINE", "say which line does, if it is another")
        + ", or export with ';' between the columns",
    )


def _name_and_unit(cell: str, time: str | None) -> tuple[str, str | None]:
    """'ch1 [um/m]' → 'ch1', 'um/m'; 't (-)' → 't', None. Round brackets hold many things: in them only what is known as a unit is
    one."""
    found = _BRACKETS.fullmatch(cell)
    if not found:
        return cell, None
    name, unit = found[1], found[2][1:-1].strip()
    if unit == "-":
        return name, None
    if found[2][0] == "[":
        holds = bool(unit) and not unit.isdigit()
    else:
        holds = known_unit(unit) is not None or (seconds_in(unit) is not None and time in (name, cell))
    return (name, unit) if holds else (cell, None)


def _column(wanted: str, cells: Sequence[str], names: Sequence[str], where: str, otherwise: str = "") -> int:
    found = [i for i, said in enumerate(zip(cells, names, strict=True)) if wanted in said]
    if len(found) == 1:
        return found[0]
    if found:
        raise UserError(
            f"{wanted!r} stands over columns {', '.join(str(i + 1) for i in found)}",
            where=where,
            remedy="give every column its own name",
        )
    shown = [plain(name) for name in names if name]
    raise UserError(
        f"no column {wanted!r}",
        where=where,
        key=wanted,
        remedy=did_you_mean(
            wanted, names, f"it has {', '.join(shown[:20])}{' …' if len(shown) > 20 else ''}{otherwise}"
        ),
    )


def _number_like(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return not cell
    return True
