"""Figures of a bench in time as it was simulated, and of gauges that were placed on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.pages.arrays import FloatArray
from strainsight.pages.bench.data import BenchMotion, BenchStress
from strainsight.pages.bench.figures import line_style
from strainsight.pages.chart.drawing import BLUE, MUTED, VERMILION, Drawing, figure, styled, svg, visible_instants
from strainsight.pages.chart.panels import drawable, legend_above, plain_axis, plain_ticks, time_axis
from strainsight.pages.text import number, percent, prefix, quantity, short
from strainsight.records.bench import BenchPlaced, DriveMotion, RingMotion


def loads_figure(motion: BenchMotion) -> Drawing:
    """Forces above, moments below, as they act on the bench."""
    largest = {name: float(np.max(np.abs(values), initial=0.0)) for name, (_, values) in motion.inputs.items()}
    panels, listed = [], []
    for unit in dict.fromkeys(unit for unit, _ in motion.inputs.values()):
        loads = {name: values for name, (own, values) in motion.inputs.items() if own == unit}
        shown_unit = unit.replace("N m", "N·m")
        factor, shown = prefix(max(largest[name] for name in loads), shown_unit)
        panels.append(
            (f"load [{short(shown)}]", np.column_stack(list(loads.values())) / factor, tuple(map(short, loads)))
        )
        listed += [f"{name} at most {quantity(largest[name], shown_unit, 3)}" for name in loads]
    return _stacked("loads", "Loads", motion.time, panels, f"Loads on the bench in time: {'; '.join(listed)}.", 1.8)


def bearing_figures(time: FloatArray, name: str, ring: RingMotion) -> list[Drawing]:
    """Displacements and tilts of the inner ring; loads and highest contact pressure."""
    moved = _stacked(
        f"bearing-{name}-displacement",
        f"{name}: displacement of the inner ring",
        time,
        (
            ("displacement [µm]", 1e6 * ring.displacement[:, :3], ("x", "y", "z")),
            ("tilt [µrad]", 1e6 * ring.displacement[:, 3:], ("y", "z")),
        ),
        f"Displacement of the inner ring of {name} in the axes of the outer one; x is the axis.",
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
    """Where a driven joint is, and the force or torque that it takes; turns: whether its motion is an angle."""
    largest = float(np.max(np.abs(drive.force), initial=0.0))
    factor, unit = prefix(largest, "N·m" if turns else "N")
    place = ("angle [°]", np.rad2deg(drive.position)) if turns else ("position [m]", drive.position)
    what = "torque" if turns else "force"
    return _stacked(
        f"drive-{name}",
        f"{name}: motion and {what} of the drive",
        time,
        ((place[0], place[1][:, None], (name,)), (f"{what} [{unit}]", drive.force[:, None] / factor, (what,))),
        f"Motion that {name} follows, and the {what} that it takes, at most {number(largest / factor, 3)} {unit}.",
    )


def stress_figure(stress: BenchStress) -> Drawing:
    """The largest von Mises stress of every picture in time, beside the allowable where one is stated."""
    largest = stress.largest / 1e6
    with styled():
        drawn, axes = figure(2.4)
        axes.plot(stress.time, largest, **line_style(0), label="largest")
        if stress.allowable is not None:
            axes.axhline(stress.allowable / 1e6, color=VERMILION, ls="--", lw=1.4, label="allowable")
        axes.set_ylim(bottom=0.0)
        plain_axis(axes)
        axes.set_ylabel("von Mises stress [MPa]")
        legend_above(axes)
        time_axis(axes)
        image = svg(drawn)
    caption = f"Largest von Mises stress anywhere on {stress.body}, at {len(stress.time)} instants: {stress_in_words(stress)}."
    return Drawing("stress", f"{stress.body}: stress in time", caption, f"Line chart: {caption}", image)


def stress_in_words(stress: BenchStress) -> str:
    """The largest stress, where it is, and how much of the allowable."""
    text = f"at most {quantity(float(np.max(stress.largest)), 'Pa')}, in element {stress.element}"
    if stress.allowable is None or stress.share is None:
        return f"{text}; no allowable is stated"
    return f"{text}, {percent(stress.share)} of the allowable {quantity(stress.allowable, 'Pa')}"


def random_figure(placed: BenchPlaced) -> Drawing:
    """Expected standard deviation of every load with the layout and with random ones, over the layout's."""
    expected = placed.placed.std
    known = np.flatnonzero(expected > 0)
    names = [placed.inputs[i] for i in known]
    with styled():
        drawn, axes = figure(1.3 + 0.4 * len(names))
        for y, i in enumerate(known):
            others = placed.random_std[:, i] / expected[i]
            others = others[np.isfinite(others)]
            axes.plot(
                others, np.full(len(others), y), "|", color=MUTED, ms=10, mew=1.4, label=None if y else "random layouts"
            )
            axes.plot(1.0, y, "o", color=BLUE, ms=7, label=None if y else "placed")
        axes.set_xscale("log")
        plain_ticks(axes, "x")
        axes.set_yticks(range(len(names)), [short(name, 16) for name in names])
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("expected σ over that of the placed layout [–]")
        legend_above(axes)
        image = svg(drawn)
    caption = (
        "Expected standard deviation of every load with as many gauges drawn at random, over that of the placed layout."
    )
    return Drawing("random", "Placed against random layouts", caption, caption, image)


def _stacked(
    key: str,
    title: str,
    time: FloatArray,
    panels: Sequence[tuple[str, FloatArray, tuple[str, ...]]],
    caption: str,
    height: float = 1.5,
) -> Drawing:
    """Panels one above the other, each with its label, the columns of an array and their names; height of one [inch]."""
    with styled():
        drawn, *all_axes = figure(1.3 + height * len(panels), (1.0,) * len(panels))
        for axes, (label, columns, names) in zip(all_axes, panels, strict=True):
            index = visible_instants(columns, 240)
            for place, (column, name) in enumerate(zip(columns.T, names, strict=True)):
                axes.plot(time[index], drawable(column)[index], **line_style(place), label=name)
            plain_axis(axes)
            axes.set_ylabel(label)
            legend_above(axes)
        time_axis(all_axes[-1])
        image = svg(drawn)
    parts = ", ".join(
        f"{label} up to {number(float(np.nanmax(np.abs(values), initial=0.0)), 3)}" for label, values, _ in panels
    )
    return Drawing(key, title, caption, f"Line charts: {parts}.", image)
