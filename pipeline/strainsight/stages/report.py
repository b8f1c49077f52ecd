"""report: one page that people decide from; everything on it is read from the artefacts."""

from __future__ import annotations

from strainsight.config.placement import PlacementConfig
from strainsight.pages.picture.scene import drawn_or_why, render
from strainsight.pages.placement.figures import placement_figures
from strainsight.pages.placement.page import placement_page
from strainsight.pages.space.model import Shape
from strainsight.runner.output import Dataset, Output, Scalar, warnings_table
from strainsight.runner.stage import Context, Stage
from strainsight.stages import inputs
from strainsight.stages.pages.page import placement_report
from strainsight.stages.pages.workshop import exported, sheet_files, sheets_of, workshop_files, workshop_of_run
from strainsight.stages.view.surface import strain_shapes, strains_of
from strainsight.stages.view.views import placement_view


def run(context: Context[PlacementConfig]) -> Output:
    """Gather what the page shows and write it as one self-contained file."""
    mesh = inputs.mesh(context)
    shop = workshop_of_run(context, mesh)
    report, sheets = placement_report(context, mesh, shop), sheet_files(sheets_of(context, shop, mesh))
    context.progress("picture", 0.1)
    scene, problem = drawn_or_why(lambda: render(report.layout))
    modes = placement_view(context.config, "modes", context.upstream, None)
    strains = strain_shapes(report.layout, strains_of(context.config, mesh, context.upstream))
    shapes = (*strains, *(Shape(panel.title, panel.shift) for panel in modes.panels))
    context.progress("figures", 0.5)
    page = placement_page(report, placement_figures(report), scene, problem, shapes, tuple(sheets.values())).encode()
    trend, noise = report.trend, report.noise
    assert noise is not None
    datasets = {
        "/trend/count": Dataset(trend.count, "1", "gauges left"),
        "/trend/metric": Dataset(trend.value, "1", f"{trend.metric.symbol} with that many gauges", ("/trend/count",)),
        "/noise/level": Dataset(noise.level, "1", "gauge noise over the strongest candidate's RMS"),
    }
    for key, values in (("error", noise.error), ("std", noise.std)):
        for name in values:
            datasets[f"/noise/{key}/{name}"] = Dataset(
                values[name], "1", f"{key} of {name} at that noise", ("/noise/level",)
            )
    said = f"report.html, {len(page) / 1024:.0f} KiB" + (f"; no 3D picture: {problem}" if problem else "")
    summary: dict[str, Scalar] = {"picture": scene is not None, "warnings": len(report.warnings)}
    return Output(
        datasets=datasets,
        summary=summary,
        message=said,
        tables=warnings_table(report.warnings),
        files={"report.html": page, **workshop_files(shop), **sheets, **exported(context, shop)},
    )


REPORT = Stage(
    "report",
    version=25,
    reads=(
        "name",
        "seed",
        "loads",
        "tolerances",
        "place.estimate",
        "validate.truth.model",
        "mesh.file",
        "mesh.length_unit",
        "mesh.free",
        "gauges.type",
        "gauges.types",
        "report",
    ),
    upstream=("import", "rom", "train", "screen", "observe", "place", "validate"),
    files=(),
    run=run,
)
