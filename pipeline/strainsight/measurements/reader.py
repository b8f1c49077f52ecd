"""Any file of test data in, a `Recording` out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from strainsight.errors import UserError
from strainsight.measurements.csv_layout import TextFormat
from strainsight.measurements.records import Recording

FORMATS = {
    "csv": (".csv", ".txt", ".tsv", ".dat", ".asc", ".lvm"),
    "hdf5": (".h5", ".hdf5", ".hdf", ".nc"),
    "uff58": (".uff", ".unv", ".ufb", ".uff58", ".58"),
    "mdf": (".mf4", ".mdf"),
    "tdms": (".tdms",),
    "mat": (".mat",),
}
"""Format → endings of the names it has."""


SPREADSHEETS = (".xlsx", ".xls", ".xlsm", ".ods")


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
    """Read channels of a test, each as the file has it.

    channels: columns of a table, datasets, "node:direction" or id line of a function, "group/channel", variables; time:
    column, dataset, channel or variable of the clock, not for UFF58, and for MDF and TDMS only where it is not the file's
    own; time_unit: that of the file has to agree; rate: samples per second [Hz], in place of a clock; format: a key of FORMATS,
    or auto by the ending of the name; form: how a text table is written.
    Raises UserError for a file that cannot be imported, with its line.
    """
    path = Path(path)
    match format_of(path) if format == "auto" else format:
        case "csv":
            from strainsight.measurements.csv_file import read_csv

            return read_csv(path, channels, time=_clock(time, rate, path), time_unit=time_unit, rate=rate, form=form)
        case "hdf5":
            from strainsight.measurements.hdf5_file import read_hdf5

            return read_hdf5(path, channels, time=_clock(time, rate, path), time_unit=time_unit, rate=rate)
        case "uff58":
            from strainsight.measurements.uff58_file import read_uff58

            if time is not None or rate is not None:
                raise UserError(
                    f"the time {time or f'at {rate:g} Hz'!r} is asked for, but functions of a universal file carry their own",
                    where=str(path),
                    remedy="remove estimate.time",
                )
            return read_uff58(path, channels, time_unit=time_unit)
        case "mdf" | "tdms" as kind:
            from strainsight.measurements.daq_file import read_daq

            return read_daq(kind, path, channels, time=time, time_unit=time_unit, rate=rate)
        case "mat":
            from strainsight.measurements.daq_file import read_daq

            return read_daq("mat", path, channels, time=_clock(time, rate, path), time_unit=time_unit, rate=rate)
        case unknown:
            raise UserError(f"unknown format {unknown!r}", remedy=f"known formats: {', '.join(FORMATS)}")


def format_of(path: Path) -> str:
    """The format by the ending of the name. Raises UserError for an ending that says none."""
    ending = path.suffix.lower()
    for name, endings in FORMATS.items():
        if ending in endings:
            return name
    remedy = f"state it: {', '.join(FORMATS)}"
    if ending in SPREADSHEETS:
        remedy = "save the table as CSV, with a line of names above the numbers"
    raise UserError(f"the ending {ending!r} says no format of test data", where=str(path), remedy=remedy)


def _clock(time: str | None, rate: float | None, path: Path) -> str | None:
    """The name of the time of a file that has none of its own, None where a rate takes its place."""
    if time is None and rate is None:
        raise UserError(
            "the clock is not named",
            where=str(path),
            remedy="set estimate.time.channel to a column, dataset or variable, or estimate.time.rate to the sampling rate [Hz]",
        )
    return time
