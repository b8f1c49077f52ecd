"""Figures of a suite: observability, metric over gauges, estimates of all runs, and studies.

Thesis figures 6.9; 6.10b, 6.12b and 6.14b in one; 6.11b, 6.13b and 6.15b."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from strainsight.pages.arrays import FloatArray, History
from strainsight.pages.bench.data import BenchPageRun
from strainsight.pages.bench.figures import STROKES, line_style, ratio_figure, sensor_figure, unknown_figure
from strainsight.pages.chart.drawing import MUTED, SERIES, Drawing, figure, styled, svg
from strainsight.pages.chart.panels import drawable, estimate_figure, legend_above, log_ticks, plain_ticks, power_of_ten
from strainsight.pages.placement.data import Trend
from strainsight.pages.suite.data import (
    PlacementRun,
    Suite,
    SuiteRun,
    SuiteStudy,
    metric_name,
    metric_words,
    metrics_of,
)
from strainsight.pages.suite.summary import (
    SINGULAR,
    ExcitationSeries,
    Result,
    groups_of,
    numbered,
    results_of,
    series_of,
)
from strainsight.text import number, percent, short

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TOGETHER = 6
"""Most runs in one figure, equal to the number of colours."""
WIDE = 3.0
"""Ratio of the largest to the smallest value from which an axis is logarithmic."""


def study_figures(suite: Suite, study: SuiteStudy) -> tuple[Drawing, ...]:
    """Numbers over the varied key, then unknowns and sensors of the benches."""
    place = suite.studies.index(study)
    runs = [suite.runs[i] for i in study.runs]
    drawings = [] if study.over is None else _sweeps(f"study-{place}", study, runs)
    estimated = [run for run in runs if isinstance(run, BenchPageRun) and run.is_estimated]
    groups = {"": estimated}
    if len(estimated) > TOGETHER:  # by group if there are too many for one figure, then in order
        names = dict.fromkeys(run.group for run in estimated)
        groups = {name: [run for run in estimated if run.group == name] for name in names}
    parts = [
        (group, members[start : start + TOGETHER])
        for group, members in groups.items()
        for start in range(0, len(members), TOGETHER)
    ]
    for i, (group, part) in enumerate(parts):
        drawings += _pair(f"study-{place}-{i}", group, part)
    return tuple(drawings)


def _pair(key: str, group: str, runs: Sequence[BenchPageRun]) -> list[Drawing]:
    """Estimates of every unknown, then measured and estimated readings of every sensor."""
    drawings = []
    behind = f" ({group})" if group else ""
    for i, name in enumerate(dict.fromkeys(unknown.name for run in runs for unknown in run.unknowns)):
        lines = [(run.label, unknown) for run in runs for unknown in run.unknowns if unknown.name == name]
        drawings.append(unknown_figure(f"{key}-unknown-{i}", f"{name}: estimate{behind}", lines))
        if elsewhere := [(label, unknown) for label, unknown in lines if unknown.unscaled is not None]:
            drawings.append(
                ratio_figure(f"{key}-ratio-{i}", f"{name}: ratio to the load on the measured bench{behind}", elsewhere)
            )
    sensors = [(run.label, sensor) for run in runs for sensor in run.sensors]
    for i, name in enumerate(dict.fromkeys(sensor.name for _, sensor in sensors)):
        if shown := [entry for entry in sensors if entry[1].name == name and entry[1].expected is not None]:
            title = f"{name}: measured and estimated readings{behind}"
            # the component with the largest motion; tilts are compared by their displacement at 1 m
            span = np.ptp(np.nan_to_num(shown[0][1].measured, posinf=0.0, neginf=0.0), axis=0)
            drawings.append(sensor_figure(f"{key}-sensor-{i}", title, int(np.argmax(span)), shown))
    return drawings


def _sweeps(key: str, study: SuiteStudy, runs: Sequence[SuiteRun]) -> list[Drawing]:
    """Numbers of the study over the key; by default the errors of loads and of parameters."""
    if study.numbers:
        return [_sweep(f"{key}-sweep", study, runs, study.numbers)]
    kinds = {unknown.name: unknown.kind for run in runs for unknown in run.unknowns}
    drawings = []
    for kind, what in (("input", "loads"), ("parameter", "parameters")):
        errors = [f"error.{name}" for name in kinds if kinds[name] == kind]
        if shown := [name for name in errors if any(run.number(name) is not None for run in runs)]:
            drawings.append(_sweep(f"{key}-sweep-{kind}", study, runs, shown, what))
    return drawings


@styled()
def _sweep(key: str, study: SuiteStudy, runs: Sequence[SuiteRun], numbers: Sequence[str], what: str = "") -> Drawing:
    """Panel for every number over the varied key, line for every group; what: kind of unknowns of the errors, with their claimed
    σ as dotted lines."""
    groups = list(dict.fromkeys(run.group for run in runs))
    at = np.array([np.nan if run.at is None else run.at for run in runs])
    place, zero = _places(at)
    canvas, *panels = figure(1.2 + 1.5 * len(numbers) + 0.1 * len(groups), (1.0,) * len(numbers))
    texts = []
    for axes, name in zip(panels, numbers, strict=True):
        values, label = _values(runs, name), name.replace("error.", "error of ", 1) if what else name
        for g, group in enumerate(groups):
            members = [i for i, run in enumerate(runs) if run.group == group and not np.isnan(at[i])]
            index = np.array(sorted(members, key=lambda i: at[i]), dtype=int)
            style, title = line_style(g), short(group, 30) if group else None
            axes.plot(place[index], values[index], marker="o", ms=4.5, **style, label=title)
            if what:
                std = _values(runs, name.replace("error.", "std.", 1))[index]
                axes.plot(place[index], std, color=style["color"], lw=1.1, ls=(0, (1, 1.5)))
        _scale(axes, values[~np.isnan(at)])
        axes.set_ylabel(f"{short(label, 22)}\n[{'–' if what else 'SI'}]")
        points = (f"{number(x, 3)} {number(v, 2)}" for x, v in zip(at, values, strict=True))
        texts.append(f"{label}: {', '.join(points)}")
    _over(panels[-1], place, zero)
    panels[-1].set_xlabel(short(study.over or "", 48))
    if any(groups):
        legend_above(panels[0], 2)
    caption = (
        f"Summary numbers of the runs versus the config key {study.over}: a panel per number, a line per group of runs."
    )
    if what:
        caption = f"Errors of the {what} versus the config key {study.over}; dotted: claimed standard deviation."
    title = f"{study.name}: {f'errors of {what}' if what else 'summary numbers'} versus {study.over}"
    return Drawing(key, title, caption, f"Line chart versus {study.over}. {'; '.join(texts)}.", svg(canvas))


def _values(runs: Sequence[SuiteRun], name: str) -> FloatArray:
    return drawable(np.array([run.number(name) for run in runs], dtype=float))


def _places(at: FloatArray) -> tuple[FloatArray, float | None]:
    """Positions of the values on the axis; 0 on a logarithmic axis is at a third of the smallest value."""
    positive = at[at > 0]
    if not len(positive) or np.nanmin(at) < 0 or not (at == 0).any():
        return at, None
    zero = float(positive.min()) / 3
    return np.where(at == 0, zero, at), zero


def _over(axes: Axes, place: FloatArray, zero: float | None) -> None:
    """Use a logarithmic axis if the values span more than a factor of three; ticks at the values if there are few."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator

    finite = np.unique(place[np.isfinite(place)])
    if len(finite) and finite[0] > 0 and finite[-1] >= WIDE * finite[0]:
        axes.set_xscale("log")
    elif zero is None:
        return
    crowded = len(finite) > 1 and np.log(finite[1:] / finite[:-1]).min() < 0.08 * np.log(finite[-1] / finite[0])
    if len(finite) <= 7 and not crowded:
        axes.xaxis.set_major_locator(FixedLocator(finite.tolist()))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: "0" if value == zero else number(value, 3)))
        axes.xaxis.set_minor_formatter(NullFormatter())
    else:
        log_ticks(axes, "x")


def _scale(axes: Axes, values: FloatArray) -> None:
    from matplotlib.ticker import FuncFormatter

    values = values[np.isfinite(values)]
    if len(values) and values.min() > 0 and values.max() >= WIDE * values.min():
        axes.set_yscale("log")
        log_ticks(axes)
    else:
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: number(round(value, 15), 4)))


COLOURS = (*SERIES, MUTED)


def suite_figures(report: Suite) -> tuple[Drawing, ...]:
    """Figures with data: "pbh", "errors", "trends", then "estimate-<run>-<unknown>" of every placement and "study-<place>-…" of
    every study."""
    drawings = []
    if series := series_of(report):
        drawings.append(pbh_figure(series))
    results = [(index, result) for index, run in report.placements for result in results_of(run)]
    if rows := [row for row in results if row[1].error is not None and np.isfinite(row[1].error)]:
        drawings.append(errors_figure(rows))
    trends = [(i, run, run.trend) for i, run in report.placements if run.trend is not None and len(run.trend.value)]
    if lines := [line for line in trends if 0 < line[2].value[0] < np.inf]:
        drawings.append(trends_figure(lines))
    for index, run in report.placements:
        drawings += [run_estimate(index, run, history) for history in run.histories]
    for study in report.studies:
        drawings += study_figures(report, study)
    return tuple(drawings)


@styled()
def pbh_figure(series: tuple[ExcitationSeries, ...]) -> Drawing:
    """Condition of the scaled PBH matrix at λ = 0; rows are groups of unknowns, colours are excitations."""
    groups = groups_of(series)
    values = np.array(
        [[entry.cases[g].condition if g in entry.cases else np.nan for entry in series] for g in groups], dtype=float
    )
    known = values[np.isfinite(values) & (values > 0)]
    end = 10 ** (np.log10(known.max(initial=10.0)) * 1.22 + 0.3)
    low = min(1.0, float(known.min(initial=1.0)))
    canvas, axes = figure(1.1 + 0.2 * len(series) + len(groups) * (0.16 + 0.165 * len(series)))
    axes.set(xscale="log", xlim=(low, end))
    step = 0.84 / len(series)
    for j, entry in enumerate(series):
        at = np.arange(len(groups)) + (j - (len(series) - 1) / 2) * step
        width = np.where(np.isnan(values[:, j]), low, np.minimum(values[:, j], end))
        style = {"color": COLOURS[j % len(COLOURS)], "lw": 0, "alpha": 1.0 if j < len(COLOURS) else 0.5}
        label = f"{short(entry.heading, 40)}: {short(entry.label, 40)}"
        axes.barh(at, np.maximum(width - low, 0.0), left=low, height=0.86 * step, label=label, **style)
        for y, value, reach in zip(at, values[:, j], width, strict=True):
            if not np.isnan(value):
                off, align = (-3, "right") if reach >= end else (3, "left")
                words = {"textcoords": "offset points", "va": "center", "ha": align, "fontsize": 7.5}
                axes.annotate(_rounded(value), (reach, y), (off, 0), **words)
    axes.set_yticks(range(len(groups)), [short(group, 26) for group in groups])
    axes.set_ylim(len(groups) - 0.45, -0.55)
    axes.grid(visible=False, axis="y")
    axes.xaxis.set_major_formatter(lambda value, _: number(value) if 0.5 < value < 50 else power_of_ten(value))
    axes.minorticks_off()
    axes.set_xlabel("condition number of the scaled PBH matrix at λ = 0 [–]")
    legend_above(axes, columns=1)
    caption = (
        "A long bar means that the unknowns are difficult to distinguish from each other and from the structural motion. "
        "Each colour is one excitation; only bars of one colour are comparable. "
        "“input” denotes all unknown loads. PBH: Popov-Belevitch-Hautus."
    )
    if len(known) and known.max() > SINGULAR:
        caption += " Above 10¹³ the matrix is singular: no gauges can distinguish these unknowns."
    rows = [", ".join(_rounded(value) for value in row if not np.isnan(value)) for row in values]
    text = "; ".join(f"{group} {row}" for group, row in zip(groups, rows, strict=True))
    alt = f"Bar chart of condition numbers at {len(series)} excitations: {text}."
    return Drawing("pbh", "Condition number of every group of unknowns", caption, alt, svg(canvas))


@styled()
def errors_figure(rows: list[tuple[int, Result]]) -> Drawing:
    """Error of every unknown of every run, with a bar of errors consistent with σ, and repeats as strokes."""
    canvas, axes = figure(1.0 + 0.3 * len(rows))
    sizes = [max(result.error or 0.0, 1e-6) for _, result in rows]
    sizes += [result.std for _, result in rows if _reach(result) and result.std]
    low = 100 * min(sizes) / 3
    axes.set_xscale("log")
    for y, (_, result) in enumerate(rows):
        assert result.error is not None
        if reach := _reach(result):
            axes.barh(y, max(100 * reach - low, 0.0), left=low, height=0.66, color=SERIES[0], alpha=0.22, lw=0)
        if (repeats := result.unknown.repeats) is not None:
            off = 100 * np.abs(repeats.error[np.isfinite(repeats.error)])
            axes.plot(np.maximum(off, low), np.full(len(off), y), "|", color=MUTED, ms=7, mew=1.0)
        axes.plot(
            max(100 * result.error, low), y, "X" if result.problems else "o",
            color=SERIES[1 if result.problems else 0], ms=7, mec="white", mew=0.6,
        )  # fmt: skip
    axes.fill_between([], [], [], color=SERIES[0], alpha=0.22, lw=0, label="consistent")
    legend = (("o", SERIES[0], "error"), ("|", MUTED, "repeats"), ("X", SERIES[1], "unreliable estimate"))
    for marker, colour, label in legend:
        axes.plot([], [], marker, color=colour, ms=7, mew=1.0, label=label)
    axes.set_yticks(range(len(rows)), [f"{i} {short(result.unknown.name, 16)}" for i, result in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_xlim(left=low)
    axes.grid(visible=False, axis="y")
    plain_ticks(axes, "x")
    axes.set(xlabel="relative error [%]", ylabel="run and unknown")
    legend_above(axes, columns=2)
    caption = (
        "Bars: range of errors consistent with the claimed σ. Errors of loads are those of the smoothed estimate. "
        "Short lines: repeated filter runs with other noise and initial values. Crosses: σ is overconfident or withheld, or "
        "the unknown is not identified, or a run diverged."
    )
    text = "; ".join(f"run {i} {result.unknown.name} {percent(result.error or 0.0)}" for i, result in rows)
    return Drawing("errors", "Errors of all runs", caption, f"Chart of errors and claimed σ: {text}.", svg(canvas))


@styled()
def trends_figure(lines: list[tuple[int, PlacementRun, Trend]]) -> Drawing:
    """Metric relative to its value with all candidates, over the number of gauges, one line per run; equal lines once."""
    shared: list[tuple[list[int], PlacementRun, Trend]] = []
    for index, run, trend in lines:
        for numbers, _, other in shared:
            same = trend.metric == other.metric and np.array_equal(trend.count, other.count)
            if same and np.allclose(trend.value, other.value, rtol=1e-9):
                numbers.append(index)
                break
        else:
            shared.append(([index], run, trend))
    metrics = metrics_of(run for _, run, _ in lines)
    canvas, axes = figure(3.1 + 0.18 * len(shared))
    top = 1.0
    for place, (numbers, run, trend) in enumerate(shared):
        colour, stroke = COLOURS[place % len(COLOURS)], STROKES[place // len(COLOURS) % len(STROKES)]
        curve = drawable(trend.value) / trend.value[0]
        label = f"{', '.join(map(str, numbers))}  {short(run.label, 40)}"
        axes.plot(trend.count, curve, color=colour, ls=stroke, lw=1.7, label=label)
        axes.plot([trend.count[-1]], [trend.final / trend.value[0]], "o", color=colour, ms=6)
        top = max(top, float(np.nanmax(curve)))
    axes.set(xscale="log", yscale="log")
    if top < 1.05:
        axes.set_ylim(0.97, 1.1)
    plain_ticks(axes, "x")
    plain_ticks(axes, "y")
    axes.set(xlabel="number of gauges [–]", ylabel=f"{metric_name(metrics)} relative to all candidates [–]")
    legend_above(axes, columns=1)
    caption = (
        f"{metric_words(metrics)}, relative to its value with all candidates, during elimination of gauges (from right to left). "
        "Dots: chosen layouts, after exchange of single gauges. A flat line means that a few gauges are as "
        "informative as all candidates."
    )
    ends = "; ".join(
        f"{numbered(tuple(numbers))}: {number(trend.final / trend.value[0], 3)} with {int(trend.count[-1])} gauges"
        for numbers, _, trend in shared
    )
    alt = f"Line chart of the placement criterion relative to its value with all candidates: {ends}."
    return Drawing("trends", "Placement criterion versus number of gauges", caption, alt, svg(canvas))


def run_estimate(index: int, run: PlacementRun, history: History) -> Drawing:
    """Estimate with band and truth; a parameter after the first tenth, for a visible band."""
    kind = next((unknown.kind for unknown in run.unknowns if unknown.name == history.name), "parameter")
    start = len(history.time) // 10 if kind == "parameter" else 0
    drawing = estimate_figure(history, start)
    span = "after the first tenth of the run" if start else "over the whole run"
    return replace(
        drawing,
        key=f"estimate-{index}-{history.name}",
        title=f"{history.name}, {kind if kind == 'parameter' else 'load'}",
        caption=f"Run {index}: estimate of {history.name} {span}; bands are ±2σ (σ claimed by the filter).",
        alt=f"Run {index}. {drawing.alt}",
    )


def _rounded(value: float) -> str:
    """Condition number with two or three digits."""
    return number(float(f"{value:.3g}"), 2)


def _reach(result: Result) -> float | None:
    """Largest error consistent with the claimed σ."""
    claims = {claim.of: claim for claim in result.unknown.claims}
    claim = claims.get("smoothed" if result.smoothed else "test")
    return claim.band[1] * result.std if claim and result.std and np.isfinite(result.std) else None
