"""Test data in universal files, datasets 58 and 58b."""

from __future__ import annotations

import math
import os
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from strainsight.errors import UserError
from strainsight.measurements.assemble import check_one_clock
from strainsight.measurements.clock import recording_of
from strainsight.measurements.records import (
    Recording,
    check_no_infinity,
    decode,
    missing_error,
    open_file,
    quote,
    time_factor,
)
from strainsight.text import parse_real

DAMAGED = "the file is truncated or damaged: export it again"
HEADER = 11
"""Number of records before the values."""
_DIRECTIONS = {1: "X", 2: "Y", 3: "Z", 4: "RX", 5: "RY", 6: "RZ"}
_SI = {8: "m", 9: "N", 12: "m/s2", 13: "N", 15: "Pa"}
"""Specific data type → unit, if dataset 164 declares SI units."""
NONE = ("", "NONE")


@dataclass(frozen=True)
class Function:
    """One function of the file, without its values.

    number: of the dataset, from 1; line (0 if lines are not counted) and offset [bytes] of its values; kind:
    function type; double, complex_: ordinate; count of values; even: abscissa spacing, then start and increment;
    order: byte order, "<" or ">", "" for text."""

    number: int
    line: int
    offset: int
    order: str
    id_line: str
    kind: int
    node: int
    direction: int
    double: bool
    complex_: bool
    count: int
    even: bool
    start: float
    increment: float
    abscissa: int
    time_unit: str | None
    unit: str | None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the function in a config: "12:3", "12:+Z", and its first id line."""
        sign = "-" if self.direction < 0 else "+"
        words = [f"{self.node}:{self.direction}"]
        if abs(self.direction) in _DIRECTIONS:
            words.append(f"{self.node}:{sign}{_DIRECTIONS[abs(self.direction)]}")
        if self.id_line not in NONE:
            words.append(self.id_line)
        return tuple(words)

    @property
    def layout(self) -> tuple[int, ...]:
        """Widths [characters] of the numbers of one value in text: abscissa if uneven, then ordinates."""
        wide = 20 if self.double else 13
        return (() if self.even else (13,)) + (wide,) * (2 if self.complex_ else 1)

    @property
    def sizes(self) -> tuple[tuple[int, ...], ...]:
        """Bytes of the numbers of one value in binary. The standard abscissa is single precision; some programs write double."""
        ordinate = (8 if self.double else 4,) * (2 if self.complex_ else 1)
        if self.even:
            return (ordinate,)
        return ((4, *ordinate), (8, *ordinate)) if self.double else ((4, *ordinate),)


def function_of(
    number: int, identifier: bytes, records: Sequence[bytes], line: int, offset: int, where: str, *, si: bool
) -> Function:
    """The function that the identifier line and the next eleven records define. line: of the first record, 0 if lines are not
    counted; where: place of the dataset; si: dataset 164 declares SI units. Raises UserError for an invalid record."""

    def at(record: int) -> str:
        return f"{where.rpartition(':')[0]}:{line + record - 1}" if line else f"{where}, record {record}"

    order = _byte_order(decode(identifier), where)
    text = [decode(record.rstrip(b"\r\n")) for record in records]
    dof = _fields(text[5], at(6), "DOF", (5, 10, 5, 10, -11, 10, 4))
    form = _fields(text[6], at(7), "data form", (10, 10, 10, 13.5, 13.5))
    ordinate, count, spacing = (int(value) for value in form[:3])
    if ordinate not in (2, 4, 5, 6) or spacing not in (0, 1) or not 0 < count < 10**12:
        raise UserError(
            f"the data form is not valid in dataset 58: ordinate type {ordinate}, {count} values, spacing {spacing}",
            where=at(7),
            remedy=DAMAGED,
        )
    abscissa, time_unit = _axis(text[7], at(8))
    kind, unit = _axis(text[8], at(9))
    _, below = _axis(text[9], at(10))
    if unit is None and si:
        unit = _SI.get(kind)
    elif unit is not None and below is not None:
        unit = f"{unit}/{below}"
    return Function(
        number=number,
        line=line + HEADER if line else 0,
        offset=offset,
        order=order,
        id_line=text[0].strip(),
        kind=int(dof[0]),
        node=int(dof[4]),
        direction=int(dof[5]),
        double=ordinate in (4, 6),
        complex_=ordinate in (5, 6),
        count=count,
        even=spacing == 1,
        start=form[3],
        increment=form[4],
        abscissa=abscissa,
        time_unit=time_unit,
        unit=unit,
    )


def _byte_order(identifier: str, where: str) -> str:
    """ "" for text; "<" or ">" for 58b, whose line has the form (I6,1A1,I6,I6,I12,I12,…)."""
    if identifier[6:7].lower() != "b":
        return ""
    order, floats, lines = (int(value) for value in _fields(identifier[7:], where, "identifier", (6, 6, 12)))
    if order not in (1, 2) or floats != 2 or lines != HEADER:
        problem = {1: "numbers of DEC VMS", 3: "numbers of IBM 370"}.get(
            floats, f"byte order {order}, number format {floats} and {lines} header lines"
        )
        raise UserError(
            f"dataset 58b with {problem} is not supported",
            where=where,
            remedy="export IEEE 754 numbers after 11 header lines, or export the file as text",
        )
    return "<" if order == 1 else ">"


def _fields(text: str, where: str, what: str, widths: tuple[float, ...]) -> list[float]:
    """Numbers in columns: integers for integer widths, reals for 13.5, blank ones zero; a negative width skips text."""
    values, at = [], 0
    for width in widths:
        piece = text[at : at + abs(int(width))].strip()
        at += abs(int(width))
        if width < 0:
            continue
        value = parse_real(piece or "0")
        if value is None or (width == int(width) and value != int(value)):
            raise UserError(
                f"{quote(piece)} is not a valid number in the {what} of dataset 58: {quote(text, 80)}",
                where=where,
                remedy="export the file again with fixed columns, as the format requires",
            )
        values.append(value)
    return values


def _axis(text: str, where: str) -> tuple[int, str | None]:
    """Specific data type and unit of a record (I10,3I5,2(1X,20A1))."""
    (kind,) = _fields(text, where, "axis", (10,))
    unit = text[46:].strip()
    return int(kind), None if unit.upper() in NONE else unit


_LONGEST = 4096
"""Longest line [bytes]; records have 80."""
_TIME_RESPONSE, _TIME = 1, 17
_MOST_DATASETS = 100_000


def read_uff58(path: Path, channels: Sequence[str], *, time_unit: str | None = None) -> Recording:
    """Functions of a universal file by "node:direction" ("12:3" or "12:+Z") or by their first id line.

    They must be real responses over the same time, evenly spaced or not, in text or binary. The time is in seconds,
    as the format requires, unless the abscissa label differs. Units are those of the ordinate label, or else of the
    data type if dataset 164 declares SI units. Other datasets are skipped. Raises UserError with file:line, or with
    the dataset for a binary file."""
    path = Path(path)
    with open_file(path) as file:
        known: dict[str, list[Function]] = {}
        for function in _functions(file, path, os.fstat(file.fileno()).st_size):
            for word in dict.fromkeys(function.names):
                known.setdefault(word, []).append(function)
        chosen = [_chosen(name, known, path) for name in channels]
        read = {name: _read(file, path, each, name, time_unit) for name, each in zip(channels, chosen, strict=True)}
    if not read:
        raise UserError(
            "no channels are specified", where=str(path), remedy="specify at least one function of the file as channel"
        )
    check_one_clock({name: time for name, (time, _) in read.items()}, path)
    signals = [
        (read[channels[0]][0], "s"),
        *((read[name][1], each.unit) for name, each in zip(channels, chosen, strict=True)),
    ]
    return recording_of(signals, channels, path, _where(path, chosen[0]), None)


class _Lines:
    """Lines of the file, counted until the first binary one."""

    def __init__(self, file: BinaryIO, path: Path):
        self.file, self.path = file, path
        self.number, self.counts = 0, True

    def next(self) -> bytes:
        self.number += 1
        return self.file.readline(_LONGEST)

    def place(self, dataset: int) -> str:
        return f"{self.path}:{self.number}" if self.counts else f"{self.path}, dataset {dataset}"


def is_mark(line: bytes) -> bool:
    """Whether a line delimits a dataset: -1 in the first six columns."""
    return line[:6].strip() == b"-1" and not line[6:].strip()


def _functions(file: BinaryIO, path: Path, size: int) -> Iterator[Function]:
    """Every function of the file, without its values. Raises UserError for datasets without end."""
    if file.read(3) != b"\xef\xbb\xbf":
        file.seek(0)
    lines, number, si = _Lines(file, path), 0, False
    while line := lines.next():
        if not line.strip():
            continue
        number += 1
        if not is_mark(line) or number > _MOST_DATASETS:
            raise UserError(
                f"expected the start of a dataset, but found {quote(decode(line.strip()))}",
                where=lines.place(number),
                remedy="use a universal file, which has lines of -1 around every dataset, or export it again",
            )
        identifier = lines.next()
        kind, where = identifier[:6].strip(), lines.place(number)
        if kind == b"58":
            records = [lines.next() for _ in range(HEADER)]
            if not records[-1].endswith(b"\n"):
                raise UserError("the file ends inside the header of a function", where=where, remedy=DAMAGED)
            first = lines.number - HEADER + 1 if lines.counts else 0
            function = function_of(number, identifier, records, first, file.tell(), where, si=si)
            yield function
            if function.order:
                lines.counts = False
                file.seek(_end_of_binary(file, path, function, size)[1])
                continue
            if function.count * sum(function.layout) > 2 * size:
                raise UserError(
                    f"{function.count} values are declared in the header of a function, but the file has only {size} bytes",
                    where=where,
                    remedy=DAMAGED,
                )
        elif kind == b"164":
            si = lines.next()[:10].strip() == b"1"  # metre and newton
        elif not kind.isdigit():
            raise UserError(f"{quote(decode(identifier.strip()))} is not a dataset number", where=where, remedy=DAMAGED)
        while not is_mark(line := lines.next()):
            if not line:
                raise UserError(f"the file ends inside dataset {number}", where=where, remedy=DAMAGED)


def _end_of_binary(file: BinaryIO, path: Path, function: Function, size: int) -> tuple[tuple[int, ...], int]:
    """Bytes of the numbers of one value, and start of the line after the closing -1.
    The length in the identifier line is wrong in files of several programs, so the end mark is used, which follows
    directly after the values, or in some files on a new line."""
    for sizes in function.sizes:
        end = function.offset + function.count * sum(sizes)
        if end >= size:
            continue
        file.seek(end)
        tail = file.read(96)
        mark = tail.removeprefix(b"\r\n") if tail.startswith(b"\r\n") else tail.removeprefix(b"\n")
        line = mark.split(b"\n", 1)[0]
        if is_mark(line.rstrip(b"\r")):
            return sizes, min(end + len(tail) - len(mark) + len(line) + 1, size)
    raise UserError(
        f"the dataset does not end after {function.count} values of "
        f"{' or '.join(str(sum(sizes)) for sizes in function.sizes)} bytes",
        where=_where(path, function),
        remedy=DAMAGED + ", or export it as text",
    )


def _chosen(name: str, known: Mapping[str, list[Function]], path: Path) -> Function:
    matches = known.get(name, [])
    if len(matches) == 1:
        return matches[0]
    if matches:
        id_lines = ", ".join(quote(function.id_line) for function in matches[:5])
        raise UserError(
            f"{name!r} is the name of {len(matches)} functions: {id_lines}",
            where=str(path),
            remedy="specify the id line of the function as `channel` in the config, or assign a unique node and direction "
            "to each function in the file",
        )
    first = [function.names[-1] for functions in known.values() for function in functions[:1]]
    raise missing_error("function", name, known, str(path), first)


def _read(
    file: BinaryIO, path: Path, function: Function, name: str, time_unit: str | None
) -> tuple[np.ndarray, np.ndarray]:
    """Time (T,) [s] and values (T,) of a function."""
    where = _where(path, function)
    if function.complex_ or function.kind not in (0, _TIME_RESPONSE):
        what = "has complex values" if function.complex_ else f"type {function.kind} is not a time response"
        raise UserError(f"the function {what}", where=where, remedy="export the time signal of this channel")
    if function.abscissa != _TIME and not (function.kind == _TIME_RESPONSE and function.abscissa in (0, 1)):
        raise UserError(
            f"the abscissa has data type {function.abscissa} instead of 17 (time)",
            where=where,
            remedy="export the time signal of this channel",
        )
    factor = time_factor(time_unit, function.time_unit or "s", where)
    table = _binary(file, path, function) if function.order else _text(file, path, function)
    values = table[:, -1].astype(float)
    if function.even:
        if not function.increment > 0:
            raise UserError(f"the time increment is {function.increment:g}, not positive", where=where, remedy=DAMAGED)
        time = function.start + function.increment * np.arange(function.count)
    else:
        time = table[:, 0].astype(float)
    check_no_infinity(values, name, where)
    return time * factor, values


def _binary(file: BinaryIO, path: Path, function: Function) -> np.ndarray:
    """(T, numbers a value), stored fields converted to float."""
    sizes, _ = _end_of_binary(file, path, function, os.fstat(file.fileno()).st_size)
    file.seek(function.offset)
    kind = np.dtype([(str(i), f"{function.order}f{width}") for i, width in enumerate(sizes)])
    rows = np.frombuffer(file.read(function.count * kind.itemsize), kind)
    return np.stack([rows[name].astype(float) for name in rows.dtype.names or ()], axis=1)


def _text(file: BinaryIO, path: Path, function: Function) -> np.ndarray:
    """(T, numbers a value) from lines with fixed columns."""
    file.seek(function.offset)
    values_, width = array("d"), len(function.layout)
    # 6E13.5, 4E20.12, 2(E13.5,E20.12) or E13.5,2E20.12 on a line
    ends = np.cumsum(function.layout * (80 // sum(function.layout))).tolist()
    columns = list(zip([0, *ends[:-1]], ends, strict=True))
    left, line_number = function.count * width, function.line
    while left > 0:
        line = file.readline(_LONGEST).rstrip(b"\r\n")
        many = min(left, len(columns))
        pieces = [line[start:end] for start, end in columns[:many]]
        try:
            values = [float(piece) for piece in pieces] if b"_" not in line else None
        except ValueError:
            values = None
        values_.extend(values or [_number(piece, path, function, line_number) for piece in pieces])
        left -= many
        line_number += 1
    if not is_mark(file.readline(_LONGEST)):
        raise UserError(
            f"the function has more than the declared {function.count} values",
            where=f"{path}:{line_number}" if function.line else _where(path, function),
            remedy=DAMAGED,
        )
    return np.frombuffer(values_, float).reshape(-1, width)


def _number(piece: bytes, path: Path, function: Function, line: int) -> float:
    text = decode(piece.strip())
    if (value := math.nan if text.lower() == "nan" else parse_real(text)) is not None:
        return value
    wide = text.startswith("*")
    raise UserError(
        f"{quote(text)} is not a number"
        + (": it exceeds its column width" if wide else f"; the header declares {function.count} values"),
        where=f"{path}:{line}" if function.line else _where(path, function),
        remedy="export the file in double precision, or binary" if wide else DAMAGED,
    )


def _where(path: Path, function: Function) -> str:
    """file:line of the values in a text file; the dataset and its name in a file with binary functions."""
    if function.line and not function.order:
        return f"{path}:{function.line}"
    return f"{path}, dataset {function.number} ({function.names[0]})"
