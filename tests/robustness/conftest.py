"""The small beam, what an undisturbed run makes of it, and processes that can be killed."""

from __future__ import annotations

from pathlib import Path

import pytest

from ..shared import once
from .processes import Launcher
from .small import write_project


@pytest.fixture(scope="session")
def launcher(tmp_path_factory):
    with Launcher(tmp_path_factory.mktemp("scratch")) as started:
        yield started


@pytest.fixture(scope="session")
def project(tmp_path_factory) -> Path:
    """beam.yaml, a placement with all its stages, and bench.yaml, a bench with all of its own."""
    folder = tmp_path_factory.mktemp("project")
    write_project(folder)
    return folder


@pytest.fixture(scope="session")
def undisturbed(project, launcher) -> Path:
    """Results of both that nobody disturbed, the same for all workers. Not to be written to."""

    def make(results: Path) -> None:
        for name in ("beam", "bench"):
            launcher.start(["run", str(project / f"{name}.yaml"), "--results", str(results)], project / "says")
            assert launcher.end() == 0, (project / "says").read_text()

    texts = [path.read_text(encoding="utf-8") for path in sorted(project.iterdir()) if path.suffix in (".yaml", ".bdf", ".csv")]
    return once("undisturbed", "".join(texts), make)
