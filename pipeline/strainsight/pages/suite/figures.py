"""The figures of a suite: what could be distinguished, what every gauge is worth, the estimates of all runs, its studies.

Thesis figures 6.9; 6.10b, 6.12b and 6.14b in one; 6.11b, 6.13b and 6.15b.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from strainsight.pages.arrays import History
from strainsight.pages.bench.figures import STROKES
from strainsight.pages.chart.drawing import MUTED, SERIES, Drawing, figure, styled, svg
from strainsight.pages.chart.histories import estimate_figure
from strainsight.pages.chart.panels import legend_above, plain_ticks
from strainsight.pages.placement.data import Trend
from strainsight.pages.suite.cases import SINGULAR, Series, groups_of, numbered, series_of
from strainsight.pages.suite.data import PlacementRun, Suite, metric_name, metric_words, metrics_of
from strainsight.pages.suite.studies import study_figures
from strainsight.pages.suite.summary import Result, results_of
from strainsight.pages.text import SUPERSCRIPTS, number, percent, short

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = (*SERIES, MUTED)


def suite_figures(report: Suite) -> tuple[Drawing, ...]:
    """All figures that the runs have data for: "pbh", "errors", "trends", then "estimate-<run>-<unknown>" of every placement
    and "study-<place>-…" of every study."""
    drawings = []
    if series := series_of(report):
        drawings.append(pbh_figure(series))
    if rows := [(index, result) for index, run in report.placements for result in results_of(run) if _drawn(result)]:
        drawings.append(errors_figure(rows))
    trends = [(i, run, run.trend) for i, run in report.placements if run.trend is not None]
    if lines := [(i, run, trend) for i, run, trend in trends if _start(trend) is not None]:
        drawings.append(trends_figure(lines))
    for index, run in report.placements:
        drawings += [run_estimate(index, run, history) for history in run.histories]
    for study in report.studies:
        drawings += study_figures(report, study)
    return tuple(drawings)


def pbh_figure(series: tuple[Series, ...]) -> Drawing:
    """Condition of the scaled PBH matrix at λ = 0: a group a set of unknowns, a colour an excitation."""
    groups = groups_of(series)
    values = np.array(
        [[entry.cases[g].condition if g in entry.cases else np.nan for entry in series] for g in groups], dtype=float
    )
    known = values[np.isfinite(values) & (values > 0)]
    end = 10 ** (np.log10(known.max(initial=10.0)) * 1.22 + 0.3)
    low = min(1.0, float(known.min(initial=1.0)))
    with styled():
        drawn, axes = figure(1.1 + 0.2 * len(series) + len(groups) * (0.16 + 0.165 * len(series)))
        axes.set_xscale("log")
        axes.set_xlim(low, end)
        step = 0.84 / len(series)
        for j, entry in enumerate(series):
            at = np.arange(len(groups)) + (j - (len(series) - 1) / 2) * step
            width = np.where(np.isnan(values[:, j]), low, np.minimum(values[:, j], end))
            axes.barh(
                at, np.maximum(width - low, 0.0), left=low, height=0.86 * step, color=COLOURS[j % len(COLOURS)], lw=0,
                alpha=1.0 if j < len(COLOURS) else 0.5, label=_series_label(entry),
            )  # fmt: skip
            for y, value, reach in zip(at, values[:, j], width, strict=True):
                if not np.isnan(value):
                    axes.annotate(
                        _rounded(value), (reach, y), (-3 if reach >= end else 3, 0), textcoords="offset points",
                        va="center", ha="right" if reach >= end else "left", fontsize=7.5,
                    )  # fmt: skip
        axes.set_yticks(range(len(groups)), [short(group, 26) for group in groups])
        axes.set_ylim(len(groups) - 0.45, -0.55)
        axes.grid(visible=False, axis="y")
        axes.xaxis.set_major_formatter(lambda value, _: _power(value))
        axes.minorticks_off()
        axes.set_xlabel("condition of the scaled PBH matrix at λ = 0 [–]")
        legend_above(axes, columns=1)
        image = svg(drawn)
    caption = (
        "The longer the bar, the harder the unknowns are to distinguish from each other and from the motion; a colour is "
        "one excitation, the number at its end the condition. Compare bars of one colour. “input” is all unknown loads."
    )
    if len(known) and known.max() > SINGULAR:
        caption += " Beyond 10¹³ the matrix is singular: no gauge can distinguish these."
    parts = [
        f"{group} " + ", ".join(_rounded(value) for value in row if not np.isnan(value))
        for group, row in zip(groups, values, strict=True)
    ]
    alt = f"Bar chart of condition numbers at {len(series)} excitations: {'; '.join(parts)}."
    return Drawing("pbh", "Condition of every set of unknowns", caption, alt, image)


def errors_figure(rows: list[tuple[int, Result]]) -> Drawing:
    """The error of every unknown of every run on a bar up to where that of a σ that holds ends, the repeats as small dots."""
    with styled():
        drawn, axes = figure(1.0 + 0.3 * len(rows))
        smallest = min(max(result.error or 0.0, 1e-6) for _, result in rows)
        smallest = min([smallest, *[result.std for _, result in rows if _reach(result) and result.std]])
        low = 100 * smallest / 3
        axes.set_xscale("log")
        for y, (_, result) in enumerate(rows):
            assert result.error is not None
            if reach := _reach(result):
                axes.barh(y, max(100 * reach - low, 0.0), left=low, height=0.66, color=SERIES[0], alpha=0.22, lw=0)
            if (repeats := result.unknown.repeats) is not None:
                off = 100 * np.abs(repeats.error[np.isfinite(repeats.error)])
                axes.plot(np.maximum(off, low), np.full(len(off), y), "|", color=MUTED, ms=7, mew=1.0)
            axes.plot(
                max(100 * result.error, low), y, "X" if result.verdicts else "o",
                color=SERIES[1 if result.verdicts else 0], ms=7, mec="white", mew=0.6,
            )  # fmt: skip
        _error_key(axes)
        axes.set_yticks(range(len(rows)), [f"{i} {short(result.unknown.name, 16)}" for i, result in rows])
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.set_xlim(left=low)
        axes.grid(visible=False, axis="y")
        plain_ticks(axes, "x")
        axes.set_xlabel("relative error [%]")
        axes.set_ylabel("run and unknown")
        legend_above(axes, columns=2)
        image = svg(drawn)
    caption = (
        "The bar ends where the error may if the claimed σ holds: one beyond it is no bad luck. Loads are smoothed; strokes "
        "are the repeats with other noise and other starts, which are filtered, also those of loads. Crosses are overconfident "
        "or not identified."
    )
    text = "; ".join(f"run {i} {result.unknown.name} {percent(result.error or 0.0)}" for i, result in rows)
    return Drawing("errors", "What came out", caption, f"Chart of errors on their claimed σ: {text}.", image)


def trends_figure(lines: list[tuple[int, PlacementRun, Trend]]) -> Drawing:
    """The metric over its value with the whole pool against the gauges left, a line a run; equal lines are drawn once."""
    shared: list[tuple[list[int], PlacementRun, Trend]] = []
    for index, run, trend in lines:
        for numbers, _, other in shared:
            alike = trend.metric == other.metric and np.array_equal(trend.count, other.count)
            if alike and np.allclose(trend.value, other.value, rtol=1e-9):
                numbers.append(index)
                break
        else:
            shared.append(([index], run, trend))
    metrics = metrics_of(run for _, run, _ in lines)
    with styled():
        drawn, axes = figure(3.1 + 0.18 * len(shared))
        top = 1.0
        for place, (numbers, run, trend) in enumerate(shared):
            scale = trend.value[0]
            colour, stroke = COLOURS[place % len(COLOURS)], STROKES[place // len(COLOURS) % len(STROKES)]
            curve = np.where(np.isfinite(trend.value), trend.value, np.nan) / scale
            label = f"{', '.join(map(str, numbers))}  {short(run.label, 40)}"
            axes.plot(trend.count, curve, color=colour, ls=stroke, lw=1.7, label=label)
            axes.plot([trend.count[-1]], [trend.final / scale], "o", color=colour, ms=6)
            top = max(top, float(np.nanmax(curve)))
        axes.set_xscale("log")
        axes.set_yscale("log")
        if top < 1.05:
            axes.set_ylim(0.97, 1.1)
        plain_ticks(axes, "x")
        plain_ticks(axes, "y")
        axes.set_xlabel("gauges left [–]")
        axes.set_ylabel(f"{metric_name(metrics)} over all gauges' [–]")
        legend_above(axes, columns=1)
        image = svg(drawn)
    caption = (
        f"{metric_words(metrics)}, while gauges are taken away, read from right to left, over its value with the whole "
        "pool; dots are the chosen sets after exchange. A flat line: a few gauges already know all that can be known."
    )
    ends = "; ".join(
        f"{numbered(tuple(numbers))} {number(trend.final / trend.value[0], 3)} times with {int(trend.count[-1])} gauges"
        for numbers, _, trend in shared
    )
    return Drawing("trends", "What every gauge is worth", caption, f"Line chart of the metric's growth: {ends}.", image)


def run_estimate(index: int, run: PlacementRun, history: History) -> Drawing:
    """The estimate beside the truth with its band; a parameter after the first tenth, where the band can be seen."""
    kind = next((unknown.kind for unknown in run.unknowns if unknown.name == history.name), "parameter")
    start = len(history.time) // 10 if kind == "parameter" else 0
    drawing = estimate_figure(history, start)
    span = "after the first tenth of the run" if start else "over the whole run"
    return replace(
        drawing,
        key=f"estimate-{index}-{history.name}",
        title=f"{history.name}, {kind if kind == 'parameter' else 'load'}",
        caption=f"Run {index}: {history.name} {span}; bands are ±2 claimed standard deviations.",
        alt=f"Run {index}. {drawing.alt}",
    )


def _series_label(entry: Series) -> str:
    return f"{short(entry.heading, 40)}: {short(entry.label, 40)}"


def _rounded(value: float) -> str:
    """Two or three digits, as more say nothing of a condition."""
    return number(float(f"{value:.3g}"), 2)


def _power(value: float) -> str:
    """A tick at a power of ten: 1, 10, 10⁶."""
    power = round(float(np.log10(value)))
    return f"10{str(power).translate(SUPERSCRIPTS)}" if power not in (0, 1) else str(10**power)


def _drawn(result: Result) -> bool:
    return result.error is not None and bool(np.isfinite(result.error))


def _reach(result: Result) -> float | None:
    """The largest error that the claimed σ allows."""
    shown = "smoothed" if result.smoothed else "test"
    claim = next((claim for claim in result.unknown.claims if claim.of == shown), None)
    return claim.band[1] * result.std if claim and result.std and np.isfinite(result.std) else None


def _start(trend: Trend) -> float | None:
    """The metric of the whole pool, if there is a number to divide by."""
    first = float(trend.value[0]) if len(trend.value) else np.nan
    return first if np.isfinite(first) and first > 0 else None


def _error_key(axes: Axes) -> None:
    axes.fill_between([], [], [], color=SERIES[0], alpha=0.22, lw=0, label="consistent")
    axes.plot([], [], "o", color=SERIES[0], ms=7, label="error")
    axes.plot([], [], "|", color=MUTED, ms=7, mew=1.0, label="repeats")
    axes.plot([], [], "X", color=SERIES[1], ms=7, label="wrong or not identified")
