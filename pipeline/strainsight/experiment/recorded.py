"""A load history from a file of the config: `signal: {type: csv}`."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np

from strainsight.config.loads import Recorded
from strainsight.errors import ConfigError, UserError, blame
from strainsight.loads.histories import FromSamples
from strainsight.measurements.csv_file import read_csv
from strainsight.measurements.csv_layout import TextFormat
from strainsight.measurements.marks import check_marks
from strainsight.measurements.records import Recording
from strainsight.measurements.units import meant_by, required_unit

LOADS = ("force", "moment", "pressure", "acceleration", "ratio", "angular velocity squared")

QUANTITY = {
    "N": "force",
    "N m": "moment",
    "Pa": "pressure",
    "1": "ratio",
    "m/s²": "acceleration",
    "rad²/s²": "angular velocity squared",
}
"""Unit of a load → what a file may hold of it."""
NO_UNIT = ("-", "–")
NO_GAPS = "a load history has no gaps: give the value, or drop the line"


def recorded(key: str, config: Recorded, path: Path, of: Sequence[str] = LOADS) -> FromSamples:
    """The history that the text table at `path` holds in the columns that the config names; key: of the signal; of: the
    quantities that it may be of.

    Time in s, values in the SI unit of the load, or in the unit that stands behind the name of the column, as in "F [kN]".
    Raises UserError with file:line for what is no table, a sample that is missing, and a time that does not increase.
    """
    column = config.value_column
    with blame(key):
        try:
            found = _read(path, config.time_column, column)
        except UserError as error:
            if error.key in (config.time_column, column):
                error.key = f"{key}.{'value' if error.key == column else 'time'}_column"
            raise
        values = found.channels[column]
        missing = np.flatnonzero(np.isnan(values))
        if missing.size:
            raise UserError(
                f"no sample under {column!r}",
                where=found.place(int(missing[0])),
                remedy=NO_GAPS,
            )
        check_marks(found, column, found.units[column] or "", NO_GAPS, negative=True)
        back = np.flatnonzero(np.diff(found.time) <= 0)
        if back.size:
            i = int(back[0])
            raise UserError(
                f"the time does not increase from {found.time[i]:.9g} s to {found.time[i + 1]:.9g} s",
                where=found.place(i + 1),
                remedy="sort the record and drop repeated times",
            )
        return FromSamples(found.time, values * _factor(column, found, path, of))


def _read(path: Path, time: str, column: str) -> Recording:
    """The two columns: with decimal points or else commas, the time in s or else in the unit that the file states."""
    first: UserError | None = None
    for form, unit in product((TextFormat(), TextFormat(decimal=",")), ("s", None)):
        try:
            return read_csv(path, [column], time=time, time_unit=unit, form=form)
        except UserError as error:
            first = first or error
    assert first is not None
    raise first


def _factor(column: str, found: Recording, path: Path, of: Sequence[str]) -> float:
    """SI units in one of the unit that the file states, 1 where it states none. Raises ConfigError for one that is not known, or
    of another quantity."""
    stated = found.units[column] or _in_round_brackets(column)
    if stated is None or stated in NO_UNIT:
        return 1.0
    try:
        unit = required_unit(stated, of)
    except UserError as error:
        raise ConfigError(
            f"{column!r} is in {stated}, {path.name} says: no unit that is known", remedy=error.remedy
        ) from None
    if unit.quantity not in of:
        what = (
            "a load"
            if set(of) == set(LOADS)
            else f"a load that is a {of[0]}"
            if set(of) <= set(LOADS)
            else " or ".join(of)
        )
        raise ConfigError(
            f"{column!r} is in {stated}, {path.name} says: no unit of {what}",
            remedy=f"name the column of {'the load' if set(of) <= set(LOADS) else 'what the history is of'}",
        )
    return unit.factor


def _in_round_brackets(column: str) -> str | None:
    """What stands behind a name, as in "F (KN)", where it is almost a unit: a known one was taken off by the reader."""
    inside = column.rstrip().removesuffix(")").rpartition("(")[2].strip() if column.rstrip().endswith(")") else ""
    return inside if inside and meant_by(inside) else None
