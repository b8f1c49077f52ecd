"""What every channel measured, what the filter makes of it, and what the others predict of one that was held out."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from strainsight.report.arrays import FloatArray, Reading, largest, rms
from strainsight.report.chart.drawing import (
    INK,
    MUTED,
    SMALL,
    Drawing,
    figure,
    gauge_colour,
    styled,
    svg,
    visible_instants,
)
from strainsight.report.chart.panels import about, dots, drawable, legend_above, plain_axis, time_axis
from strainsight.report.page.markup import data, figures, plain, share, table
from strainsight.report.text import READINGS, number, percent, reading_unit, short

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BUCKETS = 180
"""Of a record: the least and the largest value of each are kept."""
INSIDE = 2.0
"""Half the width of the band [σ]."""
HOLD_OUT = "Every channel as the others predict it: the filter was not given what it is compared with."


def unit_of_reading(reading: Reading) -> tuple[float, str]:
    """The factor and the unit in which it is shown."""
    return reading_unit(largest(reading.measured, reading.estimated), reading.unit)


def reading(value: float, unit: str, digits: int = 3) -> str:
    """A reading as people read it, with its exact value; a dash for none."""
    if math.isnan(value):
        return "–"
    factor, shown = reading_unit(abs(value), unit)
    return data(value, f"{number(value / factor, digits)}\u00a0{shown}", unit)


def overlay(
    axes: Axes, time: FloatArray, measured: FloatArray, estimated: FloatArray, std: FloatArray, colour: str, words: str
) -> None:
    """Measured as dots, the estimate as a line in its ±2σ band, thinned to what can be seen."""
    columns = [measured, estimated]
    banded = bool(np.isfinite(std).any())
    if banded:
        columns += [estimated - 2 * std, estimated + 2 * std]
    index = visible_instants(np.column_stack(columns), BUCKETS)
    dots(axes, time[index], measured[index], "measured")
    if banded:
        axes.fill_between(time[index], columns[2][index], columns[3][index], color=colour, alpha=0.3, lw=0)
    axes.plot(time[index], estimated[index], color=colour, lw=1.2, label=f"{words} ±2σ" if banded else words)


def _scatter(axes: Axes, time: FloatArray, values: FloatArray) -> None:
    """Dots, or of a long record the span of what lies in every bucket: extremes alone would look like two bands of dots."""
    if len(values) <= 2 * BUCKETS:
        dots(axes, time, values, "")
        return
    edges = np.linspace(0, len(values), BUCKETS + 1).astype(int)
    parts = [values[a:b] for a, b in pairwise(edges)]
    low = np.array([np.min(own[np.isfinite(own)], initial=np.inf) for own in parts])
    high = np.array([np.max(own[np.isfinite(own)], initial=-np.inf) for own in parts])
    there = np.isfinite(low)
    at = time[(edges[:-1] + edges[1:]) // 2]
    # from one bucket to the next where both hold a sample; a line stands for one that is alone
    axes.fill_between(at, np.where(there, low, np.nan), np.where(there, high, np.nan), color=MUTED, alpha=0.7, lw=0.8)


def reading_figure(reading: Reading) -> Drawing:
    """One channel: the whole record, what is left of it beside the stated noise, and a close-up about its largest reading."""
    factor, unit = unit_of_reading(reading)
    colour, what = gauge_colour(reading.gauge), READINGS.get(reading.unit, "reading")
    measured, estimated, std = (drawable(own) / factor for own in (reading.measured, reading.estimated, reading.std))
    residual, time, noise = measured - estimated, reading.time, reading.noise_std / factor
    size = np.where(np.isfinite(measured), np.abs(measured), -1.0)
    window = about(estimated, int(np.argmax(size)))
    close = window.stop - window.start < len(time)
    with styled():
        drawn, *panels = figure(
            4.6 if close else 3.4, (1.0, 0.7, 1.2) if close else (1.2, 0.8), shared=False, width=SMALL
        )
        overlay(panels[0], time, measured, estimated, std, colour, "reconstructed")
        _scatter(panels[1], time, residual)
        for edge in (-2 * noise, 2 * noise):
            panels[1].axhline(edge, color=INK, ls=(0, (4, 3)), lw=1)
        if close:
            part = window
            overlay(panels[2], time[part], measured[part], estimated[part], std[part], colour, "reconstructed")
        for axes in panels:
            plain_axis(axes)
            axes.set_ylabel(f"{what}\n[{short(unit)}]")
            axes.margins(x=0.01)
        panels[1].set_ylabel(f"left over\n[{short(unit)}]")
        panels[0].tick_params(labelbottom=False)
        panels[1].set_xlim(panels[0].get_xlim())
        for axes in panels[1:]:
            time_axis(axes)
        legend_above(panels[0])
        image = svg(drawn)
    left = rms(residual)
    caption = (
        f"Left over {number(left, 3)} {unit} RMS, beside a stated noise of {number(noise, 3)} {unit} (dashed: twice that)"
        + ("; lowest, about the largest reading." if close else ".")
    )
    if reading.missing:
        caption += f" {reading.missing} of {len(time)} samples are missing."
    if reading.offset is not None:
        mean, sigma = (number(own / factor, 3) for own in reading.offset)
        caption += f" An offset of {mean} ± {sigma} {unit} was estimated and is taken off."
    alt = (
        f"Line chart of measured and reconstructed {what} of {reading.label}, peak "
        f"{number(largest(estimated), 3)} {unit}, left over {number(left, 3)} {unit} RMS."
    )
    return Drawing(f"reading-{reading.label}", reading.label, caption, alt, image)


def inside(own: Reading) -> float:
    """Share of the samples within ±2σ of what they were predicted, noise of the sample in σ; NaN without σ."""
    ratio = np.abs(own.residual / own.std)
    there = ratio[np.isfinite(ratio)]
    return float(np.mean(there <= INSIDE)) if len(there) else float("nan")


def hold_out_figures(held: Sequence[Reading]) -> list[Drawing]:
    """Of every channel a cross-plot and an overlay in time."""
    return [drawing for own in held for drawing in (_cross(own), _overlay(own))]


def _cross(own: Reading) -> Drawing:
    """Measured over predicted, with the line where both are the same."""
    factor, unit = unit_of_reading(own)
    measured, predicted = drawable(own.measured) / factor, drawable(own.estimated) / factor
    index = visible_instants(np.column_stack([measured, predicted, measured - predicted]), 240)
    limit = 1.05 * largest(measured, predicted) or 1.0
    what = READINGS.get(own.unit, "reading")
    with styled():
        drawn, axes = figure(4.2)
        dots(axes, predicted[index], measured[index], "samples")
        axes.plot([-limit, limit], [-limit, limit], color=INK, lw=1, ls=(0, (5, 3)), label="the same")
        axes.set_xlim(-limit, limit)
        axes.set_ylim(-limit, limit)
        axes.set_aspect("equal")
        axes.set_xlabel(f"predicted {what} [{short(unit)}]")
        axes.set_ylabel(f"measured {what} [{short(unit)}]")
        legend_above(axes)
        image = svg(drawn)
    caption = f"{own.label}, measured over predicted; on the dashed line both are the same."
    alt = f"Scatter plot of measured over predicted {what} of {own.label}, error {_error(own)} of its RMS."
    return Drawing(f"hold-out-{own.label}", f"{own.label}: measured over predicted", caption, alt, image)


def _overlay(own: Reading) -> Drawing:
    """Measured and predicted in time, about the largest reading."""
    factor, unit = unit_of_reading(own)
    measured, predicted, std = (drawable(values) / factor for values in (own.measured, own.estimated, own.std))
    window = about(predicted, int(np.argmax(np.where(np.isfinite(measured), np.abs(measured), -1.0))))
    what, part = READINGS.get(own.unit, "reading"), window
    with styled():
        drawn, axes = figure(3.4)
        overlay(axes, own.time[part], measured[part], predicted[part], std[part], gauge_colour(own.gauge), "predicted")
        plain_axis(axes)
        axes.set_ylabel(f"{what} [{short(unit)}]")
        time_axis(axes)
        legend_above(axes)
        image = svg(drawn)
    caption = (
        f"{own.label} about its largest reading: measured, and as the other channels predict it with its ±2σ band."
    )
    alt = f"Line chart of measured and predicted {what} of {own.label}, error {_error(own)} of its RMS."
    return Drawing(f"hold-out-time-{own.label}", f"{own.label}: in time", caption, alt, image)


def _error(own: Reading) -> str:
    size = rms(own.measured)
    return percent(rms(own.residual) / size) if size > 0 else "–"


def hold_out_section(held: Sequence[Reading], cards: Iterable[str]) -> str:
    """The table and the figures; nothing where no channel was left out."""
    if not held:
        return ""
    rows = []
    for own in held:
        error, size = rms(own.residual), rms(own.measured)
        sigma = rms(own.residual / own.std)
        rows.append(
            [
                escape(own.label),
                reading(error, own.unit),
                share(error / size) if size > 0 else "–",
                plain(sigma, 3) if np.isfinite(sigma) else "–",
                share(inside(own)),
            ]
        )
    head = ("channel", "RMS error", "of its RMS", "error over σ", "inside ±2σ")
    caption = "Inside ±2σ: 95 % where σ holds; error over σ: 1."
    text = table("hold-out", head, rows, caption=caption, numeric=range(1, 5))
    worst = min((inside(own) for own in held), default=float("nan"))
    said = "" if np.isnan(worst) else f" Least share inside ±2σ: {number(100 * worst, 3)} %."
    return f'<h2>Hold-out</h2><p class="lead">{HOLD_OUT}{said}</p><div class="card">{text}</div>{figures(cards)}'
