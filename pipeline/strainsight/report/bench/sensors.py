"""Figures of a bench's sensors as measured and as its estimate has them, and whether the filter believes them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.report.arrays import FloatArray, largest
from strainsight.report.bench.data import BenchEstimate, BenchSensor
from strainsight.report.bench.figures import legend_height, line_label, line_style
from strainsight.report.chart.drawing import BLUE, INK, Drawing, figure, styled, svg, visible_instants
from strainsight.report.chart.panels import (
    dots,
    drawable,
    legend_above,
    legend_of_lines,
    log_ticks,
    plain_axis,
    time_axis,
)
from strainsight.report.text import number, ratio, reading_unit, short

PANELS = 8
"""Most components of a sensor in one figure."""
NONE = 1e-20
"""A violation of constraints below this, a millionth of rounding, is none: no logarithmic axis reaches down to it."""
ROUNDING = 1e-12
"""Share of the largest component of a simulated sensor, below which one is none: a scale of its own would show noise."""


def sensor_figure(key: str, title: str, component: int, lines: Sequence[tuple[str, BenchSensor]]) -> Drawing:
    """One component of a sensor as measured and as the estimates say it; below, the difference."""
    first = lines[0][1]
    columns = [(label, sensor, drawable(sensor.measured[:, component])) for label, sensor in lines]
    factor, unit = sensor_unit(largest(*(values for *_, values in columns)), first.units[component])
    with styled():
        labels = [line_label(label, len(lines)) for label, _ in lines]
        drawn, axes, below = figure(4.4 + legend_height(labels), (1.5, 1.0))
        shown: list[FloatArray] = []
        for place, (label, sensor, values) in enumerate(columns):
            index = visible_instants(values[:, None], 240)
            if not any(np.array_equal(values, other, equal_nan=True) for other in shown):
                dots(axes, sensor.time[index], values[index] / factor, "" if shown else "measured")
                shown.append(values)
            if sensor.expected is None:
                continue
            expected, style = drawable(sensor.expected[:, component]), line_style(place)
            axes.plot(sensor.time[index], expected[index] / factor, **style, label=line_label(label, len(lines)))
            difference = (values - expected) / factor
            index = visible_instants(difference[:, None], 240)
            below.plot(sensor.time[index], difference[index], **{**style, "lw": 0.7 * style["lw"]})
        plain_axis(axes)
        axes.set_ylabel(f"{short(first.components[component], 20)} [{short(unit)}]")
        below.set_ylabel(f"measured −\nestimated [{short(unit)}]")
        time_axis(below)
        legend_of_lines(axes, labels)
        image = svg(drawn)
    what = f"{first.name}, {first.components[component]}"
    given = "" if first.used else "; the filter was not given it"
    caption = f"{what}: measured, and as the estimate says it should read; below, the difference{given}."
    parts = [
        f"{label or first.name} {ratio(mismatch(sensor, component))}"
        for label, sensor in lines
        if sensor.expected is not None
    ]
    alt = f"Line chart of {what} measured and estimated; RMS of the difference over that of the reading: {', '.join(parts)}."
    return Drawing(key, title, caption, alt, image)


def components_figure(key: str, title: str, sensor: BenchSensor) -> Drawing:
    """All components of one sensor, the largest eight where there are more, measured and estimated, one over the other."""
    size = np.nanmax(np.abs(drawable(sensor.measured)), axis=0, initial=0.0)
    kept = sorted(np.argsort(-size, kind="stable")[:PANELS].tolist())
    with styled():
        drawn, *panels = figure(1.0 + 0.95 * len(kept), (1.0,) * len(kept))
        for axes, i in zip(panels, kept, strict=True):
            measured = drawable(sensor.measured[:, i])
            if sensor.expected is None and size[i] <= ROUNDING * size.max():
                measured = np.zeros_like(measured)
            factor, unit = sensor_unit(largest(measured), sensor.units[i])
            index = visible_instants(measured[:, None], 240)
            if sensor.expected is None:
                axes.plot(sensor.time[index], measured[index] / factor, color=BLUE)
            else:
                dots(axes, sensor.time[index], measured[index] / factor, "measured" * (i == kept[0]))
                expected = drawable(sensor.expected[:, i])[index] / factor
                axes.plot(sensor.time[index], expected, color=BLUE, label="estimated" if i == kept[0] else None)
            plain_axis(axes)
            axes.locator_params(axis="y", nbins=3)
            axes.set_ylabel(f"{short(sensor.components[i], 9)}\n[{short(unit)}]")
        time_axis(panels[-1])
        if sensor.expected is not None:
            legend_above(panels[0])
        image = svg(drawn)
    many = "" if len(kept) == len(sensor.components) else f" (the largest {len(kept)} of {len(sensor.components)})"
    caption = f"Components of {sensor.name}{many} in time"
    if sensor.expected is not None:
        text = ", ".join(f"{sensor.components[i]} {ratio(mismatch(sensor, i))}" for i in kept)
        caption += f"; RMS of measured − estimated over RMS of measured: {text}"
    if not sensor.used:
        caption += "; the filter was not given it"
    return Drawing(key, title, f"{caption}.", f"Line charts of {len(kept)} components of {sensor.name} in time.", image)


def consistency_figure(estimate: BenchEstimate, expected: float | None) -> Drawing:
    """NIS over the number of channels at every step, and the violation of the constraints after every correction; expected: NIS,
    where it is known."""
    with styled():
        drawn, axes, below = figure(4.2, (1.4, 1.0))
        index = visible_instants(estimate.nis[:, None], 240)
        dots(axes, estimate.time[1:][index], estimate.nis[index], "NIS over channels")
        mean = float(np.mean(estimate.nis[np.isfinite(estimate.nis)])) if np.isfinite(estimate.nis).any() else np.nan
        axes.axhline(mean, color=BLUE, label="mean")
        if expected is not None:
            axes.axhline(expected, color=INK, lw=1, ls=(0, (4, 2)), label="expected")
        axes.set_ylabel("NIS / channels [–]")
        axes.set_ylim(bottom=0)
        plain_axis(axes)
        index = visible_instants(estimate.violation[:, None], 240)
        violation = drawable(estimate.violation[index])
        if (violation > NONE).any():
            violation = np.where(violation > NONE, violation, np.nan)
            below.set_yscale("log")
        dots(below, estimate.time[index], violation, "")
        log_ticks(below)
        below.set_ylabel("constraints\nviolated by")
        time_axis(below)
        legend_above(axes)
        image = svg(drawn)
    worst = number(float(np.nanmax(estimate.violation, initial=0.0)), 2)
    caption = (
        f"Above, normalised innovation squared over the number of channels: mean {number(mean, 3)}"
        + (f", expected {number(expected, 3)}" if expected is not None else "")
        + f". Below, how far the constraints are violated after every correction: at most {worst}."
    )
    return Drawing("consistency", "Does the filter believe its sensors?", caption, caption, image)


def mismatch(sensor: BenchSensor, component: int) -> float:
    """RMS of measured − estimated over RMS of measured; NaN where nothing was measured."""
    if sensor.expected is None:
        return float("nan")
    off = sensor.measured[:, component] - sensor.expected[:, component]
    size = float(np.sqrt(np.mean(sensor.measured[:, component] ** 2)))
    return float(np.sqrt(np.mean(off**2))) / size if size > 0 else float("nan")


def sensor_unit(size: float, unit: str) -> tuple[float, str]:
    """Factor and unit in which readings of this size are shown: angles as displacements are."""
    if unit == "rad":
        factor, shown = reading_unit(size, "m")
        return factor, f"{shown.removesuffix('m')}rad"
    return reading_unit(size, unit)
