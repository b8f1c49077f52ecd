"""strainsight: from a finite-element mesh to a strain-gauge layout with an optimality bound."""

from __future__ import annotations

import io
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from strainsight.errors import ConfigError, UserError
from strainsight.parallel import cores
from strainsight.processes import SAFE_PATH
from strainsight_cli import pipelines
from strainsight_cli.bar import progress_bar
from strainsight_cli.check_modes import check_modes
from strainsight_cli.example import example
from strainsight_cli.failures import USER, failure_of, reported, tell
from strainsight_cli.init import init
from strainsight_cli.options import (
    DEFAULT_RESULTS,
    ConfigFile,
    DoctorJson,
    Json,
    Results,
    RunOptions,
    Set,
    Verbose,
    computing,
)
from strainsight_cli.printing import missing, prepare_streams, say, unwritten
from strainsight_cli.show import show
from strainsight_cli.status import show_plan
from strainsight_cli.summary import print_summary
from strainsight_cli.view import figures, view
from strainsight_cli.work import Work, bring_up_to_date, exit_code, refuse_warned, show_results

# The dense matrices here have tens of rows: a second OpenBLAS thread doubles the time of rom and validate, and changes the
# last digits. Numpy reads this when it is first imported, inside the commands. PARDISO has its own threads.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

USAGE: Any = typer.BadParameter.__mro__[1]
"""Tokens that are not a command or option, in the version of click that this typer contains."""

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Place strain gauges on a finite-element model, and estimate loads, parameters and strains from their readings.",
)


@app.callback(invoke_without_command=True)
def about(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        import strainsight

        say(f"strainsight {strainsight.__version__}")
        raise typer.Exit


@app.command(help="Run every stage that is not up to date.")
@computing
def run(config: ConfigFile, options: RunOptions) -> None:
    loaded = pipelines.with_last_test(config, options.overrides, options.results)
    if loaded.data["kind"] == "suite":
        from strainsight_cli import suites

        # --jobs sets the number of parallel runs; otherwise the suite does, and the runs share the cores
        at_once = options.jobs or int(loaded.data["jobs"])
        where = replace(options.where, jobs=1 if options.jobs else max(1, cores() // at_once))
        works = suites.works_of(loaded, options.results, where)
        if options.dry_run:
            suites.show_suite(works, options.force, options.as_json, options.verbose)
        else:
            suites.run_suite(works, at_once, options.force, options.as_json, options.verbose)
        return
    work = replace(pipelines.work_of(loaded, options.results), where=options.where)
    names = [stage.name for stage in work.stages]
    _bring_up_to_date(work, options, forced=names, tables=names, summary=True)


@app.command(help="Show which stages are up to date, and why the others are not.")
def status(
    config: ConfigFile,
    results: Results = DEFAULT_RESULTS,
    as_json: Json = False,
    overrides: Set = None,
    verbose: Verbose = False,
) -> None:
    with reported(verbose):
        loaded = pipelines.with_last_test(config, overrides, results)
        if loaded.data["kind"] == "suite":
            from strainsight_cli import suites

            suites.show_suite(suites.works_of(loaded, results), False, as_json, verbose)
        else:
            show_plan(pipelines.work_of(loaded, results), (), as_json, verbose)


app.command(help="Copy an example into this folder, or list the examples.")(example)


app.command(help="Write a commented config for a deck.")(init)


@app.command(help="Check this machine: packages, solver, rendering, memory.")
def doctor(results: Results = DEFAULT_RESULTS, as_json: DoctorJson = False, verbose: Verbose = False) -> None:
    with reported(verbose):
        from strainsight_cli.doctor import examine, show

        raise typer.Exit(show(examine(results), as_json))


@app.command(help="Print the JSON Schema of a config.")
def schema() -> None:
    with reported():
        from strainsight.config.template import schema_text

        say(*schema_text().splitlines())


def _add_stage(name: str, what: str) -> None:
    @app.command(
        name, short_help=f"{what}.", help=f"{what}. Runs the previous stages first if they are not up to date."
    )
    @computing
    def command(config: ConfigFile, options: RunOptions) -> None:
        _one_stage(pipelines.work_of_one(config, options.results, options.overrides, name), name, options)


_IMPORTS = pipelines.STAGES["import"]


@app.command("import", short_help=f"{_IMPORTS}.", help=f"{_IMPORTS}, and print the model assumptions.")
@computing
def import_(
    config: ConfigFile,
    options: RunOptions,
    strict: Annotated[bool, typer.Option("--strict", help="Exit with code 2 if there is a warning.")] = False,
) -> None:
    work = pipelines.work_of_one(config, options.results, options.overrides, "import")
    _one_stage(work, "import", options)
    if strict and not options.dry_run:
        refuse_warned(work)


for _name, _what in pipelines.STAGES.items():
    if _name != "import":
        _add_stage(_name, _what)


app.command(
    "check-modes", help="Compare natural frequencies and mode shapes of another program with those of the deck."
)(check_modes)
app.command(help="Print a table of a finished run, or list its tables and files; nothing is computed.")(show)
app.command("view", help="Show results of a run in a window, or save them as a picture.")(view)
app.command("figures", help="Write the figures of the results page as SVG and PNG files, with their data as CSV.")(
    figures
)


@app.command(help="Estimate loads, parameters and strains from the measurements of a test.")
@computing
def estimate(
    config: ConfigFile,
    options: RunOptions,
    measurements: Annotated[
        Path | None,
        typer.Option(
            "--measurements",
            metavar="FILE",
            help="Measurement file of a test with one record (CSV, HDF5, UFF58, MDF4, TDMS, MAT), instead of "
            "estimate.file. Files of several records belong in the config, under estimate.records.",
        ),
    ] = None,
    allow_unobservable: Annotated[
        bool,
        typer.Option("--allow-unobservable", help="Continue even if the channels cannot distinguish all unknowns."),
    ] = False,
    page: Annotated[bool, typer.Option("--page/--no-page", help="Also write the results page test.html.")] = True,
    accept: Annotated[
        bool,
        typer.Option(
            "--accept",
            help="Report uncertainties even if the measurements are inconsistent with the model, and exit with code 0.",
        ),
    ] = False,
) -> None:
    from strainsight.config.keys import Override
    from strainsight.config.load import kind_of

    overrides: list[str | Override] = [*(options.overrides or ())]

    if measurements is not None and kind_of(config) == "bench":
        raise ConfigError(
            "--measurements is not supported for a bench",
            key="estimate.measured",
            where=str(config),
            remedy="set the file in the config, `estimate: {measured: {file: FILE, channels: …}}`, or use the simulated "
            "measurements of another run, `estimate: {measured: {from: RUN}}`",
        )
    if measurements is not None:
        if not measurements.is_file():
            sibling = config.parent / measurements
            remedy = f"The path of --measurements is relative to the current folder, {Path.cwd()}"
            if sibling.is_file():
                remedy = f"did you mean {sibling}? {remedy}"
            raise UserError("file not found", where=str(measurements), key="--measurements", remedy=remedy)
        # From the config's folder, as all paths of a config: no absolute path gets into the results.
        relative = os.path.relpath(measurements.resolve(), config.resolve().parent)
        overrides.append(Override("estimate.file", Path(relative).as_posix(), "--measurements"))
    if allow_unobservable:
        overrides.append("estimate.allow_unobservable=true")
    if accept:
        overrides.append("estimate.accept_inconsistent=true")
    work = pipelines.work_of_one(config, options.results, overrides, "estimate")
    if "estimate" not in [stage.name for stage in work.stages]:
        if work.job.config.get("estimate"):
            raise ConfigError(
                "the measurement file is missing",
                key="estimate.file",
                where=str(config),
                remedy="use --measurements FILE, or set `file` in the section `estimate`",
            )
        raise ConfigError(
            "the config has no section `estimate`",
            key="estimate",
            where=str(config),
            remedy="add a section `estimate: {channels: [{gauge: G1, channel: NAME, unit: um/m}]}` to the config "
            "(docs/estimation.md), and use --measurements FILE",
        )
    names = [stage.name for stage in work.stages]
    _one_stage(work, "estimate", options, "test" if page and "test" in names else "")


def _one_stage(work: Work, name: str, options: RunOptions, then: str = "") -> None:
    """Stages up to this one or a later one, and its tables."""
    last = [stage.name for stage in work.stages].index(then or name)
    upto = replace(work, stages=work.stages[: last + 1], where=options.where)
    _bring_up_to_date(upto, options, forced=[name], tables=[name])


def _bring_up_to_date(
    work: Work, options: RunOptions, forced: list[str], tables: list[str], summary: bool = False
) -> None:
    """Run what is not up to date (with --force also the stages `forced`); print one line per stage, then the tables of the stages
    named, or with `summary` the answers only (-v: tables and answers)."""
    forced = forced if options.force else []
    if options.dry_run:
        show_plan(work, forced, options.as_json, options.verbose)
        return
    with progress_bar(not options.as_json) as progress:
        artefacts = bring_up_to_date(work, forced, options.as_json, options.verbose, say, progress)
    if not options.as_json and (options.verbose or not summary):
        show_results(artefacts, tables)
    if not options.as_json and summary:
        print_summary(artefacts, work.job.folder)
    if code := exit_code(artefacts):
        raise typer.Exit(code)


def main() -> None:
    """Entry point of the console script."""
    # For this process, and for all that it or a library starts: no module and no plugin of the working folder.
    os.environ |= {SAFE_PATH: "1", "PYDANTIC_DISABLE_PLUGINS": "__all__"}
    prepare_streams()
    if refused := missing():
        say(*refused.split("\n"), error=True)
        raise SystemExit(USER)
    # Handed on to the processes that clear up after others when Ctrl-C has ended those: they must not report it.
    sys.warnoptions.append("ignore:resource_tracker")
    code: int | str | None = 0
    try:
        code = app(standalone_mode=False)
    except USAGE as error:
        usage = io.StringIO()
        error.show(usage)
        say(*usage.getvalue().rstrip("\n").split("\n"), error=True)
        code = error.exit_code
    except OSError as error:  # of what is printed outside of a command, as by --help
        code = tell(failure_of(error), verbose=False).exit_code
    if (text := unwritten()) and not code:
        say(*text.split("\n"), error=True)
        code = USER
    raise SystemExit(code)


if __name__ == "__main__":
    main()
