"""strainsight: from a finite-element mesh to a certified layout of strain gauges."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from strainsight_cli import pipelines, render
from strainsight_cli.failures import reported

if TYPE_CHECKING:
    from strainsight.workflow.plan import Job
    from strainsight.workflow.stage import Stage

# The dense matrices here have tens of rows: a second OpenBLAS thread doubles the time of rom and validate. Numpy reads this
# when it is first imported, inside the commands. PARDISO has its own threads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Where to glue strain gauges on a finite-element model, what they will let you know, and how well.",
)

ConfigFile = Annotated[Path, typer.Argument(metavar="CONFIG", help="Config file; `strainsight init DECK` writes one.")]
Force = Annotated[bool, typer.Option("--force", help="Run it even if it is up to date (`run`: every stage).")]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Say what would run and why; write nothing.")]
Results = Annotated[Path, typer.Option("--results", metavar="DIR", help="Results folder.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object a stage.")]
Set = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override, as in --set place.keep=6.")
]
Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="Say why stages run; show the traceback of a failure.")]
DEFAULT_RESULTS = Path("results")


@app.callback(invoke_without_command=True)
def about(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        import strainsight

        print(f"strainsight {strainsight.__version__}")
        raise typer.Exit


@app.command(help="Run every stage that is not up to date.")
def run(
    config: ConfigFile,
    force: Force = False,
    dry_run: DryRun = False,
    results: Results = DEFAULT_RESULTS,
    as_json: Json = False,
    overrides: Set = None,
    verbose: Verbose = False,
) -> None:
    with reported(verbose):
        stages, job = _job(config, results, overrides)
        names = [stage.name for stage in stages]
        _bring_up_to_date(stages, job, names if force else [], dry_run, as_json, verbose, tables=names)


@app.command(help="Say which stages are up to date, and why the others are not.")
def status(
    config: ConfigFile,
    results: Results = DEFAULT_RESULTS,
    as_json: Json = False,
    overrides: Set = None,
    verbose: Verbose = False,
) -> None:
    with reported(verbose):
        stages, job = _job(config, results, overrides)
        _show_plan(stages, job, (), as_json)


@app.command(help="Write a commented config for your own deck.")
def init(
    deck: Annotated[Path, typer.Argument(metavar="DECK", help="Finite-element deck.")],
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE", help="Config to write.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file.")] = False,
    verbose: Verbose = False,
) -> None:
    with reported(verbose):
        from strainsight.config.template import template
        from strainsight.errors import UserError

        if not deck.is_file():
            raise UserError("no such deck", where=str(deck), remedy="give the path of a finite-element deck")
        target = output or Path(f"{Path(deck.name.removesuffix('.gz')).stem}.yaml")
        if target.exists() and not force:
            raise UserError("the file exists", where=str(target), remedy="give another one with -o FILE, or --force")
        from strainsight.stages.suggestion import suggestion

        relative = Path(os.path.relpath(deck.resolve(), target.resolve().parent)).as_posix()
        text = template(relative, suggestion(deck))
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, encoding="utf-8")
        print(f"wrote {target}: fill in the lines marked ←, then: strainsight run {target}")


@app.command(help="Print the JSON Schema of a config.")
def schema() -> None:
    with reported():
        from strainsight.config.schema import schema_text

        print(schema_text(), end="")


def _add_stage(name: str, what: str) -> None:
    @app.command(
        name,
        short_help=f"{what}.",
        help=f"{what}. Runs the stages above first where they are not up to date.",
    )
    def command(
        config: ConfigFile,
        force: Force = False,
        dry_run: DryRun = False,
        results: Results = DEFAULT_RESULTS,
        as_json: Json = False,
        overrides: Set = None,
        verbose: Verbose = False,
    ) -> None:
        with reported(verbose):
            stages, job = _job(config, results, overrides)
            upto = stages[: [stage.name for stage in stages].index(name) + 1]
            _bring_up_to_date(upto, job, [name] if force else [], dry_run, as_json, verbose, tables=[name])


for _name, _what in pipelines.STAGES.items():
    _add_stage(_name, _what)


@app.command(help="Estimate loads, parameters and strains from the measurements of a test.")
def estimate(
    config: ConfigFile,
    measurements: Annotated[
        Path | None,
        typer.Option("--measurements", metavar="FILE", help="CSV, HDF5 or UFF58 file; default: estimate.file."),
    ] = None,
    allow_unobservable: Annotated[
        bool, typer.Option("--allow-unobservable", help="Go on where the channels cannot tell all unknowns.")
    ] = False,
    force: Force = False,
    dry_run: DryRun = False,
    results: Results = DEFAULT_RESULTS,
    as_json: Json = False,
    overrides: Set = None,
    verbose: Verbose = False,
) -> None:
    with reported(verbose):
        from strainsight.errors import ConfigError

        asked = list(overrides or ())
        if measurements is not None:
            # From the config's folder, as all paths of a config: no absolute path gets into the results.
            relative = os.path.relpath(measurements.resolve(), config.resolve().parent)
            asked.append(f"estimate.file={json.dumps(Path(relative).as_posix())}")
        if allow_unobservable:
            asked.append("estimate.allow_unobservable=true")
        stages, job = _job(config, results, asked)
        names = [stage.name for stage in stages]
        if "estimate" not in names:
            raise ConfigError(
                "no measurements to estimate from",
                key="estimate",
                where=str(config),
                remedy="give `estimate: {channels: …}` in the config and --measurements FILE",
            )
        upto = stages[: names.index("estimate") + 1]
        _bring_up_to_date(upto, job, ["estimate"] if force else [], dry_run, as_json, verbose, tables=["estimate"])


def _job(path: Path, results: Path, overrides: list[str] | None) -> tuple[tuple[Stage, ...], Job]:
    """Check the config before anything else is loaded."""
    from strainsight.config.load import load_config

    config = load_config(path, overrides or ())
    from strainsight.workflow.plan import Job

    data: dict[str, Any] = config.data
    return pipelines.stages_of(data), Job(data, path.parent, results, config.locate)


def _show_plan(stages: tuple[Stage, ...], job: Job, forced: list[str] | tuple[str, ...], as_json: bool) -> None:
    from strainsight.workflow.plan import plan

    for entry in plan(stages, job, forced):
        print(render.status_json(entry) if as_json else render.status_line(entry))


def _bring_up_to_date(
    stages: tuple[Stage, ...],
    job: Job,
    forced: list[str],
    dry_run: bool,
    as_json: bool,
    verbose: bool,
    tables: list[str],
) -> None:
    """Run what is not up to date; print a line a stage and, at the end, the tables of the stages named."""
    if dry_run:
        _show_plan(stages, job, forced, as_json)
        return
    from strainsight.errors import StrainsightError
    from strainsight.workflow.runner import RUNNING
    from strainsight.workflow.runner import run as run_stages

    artefacts = []
    at_work = ""
    with render.progress_bar(not as_json) as progress:
        events = run_stages(stages, job, forced=forced, progress=progress, notice=_note)
        try:
            for event in events:
                if event.status == RUNNING:
                    at_work = event.stage
                    progress(event.stage, event.reason, 0.0)
                    continue
                assert event.artefact is not None
                artefacts.append(event.artefact)
                print(render.event_json(event) if as_json else render.stage_line(event, verbose), flush=True)
        except Exception as error:
            if as_json and at_work:
                reason = str(error) if isinstance(error, StrainsightError) else f"{type(error).__name__}: {error}"
                print(render.failure_json(at_work, reason), flush=True)
            raise
    if as_json:
        return
    render.print_tables(
        [table for artefact in artefacts if artefact.header.stage in tables for table in artefact.tables]
    )
    for artefact in artefacts:
        for name in artefact.header.beside or {}:
            print(f"{Path(name).stem}: {artefact.path.parent / name}")


def _note(text: str) -> None:
    print(f"note: {text}", file=sys.stderr)


def main() -> None:
    """Console script."""
    app()


if __name__ == "__main__":
    main()
