"""Arguments and options common to several commands."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

import typer

from strainsight.runner.sweep_location import Where
from strainsight_cli.failures import saying

ConfigFile = Annotated[
    Path, typer.Argument(metavar="CONFIG", help="Config file; create one with `strainsight init DECK`.")
]
Force = Annotated[bool, typer.Option("--force", help="Run the stage even if it is up to date (`run`: every stage).")]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="Print the stages that would run, with the reasons; write nothing.")
]
Results = Annotated[
    Path, typer.Option("--results", metavar="DIR", help="Results folder.", callback=lambda folder: _no_link(folder))
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object per stage.")]
DoctorJson = Annotated[bool, typer.Option("--json", help="Print one JSON object per check.")]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override of a config key, as in --set place.keep=6."),
]
Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="Print all tables, reasons to run, and tracebacks.")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Print errors only; run.log contains the rest.")]
LogLevel = Annotated[
    Literal["error", "warning", "info", "debug"] | None,
    typer.Option("--log-level", help="Level of the printed messages; default: info. -q is error, -v is debug."),
]
Jobs = Annotated[
    int | None,
    typer.Option(
        "--jobs",
        min=1,
        metavar="N",
        help="Number of parallel processes for independent computations (docs/scaling.md); default: one per core. For a "
        "suite: number of parallel runs; default: `jobs` in its config.",
    ),
]
Dask = Annotated[
    str | None,
    typer.Option(
        "--dask",
        metavar="ADDRESS",
        help="Trusted Dask scheduler whose workers run independent computations (docs/scaling.md).",
    ),
]
DEFAULT_RESULTS = Path("results")


def _no_link(folder: Path) -> Path:
    """The results folder; the default folder may be a link only if the user names its target."""
    if folder == DEFAULT_RESULTS and folder.is_symlink():
        target = os.readlink(folder)
        raise typer.BadParameter(
            f"the results folder {folder} is a link to {target}; to write there, use --results {shlex.quote(target)}"
        )
    return folder


@dataclass(frozen=True)
class RunOptions:
    """Options of all commands that compute."""

    force: Force = False
    dry_run: DryRun = False
    results: Results = DEFAULT_RESULTS
    as_json: Json = False
    overrides: Set = None
    jobs: Jobs = None
    dask: Dask = None
    verbose: Verbose = False
    quiet: Quiet = False
    log_level: LogLevel = None

    @property
    def where(self) -> Where:
        """Where sweeps run."""
        return Where(self.jobs, self.dask)


def computing(command: Callable[..., None]) -> Callable[..., None]:
    """A command with the options of `RunOptions` after its own; it receives them as `options` and prints at their level."""
    hints = get_type_hints(RunOptions, include_extras=True)
    shared = [
        Parameter(f.name, Parameter.KEYWORD_ONLY, default=f.default, annotation=hints[f.name])
        for f in fields(RunOptions)
    ]
    others = [p for p in signature(command, eval_str=True).parameters.values() if p.name != "options"]

    @wraps(command)
    def run(**arguments: Any) -> None:
        options = RunOptions(**{name: arguments.pop(name) for name in hints})
        with saying(options.quiet, options.verbose, options.log_level, options.as_json or options.dry_run) as verbose:
            command(**arguments, options=replace(options, verbose=verbose))

    run.__signature__ = Signature([*(p.replace(kind=Parameter.KEYWORD_ONLY) for p in others), *shared])  # type: ignore[attr-defined]
    run.__annotations__ = {p.name: p.annotation for p in (*others, *shared)}
    return run
