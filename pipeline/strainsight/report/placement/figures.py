"""The figures of a placement report: each turns arrays into an SVG with its caption and alternative text.

The metric's trend and the estimates with their bands: thesis figures 6.1b, 6.2, 6.5b and 6.6.
"""

from __future__ import annotations

import numpy as np

from strainsight.report.arrays import FloatArray, IntArray
from strainsight.report.chart.drawing import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    Drawing,
    figure,
    styled,
    svg,
)
from strainsight.report.chart.histories import closing_figure, estimate_figure
from strainsight.report.chart.panels import (
    legend_above,
    plain_ticks,
)
from strainsight.report.chart.posterior import posterior_figure
from strainsight.report.placement.comparisons import (
    noise_figure,
    random_errors_figure,
    random_histories_figure,
    repeats_figure,
)
from strainsight.report.placement.data import PlacementReport, Trend
from strainsight.report.placement.signals import signal_figures
from strainsight.report.text import number, short


def placement_figures(report: PlacementReport) -> tuple[Drawing, ...]:
    """All figures that the report has data for, in the order of the page."""
    kind = {unknown.name: unknown.kind for unknown in report.unknowns}
    history = {entry.name: entry for entry in report.histories}
    drawings = [trend_figure(report.trend)]
    for entry in report.histories:
        drawings.append(estimate_figure(entry))
        drawings.append(closing_figure(entry, kind.get(entry.name, "parameter")))
    drawings += [posterior_figure(own) for own in report.posteriors]
    drawings += signal_figures(report.gauge_signals, report.layout.gauges)
    for name in dict.fromkeys(sets.name for sets in report.random_sets):
        sets = tuple(entry for entry in report.random_sets if entry.name == name)
        drawings.append(random_errors_figure(sets))
        if name in history and any(entry.history is not None for entry in sets):
            drawings.append(random_histories_figure(sets, history[name]))
    if report.noise:
        drawings.append(noise_figure(report.noise, report.unknowns))
    claims = {unknown.name: claim for unknown in report.unknowns for claim in unknown.claims if claim.of == "repeats"}
    drawings += [repeats_figure(repeats, claims.get(repeats.name)) for repeats in report.repeats]
    return tuple(drawings)


def elbow(count: IntArray, value: FloatArray) -> int | None:
    """The gauge count at the elbow of the trend: the point furthest below the chord, on logarithmic axes from 0 to 1.

    count (s,), value (s,) > 0. None where the trend is straight (a furthest distance under a tenth): with independent
    noise and no other limit the metric falls evenly, and every gauge is worth as much as the one before.
    """
    if len(count) < 3 or not np.all(np.isfinite(value)) or value.min() <= 0 or np.ptp(value) == 0:
        return None
    x, y = (np.log(values / values.min()) / np.log(values.max() / values.min()) for values in (count, value))
    ends = np.argmin(x), np.argmax(x)
    below = y[ends[0]] + (y[ends[1]] - y[ends[0]]) * x - y
    best = int(np.argmax(below))
    return int(count[best]) if below[best] > 0.1 else None


def trend_figure(trend: Trend) -> Drawing:
    """The metric against the number of gauges left, the certified bound and the elbow."""
    shown = np.isfinite(trend.value)
    count, value = trend.count[shown], trend.value[shown]
    bend = elbow(count, value)
    with styled():
        drawn, axes = figure()
        if len(trend.blocks) > 1:
            for (name, block), colour in zip(trend.blocks.items(), (GREEN, PURPLE, ORANGE, SKY), strict=False):
                axes.plot(
                    trend.count,
                    np.where(np.isfinite(block), block, np.nan),
                    color=colour,
                    lw=1.2,
                    label=f"variance of {short(name)}",
                )
        axes.plot(count, value, color=BLUE, lw=2, label=trend.metric.symbol)
        keep = int(trend.count[-1])
        axes.plot([keep], [trend.final], "o", color=BLUE, ms=7, label=f"chosen set: {number(trend.final)}")
        if trend.lower_bound is not None and np.isfinite(trend.lower_bound):
            label = f"no set of {keep} below {number(trend.lower_bound)}"
            axes.axhline(trend.lower_bound, color=VERMILION, ls=(0, (5, 3)), lw=1.3, label=label)
        if bend is not None:
            at = value[count == bend][0]
            axes.plot([bend], [at], "D", mfc="none", mec=INK, ms=7, label=f"elbow: {bend} gauges")
        # An axis without a point to show has no logarithm.
        if len(count):
            axes.set_xscale("log")
        positive = value[value > 0]
        if len(positive) == len(value) and len(value) and positive.max() > 5 * positive.min():
            axes.set_yscale("log")
        plain_ticks(axes, "x")
        plain_ticks(axes, "y")
        axes.set_xlabel("gauges left [–]")
        axes.set_ylabel(f"metric {trend.metric.symbol} [–]")
        legend_above(axes, columns=2)
        image = svg(drawn)
    all_gauges = int(trend.count[0])
    ratio = trend.final / value[0] if len(value) and value[0] > 0 else np.nan
    caption = (
        f"{trend.metric.meaning.capitalize()} while gauges are taken away one by one, read from right to left: "
        f"with {keep} of {all_gauges} gauges it is {number(ratio, 3)} times what all together reach."
    )
    if trend.lower_bound is not None:
        caption += " The dashed line is a certified bound: no set of that size lies below it."
    if bend is not None:
        caption += f" The elbow, {bend} gauges, is where the trend bends most: further gauges mostly average noise."
    start, end = number(trend.value[0]), number(trend.final)
    alt = f"Line chart of the metric from {start} with {all_gauges} gauges to {end} with {keep}."
    return Drawing("trend", "What every gauge is worth", caption, alt, image)
