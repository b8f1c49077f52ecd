"""A suite from the command line: its runs, its page, what is said when one fails, and where the time went."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from strainsight.config.load import load_config
from strainsight.errors import ConfigError
from strainsight.runner.artefact import Artefact
from strainsight_cli.main import app
from strainsight_cli.suites import works_of
from strainsight_cli.work import makers

CONFIGS = Path(__file__).parents[2] / "configs"
CONFIG = CONFIGS / "cantilever-youngs-modulus.yaml"
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
    folder = tmp_path_factory.mktemp("suite")
    (folder / "pendulum.yaml").write_text(PENDULUM, encoding="utf-8")
    (folder / "both.yaml").write_text(SUITE, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def call(folder):
    """A function: a command and more words → how it ended on the suite of two benches."""

    def called(command: str, *words: str):
        return CliRunner().invoke(app, [command, str(folder / "both.yaml"), *words, "--results", str(folder / "results")])

    return called


@pytest.fixture(scope="module")
def first(call):
    """What the first run prints, before any other test."""
    before = call("status")
    assert before.exit_code == 0
    assert before.output.count("will run") == before.output.count("never run") == 2 * 3 + 1
    assert call("run", "--dry-run").output == before.output
    done = call("run", "-v")
    assert done.exit_code == 0, done.output
    return done.output


def test_suite_prints_runs_claims_and_times(first, folder):
    for heading in ("run 1 of 2 coarse", "run 2 of 2 fine", "suite both"):
        assert heading in first.splitlines()
    statement = next(line for line in first.splitlines() if line.startswith("Fine takes"))
    assert " ".join(statement.split()) == "Fine takes ten times the steps. 9 to 11 5 contradicted"
    head, *rows, total = (line.split() for line in first.split("run time [s]")[1].splitlines()[1:6])
    assert (head[0], head[-1]) == ("run", "all")
    assert float(total[-1]) == pytest.approx(sum(float(row[-1]) for row in rows), abs=0.2)
    assert Artefact(folder / "results" / "both" / "suite.h5")["/claim/verdict"].tolist() == ["confirmed", "contradicted"]


def test_suite_ends_with_its_claims_in_at_most_30_lines(first, call, folder):
    last = call("run").output.split("suite both\n")[1].splitlines()
    assert len(last) <= 30
    assert [line.split()[-1] for line in last if line.startswith(("The joint", "Fine"))] == ["confirmed", "contradicted"]
    assert f"report: {folder / 'results' / 'both' / 'report.html'}" in last
    assert "run time [s]" not in last


def test_suite_writes_its_page_and_escapes_its_texts(first, folder):
    results = folder / "results"
    assert {path.name for path in results.iterdir() if path.is_dir()} == {"coarse", "fine", "both"}
    assert {path.name for path in (results / "both").iterdir()} == {"suite.h5", "report.html", "run.log"}
    page = (results / "both" / "report.html").read_text(encoding="utf-8")
    assert "<pendulums>" not in page
    assert "coarse &amp; quick" in page
    assert "Takes longer." in page


def test_finished_suite_is_up_to_date_and_json_names_the_run_of_every_stage(first, call):
    again = call("run", "--json")
    events = [json.loads(line) for line in again.stdout.splitlines()]
    assert {event["status"] for event in events} == {"up to date"}
    assert list(dict.fromkeys(event["run"] for event in events)) == ["coarse", "fine", "both"]
    assert events[-1]["summary"]["runs"] == 2
    looked = [json.loads(line) for line in call("status", "--json").stdout.splitlines()]
    assert [(entry["run"], entry["stage"]) for entry in looked] == [(event["run"], event["stage"]) for event in events]


@pytest.mark.parametrize(
    ("change", "stages"),
    [("runs.1.label=other", ["suite"]), ("claims.1.above=4", ["suite"])],
)
def test_changed_text_or_bound_writes_the_page_only(first, call, change, stages):
    lines = call("status", "--set", change).output.splitlines()
    assert [line.split()[0] for line in lines if "will run" in line] == stages


def test_changed_run_is_named(first, call):
    lines = call("status", "--set", "runs.1.set.simulate.duration=0.4").output.splitlines()
    assert [line for line in lines if "will run" in line][-1].endswith("fine changed")


def test_failed_run_stops_the_suite_and_is_named(first, call, folder):
    page = folder / "results" / "both" / "report.html"
    before = page.read_bytes()
    done = call("run", "--set", "runs.0.set.bodies.bob.pose.origin=[0, 0, 5]", "--set", "runs.0.set.simulate.start=equilibrium")
    assert done.exit_code == 2
    assert "run 1 of 2 coarse failed:\n" in done.stderr
    assert "bodies.bob.pose" in done.stderr
    assert "run 2 of 2" not in done.output
    assert page.read_bytes() == before


def test_missing_inputs_of_any_run_are_found_before_the_first_one_starts(folder):
    signal = "{type: sine, amplitude: 2.0, frequency: 1.0}"
    file = "{type: csv, file: none.csv, time_column: t, value_column: F}"
    (folder / "lacking.yaml").write_text(PENDULUM.replace(signal, file), encoding="utf-8")
    path = folder / "missing.yaml"
    path.write_text(SUITE.replace("pendulum.yaml, name: fine", "lacking.yaml, name: fine"), encoding="utf-8")
    done = CliRunner().invoke(app, ["run", str(path), "--results", str(folder / "none")])
    assert done.exit_code == 2
    assert "run 2 of 2 fine failed:" in done.stderr
    assert "lacking.yaml:13:" in done.stderr
    assert not (folder / "none").exists()


@pytest.mark.parametrize(
    ("command", "changes", "words"),
    [
        ("import", [], ["a suite has no stage 'import'", "strainsight run"]),
        ("status", ["runs.0.until=simulat"], ["runs[0].until: the run has no stage 'simulat'", "did you mean simulate?"]),
        ("status", ["runs.0.until=a", "runs.1.until=b"], ["no stage 'a'", "no stage 'b'"]),
        ("run", ["claims.0.number=violations"], ["result 'violations' not found in the stage", "did you mean violation?"]),
        ("status", ["claims.0.stage=estimate"], ["runs[0], 'coarse', does not have the stage 'estimate'"]),
    ],
)
def test_fault_of_suite_is_refused_with_location(first, call, command, changes, words):
    done = call(command, *(word for change in changes for word in ("--set", change)))
    assert done.exit_code == 2
    for word in words:
        assert word in done.stderr


@pytest.fixture
def guessing(tmp_path):
    """A function: where the guess of the second run comes from, and the first run's last stage → the works of both."""

    def made(source: str, until: str = "validate", place: int = 1):
        runs = [f"{{config: {CONFIG}, label: a, name: first, until: {until}}}"]
        runs.insert(
            place, f"{{config: {CONFIG}, label: b, name: second, set: {{parameters.E.guess: {{from: {source}}}}}}}"
        )
        listed = "".join(f"  - {entry}\n" for entry in runs)
        path = tmp_path / "guess.yaml"
        path.write_text(f"kind: suite\nname: both\ntitle: Both\nruns:\n{listed}", encoding="utf-8")
        return works_of(load_config(path), tmp_path / "results")

    made.path = os.path.relpath(tmp_path / "results" / "first" / "validate.h5", CONFIGS)
    return made


def test_run_waits_for_guess_in_any_path_notation(guessing):
    for source in ("first", f"../configs/{guessing.path}"):
        works = guessing(source)
        assert makers(works[1], works) == {"parameters.E.guess.from": 0}


def test_a_guess_from_a_run_that_ends_before_it_or_comes_later_is_refused(guessing):
    with pytest.raises(ConfigError) as caught:
        guessing("first", until="place")
    assert caught.value.key == "runs[0].until"
    assert "guess.yaml:5:" in caught.value.where
    assert caught.value.remedy == "set until: validate; the key parameters.E.guess.from of runs[1] needs this file"
    with pytest.raises(ConfigError, match="which is later in this suite"):
        guessing(guessing.path, place=0)


def test_existing_run_name_is_refused(guessing, tmp_path):
    (tmp_path / "results" / "both").mkdir(parents=True)
    (tmp_path / "results" / "first").mkdir()
    (tmp_path / "results" / "both" / "import.h5").touch()
    (tmp_path / "results" / "first" / "suite.h5").touch()
    with pytest.raises(ConfigError) as caught:
        guessing("first")
    places = [error.where for error in (caught.value, *caught.value.others)]
    assert len(places) == 2
    assert all("guess.yaml:" in place for place in places)
