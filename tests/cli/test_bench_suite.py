"""A suite of benches from the command line: two pendulums, what is claimed of them, and the page."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest
from typer.testing import CliRunner

from strainsight.workflow.artefact import Artefact
from strainsight_cli.main import app

PENDULUM = """\
kind: bench
name: pendulum
bodies:
  bob: {type: rigid, mass: 2.0, inertia: {xx: 0.1, yy: 0.1, zz: 0.1}, pose: {origin: [0.1, 0, -1.0]}}
frames:
  pivot: {body: ground, pose: {x_axis: [0, 1, 0], y_axis: [1, 0, 0]}}
  hinge: {body: bob, pose: {origin: [-0.1, 0, 1.0], x_axis: [0, 1, 0], y_axis: [1, 0, 0]}}
  centre: {body: bob}
joints:
  hinge: {type: revolute, frames: [pivot, hinge], axis: x}
forces:
  weight: {type: gravity}
  push: {type: force, frame: centre, direction: [1, 0, 0], signal: {type: sine, amplitude: 2.0, frequency: 1.0}}
sensors:
  centre: {type: motion, frame: centre}
simulate: {duration: 0.5, time_step: 0.01, start: as_given}
"""
SUITE = """\
kind: suite
name: both
title: Two <pendulums>
runs:
  - {config: pendulum.yaml, name: coarse, label: coarse & quick, study: Steps, until: simulate, set: {simulate.time_step: 0.05}}
  - {config: pendulum.yaml, name: fine, label: fine, study: Steps, until: simulate, note: Takes longer.}
studies:
  - {name: Steps, over: simulate.time_step}
claims:
  - {text: The joint holds., run: [coarse, fine], stage: simulate, number: violation, below: 1.0e-12}
  - {text: Fine takes ten times the steps., run: fine, stage: simulate, number: steps, against: coarse, above: 9, below: 11}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("benches")
    (folder / "pendulum.yaml").write_text(PENDULUM, encoding="utf-8")
    (folder / "both.yaml").write_text(SUITE, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def call(folder):
    def called(*words: str):
        return CliRunner().invoke(
            app, [words[0], str(folder / "both.yaml"), *words[1:], "--results", str(folder / "r")]
        )

    return called


@pytest.fixture(scope="module")
def first(call):
    done = call("run")
    assert done.exit_code == 0, done.output
    return done.output


def test_runs_claims_and_times_are_reported(first, folder):
    for heading in ("run 1 of 2 coarse", "run 2 of 2 fine", "suite both"):
        assert heading in first.splitlines()
    statement = next(line for line in first.splitlines() if line.startswith("Fine takes"))
    assert " ".join(statement.split()) == "Fine takes ten times the steps. 9 to 11 5 contradicted"
    assert "where the time goes" in first
    suite = Artefact(folder / "r" / "both" / "suite.h5")
    assert suite["/claim/verdict"].tolist() == ["confirmed", "contradicted"]
    page = (folder / "r" / "both" / "report.html").read_text(encoding="utf-8")
    assert "<pendulums>" not in page
    assert "coarse &amp; quick" in page
    assert "Takes longer." in page


def test_then_it_is_up_to_date_and_another_bound_writes_the_page_only(first, call):
    assert " done " not in call("run").output
    lines = call("status", "--set", "claims.1.above=4").output.splitlines()
    assert [line.split()[0] for line in lines if "will run" in line] == ["suite"]


def test_a_number_that_no_run_has_is_named_with_its_line(first, call):
    done = call("run", "--set", "claims.0.number=violations")
    assert done.exit_code == 2
    assert (
        "--set claims.0.number  claims.0.number: no number 'violations' in the stage 'simulate' of 'coarse'"
        in done.stderr
    )
    assert "did you mean violation?" in done.stderr


def test_a_stage_that_a_run_does_not_come_to_is_found_before_anything_runs(call):
    done = call("status", "--set", "claims.0.stage=estimate")
    assert done.exit_code == 2
    assert "runs[0], 'coarse', has no stage 'estimate'" in done.stderr


def test_a_key_of_a_bench_behind_set_is_placed_there(call):
    assert "write set.simulate.duration=1" in call("status", "--set", "simulate.duration=1").stderr


def test_a_suite_that_was_killed_goes_on_where_it_ended(folder):
    """Killed between two runs, without a word: what was finished is taken as it is, what was begun is done again."""
    results, words = folder / "killed", ["run", str(folder / "both.yaml"), "--results"]
    whole = results / "coarse" / "simulate.h5"
    child = subprocess.Popen([sys.executable, "-m", "strainsight_cli.main", *words, str(results)], stdout=subprocess.DEVNULL)
    while not whole.exists() and child.poll() is None:
        time.sleep(0.005)
    child.kill()
    child.wait()
    assert not (results / "both" / "suite.h5").exists()
    before = whole.stat().st_mtime_ns
    done = CliRunner().invoke(app, [*words, str(results)])
    assert done.exit_code == 0, done.output
    assert whole.stat().st_mtime_ns == before
    assert Artefact(results / "both" / "suite.h5").header.stage == "suite"
    coarse = done.output.split("run 1 of 2 coarse")[1].split("run 2 of 2")[0]
    assert "up to date" in coarse
