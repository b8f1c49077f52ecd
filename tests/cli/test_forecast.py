"""The line that says beforehand how long it takes: not before the size is known, and not where nothing is left to do."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from strainsight import memory
from strainsight.records.mesh import MeshColumns
from strainsight.records.record import written
from strainsight.workflow.artefact import Header
from strainsight.workflow.output import Output
from strainsight.workflow.store import write_artefact
from strainsight_cli.forecast import size_in
from strainsight_cli.main import app

from ..mesh.test_shell_faces import plate, strip
from ..robustness.small import write_project


@pytest.fixture
def call(tmp_path):
    write_project(tmp_path)
    words = (str(tmp_path / "beam.yaml"), "--results", str(tmp_path / "results"))
    return lambda command, *more: CliRunner().invoke(app, [command, *words, *more])


FORECAST = "forecast: modes 1 s, rom 1 s, place 4 s and spectrum 1 s for 246 unknowns, 0.15 GiB, processor time and memory"


def lines(result) -> list[str]:
    assert result.exit_code == 0, result.output
    return [line for line in result.output.splitlines() if line.startswith("forecast")]


def test_the_size_is_known_after_the_import_and_what_is_done_has_no_line(call, monkeypatch):
    assert lines(call("run", "--dry-run")) == [
        "forecast: the deck has 0.0 MB; time and memory are known once it is imported"
    ]
    assert lines(call("import")) == []
    (line,) = lines(call("run", "--dry-run"))
    assert line.startswith(FORECAST)
    monkeypatch.setattr(memory, "available_memory", lambda: 0.1 * 2**30)
    (line,) = lines(call("run", "--dry-run"))
    assert line.endswith("; 0.1 GiB are there: take a coarser mesh or a larger machine")
    monkeypatch.undo()
    (line,) = lines(call("run", "--dry-run", "--set", "solver=slepc"))
    assert line.startswith("forecast: place 4 s for 246 unknowns")
    (line,) = lines(call("modes"))
    assert line.startswith("forecast: modes 1 s for 246 unknowns")
    assert lines(call("modes")) == lines(call("modes", "--force", "--json")) == []


def test_nodes_of_shells_count_with_their_rotations_and_those_on_their_faces_do_not(tmp_path):
    mesh = plate(*strip())
    output = Output(written(MeshColumns.of(mesh)), {}, "toy")
    imported = write_artefact(tmp_path / "import.h5", output, Header("import", 1, "key", {}, {}, {}))
    assert size_in(imported).unknowns == 6 * 6
