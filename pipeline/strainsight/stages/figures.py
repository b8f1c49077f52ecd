"""The figures of a run's page as files, drawn anew from the artefacts.

Not by the stage `report`: what a stage writes beside its artefact are plain files in one folder, each checked by its sha256
on every run; a run has some thirty figures, and drawing them as PNG takes as long as the page.
"""

from __future__ import annotations

from pathlib import Path

from strainsight.cases.resources import silent
from strainsight.config.bench.bench import BenchConfig
from strainsight.config.placement import PlacementConfig
from strainsight.errors import UserError
from strainsight.report.chart.drawing import Drawing, kept
from strainsight.report.chart.files import figure_files
from strainsight.workflow.artefact import Artefact
from strainsight.workflow.slices import declared, prune
from strainsight.workflow.stage import Context, Stage


def figures_of(
    config: PlacementConfig | BenchConfig, report: Stage, folder: Path, config_file: str
) -> dict[str, bytes]:
    """File name → content of every figure of the page that `report`, the last stage of a placement or a bench, would write.

    Raises UserError with the command to run where artefacts are missing.
    """
    missing = [name for name in report.upstream if not (folder / f"{name}.h5").is_file()]
    if missing:
        raise UserError(
            f"there are no figures yet: {folder / missing[0]}.h5 has not been written",
            where=config_file,
            remedy=f"run first: strainsight run {config_file}",
        )
    upstream = {name: Artefact(folder / f"{name}.h5") for name in report.upstream}
    data = config.model_dump(mode="json", by_alias=True)
    own = declared(config, prune(data, report.reads))
    with kept() as drawn:
        if isinstance(own, BenchConfig):
            drawings = _of_bench(Context(own, upstream, {}, silent))
        else:
            drawings = _of_placement(Context(own, upstream, {}, silent))
        return figure_files(drawings, drawn)


def _of_placement(context: Context[PlacementConfig]) -> list[Drawing]:
    from strainsight.report.placement.figures import placement_figures
    from strainsight.stages.pages.page import placement_report

    return list(placement_figures(placement_report(context)))


def _of_bench(context: Context[BenchConfig]) -> list[Drawing]:
    from strainsight.report.bench.page import bench_figures
    from strainsight.stages.bench.report import bench_run

    return [drawing for section in bench_figures(bench_run(context)).values() for drawing in section]
