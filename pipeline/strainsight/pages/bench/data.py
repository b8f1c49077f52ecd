"""What the page of a bench shows; whoever has the artefacts fills it in.

Numbers are kept under the names that the stages give them in their summaries ("error.Fz"); all of them are in SI units.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from strainsight.estimation.decision import DIVERGED, FAULTS, LOST, Claim, check_ratio
from strainsight.pages.arrays import FloatArray, History, Reading
from strainsight.pages.placement.data import Criteria, MetricWords, Trend
from strainsight.records.bench import BenchEstimated, BenchPlaced, Simulated
from strainsight.runner.output import Scalar


@dataclass(frozen=True)
class BenchUnknown(History):
    """A load or a parameter that was estimated, a parameter's truth the same at every instant.

    errors, stds (runs,): error [unit] of every run over seeds and starts, and the parameter's claimed σ [unit] or None;
    there: the load [unit] on the bench that the measurements came from, where they came from one.
    """

    kind: Literal["input", "parameter"] = "input"
    errors: FloatArray | None = None
    stds: FloatArray | None = None
    there: FloatArray | None = None


@dataclass(frozen=True)
class BenchSensor:
    """Readings in time: time (T,) [s]; measured and expected (T, components), expected None where nothing was estimated;
    components: what each is called; units: the unit of each; used: whether the filter was given it."""

    name: str
    time: FloatArray
    measured: FloatArray
    expected: FloatArray | None
    components: tuple[str, ...]
    units: tuple[str, ...]
    used: bool = True


@dataclass(frozen=True)
class BenchStress:
    """Von Mises stress on the surface of a body: largest (T,) [Pa] at time (T,) [s]; element in which it is largest of all;
    allowable [Pa], None where none is stated."""

    body: str
    time: FloatArray
    largest: FloatArray
    element: int
    allowable: float | None = None

    @property
    def share(self) -> float | None:
        """Of the allowable that the largest stress is."""
        return None if self.allowable is None else float(np.max(self.largest)) / self.allowable

    @property
    def too_high(self) -> bool:
        """Whether it is beyond the allowable."""
        return self.share is not None and self.share > 1


@dataclass(frozen=True)
class PlacedGauges:
    """Gauges that were placed: trend of the metric; criteria: layouts by other rules, ours first, by every one of metrics; labels
    (g,) of the gauges."""

    placed: BenchPlaced
    trend: Trend
    metrics: tuple[MetricWords, ...] = ()
    criteria: tuple[Criteria, ...] = ()
    labels: tuple[str, ...] = ()

    @property
    def units(self) -> Mapping[str, str]:
        """Unit of every unknown, by name."""
        units = zip(self.placed.inputs, self.placed.units, strict=True)
        return {name: unit.replace("N m", "N·m") for name, unit in units}


@dataclass(frozen=True)
class PageRun:
    """One run: name of its config; label, note, study and group as in the suite; at: the value of the key that its study
    varies; reached: its last stage; page: relative link to its own page or None; numbers: stage → its summary; seeds:
    numbers of its estimates that there are once a seed, each (seeds,); warnings: sentences."""

    name: str
    label: str = ""
    note: str = ""
    study: str = ""
    group: str = ""
    at: float | None = None
    reached: str = ""
    page: str | None = None
    numbers: Mapping[str, Mapping[str, Scalar]] = field(default_factory=dict)
    seeds: Mapping[str, np.ndarray] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @property
    def summary(self) -> Mapping[str, Scalar]:
        """The numbers of its estimates, none where nothing was estimated."""
        return self.numbers.get("validate", {})

    def number(self, name: str) -> float | None:
        """A number of its estimates; None where there is none of that name, true as 1."""
        value = self.summary.get(name)
        return None if value is None or isinstance(value, str) else float(value)


@dataclass(frozen=True)
class BenchPageRun(PageRun):
    """A run of a bench, as far as it went: what it wrote, and of an estimate unknowns, sensors and channels by the others.

    loads: of the simulation, name → (unit, history (T,)); readings: of its sensors; turning: its drives whose motion is an angle.
    """

    simulated: Simulated | None = None
    loads: Mapping[str, tuple[str, FloatArray]] = field(default_factory=dict)
    readings: tuple[BenchSensor, ...] = ()
    turning: tuple[str, ...] = ()
    estimated: BenchEstimated | None = None
    unknowns: tuple[BenchUnknown, ...] = ()
    sensors: tuple[BenchSensor, ...] = ()
    hold_out: tuple[Reading, ...] = ()
    placement: PlacedGauges | None = None
    stress: BenchStress | None = None

    @property
    def summary(self) -> Mapping[str, Scalar]:
        """The numbers of the estimate, none where there is none."""
        return self.numbers.get("estimate", {})

    @property
    def is_estimated(self) -> bool:
        """Whether a filter has run."""
        return self.estimated is not None

    def claim(self, name: str) -> Claim | None:
        """Whether the estimate of an unknown keeps to its σ; None where no truth is known."""
        ratio, draws = (self.number(f"claim_{key}.{name}") for key in ("ratio", "draws"))
        return None if ratio is None or draws is None else check_ratio(ratio, int(draws))

    def faults(self, name: str) -> tuple[str, ...]:
        """What is wrong with the estimate of an unknown, the gravest first, empty where nothing is."""
        words = {self.summary.get(f"{key}.{name}") for key in ("claim", "verdict")}
        words |= {LOST} if self.summary.get(f"identified.{name}") is False else set()
        return tuple(word for word in FAULTS if word in words and word != DIVERGED)

    @property
    def all_faults(self) -> tuple[str, ...]:
        """What is wrong with the run, each once."""
        wrong = {fault for unknown in self.unknowns for fault in self.faults(unknown.name)}
        return tuple(word for word in FAULTS if word in wrong or (word == DIVERGED and self.number("lost")))
