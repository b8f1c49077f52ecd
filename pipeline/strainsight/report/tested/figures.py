"""All figures of the page of a test, in the order of the page."""

from __future__ import annotations

import numpy as np

from strainsight.report.arrays import History, largest
from strainsight.report.chart.drawing import (
    BLUE,
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
from strainsight.report.chart.histories import estimate_figure, posterior_figure
from strainsight.report.chart.panels import about, drawable, legend_above, log_ticks, plain_axis, time_axis
from strainsight.report.tested.data import Findings, Spectrum, peak_of
from strainsight.report.tested.readings import BUCKETS, hold_out_figures, reading_figure
from strainsight.report.text import capital, number, prefix, quantity, reading_unit, short

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
                axes.fill_between(at, low[index], high[index], color=colour, alpha=0.25, lw=0)
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
