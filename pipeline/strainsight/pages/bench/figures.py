"""Figures of estimated unknowns and sensors of benches, for one run or several runs.

Thesis figures 2.2 to 2.8, 3.2 to 3.9 and 4.1 to 4.6."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from strainsight.pages.arrays import FloatArray, History, largest, rms
from strainsight.pages.bench.data import BenchSensor, BenchUnknown
from strainsight.pages.chart.drawing import (
    BLUE,
    GREEN,
    INK,
    MUTED,
    SERIES,
    Drawing,
    figure,
    styled,
    svg,
    visible_instants,
)
from strainsight.pages.chart.panels import (
    band,
    dots,
    drawable,
    focus_on,
    legend_above,
    legend_of_lines,
    log_ticks,
    plain_axis,
    shown_unit,
    time_axis,
)
from strainsight.records.bench import BenchEstimated
from strainsight.text import number, ratio, reading_unit, short

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STROKES = ("-", (0, (5, 2)), (0, (1, 1.5)), (0, (5, 2, 1, 2)))
"""Stroke of each cycle through the colours."""
ROUNDING = 1e-14
"""Smallest relative error on a logarithmic axis: a starting value may equal the truth."""
LARGE = 0.3
"""Share of the largest load above which a ratio is computed."""
SAME = 0.02
"""Share of the largest value within which two true histories are shown as one, e.g. with different sampling."""


@styled()
def unknown_figure(key: str, title: str, lines: Sequence[tuple[str, BenchUnknown]]) -> Drawing:
    """Estimates and truth of one unknown; below, errors relative to the largest true value on a logarithmic axis.

    lines: label of the run and its unknown. A single line also has the ±2σ band, the claimed σ in the error panel, unless σ is
    withheld, and the smoothed estimate."""
    (_, first), alone = lines[0], len(lines) == 1
    name, load = first.name, first.kind == "input"
    factor, unit = shown_unit(*(history for _, history in lines))
    labels = [line_label(label, len(lines)) for label, _ in lines]
    known = [(place, history) for place, (_, history) in enumerate(lines) if history.truth is not None]
    claimed, smoothed = alone and bool(np.isfinite(first.std).any()), first.smoothed if alone else None
    canvas, axes, *more = figure((4.6 if known else 3.2) + legend_height(labels), (1.3, 1.0) if known else (1.0,))
    _truths(axes, [history for _, history in known], factor)
    if claimed:
        mean, std = drawable(first.mean) / factor, drawable(first.std) / factor
        index = visible_instants(np.column_stack([mean, std]), 240)
        band(axes, first.time[index], mean[index], std[index], BLUE, "±2σ")
    for place, (label, (_, history)) in enumerate(zip(labels, lines, strict=True)):
        line(axes, history.time, history.mean / factor, **line_style(place), label=label)
    if smoothed is not None:
        line(axes, first.time, smoothed / factor, color=GREEN, lw=1.2, label="smoothed")
    if alone and load:
        # limited to the estimate and the truth: the initial band may be a hundred times wider
        late = slice(len(first.std) // 10, None)
        mean, reach = first.mean[late], 2 * first.std[late]
        parts = [first.mean, mean + reach, mean - reach, *([] if first.truth is None else [first.truth])]
        focus_on(axes, np.concatenate(parts) / factor, share=0.0)
    plain_axis(axes)
    axes.set_ylabel(f"{short(name, 24)} [{short(unit)}]")
    for below in more:
        _errors(below, known, alone=alone)
    time_axis((axes, *more)[-1])
    legend_of_lines(axes, labels)
    caption = f"{name}, {'load' if load else 'parameter'}: estimate" + " and true value (dashed)" * bool(known)
    caption += ", with a band of ±2σ (σ claimed by the filter)" * claimed
    caption += ", and smoothed estimate (green)" * (smoothed is not None)
    caption += "; below, absolute error of the estimate relative to the largest true value" * bool(known)
    caption += ", with the σ claimed by the filter (dotted)" * (bool(known) and claimed)
    text = "; ".join(f"{label or name}: {_ending(history)}" for label, history in lines)
    return Drawing(key, title, f"{caption}.", f"Line chart of the estimates of {name}. {text}.", svg(canvas))


@styled()
def ratio_figure(key: str, title: str, lines: Sequence[tuple[str, BenchUnknown]]) -> Drawing:
    """Load on this bench and its ratio to the load on the measured bench, if the latter is large."""
    name = lines[0][1].name
    factor, unit = shown_unit(*(unknown for _, unknown in lines))
    labels = [line_label(label, len(lines)) for label, _ in lines]
    canvas, axes, below = figure(4.6 + legend_height(labels), (1.0, 1.0))
    text = []
    for place, (label, (run, unknown)) in enumerate(zip(labels, lines, strict=True)):
        measured, style = unknown.unscaled, line_style(place)
        assert measured is not None
        large = np.abs(measured) > LARGE * largest(measured)
        large[0] = False  # the starting value
        quotient = np.full(len(measured), np.nan)
        quotient[large] = unknown.mean[large] / measured[large]
        line(axes, unknown.time, unknown.mean / factor, **style, label=label)
        line(below, unknown.time, quotient, **style)
        if (known := quotient[np.isfinite(quotient)]).size:
            text.append(f"{run or name} {number(float(known.min()), 4)} to {number(float(known.max()), 4)}")
    axes.set_ylabel(f"{short(name, 24)} [{short(unit)}]")
    plain_axis(axes)
    plain_axis(below)
    below.set_ylabel("load / load on\nthe measured bench [–]")
    time_axis(below)
    legend_of_lines(axes, labels)
    caption = (
        f"{name} on this bench. Below, ratio of {name} on this bench to {name} on the measured bench (the run in "
        f"estimate.measured.from). Range of the ratio while {name} on the measured bench "
        f"exceeds {number(LARGE)} times its maximum: {'; '.join(text) or 'not available'}."
    )
    return Drawing(key, title, caption, f"Line chart of a ratio of loads. {caption}", svg(canvas))


@styled()
def runs_figure(unknown: BenchUnknown) -> Drawing:
    """Relative errors of an unknown in all runs over seeds and starts, with bars of the claimed σ, on a logarithmic axis."""
    assert unknown.errors is not None
    scale = 1.0 if unknown.truth is None else largest(unknown.truth)
    errors = np.abs(unknown.errors) / scale
    canvas, axes = figure(3.0)
    at = np.arange(1, len(errors) + 1)
    if unknown.stds is not None:
        axes.bar(at, unknown.stds / scale, color=BLUE, alpha=0.22, lw=0, label="claimed σ")
    axes.plot(at, np.maximum(errors, ROUNDING), "o", color=BLUE, ms=5, label="error")
    axes.set_yscale("log")
    log_ticks(axes)
    axes.locator_params(axis="x", integer=True)
    axes.set_xlabel("filter run [–]")
    axes.set_ylabel("relative error [–]")
    legend_above(axes)
    finite = errors[np.isfinite(errors)]
    text = f"RMS {number(rms(errors), 2)}, largest {number(float(finite.max()), 2)}" if len(finite) else "not available"
    text += f"; {len(errors) - len(finite)} diverged" * (len(finite) < len(errors))
    what = "at the end of the run" if unknown.kind == "parameter" else "as RMS over the second half of the run"
    caption = (
        f"Error of {unknown.name} {what}, relative to the largest true value, in {len(errors)} filter runs: {text}."
    )
    return Drawing(
        f"runs-{unknown.name}",
        f"{unknown.name}: runs with other seeds and initial values",
        caption,
        caption,
        svg(canvas),
    )


def line(axes: Axes, time: FloatArray, values: FloatArray, **style: Any) -> None:
    """Plot a curve at its visible instants."""
    values = drawable(values)
    index = visible_instants(values[:, None], 240)
    axes.plot(time[index], values[index], **style)


def line_style(place: int) -> dict[str, Any]:
    """Colour, stroke and width of line number `place`; later lines are thinner to keep earlier ones visible."""
    width = max(1.0, 2.0 - 0.25 * (place % len(SERIES)))
    return {"color": SERIES[place % len(SERIES)], "ls": STROKES[place // len(SERIES) % len(STROKES)], "lw": width}


def line_label(label: str, many: int) -> str:
    """Legend entry of one of `many` lines."""
    return "estimate" if many == 1 else short(label, 26)


def legend_height(labels: Sequence[str]) -> float:
    """Additional height [inch] of a legend with long labels."""
    return 0.17 * len(labels) if max(map(len, labels), default=0) > 20 else 0.0


def _truths(axes: Axes, histories: Sequence[History], factor: float) -> None:
    """Plot each distinct true history once, with its finest sampling."""
    shown: list[tuple[FloatArray, FloatArray]] = []
    for history in sorted(histories, key=lambda history: -len(history.time)):
        time, truth = history.time, history.truth
        assert truth is not None
        if any(np.allclose(np.interp(time, t, u), truth, rtol=0, atol=SAME * largest(u)) for t, u in shown):
            continue
        label = None if shown else "true value"
        line(axes, time, truth / factor, color=INK, lw=1, ls=(0, (4, 2)), zorder=3, label=label)
        shown.append((time, truth))


def _errors(axes: Axes, histories: Sequence[tuple[int, History]], *, alone: bool) -> None:
    for place, history in histories:
        assert history.truth is not None
        scale = largest(history.truth) or 1.0
        _error(axes, history, history.mean, **line_style(place) | ({"lw": 1.1} if alone else {}))
        if alone and history.smoothed is not None:
            _error(axes, history, history.smoothed, color=GREEN, lw=1.0)
        if alone:
            std = np.where(drawable(history.std) > 0, drawable(history.std) / scale, np.nan)
            line(axes, history.time, std, color=MUTED, lw=1.2, ls=(0, (1, 1.5)))
    axes.set_yscale("log")
    log_ticks(axes)
    axes.set_ylabel("|error| relative\nto largest true value")


def _error(axes: Axes, history: History, values: FloatArray, **style: Any) -> None:
    """Plot the absolute error relative to the largest true value, without rounding errors."""
    assert history.truth is not None
    error = np.abs(drawable(values - history.truth)) / (largest(history.truth) or 1.0)
    error = np.where(error > ROUNDING, error, np.nan)
    index = visible_instants(np.log(error)[:, None], 240)
    axes.plot(history.time[index], error[index], **style)


def _ending(history: History) -> str:
    if history.truth is None:
        return f"last value {number(float(history.mean[-1]), 4)} {history.unit}"
    scale = largest(history.truth) or 1.0
    return (
        f"error at the end of the run is {number(abs(float(history.mean[-1] - history.truth[-1])) / scale, 2)} "
        "times the largest true value"
    )


PANELS = 8
"""Most components of a sensor in one figure."""
NONE = 1e-20
"""Violation of constraints that counts as zero, a millionth of rounding, because of logarithmic axes."""
SILENT = 1e-12
"""Share of the largest component of a simulated sensor below which a component is shown as zero, to hide rounding errors."""


@styled()
def sensor_figure(key: str, title: str, component: int, lines: Sequence[tuple[str, BenchSensor]]) -> Drawing:
    """Measured and estimated component of a sensor; below, the difference."""
    first = lines[0][1]
    columns = [(label, sensor, drawable(sensor.measured[:, component])) for label, sensor in lines]
    factor, unit = sensor_unit(largest(*(values for *_, values in columns)), first.units[component])
    labels = [line_label(label, len(lines)) for label, _ in lines]
    canvas, axes, below = figure(4.4 + legend_height(labels), (1.5, 1.0))
    shown: list[FloatArray] = []
    for place, (label, (_, sensor, values)) in enumerate(zip(labels, columns, strict=True)):
        index = visible_instants(values[:, None], 240)
        if not any(np.array_equal(values, other, equal_nan=True) for other in shown):
            dots(axes, sensor.time[index], values[index] / factor, "" if shown else "measured")
            shown.append(values)
        if sensor.expected is None:
            continue
        expected, style = sensor.expected[:, component], line_style(place)
        line(axes, sensor.time, expected / factor, **style, label=label)
        line(below, sensor.time, (values - expected) / factor, **{**style, "lw": 0.7 * style["lw"]})
    plain_axis(axes)
    axes.set_ylabel(f"{short(first.components[component], 20)} [{short(unit)}]")
    below.set_ylabel(f"measured −\nestimated [{short(unit)}]")
    time_axis(below)
    legend_of_lines(axes, labels)
    what = f"{first.name}, {first.components[component]}"
    caption = f"{what}: measured and estimated reading; below, measured − estimated{_unused(first)}."
    estimated = [(label, sensor) for label, sensor in lines if sensor.expected is not None]
    parts = ", ".join(f"{label or first.name} {ratio(mismatch(sensor, component))}" for label, sensor in estimated)
    alt = f"Line chart of {what}, measured and estimated; RMS of the difference divided by RMS of the measured reading: {parts}."
    return Drawing(key, title, caption, alt, svg(canvas))


def _unused(sensor: BenchSensor) -> str:
    return "" if sensor.used else "; the filter does not use this sensor"


@styled()
def components_figure(key: str, title: str, sensor: BenchSensor) -> Drawing:
    """Measured and estimated components of one sensor in panels, at most the eight largest."""
    size = np.nanmax(np.abs(drawable(sensor.measured)), axis=0, initial=0.0)
    indices = sorted(np.argsort(-size, kind="stable")[:PANELS].tolist())
    canvas, *panels = figure(1.0 + 0.95 * len(indices), (1.0,) * len(indices))
    for axes, i in zip(panels, indices, strict=True):
        measured = drawable(sensor.measured[:, i])
        if sensor.expected is None and size[i] <= SILENT * size.max():
            measured = np.zeros_like(measured)
        factor, unit = sensor_unit(largest(measured), sensor.units[i])
        if sensor.expected is None:
            line(axes, sensor.time, measured / factor, color=BLUE)
        else:
            index = visible_instants(measured[:, None], 240)
            dots(axes, sensor.time[index], measured[index] / factor, "measured" * (i == indices[0]))
            label = "estimated" if i == indices[0] else None
            line(axes, sensor.time, sensor.expected[:, i] / factor, color=BLUE, label=label)
        plain_axis(axes)
        axes.locator_params(axis="y", nbins=3)
        axes.set_ylabel(f"{short(sensor.components[i], 9)}\n[{short(unit)}]")
    time_axis(panels[-1])
    many = (
        ""
        if len(indices) == len(sensor.components)
        else f" (the {len(indices)} largest of {len(sensor.components)} readings)"
    )
    caption = f"Components of {sensor.name}{many} over time"
    if sensor.expected is not None:
        legend_above(panels[0])
        text = ", ".join(f"{sensor.components[i]} {ratio(mismatch(sensor, i))}" for i in indices)
        caption += f"; RMS of the residual (measured − estimated) divided by RMS of the measured reading: {text}"
    alt = f"Line charts of {len(indices)} components of {sensor.name} over time."
    return Drawing(key, title, f"{caption}{_unused(sensor)}.", alt, svg(canvas))


@styled()
def consistency_figure(estimate: BenchEstimated, expected: float | None) -> Drawing:
    """NIS divided by the number of channels, and violation of the constraints after every correction; expected: NIS, if known."""
    canvas, axes, below = figure(4.2, (1.4, 1.0))
    index, known = visible_instants(estimate.nis[:, None], 240), np.isfinite(estimate.nis)
    dots(axes, estimate.time[1:][index], estimate.nis[index], "NIS / channels")
    mean = float(np.mean(estimate.nis[known])) if known.any() else np.nan
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
    below.set_ylabel("constraint\nviolation")
    time_axis(below)
    legend_above(axes)
    worst = number(float(np.nanmax(estimate.violation, initial=0.0)), 2)
    words = "" if expected is None else f", expected {number(expected, 3)}"
    caption = (
        f"Above, normalised innovation squared divided by the number of channels: mean {number(mean, 3)}{words}. Below, "
        "violation of the joint constraints after every measurement update, relative to the mass-weighted norm of the "
        f"coordinates: at most {worst}."
    )
    return Drawing("consistency", "Consistency of the innovations", caption, caption, svg(canvas))


def mismatch(sensor: BenchSensor, component: int) -> float:
    """RMS of measured − estimated divided by RMS of measured; NaN without measurements."""
    if sensor.expected is None:
        return float("nan")
    off = sensor.measured[:, component] - sensor.expected[:, component]
    size = float(np.sqrt(np.mean(sensor.measured[:, component] ** 2)))
    return float(np.sqrt(np.mean(off**2))) / size if size > 0 else float("nan")


def sensor_unit(size: float, unit: str) -> tuple[float, str]:
    """Factor and unit for readings of this size; angles are treated like displacements."""
    if unit == "rad":
        factor, shown = reading_unit(size, "m")
        return factor, f"{shown.removesuffix('m')}rad"
    return reading_unit(size, unit)
