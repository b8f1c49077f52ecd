"""Test data in HDF5 files, read in a child process."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from strainsight.measurements.clock import recording_of
from strainsight.measurements.hdf5_datasets import declared, place_of, signals
from strainsight.measurements.records import Recording, opened
from strainsight.measurements.sandbox import answer, read_apart
from strainsight.processes import START_LIMIT, python

TIME_LIMIT = 7.0
"""[s] of processor time for every channel, and one more for every 10 MB of the file."""
UNPACKED = 5e7
"""[bytes] for which another second is there: what the table of a channel unpacks to."""
COMMAND = python("strainsight.measurements.hdf5_file")


def read_hdf5(
    path: Path,
    channels: Sequence[str],
    *,
    time: str | None = None,
    time_unit: str | None = None,
    rate: float | None = None,
    sandboxed: bool = True,
) -> Recording:
    """Datasets (T,) of an HDF5 file by their paths; "table[3]" is column 3, from 0, of a dataset (T, columns).

    time: path of the one clock; or rate: samples per second [Hz]. Units from the attribute `units` or `unit` of the dataset. The
    netCDF attributes _FillValue and missing_value mark missing samples, beside NaN. sandboxed: in a child process.
    Raises UserError as `signals` does, where the time has no unit or a sample none, the memory does not hold what the file
    declares, and where the library fails.
    """
    path = Path(path)
    with opened(path) as file:
        limits = START_LIMIT, TIME_LIMIT + os.fstat(file.fileno()).st_size / 1e7
    names = [time or channels[0], *channels]
    places = [place_of(path, name) for name in names]
    read = read_apart(COMMAND, path, names, places, limits, "HDF5", UNPACKED) if sandboxed else signals(path, names)
    return recording_of(list(read), channels, path, places[0], time_unit, rate)


if __name__ == "__main__":
    answer(signals, ["h5py"], declared=declared)
