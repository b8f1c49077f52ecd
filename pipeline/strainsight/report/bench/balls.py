"""The figure of what the balls of a bearing carry by an estimate, with its σ."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from strainsight.report.arrays import FloatArray
from strainsight.report.bench.bearing_page import COLOURS, CONTACTS
from strainsight.report.bench.data import BearingEstimate
from strainsight.report.chart.drawing import BLUE, Drawing, figure, styled, svg
from strainsight.report.chart.panels import legend_above, plain_axis, time_axis
from strainsight.report.text import number, quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INNER = 2
"""The first contacts, of the two diagonals; the outer ones carry the same, but for what turning adds."""


BELIEF = "Bands are ±2σ; but for parameters that are sought, the bearing is taken to be as the config states it."


def balls_figures(bearing: BearingEstimate) -> tuple[Drawing, Drawing]:
    """Force of every ball at the instant of the highest pressure, and the highest pressure in time, ±2σ."""
    return _around(bearing), _in_time(bearing)


def _around(bearing: BearingEstimate) -> Drawing:
    order = np.argsort(bearing.station)
    station = np.rad2deg(bearing.station[order])
    force, std = bearing.force[order] / 1e3, bearing.force_std[order] / 1e3
    with styled():
        drawn, axes = figure(2.6)
        for contact in range(INNER):
            axes.plot(station, force[:, contact], color=COLOURS[contact], label=CONTACTS[contact])
            _band(axes, station, force[:, contact], std[:, contact], COLOURS[contact])
        axes.set_ylabel("force [kN]")
        axes.set_xlabel("station of the ball [°]")
        axes.set_ylim(bottom=0)
        plain_axis(axes)
        legend_above(axes)
        image = svg(drawn)
    at = np.unravel_index(np.argmax(bearing.force), bearing.force.shape)
    caption = (
        f"Force on each of the {len(bearing.station)} balls of {bearing.name} by the estimate at {number(bearing.worst, 4)} s, "
        f"when the pressure is highest: at most {_known(bearing.force[at], bearing.force_std[at], 'N')}"
    )
    title = f"{bearing.name}: what the balls carry"
    return Drawing(f"balls-{bearing.name}", title, caption, f"Line chart: {caption}", image)


def _in_time(bearing: BearingEstimate) -> Drawing:
    with styled():
        drawn, axes = figure(2.4)
        axes.plot(bearing.time, bearing.pressure / 1e6, color=BLUE)
        _band(axes, bearing.time, bearing.pressure / 1e6, bearing.pressure_std / 1e6, BLUE)
        axes.set_ylabel("highest pressure [MPa]")
        plain_axis(axes)
        time_axis(axes)
        image = svg(drawn)
    at = int(np.argmax(bearing.pressure))
    caption = (
        f"Highest contact pressure in {bearing.name} by the estimate, of all balls: at most "
        f"{_known(bearing.pressure[at], bearing.pressure_std[at], 'Pa')}"
    )
    title = f"{bearing.name}: highest pressure by the estimate"
    return Drawing(f"pressure-{bearing.name}", title, caption, f"Line chart: {caption}", image)


def _known(value: float, std: float, unit: str) -> str:
    """A value with its 2σ and what that takes for granted; without them where σ is withheld."""
    shown = quantity(float(value), unit, 4)
    return (
        f"{shown}; its σ is withheld." if np.isnan(std) else f"{shown} ± {quantity(2 * float(std), unit, 2)}. {BELIEF}"
    )


def _band(axes: Axes, x: FloatArray, mean: FloatArray, std: FloatArray, colour: str) -> None:
    axes.fill_between(x, mean - 2 * std, mean + 2 * std, color=colour, alpha=0.25, lw=0)
