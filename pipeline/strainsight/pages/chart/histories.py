"""The figures of an unknown: its estimate in time with the band that is claimed for it, and the posterior of a parameter."""

from __future__ import annotations

import numpy as np

from strainsight.pages.arrays import History
from strainsight.pages.chart.drawing import BLUE, GREEN, INK, ORANGE, Drawing, figure, styled, svg, visible_instants
from strainsight.pages.chart.panels import band, drawable, focus_on, last_periods, legend_above, shown_unit, time_axis
from strainsight.pages.text import prefix, quantity, short
from strainsight.records.estimated import Posterior


def estimate_figure(history: History, start: int = 0) -> Drawing:
    """Estimate with its ±2σ band beside the truth, the whole run, or what of it follows an instant."""
    image = _bands(history, slice(start, None), focus=False)
    caption = (
        f"Estimate of {history.name} over the whole run; the band is ±2 standard deviations as the filter claims them."
    )
    alt = _history_alt(history)
    return Drawing(f"estimate-{history.name}", f"{history.name}: whole run", caption, alt, image)


def closing_figure(history: History, kind: str) -> Drawing:
    """The same, close up: the last half of a parameter, the last periods of an input."""
    reference = history.mean if history.truth is None else history.truth
    window = slice(len(history.time) // 2, None) if kind == "parameter" else last_periods(reference)
    image = _bands(history, window, focus=True)
    span = "last half of the run" if kind == "parameter" else "last periods"
    caption = f"{history.name} close up: the {span}, on a scale that shows the band."
    return Drawing(f"closing-{history.name}", f"{history.name}: {span}", caption, _history_alt(history), image)


def _bands(history: History, window: slice, *, focus: bool) -> bytes:
    factor, unit = shown_unit(history)
    time = history.time[window]
    mean, std = drawable(history.mean[window]) / factor, drawable(history.std[window]) / factor
    columns = [mean, mean - 2 * std, mean + 2 * std]
    truth = None if history.truth is None else drawable(history.truth[window]) / factor
    smoothed = None if history.smoothed is None else drawable(history.smoothed[window]) / factor
    columns += [values for values in (truth, smoothed) if values is not None]
    index = visible_instants(np.column_stack(columns))
    with styled():
        drawn, axes = figure()
        if np.isfinite(std).any():
            band(axes, time[index], mean[index], std[index], BLUE, 0.2, "±2σ")
        axes.plot(time[index], mean[index], color=BLUE, label="estimate")
        if smoothed is not None:
            claimed = history.smoothed_std is not None and np.isfinite(history.smoothed_std).any()
            if history.smoothed_std is not None and claimed:
                band(axes, time[index], smoothed[index], drawable(history.smoothed_std[window])[index] / factor, GREEN)
            axes.plot(time[index], smoothed[index], color=GREEN, label="smoothed ±2σ" if claimed else "smoothed")
        if truth is not None:
            axes.plot(time[index], truth[index], color=INK, lw=1.2, ls=(0, (5, 3)), label="truth")
        if focus:
            focus_on(axes, np.concatenate([values[np.isfinite(values)] for values in columns]), share=0.0)
        time_axis(axes)
        axes.set_ylabel(f"{short(history.name)} [{unit}]")
        legend_above(axes)
        return svg(drawn)


def _history_alt(history: History) -> str:
    """The curve in words: where it ends, with what band."""
    end = quantity(float(history.mean[-1]), history.unit)
    truth = "" if history.truth is None else f", truth {quantity(float(history.truth[-1]), history.unit)}"
    sigma = f" ± {quantity(float(history.std[-1]), history.unit, 2)}" if np.isfinite(history.std[-1]) else ""
    return f"Line chart of {history.name}: at the end {end}{sigma}{truth}."


def posterior_figure(name: str, unit: str, own: Posterior, truth: float | None = None) -> Drawing:
    """Density of a parameter before and after the measurements, and its true value where that is known."""
    factor, shown = prefix(float(own.value.max()), unit)
    value = own.value / factor
    with styled():
        drawn, axes = figure()
        axes.fill_between(value, own.density, color=BLUE, alpha=0.25, lw=0, label="after the measurements")
        axes.plot(value, own.density, color=BLUE, lw=1.6, label="_")
        axes.plot(value, own.prior, color=ORANGE, lw=1.4, label="before them")
        if truth is not None:
            axes.axvline(truth / factor, color=INK, ls=(0, (5, 3)), lw=1.2, label="truth")
        axes.set_xlabel(f"{name} [{shown}]")
        axes.set_ylabel(f"density of ln {name} [–]")
        axes.set_ylim(bottom=0)
        legend_above(axes, columns=3)
        image = svg(drawn)
    top = quantity(float(own.value[np.argmax(own.density)]), unit)
    caption = (
        f"What is known of {name} after the measurements of the test, beside what was known before: the narrower of the two "
        "curves, the more they say; one with several peaks allows several values."
    )
    alt = f"Density of {name} before and after the measurements, largest at {top}."
    return Drawing(f"posterior-{name}", f"{name}: what the measurements leave", caption, alt, image)
