"""What every channel measured, and what the filter makes of it."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from strainsight.report.arrays import FloatArray
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
from strainsight.report.page.markup import data
from strainsight.report.tested.data import Reading
from strainsight.report.text import READINGS, number, reading_unit, short

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BUCKETS = 180
"""Of a record: the least and the largest value of each are kept."""


def unit_of_reading(reading: Reading) -> tuple[float, str]:
    """The factor and the unit in which it is shown."""
    return reading_unit(largest(reading.measured, reading.estimated), reading.unit)


def largest(*signals: FloatArray) -> float:
    """Largest size among what is finite, 0 where nothing is."""
    return max((float(np.max(np.abs(own[np.isfinite(own)]), initial=0.0)) for own in signals), default=0.0)


def rms(values: FloatArray) -> float:
    """Root mean square of what is finite, NaN where nothing is."""
    there = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(there**2))) if len(there) else float("nan")


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
