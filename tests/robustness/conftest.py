"""The small beam, what undisturbed runs make of it, and processes that can be killed."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from strainsight_cli.main import app

from ..shared import once
from .processes import Launcher
from .small import write_project


@pytest.fixture(scope="session")
def launcher(tmp_path_factory):
    """Starts commands quickly, for tests whose subject is the process; `--times` counts them at the end of the session."""
    with Launcher(tmp_path_factory.mktemp("scratch")) as started:
        yield started


@pytest.fixture(scope="session")
def project(tmp_path_factory) -> Path:
    """beam.yaml, a placement with all its stages, and bench.yaml, a bench with all of its own."""
    folder = tmp_path_factory.mktemp("project")
    write_project(folder)
    return folder


def of_project(project: Path) -> str:
    names = ("beam.yaml", "bench.yaml", "beam.bdf", "measured.csv")
    return "".join((project / name).read_text(encoding="utf-8") for name in names)


@pytest.fixture(scope="session")
def placed(project) -> Path:
    """Results of the beam as far as its placement, the same for all workers. Not to be written to."""

    def make(results: Path) -> None:
        done = CliRunner().invoke(app, ["place", str(project / "beam.yaml"), "--results", str(results)])
        assert done.exit_code == 0, done.output

    return once("placed", of_project(project), make)


@pytest.fixture(scope="session")
def undisturbed(project, launcher) -> Path:
    """Results of both by processes that nobody disturbed, the same for all workers. Not to be written to."""

    def make(results: Path) -> None:
        for name in ("beam", "bench"):
            launcher.start(["run", str(project / f"{name}.yaml"), "--results", str(results)], project / "says")
            assert launcher.end() == 0, (project / "says").read_text()

    return once("undisturbed", of_project(project), make)
