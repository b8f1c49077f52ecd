"""Page of a bearing: equilibrium of the inner ring, and loads of the balls, also of an estimate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import count

import numpy as np

from strainsight.pages.arrays import FloatArray
from strainsight.pages.chart.drawing import BLUE, GREEN, ORANGE, VERMILION, Drawing, figure, styled, svg
from strainsight.pages.chart.panels import band, legend_above, plain_axis, time_axis
from strainsight.pages.page.markup import figure as card
from strainsight.pages.page.markup import figures, measure, table
from strainsight.pages.page.sections import document, section
from strainsight.records.bearing import BearingCase, BearingDisplaced
from strainsight.records.bench import BallsThen, RingEstimate
from strainsight.text import number, quantity

CONTACTS = ("inner left", "inner right", "outer left", "outer right")
COLOURS = (BLUE, VERMILION, GREEN, ORANGE)
DISPLACEMENTS = ("x", "y", "z", "tilt about y", "tilt about z")
DISPLACEMENT_UNITS = ("m", "m", "m", "rad", "rad")
ROUNDING = 1e-9
"""Share of the largest load below which a component is shown as zero."""
LOAD_UNITS = ("N", "N", "N", "N m", "N m")
INNER = 2
"""Contacts of the inner ring; those of the outer ring have the same forces except for inertia."""
BELIEF = (
    "Band and ±: 2σ of the estimate. σ includes the uncertainty of the estimated bearing parameters; "
    "all other bearing data are assumed exact."
)
CASE_HEAD = ("", "load", "displacement", *(f"∂/∂{name}" for name in DISPLACEMENTS))
"""Heading of the table of a load case, on the page and in the terminal."""


@dataclass(frozen=True)
class LoadedBearing:
    """Equilibrium of a bearing in a load case, both by name."""

    bearing: str
    case: str
    state: BearingCase

    @property
    def title(self) -> str:
        """Title of its tables."""
        return f"{self.bearing} under load case {self.case}"

    @property
    def pressure(self) -> float:
        """Highest contact pressure [Pa]."""
        return float(self.state.pressure.max())

    @property
    def loaded(self) -> int:
        """Number of loaded balls."""
        return int((self.state.force > 0).any(axis=1).sum())


def bearing_page(
    name: str, facts: Mapping[str, str], cases: Sequence[LoadedBearing], curves: Sequence[BearingDisplaced]
) -> str:
    """HTML page; facts: name of a bearing → description."""
    polar = [drawing for case in cases for drawing in ball_figures(case)]
    bearings = table("bearings", ("bearing", "description"), [list(map(escape, pair)) for pair in facts.items()])
    sections = [
        section("Bearings", bearings),
        *map(_case, cases),
        figures(map(card, polar, count()), "<h2>Loads of the balls</h2>"),
        figures(map(card, map(curve_figure, curves), count(len(polar))), "<h2>Load versus displacement</h2>"),
    ]
    answer = f"{len(curves)} load-displacement curve{'s' * (len(curves) != 1)}."
    if cases:
        worst = max(cases, key=lambda case: case.pressure)
        answer = f"The highest contact pressure is {number(worst.pressure / 1e6, 4)} MPa, in {worst.title}."
    footer = "The contacts are quasi-static and Hertzian; the rings are rigid. The outer ring is fixed; x is the bearing axis."
    return document("bearing", name, name, escape(answer), sections, footer)


def ball_figures(case: LoadedBearing) -> list[Drawing]:
    """Contact force, contact angle and pressure around the bearing, thesis figures 1.4 and 1.5."""
    loaded = np.where(case.state.force > 0, 1.0, np.nan)
    shown = (
        ("force", "contact force", case.state.force / 1e3, "kN"),
        ("angle", "contact angle", np.rad2deg(case.state.contact_angle) * loaded, "°"),
        ("pressure", "contact pressure", case.state.pressure / 1e6, "MPa"),
    )
    return [_polar(case, *entry) for entry in shown]


@styled()
def _polar(case: LoadedBearing, key: str, what: str, values: FloatArray, unit: str) -> Drawing:
    order = np.argsort(case.state.station)
    around = np.append(case.state.station[order], case.state.station[order][0] + 2 * np.pi)
    canvas, axes = figure(4.6)
    place = axes.get_subplotspec()
    axes.remove()
    axes = canvas.add_subplot(place, projection="polar")
    axes.patch.set_visible(False)
    for contact, colour in enumerate(COLOURS):
        column = np.append(values[order, contact], values[order[0], contact])
        if np.nanmax(np.abs(np.append(column, 0.0))) > 0:
            # the two contacts of one diagonal have nearly equal values: dashes keep the lower line visible
            axes.plot(around, column, color=colour, ls="-" if contact < 2 else (0, (4, 3)), label=CONTACTS[contact])
    axes.set_title(f"{what} [{unit}]")
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        canvas.legend(handles, labels, loc="outside lower center", ncols=2)
    largest = np.nanmax(np.append(values, 0.0))
    z = len(case.state.station)
    caption = (
        f"{what.capitalize()} of the {z} balls of {case.title} versus the angular position of the ball: 0° is the y "
        f"axis, 90° the z axis. Largest {what}: {number(float(largest), 4)} {unit}."
    )
    alt = f"Polar chart of the {what} of {z} balls, largest {number(float(largest), 4)} {unit}."
    return Drawing(
        f"{key}-{case.bearing}-{case.case}", f"{case.bearing}, {case.case}: {what}", caption, alt, svg(canvas)
    )


@styled()
def curve_figure(curve: BearingDisplaced) -> Drawing:
    """Load along and transverse to one displacement."""
    a = curve.along
    unit = "mm" if a < 3 else "mrad"
    load = _cleared(curve.curve.load, np.abs(curve.curve.load).max())
    canvas, forces, moments = figure(4.6, (1.0, 1.0))
    for axes, which, what in ((forces, range(3), "force [kN]"), (moments, range(3, 5), "moment [kN m]")):
        for i in which:
            axes.plot(1e3 * curve.curve.displacement, load[:, i] / 1e3, color=COLOURS[i % 3], label="xyzyz"[i])
        axes.set_ylabel(what)
        legend_above(axes)
    moments.locator_params(axis="x", nbins=5)
    moments.set_xlabel(f"{DISPLACEMENTS[a]} [{unit}]")
    largest = float(np.abs(curve.curve.load[:, a]).max())
    name = DISPLACEMENTS[a]
    caption = (
        f"Load on the inner ring of {curve.bearing} versus the displacement {name} of this ring; its other "
        f"displacements are zero. x is the bearing axis. Load component in the direction of the displacement: at most "
        f"{number(largest, 4)} {LOAD_UNITS[a]}."
    )
    alt = f"Line chart of three forces and two moments versus the displacement {name}."
    return Drawing(
        f"curve-{curve.bearing}-{a}", f"{curve.bearing}: load versus displacement {name}", caption, alt, svg(canvas)
    )


def _cleared(values: FloatArray, size: FloatArray | float) -> FloatArray:
    """Values, with rounding errors relative to this size set to zero."""
    return np.where(np.abs(values) > ROUNDING * size, values, 0.0)


def case_rows(case: LoadedBearing) -> list[tuple[str, list[tuple[float, str, int]]]]:
    """Rows below CASE_HEAD: displacement, and cells as value, unit and significant digits."""
    state, scale = case.state, np.sqrt(np.abs(np.diag(case.state.stiffness)))
    load, q = (_cleared(values, np.abs(values).max()).tolist() for values in (state.load, state.displacement))
    stiffness = _cleared(state.stiffness, np.outer(scale, scale)).tolist()
    columns = zip(DISPLACEMENTS, load, LOAD_UNITS, q, DISPLACEMENT_UNITS, stiffness, strict=True)
    return [
        (name, [(force, force_unit, 6), (moved, unit, 6), *((value, "", 4) for value in row)])
        for name, force, force_unit, moved, unit, row in columns
    ]


def _case(case: LoadedBearing) -> str:
    rows = [[name, *(measure(*cell) for cell in cells)] for name, cells in case_rows(case)]
    caption = "Columns ∂/∂…: stiffness (derivative of the load with respect to a displacement) in N/m, N/rad, N m/m or N m/rad."
    text = table(case.title, ("component", *CASE_HEAD[1:]), rows, numeric=range(1, 8), caption=caption)
    return section(escape(case.title), text)


@styled()
def balls_figure(name: str, then: BallsThen) -> Drawing:
    """Estimated ball forces at the instant of the highest pressure, ±2σ."""
    order = np.argsort(then.station)
    station = np.rad2deg(then.station[order])
    force, std = then.force[order] / 1e3, then.force_std[order] / 1e3
    canvas, axes = figure(2.6)
    for contact in range(INNER):
        axes.plot(station, force[:, contact], color=COLOURS[contact], label=CONTACTS[contact])
        band(axes, station, force[:, contact], std[:, contact], COLOURS[contact])
    axes.set_ylabel("force [kN]")
    axes.set_xlabel("ball position [°]")
    axes.set_ylim(bottom=0)
    plain_axis(axes)
    legend_above(axes)
    at = np.unravel_index(np.argmax(then.force), then.force.shape)
    caption = (
        f"Estimated force on each of the {len(then.station)} balls of {name} at {number(then.time, 4)} s, "
        f"the instant of the highest contact pressure: at most {_known(then.force[at], then.force_std[at], 'N')}"
    )
    title = f"{name}: ball forces"
    return Drawing(f"balls-{name}", title, caption, f"Line chart: {caption}", svg(canvas))


@styled()
def pressure_figure(name: str, ring: RingEstimate) -> Drawing:
    """Estimated highest contact pressure over time, ±2σ."""
    canvas, axes = figure(2.4)
    axes.plot(ring.instants, ring.pressure / 1e6, color=BLUE)
    band(axes, ring.instants, ring.pressure / 1e6, ring.pressure_std / 1e6, BLUE)
    axes.set_ylabel("contact pressure [MPa]")
    plain_axis(axes)
    time_axis(axes)
    at = int(np.argmax(ring.pressure))
    caption = (
        f"Estimated highest contact pressure of all balls in {name}: at most "
        f"{_known(ring.pressure[at], ring.pressure_std[at], 'Pa')}"
    )
    title = f"{name}: estimated highest contact pressure"
    return Drawing(f"pressure-{name}", title, caption, f"Line chart: {caption}", svg(canvas))


def _known(value: float, std: float, unit: str) -> str:
    """Value with 2σ and its assumption; without both if σ is withheld."""
    shown = quantity(float(value), unit, 4)
    return f"{shown}; σ is withheld." if np.isnan(std) else f"{shown} ± {quantity(2 * float(std), unit, 2)}. {BELIEF}"
