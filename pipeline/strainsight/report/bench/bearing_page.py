"""The page of a bearing alone: what holds the inner ring where, and what every ball carries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import count

import numpy as np

from strainsight.report.arrays import FloatArray
from strainsight.report.chart.drawing import BLUE, GREEN, ORANGE, VERMILION, Drawing, figure, styled, svg
from strainsight.report.chart.panels import legend_above
from strainsight.report.page.document import document
from strainsight.report.page.markup import figure as card
from strainsight.report.page.markup import figures, measure, table
from strainsight.report.text import number

CONTACTS = ("inner left", "inner right", "outer left", "outer right")
COLOURS = (BLUE, VERMILION, GREEN, ORANGE)
DISPLACEMENTS = ("x", "y", "z", "tilt about y", "tilt about z")
DISPLACEMENT_UNITS = ("m", "m", "m", "rad", "rad")
ROUNDING = 1e-9
"""Share of the largest load below which a component is drawn as zero."""
LOAD_UNITS = ("N", "N", "N", "N m", "N m")
CASE_HEAD = ("", "load", "displacement", *(f"∂/∂{name}" for name in DISPLACEMENTS))
"""Of the table of a load case, on the page and in the terminal."""


@dataclass(frozen=True)
class BearingCase:
    """A bearing in equilibrium. bearing, case: names; load (5,) [N, N m], displacement (5,) [m, rad], stiffness (5, 5);
    station (z,) [rad]; force (z, 4) [N], angle (z, 4) [rad] and pressure (z, 4) [Pa] of every contact of every ball."""

    bearing: str
    case: str
    load: FloatArray
    displacement: FloatArray
    stiffness: FloatArray
    station: FloatArray
    force: FloatArray
    angle: FloatArray
    pressure: FloatArray


@dataclass(frozen=True)
class BearingCurve:
    """Load (p, 5) [N, N m] over one displacement (p,) [m or rad], number `along` of the five, the others held at zero."""

    bearing: str
    along: int
    displacement: FloatArray
    load: FloatArray


def bearing_page(
    name: str, facts: Mapping[str, str], cases: Sequence[BearingCase], curves: Sequence[BearingCurve]
) -> str:
    """The page as HTML text; facts: what the bearings are, by name."""
    drawings = [curve_figure(curve) for curve in curves]
    polar = [drawn for case in cases for drawn in ball_figures(case)]
    sections = [
        "<h2>Bearings</h2>"
        '<div class="card">'
        + table("bearings", ("bearing", "what it is"), [[escape(key), escape(text)] for key, text in facts.items()])
        + "</div>",
        _cases(cases),
        figures(map(card, polar, count()), "<h2>Loads of the balls</h2>"),
        figures(map(card, drawings, count(len(polar))), "<h2>Load over displacement</h2>"),
    ]
    worst = max(cases, key=lambda case: float(case.pressure.max()), default=None)
    answer = escape(
        f"The highest contact pressure is {number(float(worst.pressure.max()) / 1e6, 4)} MPa, in {worst.bearing} under "
        f"{worst.case}."
        if worst is not None
        else f"{len(curves)} load-displacement curves."
    )
    footer = (
        "Quasi-static contact after Hertz, rings rigid but for the contacts; the outer ring is held, x is the axis."
    )
    return document("bearing", name, name, answer, sections, footer)


def ball_figures(case: BearingCase) -> list[Drawing]:
    """Contact force, contact angle and pressure around the bearing, thesis figures 1.4 and 1.5."""
    loaded = np.where(case.force > 0, 1.0, np.nan)
    shown = (
        ("force", "contact force", case.force / 1e3, "kN"),
        ("angle", "contact angle", np.rad2deg(case.angle) * loaded, "°"),
        ("pressure", "contact pressure", case.pressure / 1e6, "MPa"),
    )
    return [_polar(case, *entry) for entry in shown]


def _polar(case: BearingCase, key: str, what: str, values: FloatArray, unit: str) -> Drawing:
    order = np.argsort(case.station)
    around = np.append(case.station[order], case.station[order][0] + 2 * np.pi)
    with styled():
        drawn, axes = figure(4.6)
        place = axes.get_subplotspec()
        axes.remove()
        axes = drawn.add_subplot(place, projection="polar")
        axes.patch.set_visible(False)
        for contact, colour in enumerate(COLOURS):
            column = np.append(values[order, contact], values[order[0], contact])
            if np.nanmax(np.abs(np.append(column, 0.0))) > 0:
                # the two contacts of one diagonal carry nearly the same: dashes leave the line below to be seen
                axes.plot(around, column, color=colour, ls="-" if contact < 2 else (0, (4, 3)), label=CONTACTS[contact])
        axes.set_title(f"{what} [{unit}]")
        handles, labels = axes.get_legend_handles_labels()
        if handles:
            drawn.legend(handles, labels, loc="outside lower center", ncols=2)
        image = svg(drawn)
    largest = np.nanmax(np.append(values, 0.0))
    z = len(case.station)
    caption = (
        f"{what.capitalize()} of the {z} balls of {case.bearing} under {case.case}, over the station of the ball: 0° is the y "
        f"axis, 90° the z axis. Largest: {number(float(largest), 4)} {unit}."
    )
    alt = f"Polar chart of the {what} of {z} balls, largest {number(float(largest), 4)} {unit}."
    return Drawing(f"{key}-{case.bearing}-{case.case}", f"{case.bearing}, {case.case}: {what}", caption, alt, image)


def curve_figure(curve: BearingCurve) -> Drawing:
    """Load along and across one displacement."""
    a = curve.along
    unit = "mm" if a < 3 else "mrad"
    load = np.where(np.abs(curve.load) > ROUNDING * np.abs(curve.load).max(), curve.load, 0.0)
    with styled():
        drawn, forces, moments = figure(4.6, (1.0, 1.0))
        for axes, which, what in ((forces, range(3), "force [kN]"), (moments, range(3, 5), "moment [kN m]")):
            for i in which:
                axes.plot(1e3 * curve.displacement, load[:, i] / 1e3, color=COLOURS[i % 3], label="xyzyz"[i])
            axes.set_ylabel(what)
            legend_above(axes)
        moments.locator_params(axis="x", nbins=5)
        moments.set_xlabel(f"{DISPLACEMENTS[a]} [{unit}]")
        image = svg(drawn)
    largest = float(np.abs(curve.load[:, a]).max())
    name = DISPLACEMENTS[a]
    caption = (
        f"Load on the inner ring of {curve.bearing} that holds it at a displacement {name}, the other four zero. "
        f"At most {number(largest, 4)} {LOAD_UNITS[a]} along it."
    )
    alt = f"Line chart of three forces and two moments over the displacement {name}."
    return Drawing(f"curve-{curve.bearing}-{a}", f"{curve.bearing}: load over {name}", caption, alt, image)


def cleared(values: FloatArray) -> FloatArray:
    """Numbers (5,), or a matrix (5, 5) beside its diagonal, without what is rounding."""
    if values.ndim == 2:
        scale = np.sqrt(np.abs(np.diag(values)))
        return np.where(np.abs(values) > ROUNDING * np.outer(scale, scale), values, 0.0)
    return np.where(np.abs(values) > ROUNDING * np.abs(values).max(), values, 0.0)


def case_rows(case: BearingCase) -> list[tuple[str, list[tuple[float, str, int]]]]:
    """Rows below CASE_HEAD: the displacement, and its cells as value, unit and significant digits."""
    load, q, stiffness = cleared(case.load), cleared(case.displacement), cleared(case.stiffness)
    return [
        (
            DISPLACEMENTS[i],
            [
                (float(load[i]), LOAD_UNITS[i], 6),
                (float(q[i]), DISPLACEMENT_UNITS[i], 6),
                *((float(value), "", 4) for value in stiffness[i]),
            ],
        )
        for i in range(len(DISPLACEMENTS))
    ]


def _cases(cases: Sequence[BearingCase]) -> str:
    text = ""
    for case in cases:
        rows = [[name, *(measure(*cell) for cell in cells)] for name, cells in case_rows(case)]
        title = f"{case.bearing} under {case.case}"
        caption = "Stiffness ∂F/∂q in N/m, N/rad, N m/m and N m/rad."
        words = table(title, ("along", *CASE_HEAD[1:]), rows, numeric=range(1, 8), caption=caption)
        text += f'<h2>{escape(title)}</h2><div class="card">{words}</div>'
    return text
