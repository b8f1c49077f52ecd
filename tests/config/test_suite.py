"""A suite is checked whole, with the configs of its runs: every problem has its place in the file that it stands in."""

from __future__ import annotations

from pathlib import Path

import pytest

from strainsight.config.load import load_config
from strainsight.config.suite_runs import runs_of
from strainsight.errors import ConfigError

CONFIGS = Path(__file__).parents[2] / "configs"
SUITE = """\
kind: suite
name: all
title: Two runs
set: {place.instants: 3}
suffix: -short
runs:
  - config: cantilever-youngs-modulus.yaml
    label: E
    set: {place.keep: 5}
  - config: cantilever-youngs-modulus.yaml
    name: watched
    label: E, only observed
    until: observe
  - config: cantilever-input.yaml
    label: tip
    note: With the modulus of the first run.
"""


@pytest.fixture
def write(tmp_path):
    for name in ("cantilever-youngs-modulus", "cantilever-input"):
        (tmp_path / f"{name}.yaml").write_text((CONFIGS / f"{name}.yaml").read_text(encoding="utf-8"), encoding="utf-8")

    def written(text: str = SUITE) -> Path:
        path = tmp_path / "suite.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return written


def refused(path: Path, *overrides: str) -> list[ConfigError]:
    with pytest.raises(ConfigError) as caught:
        runs_of(load_config(path, overrides))
    return [caught.value, *caught.value.others]


def place(text: str, part: str, file: str = "suite.yaml") -> str:
    """ "suite.yaml:line:" of the first line that holds the part."""
    return f"{file}:{text[: text.index(part)].count(chr(10)) + 1}:"


def test_every_run_gets_what_is_set_its_name_and_the_suffix(write):
    runs = runs_of(load_config(write()))
    assert [run.config.model.name for run in runs] == [
        "cantilever-youngs-modulus-short",
        "watched-short",
        "cantilever-input-short",
    ]
    assert [run.config.data["place"]["instants"] for run in runs] == [3, 3, 3]
    assert [run.config.data["place"]["keep"] for run in runs] == [5, 4, 4]
    assert [run.entry.until for run in runs] == ["report", "observe", "report"]


def test_a_guess_from_a_run_of_the_suite_follows_its_suffix_and_others_stay(write):
    runs = runs_of(load_config(write()))
    assert runs[2].config.data["parameters"]["E"]["guess"]["from"] == "cantilever-youngs-modulus-short"
    head, _, _, last = SUITE.split("  - config: ")
    alone = runs_of(load_config(write(f"{head}  - config: {last}")))
    assert alone[-1].config.data["parameters"]["E"]["guess"]["from"] == "cantilever-youngs-modulus"


def test_overrides_of_the_command_line_reach_the_suite_and_its_set(write):
    path = write()
    runs = runs_of(load_config(path, ["suffix=-x", "set.place.keep=7", "runs.1.set.train.duration=0.5"]))
    assert runs[1].config.model.name == "watched-x"
    assert [run.config.data["place"]["keep"] for run in runs] == [5, 7, 7]
    assert runs[1].config.data["train"]["duration"] == 0.5
    (error,) = refused(path, "set.place.instants=0")
    assert error.where == "--set set.place.instants"


def test_what_set_made_wrong_is_placed_in_the_suite_and_reported_once(write):
    text = SUITE.replace("place.instants: 3", "place.instant: 3").replace("place.keep: 5", "place.keep: 0")
    found = {error.key: error for error in refused(write(text))}
    assert set(found) == {"place.instant", "place.keep"}
    assert place(text, "place.instant") in found["place.instant"].where
    assert found["place.instant"].remedy == "did you mean instants?"
    assert place(text, "place.keep") in found["place.keep"].where


def test_what_is_wrong_with_the_config_of_a_run_is_placed_there_and_reported_once(write):
    path = write()
    own = path.parent / "cantilever-youngs-modulus.yaml"
    text = own.read_text(encoding="utf-8").replace("seed: 1", "seed: -1")
    own.write_text(text, encoding="utf-8")
    (error,) = refused(path)
    assert error.key == "seed"
    assert place(text, "seed", own.name) in error.where


@pytest.mark.parametrize(
    ("before", "after", "key", "what"),
    [
        ("title: Two runs", "titel: Two runs", "titel", "unknown key"),
        ("runs:", "runs: []\nrest:", "runs", "has to be at least 1 long"),
        ("suffix: -short", "suffix: a b", "suffix", "is not a name"),
        ("name: watched", "name: a/b", "runs[1].name", "is not a name"),
        ("label: tip", "lable: tip", "runs[2].lable", "unknown key"),
        ("{place.keep: 5}", "{place..keep: 5}", "runs[0].set.place..keep", "is not a dotted key"),
        ("{place.keep: 5}", "{name: other}", "runs[0].set.name", "cannot set 'name'"),
        ("cantilever-input.yaml", "cantilever.yaml", "runs[2].config", "no such file"),
        ("cantilever-input.yaml", "suite.yaml", "runs[2].config", "is a suite itself"),
        ("name: watched", "name: cantilever-youngs-modulus", "runs[1].name", "as is runs[0]"),
        ("name: all", "name: watched-short", "runs[1].name", "as is the suite itself"),
    ],
)
def test_a_mistake_in_the_suite_has_its_place(write, before, after, key, what):
    errors = refused(write(SUITE.replace(before, after)))
    (error,) = (error for error in errors if what in error.what)
    assert error.key == key
    assert "suite.yaml:" in error.where
    assert error.remedy


def test_a_list_is_not_called_too_short_because_all_its_entries_are_wrong(write):
    text = "kind: suite\nname: all\ntitle: t\nruns:\n  - {label: 1, config: a.yaml}\n"
    (error,) = refused(write(text))
    assert error.key == "runs[0].label"


def test_a_guess_from_a_run_that_comes_later_is_refused(write):
    head, first, _, last = SUITE.split("  - config: ")
    (error,) = refused(write(f"{head}  - config: {last}  - config: {first}"))
    assert "which the suite runs later" in error.what
    assert error.key == "parameters.E.guess.from"
    assert "cantilever-input.yaml:" in error.where


@pytest.mark.parametrize(
    ("before", "after", "key", "what"),
    [
        ("title: Two runs", 'title: "Two \\e[31mruns"', "title", "control character U+001B"),
        ("label: E, only observed", 'label: "a\\0b"', "runs[1].label", "control character U+0000"),
        ("note: With", "note: |\n      With", "runs[2].note", "a line break"),
    ],
)
def test_a_text_that_a_terminal_would_act_upon_is_refused(write, before, after, key, what):
    (error,) = refused(write(SUITE.replace(before, after)))
    assert error.key == key
    assert what in error.what
    assert "suite.yaml:" in error.where
    assert str(error).isprintable() or "\n    write plain text" in str(error)


@pytest.mark.parametrize(
    ("given", "remedy"),
    [
        ("place.keep=5", "write set.place.keep=5"),
        ("seed=2", "write set.seed=2"),
        ("mesh.file=a.bdf", "write set.mesh.file=a.bdf"),
        ("jbos=2", "did you mean jobs?"),
    ],
)
def test_a_key_of_the_runs_behind_set_is_placed_there(write, given, remedy):
    (error,) = refused(write(), given)
    assert error.where == f"--set {given.split('=')[0]}"
    assert error.remedy == remedy


def test_a_misspelt_name_in_a_set_of_the_command_line_is_placed_there(write):
    for error in refused(write(), "set.loads.tipp.signal.amplitude=3"):
        assert error.where == "--set set.loads.tipp.signal.amplitude"
        assert error.remedy == "did you mean tip?"


def test_a_section_that_was_replaced_whole_is_reported(write):
    text = SUITE.replace("{place.instants: 3}", "{train: {duration: 0.2}}")
    errors = [error for error in refused(write(text)) if error.what == "missing"]
    assert errors
    for error in errors:
        assert error.remedy == "`set` replaced all of train: write train.duration: 0.2"
        assert place(text, "{train") in error.where


@pytest.mark.parametrize("name", ["x" * 300, r'"a\0b"', "../" * 2000])
def test_a_name_that_no_file_can_have_is_no_file(write, name):
    (error,) = refused(write(SUITE.replace("cantilever-input.yaml", name, 1)))
    assert error.key == "runs[2].config"
    assert "no such file" in error.what
