"""What every channel of every gauge measured, and what the filter makes of it: thesis figure 6.8."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.report.chart.drawing import INK, Drawing, figure, gauge_colour, styled, svg, visible_instants
from strainsight.report.chart.panels import dots, drawable, last_periods, legend_above, time_axis
from strainsight.report.picture.layout import Gauge
from strainsight.report.placement.data import GaugeSignal
from strainsight.report.text import READINGS, number, reading_unit, short


def signal_figures(signals: Sequence[GaugeSignal], gauges: Sequence[Gauge]) -> list[Drawing]:
    """One figure a channel, in the colour of its gauge."""
    labels = [gauge.label for gauge in gauges]
    return [signal_figure(signal, gauge_colour(owner(signal.label, labels, i))) for i, signal in enumerate(signals)]


def owner(label: str, gauges: Sequence[str], otherwise: int) -> int:
    """Which gauge a channel belongs to: that of its label, or of the longest label that it begins with ("G1 45°")."""
    if label in gauges:
        return gauges.index(label)
    begun = [name for name in gauges if label.startswith(f"{name} ")]
    return gauges.index(max(begun, key=len)) if begun else otherwise


def signal_figure(signal: GaugeSignal, colour: str) -> Drawing:
    """Measured and estimated reading of one channel over the last periods, in µm/m, m/s² or millimetres."""
    window = last_periods(signal.estimated)
    factor, unit = reading_unit(_peak(signal.measured[window]), signal.unit)
    what = READINGS.get(signal.unit, "reading")
    time = signal.time[window]
    whole = [drawable(values) / factor for values in (signal.measured, signal.estimated, signal.std)]
    measured, estimated, std = (values[window] for values in whole)
    index = visible_instants(np.column_stack([measured, estimated]))
    with styled():
        drawn, axes, below = figure(4.1, (2.2, 1.0))
        dots(axes, time[index], measured[index], "measured")
        if signal.truth is not None:
            truth = drawable(signal.truth)[window][index] / factor
            axes.plot(time[index], truth, color=INK, lw=1, ls=(0, (4, 2)), label="without noise")
        axes.plot(time[index], estimated[index], color=colour, label="estimated")
        below.fill_between(time[index], -2 * std[index], 2 * std[index], color=colour, alpha=0.35, lw=0)
        dots(below, time[index], (measured - estimated)[index], "")
        axes.set_ylabel(f"{what} [{short(unit)}]")
        below.set_ylabel(f"measured −\nestimated [{short(unit)}]")
        time_axis(below)
        legend_above(axes)
        image = svg(drawn)
    residual = float(np.sqrt(np.mean((whole[0] - whole[1]) ** 2)))
    caption = (
        f"{what.capitalize()} at gauge {signal.label}, last periods. Below, what the filter leaves unexplained "
        f"(RMS {number(residual, 3)} {unit} over the run) and the ±2σ band of its estimate."
    )
    peak = number(_peak(estimated), 3)
    alt = f"Line chart of measured and estimated {what} at gauge {signal.label}, peak {peak} {unit}."
    return Drawing(f"signal-{signal.label}", f"Gauge {signal.label}", caption, alt, image)


def _peak(values: np.ndarray) -> float:
    """Largest size among what is finite, 0 where nothing is."""
    return float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0))
