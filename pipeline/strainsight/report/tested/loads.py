"""Loads in time: the whole record, and a close-up about the largest value."""

from __future__ import annotations

import numpy as np

from strainsight.report.arrays import History
from strainsight.report.chart.drawing import Drawing, figure, styled, svg, visible_instants
from strainsight.report.chart.panels import about, drawable, legend_above, plain_axis, time_axis
from strainsight.report.tested.data import peak_of
from strainsight.report.tested.readings import BUCKETS, largest
from strainsight.report.text import capital, number, prefix, quantity, short

WORDS = {
    "load": ("smoothed estimate of {}", "smoothed"),
    "resultant": ("size of the sum of the loads at {}, smoothed", "size"),
    "known": ("known load {} as measured", "measured"),
}
"""Kind of history → what it is, and the name of its curve."""


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
