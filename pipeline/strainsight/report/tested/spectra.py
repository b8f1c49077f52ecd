"""Spectra: of what the estimate leaves of every channel beside the stated noise, and of the loads."""

from __future__ import annotations

import numpy as np

from strainsight.report.chart.drawing import BLUE, SMALL, VERMILION, WIDE, Drawing, figure, styled, svg
from strainsight.report.chart.panels import legend_above, log_ticks
from strainsight.report.tested.data import Spectrum
from strainsight.report.text import number, prefix, quantity, reading_unit, short

LINES = 700
"""More lines of a spectrum than these are drawn as the largest of neighbours."""


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
