"""The figure of a parameter's posterior: what was known of it before the measurements, and after."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.report.arrays import FloatArray
from strainsight.report.chart.drawing import BLUE, INK, ORANGE, Drawing, figure, styled, svg
from strainsight.report.chart.panels import legend_above
from strainsight.report.text import prefix, quantity


@dataclass(frozen=True)
class Posterior:
    """What the measurements leave of a parameter: density and prior (k,) of its logarithm at value (k,) [unit], and the
    truth, where it is known."""

    name: str
    unit: str
    value: FloatArray
    density: FloatArray
    prior: FloatArray
    truth: float | None = None


def posterior_figure(own: Posterior) -> Drawing:
    """Density of a parameter before and after the measurements, and its true value where that is known."""
    factor, unit = prefix(float(own.value.max()), own.unit)
    value = own.value / factor
    with styled():
        drawn, axes = figure()
        axes.fill_between(value, own.density, color=BLUE, alpha=0.25, lw=0, label="after the measurements")
        axes.plot(value, own.density, color=BLUE, lw=1.6, label="_")
        axes.plot(value, own.prior, color=ORANGE, lw=1.4, label="before them")
        if own.truth is not None:
            axes.axvline(own.truth / factor, color=INK, ls=(0, (5, 3)), lw=1.2, label="truth")
        axes.set_xlabel(f"{own.name} [{unit}]")
        axes.set_ylabel(f"density of ln {own.name} [–]")
        axes.set_ylim(bottom=0)
        legend_above(axes, columns=3)
        image = svg(drawn)
    top = quantity(float(own.value[np.argmax(own.density)]), own.unit)
    caption = (
        f"What is known of {own.name} after the measurements of the test, beside what was known before: the narrower of the two "
        "curves, the more they say; one with several peaks allows several values."
    )
    alt = f"Density of {own.name} before and after the measurements, largest at {top}."
    return Drawing(f"posterior-{own.name}", f"{own.name}: what the measurements leave", caption, alt, image)
