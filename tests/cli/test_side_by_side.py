"""Two runs of a suite at a time: the same numbers as one after the other, nothing computed twice, failures named."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from strainsight.runner.artefact import Artefact
from strainsight_cli.main import app

from ..robustness import small

pytestmark = pytest.mark.slow

SUITE = """
kind: suite
name: three
title: Three runs
jobs: 2
set: {estimate: null, filter.compare: false}
runs:
  - {config: beam.yaml, label: "E", name: first, until: validate}
  - {config: beam.yaml, label: "two gauges", name: second, until: place, set: {place.keep: 2}}
  - {config: beam.yaml, label: "again", name: third, until: validate, set: {parameters.E.guess: {from: first}}}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("jobs")
    small.write_project(folder)
    (folder / "three.yaml").write_text(SUITE, encoding="utf-8")
    return folder


def run(folder: Path, results: str, *options: str):
    return CliRunner().invoke(app, ["run", str(folder / "three.yaml"), "--results", str(folder / results), *options])


@pytest.fixture(scope="module")
def together(folder) -> str:
    done = run(folder, "together", "-v")
    assert done.exit_code == 0, done.output
    return done.output


def test_every_number_is_that_of_one_run_after_the_other(folder, together):
    alone = run(folder, "alone", "--set", "jobs=1")
    assert alone.exit_code == 0, alone.output
    found = sorted(path.relative_to(folder / "alone") for path in (folder / "alone").glob("*/*.h5"))
    assert len(found) == 9 + 7 + 9 + 1
    for path in found:
        assert Artefact(folder / "together" / path).digest == Artefact(folder / "alone" / path).digest


def test_common_stages_are_computed_once(together):
    table = together.split("run time [s]")[1].splitlines()
    first, second = (next(line for line in table if f" {name} " in line) for name in ("first", "second"))
    assert first.count("↩") + second.count("↩") == 6
