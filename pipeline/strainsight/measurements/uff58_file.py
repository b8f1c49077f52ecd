"""Test data in universal files, datasets 58 and 58b."""

from __future__ import annotations

import os
from array import array
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np

from strainsight.errors import UserError, did_you_mean
from strainsight.measurements.records import Recording, decoded, opened, plain
from strainsight.measurements.uff58_records import DAMAGED, HEADER, Function, function_of, is_si, known_names, number_of
from strainsight.measurements.units import time_factor

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
        time, first, values = np.zeros(0), None, {}
        for name, function in zip(channels, chosen, strict=True):
            t, values[name] = _read(file, path, function, time_unit)
            if first is None:
                time, first = t, function
            elif t.shape != time.shape or not np.allclose(
                t, time, rtol=0, atol=1e-6 * abs(time[-1] - time[0]) / t.size
            ):
                raise UserError(
                    f"{name!r} has {t.size} samples from {t[0]:g} to {t[-1]:g} s, {channels[0]!r} {time.size} from "
                    f"{time[0]:g} to {time[-1]:g} s",
                    where=_where(path, function),
                    remedy="give channels of one clock, or resample them",
                )
    if first is None:
        raise UserError("no channel was asked for", where=str(path), remedy="state the channels")
    units = {name: function.unit for name, function in zip(channels, chosen, strict=True)}
    return Recording(time, values, units, str(path))


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


def _is_mark(line: bytes) -> bool:
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
        if not _is_mark(line) or number > _MOST_DATASETS:
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
            si = is_si(lines.next())
        elif not kind.isdigit():
            raise UserError(
                f"{plain(decoded(identifier.strip()))} is no number of a dataset", where=where, remedy=DAMAGED
            )
        while not _is_mark(line := lines.next()):
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
        if _is_mark(line.rstrip(b"\r")):
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
    raise UserError(
        f"no function {name!r}",
        where=str(path),
        remedy=did_you_mean(
            name, known, f"it has {', '.join(map(plain, dict.fromkeys(first[:20])))}" if known else "it has none"
        ),
    )


def _read(file: BinaryIO, path: Path, function: Function, time_unit: str | None) -> tuple[np.ndarray, np.ndarray]:
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
    for column, what in ((time, "time"), (values, "value")):
        bad = ~np.isfinite(column) if what == "time" else np.isinf(column)
        if bad.any():
            raise UserError(
                f"{what} {int(np.argmax(bad)) + 1} is {column[np.argmax(bad)]:g}",
                where=where,
                remedy="write NaN where a sample is missing" if what == "value" else "give every sample its time",
            )
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
    if not _is_mark(file.readline(_LONGEST)):
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
