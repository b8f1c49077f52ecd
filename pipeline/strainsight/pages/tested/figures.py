"""Figures of the page of a test, and the section on held-out channels."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from strainsight.pages.arrays import FloatArray, History, Reading, largest, rms
from strainsight.pages.chart.drawing import (
    BLUE,
    INK,
    MUTED,
    SMALL,
    VERMILION,
    WIDE,
    Drawing,
    figure,
    gauge_colour,
    styled,
    svg,
    visible_instants,
)
from strainsight.pages.chart.panels import (
    about,
    dots,
    drawable,
    estimate_figure,
    legend_above,
    log_ticks,
    overlay,
    plain_axis,
    posterior_figure,
    time_axis,
)
from strainsight.pages.page.markup import data, figures, plain, share, table
from strainsight.pages.page.sections import section
from strainsight.pages.tested.data import Findings, Spectrum, peak_of
from strainsight.text import READINGS, capital, number, percent, prefix, quantity, reading_unit, short

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BUCKETS = 180
"""Buckets of a record; the minimum and maximum of each are shown."""
INSIDE = 2.0
"""Half width of the band [σ]."""
HOLD_OUT = "Every channel is predicted from the other channels; the filter does not use the predicted channel."


def reading(value: float, unit: str, digits: int = 3) -> str:
    """Rounded reading with its exact value as data, a dash for NaN."""
    if math.isnan(value):
        return "–"
    factor, shown = reading_unit(abs(value), unit)
    return data(value, f"{number(value / factor, digits)}\u00a0{shown}", unit)


@dataclass(frozen=True)
class Curves:
    """Curves of a reading: factor, unit; what: quantity; measured, estimated and std (T,) [unit]; window: around the maximum."""

    factor: float
    unit: str
    what: str
    measured: FloatArray
    estimated: FloatArray
    std: FloatArray
    window: slice

    def overlay(self, axes: Axes, reading: Reading, part: slice, words: str) -> None:
        """Plot measured and estimated values over time."""
        values = (self.estimated[part], self.std[part])
        overlay(axes, reading.time[part], *values, gauge_colour(reading.gauge), words, self.measured[part])
        axes.set_ylabel(f"{self.what} [{short(self.unit)}]")


def curves_of(reading: Reading) -> Curves:
    """Curves in the displayed unit."""
    factor, unit = reading_unit(largest(reading.measured, reading.estimated), reading.unit)
    measured, estimated, std = (drawable(v) / factor for v in (reading.measured, reading.estimated, reading.std))
    what = READINGS.get(reading.unit, "reading")
    return Curves(factor, unit, what, measured, estimated, std, about(estimated, measured))


def _scatter(axes: Axes, time: FloatArray, values: FloatArray) -> None:
    """Plot dots or, for a long record, the range of the samples in every bucket."""
    if len(values) <= 2 * BUCKETS:
        dots(axes, time, values, "")
        return
    edges = np.linspace(0, len(values), BUCKETS + 1).astype(int)
    parts = [part[np.isfinite(part)] for part in np.split(values, edges[1:-1])]
    low = np.array([np.min(part, initial=np.inf) for part in parts])
    high = np.array([np.max(part, initial=-np.inf) for part in parts])
    low, high = (np.where(np.isfinite(low), ends, np.nan) for ends in (low, high))
    # filled between neighbouring buckets with samples; a line for an isolated bucket
    axes.fill_between(time[(edges[:-1] + edges[1:]) // 2], low, high, color=MUTED, alpha=0.7, lw=0.8)


@styled()
def reading_figure(reading: Reading) -> Drawing:
    """One channel: whole record, residual with the configured noise, and detail around the largest reading."""
    curves, time = curves_of(reading), reading.time
    unit, factor, window = curves.unit, curves.factor, curves.window
    residual, noise = curves.measured - curves.estimated, reading.noise_std / factor
    close = window.stop - window.start < len(time)
    ratios = (1.0, 0.7, 1.2) if close else (1.2, 0.8)
    canvas, *panels = figure(4.6 if close else 3.4, ratios, shared=False, width=SMALL)
    curves.overlay(panels[0], reading, slice(None), "reconstructed")
    _scatter(panels[1], time, residual)
    for edge in (-2 * noise, 2 * noise):
        panels[1].axhline(edge, color=INK, ls=(0, (4, 3)), lw=1)
    for axes in panels[2:]:
        curves.overlay(axes, reading, window, "reconstructed")
    for axes in panels:
        plain_axis(axes)
        axes.set_ylabel(f"{curves.what}\n[{short(unit)}]")
        axes.margins(x=0.01)
    panels[1].set_ylabel(f"residual\n[{short(unit)}]")
    panels[0].tick_params(labelbottom=False)
    panels[1].set_xlim(panels[0].get_xlim())
    for axes in panels[1:]:
        time_axis(axes)
    legend_above(panels[0])
    left = number(rms(residual), 3)
    caption = f"Residual {left} {unit} RMS; configured noise σ {number(noise, 3)} {unit} (dashed: ±2σ)"
    caption += "; below, detail around the largest reading." if close else "."
    if reading.missing:
        caption += f" Missing samples in the filter: {reading.missing} of {len(time)}."
    if reading.offset is not None:
        mean, sigma = (number(value / factor, 3) for value in reading.offset)
        caption += f" The estimated offset of {mean} ± {sigma} {unit} is subtracted from the reading."
    alt = f"Line chart of measured and reconstructed {curves.what} of {reading.label}, peak "
    alt += f"{number(largest(curves.estimated), 3)} {unit}, residual {left} {unit} RMS."
    return Drawing(f"reading-{reading.label}", reading.label, caption, alt, svg(canvas))


def inside(channel: Reading) -> float:
    """Share of the samples within ±2σ of the prediction, with measurement noise in σ; NaN without σ."""
    ratio = np.abs(channel.residual / channel.std)
    known = ratio[np.isfinite(ratio)]
    return float(np.mean(known <= INSIDE)) if len(known) else float("nan")


def hold_out_figures(channels: Sequence[Reading]) -> list[Drawing]:
    """Scatter plot and time chart of every channel."""
    return [drawing for channel in channels for drawing in (_cross(channel), _overlay(channel))]


@styled()
def _cross(reading: Reading) -> Drawing:
    """Measured over predicted values, with the line of equality."""
    curves, label = curves_of(reading), reading.label
    measured, predicted, what = curves.measured, curves.estimated, curves.what
    index = visible_instants(np.column_stack([measured, predicted, measured - predicted]), 240)
    limit = 1.05 * largest(measured, predicted) or 1.0
    canvas, axes = figure(4.2)
    dots(axes, predicted[index], measured[index], "samples")
    axes.plot([-limit, limit], [-limit, limit], color=INK, lw=1, ls=(0, (5, 3)), label="equal")
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit), aspect="equal")
    axes.set(xlabel=f"predicted {what} [{short(curves.unit)}]", ylabel=f"measured {what} [{short(curves.unit)}]")
    legend_above(axes)
    caption = f"{label}, measured versus predicted reading; both are equal on the dashed line."
    alt = (
        f"Scatter plot of measured versus predicted {what} of {label}, RMS error {_error(reading)} of the measured RMS."
    )
    return Drawing(f"hold-out-{label}", f"{label}: measured versus predicted", caption, alt, svg(canvas))


@styled()
def _overlay(reading: Reading) -> Drawing:
    """Measured and predicted values over time around the largest reading."""
    curves, label = curves_of(reading), reading.label
    canvas, axes = figure(3.4)
    curves.overlay(axes, reading, curves.window, "predicted")
    plain_axis(axes)
    time_axis(axes)
    legend_above(axes)
    caption = f"{label} around its largest reading: measured, and predicted from the other channels with ±2σ band."
    alt = f"Line chart of measured and predicted {curves.what} of {label}, RMS error {_error(reading)} of the measured RMS."
    return Drawing(f"hold-out-time-{label}", f"{label}: measured and predicted over time", caption, alt, svg(canvas))


def _error(reading: Reading) -> str:
    size = rms(reading.measured)
    return percent(rms(reading.residual) / size) if size > 0 else "–"


def hold_out_section(channels: Sequence[Reading], cards: Iterable[str]) -> str:
    """Table and figures; empty without held-out channels."""
    if not channels:
        return ""
    rows = []
    for channel in channels:
        error, size, sigma = rms(channel.residual), rms(channel.measured), rms(channel.residual / channel.std)
        of_size = share(error / size) if size > 0 else "–"
        over_sigma = plain(sigma, 3) if np.isfinite(sigma) else "–"
        rows.append([escape(channel.label), reading(error, channel.unit), of_size, over_sigma, share(inside(channel))])
    head = ("channel", "RMS error", "RMS error / RMS reading", "RMS of error / σ", "samples within ±2σ")
    caption = "Error: measured − predicted. For a correct σ, 95 % of the samples are within ±2σ, and the RMS of error / σ is 1."
    text = table("hold-out", head, rows, caption=caption, numeric=range(1, 5))
    worst = min(map(inside, channels))
    least = "" if np.isnan(worst) else f" Smallest share of samples within ±2σ: {number(100 * worst, 3)} %."
    return section("Prediction of held-out channels", text, lead=HOLD_OUT + least) + figures(cards)


WORDS = {
    "load": ("smoothed estimate of {}", "smoothed"),
    "resultant": ("magnitude of the sum of the loads at {}, smoothed", "magnitude"),
    "known": ("measured known load {}", "measured"),
}
"""Kind of history → its description, and the name of its curve."""
LINES = 700
"""Most lines of a spectrum; of more, the largest of neighbours are shown."""


def figures_of_test(report: Findings) -> tuple[Drawing, ...]:
    """Figures with data. Their keys begin with "reading-", "residual-", "hold-out", "load-", "known-", "resultant-", "spectrum-",
    "estimate-" or "posterior-"."""
    loads = {entry.name for entry in report.loads}
    drawings = [reading_figure(entry) for entry in report.readings]
    drawings += hold_out_figures(report.hold_out)
    colours = {entry.label: gauge_colour(entry.gauge) for entry in report.readings}
    drawings += [spectrum_figure(entry, colours.get(entry.name, BLUE)) for entry in report.residuals]
    drawings += [load_figure("load", entry, BLUE) for entry in report.histories if entry.name in loads]
    drawings += [load_figure("resultant", entry, BLUE) for entry in report.resultants]
    drawings += [load_figure("known", entry, VERMILION) for entry in report.known]
    drawings += [spectrum_figure(entry) for entry in report.load_spectra]
    drawings += [estimate_figure(entry) for entry in report.histories if entry.name not in loads]
    drawings += [posterior_figure(name, report.units[name], entry) for name, entry in report.posteriors.items()]
    return tuple(drawings)


@styled()
def load_figure(kind: str, history: History, colour: str) -> Drawing:
    """Mean of a load history with its ±2σ band, if σ is known; kind: a key of WORDS."""
    words, curve = WORDS[kind]
    factor, unit = prefix(largest(history.mean), history.unit)
    mean, std, time = drawable(history.mean) / factor, drawable(history.std) / factor, history.time
    banded, window = bool(np.isfinite(std).any()), about(mean, mean)
    close = window.stop - window.start < len(time)
    canvas, *panels = figure(4.4 if close else 3.2, (1.0, 1.2) if close else (1.0,), shared=False)
    for axes, part in zip(panels, (slice(None), window), strict=False):
        overlay(axes, time[part], mean[part], std[part], colour, curve)
        plain_axis(axes)
        axes.set_ylabel(f"{short(history.name)} [{unit}]")
        axes.margins(x=0.01)
        time_axis(axes)
    legend_above(panels[0])
    value, when = peak_of(history.time, history.mean).largest
    title = words.format(history.name)
    caption = capital(title) + " with a band of ±2σ (σ claimed by the filter)" * banded
    caption += "; below, detail around the largest value." if close else "."
    caption += " σ is withheld." * (kind == "load" and not banded)
    alt = f"Line chart of the {title}, largest {quantity(value, history.unit)} at {number(when)} s."
    return Drawing(f"{kind}-{history.name}", history.name, caption, alt, svg(canvas))


@styled()
def spectrum_figure(spectrum: Spectrum, colour: str = BLUE) -> Drawing:
    """√density over frequency of a load, or of a channel's residual with the configured noise."""
    name, root, frequency = spectrum.name, np.sqrt(spectrum.density), spectrum.frequency
    at, top = f"{number(float(frequency[np.argmax(root)]), 3)} Hz", float(np.max(root, initial=0.0))
    level = None if spectrum.level is None else float(np.sqrt(spectrum.level))
    if level is None:
        factor, unit = prefix(top, spectrum.unit)
        key, title, label = f"spectrum-{name}", f"{name}: spectrum", short(name)
        caption = f"Spectrum of the smoothed load {name}: at most {quantity(top, spectrum.unit, 3)}/√Hz, at {at}."
        alt = f"Spectrum of the smoothed load {name}, largest at {at}."
    else:
        factor, unit = reading_unit(max(level, top), spectrum.unit)
        if spectrum.unit == "strain":
            factor, unit = 1e-9, "nm/m"
        key, title, label = f"residual-{name}", name, "residual"
        words = f"at most {number(top / level if level > 0 else np.inf, 2)} times the configured noise, at {at}."
        caption = alt = f"Spectrum of the residual of {name}: {words}"
    few = -(-len(root) // LINES)
    if few > 1:  # the largest of neighbouring lines, at its frequency
        places = np.array([start + int(np.argmax(root[start : start + few])) for start in range(0, len(root), few)])
        frequency, root = frequency[places], root[places]
    root, noise = root / factor, (level or 0.0) / factor
    canvas, axes = figure(3.4, width=WIDE) if level is None else figure(2.5, width=SMALL)
    axes.plot(frequency, np.where(root > 0, root, np.nan), color=colour, lw=1.2, label=label)
    if level is not None:
        axes.axhline(noise, color=VERMILION, ls=(0, (5, 3)), lw=1.3, label="configured noise")
    if (root > 0).any():
        axes.set_yscale("log")
        low, high = axes.get_ylim()
        if noise:  # at least a decade on each side, to show the scatter to scale
            low, high = min(low, 0.1 * noise), max(high, 10 * noise)
        axes.set_ylim(max(low, 1e-5 * max(float(root.max()), noise)), high)
    log_ticks(axes)
    axes.set(xlabel="frequency [Hz]", ylabel=f"√PSD\n[{short(unit)}/√Hz]")
    axes.margins(x=0.01)
    legend_above(axes)
    return Drawing(key, title, caption, alt, svg(canvas))
