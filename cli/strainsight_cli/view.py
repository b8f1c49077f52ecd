"""`strainsight view` and `strainsight figures`: results of a run in a window, as a picture, or as files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from strainsight.errors import UserError
from strainsight.writing import write_file
from strainsight_cli import pipelines
from strainsight_cli.failures import reported
from strainsight_cli.options import DEFAULT_RESULTS, ConfigFile, Results, Set, Verbose
from strainsight_cli.printing import say
from strainsight_cli.runlog import run_log
from strainsight_cli.work import note, show_warnings

if TYPE_CHECKING:
    from strainsight.config.bench.bench import BenchConfig
    from strainsight.config.load import LoadedConfig
    from strainsight.config.placement import PlacementConfig


def view(
    config: ConfigFile,
    what: Annotated[
        Literal["mesh", "modes", "strain", "candidates", "layout", "field"] | None,
        typer.Option("--what", help="View to show; default: the layout, or the mesh if no layout exists."),
    ] = None,
    at: Annotated[
        float | None,
        typer.Option("--at", metavar="SECONDS", help="Time of the field [s]; default: time of the largest stress."),
    ] = None,
    of: Annotated[
        Literal["test", "validation"] | None,
        typer.Option("--of", help="Source of the field of a placement; default: the test, if the run has one."),
    ] = None,
    record: Annotated[
        str | None,
        typer.Option("--record", metavar="NAME", help="Record to show, if the test has several; default: the first."),
    ] = None,
    body: Annotated[str | None, typer.Option("--body", metavar="NAME", help="Flexible body of a bench.")] = None,
    screenshot: Annotated[
        Path | None,
        typer.Option("--screenshot", metavar="FILE.png", help="Write a picture instead of opening a window."),
    ] = None,
    results: Results = DEFAULT_RESULTS,
    overrides: Set = None,
    verbose: Verbose = False,
) -> None:
    with reported(verbose):
        _refuse_name(screenshot)
        loaded = pipelines.with_last_test(config, overrides, results, "import" if what == "mesh" else None)
        model = viewable(loaded, config)
        stages = pipelines.stages_of(loaded.data)
        from strainsight.stages.view.views import view_of

        folder = results / str(loaded.data["name"])
        names = [stage.name for stage in stages]
        shown, read = view_of(model, names, folder, str(config), what, at, body, of, record)
        say_stale(loaded, results, read, "view")
        from strainsight.pages.view import viewing

        if screenshot is None:
            viewing.window(shown)
        else:
            write_file(screenshot, *viewing.screenshots([shown]))
            say(f"wrote {screenshot}: {shown.title}")


def _refuse_name(screenshot: Path | None) -> None:
    """Check the path of the picture before the rendering."""
    if screenshot is None:
        return
    if screenshot.suffix.lower() != ".png":
        raise UserError("a screenshot is a PNG file", where=str(screenshot), remedy="use a name that ends in .png")
    if not screenshot.parent.is_dir():
        raise UserError(
            "folder not found", where=str(screenshot.parent), remedy="create the folder, or use another path"
        )


def viewable(loaded: LoadedConfig, config: Path) -> PlacementConfig | BenchConfig:
    """The config of a placement or a bench. Raises UserError for others."""
    from strainsight.config.bench.bench import BenchConfig
    from strainsight.config.placement import PlacementConfig

    model = loaded.model
    if isinstance(model, PlacementConfig | BenchConfig):
        return model
    if model.kind == "suite":
        raise UserError(
            "`view` and `figures` do not support a suite", where=str(config), remedy="use the config of one of its runs"
        )
    raise UserError(
        "a bearing config has no mesh", where=str(config), remedy="open bearing.html for its curves and ball loads"
    )


def say_stale(loaded: LoadedConfig, results: Path, read: tuple[str, ...], command: str) -> None:
    """Print and log the warnings of the stages shown, with a note for results older than the config."""
    from strainsight.runner.plan import UP_TO_DATE, plan

    work = pipelines.work_of(loaded, results)
    shown = [i for i, stage in enumerate(work.stages) if stage.name in ("import", *read)]
    statuses = [status for status in plan(work.stages[: shown[-1] + 1], work.job) if status.stage in ("import", *read)]
    with run_log(work.job, command):
        show_warnings(work, statuses)
    stale = [status for status in statuses if status.stage in read and status.status != UP_TO_DATE]
    for status in stale[:1]:
        note(f"the results file {status.artefact} is older than the config: {status.reason}")


def figures(
    config: ConfigFile, results: Results = DEFAULT_RESULTS, overrides: Set = None, verbose: Verbose = False
) -> None:
    with reported(verbose):
        from strainsight.pages.chart.files import write_figures
        from strainsight.stages.figures import figures_of

        loaded = pipelines.with_last_test(config, overrides, results)
        model = viewable(loaded, config)
        folder = results / str(loaded.data["name"])
        pages = [stage for stage in pipelines.stages_of(loaded.data) if stage.name in pipelines.PAGES]
        figures = figures_of(model, pages, folder, str(config))
        say_stale(loaded, results, figures.read, "figures")
        write_figures(folder / "figures", figures.files)
        many = sum(figures.counted.values())
        of = _of_what(figures.counted, loaded)
        say(f"wrote {many} figures{of} as SVG, PNG and CSV: {folder / 'figures'}")


def _of_what(counted: Mapping[str, int], loaded: LoadedConfig) -> str:
    """The pages with the figures, if there is a test."""
    if "test" not in counted:
        return ""
    settings = loaded.data["estimate"]
    test = settings["file"] or ", ".join(record["name"] for record in settings["records"])
    placement = f"; {counted['report']} of the placement" if "report" in counted else ""
    return f" ({counted['test']} of the test {test}, their names begin with test-{placement})"
