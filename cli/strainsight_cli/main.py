"""strainsight: from a finite-element mesh to a certified layout of strain gauges."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from strainsight_cli import pipelines, render
from strainsight_cli.failures import reported
from strainsight_cli.work import Work, bring_up_to_date, say, show_plan, show_results

if TYPE_CHECKING:
    from strainsight.config.load import LoadedConfig

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
        loaded = _loaded(config, overrides)
        if loaded.data["kind"] == "suite":
            from strainsight_cli import suites

            works = suites.works_of(loaded, results)
            if dry_run:
                suites.show_suite(works, force, as_json)
            else:
                suites.run_suite(works, loaded.data["jobs"], force, as_json, verbose)
            return
        work = _work(loaded, results)
        names = [stage.name for stage in work.stages]
        _bring_up_to_date(work, names if force else [], dry_run, as_json, verbose, tables=names)


@app.command(help="Say which stages are up to date, and why the others are not.")
def status(
    config: ConfigFile,
    results: Results = DEFAULT_RESULTS,
    as_json: Json = False,
    overrides: Set = None,
    verbose: Verbose = False,
) -> None:
    with reported(verbose):
        loaded = _loaded(config, overrides)
        if loaded.data["kind"] == "suite":
            from strainsight_cli import suites

            suites.show_suite(suites.works_of(loaded, results), False, as_json)
        else:
            show_plan(_work(loaded, results), (), as_json)


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
            work = _work_of_one(config, results, overrides, name)
            upto = replace(work, stages=work.stages[: [stage.name for stage in work.stages].index(name) + 1])
            _bring_up_to_date(upto, [name] if force else [], dry_run, as_json, verbose, tables=[name])


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
        from strainsight.config.load import kind_of

        if measurements is not None and kind_of(config) == "bench":
            raise ConfigError(
                "a bench takes its measurements from another run of a bench, not from a file",
                key="estimate.measured",
                where=str(config),
                remedy="give `estimate: {measured: {from: RUN}}`",
            )
        if measurements is not None:
            # From the config's folder, as all paths of a config: no absolute path gets into the results.
            relative = os.path.relpath(measurements.resolve(), config.resolve().parent)
            asked.append(f"estimate.file={json.dumps(Path(relative).as_posix())}")
        if allow_unobservable:
            asked.append("estimate.allow_unobservable=true")
        work = _work_of_one(config, results, asked, "estimate")
        names = [stage.name for stage in work.stages]
        if "estimate" not in names:
            raise ConfigError(
                "no measurements to estimate from",
                key="estimate",
                where=str(config),
                remedy="give `estimate: {channels: …}` in the config and --measurements FILE",
            )
        upto = replace(work, stages=work.stages[: names.index("estimate") + 1])
        _bring_up_to_date(upto, ["estimate"] if force else [], dry_run, as_json, verbose, tables=["estimate"])


def _loaded(path: Path, overrides: list[str] | None) -> LoadedConfig:
    """Check the config before anything else is loaded."""
    from strainsight.config.load import load_config

    return load_config(path, overrides or ())


def _work(config: LoadedConfig, results: Path) -> Work:
    from strainsight.workflow.plan import Job

    data: dict[str, Any] = config.data
    return Work(pipelines.stages_of(data), Job(data, config.path.parent, results, config.locate))


def _work_of_one(path: Path, results: Path, overrides: list[str] | None, stage: str) -> Work:
    """The work of a config that has the stage; a suite has none."""
    from strainsight_cli import suites

    suites.refuse(path, stage)
    loaded = _loaded(path, overrides)
    work = _work(loaded, results)
    names = [own.name for own in work.stages]
    kind = loaded.data["kind"]
    if stage not in names and (kind, stage) != ("placement", "estimate"):  # which says itself what is missing
        from strainsight.errors import UserError

        section = f"give it a section `{stage}`; " if kind == "bench" and stage in ("place", "estimate", "field") else ""
        raise UserError(
            f"this config of kind {kind} has no stage '{stage}'",
            where=str(path),
            remedy=f"{section}its stages are {', '.join(names)}",
        )
    return work


def _bring_up_to_date(
    work: Work, forced: list[str], dry_run: bool, as_json: bool, verbose: bool, tables: list[str]
) -> None:
    """Run what is not up to date; print a line a stage and, at the end, the tables of the stages named."""
    if dry_run:
        show_plan(work, forced, as_json)
        return
    with render.progress_bar(not as_json) as progress:
        artefacts = bring_up_to_date(work, forced, as_json, verbose, say, progress)
    if not as_json:
        show_results(artefacts, tables)


def main() -> None:
    """Console script."""
    app()


if __name__ == "__main__":
    main()
