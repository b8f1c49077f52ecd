"""Contents of the page of a test, as arrays and names.

Unknown contents are None or empty, e.g. loads in a test with parameters only. σ is NaN or None if it is withheld."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from strainsight.pages.arrays import FloatArray, History, Reading
from strainsight.pages.picture.layout import PictureLayout
from strainsight.records.estimated import Compared, Posterior, TestSource
from strainsight.runner.output import Table


@dataclass(frozen=True)
class Extremes:
    """Minimum and maximum [unit] of a signal, NaN without samples, and their instants [s]."""

    low: float
    low_at: float
    high: float
    high_at: float

    @property
    def largest(self) -> tuple[float, float]:
        """Extreme with the larger absolute value, and its instant."""
        return (self.low, self.low_at) if abs(self.low) > abs(self.high) else (self.high, self.high_at)


def peak_of(time: FloatArray, values: FloatArray) -> Extremes:
    """Extremes of the finite values (T,) [unit] at time (T,) [s]."""
    known = np.flatnonzero(np.isfinite(values))
    if not len(known):
        return Extremes(np.nan, np.nan, np.nan, np.nan)
    low, high = known[np.argmin(values[known])], known[np.argmax(values[known])]
    return Extremes(float(values[low]), float(time[low]), float(values[high]), float(time[high]))


@dataclass(frozen=True)
class TestedUnknown:
    """Load or parameter: estimate, for a load its RMS [unit]; std [unit]: σ, None if withheld; peak of a load, peak_std: its σ,
    None if withheld; doubts: warnings about it."""

    name: str
    unit: str
    kind: Literal["load", "parameter"]
    estimate: float
    std: float | None
    peak: Extremes | None = None
    doubts: tuple[str, ...] = ()
    peak_std: float | None = None

    @property
    def relative(self) -> float:
        """σ divided by the absolute estimate, NaN if unknown."""
        return self.std / abs(self.estimate) if self.std is not None and self.estimate else np.nan


@dataclass(frozen=True)
class Spectrum:
    """Spectrum of a signal: density (k,) [unit²/Hz] at frequency (k,) [Hz]; level: density of the configured noise or None."""

    name: str
    unit: str
    frequency: FloatArray
    density: FloatArray
    level: float | None = None


@dataclass(frozen=True)
class Map:
    """Quantity on every facet of the structure: values (f,) [unit], std (f,) or None."""

    quantity: str
    unit: str
    values: FloatArray
    std: FloatArray | None = None


@dataclass(frozen=True)
class SurfaceMoment:
    """Surface at the instant [s] of the largest reading (channel `label`): shift (n, 3) [m] of the layout's points, magnified by
    `factor`; maps."""

    time: float
    label: str
    shift: FloatArray
    factor: float
    maps: tuple[Map, ...]


@dataclass(frozen=True)
class File:
    """Measurement file: rate [Hz], first instant [s], duration [s] and number of the samples."""

    source: TestSource
    rate: float
    start: float
    duration: float
    samples: int


@dataclass(frozen=True)
class Findings:
    """Contents of the page of a test.

    innovations: sentence on them; consistent: whether they are consistent; warnings: most serious first, beginning with
    the reason for a withheld σ; notes: operations on the measurements;
    histories: unknowns over time; readings: in the order of the config; residuals: their spectra; hold_out: gauges that the
    filter does not use; checked: every channel compared with its prediction; damage: hot spots and virtual gauges, None if not
    requested; moment: None without a surface; facts: results by stage; record: its name if the test has several;
    other_records: (name, page) of them; page: of this record; inside: share of the innovations within 2σ;
    consistency: of the record with the model and the others."""

    name: str
    title: str
    unknowns: tuple[TestedUnknown, ...]
    innovations: str
    consistent: bool
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    layout: PictureLayout
    histories: tuple[History, ...]
    file: File
    readings: tuple[Reading, ...]
    residuals: tuple[Spectrum, ...] = ()
    resultants: tuple[History, ...] = ()
    known: tuple[History, ...] = ()
    load_spectra: tuple[Spectrum, ...] = ()
    posteriors: Mapping[str, Posterior] = field(default_factory=dict)
    filters: Compared | None = None
    budget: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    hold_out: tuple[Reading, ...] = ()
    checked: Table | None = None
    damage: Table | None = None
    moment: SurfaceMoment | None = None
    facts: Mapping[str, str] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)
    record: str = ""
    other_records: tuple[tuple[str, str], ...] = ()
    page: str = ""
    inside: float = np.nan
    consistency: str = ""

    @property
    def units(self) -> Mapping[str, str]:
        """Unit of every unknown, by name."""
        return {unknown.name: unknown.unit for unknown in self.unknowns}

    @property
    def loads(self) -> tuple[TestedUnknown, ...]:
        """Unknown loads."""
        return tuple(unknown for unknown in self.unknowns if unknown.kind == "load")
