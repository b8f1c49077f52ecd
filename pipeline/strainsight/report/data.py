"""Everything a placement report shows, as arrays and names; whoever has the artefacts fills it in.

Errors and standard deviations are relative (0.01 is one per cent) unless a unit is stated:
of a parameter to its true value, of an input to the RMS of the load vector.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Unknown:
    """One thing the gauges are to tell.

    name, unit      as the config calls it, in SI ("E", "Pa")
    kind            "input" (a load history) or "parameter" (one number)
    guess           parameter: the value the filter started from; input: the amplitude it is scaled by [unit]
    truth           parameter: the simulated true value; input: RMS of the true history [unit]
    estimate        parameter: mean over the last half; input: RMS of the estimated history [unit]
    error           relative: parameter |estimate/truth − 1|; input RMS error over RMS of the load vector, both after
                    the first tenth
    std             relative: one standard deviation that the filter claims for the same span
    smoothed_error  `error` of the smoothed estimate
    expected_std    relative: one standard deviation expected at placement, from the covariance recursion along training

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


@dataclass(frozen=True)
class Gauge:
    """One gauge of the chosen set.

    label ("G1"); element, facet ids of the file; position (3,) [m]; direction, normal (3,) unit vectors;
    angle [deg] from the projected axis; nodes: ids of the facet's nodes;
    without: unknown's name → relative standard deviation expected when this gauge is left out (inf: not observable).
    """

    label: str
    element: int
    facet: int
    position: FloatArray
    direction: FloatArray
    normal: FloatArray
    angle: float
    without: Mapping[str, float] = field(default_factory=dict)
    nodes: tuple[int, ...] = ()


@dataclass(frozen=True)
class Load:
    """A point load to draw: name, point (3,) [m], direction (3,), and whether its history is known to the filter."""

    name: str
    point: FloatArray
    direction: FloatArray
    known: bool = True


@dataclass(frozen=True)
class Layout:
    """The structure and what sits on it.

    points (n, 3) [m]; faces (f, 8) indices into points, padded with −1: exterior facets tri3, quad4, tri6 or quad8
    (told apart by 3, 4, 6 or 8 valid entries), VTK order, outward; pool (m, 3) [m] the candidates that the
    gauges were chosen from; fixed (k, 3) [m] clamped nodes; loose (l, 3) [m] nodes of a structure that is no solid.
    """

    points: FloatArray
    faces: IntArray
    pool: FloatArray
    gauges: tuple[Gauge, ...]
    loads: tuple[Load, ...] = ()
    fixed: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    loose: FloatArray = field(default_factory=lambda: np.empty((0, 3)))


@dataclass(frozen=True)
class Trend:
    """The metric tr(W P) while gauges are taken away.

    count (s,) gauges left, falling; trace (s,) metric, dimensionless (each unknown is 1 with the whole pool);
    blocks: unknown's name → (s,) its share; final_trace after exchange; lower_bound no set of that size can undercut;
    gap = 1 − lower_bound / final_trace.
    """

    count: IntArray
    trace: FloatArray
    blocks: Mapping[str, FloatArray]
    final_trace: float
    lower_bound: float | None = None
    gap: float | None = None


@dataclass(frozen=True)
class History:
    """An unknown over time: time (T,) [s]; truth, mean, smoothed (T,) [unit]; std, smoothed_std (T,) [unit] one σ."""

    name: str
    unit: str
    time: FloatArray
    truth: FloatArray | None
    mean: FloatArray
    std: FloatArray
    smoothed: FloatArray | None = None
    smoothed_std: FloatArray | None = None


@dataclass(frozen=True)
class GaugeSignal:
    """One gauge over time: time (T,) [s]; measured, truth (without noise), estimated, std (T,) [strain]."""

    label: str
    time: FloatArray
    measured: FloatArray
    truth: FloatArray | None
    estimated: FloatArray
    std: FloatArray


@dataclass(frozen=True)
class RandomSets:
    """The same estimation with gauges drawn at random, for one unknown.

    pool_label where they were drawn from; error (sets,) relative, NaN where the filter diverged;
    history (sets, T) [unit] on the instants of the unknown's History, or None; chosen_error relative, the chosen set's.
    """

    name: str
    pool_label: Literal["all candidates", "screened"]
    error: FloatArray
    history: FloatArray | None
    chosen_error: float


@dataclass(frozen=True)
class NoiseRow:
    """One noise level: level = noise std over the strongest candidate's RMS (0.01 is one per cent), factor times the
    configured noise; error, std: unknown's name → relative."""

    level: float
    factor: float
    error: Mapping[str, float]
    std: Mapping[str, float]


@dataclass(frozen=True)
class Repeats:
    """The estimation repeated over seeds and starts: error (n,), claimed_std (n,) relative, and the verdict on it."""

    name: str
    error: FloatArray
    claimed_std: FloatArray
    verdict: Literal["identified", "not identified"]


@dataclass(frozen=True)
class Consistency:
    """NEES and NIS divided by their dimension (1 is ideal), each with the 95 % band a consistent filter stays in."""

    nees: float | None = None
    nees_band: tuple[float, float] | None = None
    nis: float | None = None
    nis_band: tuple[float, float] | None = None


@dataclass(frozen=True)
class PlacementReport:
    """All that the page of a placement shows.

    name of the config, title for people; frequencies [Hz] of the model at the reference;
    baselines: name → metric tr(W P) of that set (inf: cannot observe everything); observability: name → number;
    truth_description: what the estimates were tested against; warnings and not_tested: sentences;
    facts: mesh, mass, pool sizes, timing; provenance: versions, seed, keys.
    """

    name: str
    title: str
    unknowns: tuple[Unknown, ...]
    layout: Layout
    trend: Trend
    histories: tuple[History, ...] = ()
    gauge_signals: tuple[GaugeSignal, ...] = ()
    random_sets: tuple[RandomSets, ...] = ()
    noise: tuple[NoiseRow, ...] = ()
    repeats: tuple[Repeats, ...] = ()
    frequencies: tuple[float, ...] = ()
    baselines: Mapping[str, float] = field(default_factory=dict)
    observability: Mapping[str, float] = field(default_factory=dict)
    truth_description: str = ""
    consistency: Consistency = field(default_factory=Consistency)
    warnings: tuple[str, ...] = ()
    not_tested: tuple[str, ...] = ()
    facts: Mapping[str, str] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)
