"""Mistakes of a first day, each in the example `test`: the message names file, line and key, and what to do."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from strainsight_cli.example import write
from strainsight_cli.main import app

TIMES = [0.001 * i for i in range(401)]
SIGNAL = "{type: sweep, start_frequency: 5.0, end_frequency: 60.0, duration: 0.4, amplitude: 5.0e+3}"
G1 = "{channel: G1, gauge: root, unit: um/m}"


def table(head: str, value: float, times: int = 401) -> str:
    """A record whose channels are all one ramp."""
    rows = [",".join([f"{t:.3f}", *[f"{value * t:.4f}"] * head.count(",")]) for t in TIMES[:times]]
    return "\n".join([head, *rows]) + "\n"


def history(**changed: str) -> tuple[str, str]:
    keys = {"file": "f.csv", "time_column": "t", "value_column": "F", **changed}
    return SIGNAL, f"{{type: csv, {', '.join(f'{key}: {value}' for key, value in keys.items())}}}"


RECORD = "time,G1,G2,G3,G4"
HISTORY = {"f.csv": table("t [s],F [N]", 5.0)}
KNOWN = [
    ("loads:", "parameters: {E: {property: youngs_modulus, region: 1, guess: 2.1e11, range: [1e11, 3e11]}}\nloads:"),
    ("known: false", "known: true"),
    ("[tip]", "[E]"),
    ("std: {tip: 1.0}", "std: {E: 0.1}"),
]
CONFIG = {
    "a misspelt section": ([("train:", "trian:")], "test.yaml:14:1  trian: unknown key", "did you mean train?"),
    "a decimal comma": (
        [("ratio: 0.01", "ratio: 0,01")],
        "test.yaml:13:10  damping: the comma before '01' separates two entries",
        "decimal point, as in 0.01",
    ),
    "a unit": ([("train: {duration: 0.4,", "train: {duration: 0.4 s,")], "train.duration: the value is '0.4 s'", "and without"),
    "no for false": ([("known: false", "known: no")], "test.yaml:10:12  loads.tip.known: the value is 'no'", "rite false"),
    "a key twice": ([("seed: 1", "seed: 1\nseed: 2")], "test.yaml:5:1  seed: the key appears twice", "the first key is at 4:1"),
    "a coarse step": (
        [("time_step: 1.0e-3}", "time_step: 1.0e-2}")],
        "train.time_step: the shortest period of load 'tip' (60 Hz) is 1.67 times the time step of 0.01 s",
        "at most 0.00208 s",
    ),
    "noise in um/m": ([("value: 2.0e-6", "value: 2.0")], "a noise of 2 m/m is 200 % strain", "2 um/m is 2.0e-06"),
    "a misspelt gauge": ([("below,", "bellow,")], "test.yaml:32:28  estimate.channels.2.gauge", "did you mean below?"),
    "a known load without a channel": (
        KNOWN,
        "estimate.inputs: the known load 'tip' has no channel",
        "inputs: {tip: {channel: …, unit: N}}",
    ),
}
"""What the config alone shows."""
FILES = {
    "a time in ms": (
        [],
        {"test.csv": table("time [ms],G1,G2,G3,G4", 1.0)},
        "the time unit is s in the config, but ms in the file",
        "`time: {unit: ms}`",
    ),
    "um/m read as strain": (
        [(G1, G1.replace("um/m", "strain"))],
        {"test.csv": table(RECORD, 300.0)},
        "estimate.channels.0.unit: the strain of G1 reaches 120 m/m (12000 %)",
        "which may be um/m",
    ),
    "a gauge in newtons": (
        [(G1, G1.replace("um/m", "N"))],
        {"test.csv": table(RECORD, 300.0)},
        "estimate.channels.0.unit: the channel has the unit N (force), expected strain",
        "the assigned gauge or load",
    ),
    "a history that is short": (
        [history()],
        {"f.csv": table("t [s],F [N]", 5.0, times=300)},
        "loads.tip.signal.file: f.csv covers 0 to 0.299 s, but train.duration requires 0 to 0.4 s",
        "set train.duration to at most 0.299 s",
    ),
}
"""What the files contradict, before the import."""
WORDS = {
    "a misspelt override": (["run", "test.yaml", "--set", "place.kep=3"], "--set place.kep  place.kep", "did you mean keep?"),
    "a deck for a config": (["run", "cantilever.bdf"], "cantilever.bdf  the config is larger than 128 KiB", "not of a mesh file"),
    "a misspelt config": (["run", "tset.yaml"], "tset.yaml  config file not found", "create one with `strainsight init DECK`"),
    "a config for a deck": (["init", "test.yaml"], "test.yaml  the file is a config, not a deck", "strainsight run test.yaml"),
}
"""What the command line says by itself."""
MISTAKES = (
    {name: (["import", "test.yaml"], changes, {}, place, remedy) for name, (changes, place, remedy) in CONFIG.items()}
    | {name: (["import", "test.yaml"], *row) for name, row in FILES.items()}
    | {name: (words, [], {}, place, remedy) for name, (words, place, remedy) in WORDS.items()}
)


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


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_are_named_before_anything_is_computed(name, project):
    words, changes, files, place, remedy = MISTAKES[name]
    change(project, changes)
    for file, text in files.items():
        (project / file).write_text(text, encoding="utf-8")
    refused(project, words, place, remedy)


def test_where_gauges_were_bonded_is_known_after_the_layout(project):
    """Neither the file of their places nor the record of the test is there on the day of the layout; the test needs both."""
    names = [(f"gauge: {old}", f"gauge: G{i}") for i, old in enumerate(("root", "left", "below", "right"), start=1)]
    later = ("  file: test.csv", "  file: later.csv\n  gauges_file: g.csv")
    change(project, [("fixed_file: bonded.csv", "surface: all"), *names, later])
    done = CliRunner().invoke(app, ["import", "test.yaml"])
    assert (done.exit_code, done.stderr) == (0, "")
    shutil.rmtree(project / "results")
    refused(project, ["estimate", "test.yaml"], "estimate.file: file not found: ", "folder of the config")
    shutil.copy(project / "test.csv", project / "later.csv")
    refused(project, ["estimate", "test.yaml"], "estimate.gauges_file: file not found: ", "folder of the config")


def test_a_record_with_the_config_is_named(project, monkeypatch):
    (project / "elsewhere").mkdir()
    monkeypatch.chdir(project / "elsewhere")
    words = ["estimate", "../test.yaml", "--measurements", "test.csv"]
    refused(
        project, words, "test.csv  --measurements: file not found", "did you mean ../test.csv? The path of --measurements is"
    )


def test_a_test_without_a_measurement_file_names_the_option(project):
    change(project, [("  file: test.csv\n", "")])
    refused(project, ["estimate", "test.yaml"], "estimate.file: the measurement file is missing", "--measurements FILE")


def test_from_another_working_directory_the_results_that_are_there_are_named(project, monkeypatch):
    done = CliRunner().invoke(app, ["import", "test.yaml"])
    assert (done.exit_code, done.stderr) == (0, "")
    (project / "elsewhere").mkdir()
    monkeypatch.chdir(project / "elsewhere")
    there = project / "results"
    note = f"note: results/test has no results yet, but {there / 'test'} has results; to use these, set --results {there}\n"
    for words in (["status", "../test.yaml"], ["import", "../test.yaml"]):
        done = CliRunner().invoke(app, words)
        assert (done.exit_code, done.stderr) == (0, note)
    assert CliRunner().invoke(app, ["import", "../test.yaml"]).stderr == ""
    shutil.rmtree(project / "elsewhere" / "results")
    done = CliRunner().invoke(app, ["import", "../test.yaml", "--results", str(there)])
    assert done.output.startswith("import    up to date")


def test_what_is_done_is_not_checked_again_and_a_longer_record_is_taken(project):
    """A check enters no key: after a history has changed the import stays up to date."""
    change(project, [history()])
    (project / "f.csv").write_text(HISTORY["f.csv"], encoding="utf-8")
    assert CliRunner().invoke(app, ["import", "test.yaml"]).exit_code == 0
    (project / "f.csv").write_text(table("t [s],F [N]", 5.0, times=300), encoding="utf-8")
    assert CliRunner().invoke(app, ["import", "test.yaml"]).output.startswith("import    up to date")
    refused_now = CliRunner().invoke(app, ["modes", "test.yaml"])
    assert (refused_now.exit_code, list((project / "results").rglob("modes.h5"))) == (2, [])
