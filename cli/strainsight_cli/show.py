"""`strainsight show`: tables and files of a finished run, without computing anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from strainsight.errors import UserError, did_you_mean, printable
from strainsight_cli import pipelines, render
from strainsight_cli.failures import reported
from strainsight_cli.options import DEFAULT_RESULTS, Results, Verbose
from strainsight_cli.printing import say

if TYPE_CHECKING:
    from strainsight.runner.artefact import Artefact
    from strainsight.runner.output import Table


def show(
    run: Annotated[str, typer.Argument(metavar="RUN|CONFIG", help="Folder or name of a run, or its config file.")],
    table: Annotated[
        str | None, typer.Argument(metavar="[TABLE]", help="Name of a table, or its beginning; default: list them.")
    ] = None,
    results: Results = DEFAULT_RESULTS,
    verbose: Verbose = False,
) -> None:
    with reported(verbose):
        artefacts = finished_stages(folder_of(run, results))
        if table is None:
            _list(artefacts)
        else:
            render.print_tables(tables_named(artefacts, table))


def folder_of(run: str, results: Path) -> Path:
    """Results folder of a run, given as folder, name or config."""
    path = Path(run)
    if path.is_file():
        return results / str(pipelines.loaded_config(path, ()).data["name"])
    return path if any(path.glob("*.h5")) else results / run


def finished_stages(folder: Path) -> list[Artefact]:
    """Artefacts of a results folder, in the order of the stages. Raises UserError without any."""
    from strainsight.runner.artefact import Artefact

    paths = [folder / f"{name}.h5" for name in (*pipelines.STAGES, "suite")]
    artefacts = [Artefact(path) for path in paths if path.is_file()]
    if not artefacts:
        raise UserError(
            "no results in this folder",
            where=str(folder),
            remedy="use the folder or config of a finished run, --results DIR for another results folder, or start the run "
            "with: strainsight run CONFIG",
        )
    return artefacts


def tables_named(artefacts: Sequence[Artefact], name: str) -> list[Table]:
    """Tables with this name, or with the only name that begins so. Raises UserError for none and for several names."""
    tables = [(artefact, table) for artefact in artefacts for table in artefact.tables]
    names = list(dict.fromkeys(table.name for _, table in tables))
    matching = [each for each in names if each.lower().startswith(name.lower())]
    if name.lower() in (each.lower() for each in matching):
        matching = [each for each in matching if each.lower() == name.lower()]
    if len(matching) != 1:
        what = f"several tables begin with '{name}'" if matching else f"the run has no table '{name}'"
        listed = ", ".join(matching or names)
        raise UserError(
            what, where=str(artefacts[0].path.parent), remedy=did_you_mean(name, names, f"use one of: {listed}")
        )
    chosen = [(artefact, table) for artefact, table in tables if table.name == matching[0]]
    if len(chosen) == 1:
        return [chosen[0][1]]
    return [replace(table, title=f"{table.title} ({artefact.header.stage})") for artefact, table in chosen]


def _list(artefacts: Sequence[Artefact]) -> None:
    from rich.text import Text

    rows = [
        (artefact.header.stage, table.name, str(len(table.rows))) for artefact in artefacts for table in artefact.tables
    ]
    render.print_grid(("stage", "table", "rows"), [[Text(printable(cell)) for cell in row] for row in rows], right=(2,))
    files = [str(artefact.path.parent / name) for artefact in artefacts for name in artefact.header.side_files or {}]
    say("", *files)
