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
from strainsight.measurements.records import Recording, check_no_infinity, decoded, missing, opened, plain, time_factor

DAMAGED = "export the file again: it was cut short or altered"
HEADER = 11
"""Records in front of the values."""
_DIRECTIONS = {1: "X", 2: "Y", 3: "Z", 4: "RX", 5: "RY", 6: "RZ"}
_SI = {8: "m", 9: "N", 12: "m/s2", 13: "N", 15: "Pa"}
"""Specific data type → unit where dataset 164 says the file is in SI."""
NONE = ("", "NONE")


@dataclass(frozen=True)
class Function:
    """One function of the file, without its values.

    number: of the dataset, from 1; line (0 where lines no longer count) and offset [bytes] of its values; kind: function
    type; double, complex_: ordinate; count of values; even: abscissa spacing, then start and increment; order: of the
    bytes, "<" or ">", "" for text.
    """

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
        """What it may be asked for by: "12:3", "12:+Z", and its first id line."""
        sign = "-" if self.direction < 0 else "+"
        words = [f"{self.node}:{self.direction}"]
        if abs(self.direction) in _DIRECTIONS:
            words.append(f"{self.node}:{sign}{_DIRECTIONS[abs(self.direction)]}")
        if self.id_line not in NONE:
            words.append(self.id_line)
        return tuple(words)

    @property
    def layout(self) -> tuple[int, ...]:
        """Widths [characters] of the numbers of one value in text: its abscissa where uneven, its ordinates."""
        wide = 20 if self.double else 13
        return (() if self.even else (13,)) + (wide,) * (2 if self.complex_ else 1)

    @property
    def per_line(self) -> int:
        """Values on a line of text: 6E13.5, 4E20.12, 2(E13.5,E20.12) or E13.5,2E20.12."""
        return 80 // sum(self.layout)

    @property
    def sizes(self) -> tuple[tuple[int, ...], ...]:
        """Bytes of the numbers of one value in binary. The standard keeps the abscissa single; some write it double."""
        ordinate = (8 if self.double else 4,) * (2 if self.complex_ else 1)
        if self.even:
            return (ordinate,)
        return ((4, *ordinate), (8, *ordinate)) if self.double else ((4, *ordinate),)


def function_of(
    number: int, identifier: bytes, records: Sequence[bytes], line: int, offset: int, where: str, *, si: bool
) -> Function:
    """The function that the identifier line and the eleven records behind it describe.

    line: that of the first record, 0 where lines do not count; where: the place of the dataset; si: dataset 164 says so.
    Raises UserError where a record does not have its form.
    """

    def at(record: int) -> str:
        return f"{where.rpartition(':')[0]}:{line + record - 1}" if line else f"{where}, record {record}"

    order = _byte_order(decoded(identifier), where)
    text = [decoded(record.rstrip(b"\r\n")) for record in records]
    dof = _fields(text[5], at(6), "the DOF", (5, 10, 5, 10, -11, 10, 4))
    form = _fields(text[6], at(7), "the form of the data", (10, 10, 10, 13.5, 13.5))
    ordinate, count, spacing = (int(value) for value in form[:3])
    if ordinate not in (2, 4, 5, 6) or spacing not in (0, 1) or not 0 < count < 10**12:
        raise UserError(
            f"ordinates of type {ordinate}, {count} values, spacing {spacing}: no form of data of dataset 58",
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
    order, floats, lines = (int(value) for value in _fields(identifier[7:], where, "the identifier", (6, 6, 12)))
    if order not in (1, 2) or floats != 2 or lines != HEADER:
        said = {1: "numbers of DEC VMS", 3: "numbers of IBM 370"}.get(
            floats, f"byte order {order}, numbers {floats}, {lines} lines"
        )
        raise UserError(
            f"{said} in dataset 58b", where=where, remedy="export IEEE 754 numbers behind 11 lines, or the file as text"
        )
    return "<" if order == 1 else ">"


def _fields(text: str, where: str, what: str, widths: tuple[float, ...]) -> list[float]:
    """Numbers in columns: integers by whole widths, reals by 13.5, blank ones zero; a negative width passes over text."""
    found, at = [], 0
    for width in widths:
        piece = text[at : at + abs(int(width))].strip()
        at += abs(int(width))
        if width < 0:
            continue
        value = 0.0 if not piece else number_of(piece)
        if value is None or not math.isfinite(value) or (width == int(width) and value != int(value)):
            raise UserError(
                f"{plain(piece)} is no number of {what}: {plain(text, 80)}",
                where=where,
                remedy="the record has fixed columns: export the file again, by a writer that keeps to them",
            )
        found.append(value)
    return found


def _axis(text: str, where: str) -> tuple[int, str | None]:
    """Specific data type and unit of a record (I10,3I5,2(1X,20A1))."""
    (kind,) = _fields(text, where, "the axis", (10,))
    unit = text[46:].strip()
    return int(kind), None if unit.upper() in NONE else unit


def number_of(piece: str | bytes) -> float | None:
    """A number as Fortran prints it, 1.5D-3 and 1.5-103 too; None where it is none."""
    text = piece.decode("latin-1") if isinstance(piece, bytes) else piece
    if "_" in text:
        return None
    text = text.strip().upper().replace("D", "E")
    try:
        return float(text)
    except ValueError:
        pass
    # Fortran drops the letter where the exponent has three digits: 1.5-105
    at = max(text.rfind("+"), text.rfind("-"))
    try:
        return float(f"{text[:at]}E{text[at:]}") if at > 0 else None
    except ValueError:
        return None


def known_names(functions: Sequence[Function]) -> Mapping[str, list[Function]]:
    """Name → the functions it may mean."""
    found: dict[str, list[Function]] = {}
    for function in functions:
        for name in dict.fromkeys(function.names):
            found.setdefault(name, []).append(function)
    return found


_LONGEST = 4096
"""[bytes] read as one line: records have 80."""
_TIME_RESPONSE, _TIME = 1, 17
_MOST_DATASETS = 100_000


def read_uff58(path: Path, channels: Sequence[str], *, time_unit: str | None = None) -> Recording:
    """Functions of a universal file by "node:direction" ("12:3" or "12:+Z") or by their first id line.

    They have to be real responses over one and the same time, evenly spaced or not, in text or binary. The time is in
    seconds, as the format has it, unless the label of the abscissa says otherwise. Units from the label of the ordinate;
    where it has none, from the data type if dataset 164 says that the file is in SI. Other datasets are passed over.
    Raises UserError with file:line, or the dataset where the file is binary.
    """
    path = Path(path)
    with opened(path) as file:
        size = os.fstat(file.fileno()).st_size
        functions = list(_functions(file, path, size))
        known = known_names(functions)
        chosen = [_chosen(name, known, path) for name in channels]
        read = {name: _read(file, path, each, name, time_unit) for name, each in zip(channels, chosen, strict=True)}
    if not read:
        raise UserError("no channel was asked for", where=str(path), remedy="state the channels")
    check_one_clock({name: time for name, (time, _) in read.items()}, path)
    found = [
        (read[channels[0]][0], "s"),
        *((read[name][1], each.unit) for name, each in zip(channels, chosen, strict=True)),
    ]
    return recording_of(found, channels, path, _where(path, chosen[0]), None)


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
    """The line before and behind every dataset: -1 in the first six columns."""
    return line[:6].strip() == b"-1" and not line[6:].strip()


def _functions(file: BinaryIO, path: Path, size: int) -> Iterator[Function]:
    """Every function of the file, its values passed over. Raises UserError where the datasets do not close."""
    if file.read(3) != b"\xef\xbb\xbf":
        file.seek(0)
    lines, number, si = _Lines(file, path), 0, False
    while line := lines.next():
        if not line.strip():
            continue
        number += 1
        if not is_mark(line) or number > _MOST_DATASETS:
            raise UserError(
                f"no start of a dataset: {plain(decoded(line.strip()))}",
                where=lines.place(number),
                remedy="a universal file has lines of -1 around every dataset: give such a file, or export it again",
            )
        identifier = lines.next()
        kind, where = identifier[:6].strip(), lines.place(number)
        if kind == b"58":
            records = [lines.next() for _ in range(HEADER)]
            if not records[-1].endswith(b"\n"):
                raise UserError("the file ends within the header of a function", where=where, remedy=DAMAGED)
            first = lines.number - HEADER + 1 if lines.counts else 0
            function = function_of(number, identifier, records, first, file.tell(), where, si=si)
            if function.order:
                lines.counts = False
                file.seek(_end_of_binary(file, path, function, size)[1])
                yield function
                continue
            if function.count * sum(function.layout) > 2 * size:
                raise UserError(
                    f"{function.count} values are claimed in a file of {size} bytes", where=where, remedy=DAMAGED
                )
            yield function
        elif kind == b"164":
            si = lines.next()[:10].strip() == b"1"  # metre and newton
        elif not kind.isdigit():
            raise UserError(
                f"{plain(decoded(identifier.strip()))} is no number of a dataset", where=where, remedy=DAMAGED
            )
        while not is_mark(line := lines.next()):
            if not line:
                raise UserError(f"the file ends within dataset {number}", where=where, remedy=DAMAGED)


def _end_of_binary(file: BinaryIO, path: Path, function: Function, size: int) -> tuple[tuple[int, ...], int]:
    """Bytes of the numbers of one value, and where the line behind the closing -1 begins.

    The length that the identifier line states is wrong in files of several writers: what counts is where the dataset
    closes, by the standard right behind the values, in some files on a line of its own.
    """
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
        f"{function.count} values of {' or '.join(str(sum(sizes)) for sizes in function.sizes)} bytes do not end where the "
        "dataset closes",
        where=_where(path, function),
        remedy=DAMAGED + ", or its header does not fit; exported as text it can be read",
    )


def _chosen(name: str, known: Mapping[str, list[Function]], path: Path) -> Function:
    found = known.get(name, [])
    if len(found) == 1:
        return found[0]
    if found:
        said = ", ".join(plain(function.id_line) for function in found[:5])
        raise UserError(
            f"{name!r} means {len(found)} functions: {said}",
            where=str(path),
            remedy="ask for them by their id lines, or give each its own node and direction",
        )
    first = [function.names[-1] for functions in known.values() for function in functions[:1]]
    raise missing("function", name, known, str(path), first)


def _read(
    file: BinaryIO, path: Path, function: Function, name: str, time_unit: str | None
) -> tuple[np.ndarray, np.ndarray]:
    """Time (T,) [s] and values (T,) of a function."""
    where = _where(path, function)
    if function.complex_ or function.kind not in (0, _TIME_RESPONSE):
        said = "complex values" if function.complex_ else f"a function of type {function.kind}, no time response"
        raise UserError(said, where=where, remedy="export the time signal")
    if function.abscissa != _TIME and not (function.kind == _TIME_RESPONSE and function.abscissa in (0, 1)):
        raise UserError(
            f"an abscissa of data type {function.abscissa}, not time (17)", where=where, remedy="export the time signal"
        )
    factor = time_factor(time_unit, function.time_unit or "s", where)
    table = _binary(file, path, function) if function.order else _text(file, path, function)
    values = table[:, -1].astype(float)
    if function.even:
        if not function.increment > 0:
            raise UserError(f"an abscissa increment of {function.increment:g}", where=where, remedy=DAMAGED)
        time = function.start + function.increment * np.arange(function.count)
    else:
        time = table[:, 0].astype(float)
    check_no_infinity(values, name, where)
    return time * factor, values


def _binary(file: BinaryIO, path: Path, function: Function) -> np.ndarray:
    """(T, numbers a value), its fields as they are stored."""
    sizes, _ = _end_of_binary(file, path, function, os.fstat(file.fileno()).st_size)
    file.seek(function.offset)
    kind = np.dtype([(str(i), f"{function.order}f{width}") for i, width in enumerate(sizes)])
    rows = np.frombuffer(file.read(function.count * kind.itemsize), kind)
    return np.stack([rows[name].astype(float) for name in rows.dtype.names or ()], axis=1)


def _text(file: BinaryIO, path: Path, function: Function) -> np.ndarray:
    """(T, numbers a value) from lines of fixed columns."""
    file.seek(function.offset)
    found, width = array("d"), len(function.layout)
    ends = np.cumsum(function.layout * function.per_line).tolist()
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
        found.extend(values or [_number(piece, path, function, line_number) for piece in pieces])
        left -= many
        line_number += 1
    if not is_mark(file.readline(_LONGEST)):
        raise UserError(
            f"more values than the {function.count} that are claimed",
            where=f"{path}:{line_number}" if function.line else _where(path, function),
            remedy=DAMAGED,
        )
    return np.frombuffer(found, float).reshape(-1, width)


def _number(piece: bytes, path: Path, function: Function, line: int) -> float:
    if (value := number_of(piece)) is not None:
        return value
    said = plain(decoded(piece.strip()))
    wide = piece.strip().startswith(b"*")
    raise UserError(
        f"{said} is no number"
        + (": it did not fit its column" if wide else f" of a function of {function.count} values"),
        where=f"{path}:{line}" if function.line else _where(path, function),
        remedy="export the file in double precision, or binary" if wide else DAMAGED,
    )


def _where(path: Path, function: Function) -> str:
    """file:line of the values in a file of text; the dataset and its name in one with binary functions."""
    if function.line and not function.order:
        return f"{path}:{function.line}"
    return f"{path}, dataset {function.number} ({function.names[0]})"
