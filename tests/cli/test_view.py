"""`view`, `figures` and the forecast of a run: what they need, what they refuse, what they write."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image
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

ROOT = Path(__file__).parents[2]
CONFIG = str(ROOT / "configs" / "cantilever-youngs-modulus.yaml")


@pytest.fixture
def call(tmp_path):
    def called(*words: str):
        return CliRunner().invoke(app, [*words, "--results", str(tmp_path / "results")])

    return called


def said(done) -> str:
    return done.output + (done.stderr or "")


def test_before_anything_has_run_it_says_what_to_run_and_writes_nothing(call, tmp_path):
    for words in ((), ("--what", "modes")):
        done = call("view", CONFIG, *words, "--screenshot", str(tmp_path / "a.png"))
        assert done.exit_code == 2
        assert "run first: strainsight" in said(done)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_after_import_the_mesh_is_pictured_and_a_changed_config_is_reported(call, tmp_path):
    assert call("import", CONFIG).exit_code == 0
    picture = tmp_path / "mesh.png"
    done = call("view", CONFIG, "--screenshot", str(picture))
    assert done.exit_code == 0, said(done)
    assert "640 elements" in done.output
    assert "older than the config" not in said(done)
    with Image.open(picture) as image:
        assert image.size == (1400, 900)
    # the validation's units do not matter to the mesh, those of the deck do
    changed = call("view", CONFIG, "--set", "mesh.length_unit=mm", "--screenshot", str(picture))
    assert changed.exit_code == 0, said(changed)
    assert "older than the config" in said(changed)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--screenshot", "a.jpg"), "ends in .png"),
        (("--screenshot", "none/a.png"), "no such folder"),
        (("--what", "stress"), "'field'"),
        (("--body", "hub"), "one body"),
    ],
)
def test_what_cannot_be_is_refused_with_exit_code_2(call, words, text):
    done = call("view", CONFIG, *words)
    assert done.exit_code == 2
    assert text in said(done)


def test_suites_and_bearings_have_no_picture(call):
    done = call("view", str(ROOT / "configs" / "bench" / "suite.yaml"))
    assert done.exit_code == 2
    assert "one of its runs" in said(done)


def test_before_a_run_it_says_what_to_run_and_writes_nothing(tmp_path):
    config = str(ROOT / "configs" / "cantilever-youngs-modulus.yaml")
    done = CliRunner().invoke(app, ["figures", config, "--results", str(tmp_path)])
    assert done.exit_code == 2
    assert f"run first: strainsight run {config}" in said(done)
    assert list(tmp_path.iterdir()) == []


def test_a_suite_has_none_of_its_own(tmp_path):
    suite = str(ROOT / "configs" / "bench" / "suite.yaml")
    done = CliRunner().invoke(app, ["figures", suite, "--results", str(tmp_path)])
    assert done.exit_code == 2
    assert "one of its runs" in said(done)


@pytest.fixture
def forecast_call(tmp_path):
    write_project(tmp_path)
    words = (str(tmp_path / "beam.yaml"), "--results", str(tmp_path / "results"))
    return lambda command, *more: CliRunner().invoke(app, [command, *words, *more])


FORECAST = "forecast: modes 1 s, rom 1 s, place 4 s and spectrum 1 s for 246 unknowns, 0.15 GiB, processor time and memory"


def lines(result) -> list[str]:
    assert result.exit_code == 0, result.output
    return [line for line in result.output.splitlines() if line.startswith("forecast")]


def test_the_size_is_known_after_the_import_and_what_is_done_has_no_line(forecast_call, monkeypatch):
    assert lines(forecast_call("run", "--dry-run")) == [
        "forecast: the deck has 0.0 MB; time and memory are known once it is imported"
    ]
    assert lines(forecast_call("import")) == []
    (line,) = lines(forecast_call("run", "--dry-run"))
    assert line.startswith(FORECAST)
    monkeypatch.setattr(memory, "available_memory", lambda: 0.1 * 2**30)
    (line,) = lines(forecast_call("run", "--dry-run"))
    assert line.endswith("; 0.1 GiB are there: take a coarser mesh or a larger machine")
    monkeypatch.undo()
    (line,) = lines(forecast_call("run", "--dry-run", "--set", "solver=slepc"))
    assert line.startswith("forecast: place 4 s for 246 unknowns")
    (line,) = lines(forecast_call("modes"))
    assert line.startswith("forecast: modes 1 s for 246 unknowns")
    assert lines(forecast_call("modes")) == lines(forecast_call("modes", "--force", "--json")) == []


def test_nodes_of_shells_count_with_their_rotations_and_those_on_their_faces_do_not(tmp_path):
    mesh = plate(*strip())
    output = Output(written(MeshColumns.of(mesh)), {}, "toy")
    imported = write_artefact(tmp_path / "import.h5", output, Header("import", 1, "key", {}, {}, {}))
    assert size_in(imported).unknowns == 6 * 6
