"""Everything that the page of a test shows, as arrays and names; whoever has the artefacts fills it in.

What is not known is None or empty: the page of parameters alone has no load, that of loads alone no parameter. σ is NaN or None
where it is withheld.
"""

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
    """The least and the largest value of a signal [unit], NaN where it has none, and when [s]."""

    low: float
    low_at: float
    high: float
    high_at: float

    @property
    def largest(self) -> tuple[float, float]:
        """The one of larger size, and when."""
        return (self.low, self.low_at) if abs(self.low) > abs(self.high) else (self.high, self.high_at)


def peak_of(time: FloatArray, values: FloatArray) -> Extremes:
    """time (T,) [s], values (T,) [unit], of which those count that are finite."""
    known = np.flatnonzero(np.isfinite(values))
    if not len(known):
        return Extremes(np.nan, np.nan, np.nan, np.nan)
    low, high = known[np.argmin(values[known])], known[np.argmax(values[known])]
    return Extremes(float(values[low]), float(time[low]), float(values[high]), float(time[high]))


@dataclass(frozen=True)
class TestedUnknown:
    """A load or a parameter: estimate, of a load its RMS [unit]; std [unit] one σ, None where it is withheld; peak of a load,
    peak_std its σ where that is not withheld; doubts: sentences about it alone."""

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
        """σ over the size of the estimate, NaN where either is not known."""
        return self.std / abs(self.estimate) if self.std is not None and self.estimate else np.nan


@dataclass(frozen=True)
class Spectrum:
    """Of a signal: density (k,) [unit²/Hz] at frequency (k,) [Hz]; level: that of the stated noise, None where there is none."""

    name: str
    unit: str
    frequency: FloatArray
    density: FloatArray
    level: float | None = None


@dataclass(frozen=True)
class Map:
    """A quantity on every facet of the structure: values (f,) [unit], std (f,) or None where it is not known."""

    quantity: str
    unit: str
    values: FloatArray
    std: FloatArray | None = None


@dataclass(frozen=True)
class SurfaceMoment:
    """The surface at the moment [s] of the largest reading, of the channel `label`: shift (n, 3) [m] of the layout's points, as
    large as it is to be seen, `factor` times itself; maps."""

    time: float
    label: str
    shift: FloatArray
    factor: float
    maps: tuple[Map, ...]


@dataclass(frozen=True)
class File:
    """The file of the test as it was read: rate [Hz], first instant [s] and duration [s] of the samples; how many there are."""

    source: TestSource
    rate: float
    start: float
    duration: float
    samples: int


@dataclass(frozen=True)
class Findings:
    """All that the page of a test shows.

    verdict: a sentence on the innovations, consistent: whether it is a good one; warnings: sentences, the gravest first, the
    reason why σ is withheld before all; notes: what was done to the measurements;
    histories: every unknown in time, resultants and known loads; load_spectra: of every unknown load; readings in the order of
    the config, residuals: their spectra; hold_out: what gauges predict that the filter was not given, empty where none was
    left out; checked: every channel against what the others say of it, damage: hot spots and virtual gauges, None where not asked
    for; moment: None where the mesh has no surface; facts: what was found by which stage; record: its name, where the test
    has several; beside: (name, page) of what there is to see of the others, page: its own; inside: share of the innovations
    within 2σ; judged: whether the record agrees with the model and the others, in words.
    """

    name: str
    title: str
    unknowns: tuple[TestedUnknown, ...]
    verdict: str
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
    beside: tuple[tuple[str, str], ...] = ()
    page: str = ""
    inside: float = np.nan
    judged: str = ""

    @property
    def units(self) -> Mapping[str, str]:
        """Unit of every unknown, by name."""
        return {unknown.name: unknown.unit for unknown in self.unknowns}

    @property
    def loads(self) -> tuple[TestedUnknown, ...]:
        """The unknown loads."""
        return tuple(unknown for unknown in self.unknowns if unknown.kind == "load")
