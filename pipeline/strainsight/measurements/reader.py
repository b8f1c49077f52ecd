"""Read any test data file into a `Recording`."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from strainsight.child_reader import Message, answer, child_reader, reason
from strainsight.errors import UserError
from strainsight.measurements.clock import recording_of, time_from_number
from strainsight.measurements.csv_layout import TextFormat
from strainsight.measurements.records import DAMAGED, Read, Recording, Signals, open_file
from strainsight.processes import python

FORMATS = {
    "csv": (".csv", ".txt", ".tsv", ".dat", ".asc", ".lvm"),
    "hdf5": (".h5", ".hdf5", ".hdf", ".nc"),
    "uff58": (".uff", ".unv", ".ufb", ".uff58", ".58"),
    "mdf": (".mf4", ".mdf"),
    "tdms": (".tdms",),
    "mat": (".mat",),
}
"""Format → file name endings."""
SPREADSHEETS = (".xlsx", ".xls", ".xlsm", ".ods")
COMMAND = python("strainsight.measurements.reader")
EXTRA = "daq"
MEMORY_LIMIT = 1 << 30
"""Memory limit [bytes] for reading, plus MEMORY_A_BYTE for every byte of the file."""
MEMORY_A_BYTE = 20


@dataclass(frozen=True)
class Library:
    """Library that reads a format in a child process: format name for messages, its modules, the package to install
    if it is not a dependency, and our module whose `signals` calls it.

    seconds: processor time for every channel, plus one second for every `rate` bytes of the file; unpacked: and for
    every so many bytes of an unpacked channel, from `declared` of the module; None if not available."""

    format: str
    modules: tuple[str, ...]
    package: str | None
    reader: str
    seconds: float = 20.0
    rate: float = 5e6
    unpacked: float | None = None


LIBRARIES = {
    "hdf5": Library("HDF5", ("h5py",), None, "strainsight.measurements.hdf5_datasets", 7.0, 1e7, 5e7),
    "mdf": Library("MDF", ("asammdf",), "asammdf", "strainsight.measurements.mdf"),
    "tdms": Library("TDMS", ("nptdms",), "npTDMS", "strainsight.measurements.tdms"),
    "mat": Library("MAT", ("scipy.io", "h5py"), None, "strainsight.measurements.mat"),
}


def read_recording(
    path: Path,
    channels: Sequence[str],
    *,
    time: str | None = None,
    time_unit: str | None = None,
    rate: float | None = None,
    format: str = "auto",
    form: TextFormat | None = None,
) -> Recording:
    """Read channels of a test in the units of the file.

    channels: columns of a table, datasets, "node:direction" or id line of a function, "group/channel", variables;
    time: column, dataset, channel or variable of the clock, not for UFF58, optional for MDF and TDMS; time_unit: must
    agree with the file; rate: sampling rate [Hz] instead of a clock; format: a key of FORMATS, or auto by the file
    name ending; form: format of a text table. Raises UserError with the line for a file that cannot be imported."""
    path = Path(path)
    kind = format_of(path) if format == "auto" else format
    if kind not in FORMATS:
        raise UserError(f"unknown format {kind!r}", remedy=f"use one of the formats {', '.join(FORMATS)}")
    if kind in ("csv", "hdf5", "mat") and time is None and rate is None:
        raise UserError(
            "the time channel is not specified",
            where=str(path),
            remedy="set estimate.time.channel to a column, dataset or variable, or estimate.time.rate to the sampling rate [Hz]",
        )
    if kind == "csv":
        from strainsight.measurements.csv_file import read_csv

        return read_csv(path, channels, time=time, time_unit=time_unit, rate=rate, form=form)
    if kind == "uff58":
        from strainsight.measurements.uff58_file import read_uff58

        if time is not None or rate is not None:
            raise UserError(
                f"estimate.time is set ({time or f'at {rate:g} Hz'!r}), but functions of a universal file "
                "define their time",
                where=str(path),
                remedy="remove estimate.time",
            )
        return read_uff58(path, channels, time_unit=time_unit)
    return read_binary(kind, path, channels, time=time, time_unit=time_unit, rate=rate)


def format_of(path: Path) -> str:
    """Format from the file name ending. Raises UserError for an unknown ending."""
    ending = path.suffix.lower()
    for name, endings in FORMATS.items():
        if ending in endings:
            return name
    remedy = f"set the key `format`, next to `file`, to one of {', '.join(FORMATS)}"
    if ending in SPREADSHEETS:
        remedy = "save the table as CSV, with a line of column names above the numbers"
    raise UserError(f"the ending {ending!r} belongs to no known test data format", where=str(path), remedy=remedy)


def read_binary(
    kind: str,
    path: Path,
    channels: Sequence[str],
    *,
    time: str | None = None,
    time_unit: str | None = None,
    rate: float | None = None,
    sandboxed: bool = True,
) -> Recording:
    """Channels of a file of a kind in LIBRARIES, from the `signals` of its reader.

    time: name of the clock, None if the file defines it; or rate: sampling rate [Hz]. sandboxed: run in a child
    process. Raises UserError as the reader does, and if its library is not installed or fails."""
    path, library = Path(path), LIBRARIES[kind]
    with open_file(path) as file:
        size = os.fstat(file.fileno()).st_size
    if library.package is not None and find_spec(library.modules[0]) is None:
        raise UserError(
            f"{library.format} files require {library.package}, which is not installed",
            where=str(path),
            remedy=f'install it: pip install "strainsight[{EXTRA}]"',
        )
    names = [time if rate is None else channels[0], *channels]
    signals = list(_signals_in_child_process(kind, path, names, size) if sandboxed else reading(kind)(path, names))
    t, unit = signals[0]
    if time is not None and kind == "mat" and t.size == 1 and len(signals) > 1 and signals[1][0].size > 1:
        signals[0] = time_from_number(float(t[0]), signals[1][0].size, time, time_unit, unit, str(path))
        time_unit = None
    where = f"{path}, {time}" if time and kind != "hdf5" else _place(kind, path, names[0])
    return recording_of(signals, channels, path, where, time_unit, rate)


def _place(kind: str, path: Path, name: str | None) -> str:
    return f"{path}:/{(name or '').strip('/')}" if kind == "hdf5" else str(path)


def _signals_in_child_process(kind: str, path: Path, names: Sequence[str | None], size: int) -> Signals:
    """The signals of `reading` from a child process."""
    library = LIBRARIES[kind]
    crashed = f"the {library.format} library crashed or took too long to read the file"
    failure = UserError(crashed, where=_place(kind, path, names[0]), remedy=DAMAGED)
    limit, more = library.seconds + size / library.rate, [0.0] * len(names)
    with child_reader([*COMMAND, kind], [str(path), *names], failure) as receive:
        if library.unpacked is not None:
            more = [count / library.unpacked for count in receive(limit)[0]["declared"]]
        for name, longer in zip(names, more, strict=True):
            failure.where = _place(kind, path, name)
            head, (values,) = receive(limit + longer)
            yield values, head["unit"]


def reading(kind: str) -> Read:
    """The `signals` of the reader of a kind, with errors of its library converted to UserError."""

    def read(path: Path, names: Sequence[str | None]) -> Signals:
        with _library_errors(kind, path):
            yield from import_module(LIBRARIES[kind].reader).signals(path, names)

    return read


@contextmanager
def _library_errors(kind: str, path: Path) -> Iterator[None]:
    """Convert errors of a library for a file to UserError."""
    name = LIBRARIES[kind].format
    try:
        yield
    except UserError:
        raise
    except MemoryError:
        raise UserError(
            f"reading the file as {name} requires more memory than is plausible for its size",
            where=str(path),
            remedy=f"export a part of the record, or {DAMAGED}",
        ) from None
    except Exception as error:
        raise UserError(
            f"the file cannot be read as {name}: {reason(error)}", where=str(path), remedy=DAMAGED
        ) from None


def messages(kind: str, arguments: Sequence[str | None]) -> Iterator[Message]:
    """In the child process: unpacked size of each name, if the format declares it, then the signals."""
    path, names = Path(arguments[0] or ""), arguments[1:]
    if LIBRARIES[kind].unpacked is not None:
        with _library_errors(kind, path):
            declared = import_module(LIBRARIES[kind].reader).declared(path, names)
        yield {"declared": declared}, []
    for values, unit in reading(kind)(path, names):
        yield {"unit": unit}, [np.asarray(values, dtype=float)]


def answer_for(kind: str) -> None:
    """In the child process: `messages` with memory limits, except for HDF5, which declares its needs."""
    library = LIBRARIES[kind]

    def memory(arguments: Sequence[str]) -> int:
        return MEMORY_LIMIT + MEMORY_A_BYTE * Path(arguments[0]).stat().st_size

    modules = (*library.modules, library.reader)
    answer(lambda arguments: messages(kind, arguments), modules, memory if library.unpacked is None else None)


if __name__ == "__main__":
    answer_for(sys.argv[1])
