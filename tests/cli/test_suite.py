"""A suite from the command line: its runs, its page, what is said when one fails, and where the time went."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from strainsight.config.load import load_config
from strainsight.errors import ConfigError
from strainsight.workflow.artefact import Artefact
from strainsight_cli.main import app
from strainsight_cli.suites import works_of
from strainsight_cli.work import makers

from ..robustness import small

CONFIGS = Path(__file__).parents[2] / "configs"
CONFIG = CONFIGS / "cantilever-youngs-modulus.yaml"
SUITE = """\
kind: suite
name: two
title: A beam & its <modulus>
set: {estimate: null, rom.parameter_samples: 1, tolerances.frequency: 0, validate.random_sets: 0}  # seed 1 draws −2.8 σ of it
runs:
  - {config: beam.yaml, label: "E", set: {place.keep: 4}}
  - {config: beam.yaml, label: placed only, name: placed, until: place, set: {place.keep: 2}}
  - {config: beam.yaml, label: watched, name: watched, until: observe, note: "A note.", set: {place.keep: 4}}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("suite")


@pytest.fixture(scope="module")
def suite(folder):
    small.write_project(folder)
    path = folder / "two.yaml"
    path.write_text(SUITE, encoding="utf-8")
    return str(path)


@pytest.fixture(scope="module")
def call(folder):
    def called(*words: str):
        return CliRunner().invoke(app, [*words, "--results", str(folder / "results")])

    return called


@pytest.fixture(scope="module")
def first(suite, call):
    """The first run, before any other test."""
    before = call("status", suite)
    assert before.exit_code == 0
    assert before.output.count("will run") == before.output.count("never run") > 20
    assert call("run", suite, "--dry-run").output == before.output
    done = call("run", suite)
    assert done.exit_code == 0, done.output
    return done.output


def test_every_run_has_its_stages_and_the_suite_its_page(first, folder):
    results = folder / "results"
    assert {path.name for path in results.iterdir() if path.is_dir()} == {
        "beam",
        "placed",
        "watched",
        "two",
    }
    assert not (results / "placed" / "validate.h5").exists()
    assert not (results / "watched" / "place.h5").exists()
    assert {path.name for path in (results / "two").iterdir()} == {"suite.h5", "report.html", "run.log"}
    page = (results / "two" / "report.html").read_text(encoding="utf-8")
    assert "<modulus>" not in page
    assert "A note." in page
    assert 'href="../beam/report.html"' in page
    assert 'href="../placed/report.html"' not in page


def test_it_says_which_run_is_at_work_what_came_out_and_where_the_time_went(first):
    for heading in ("run 1 of 3 beam", "run 2 of 3 placed", "run 3 of 3 watched", "suite two"):
        assert heading in first.splitlines()
    table = first.split("where the time goes")[1].splitlines()
    head, own, placed, watched, page, total = (line.split() for line in table[1:7])
    assert head[:2] == ["run", "import"]
    assert head[-1] == "all"
    assert "↩" not in own
    # Only what comes after the observability differs.
    assert placed.count("↩") == watched.count("↩") == head.index("observe") - head.index("import") + 1
    assert float(total[-1]) == pytest.approx(sum(float(row[-1]) for row in (own, placed, page)), abs=0.2)
    assert "peak memory: " in first
    assert "not estimated (observe)" in first


def test_then_it_is_up_to_date_and_says_the_same_of_its_time(first, suite, call):
    again = call("run", suite)
    assert again.exit_code == 0
    assert " done " not in again.output
    assert (
        again.output.split("where the time goes")[1].splitlines()[:7]
        == first.split("where the time goes")[1].splitlines()[:7]
    )
    assert "will run" not in call("status", suite).output


def test_json_names_the_run_of_every_stage(first, suite, call):
    events = [json.loads(line) for line in call("run", suite, "--json").stdout.splitlines()]
    assert {event["status"] for event in events} == {"up to date"}
    assert list(dict.fromkeys(event["run"] for event in events)) == [
        "beam",
        "placed",
        "watched",
        "two",
    ]
    assert events[-1]["summary"]["runs"] == 3
    looked = [json.loads(line) for line in call("status", suite, "--json").stdout.splitlines()]
    assert [(entry["run"], entry["stage"]) for entry in looked] == [(event["run"], event["stage"]) for event in events]


def test_a_changed_label_writes_the_page_only_and_a_changed_run_is_named(first, suite, call):
    lines = call("status", suite, "--set", "runs.2.label=other").output.splitlines()
    assert [line.split()[0] for line in lines if "will run" in line] == ["suite"]
    changed = call("status", suite, "--set", "runs.1.set.place.keep=3").output.splitlines()
    assert [line for line in changed if "will run" in line][-1].endswith("placed changed")


def test_a_run_that_fails_stops_the_suite_and_is_named(first, suite, call, folder):
    page = folder / "results" / "two" / "report.html"
    before = page.read_bytes()
    done = call("run", suite, "--set", "runs.1.set.place.minimum_spacing=3.0")
    assert done.exit_code == 2
    said = done.stderr
    assert said.startswith("warning: --set runs.1.set.place.minimum_spacing  place.minimum_spacing: 3 m is more than")
    assert "\nrun 2 of 3 placed failed:\n--set runs.1.set.place.minimum_spacing  place.minimum_spacing: " in said
    assert "run 3 of 3" not in done.output
    assert page.read_bytes() == before
    last = call("run", suite, "--set", "runs.1.set.place.minimum_spacing=3.0", "--json").stdout.splitlines()[-1]
    assert (json.loads(last)["run"], json.loads(last)["status"]) == ("placed", "failed")


def test_missing_inputs_of_any_run_are_found_before_the_first_one_starts(suite, folder):
    results = folder / "none"
    text = Path(suite).read_text(encoding="utf-8").replace("place.keep: 2", "mesh.file: none.bdf")
    path = folder / "missing.yaml"
    path.write_text(text, encoding="utf-8")
    done = CliRunner().invoke(app, ["run", str(path), "--results", str(results)])
    assert done.exit_code == 2
    assert "run 2 of 3 placed failed:" in done.stderr
    assert "missing.yaml:7:" in done.stderr
    assert not results.exists()


@pytest.mark.parametrize("stage", ["import", "place", "report", "estimate"])
def test_a_suite_has_no_stages_of_its_own(stage, suite, call):
    done = call(stage, suite)
    assert done.exit_code == 2
    assert f"a suite has no stage '{stage}'" in done.stderr
    assert "strainsight run" in done.stderr


def test_an_unknown_last_stage_is_named_with_its_place(suite, call):
    done = call("status", suite, "--set", "runs.1.until=plaec")
    assert done.exit_code == 2
    assert "runs[1].until: the run has no stage 'plaec'" in done.stderr
    assert "did you mean place?" in done.stderr


def test_every_unknown_last_stage_is_reported_at_once(suite, call):
    done = call("status", suite, "--set", "runs.1.until=plaec", "--set", "runs.2.until=obsevre")
    assert done.stderr.count("the run has no stage") == 2


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


def test_a_guess_is_waited_for_however_its_run_is_written(guessing):
    for source in ("first", guessing.path, f"../configs/{guessing.path}"):
        works = guessing(source)
        assert makers(works[1], works) == {"parameters.E.guess.from": 0}


def test_a_guess_from_a_run_that_ends_before_it_or_comes_later_is_refused(guessing):
    for source in ("first", guessing.path):
        with pytest.raises(ConfigError) as caught:
            guessing(source, until="place")
        assert caught.value.key == "runs[0].until"
        assert "guess.yaml:5:" in caught.value.where
        assert caught.value.remedy == "runs[1] takes its guess from it: until: validate"
    with pytest.raises(ConfigError, match="which the suite runs later"):
        guessing(guessing.path, place=0)


def test_a_name_that_is_taken_in_the_results_is_refused(guessing, tmp_path):
    (tmp_path / "results" / "both").mkdir(parents=True)
    (tmp_path / "results" / "first").mkdir()
    (tmp_path / "results" / "both" / "import.h5").touch()
    (tmp_path / "results" / "first" / "suite.h5").touch()
    with pytest.raises(ConfigError) as caught:
        guessing("first")
    places = [error.where for error in (caught.value, *caught.value.others)]
    assert len(places) == 2
    assert all("guess.yaml:" in place for place in places)


def test_its_artefact_holds_the_table(first, folder):
    suite = Artefact(folder / "results" / "two" / "suite.h5")
    assert suite["/run/name"].tolist() == ["beam", "placed", "watched"]
    assert suite["/run/gauges"][:2].tolist() == [4, 2]
    assert suite["/unknown/run"].tolist() == [0, 1, 2]
    place = Artefact(folder / "results" / "placed" / "place.h5")
    assert suite["/run/metric_final"][1] == place.summary["trace_final"]
    validate = Artefact(folder / "results" / "beam" / "validate.h5")
    assert suite["/unknown/error"][0] == validate.summary["error.E"]
    assert suite["/unknown/verdict"].tolist()[1:] == ["", ""]
    assert len(suite["/case/condition"]) == 9
