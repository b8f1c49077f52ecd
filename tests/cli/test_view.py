"""`strainsight view`: what it needs, what it refuses, the picture it writes."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image
from typer.testing import CliRunner

from strainsight_cli.main import app

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
