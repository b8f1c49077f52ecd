"""What the page of a bench shows; whoever has the artefacts fills it in.

Numbers are kept under the names that the stages give them in their summaries ("error.Fz"); all of them are in SI units.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from strainsight.estimation.decision import BEYOND, CONTRADICTED, DIVERGED, LOST, OVERCONFIDENT, WITHHELD, Claim, judged
from strainsight.report.arrays import FloatArray, History
from strainsight.report.page.run import Run, Scalar
from strainsight.report.placement.data import Criteria, Metric, Trend
from strainsight.report.tested.data import HoldOut


@dataclass(frozen=True)
class BenchUnknown:
    """A load or a parameter that was estimated: its history, a parameter's truth the same at every instant.

    errors, stds (runs,): error [unit] of every run over seeds and starts, and the parameter's claimed σ [unit] or None;
    there: the load [unit] on the bench that the measurements came from, where they came from one.
    """

    kind: Literal["input", "parameter"]
    history: History
    errors: FloatArray | None = None
    stds: FloatArray | None = None
    there: FloatArray | None = None

    @property
    def name(self) -> str:
        return self.history.name


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
class BearingEstimate:
    """What a bearing carries by the estimate: highest pressure (k,) with its σ [Pa] at time (k,) [s]; at the instant `worst` of
    the highest one force (z, 4) with its σ [N] of every contact of every ball at station (z,) [rad]."""

    name: str
    time: FloatArray
    pressure: FloatArray
    pressure_std: FloatArray
    worst: float
    station: FloatArray
    force: FloatArray
    force_std: FloatArray


@dataclass(frozen=True)
class BenchEstimate:
    """What a filter made of a bench: unknowns, sensors, bearings; nis (T,) over the number of channels; violation (T+1,) of the
    constraints at time (T+1,) [s]; numbers: its summary; hold_out: channels as the others predict them."""

    time: FloatArray
    unknowns: tuple[BenchUnknown, ...]
    sensors: tuple[BenchSensor, ...]
    bearings: tuple[BearingEstimate, ...]
    nis: FloatArray
    violation: FloatArray
    numbers: Mapping[str, Scalar]
    hold_out: tuple[HoldOut, ...] = ()


@dataclass(frozen=True)
class BearingMotion:
    """A bearing in time: displacement (T, 5) [m, rad], load (T, 5) [N, N m], highest pressure (T,) [Pa]."""

    name: str
    displacement: FloatArray
    load: FloatArray
    pressure: FloatArray


@dataclass(frozen=True)
class DriveMotion:
    """A driven joint in time: position (T,) [rad or m], and force (T,) [N m or N] by which it does work; whether it turns."""

    name: str
    turns: bool
    position: FloatArray
    force: FloatArray


@dataclass(frozen=True)
class BenchMotion:
    """A bench in time (T,) [s]: inputs, name → (unit, history (T,)); sensors; bearings; drives; numbers: summary of simulate."""

    time: FloatArray
    inputs: Mapping[str, tuple[str, FloatArray]]
    sensors: tuple[BenchSensor, ...]
    bearings: tuple[BearingMotion, ...]
    numbers: Mapping[str, Scalar]
    drives: tuple[DriveMotion, ...] = ()


@dataclass(frozen=True)
class BenchStress:
    """Von Mises stress on the surface of a body: largest (T,) [Pa] at time (T,) [s]; element in which it is largest of all;
    allowable [Pa], None where none is stated; estimated: of the estimated motion, else of the simulated one."""

    body: str
    time: FloatArray
    largest: FloatArray
    element: int
    allowable: float | None = None
    estimated: bool = False

    @property
    def share(self) -> float | None:
        """Of the allowable that the largest stress is."""
        return None if self.allowable is None else float(np.max(self.largest)) / self.allowable


@dataclass(frozen=True)
class BenchPlacement:
    """Gauges that were placed: position and direction (g, 3), expected: input → its expected σ [unit] with the layout, and
    random: input → the same with every random layout (r,), inf where it is lost; numbers: the summary of place; units: input →
    N or N m; trend of the metric; criteria: layouts by other rules, ours first, by every one of metrics; loss (g,): the metric
    when each gauge fails, without: input → σ (g,) [unit] without each; advice: sentences; labels (g,)."""

    position: FloatArray
    direction: FloatArray
    expected: Mapping[str, float]
    random: Mapping[str, FloatArray]
    numbers: Mapping[str, Scalar]
    units: Mapping[str, str]
    trend: Trend
    loss: FloatArray
    without: Mapping[str, FloatArray]
    metrics: tuple[Metric, ...] = ()
    criteria: tuple[Criteria, ...] = ()
    advice: tuple[str, ...] = ()
    labels: tuple[str, ...] = ()


@dataclass(frozen=True)
class BenchRun(Run):
    """A run of a bench, as far as it went."""

    motion: BenchMotion | None = None
    estimate: BenchEstimate | None = None
    placement: BenchPlacement | None = None
    stress: BenchStress | None = None

    @property
    def summary(self) -> Mapping[str, Scalar]:
        """The numbers of the estimate, none where there is none."""
        return {} if self.estimate is None else self.estimate.numbers

    @property
    def unknowns(self) -> tuple[BenchUnknown, ...]:
        """What was estimated."""
        return () if self.estimate is None else self.estimate.unknowns

    @property
    def sensors(self) -> tuple[BenchSensor, ...]:
        """What the estimate was compared with."""
        return () if self.estimate is None else self.estimate.sensors

    def claim(self, name: str) -> Claim | None:
        """Whether the estimate of an unknown keeps to its σ; None where no truth is known."""
        ratio, draws = (self.number(f"claim_{key}.{name}") for key in ("ratio", "draws"))
        return None if ratio is None or draws is None else judged(ratio, int(draws))

    def faults(self, name: str) -> tuple[str, ...]:
        """What is wrong with the estimate of an unknown, empty where nothing is."""
        found = [OVERCONFIDENT] * (self.summary.get(f"claim.{name}") == OVERCONFIDENT)
        found += [LOST] * (self.summary.get(f"identified.{name}") is False)
        word = str(self.summary.get(f"verdict.{name}"))
        return (*found, *[word] * (word in (CONTRADICTED, BEYOND, WITHHELD)))

    @property
    def all_faults(self) -> tuple[str, ...]:
        """What is wrong with the run, each once."""
        found = [DIVERGED] * bool(self.number("lost"))
        return tuple(dict.fromkeys([*found, *(fault for own in self.unknowns for fault in self.faults(own.name))]))
