"""Everything a placement report shows, as arrays and names; whoever has the artefacts fills it in.

Errors and standard deviations are relative (0.01 is one per cent) unless a unit is stated:
of a parameter to its true value, of an input to its own RMS, or to its amplitude where it is zero throughout.
"""

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
from strainsight.records.placed import ByCase


@dataclass(frozen=True)
class Repeats:
    """The estimation over other seeds and starts: error (n,), claimed_std (n,) relative, and whether the starts end together."""

    error: FloatArray
    claimed_std: FloatArray
    identified: bool

    @property
    def lost(self) -> int:
        """How many diverged."""
        return int(np.count_nonzero(~np.isfinite(self.error)))

    @property
    def worst(self) -> float:
        """The largest error, ∞ where one diverged."""
        return math.inf if self.lost else float(np.max(np.abs(self.error)))


@dataclass(frozen=True)
class Unknown:
    """One thing the gauges are to tell.

    name, unit      as the config calls it, in SI ("E", "Pa")
    kind            "input" (a load history) or "parameter" (one number)
    guess           parameter: the value the filter started from; input: the amplitude it is scaled by [unit]
    truth           parameter: the simulated true value; input: RMS of the true history [unit]
    estimate        parameter: mean over the last half; input: RMS of the estimated history [unit]
    error           relative: parameter |estimate/truth − 1|; input RMS error over its RMS, both after the first tenth
    std             relative: one standard deviation that the filter claims for the same span
    smoothed_error, smoothed_std  `error` and `std` of the smoothed estimate
    expected_std    relative: one standard deviation expected at placement, from the covariance recursion along training; with
                    load cases in the worst one, relative to the amplitude there
    zero            an input that is zero throughout: everything relative is over its amplitude, `guess`
    claims          whether its σ held, first the one that decides
    benefit         whether random layouts of the same size estimate it as well
    withheld        whether σ is, as a parameter has left the range of the reduced model: std and smoothed_std are None
    worst_case      name of the load case of expected_std, empty where there are none
    repeats         the same of other seeds and starts

    What was not computed is None: a placement without a validation still has a page.
    """

    name: str
    unit: str
    kind: Literal["input", "parameter"]
    guess: float
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
        """Whether its starts end apart."""
        return self.repeats is not None and not self.repeats.identified


@dataclass(frozen=True)
class MetricWords:
    """What a layout is judged by, a variance, as a formula and in words."""

    symbol: str
    meaning: str


@dataclass(frozen=True)
class Trend:
    """The metric while gauges are taken away.

    count (s,) gauges left, falling; value (s,) of the metric, dimensionless; blocks: unknown's name → (s,) its scaled
    variance; final after exchange; metric: which one; lower_bound no set of that size can undercut;
    gap = 1 − lower_bound / final.
    """

    count: IntArray
    value: FloatArray
    blocks: Mapping[str, FloatArray]
    final: float
    metric: MetricWords
    lower_bound: float | None = None
    gap: float | None = None


@dataclass(frozen=True)
class Criteria:
    """One layout by every criterion, all from the same covariances (inf: it cannot observe everything).

    rule: how it was found ("elimination, exchange", "log-determinant", "effective independence", "random, median of 10");
    values: by every metric of `PlacementReport.metrics`, in their order; std: unknown's name → steady-state σ [SI]: a ranking
    number, not what a filter will claim.
    """

    rule: str
    values: tuple[float, ...]
    std: Mapping[str, float]

    @property
    def chosen(self) -> float:
        """The metric that the layout of the page was chosen by."""
        return self.values[0]


@dataclass(frozen=True)
class ObservabilityCase:
    """How well one set of unknowns could be distinguished: its names; excitation ("training run", "35 Hz"); condition of the
    scaled PBH matrix at λ = 0, raw: that of the unscaled one, which orders cases by their units; lost: in words what is (nearly)
    unobservable, empty where nothing is."""

    unknowns: tuple[str, ...]
    excitation: str
    condition: float
    raw: float
    lost: str = ""


@dataclass(frozen=True)
class RandomSetErrors:
    """The same estimation with gauges drawn at random, for one unknown.

    pool_label where they were drawn from; error (sets,) relative, NaN where the filter diverged;
    history (sets, T) [unit] on the instants of the unknown's History, or None; chosen_error relative, the chosen set's.
    """

    name: str
    pool_label: Literal["all candidates", "screened"]
    error: FloatArray
    history: FloatArray | None
    chosen_error: float

    @property
    def finite(self) -> FloatArray:
        """Errors of the sets whose filter did not diverge."""
        return self.error[np.isfinite(self.error)]


@dataclass(frozen=True)
class Noise:
    """The estimation at other noise: level (k,), rising, = noise std over the strongest candidate's RMS (0.01 is one per cent);
    error, std: unknown's name → (k,) relative."""

    level: FloatArray
    error: Mapping[str, FloatArray]
    std: Mapping[str, FloatArray]


@dataclass(frozen=True)
class Check:
    """NEES or NIS over its dimension (1 is ideal), the band in which that of a consistent filter stays, and the verdict."""

    name: str
    value: float
    band: tuple[float, float]
    verdict: str


@dataclass(frozen=True)
class PlacementReport:
    """All that the page of a placement shows.

    name of the config, title for people; settings: its section `report`; frequencies [Hz] of the model at the reference;
    metrics: every one, that of the layout first; criteria: layouts by every rule, ours first; cases: what could be
    distinguished; observability: name → number;
    load_cases: what the layout is placed for together, None where it is the loads as stated;
    budget: unknown's name → source → share of the variance expected, empty where that is not known;
    advice: sentences, what to do with the layout (how many gauges are worth it, which are redundant, limits);
    posteriors: parameter → what the measurements leave of it; filters: parameters by the grid filter and by others;
    truth_description: what the estimates were tested against; warnings and not_tested: sentences;
    test: what the test of this layout said, empty before one;
    facts: mesh, mass, pool sizes; seconds: stage → how long it took when it was computed [s];
    provenance: versions, seed, keys; assumes: rows of what the model assumes, how many, and a detail.
    """

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
        """Unit of every unknown, by name."""
        return {unknown.name: unknown.unit for unknown in self.unknowns}
