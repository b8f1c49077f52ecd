"""Axes of figures: units, limits, ticks, legends, and the shown part of a history."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from strainsight.pages.arrays import FloatArray, History, largest
from strainsight.pages.chart.drawing import (
    BLUE,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    Drawing,
    figure,
    styled,
    svg,
    visible_instants,
)
from strainsight.records.estimated import Posterior
from strainsight.text import SUPERSCRIPTS, number, prefix, quantity, reading_unit, short

if TYPE_CHECKING:
    from matplotlib.axes import Axes


FLAT = 1e-9
"""Relative variation below which a curve is flat."""
LONG = 1e5
"""Value from which tick labels have powers of ten."""


def focus_on(axes: Axes, values: FloatArray, share: float = 0.02) -> None:
    """Limit the y axis to the bulk of the values, with a margin."""
    values = values[np.isfinite(values)]
    if not len(values):
        return
    low, high = np.quantile(values, [share, 1 - share])
    margin = 0.08 * (high - low) or 0.01 * abs(high) or 1.0
    axes.set_ylim(low - margin, high + margin)


def legend_above(axes: Axes, columns: int = 4) -> None:
    """Put the legend above the axes."""
    axes.legend(
        loc="lower left", bbox_to_anchor=(0, 1.0), ncols=columns, borderaxespad=0.2, handlelength=1.5, columnspacing=1.2
    )


def band(axes: Axes, x: FloatArray, mean: FloatArray, std: FloatArray, colour: str, label: str = "") -> None:
    """Draw mean ± 2σ over x."""
    axes.fill_between(x, mean - 2 * std, mean + 2 * std, color=colour, alpha=0.25, lw=0, label=label)


def time_axis(axes: Axes) -> None:
    axes.locator_params(axis="x", nbins=6)
    axes.set_xlabel("time [s]")


DOTS = "_dots:"


def dots(axes: Axes, x: FloatArray, y: FloatArray, label: str) -> None:
    """Draw many dots as one path of zero-length round-capped lines, with a tenth of the size of markers."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    shown = np.column_stack([x, y])
    shown = shown[np.isfinite(shown).all(axis=1)]
    vertices = np.repeat(shown, 2, axis=0)
    codes = np.tile(np.array([Path.MOVETO, Path.LINETO], dtype=np.uint8), len(shown))
    style = {"color": MUTED, "lw": 2.4, "capstyle": "round"}
    # the label identifies the dots for `figure_csv`; the legend ignores labels with an underscore
    axes.add_patch(PathPatch(Path(vertices, codes), fill=False, alpha=0.8, label=f"{DOTS}{label}", **style))
    if label:
        axes.plot([], [], ".", color=MUTED, ms=4, label=label)
    axes.update_datalim(vertices)
    axes.autoscale_view()


def plain_ticks(axes: Axes, which: str) -> None:
    """Label a logarithmic axis 0.1, 1, 10, and also 2 and 5 if it spans less than two decades."""
    from matplotlib.ticker import LogLocator, NullFormatter

    axis = axes.xaxis if which == "x" else axes.yaxis
    low, high = axis.get_view_interval()
    if not (axis.get_scale() == "log" and 0 < low < high < np.inf):
        return
    decades = np.log10(high / low)
    marks = ((3, (1.0,)), (2, (1.0, 3.0)), (0.7, (1.0, 2.0, 5.0)))
    subs = next((subs for most, subs in marks if decades > most), tuple(np.arange(1.0, 10.0)))
    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_major_formatter(lambda value, _: number(value, 3))
    axis.set_minor_formatter(NullFormatter())


def legend_of_lines(axes: Axes, labels: Sequence[str]) -> None:
    """Put the legend above the axes in as many columns as fit."""
    longest = max(map(len, labels), default=0)
    legend_above(axes, 4 if longest <= 10 else 2 if longest <= 20 else 1)


def plain_axis(axes: Axes) -> None:
    """Label a linear y axis without power or offset; rounding errors appear flat."""
    low, high = axes.get_ylim()
    size = max(abs(low), abs(high))
    if high - low < FLAT * size:
        axes.set_ylim((low + high) / 2 - 0.05 * size, (low + high) / 2 + 0.05 * size)
    if size < LONG:
        axes.ticklabel_format(axis="y", useOffset=False)
    else:
        axes.yaxis.set_major_formatter(lambda value, _: number(value, 4))


def log_ticks(axes: Axes, which: str = "y") -> None:
    """Label a logarithmic axis with powers of ten if it spans more than three decades, else as `plain_ticks`."""
    plain_ticks(axes, which)
    axis = axes.xaxis if which == "x" else axes.yaxis
    low, high = axis.get_view_interval()
    if axis.get_scale() == "log" and 0 < low < high < np.inf and high / low > 1e3:
        from matplotlib.ticker import LogLocator

        axis.set_major_locator(LogLocator(numticks=6))
        axis.set_major_formatter(lambda value, _: power_of_ten(value))


def power_of_ten(value: float) -> str:
    """Format as 10⁶."""
    return f"10{str(round(np.log10(value))).translate(SUPERSCRIPTS)}"


def shown_unit(*histories: History) -> tuple[float, str]:
    """Factor and unit for display of the largest history."""
    unit = histories[0].unit.replace("N m", "N·m")
    size = largest(*(h.mean if h.truth is None else h.truth for h in histories))
    return reading_unit(size, unit) if unit == "m" else prefix(size, unit)


def drawable(values: FloatArray) -> FloatArray:
    """Replace values that are not finite by NaN."""
    return np.where(np.isfinite(values), values, np.nan)


def last_periods(values: FloatArray) -> slice:
    """The last four periods of an oscillation (T,) by mean crossings, at least a fiftieth of the run; all without oscillation."""
    steps, finite = len(values), values[np.isfinite(values)]
    mean = np.mean(finite) if len(finite) else 0.0
    crossing = np.flatnonzero(np.diff(np.signbit(values - mean)))
    start = int(crossing[-8]) if len(crossing) > 8 else 0
    return slice(max(min(start, steps - max(round(0.02 * steps), 2)), 0), None)


def about(values: FloatArray, near: FloatArray, periods: float = 5.0, least: int = 60, share: float = 0.6) -> slice:
    """A few periods of an oscillation (T,) around the largest finite sample of `near` (T,), with at least `least` samples; all of
    it if this exceeds `share`. A period is twice the mean distance of mean crossings."""
    finite, steps = values[np.isfinite(values)], len(values)
    crossings = int(np.count_nonzero(np.diff(np.signbit(finite - finite.mean())))) if len(finite) else 0
    width = max(least, round(2 * periods * len(finite) / crossings) if crossings else steps)
    if width > share * steps:
        return slice(0, steps)
    at = int(np.argmax(np.where(np.isfinite(near), np.abs(near), -1.0)))
    start = min(max(at - width // 2, 0), steps - width)
    return slice(start, start + width)


def overlay(
    axes: Axes,
    time: FloatArray,
    mean: FloatArray,
    std: FloatArray,
    colour: str,
    words: str,
    measured: FloatArray | None = None,
) -> None:
    """Draw a curve with its ±2σ band, if finite, and measurements as dots, thinned."""
    banded = bool(np.isfinite(std).any())
    columns = (mean, *(mean - 2 * std, mean + 2 * std) * banded, *(() if measured is None else (measured,)))
    index = visible_instants(np.column_stack(columns), 180)
    if measured is not None:
        dots(axes, time[index], measured[index], "measured")
    if banded:
        band(axes, time[index], mean[index], std[index], colour)
    axes.plot(time[index], mean[index], color=colour, lw=1.2, label=f"{words} ±2σ" if banded else words)


def estimate_figure(history: History, start: int = 0) -> Drawing:
    """Estimate with ±2σ band and truth, from an instant `start` on."""
    name, image = history.name, _bands(history, slice(start, None), focus=False)
    caption = f"Estimate of {name} over the whole run with the claimed ±2σ band."
    return Drawing(f"estimate-{name}", f"{name}: whole run", caption, _history_alt(history), image)


def closing_figure(history: History, kind: str) -> Drawing:
    """Estimate close up: last half of a parameter, last periods of a load."""
    reference = history.mean if history.truth is None else history.truth
    window = slice(len(history.time) // 2, None) if kind == "parameter" else last_periods(reference)
    image = _bands(history, window, focus=True)
    span = "second half of the run" if kind == "parameter" else "last oscillation periods"
    caption = f"Estimate of {history.name} in the {span}; the axis is scaled to the ±2σ band."
    return Drawing(f"closing-{history.name}", f"{history.name}: {span}", caption, _history_alt(history), image)


@styled()
def _bands(history: History, window: slice, *, focus: bool) -> bytes:
    factor, unit = shown_unit(history)
    time = history.time[window]
    mean, std = drawable(history.mean[window]) / factor, drawable(history.std[window]) / factor
    truth, smoothed = (
        None if values is None else drawable(values[window]) / factor for values in (history.truth, history.smoothed)
    )
    columns = [mean, mean - 2 * std, mean + 2 * std, *(values for values in (truth, smoothed) if values is not None)]
    index = visible_instants(np.column_stack(columns))
    canvas, axes = figure()
    if np.isfinite(std).any():
        band(axes, time[index], mean[index], std[index], BLUE, "±2σ")
    axes.plot(time[index], mean[index], color=BLUE, label="estimate")
    if smoothed is not None:
        label, sigma = "smoothed", history.smoothed_std
        if sigma is not None and np.isfinite(sigma).any():
            band(axes, time[index], smoothed[index], drawable(sigma[window])[index] / factor, GREEN)
            label = "smoothed ±2σ"
        axes.plot(time[index], smoothed[index], color=GREEN, label=label)
    if truth is not None:
        axes.plot(time[index], truth[index], color=INK, lw=1.2, ls=(0, (5, 3)), label="true value")
    if focus:
        focus_on(axes, np.concatenate([values[np.isfinite(values)] for values in columns]), share=0.0)
    time_axis(axes)
    axes.set_ylabel(f"{short(history.name)} [{unit}]")
    legend_above(axes)
    return svg(canvas)


def _history_alt(history: History) -> str:
    """Alternative text: final value with band."""
    end = quantity(float(history.mean[-1]), history.unit)
    truth = "" if history.truth is None else f", true value {quantity(float(history.truth[-1]), history.unit)}"
    sigma = f" ± {quantity(float(history.std[-1]), history.unit, 2)}" if np.isfinite(history.std[-1]) else ""
    return f"Line chart of {history.name}: estimate at the end of the run {end}{sigma}{truth}."


@styled()
def posterior_figure(name: str, unit: str, posterior: Posterior, truth: float | None = None) -> Drawing:
    """Prior and posterior density of a parameter, and its true value if known."""
    factor, shown = prefix(float(posterior.value.max()), unit)
    value = posterior.value / factor
    canvas, axes = figure()
    axes.fill_between(value, posterior.density, color=BLUE, alpha=0.25, lw=0, label="posterior")
    axes.plot(value, posterior.density, color=BLUE, lw=1.6, label="_")
    axes.plot(value, posterior.prior, color=ORANGE, lw=1.4, label="prior")
    if truth is not None:
        axes.axvline(truth / factor, color=INK, ls=(0, (5, 3)), lw=1.2, label="true value")
    axes.set(xlabel=f"{name} [{shown}]", ylabel=f"probability density of ln {name} [–]")
    axes.set_ylim(bottom=0)
    legend_above(axes, columns=3)
    top = quantity(float(posterior.value[np.argmax(posterior.density)]), unit)
    caption = (
        f"Probability density of {name} before (prior) and after (posterior) the measurements. A narrower posterior means more "
        "information; several peaks mean several possible values."
    )
    alt = f"Prior and posterior density of {name}; the posterior density is largest at {top}."
    return Drawing(f"posterior-{name}", f"{name}: posterior density", caption, alt, svg(canvas))
