"""Forty mistakes of a first day, each in the example `test`: the message names file, line and key, and what to do.

All but the few that the deck has to contradict are refused before anything is computed.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from strainsight_cli.example import write
from strainsight_cli.main import app

from .mistakes import CONFIG, DECK, FILES, HISTORY, OF_LAYOUT, WORDS, history, table


@pytest.fixture
def project(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write("test", Path(), False)
    return tmp_path


def refused(project: Path, words: list[str], place: str, remedy: str) -> None:
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 2, done.output
    head, _, below = done.stderr.partition("\n    ")
    assert place in head
    assert remedy in below
    assert "Traceback" not in done.stderr
    assert not list(project.rglob("*.h5"))


def change(project: Path, changes: list[tuple[str, str]]) -> None:
    config = project / "test.yaml"
    text = config.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    config.write_text(text, encoding="utf-8")


@pytest.mark.parametrize("name", [*CONFIG, *DECK])
def test_config_and_deck(name, project):
    changes, place, remedy = {**CONFIG, **DECK}[name]
    change(project, changes)
    refused(project, ["import" if name in DECK else "run", "test.yaml"], place, remedy)


@pytest.mark.parametrize("name", FILES)
def test_files_are_looked_at_before_the_import(name, project):
    changes, files, place, remedy = FILES[name]
    change(project, changes)
    for file, text in files.items():
        (project / file).write_text(text, encoding="utf-8")
    refused(project, ["import", "test.yaml"], place, remedy)


@pytest.mark.parametrize("name", WORDS)
def test_words_of_the_command(name, project):
    refused(project, *WORDS[name])


def test_they_are_forty_and_more():
    assert len(CONFIG) + len(DECK) + len(FILES) + len(WORDS) >= 40


def test_where_gauges_were_bonded_is_known_after_the_layout(project):
    """Neither the file of their places nor the record of the test is there on the day of the layout; the test needs both."""
    names = [(f"gauge: {old}", f"gauge: G{i}") for i, old in enumerate(("root", "left", "below", "right"), start=1)]
    change(project, [OF_LAYOUT, *names, ("  file: test.csv", "  file: later.csv\n  gauges_file: g.csv")])
    done = CliRunner().invoke(app, ["import", "test.yaml"])
    assert (done.exit_code, done.stderr) == (0, "")
    shutil.rmtree(project / "results")
    refused(project, ["estimate", "test.yaml"], "estimate.file: no such file: ", "folder of the config")
    shutil.copy(project / "test.csv", project / "later.csv")
    refused(project, ["estimate", "test.yaml"], "estimate.gauges_file: no such file: ", "folder of the config")


def test_a_record_beside_the_config_is_named(project, monkeypatch):
    (project / "elsewhere").mkdir()
    monkeypatch.chdir(project / "elsewhere")
    words = ["estimate", "../test.yaml", "--measurements", "test.csv"]
    refused(
        project, words, "test.csv  --measurements: no such file", "did you mean ../test.csv? --measurements starts from"
    )


def test_from_another_working_directory_the_results_that_are_there_are_named(project, monkeypatch):
    done = CliRunner().invoke(app, ["import", "test.yaml"])
    assert (done.exit_code, done.stderr) == (0, "")
    (project / "elsewhere").mkdir()
    monkeypatch.chdir(project / "elsewhere")
    there = project / "results"
    note = f"note: nothing is computed in results/test yet, but in {there / 'test'}: to go on from there give --results {there}\n"
    for words in (["status", "../test.yaml"], ["import", "../test.yaml"]):
        done = CliRunner().invoke(app, words)
        assert (done.exit_code, done.stderr) == (0, note)
    assert CliRunner().invoke(app, ["import", "../test.yaml"]).stderr == ""
    shutil.rmtree(project / "elsewhere" / "results")
    done = CliRunner().invoke(app, ["import", "../test.yaml", "--results", str(there)])
    assert done.output.startswith("import    up to date")


def test_a_forecast_comes_with_the_plan_once_the_deck_is_imported(project):
    assert CliRunner().invoke(app, ["import", "test.yaml"]).exit_code == 0
    planned = CliRunner().invoke(app, ["run", "test.yaml", "--dry-run"]).output
    assert re.search(r"forecast: modes 1 s, rom 2 s, (place \d+ s )?and spectrum 3 s for 10998 unknowns", planned)


def test_what_is_done_is_not_checked_again_and_a_longer_record_is_taken(project):
    """A check enters no key: after a history has changed the import stays up to date."""
    change(project, [history()])
    (project / "f.csv").write_text(HISTORY["f.csv"], encoding="utf-8")
    assert CliRunner().invoke(app, ["import", "test.yaml"]).exit_code == 0
    (project / "f.csv").write_text(table("t [s],F [N]", 5.0, times=300), encoding="utf-8")
    assert CliRunner().invoke(app, ["import", "test.yaml"]).output.startswith("import    up to date")
    refused_now = CliRunner().invoke(app, ["modes", "test.yaml"])
    assert (refused_now.exit_code, list((project / "results").rglob("modes.h5"))) == (2, [])
