"""Contents of the page of a bench.

Numbers have the names of the stage summaries ("error.Fz") and SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from strainsight.estimation.decision import DIVERGED, FAULTS, LOST, Claim, check_ratio
from strainsight.pages.arrays import FloatArray, History, Reading
from strainsight.pages.placement.data import Criteria, MetricWords, Trend
from strainsight.records.bench import BenchEstimated, Simulated
from strainsight.records.bench_placed import BenchPlaced
from strainsight.runner.output import Scalar


@dataclass(frozen=True)
class BenchUnknown(History):
    """Estimated load or parameter; the truth of a parameter is constant.

    errors, stds (runs,): error [unit] of every run over seeds and starts, and claimed σ [unit] of a parameter or None;
    unscaled: load [unit] on the bench with the measurements, or None."""

    kind: Literal["input", "parameter"] = "input"
    errors: FloatArray | None = None
    stds: FloatArray | None = None
    unscaled: FloatArray | None = None


@dataclass(frozen=True)
class BenchSensor:
    """Readings: time (T,) [s]; measured and expected (T, components), expected None without an estimate; components, units: name
    and unit of each; used: whether the filter uses the sensor."""

    name: str
    time: FloatArray
    measured: FloatArray
    expected: FloatArray | None
    components: tuple[str, ...]
    units: tuple[str, ...]
    used: bool = True


@dataclass(frozen=True)
class BenchStress:
    """Von Mises stress on the surface of a body: largest (T,) [Pa] at time (T,) [s]; element with the largest stress;
    allowable [Pa], None if not configured."""

    body: str
    time: FloatArray
    largest: FloatArray
    element: int
    allowable: float | None = None

    @property
    def share(self) -> float | None:
        """Largest stress divided by the allowable."""
        return None if self.allowable is None else float(np.max(self.largest)) / self.allowable

    @property
    def too_high(self) -> bool:
        """Whether the stress exceeds the allowable."""
        return self.share is not None and self.share > 1


@dataclass(frozen=True)
class PlacedGauges:
    """Placed gauges: trend of the metric; criteria: this layout and those of other rules, by every metric; labels (g,) of the
    gauges."""

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
    """Run of a suite.

    name: of its config; label, note, study, group: as in the suite; at: value of the key varied by its study;
    reached: last stage; page: relative link to its page or None; numbers: stage → summary; seeds: numbers (seeds,) of its
    estimates by seed; warnings: sentences."""

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
        """Numbers of the validation, empty without one."""
        return self.numbers.get("validate", {})

    def number(self, name: str) -> float | None:
        """Number of its estimates, None if it does not exist; true is 1."""
        value = self.summary.get(name)
        return None if value is None or isinstance(value, str) else float(value)


@dataclass(frozen=True)
class BenchPageRun(PageRun):
    """Run of a bench, as far as it was computed.

    loads: of the simulation, name → (unit, history (T,)); readings: of its sensors; turning: drives whose motion is an angle;
    hold_out: channels predicted from the other channels."""

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
        """Numbers of the estimate, empty without one."""
        return self.numbers.get("estimate", {})

    @property
    def is_estimated(self) -> bool:
        """Whether a filter has run."""
        return self.estimated is not None

    def claim(self, name: str) -> Claim | None:
        """Consistency of the error of an unknown with its σ; None without a truth."""
        ratio, draws = (self.number(f"claim_{key}.{name}") for key in ("ratio", "draws"))
        return None if ratio is None or draws is None else check_ratio(ratio, int(draws))

    def faults(self, name: str) -> tuple[str, ...]:
        """Problems of the estimate of an unknown, most serious first."""
        words = {self.summary.get(f"{key}.{name}") for key in ("claim", "verdict")}
        words |= {LOST} if self.summary.get(f"identified.{name}") is False else set()
        return tuple(word for word in FAULTS if word in words and word != DIVERGED)

    @property
    def all_faults(self) -> tuple[str, ...]:
        """Problems of the run, each once."""
        wrong = {fault for unknown in self.unknowns for fault in self.faults(unknown.name)}
        return tuple(word for word in FAULTS if word in wrong or (word == DIVERGED and self.number("lost")))
