"""Everything the page of a suite shows, run by run; whoever has the artefacts fills it in.

Errors and standard deviations are relative (0.01 is one per cent), as in `report.placement.data`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from strainsight.report.picture.layout import Layout
from strainsight.report.placement.data import Case, History, Metric, Repeats, Trend, Unknown


@dataclass(frozen=True)
class SuiteRun:
    """One run of a suite.

    name of its config, label for people; note: a sentence or ""; page: relative link to the run's own page, or None;
    reached: its last stage; unknowns: what was to be estimated, with numbers where it was validated;
    gauges kept of the pool's: None before `place`, as are trend and layout; expected_std: unknown's name → relative σ
    from placement; histories, repeats, cases, frequencies [Hz], truth_description, warnings as in `PlacementReport`;
    pairs: every gauge with its nearest other one, (label, label, distance [m]).
    """

    name: str
    label: str
    note: str
    page: str | None
    reached: str
    unknowns: tuple[Unknown, ...]
    gauges: int | None = None
    pool: int | None = None
    trend: Trend | None = None
    layout: Layout | None = None
    expected_std: Mapping[str, float] = field(default_factory=dict)
    histories: tuple[History, ...] = ()
    repeats: tuple[Repeats, ...] = ()
    cases: tuple[Case, ...] = ()
    frequencies: tuple[float, ...] = ()
    truth_description: str = ""
    pairs: tuple[tuple[str, str, float], ...] = ()
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class SuiteReport:
    """All that the page of a suite shows: its name, a title for people, the runs in order; provenance: versions, keys."""

    name: str
    title: str
    runs: tuple[SuiteRun, ...]
    provenance: Mapping[str, str] = field(default_factory=dict)


def metrics_of(runs: Iterable[SuiteRun]) -> tuple[Metric, ...]:
    """What the layouts of these runs were chosen by, each once."""
    return tuple(dict.fromkeys(run.trend.metric for run in runs if run.trend is not None))


def metric_name(metrics: Sequence[Metric]) -> str:
    """What a column of them is called: by its formula where they are all one."""
    return metrics[0].symbol if len(metrics) == 1 else "metric"


def metric_words(metrics: Sequence[Metric]) -> str:
    """What they are, as the beginning of a sentence."""
    return "; ".join(f"{metric.symbol}: {metric.meaning}" for metric in metrics)
