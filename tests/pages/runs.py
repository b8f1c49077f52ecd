"""Runs that the pages are of."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner

from strainsight_cli.main import app

from ..shared import made


def page_of(config: Path, results: Path, *overrides: str, name: str = "*") -> Path:
    """Run every stage of a config by the command line as a user has it; the page that comes of it.

    name: of the run, where there are several in `results`.
    """
    words = ["run", str(config), "--results", str(results)]
    done = CliRunner().invoke(app, [*words, *(word for value in overrides for word in ("--set", value))])
    assert done.exit_code == 0, done.output
    (page,) = results.glob(f"{name}/report.html")
    return page


def shared_page(config: Path, *overrides: str, beside: str = "") -> Path:
    """The page of a run that other tests look at as well (`made`)."""
    return made(config, *overrides, beside=beside)["report"].path.parent / "report.html"
