"""All figures of the page of a test, in the order of the page, and the section of channels that were held out."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape
from itertools import pairwise
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
    band,
    dots,
    drawable,
    estimate_figure,
    legend_above,
    log_ticks,
    plain_axis,
    posterior_figure,
    time_axis,
)
from strainsight.pages.page.markup import data, figures, plain, share, table
from strainsight.pages.tested.data import Findings, Spectrum, peak_of
from strainsight.pages.text import READINGS, capital, number, percent, prefix, quantity, reading_unit, short

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
        band(axes, time[index], estimated[index], std[index], colour, 0.3)
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


WORDS = {
    "load": ("smoothed estimate of {}", "smoothed"),
    "resultant": ("size of the sum of the loads at {}, smoothed", "size"),
    "known": ("known load {} as measured", "measured"),
}
"""Kind of history → what it is, and the name of its curve."""
LINES = 700
"""More lines of a spectrum than these are drawn as the largest of neighbours."""


def figures_of_test(report: Findings) -> tuple[Drawing, ...]:
    """Those that the report has data for; their keys begin with what they are of: "reading-", "residual-", "hold-out", "load-",
    "known-", "resultant-", "spectrum-", "estimate-", "posterior-"."""
    loads = {own.name for own in report.loads}
    drawings = [reading_figure(own) for own in report.readings]
    drawings += hold_out_figures(report.hold_out)
    colours = {own.label: gauge_colour(own.gauge) for own in report.readings}
    drawings += [residual_figure(own, colours.get(own.name, BLUE)) for own in report.residuals]
    drawings += [load_figure("load", own, BLUE) for own in report.histories if own.name in loads]
    drawings += [load_figure("resultant", own, BLUE) for own in report.resultants]
    drawings += [load_figure("known", own, VERMILION) for own in report.known]
    drawings += [load_spectrum_figure(own) for own in report.load_spectra]
    drawings += [estimate_figure(own) for own in report.histories if own.name not in loads]
    drawings += [posterior_figure(name, report.units[name], own) for name, own in report.posteriors.items()]
    return tuple(drawings)


def load_figure(kind: str, history: History, colour: str) -> Drawing:
    """kind: a key of WORDS; history: its mean and std are drawn, the band where σ is given."""
    words, curve = WORDS[kind]
    factor, unit = prefix(largest(history.mean), history.unit)
    mean, std, time = drawable(history.mean) / factor, drawable(history.std) / factor, history.time
    banded = bool(np.isfinite(std).any())
    window = about(mean, int(np.argmax(np.where(np.isfinite(mean), np.abs(mean), -1.0))))
    close = window.stop - window.start < len(time)
    with styled():
        drawn, *panels = figure(4.4 if close else 3.2, (1.0, 1.2) if close else (1.0,), shared=False)
        for axes, part in zip(panels, (slice(None), window), strict=False):
            low, high = mean[part] - 2 * std[part], mean[part] + 2 * std[part]
            columns = [mean[part], low, high] if banded else [mean[part]]
            index = visible_instants(np.column_stack(columns), BUCKETS)
            at = time[part][index]
            if banded:
                band(axes, at, mean[part][index], std[part][index], colour)
            axes.plot(at, mean[part][index], color=colour, lw=1.2, label=f"{curve} ±2σ" if banded else curve)
            plain_axis(axes)
            axes.set_ylabel(f"{short(history.name)} [{unit}]")
            axes.margins(x=0.01)
            time_axis(axes)
        legend_above(panels[0])
        image = svg(drawn)
    value, when = peak_of(history.time, history.mean).largest
    top = f"{quantity(value, history.unit)} at {number(when)} s"
    said = words.format(history.name)
    caption = (
        f"{capital(said)}"
        + (" with its band of ±2 claimed standard deviations" if banded else "")
        + ("; below, about the largest value." if close else ".")
    )
    if kind == "load" and not banded:
        caption += " σ is withheld."
    alt = f"Line chart of the {said}, largest {top}."
    return Drawing(f"{kind}-{history.name}", history.name, caption, alt, image)


def residual_figure(own: Spectrum, colour: str) -> Drawing:
    """What is left of a channel: √density over frequency beside that of the noise as stated."""
    root = np.sqrt(own.density)
    level = None if own.level is None else float(np.sqrt(own.level))
    factor, unit = reading_unit(float(np.max(root, initial=level or 0.0)), own.unit)
    if own.unit == "strain":
        factor, unit = 1e-9, "nm/m"
    image = _drawn(own.frequency, root / factor, f"[{short(unit)}/√Hz]", colour, "left over", level, factor)
    caption = f"Left over of {own.name}."
    alt = f"Spectrum of the residual of {own.name}"
    if level is not None:
        above = float(np.max(root, initial=0.0)) / level if level > 0 else np.inf
        at = float(own.frequency[np.argmax(root)])
        caption = f"Left over of {own.name}: at most {number(above, 2)} times the stated noise, at {number(at, 3)} Hz."
        alt += f", at most {number(above, 2)} times the stated noise, at {number(at, 3)} Hz"
    return Drawing(f"residual-{own.name}", own.name, caption, f"{alt}.", image)


def load_spectrum_figure(own: Spectrum) -> Drawing:
    """Of a load: √density over frequency."""
    root = np.sqrt(own.density)
    factor, unit = prefix(float(np.max(root, initial=0.0)), own.unit)
    image = _drawn(own.frequency, root / factor, f"[{short(unit)}/√Hz]", BLUE, short(own.name), None, factor)
    at = float(own.frequency[np.argmax(root)])
    top = quantity(float(np.max(root, initial=0.0)), own.unit, 3)
    caption = f"Spectrum of {own.name}, smoothed: largest at {number(at, 3)} Hz, {top}/√Hz."
    alt = f"Spectrum of the load {own.name}, largest at {number(at, 3)} Hz."
    return Drawing(f"spectrum-{own.name}", f"{own.name}: spectrum", caption, alt, image)


def _drawn(
    frequency: np.ndarray, root: np.ndarray, unit: str, colour: str, label: str, level: float | None, factor: float
) -> bytes:
    frequency, root = _thinned(frequency, root)
    with styled():
        drawn, axes = figure(2.5 if level is not None else 3.4, width=WIDE if level is None else SMALL)
        positive = root > 0
        axes.plot(frequency, np.where(positive, root, np.nan), color=colour, lw=1.2, label=label)
        if level is not None:
            axes.axhline(level / factor, color=VERMILION, ls=(0, (5, 3)), lw=1.3, label="noise as stated")
        if positive.any():
            axes.set_yscale("log")
            top = max(float(root.max()), (level or 0.0) / factor)
            low, high = axes.get_ylim()
            if level:  # a decade to either side at least, so that scatter looks like scatter
                low, high = min(low, 0.1 * level / factor), max(high, 10 * level / factor)
            axes.set_ylim(max(low, 1e-5 * top), high)
        log_ticks(axes)
        axes.set_xlabel("frequency [Hz]")
        axes.set_ylabel(f"√density\n{unit}")
        axes.margins(x=0.01)
        legend_above(axes)
        return svg(drawn)


def _thinned(frequency: np.ndarray, root: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The largest of every few neighbours, at its own frequency."""
    few = -(-len(root) // LINES)
    if few <= 1:
        return frequency, root
    at = np.array([start + int(np.argmax(root[start : start + few])) for start in range(0, len(root), few)])
    return frequency[at], root[at]
