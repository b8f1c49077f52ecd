"""report: one page about a run of a bench; everything on it is read from the artefacts."""

from __future__ import annotations

from collections.abc import Sequence

from strainsight import __version__
from strainsight.config.bench.bench import BenchConfig
from strainsight.experiment.bench.reduction import flexible
from strainsight.pages.bench.data import BenchRun
from strainsight.pages.bench.page import bench_figures, bench_page
from strainsight.pages.picture.scene import drawn_or_why
from strainsight.pages.space.model import Shape
from strainsight.pages.space.section import space_section
from strainsight.pages.view.viewing import View, screenshot, untitled
from strainsight.runner.output import Dataset, Output
from strainsight.runner.stage import Context, Stage
from strainsight.stages.pages.bench_run import placement_of, run_of, stress_of
from strainsight.stages.view.surface import field_shape
from strainsight.stages.view.views import bench_view, body_of

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
