"""`strainsight figures`: what has to have run, and what it refuses."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner

from strainsight_cli.main import app

ROOT = Path(__file__).parents[2]


def said(done) -> str:
    return done.output + (done.stderr or "")


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
