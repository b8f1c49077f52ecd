"""report: one page about a run of a bench; everything on it is read from the artefacts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from strainsight import __version__
from strainsight.config.bench.bench import BenchConfig
from strainsight.experiment.layout.gauge_list import layout_labels
from strainsight.pages.arrays import Reading
from strainsight.pages.bench.data import BenchPageRun, BenchSensor, BenchStress, BenchUnknown, PlacedGauges
from strainsight.pages.bench.page import bench_figures, bench_page
from strainsight.pages.picture.scene import draw_or_explain
from strainsight.pages.space.model import ShownState
from strainsight.pages.space.section import space_section
from strainsight.pages.view.viewing import View, screenshots, untitled
from strainsight.records.bench import BenchEstimated, Simulated, SurfaceHistory
from strainsight.records.bench_placed import BenchPlaced
from strainsight.records.record import read, unit_of
from strainsight.runner.artefact import Artefact
from strainsight.runner.output import Dataset, Output
from strainsight.runner.stage import Context, Stage
from strainsight.stages.pages.page import criteria_of, metrics_of, trend_of
from strainsight.stages.view.surface import field_shape
from strainsight.stages.view.views import bench_view, body_of

COMPONENTS = {
    "relative": (("x", "y", "z", "tilt y", "tilt z"), ("m", "m", "m", "rad", "rad")),
    "reaction": (("Fx", "Fy", "Fz", "Mx", "My", "Mz"), ("N", "N", "N", "N m", "N m", "N m")),
}
"""Sensors whose components have different units: their names and units."""


def run_of(up: Mapping[str, Artefact]) -> dict[str, Any]:
    """Data of a run on any page, as far as computed: fields of `BenchPageRun`."""
    texts = dict.fromkeys(text for artefact in up.values() for text in artefact.warnings)
    return {
        "numbers": {stage: artefact.summary for stage, artefact in up.items()},
        "warnings": tuple(f"{text[:1].upper()}{text[1:].rstrip('.')}." for text in texts),
        **(_simulated(up["simulate"]) if "simulate" in up else {}),
        **(_estimated(up["estimate"]) if "estimate" in up else {}),
    }


def _simulated(artefact: Artefact) -> dict[str, Any]:
    record, config = read(Simulated, artefact), artefact.header.config
    readings = []
    for name, values in record.sensors.items():
        components = _components(config, name, unit_of(record, "sensors", name), values.shape[1])
        readings.append(BenchSensor(name, record.time, values, None, *components))
    return {
        "simulated": record,
        "loads": {name: (unit_of(record, "inputs", name), values) for name, values in record.inputs.items()},
        "readings": tuple(readings),
        "turning": tuple(name for name in record.drives if config["joints"][name]["type"] == "driven_angle"),
    }


def _estimated(artefact: Artefact) -> dict[str, Any]:
    record, unknowns, sensors, held_out = read(BenchEstimated, artefact), [], [], []
    time, after = record.time, record.time[1:]
    for name, load in record.inputs.items():
        runs = record.input_runs.get(name)
        values = (load.true, load.estimate, load.std, load.smoothed, load.smoothed_std)
        errors = None if runs is None else runs.error
        unknowns.append(
            BenchUnknown(
                name, unit_of(load, "estimate"), time, *values, kind="input", errors=errors, unscaled=load.unscaled
            )
        )
    for name, parameter in record.parameters.items():
        ends = record.parameter_runs.get(name)
        errors, stds = (None, None) if ends is None else (ends.error, ends.std)
        true = None if parameter.true is None else np.full(len(time), parameter.true)
        history = (name, unit_of(parameter, "estimate"), time, true, parameter.estimate, parameter.std)
        unknowns.append(BenchUnknown(*history, kind="parameter", errors=errors, stds=stds))
    for name, match in record.sensors.items():
        unit, count = unit_of(match, "expected"), match.expected.shape[1]
        names, units = _components(artefact.header.config, name, unit, count)
        measured = np.full_like(match.expected, np.nan) if match.measured is None else match.measured
        sensors.append(BenchSensor(name, after, measured, match.expected, names, units, match.used))
        if match.measured is None or match.predicted is None or match.predicted_std is None or match.left_in is None:
            continue
        columns = zip(measured.T, match.predicted.T, match.predicted_std.T, match.left_in, units, strict=True)
        for i, (reading, predicted, std, why, unit_of_channel) in enumerate(columns, start=1):
            if not why:
                held_out.append(Reading(f"{name}.{i}", unit_of_channel, after, reading, predicted, std, i))
    return {"estimated": record, "unknowns": tuple(unknowns), "sensors": tuple(sensors), "hold_out": tuple(held_out)}


def _components(config: Any, name: str, unit: str, count: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units of the components of a sensor; their common unit, if there is one; their number."""
    kind = str(config["sensors"][name]["type"])
    gauges = tuple(f"gauge {i}" for i in range(1, count + 1))
    usual = (gauges if kind == "strain" else tuple("xyz")), ("–" if unit == "1" else unit,) * count
    return COMPONENTS.get(kind, usual)


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
    pictures: list[tuple[str, bytes]] = []
    problem = turned = ""
    if (body := _body(context)) is not None:
        kinds = ("layout", "modes", *(("field", "strain") if "field" in up else ()))
        views = {what: bench_view(context.config, what, body, up, None) for what in kinds}
        (pictures, problem), turned = _pictures(views), _in_space(views, body)
    page = bench_page(report, drawings, provenance, pictures, turned).encode()
    count = sum(len(entries) for entries in drawings.values())
    # artefacts need at least one array
    shown = report.simulated or report.estimated
    return Output(
        datasets={}
        if shown is None
        else {"/time": Dataset(shown.time, "s", "time of the time histories on the results page")},
        summary={"figures": count, "pictures": len(pictures), "warnings": len(report.warnings)},
        message=f"report.html, {count} figures, {len(page) / 1024:.0f} KiB"
        + (f"; no 3D pictures: {problem}" if problem else ""),
        files={"report.html": page},
    )


def _body(context: Context[BenchConfig]) -> str | None:
    """The flexible body to show: that of the field or of the placement, else the first with gauges, else the first."""
    config, up = context.config, context.upstream
    if "import" not in up or not config.flexible:
        return None
    strain = [str(sensor.body) for sensor in config.sensors.values() if sensor.type == "strain"]
    return body_of(config, None if "field" in up or "place" in up else next(iter(strain), None))


def _in_space(views: Mapping[str, View], body: str) -> str:
    """The body with its gauges, stress, strain and modes to turn round."""
    layout, fields = views["layout"].layout, [views[what] for what in ("field", "strain") if what in views]
    shapes = [
        *(field_shape(view, layout) for view in fields),
        *(ShownState(panel.title, panel.shift) for panel in views["modes"].panels),
    ]
    return space_section([("", layout)], shapes, body, first=0 if fields else -1)


def _pictures(views: Mapping[str, View]) -> tuple[list[tuple[str, bytes]], str]:
    """Captions and PNGs of the gauges on the body and of its stress, and the reason if they are missing."""
    shown = [views[what] for what in ("layout", "field") if what in views]
    shown = [view for view in shown if view.layout.gauges or len(view.panels[0].values)]
    # The caption is below the picture, not in it.
    pictures, problem = draw_or_explain(lambda: screenshots([*map(untitled, shown)])) if shown else (None, "")
    return list(zip(map(_caption, shown), pictures or (), strict=False)), problem


def _caption(view: View) -> str:
    """Caption of a picture."""
    shown = f", {view.quantity} [{view.unit}]" * bool(view.quantity)
    return f"{view.title}{shown}; {view.panels[0].title}".rstrip("; ")


def bench_run(context: Context[BenchConfig]) -> BenchPageRun:
    """The page's content."""
    up, settings = context.upstream, context.config.field
    placement = stress = None
    if "place" in up:
        place, placed = up["place"], read(BenchPlaced, up["place"])
        sensor = placed.placed.sensor
        labels = layout_labels(sensor, np.arange(len(sensor)))
        criteria = criteria_of(list(placed.inputs), place)
        placement = PlacedGauges(placed, trend_of(place), metrics_of(place), criteria, labels)
    if "field" in up and settings:
        field, element = read(SurfaceHistory, up["field"]), int(str(up["field"].summary["element"]))
        stress = BenchStress(settings.body, field.time, field.von_mises, element, settings.allowable)
    return BenchPageRun(context.config.name, **run_of(up), placement=placement, stress=stress)


def report_stage(stages: Sequence[str]) -> Stage:
    """The stage of a bench that has these stages."""
    upstream = tuple(stage for stage in stages if stage in SHOWN)
    reads = ("name", "seed", "bodies.*.type", "sensors", "field", "place")
    return Stage("report", version=10, reads=reads, upstream=upstream, files=(), run=run)
