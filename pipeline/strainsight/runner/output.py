"""What a stage returns: arrays with units, a few scalars, one line for the reader."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

Scalar = float | int | str | bool


@dataclass(frozen=True)
class Dataset:
    """One array of an artefact.

    array        numbers, booleans or strings, any shape
    unit         "m", "Hz", "strain", "1" for dimensionless; "" only under /VTKHDF
    description  one line, axes named: "strain of every candidate (time × candidate)"
    scales       path of the dataset that labels each axis, "" for an axis without one: ("/time", "")
    """

    array: np.ndarray
    unit: str
    description: str
    scales: tuple[str, ...] = ()


@dataclass(frozen=True)
class Table:
    """A table for people, printed at the end of `run`; every cell is already text."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


WARNINGS = "warnings"
"""Title of the table of a stage's warnings."""


def warnings_table(texts: Sequence[str]) -> tuple[Table, ...]:
    """A table of warnings, none for no texts."""
    return (Table(WARNINGS, ("",), tuple((text,) for text in texts)),) if texts else ()


def warnings_in(tables: Iterable[Table]) -> tuple[str, ...]:
    """Texts of tables titled `WARNINGS`, and of rows that begin with "warning"."""
    return tuple(row[-1] for table in tables for row in table.rows if table.title == WARNINGS or row[0] == "warning")


@dataclass(frozen=True)
class Output:
    """The whole result of a stage; the same inputs must give the same Output (no clock, no path in it).

    datasets    path ("/reduced/mass/constant") → Dataset
    summary     small scalars that --json prints
    message     one line: "100 → 4, gap 0.000 %, E ± 0.08 %"
    tables      printed at the end of `run`
    attributes  group or dataset path → attributes; under /VTKHDF they are written exactly as given
    files       file name → content, written beside the artefact ("report.html")
    inputs      files the stage found while running beside its declared ones (a deck's INCLUDEs): a change runs it again
    """

    datasets: Mapping[str, Dataset]
    summary: Mapping[str, Scalar]
    message: str
    tables: tuple[Table, ...] = ()
    attributes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    files: Mapping[str, bytes] = field(default_factory=dict)
    inputs: tuple[Path, ...] = ()
