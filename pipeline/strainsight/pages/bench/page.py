"""Page of one bench run: estimates and their errors, motion of the bench, model and provenance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from strainsight.pages.arrays import FloatArray
from strainsight.pages.bench.bearing_page import balls_figure, pressure_figure
from strainsight.pages.bench.data import BenchPageRun, BenchStress, PlacedGauges
from strainsight.pages.bench.figures import (
    components_figure,
    consistency_figure,
    line,
    line_style,
    ratio_figure,
    runs_figure,
    unknown_figure,
)
from strainsight.pages.bench.tables import bench_answer, mismatch_table, placement_table, runs_table, stress_words
from strainsight.pages.chart.drawing import BLUE, MUTED, VERMILION, Drawing, figure, styled, svg
from strainsight.pages.chart.panels import legend_above, plain_axis, plain_ticks, time_axis
from strainsight.pages.page.markup import bullets, figures, measure, picture, plain, table
from strainsight.pages.page.markup import figure as card
from strainsight.pages.page.problems import headline
from strainsight.pages.page.sections import advice_card, document, notes_card, panel, provenance_section, section
from strainsight.pages.placement.figures import trend_figure
from strainsight.pages.placement.gauge_table import criteria_meaning, criteria_table
from strainsight.pages.tested.figures import hold_out_figures, hold_out_section
from strainsight.records.bench import DriveMotion, RingMotion
from strainsight.records.bench_placed import BenchPlaced
from strainsight.runner.output import Scalar
from strainsight.text import number, percent, prefix, quantity, short


def loads_figure(time: FloatArray, every: Mapping[str, tuple[str, FloatArray]]) -> Drawing:
    """Forces (above) and moments (below) on the bench; every: name → (unit, history (T,))."""
    largest = {name: float(np.max(np.abs(values), initial=0.0)) for name, (_, values) in every.items()}
    panels, listed = [], []
    for unit in dict.fromkeys(unit for unit, _ in every.values()):
        loads = {name: values for name, (other, values) in every.items() if other == unit}
        shown_unit = unit.replace("N m", "N·m")
        factor, shown = prefix(max(largest[name] for name in loads), shown_unit)
        panels.append(
            (f"load [{short(shown)}]", np.column_stack(list(loads.values())) / factor, tuple(map(short, loads)))
        )
        listed += [f"{name} at most {quantity(largest[name], shown_unit, 3)}" for name in loads]
    return _stacked("loads", "Loads", time, panels, f"Loads on the bench over time: {'; '.join(listed)}.", 1.8)


def bearing_figures(time: FloatArray, name: str, ring: RingMotion) -> list[Drawing]:
    """Displacements and tilts of the inner ring, its loads, and the highest contact pressure."""
    moved = _stacked(
        f"bearing-{name}-displacement",
        f"{name}: displacement of the inner ring",
        time,
        (
            ("displacement [µm]", 1e6 * ring.displacement[:, :3], ("x", "y", "z")),
            ("tilt [µrad]", 1e6 * ring.displacement[:, 3:], ("y", "z")),
        ),
        f"Displacement of the inner ring of {name} in the axes of the outer ring; x is the bearing axis.",
    )
    pressed = _stacked(
        f"bearing-{name}-load",
        f"{name}: load on the inner ring",
        time,
        (
            ("force [kN]", ring.load[:, :3] / 1e3, ("x", "y", "z")),
            ("moment [kN·m]", ring.load[:, 3:] / 1e3, ("y", "z")),
            ("pressure [MPa]", ring.pressure[:, None] / 1e6, ("highest",)),
        ),
        f"Load on the inner ring of {name} and the highest contact pressure of all balls, at most "
        f"{number(float(np.max(ring.pressure, initial=0.0)) / 1e6, 4)} MPa.",
    )
    return [moved, pressed]


def drive_figure(time: FloatArray, name: str, turns: bool, drive: DriveMotion) -> Drawing:
    """Position of a driven joint and its drive force or torque; turns: whether its motion is an angle."""
    largest = float(np.max(np.abs(drive.force), initial=0.0))
    factor, unit = prefix(largest, "N·m" if turns else "N")
    place = ("angle [°]", np.rad2deg(drive.position)) if turns else ("position [m]", drive.position)
    what = "torque" if turns else "force"
    return _stacked(
        f"drive-{name}",
        f"{name}: motion and {what} of the drive",
        time,
        ((place[0], place[1][:, None], (name,)), (f"{what} [{unit}]", drive.force[:, None] / factor, (what,))),
        f"Prescribed motion of {name} and the required {what}, at most {number(largest / factor, 3)} {unit}.",
    )


@styled()
def stress_figure(stress: BenchStress) -> Drawing:
    """Largest von Mises stress over time, with the allowable if configured."""
    largest = stress.largest / 1e6
    canvas, axes = figure(2.4)
    axes.plot(stress.time, largest, **line_style(0), label="largest")
    if stress.allowable is not None:
        axes.axhline(stress.allowable / 1e6, color=VERMILION, ls="--", lw=1.4, label="allowable")
    axes.set_ylim(bottom=0.0)
    plain_axis(axes)
    axes.set_ylabel("von Mises stress [MPa]")
    legend_above(axes)
    time_axis(axes)
    words = stress_words(stress, quantity, percent, f", in element {stress.element}")
    words += "; no allowable stress is configured" * (stress.allowable is None)
    caption = f"Largest von Mises stress on {stress.body} at {len(stress.time)} instants: {words}."
    return Drawing(
        "stress", f"{stress.body}: largest von Mises stress over time", caption, f"Line chart: {caption}", svg(canvas)
    )


@styled()
def random_figure(placed: BenchPlaced) -> Drawing:
    """Expected standard deviation of every load with random layouts, relative to that of the layout."""
    expected = placed.placed.std
    known = np.flatnonzero(expected > 0)
    names = [placed.inputs[i] for i in known]
    canvas, axes = figure(1.3 + 0.4 * len(names))
    for y, i in enumerate(known):
        others = placed.random_std[:, i] / expected[i]
        others = others[np.isfinite(others)]
        axes.plot(
            others, np.full(len(others), y), "|", color=MUTED, ms=10, mew=1.4, label=None if y else "random layouts"
        )
        axes.plot(1.0, y, "o", color=BLUE, ms=7, label=None if y else "chosen layout")
    axes.set_xscale("log")
    plain_ticks(axes, "x")
    axes.set_yticks(range(len(names)), [short(name, 16) for name in names])
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("expected σ relative to that of the chosen layout [–]")
    legend_above(axes)
    caption = (
        "Expected σ of every load with random layouts (same number of gauges), divided by that of the chosen layout."
    )
    return Drawing("random", "Comparison with random layouts", caption, caption, svg(canvas))


@styled()
def _stacked(
    key: str,
    title: str,
    time: FloatArray,
    panels: Sequence[tuple[str, FloatArray, tuple[str, ...]]],
    caption: str,
    height: float = 1.5,
) -> Drawing:
    """Panels from top to bottom, each with label, columns of an array and their names; height of one [inch]."""
    canvas, *all_axes = figure(1.3 + height * len(panels), (1.0,) * len(panels))
    for axes, (label, columns, names) in zip(all_axes, panels, strict=True):
        for place, (column, name) in enumerate(zip(columns.T, names, strict=True)):
            line(axes, time, column, **line_style(place), label=name)
        plain_axis(axes)
        axes.set_ylabel(label)
        legend_above(axes)
    time_axis(all_axes[-1])
    parts = ", ".join(
        f"{label} up to {number(float(np.nanmax(np.abs(values), initial=0.0)), 3)}" for label, values, _ in panels
    )
    return Drawing(key, title, caption, f"Line charts: {parts}.", svg(canvas))


STYLE = "bench/bench.css"
FOOTER = (
    "σ is one standard deviation. Errors and claimed σ of a load are relative to the largest true value of the load, errors and "
    "claimed σ of a parameter to its true value. Claimed σ: computed by the filter. The contacts in bearings "
    "are quasi-static and Hertzian; the rings are rigid."
)


def bench_figures(run: BenchPageRun) -> dict[str, tuple[Drawing, ...]]:
    """Section → its figures: "unknowns", "sensors", "hold-out", "placement", "motion"."""
    shown: dict[str, tuple[Drawing, ...]] = {}
    kinds = {"input": "load", "parameter": "parameter"}
    if (estimate := run.estimated) is not None:
        every = list(enumerate(run.unknowns))
        shown["unknowns"] = (
            *(unknown_figure(f"unknown-{i}", f"{one.name}, {kinds[one.kind]}", [("", one)]) for i, one in every),
            *(
                ratio_figure(f"ratio-{i}", f"{one.name}: ratio to the load on the measured bench", [("", one)])
                for i, one in every
                if one.unscaled is not None
            ),
            *(
                drawing
                for name, ring in estimate.bearings.items()
                for drawing in (balls_figure(name, ring.worst), pressure_figure(name, ring))
            ),
            *(runs_figure(one) for _, one in every if one.errors is not None),
        )
        shown["sensors"] = (
            *(
                components_figure(f"sensor-{i}", f"{sensor.name}: measured and estimated readings", sensor)
                for i, sensor in enumerate(run.sensors)
            ),
            consistency_figure(estimate, run.number("expected_nis")),
        )
        shown["hold-out"] = tuple(hold_out_figures(run.hold_out))
    if (placement := run.placement) is not None:
        random = [random_figure(placement.placed)] if placement.placed.random_std.size else []
        shown["placement"] = (trend_figure(placement.trend), *random)
    if (motion := run.simulated) is not None:
        estimated = {sensor.name for sensor in run.sensors}
        shown["motion"] = (
            *([loads_figure(motion.time, run.loads)] if run.loads else []),
            *([stress_figure(run.stress)] if run.stress is not None else []),
            *(drive_figure(motion.time, name, name in run.turning, drive) for name, drive in motion.drives.items()),
            *(
                drawing
                for name, ring in motion.bearings.items()
                for drawing in bearing_figures(motion.time, name, ring)
            ),
            *(
                components_figure(f"motion-{i}", f"{sensor.name}: reading", sensor)
                for i, sensor in enumerate(run.readings)
                if sensor.name not in estimated
            ),
        )
    return shown


def bench_page(
    run: BenchPageRun,
    drawings: dict[str, tuple[Drawing, ...]],
    provenance: Mapping[str, str],
    pictures: Sequence[tuple[str, bytes]] = (),
    turned: str = "",
) -> str:
    """Self-contained HTML page; drawings: from `bench_figures`; pictures: caption, PNG; turned: `space_section` or empty."""
    keys = [entry.key for entries in drawings.values() for entry in entries]

    def each(key: str) -> list[str]:
        return [card(entry, keys.index(entry.key)) for entry in drawings.get(key, ())]

    sections = [notes_card("Warnings", bullets(run.warnings), kind="warnings")]
    if run.is_estimated:
        listed = runs_table("unknowns", [(escape(run.name), run)])
        sections.append(f'<section id="answer" aria-label="answer" class="card">{listed}</section>')
        sections.append(figures(each("unknowns"), "<h2>Estimates</h2>"))
        sections.append(
            section("Consistency of the estimate with the readings", mismatch_table(run)) + figures(each("sensors"))
        )
        sections.append(hold_out_section(run.hold_out, each("hold-out")))
    if pictures:
        head = "Gauges and stress on the body" if run.stress is not None else "Gauges on the body"
        sections.append(f"<h2>{head}</h2>" + "".join(_picture(*entry) for entry in pictures))
    sections.append(turned)
    if run.placement is not None:
        placed = _placed(run.placement, run.numbers.get("place", {}))
        sections.append(f"<h2>Gauge positions</h2>{placed}{figures(each('placement'))}")
    if run.simulated is not None:
        lead = '<p class="lead">Simulation with the configured loads.</p>'
        sections.append(f"<h2>Motion of the bench</h2>{lead}{figures(each('motion'))}")
    sections.append(provenance_section({}, provenance, panel("Numbers", table("numbers", (), _facts(run)))))
    faults = [(unknown.name, run.faults(unknown.name)) for unknown in run.unknowns]
    if run.stress is not None and run.stress.too_high:
        faults.append(("von Mises stress", ("above the allowable stress",)))
    title = headline(faults) + run.name
    return document("bench", run.name, title, bench_answer(run), sections, FOOTER, STYLE, turned=bool(turned))


def _placed(placement: PlacedGauges, numbers: Mapping[str, Scalar]) -> str:
    """Layout, advice, and comparison with other rules; numbers: summary of place."""
    text = f'<div class="card">{placement_table(placement, numbers)}</div>'
    text += advice_card(placement.placed.advice, "h3")
    if not placement.criteria:
        return text
    rules = criteria_table(placement.trend, placement.metrics, placement.criteria, placement.units)
    return f'{text}<div class="card">{criteria_meaning(placement.metrics)}{rules}</div>'


def _picture(caption: str, png: bytes) -> str:
    shown = picture(png, caption, 1400, 900)
    return f'<figure class="card picture">{shown}<figcaption>{escape(caption)}</figcaption></figure>'


NAMES = {
    "coordinates": ("number of generalised coordinates", ""),
    "constraints": ("number of constraints", ""),
    "steps": ("number of time steps", ""),
    "violation": ("largest violation of a constraint (SI units)", ""),
    "violation_rate": ("largest time derivative of a constraint residual (SI units)", ""),
    "first_frequency": ("first natural frequency of the bench", "Hz"),
    "band": ("highest load frequency resolved by the time step", "Hz"),
    "turn": ("largest rotation of a body in a time step", "rad"),
}
"""Key of a simulation number → its name and unit."""
OF_ESTIMATE = {
    "method": "measurement update of the filter",
    "truth": "simulated test",
    "channels": "number of channels",
    "unknowns": "number of unknown loads and parameters",
    "violation": "largest violation of a joint constraint after a measurement update, relative to the mass-weighted norm of "
    "the coordinates",
}


def _facts(run: BenchPageRun) -> list[tuple[str, str]]:
    simulated, placed = run.numbers.get("simulate", {}), run.numbers.get("place", {})
    rows = [(NAMES[key][0], measure(float(simulated[key]), NAMES[key][1])) for key in NAMES if key in simulated]
    for key, name in OF_ESTIMATE.items():
        if (value := run.summary.get(key)) is not None:
            rows.append((name, escape(value) if isinstance(value, str) else plain(float(value), 3)))
    rows += [
        (escape(f"placement: {key}"), plain(float(value), 4))
        for key, value in placed.items()
        if not isinstance(value, str | bool) and not key.startswith("std.")
    ]
    return rows
