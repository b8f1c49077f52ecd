"""strainsight: from a finite-element mesh to a certified layout of strain gauges."""

from __future__ import annotations

import io
import os
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from strainsight.processes import SAFE_PATH
from strainsight.runner.where import Where
from strainsight_cli import pipelines
from strainsight_cli.bar import progress_bar
from strainsight_cli.check_modes import check_modes
from strainsight_cli.example import example
from strainsight_cli.failures import USER, failure_of, reported, saying, tell
from strainsight_cli.options import (
    DEFAULT_RESULTS,
    ConfigFile,
    Dask,
    DoctorJson,
    DryRun,
    Force,
    Jobs,
    Json,
    LogLevel,
    Quiet,
    Results,
    Set,
    Verbose,
)
from strainsight_cli.printing import missing, prepare_streams, say, unwritten
from strainsight_cli.status import show_plan
from strainsight_cli.view import figures, view
from strainsight_cli.work import Work, bring_up_to_date, exit_code, refuse_warned, show_results

# The dense matrices here have tens of rows: a second OpenBLAS thread doubles the time of rom and validate, and changes the
# last digits. Numpy reads this when it is first imported, inside the commands. PARDISO has its own threads.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

USAGE: Any = typer.BadParameter.__mro__[1]
"""Words that are no command or option; of the click that this typer brings."""

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Where to bond strain gauges on a finite-element model, what they will let you know, and how well.",
)


@app.callback(invoke_without_command=True)
def about(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        import strainsight

        say(f"strainsight {strainsight.__version__}")
        raise typer.Exit


@app.command(help="Run every stage that is not up to date.")
def run(
    config: ConfigFile,
    force: Force = False,
    dry_run: DryRun = False,
    results: Results = DEFAULT_RESULTS,
    as_json: Json = False,
    overrides: Set = None,
    jobs: Jobs = None,
    dask: Dask = None,
    verbose: Verbose = False,
    quiet: Quiet = False,
    log_level: LogLevel = None,
) -> None:
    with saying(quiet, verbose, log_level, as_json or dry_run) as verbose:
        loaded = pipelines.with_last_test(config, overrides, results)
        if loaded.data["kind"] == "suite":
            from strainsight_cli import suites

            at_once, where = suites.shared_out(loaded, jobs, dask)
            works = suites.works_of(loaded, results, where)
            if dry_run:
                suites.show_suite(works, force, as_json, verbose)
            else:
                suites.run_suite(works, at_once, force, as_json, verbose)
            return
        work = replace(pipelines.work_of(loaded, results), where=Where(jobs, dask))
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
        loaded = pipelines.with_last_test(config, overrides, results)
        if loaded.data["kind"] == "suite":
            from strainsight_cli import suites

            suites.show_suite(suites.works_of(loaded, results), False, as_json, verbose)
        else:
            show_plan(pipelines.work_of(loaded, results), (), as_json, verbose)


app.command(help="Write an example that runs as it stands into this folder, or list them.")(example)


@app.command(help="Write a commented config for your own deck.")
def init(
    deck: Annotated[Path, typer.Argument(metavar="DECK", help="Finite-element deck.")],
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE", help="Config to write.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file.")] = False,
    interactive: Annotated[
        bool, typer.Option("-i", "--interactive", help="Ask in the terminal for what only you know.")
    ] = False,
    find: Annotated[
        Literal["modulus", "load"] | None,
        typer.Option("--find", help="The modulus from a measured load (default), or the load."),
    ] = None,
    material: Annotated[
        str | None,
        typer.Option("--material", help="For a deck without: steel, aluminium, titanium, or 'E, ν, ρ' in SI."),
    ] = None,
    held: Annotated[
        str | None,
        typer.Option("--held", help="For a deck without supports: 'set NAME', 'node ID', or 'x, y, z' [m] of a face."),
    ] = None,
    load: Annotated[
        str | None, typer.Option("--load", help="Where the load acts: as --held, or 'deck_load NAME'.")
    ] = None,
    direction: Annotated[str | None, typer.Option("--direction", help="Of the load, 'x, y, z'.")] = None,
    amplitude: Annotated[str | None, typer.Option("--amplitude", help="Of the load [N].")] = None,
    frequency: Annotated[str | None, typer.Option("--frequency", help="Of the load [Hz].")] = None,
    axis: Annotated[
        str | None, typer.Option("--axis", help="Along which gauges point, 'x, y, z'; default: what strains most.")
    ] = None,
    keep: Annotated[int, typer.Option("--keep", min=1, help="Gauges to bond.")] = 4,
    verbose: Verbose = False,
) -> None:
    with reported(verbose):
        from strainsight.config.answers import Answers
        from strainsight.config.template import template
        from strainsight.errors import UserError

        if not deck.is_file():
            raise UserError("no such deck", where=str(deck), remedy="give the path of a finite-element deck")
        if deck.suffix.lower() in (".yaml", ".yml"):
            raise UserError(
                "a config, not a deck",
                where=str(deck),
                remedy=f"to compute it: strainsight run {shlex.quote(str(deck))}; for a new one give the deck",
            )
        target = output or Path(f"{Path(deck.name.removesuffix('.gz')).stem}.yaml")
        if os.path.lexists(target) and not force:
            raise UserError("the file exists", where=str(target), remedy="give another one with -o FILE, or --force")
        from strainsight.config.load import load_config
        from strainsight.errors import ConfigError
        from strainsight.stages.suggestion import suggestion
        from strainsight.writing import write_file
        from strainsight_cli import asking

        relative = Path(os.path.relpath(deck.resolve(), target.resolve().parent)).as_posix()
        found = suggestion(deck)
        answers = Answers(
            material=asking.material("--material", material) if material else None,
            held=asking.support("--held", held, found) if held else None,
            load=asking.place("--load", load, found) if load else None,
            direction=asking.direction("--direction", direction) if direction else None,
            amplitude=asking.positive("--amplitude", amplitude) if amplitude else None,
            frequency=asking.positive("--frequency", frequency) if frequency else None,
            find=find or "modulus",
            axis=asking.direction("--axis", axis) if axis else None,
            keep=keep,
        )
        asking.checked(found, answers)
        if interactive:
            answers = asking.asked(found, answers, find=find is not None)
            if answers.spc is not None:
                found = suggestion(deck, answers.spc)
        target.parent.mkdir(parents=True, exist_ok=True)
        write_file(target, template(relative, found, answers).encode())
        try:
            load_config(target)
        except ConfigError:
            first = "fill in what is blank and check the other lines marked ←"
        else:
            first = "check the lines marked ←"
        if not found.solids:
            nothing = "the deck has nothing to bond gauges on (solids, shells, sides of beams)"
            first = f"{nothing}, unless mesh.matrices and gauges.given state it; {first}"
        say(f"wrote {target}: {first}, then: strainsight run {shlex.quote(str(target))}")


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
        name, short_help=f"{what}.", help=f"{what}. Runs the stages above first where they are not up to date."
    )
    def command(
        config: ConfigFile,
        force: Force = False,
        dry_run: DryRun = False,
        results: Results = DEFAULT_RESULTS,
        as_json: Json = False,
        overrides: Set = None,
        jobs: Jobs = None,
        dask: Dask = None,
        verbose: Verbose = False,
        quiet: Quiet = False,
        log_level: LogLevel = None,
    ) -> None:
        with saying(quiet, verbose, log_level, as_json or dry_run) as verbose:
            work = replace(pipelines.work_of_one(config, results, overrides, name), where=Where(jobs, dask))
            _one_stage(work, name, force, dry_run, as_json, verbose)


_IMPORTS = pipelines.STAGES["import"]


@app.command("import", short_help=f"{_IMPORTS}.", help=f"{_IMPORTS}, and say what the model assumes.")
def import_(
    config: ConfigFile,
    strict: Annotated[bool, typer.Option("--strict", help="End with 2 where there is a warning.")] = False,
    force: Force = False,
    dry_run: DryRun = False,
    results: Results = DEFAULT_RESULTS,
    as_json: Json = False,
    overrides: Set = None,
    jobs: Jobs = None,
    dask: Dask = None,
    verbose: Verbose = False,
    quiet: Quiet = False,
    log_level: LogLevel = None,
) -> None:
    with saying(quiet, verbose, log_level, as_json or dry_run) as verbose:
        work = replace(pipelines.work_of_one(config, results, overrides, "import"), where=Where(jobs, dask))
        _one_stage(work, "import", force, dry_run, as_json, verbose)
        if strict and not dry_run:
            refuse_warned(work)


for _name, _what in pipelines.STAGES.items():
    if _name != "import":
        _add_stage(_name, _what)


app.command("check-modes", help="Compare natural frequencies and shapes of another program with those of the deck.")(
    check_modes
)
app.command("view", help="Show what a run has computed, in a window or as a picture.")(view)
app.command("figures", help="Write the figures of a run's page as SVG and PNG files, with their numbers as CSV.")(
    figures
)


@app.command(help="Estimate loads, parameters and strains from the measurements of a test.")
def estimate(
    config: ConfigFile,
    measurements: Annotated[
        Path | None,
        typer.Option(
            "--measurements",
            metavar="FILE",
            help="File of a test in one record (CSV, HDF5, UFF58, MDF4, TDMS, MAT), in place of estimate.file; the files of "
            "estimate.records stand in the config.",
        ),
    ] = None,
    allow_unobservable: Annotated[
        bool, typer.Option("--allow-unobservable", help="Go on where the channels cannot tell all unknowns.")
    ] = False,
    page: Annotated[bool, typer.Option("--page/--no-page", help="Write test.html, too.")] = True,
    accept: Annotated[
        bool,
        typer.Option(
            "--accept", help="Report σ even if the measurements are inconsistent with the model, and end with 0."
        ),
    ] = False,
    force: Force = False,
    dry_run: DryRun = False,
    results: Results = DEFAULT_RESULTS,
    as_json: Json = False,
    overrides: Set = None,
    jobs: Jobs = None,
    dask: Dask = None,
    verbose: Verbose = False,
    quiet: Quiet = False,
    log_level: LogLevel = None,
) -> None:
    with saying(quiet, verbose, log_level, as_json or dry_run) as verbose:
        from strainsight.config.keys import Override
        from strainsight.config.load import kind_of
        from strainsight.errors import ConfigError, UserError

        asked: list[str | Override] = [*(overrides or ())]

        if measurements is not None and kind_of(config) == "bench":
            raise ConfigError(
                "--measurements is of the estimate of a structure",
                key="estimate.measured",
                where=str(config),
                remedy="name the file in the config of the bench, `estimate: {measured: {file: FILE, channels: …}}`, or another "
                "run, `{measured: {from: RUN}}`",
            )
        if measurements is not None:
            if not measurements.is_file():
                beside = config.parent / measurements
                remedy = f"--measurements starts from the folder that you are in, {Path.cwd()}"
                if beside.is_file():
                    remedy = f"did you mean {beside}? {remedy}"
                raise UserError("no such file", where=str(measurements), key="--measurements", remedy=remedy)
            # From the config's folder, as all paths of a config: no absolute path gets into the results.
            relative = os.path.relpath(measurements.resolve(), config.resolve().parent)
            asked.append(Override("estimate.file", Path(relative).as_posix(), "--measurements"))
        if allow_unobservable:
            asked.append("estimate.allow_unobservable=true")
        if accept:
            asked.append("estimate.accept=true")
        work = pipelines.work_of_one(config, results, asked, "estimate")
        if "estimate" not in [stage.name for stage in work.stages]:
            raise ConfigError(
                "no measurements to estimate from",
                key="estimate",
                where=str(config),
                remedy="add a section `estimate: {channels: [{gauge: G1, channel: NAME, unit: um/m}]}` to the config "
                "(docs/estimation.md), and give --measurements FILE",
            )
        names = [stage.name for stage in work.stages]
        then = "test" if page and "test" in names else ""
        _one_stage(replace(work, where=Where(jobs, dask)), "estimate", force, dry_run, as_json, verbose, then)


def _one_stage(work: Work, name: str, force: bool, dry_run: bool, as_json: bool, verbose: bool, then: str = "") -> None:
    """The stages up to this one, or one that comes after it, and its tables."""
    last = [stage.name for stage in work.stages].index(then or name)
    upto = replace(work, stages=work.stages[: last + 1])
    _bring_up_to_date(upto, [name] if force else [], dry_run, as_json, verbose, tables=[name])


def _bring_up_to_date(
    work: Work, forced: list[str], dry_run: bool, as_json: bool, verbose: bool, tables: list[str]
) -> None:
    """Run what is not up to date; print a line a stage and, at the end, the tables of the stages named."""
    if dry_run:
        show_plan(work, forced, as_json, verbose)
        return
    with progress_bar(not as_json) as progress:
        artefacts = bring_up_to_date(work, forced, as_json, verbose, say, progress)
    if not as_json:
        show_results(artefacts, tables)
    if code := exit_code(artefacts):
        raise typer.Exit(code)


def main() -> None:
    """Console script."""
    # For this process, and for all that it or a library starts: no module and no plugin of the working folder.
    os.environ |= {SAFE_PATH: "1", "PYDANTIC_DISABLE_PLUGINS": "__all__"}
    prepare_streams()
    if refused := missing():
        say(*refused.split("\n"), error=True)
        raise SystemExit(USER)
    # Handed on to the processes that clear up after others when Ctrl-C has ended those: they need not speak of it.
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
