"""Figures of the results page as files, drawn from the artefacts.
They are not files of the stage `report`: those are verified by sha256 on every run, and PNG versions of about thirty figures take
as long as the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from strainsight.config.bench.bench import BenchConfig
from strainsight.config.placement import PlacementConfig
from strainsight.errors import UserError
from strainsight.experiment.system import silent
from strainsight.pages.chart.drawing import Drawing, recorded_figures
from strainsight.pages.chart.files import figure_files
from strainsight.runner.artefact import Artefact, missing_stages
from strainsight.runner.slices import declared, prune
from strainsight.runner.stage import Context, Stage
from strainsight.stages import inputs

TEST = "test"
"""Name of the stage whose page is of a test, and what the names of its figures begin with."""


@dataclass(frozen=True)
class Figures:
    """files: file name → content; counted: page ("report", "test") → how many figures are of it; read: the stages whose
    artefacts they were drawn from."""

    files: dict[str, bytes]
    counted: dict[str, int]
    read: tuple[str, ...]


def figures_of(
    config: PlacementConfig | BenchConfig, pages: Sequence[Stage], folder: Path, config_file: str
) -> Figures:
    """Every figure of the pages that these stages of a placement or a bench would write, as far as what they are read from is
    there.

    Raises UserError with the command to run where there is no page yet."""
    ready = [page for page in pages if not missing_stages(folder, page.upstream)]
    if not ready:
        raise UserError(
            f"no figures available: {folder / missing_stages(folder, pages[-1].upstream)[0]}.h5 is missing",
            where=config_file,
            remedy=f"first run: strainsight run {config_file}",
        )
    data = config.model_dump(mode="json", by_alias=True)
    counted = {}
    with recorded_figures() as figures:
        drawings: list[Drawing] = []
        for page in ready:
            upstream = {name: Artefact(folder / f"{name}.h5") for name in page.upstream}
            settings: Any = declared(config, prune(data, page.reads))
            of = _of_bench if isinstance(config, BenchConfig) else _of_test if page.name == TEST else _of_placement
            shown = of(Context(settings, upstream, {}, silent))
            counted[page.name] = len(shown)
            drawings += shown
        files = figure_files(drawings, figures)
    return Figures(files, counted, tuple(dict.fromkeys(name for page in ready for name in page.upstream)))


def _of_placement(context: Context[PlacementConfig]) -> list[Drawing]:
    from strainsight.pages.placement.figures import placement_figures
    from strainsight.stages.pages.page import placement_report
    from strainsight.stages.report import workshop_of_run

    mesh = inputs.mesh(context)
    return list(placement_figures(placement_report(context, mesh, workshop_of_run(context, mesh))))


def _of_test(context: Context[PlacementConfig]) -> list[Drawing]:
    """Unique figure names, with the record name if there are several: the page of the placement also has an estimate of every
    unknown."""
    from strainsight.pages.tested.campaign import campaign_figures
    from strainsight.pages.tested.figures import figures_of_test
    from strainsight.stages.measurement_report import pages_of

    records, campaign = pages_of(context)
    pages = [] if campaign is None else [("", "", campaign_figures(campaign))]
    for report in records:
        name, of_record = (f"-{report.record}", f", record {report.record}") if report.record else ("", "")
        pages.append((name, of_record, figures_of_test(report)))
    return [
        replace(figure, key=f"{TEST}{name}-{figure.key}", title=f"estimate from the test{of_record}: {figure.title}")
        for name, of_record, figures in pages
        for figure in figures
    ]


def _of_bench(context: Context[BenchConfig]) -> list[Drawing]:
    from strainsight.pages.bench.page import bench_figures
    from strainsight.stages.bench.report import bench_run

    return [drawing for section in bench_figures(bench_run(context)).values() for drawing in section]
