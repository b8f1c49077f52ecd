"""Test data in HDF5 files, read in a child process.

The library ends the whole process with a segmentation fault on some damaged files, and never ends on others (seen with
HDF5 2.0, a few altered bytes in four of four thousand files); in a child process that costs the file and not the run.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import IO

import numpy as np

from strainsight.errors import UserError
from strainsight.measurements.hdf5_datasets import DAMAGED, place_of, signals
from strainsight.measurements.records import Recording, opened
from strainsight.measurements.units import time_factor
from strainsight.processes import START_LIMIT, asked_of_reader, python, reader

TIME_LIMIT = 7.0
"""[s] for every channel, and one more for every 10 MB of the file."""
COMMAND = python("strainsight.measurements.hdf5_file")


def read_hdf5(
    path: Path, channels: Sequence[str], *, time: str, time_unit: str | None = None, sandboxed: bool = True
) -> Recording:
    """Datasets (T,) of an HDF5 file by their paths; "table[3]" is column 3, from 0, of a dataset (T, columns).

    time: path of the one clock. Units from the attribute `units` or `unit` of the dataset. The netCDF attributes
    _FillValue and missing_value mark missing samples, beside NaN. sandboxed: in a child process.
    Raises UserError as `signals` does, where the time has no unit or a sample none, and where the library fails.
    """
    path = Path(path)
    with opened(path) as file:
        size = os.fstat(file.fileno()).st_size
    names = [time, *channels]
    found = list(_sandboxed(path, names, TIME_LIMIT + size / 1e7) if sandboxed else signals(path, names))
    t, unit = found[0]
    factor = time_factor(time_unit, unit, place_of(path, time))
    if not np.isfinite(t).all():
        raise UserError(
            f"sample {int(np.argmin(np.isfinite(t))) + 1} of the time is missing",
            where=place_of(path, time),
            remedy="give every sample its time, or drop it",
        )
    values = {name: read for name, (read, _) in zip(channels, found[1:], strict=True)}
    return Recording(
        t * factor, values, {name: said for name, (_, said) in zip(channels, found[1:], strict=True)}, str(path)
    )


def _sandboxed(path: Path, names: Sequence[str], limit: float) -> Iterator[tuple[np.ndarray, str | None]]:
    """`signals`, from a child process: for every name a line of JSON, {samples, unit} or the error, then the samples."""
    with reader(COMMAND, [str(path), *names], START_LIMIT) as within:
        for name in names:
            yield within(limit, partial(_received, where=place_of(path, name)))


def _received(stream: IO[bytes], where: str) -> tuple[np.ndarray, str | None]:
    line = stream.readline()
    try:
        said = json.loads(line)
    except ValueError:
        said = {}
    if "what" in said:
        raise UserError(said["what"], where=said["where"], remedy=said["remedy"])
    values = np.empty(said.get("samples", 0))
    view, filled = values.view(np.uint8), 0
    while filled < len(view) and (count := stream.readinto(view[filled:])):  # type: ignore[attr-defined]
        filled += count
    if not said or filled < len(view):
        raise UserError("the HDF5 library crashed, or did not come to an end", where=where, remedy=DAMAGED)
    return values, said["unit"]


def _child() -> None:
    path, *names = asked_of_reader("h5py")
    out = sys.stdout.buffer
    try:
        for values, unit in signals(Path(path), names):
            out.write(json.dumps({"samples": values.size, "unit": unit}).encode() + b"\n")
            out.write(np.ascontiguousarray(values).data)
            out.flush()
    except UserError as error:
        out.write(json.dumps({"what": error.what, "where": error.where, "remedy": error.remedy}).encode() + b"\n")


if __name__ == "__main__":
    _child()
