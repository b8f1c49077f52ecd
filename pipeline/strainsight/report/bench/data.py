"""What the pages of benches show: one run, or a suite of runs with studies and claims; whoever has the artefacts fills it in.

Numbers are kept under the names that the stages give them in their summaries ("error.Fz"); all of them are in SI units.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from strainsight.report.placement.data import FloatArray, History, IntArray

Scalar = float | int | str | bool
CONFIRMED, CONTRADICTED, UNDECIDED = "confirmed", "contradicted", "no number"


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
class BenchEstimate:
    """What a filter made of a bench: unknowns, sensors; nis (T,) over the number of channels; violation (T+1,) of the
    constraints at time (T+1,) [s]; numbers: its summary."""

    time: FloatArray
    unknowns: tuple[BenchUnknown, ...]
    sensors: tuple[BenchSensor, ...]
    nis: FloatArray
    violation: FloatArray
    numbers: Mapping[str, Scalar]


@dataclass(frozen=True)
class BearingMotion:
    """A bearing in time: displacement (T, 5) [m, rad], load (T, 5) [N, N m], highest pressure (T,) [Pa]."""

    name: str
    displacement: FloatArray
    load: FloatArray
    pressure: FloatArray


@dataclass(frozen=True)
class BenchMotion:
    """A bench in time (T,) [s]: inputs, name → (unit, history (T,)); sensors; bearings; numbers: the summary of simulate."""

    time: FloatArray
    inputs: Mapping[str, tuple[str, FloatArray]]
    sensors: tuple[BenchSensor, ...]
    bearings: tuple[BearingMotion, ...]
    numbers: Mapping[str, Scalar]


@dataclass(frozen=True)
class BenchPlacement:
    """Gauges that were placed: position and direction (g, 3), expected: input → its expected σ [unit] with the layout, and
    random: input → the same with every random layout (r,), inf where it is lost; count (s,), trace (s,): the metric while
    gauges are taken away; numbers: the summary of place; units: input → N or N m, where they are known."""

    position: FloatArray
    direction: FloatArray
    expected: Mapping[str, float]
    random: Mapping[str, FloatArray]
    count: IntArray
    trace: FloatArray
    numbers: Mapping[str, Scalar]
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class BenchRun:
    """One run: names and texts as in a suite's config; at: the value of the key that its study varies; page: relative link to
    its own page or None; numbers: stage → its summary; warnings: what its stages warned of."""

    name: str
    label: str = ""
    note: str = ""
    study: str = ""
    group: str = ""
    at: float | None = None
    reached: str = ""
    page: str | None = None
    motion: BenchMotion | None = None
    estimate: BenchEstimate | None = None
    placement: BenchPlacement | None = None
    numbers: Mapping[str, Mapping[str, Scalar]] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @property
    def told(self) -> Mapping[str, Scalar]:
        """The numbers of the estimate, none where there is none."""
        return {} if self.estimate is None else self.estimate.numbers

    def number(self, name: str) -> float | None:
        """A number of the estimate; None where there is none of that name, true as 1."""
        value = self.told.get(name)
        return None if value is None or isinstance(value, str) else float(value)


@dataclass(frozen=True)
class BenchStudy:
    """A question that several runs answer: name, note; over: the key they vary or None; numbers that are drawn over it, or
    none for the errors; runs: places of its runs in the suite."""

    name: str
    note: str
    over: str | None
    numbers: tuple[str, ...]
    runs: tuple[int, ...]


@dataclass(frozen=True)
class BenchClaim:
    """A statement and the numbers that it stands or falls with: found, (place of the run, name of the number, value); above
    and below: bounds or None; equals: what a number that is true or false has to be; compared: what it was divided by."""

    text: str
    found: tuple[tuple[int, str, float], ...]
    above: float | None = None
    below: float | None = None
    equals: bool | None = None
    unit: str = ""
    compared: str = ""

    @property
    def verdict(self) -> str:
        """Confirmed where every number is within the bounds; no number where one is none and the others are."""
        verdicts = [self.holds(value) for _, _, value in self.found]
        if not all(verdict is not False for verdict in verdicts):
            return CONTRADICTED
        return UNDECIDED if None in verdicts or not verdicts else CONFIRMED

    def holds(self, value: float) -> bool | None:
        """Whether a number is within the bounds; None for what is no number."""
        if math.isnan(value):
            return None
        if self.equals is not None:
            return bool(value) == self.equals
        return (self.above is None or value > self.above) and (self.below is None or value < self.below)


@dataclass(frozen=True)
class BenchSuite:
    """All that the page of a suite of benches shows."""

    name: str
    title: str
    runs: tuple[BenchRun, ...]
    studies: tuple[BenchStudy, ...]
    claims: tuple[BenchClaim, ...]
    provenance: Mapping[str, str] = field(default_factory=dict)
