"""report: one page about a run of a bench; everything on it is read from the artefacts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from strainsight import __version__
from strainsight.config.bench.bench import BenchConfig, SurfaceField
from strainsight.experiment.bench.reduction import flexible
from strainsight.experiment.layout.gauge_list import layout_labels
from strainsight.pages.arrays import History, Reading
from strainsight.pages.bench.data import (
    BenchEstimate,
    BenchMotion,
    BenchPlacement,
    BenchRun,
    BenchSensor,
    BenchStress,
    BenchUnknown,
)
from strainsight.pages.bench.page import bench_figures, bench_page
from strainsight.pages.picture.scene import drawn_or_why
from strainsight.pages.space.model import Shape
from strainsight.pages.space.section import space_section
from strainsight.pages.view.viewing import View, screenshot, untitled
from strainsight.records.bench import BenchEstimated, BenchPlaced, SensorMatch, Simulated, SurfaceInTime
from strainsight.records.record import read, unit_of
from strainsight.runner.artefact import Artefact
from strainsight.runner.output import Dataset, Output
from strainsight.runner.stage import Context, Stage
from strainsight.stages.pages.page import criteria_of, metrics_of, trend_of
from strainsight.stages.view.surface import field_shape
from strainsight.stages.view.views import bench_view, body_of

RELATIVE = (("x", "m"), ("y", "m"), ("z", "m"), ("tilt y", "rad"), ("tilt z", "rad"))
REACTION = (("Fx", "N"), ("Fy", "N"), ("Fz", "N"), ("Mx", "N m"), ("My", "N m"), ("Mz", "N m"))


def estimate_of(artefact: Artefact) -> BenchEstimate:
    """Everything that a page shows of estimate.h5."""
    own, kinds = read(BenchEstimated, artefact), _kinds(artefact)
    return BenchEstimate(
        time=own.time,
        unknowns=(*(_input(own, name) for name in own.inputs), *(_parameter(own, name) for name in own.parameters)),
        sensors=tuple(_compared(name, kinds[name], match, own.time[1:]) for name, match in own.sensors.items()),
        bearings=own.bearings,
        nis=own.nis,
        violation=own.violation,
        hold_out=tuple(_held_out(own, kinds)),
    )


def _held_out(own: BenchEstimated, kinds: Mapping[str, str]) -> Iterator[Reading]:
    """Every channel that was left out, as the others predict it."""
    for name, match in own.sensors.items():
        if match.measured is None or match.predicted is None or match.predicted_std is None or match.left_in is None:
            continue
        _, units = _components(kinds[name], unit_of(match, "expected"), match.expected.shape[1])
        for i, why in enumerate(match.left_in):
            if not why:
                measured, predicted, std = (
                    values[:, i] for values in (match.measured, match.predicted, match.predicted_std)
                )
                yield Reading(f"{name}.{i + 1}", units[i], own.time[1:], measured, predicted, std, i + 1)


def motion_of(artefact: Artefact) -> BenchMotion:
    """Everything that a page shows of simulate.h5."""
    own, kinds = read(Simulated, artefact), _kinds(artefact)
    return BenchMotion(
        time=own.time,
        inputs={name: (unit_of(own, "inputs", name), values) for name, values in own.inputs.items()},
        sensors=tuple(
            BenchSensor(
                name, own.time, values, None, *_components(kinds[name], unit_of(own, "sensors", name), values.shape[1])
            )
            for name, values in own.sensors.items()
        ),
        bearings=own.bearings,
        drives={
            name: (artefact.header.config["joints"][name]["type"] == "driven_angle", drive)
            for name, drive in own.drives.items()
        },
    )


def stress_of(artefact: Artefact, settings: SurfaceField) -> BenchStress:
    """Everything that a page shows of field.h5, but for its pictures."""
    own = read(SurfaceInTime, artefact)
    return BenchStress(
        body=settings.body,
        time=own.time,
        largest=own.von_mises,
        element=int(str(artefact.summary["element"])),
        allowable=settings.allowable,
    )


def placement_of(artefact: Artefact) -> BenchPlacement:
    """Everything that a page shows of place.h5 of a bench."""
    own = read(BenchPlaced, artefact)
    sensor = own.placed.sensor
    labels = layout_labels(sensor, np.arange(len(sensor)))
    rules = criteria_of(list(own.inputs), artefact)
    return BenchPlacement(own, trend_of(artefact), metrics_of(artefact), rules, labels)


def run_of(up: Mapping[str, Artefact]) -> dict[str, Any]:
    """What any page shows of a run, as far as it went."""
    texts = dict.fromkeys(text for artefact in up.values() for text in artefact.warnings)
    return {
        "motion": motion_of(up["simulate"]) if "simulate" in up else None,
        "estimate": estimate_of(up["estimate"]) if "estimate" in up else None,
        "numbers": {stage: artefact.summary for stage, artefact in up.items()},
        "warnings": tuple(f"{text[:1].upper()}{text[1:].rstrip('.')}." for text in texts),
    }


def _input(own: BenchEstimated, name: str) -> BenchUnknown:
    load, runs = own.inputs[name], own.input_runs.get(name)
    history = History(
        name, unit_of(load, "estimate"), own.time, load.true, load.estimate, load.std, load.smoothed, load.smoothed_std
    )
    return BenchUnknown("input", history, None if runs is None else runs.error, None, load.there)


def _parameter(own: BenchEstimated, name: str) -> BenchUnknown:
    found, runs = own.parameters[name], own.parameter_runs.get(name)
    true = None if found.true is None else np.full(len(own.time), found.true)
    history = History(name, unit_of(found, "estimate"), own.time, true, found.estimate, found.std)
    errors, stds = (None, None) if runs is None else (runs.error, runs.std)
    return BenchUnknown("parameter", history, errors, stds)


def _compared(name: str, kind: str, match: SensorMatch, time: np.ndarray) -> BenchSensor:
    components = _components(kind, unit_of(match, "expected"), match.expected.shape[1])
    measured = np.full_like(match.expected, np.nan) if match.measured is None else match.measured
    return BenchSensor(name, time, measured, match.expected, *components, match.used)


def _kinds(artefact: Artefact) -> dict[str, str]:
    """Sensor → its `type` in the config that the artefact was made from."""
    return {name: str(sensor["type"]) for name, sensor in artefact.header.config["sensors"].items()}


def _components(kind: str, unit: str, count: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What the components of a sensor are called, and their units; unit: of all of them, where they have one."""
    if kind == "relative":
        return tuple(name for name, _ in RELATIVE), tuple(own for _, own in RELATIVE)
    if kind == "reaction":
        return tuple(name for name, _ in REACTION), tuple(own for _, own in REACTION)
    names = tuple(f"gauge {i}" for i in range(1, count + 1)) if kind == "strain" else tuple("xyz")
    return names, ("–" if unit == "1" else unit,) * count


SHOWN = ("import", "reduce", "place", "simulate", "estimate", "field")
"""Stages that the page shows, of those that a bench has."""


def run(context: Context[BenchConfig]) -> Output:
    """Gather what the page shows and write it as one self-contained file."""
    report = bench_run(context)
    context.progress("figures", 0.2)
    drawings = bench_figures(report)
    up = context.upstream
    provenance = {"strainsight": __version__, "seed": str(context.config.seed)} | {
        f"{stage} artefact": up[stage].digest[:16] for stage in up
    }
    context.progress("pictures", 0.6)
    body = _body(context)
    pictures, problem = ([], "") if body is None else _pictures(context, body)
    turned = "" if body is None else _in_space(context, body)
    page = bench_page(report, drawings, provenance, pictures, turned).encode()
    count = sum(len(entries) for entries in drawings.values())
    return Output(
        datasets=_datasets(report),
        summary={"figures": count, "pictures": len(pictures), "warnings": len(report.warnings)},
        message=f"report.html, {count} figures, {len(page) / 1024:.0f} KiB"
        + (f"; no 3D pictures: {problem}" if problem else ""),
        files={"report.html": page},
    )


def _body(context: Context[BenchConfig]) -> str | None:
    """The flexible body to show: that of the field or of the placement, else the first with gauges, else the first."""
    config, up = context.config, context.upstream
    if "import" not in up or not flexible(config):
        return None
    strain = [str(sensor.body) for sensor in config.sensors.values() if sensor.type == "strain"]
    return body_of(config, None if "field" in up or "place" in up else next(iter(strain), None))


def _in_space(context: Context[BenchConfig], body: str) -> str:
    """The body with its gauges, stress, strain and modes to turn round."""
    config, up = context.config, context.upstream
    modes = bench_view(config, "modes", body, up, None)
    layout = bench_view(config, "layout", body, up, None).layout
    fields = [bench_view(config, what, body, up, None) for what in ("field", "strain") if "field" in up]
    shapes = [
        *(field_shape(view, layout) for view in fields),
        *(Shape(panel.title, panel.shift) for panel in modes.panels),
    ]
    return space_section([("", layout)], shapes, body, first=0 if fields else -1)


def _pictures(context: Context[BenchConfig], body: str) -> tuple[list[tuple[str, bytes]], str]:
    """Captions and PNGs of the gauges on the body and of its stress, and why there are none."""
    config, up = context.config, context.upstream
    views = [bench_view(config, what, body, up, None) for what in ("layout", "field") if what == "layout" or what in up]
    views = [view for view in views if view.layout.gauges or len(view.panels[0].values)]
    # The page says below the picture what it is of: not in it, too.
    pictures, problem = drawn_or_why(lambda: [(_caption(view), screenshot(untitled(view))) for view in views])
    return pictures or [], problem


def _caption(view: View) -> str:
    """What a picture is of, once."""
    shown = f", {view.quantity} [{view.unit}]" * bool(view.quantity)
    return f"{view.title}{shown}; {view.panels[0].title}".rstrip("; ")


def bench_run(context: Context[BenchConfig]) -> BenchRun:
    """The page's content."""
    up, field = context.upstream, context.config.field
    return BenchRun(
        context.config.name,
        **run_of(up),
        placement=placement_of(up["place"]) if "place" in up else None,
        stress=stress_of(up["field"], field) if "field" in up and field else None,
    )


def _datasets(report: BenchRun) -> dict[str, Dataset]:
    """What the page is about in time: artefacts need at least one array."""
    time = (
        report.motion.time
        if report.motion is not None
        else report.estimate.time
        if report.estimate is not None
        else None
    )
    return {} if time is None else {"/time": Dataset(time, "s", "time of the bench that the page shows")}


def report_stage(stages: Sequence[str]) -> Stage:
    """The stage of a bench that has these stages."""
    upstream = tuple(stage for stage in stages if stage in SHOWN)
    reads = ("name", "seed", "bodies.*.type", "sensors", "field", "place")
    return Stage("report", version=10, reads=reads, upstream=upstream, files=(), run=run)
