"""What the other channels predict of one that the filter was not given: the proof that needs no model of the error."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

import numpy as np

from strainsight.report.chart.drawing import INK, Drawing, figure, gauge_colour, styled, svg, visible_instants
from strainsight.report.chart.panels import about, dots, drawable, legend_above, plain_axis, time_axis
from strainsight.report.page.markup import figures as cards_of
from strainsight.report.page.markup import plain, share, table
from strainsight.report.tested.data import HoldOut
from strainsight.report.tested.parts import Parts, chosen
from strainsight.report.tested.readings import largest, overlay, reading, rms
from strainsight.report.text import READINGS, number, percent, reading_unit, short

INSIDE = 2.0
"""Half the width of the band [σ]."""
LEAD = "Every channel as the others predict it: the filter was not given what it is compared with."


def inside(own: HoldOut) -> float:
    """Share of the samples within ±2σ of what they were predicted, noise of the sample in σ; NaN without σ."""
    ratio = np.abs(own.measured - own.predicted) / own.std
    there = ratio[np.isfinite(ratio)]
    return float(np.mean(there <= INSIDE)) if len(there) else float("nan")


def hold_out_figures(held: Sequence[HoldOut]) -> list[Drawing]:
    """Of every channel a cross-plot and an overlay in time."""
    return [drawing for own in held for drawing in (_cross(own), _overlay(own))]


def _cross(own: HoldOut) -> Drawing:
    """Measured over predicted, with the line where both are the same."""
    factor, unit = reading_unit(largest(own.measured, own.predicted), own.unit)
    measured, predicted = drawable(own.measured) / factor, drawable(own.predicted) / factor
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


def _overlay(own: HoldOut) -> Drawing:
    """Measured and predicted in time, about the largest reading."""
    factor, unit = reading_unit(largest(own.measured, own.predicted), own.unit)
    measured, predicted, std = (drawable(values) / factor for values in (own.measured, own.predicted, own.std))
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


def _error(own: HoldOut) -> str:
    size = rms(own.measured)
    return percent(rms(own.measured - own.predicted) / size) if size > 0 else "–"


def hold_out_section(parts: Parts) -> str:
    """Of the page of a test."""
    return held_out(parts.report.hold_out, chosen(parts, "hold-out-"))


def held_out(held: Sequence[HoldOut], cards: Iterable[str]) -> str:
    """The table and the figures; nothing where no channel was left out."""
    if not held:
        return ""
    rows = []
    for own in held:
        error, size = rms(own.measured - own.predicted), rms(own.measured)
        sigma = rms((own.measured - own.predicted) / own.std)
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
    return f'<h2>Hold-out</h2><p class="lead">{LEAD}{said}</p><div class="card">{text}</div>{cards_of(cards)}'
