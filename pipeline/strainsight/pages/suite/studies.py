"""The figures of a study: its numbers over the key that its runs vary; benches as lines beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from strainsight.pages.arrays import FloatArray, IntArray
from strainsight.pages.bench.data import BenchRun, BenchSensor
from strainsight.pages.bench.figures import line_style, ratio_figure, sensor_figure, unknown_figure
from strainsight.pages.chart.drawing import Drawing, figure, styled, svg
from strainsight.pages.chart.panels import legend_above, log_ticks
from strainsight.pages.suite.data import Study, Suite, SuiteRun
from strainsight.pages.text import number, short

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TOGETHER = 6
"""Most runs in one figure: as many as there are colours."""
WIDE = 3.0
"""Ratio of the largest to the smallest from which an axis is logarithmic."""


def study_figures(suite: Suite, study: Study) -> tuple[Drawing, ...]:
    """First what the study varies, then every unknown and every sensor of its benches."""
    place = suite.studies.index(study)
    runs = [suite.runs[i] for i in study.runs]
    drawings = []
    if study.over is not None:
        drawings += _sweeps(f"study-{place}", study, runs)
    for i, (about, part) in enumerate(_parts([run for run in runs if isinstance(run, BenchRun) and run.estimate])):
        drawings += _pair(f"study-{place}-{i}", about, part)
    return tuple(drawings)


def _parts(runs: Sequence[BenchRun]) -> list[tuple[str, Sequence[BenchRun]]]:
    """The runs in handfuls that one figure can hold: by group where there are too many, then in their order."""
    if len(runs) <= TOGETHER:
        return [("", runs)] * bool(runs)
    found: list[tuple[str, Sequence[BenchRun]]] = []
    for group in dict.fromkeys(run.group for run in runs):
        own = [run for run in runs if run.group == group]
        for start in range(0, len(own), TOGETHER):
            found.append((group, own[start : start + TOGETHER]))
    return found


def _pair(key: str, about: str, runs: Sequence[BenchRun]) -> list[Drawing]:
    """Estimates of every unknown, then every sensor as measured and as estimated."""
    drawings = []
    behind = f" ({about})" if about else ""
    kinds = {unknown.name: unknown.kind for run in runs for unknown in run.unknowns}
    for i, (name, kind) in enumerate(kinds.items()):
        own = [(run.label, unknown) for run in runs for unknown in run.unknowns if unknown.name == name]
        lines = [(label, unknown.history) for label, unknown in own]
        drawings.append(unknown_figure(f"{key}-unknown-{i}", f"{name}: estimate{behind}", kind, lines))
        elsewhere = [(label, unknown) for label, unknown in own if unknown.there is not None]
        if elsewhere:
            drawings.append(ratio_figure(f"{key}-ratio-{i}", f"{name}: ratio of the loads{behind}", elsewhere))
    names = dict.fromkeys(sensor.name for run in runs for sensor in run.sensors)
    for i, name in enumerate(names):
        shown = [
            (run.label, sensor)
            for run in runs
            for sensor in run.sensors
            if sensor.name == name and sensor.expected is not None
        ]
        if shown:
            title = f"{name}: measured against estimated{behind}"
            drawings.append(sensor_figure(f"{key}-sensor-{i}", title, _largest(shown[0][1]), shown))
    return drawings


def _largest(sensor: BenchSensor) -> int:
    """The component that moves most; a tilt counts as what it is at a metre."""
    finite = np.where(np.isfinite(sensor.measured), sensor.measured, 0.0)
    return int(np.argmax(np.ptp(finite, axis=0)))


def _sweeps(key: str, study: Study, runs: Sequence[SuiteRun]) -> list[Drawing]:
    """The numbers of the study over the key; the errors of its loads and of its parameters where it names none."""
    if study.numbers:
        return [_sweep(f"{key}-sweep", study, runs, [(name, None, name) for name in study.numbers])]
    kinds = {unknown.name: unknown.kind for run in runs for unknown in run.unknowns}
    drawings = []
    for kind, what in (("input", "loads"), ("parameter", "parameters")):
        wanted: list[tuple[str, str | None, str]] = [
            (f"error.{name}", f"std.{name}", f"error of {name}") for name, own in kinds.items() if own == kind
        ]
        wanted = [entry for entry in wanted if any(run.number(entry[0]) is not None for run in runs)]
        if wanted:
            drawings.append(_sweep(f"{key}-sweep-{kind}", study, runs, wanted, what))
    return drawings


def _sweep(
    key: str,
    study: Study,
    runs: Sequence[SuiteRun],
    wanted: Sequence[tuple[str, str | None, str]],
    what: str = "numbers",
) -> Drawing:
    """One panel a number over the varied key, one line a group; dotted: the claimed standard deviation."""
    groups = list(dict.fromkeys(run.group for run in runs))
    at = np.array([np.nan if run.at is None else run.at for run in runs])
    place, zero = _places(at)
    with styled():
        drawn, *panels = figure(1.2 + 1.5 * len(wanted) + 0.1 * len(groups), (1.0,) * len(wanted))
        for axes, (name, claimed, label) in zip(panels, wanted, strict=True):
            drawn_values: list[FloatArray] = []
            for g, group in enumerate(groups):
                own = np.array(
                    [i for i, run in enumerate(runs) if run.group == group and not np.isnan(at[i])], dtype=int
                )
                own = own[np.argsort(at[own], kind="stable")]
                values = _values(runs, own, name)
                style = line_style(g)
                axes.plot(place[own], values, marker="o", ms=4.5, **style, label=short(group, 30) if group else None)
                drawn_values.append(values)
                if claimed is not None:
                    axes.plot(place[own], _values(runs, own, claimed), color=style["color"], lw=1.1, ls=(0, (1, 1.5)))
            _scale(axes, np.concatenate(drawn_values))
            axes.set_ylabel(f"{short(label, 22)}\n[{'–' if claimed else 'SI'}]")
        _over(panels[-1], place, at, zero)
        panels[-1].set_xlabel(short(study.over or "", 48))
        if any(groups):
            legend_above(panels[0], 2)
        image = svg(drawn)
    caption = f"{what.capitalize()} over {study.over}, one line a group of runs."
    if any(claimed for _, claimed, _ in wanted):
        caption = f"Error of the {what} over {study.over}; dotted: the standard deviation that the filter claims."
    text = "; ".join(
        f"{label}: "
        + ", ".join(
            f"{number(x, 3)} {number(v, 2)}" for x, v in zip(at, _values(runs, np.arange(len(runs)), name), strict=True)
        )
        for name, _, label in wanted
    )
    return Drawing(
        key, f"{study.name}: {what} over {study.over}", caption, f"Line chart over {study.over}. {text}.", image
    )


def _values(runs: Sequence[SuiteRun], places: IntArray, name: str) -> FloatArray:
    found = [runs[int(i)].number(name) for i in places]
    return np.array([np.nan if value is None or not np.isfinite(value) else value for value in found], dtype=float)


def _places(at: FloatArray) -> tuple[FloatArray, float | None]:
    """Where the values stand on the axis: as they are, but 0 beside a logarithmic axis at a third of the smallest."""
    positive = at[at > 0]
    if not len(positive) or np.nanmin(at) < 0 or not (at == 0).any():
        return at, None
    zero = float(positive.min()) / 3
    return np.where(at == 0, zero, at), zero


def _over(axes: Axes, place: FloatArray, at: FloatArray, zero: float | None) -> None:
    """A logarithmic axis where the values span more than a factor of three, ticks at the values where these are few."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator

    finite = np.unique(place[np.isfinite(place)])
    if len(finite) and finite[0] > 0 and finite[-1] >= WIDE * finite[0]:
        axes.set_xscale("log")
    elif zero is None:
        return
    crowded = len(finite) > 1 and np.log(finite[1:] / finite[:-1]).min() < 0.08 * np.log(finite[-1] / finite[0])
    if len(finite) <= 7 and not crowded:
        axes.xaxis.set_major_locator(FixedLocator(finite.tolist()))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: "0" if value == zero else number(value, 3)))
        axes.xaxis.set_minor_formatter(NullFormatter())
    else:
        log_ticks(axes, "x")


def _scale(axes: Axes, values: FloatArray) -> None:
    from matplotlib.ticker import FuncFormatter

    values = values[np.isfinite(values)]
    if len(values) and values.min() > 0 and values.max() >= WIDE * values.min():
        axes.set_yscale("log")
        log_ticks(axes)
    else:
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: number(round(value, 15), 4)))
