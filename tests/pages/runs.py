"""Runs that the pages are of, by the command line as a user has it."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner

from strainsight_cli.main import app

ROOT = Path(__file__).parents[2]
SHORT = (
    "train.duration=0.2",
    "place.instants=3",
    "validate.duration=0.2",
    "validate.random_sets=2",
    "validate.repeats=2",
    "validate.truth.modes=20",
)
"""A placement, shortened where length does not matter to its page."""


def page_of(config: Path, results: Path, *overrides: str, name: str = "*") -> Path:
    """Run every stage of a config; the page that comes of it. name: of the run, where there are several in `results`."""
    words = ["run", str(config), "--results", str(results)]
    done = CliRunner().invoke(app, [*words, *(word for value in overrides for word in ("--set", value))])
    assert done.exit_code == 0, done.output
    (page,) = results.glob(f"{name}/report.html")
    return page
