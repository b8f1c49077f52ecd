"""Test data in MDF, TDMS and MAT files, each by a library of its own, in a child process with limits of time and memory."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from strainsight.errors import UserError
from strainsight.measurements.clock import counted, recording_of
from strainsight.measurements.records import Recording, opened
from strainsight.measurements.sandbox import DAMAGED, Read, Signals, answer, read_apart
from strainsight.processes import START_LIMIT, python

TIME_LIMIT = 20.0
"""[s] for every channel, and one more for every 5 MB of the file."""
MEMORY_LIMIT = 1 << 30
"""[bytes] that reading may take, and MEMORY_A_BYTE more for every one of the file."""
MEMORY_A_BYTE = 20
COMMAND = python("strainsight.measurements.daq_file")
EXTRA = "daq"


@dataclass(frozen=True)
class Library:
    """What reads a format: its name for messages, the modules of the library, the package that holds them where it is not
    installed with this one, and the module here whose `signals` calls it."""

    format: str
    modules: tuple[str, ...]
    package: str | None
    reader: str


LIBRARIES = {
    "mdf": Library("MDF", ("asammdf",), "asammdf", "strainsight.measurements.mdf"),
    "tdms": Library("TDMS", ("nptdms",), "npTDMS", "strainsight.measurements.tdms"),
    "mat": Library("MAT", ("scipy.io", "h5py"), None, "strainsight.measurements.mat"),
}


def read_daq(
    kind: str,
    path: Path,
    channels: Sequence[str],
    *,
    time: str | None = None,
    time_unit: str | None = None,
    rate: float | None = None,
    sandboxed: bool = True,
) -> Recording:
    """Channels of a file of the kind mdf, tdms or mat, as the `signals` of its reader has them.

    time: that of the clock; None where the file has its own; or rate: samples per second [Hz]. sandboxed: in a child process.
    Raises UserError as the reader does, where its library is not installed, and where that fails.
    """
    path, library = Path(path), LIBRARIES[kind]
    with opened(path) as file:
        size = os.fstat(file.fileno()).st_size
    if library.package is not None and find_spec(library.modules[0]) is None:
        raise UserError(
            f"a {library.format} file is read by {library.package}, which is not installed",
            where=str(path),
            remedy=f'install it: pip install "strainsight[{EXTRA}]"',
        )
    names = [time if rate is None else channels[0], *channels]
    limits = START_LIMIT, TIME_LIMIT + size / 5e6
    places = [str(path)] * len(names)
    read = (
        read_apart([*COMMAND, kind], path, names, places, limits, library.format)
        if sandboxed
        else reading(kind)(path, names)
    )
    found = list(read)
    t, unit = found[0]
    if time is not None and kind == "mat" and t.size == 1 and len(found) > 1 and found[1][0].size > 1:
        found[0] = counted(float(t[0]), found[1][0].size, time, time_unit, unit, str(path))
        time_unit = None
    return recording_of(found, channels, path, f"{path}, {time}" if time else str(path), time_unit, rate)


def reading(kind: str) -> Read:
    """The `signals` of the reader of a kind, where all that its library raises is a UserError."""
    library = LIBRARIES[kind]

    def read(path: Path, names: Sequence[str | None]) -> Signals:
        try:
            yield from import_module(library.reader).signals(path, names)
        except UserError:
            raise
        except MemoryError:
            raise UserError(
                f"reading it as {library.format} takes more memory than a file of its size may",
                where=str(path),
                remedy=f"{DAMAGED}; or export a part of the record",
            ) from None
        except Exception as error:  # the libraries have no classes of their own for damaged files
            reason = f"cannot be read as {library.format}: {' '.join(str(error).split())[:200] or type(error).__name__}"
            raise UserError(reason, where=str(path), remedy=DAMAGED) from None

    return read


if __name__ == "__main__":
    library = LIBRARIES[sys.argv[1]]
    answer(reading(sys.argv[1]), (*library.modules, library.reader), lambda size: MEMORY_LIMIT + MEMORY_A_BYTE * size)
