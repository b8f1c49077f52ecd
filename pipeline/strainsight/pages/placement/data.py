"""Data of a placement page.

Errors and standard deviations without a unit are relative (0.01 is one per cent). The reference is the true value of a parameter,
and the RMS of a load, or its amplitude if the load is zero."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from strainsight.config.placement import Report
from strainsight.estimation.decision import Benefit, Claim
from strainsight.pages.arrays import FloatArray, History, IntArray, Reading
from strainsight.pages.picture.layout import PictureLayout
from strainsight.records.estimated import Compared, Posterior
from strainsight.records.placed import ByCase, FrequencyResponse
from strainsight.runner.output import Table


@dataclass(frozen=True)
class Repeats:
    """Estimates with other seeds and starts: error (n,), claimed_std (n,) relative, and whether the starts agree."""

    error: FloatArray
    claimed_std: FloatArray
    identified: bool

    @property
    def lost(self) -> int:
        """Number of diverged runs."""
        return int(np.count_nonzero(~np.isfinite(self.error)))

    @property
    def worst(self) -> float:
        """Largest error, ∞ if a run diverged."""
        return math.inf if self.lost else float(np.max(np.abs(self.error)))


@dataclass(frozen=True)
class Unknown:
    """One unknown; values that were not computed are None.

    name, unit      in SI ("E", "Pa")
    kind            "input" (a load history) or "parameter" (one number)
    reference       of expected_std: guess of a parameter, RMS of a load in the training simulation [unit]
    truth           parameter: true value; load: RMS of the true history [unit]
    estimate        parameter: mean over the last half; load: RMS of the estimated history [unit]
    error           relative: parameter |estimate/truth − 1|; load: RMS error, both after the first tenth
    std             relative: σ of the filter over the same span
    smoothed_error, smoothed_std  `error` and `std` of the smoothed estimate
    expected_std    relative to `reference`: σ expected at placement; with load cases in the worst one
    zero            whether a load is zero, so that relative values refer to its amplitude, then in `reference`
    claims          calibration of σ, the decisive one first
    benefit         comparison with random layouts of the same size
    withheld        whether σ is withheld because a parameter is outside its range; std and smoothed_std are None
    worst_case      load case of expected_std, empty without load cases
    repeats         estimates with other seeds and starts
    """

    name: str
    unit: str
    kind: Literal["input", "parameter"]
    reference: float = math.nan
    truth: float | None = None
    estimate: float | None = None
    error: float | None = None
    std: float | None = None
    smoothed_error: float | None = None
    expected_std: float | None = None
    zero: bool = False
    smoothed_std: float | None = None
    claims: tuple[Claim, ...] = ()
    benefit: Benefit | None = None
    worst_case: str = ""
    withheld: bool = False
    repeats: Repeats | None = None

    @property
    def lost(self) -> bool:
        """Whether estimates from different starts disagree."""
        return self.repeats is not None and not self.repeats.identified


@dataclass(frozen=True)
class MetricWords:
    """Criterion of a layout as a formula and in words."""

    symbol: str
    meaning: str


@dataclass(frozen=True)
class Trend:
    """Metric during elimination.

    count (s,): remaining gauges, descending; value (s,): metric, dimensionless; blocks: unknown → (s,) scaled variance; final:
    metric after exchange; lower_bound: for layouts of the final size; gap = 1 − lower_bound / final."""

    count: IntArray
    value: FloatArray
    blocks: Mapping[str, FloatArray]
    final: float
    metric: MetricWords
    lower_bound: float | None = None
    gap: float | None = None


@dataclass(frozen=True)
class Criteria:
    """One layout scored by every criterion (inf: an unknown is unobservable).

    rule: its origin ("elimination, exchange", "log-determinant", "effective independence", "random, median of 10"); values: by
    metric, in the order of `PlacementReport.metrics`; std: unknown → steady-state σ [SI], only for ranking."""

    rule: str
    values: tuple[float, ...]
    std: Mapping[str, float]

    @property
    def chosen(self) -> float:
        """Metric of the layout."""
        return self.values[0]


@dataclass(frozen=True)
class ObservabilityCase:
    """Observability of one group of unknowns: excitation ("training simulation", "35 Hz"); condition of the scaled PBH
    matrix at λ = 0, raw: of the unscaled matrix; lost: weakly observable combination, in words."""

    unknowns: tuple[str, ...]
    excitation: str
    condition: float
    raw: float
    lost: str = ""


@dataclass(frozen=True)
class RandomSetErrors:
    """Estimates of one unknown with random layouts.

    pool_label: their pool; error (sets,): relative, NaN if the filter diverged; history (sets, T) [unit]: or None; chosen_error:
    relative, of the placed layout."""

    name: str
    pool_label: Literal["all candidates", "screened"]
    error: FloatArray
    history: FloatArray | None
    chosen_error: float

    @property
    def finite(self) -> FloatArray:
        """Errors of layouts whose filter did not diverge."""
        return self.error[np.isfinite(self.error)]


@dataclass(frozen=True)
class Noise:
    """Estimates at other noise levels: level (k,): noise σ / RMS of the strongest candidate, ascending; error, std: unknown →
    (k,) relative."""

    level: FloatArray
    error: Mapping[str, FloatArray]
    std: Mapping[str, FloatArray]


@dataclass(frozen=True)
class Check:
    """NEES or NIS per dimension (1 is ideal), the band of a consistent filter, and the result of the check."""

    name: str
    value: float
    band: tuple[float, float]
    result: str


@dataclass(frozen=True)
class PlacementReport:
    """Data of a placement page.

    settings: config section `report`; frequencies [Hz]: at the reference; metrics: that of the layout first; criteria: layouts by
    rule, the placed one first; cases: observability cases; observability: name → number;
    load_cases: None for the configured loads; influence: None for a free structure; frequency_response: None also for a
    quasi-static model; budget: unknown → source → share of the expected variance, may be empty; advice, warnings, not_tested:
    sentences; posteriors: by parameter; filters: comparison;
    truth_description: simulated truth; test: result of the test of this layout, may be empty;
    facts: mesh, mass, pool sizes; seconds: stage → computing time [s]; provenance: versions, seed, keys; assumes: rows of model
    assumptions."""

    name: str
    title: str
    settings: Report
    unknowns: tuple[Unknown, ...]
    layout: PictureLayout
    trend: Trend
    histories: tuple[History, ...] = ()
    posteriors: Mapping[str, Posterior] = field(default_factory=dict)
    gauge_signals: tuple[Reading, ...] = ()
    random_sets: tuple[RandomSetErrors, ...] = ()
    noise: Noise | None = None
    frequencies: tuple[float, ...] = ()
    metrics: tuple[MetricWords, ...] = ()
    criteria: tuple[Criteria, ...] = ()
    cases: tuple[ObservabilityCase, ...] = ()
    load_cases: ByCase | None = None
    budget: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    advice: tuple[str, ...] = ()
    influence: Table | None = None
    frequency_response: FrequencyResponse | None = None
    observability: Mapping[str, float] = field(default_factory=dict)
    truth_description: str = ""
    filters: Compared | None = None
    consistency: tuple[Check, ...] = ()
    warnings: tuple[str, ...] = ()
    not_tested: tuple[str, ...] = ()
    test: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)
    assumes: tuple[tuple[str, ...], ...] = ()

    @property
    def units(self) -> Mapping[str, str]:
        """Unit of every unknown by name."""
        return {unknown.name: unknown.unit for unknown in self.unknowns}
