"""The small beam, what an undisturbed run makes of it, and processes that can be killed."""

from __future__ import annotations

from pathlib import Path

import pytest

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
    """Results of both that nobody disturbed. Not to be written to."""
    results = project / "undisturbed"
    for name in ("beam", "bench"):
        launcher.start(["run", str(project / f"{name}.yaml"), "--results", str(results)], project / "says")
        assert launcher.end() == 0, (project / "says").read_text()
    return results
