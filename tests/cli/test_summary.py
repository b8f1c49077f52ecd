"""The end of `run`: answers in at most 30 lines, one σ of an unknown everywhere, and `show` for the other tables."""

from __future__ import annotations

import csv
import json
import re

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from strainsight.runner.artefact import Artefact
from strainsight.runner.output import Table
from strainsight_cli.main import app
from strainsight_cli.summary import LINES, shortened

from ..robustness.small import PLACEMENT, write_project
from ..shared import ROOT

REFERENCE = {"push": (500.0, "N"), "E": (1.9e11, "Pa")}
"""Amplitude of the load, guess of the parameter, and their units."""
SHORT = [f"--set=validate.{key}" for key in ("repeats=2", "random_sets=2", "noise_factors=[]")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder of the small beam with an unknown load and modulus."""
    folder = tmp_path_factory.mktemp("summary")
    write_project(folder)
    config = yaml.safe_load(PLACEMENT)
    del config["estimate"], config["validate"]["sweeps"]
    config["name"] = "both"
    sine = {"type": "sine", "frequency": 15.0, "amplitude": REFERENCE["push"][0]}
    config["loads"]["push"] = {"node": 1000, "direction": [0, 1, 0], "known": False, "signal": sine}
    config["place"]["estimate"] = list(REFERENCE)
    config["validate"] |= {"initial_std": {"push": 1.0, "E": 0.1}, "random_sets": 0, "noise_factors": [], "repeats": 1}
    (folder / "both.yaml").write_text(yaml.safe_dump(config), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def call(folder):
    def called(*words: str):
        return CliRunner(env={"NO_COLOR": "1"}).invoke(app, [*words, "--results", str(folder / "results")])

    return called


@pytest.fixture(scope="module")
def printed(call, folder):
    done = call("run", str(folder / "both.yaml"))
    assert done.exit_code == 0, done.output
    return done.output


def rows(lines: list[str], title: str) -> list[list[str]]:
    """Rows of the first table with this title, split at two spaces."""
    start = lines.index(title)
    table = lines[start + 1 : lines.index("", start)] if "" in lines[start:] else lines[start + 1 :]
    return [re.split(r"  +", line) for line in table]


def assert_answers(lines: list[str], folder, gauges: int, unknowns: list[str]) -> None:
    assert len(lines) <= LINES, "\n".join(lines)
    head, *places = rows(lines, "gauges")
    assert head[:5] == ["gauge", "element", "facet", "x y z [mm]", "nearest edge [mm]"]
    with open(folder / "gauges.csv", encoding="utf-8", newline="") as file:
        listed = list(csv.DictReader(file))
    assert len(places) == len(listed) == gauges
    for place, row in zip(places, listed, strict=True):
        assert place[:3] == [row["gauge"], row["element"], row["facet"]]
        position = [1e3 * float(row[f"position_{axis}"]) for axis in "xyz"]
        np.testing.assert_allclose([float(x) for x in place[3].split()], position, atol=0.0501)
        assert float(place[4]) == pytest.approx(1e3 * float(row["edge_m"]), abs=0.0501)
    assert [row[0] for row in rows(lines, "accuracy: expected σ of the layout")[1:]] == unknowns
    assert any("To reduce σ" in line for line in lines)
    assert f"report: {folder / 'report.html'}" in lines


def test_run_ends_with_its_answers_in_at_most_30_lines(printed, folder):
    assert_answers(printed.splitlines(), folder / "results" / "both", 3, ["push", "E"])


@pytest.mark.slow
def test_the_job_of_make_run_prints_at_most_30_lines(tmp_path):
    config = ROOT / "configs" / "cantilever-youngs-modulus.yaml"
    done = CliRunner().invoke(app, ["run", str(config), "--results", str(tmp_path), *SHORT])
    assert done.exit_code == 0, done.output
    assert_answers(done.output.splitlines(), tmp_path / config.stem, 4, ["E"])


def test_verbose_prints_every_table_before_the_answers(printed, call, folder):
    lines = call("run", str(folder / "both.yaml"), "-v").output.splitlines()
    stages = [Artefact(path) for path in sorted((folder / "results" / "both").glob("*.h5"))]
    for table in (table for stage in stages for table in stage.tables):
        assert any(line.startswith(table.name) for line in lines), table.title
    assert f"report: {folder / 'results' / 'both' / 'report.html'}" in lines[-3:]


def test_expected_sigma_is_one_number_in_console_json_csv_show_and_page(printed, call, folder):
    """Relative to the RMS of the load in training after the first tenth, and to the guess of the parameter."""
    results = folder / "results" / "both"
    summary = json.loads(call("place", str(folder / "both.yaml"), "--json").output.splitlines()[-1])["summary"]
    with open(results / "gauges.csv", encoding="utf-8", newline="") as file:
        listed = next(csv.DictReader(file))
    page = (results / "report.html").read_text(encoding="utf-8")
    time = np.arange(101)[11:100] * 1e-3
    size = {"push": np.sqrt(np.mean((500.0 * np.sin(2 * np.pi * 15.0 * time)) ** 2)), "E": 1.9e11}
    for name, (_, unit) in REFERENCE.items():
        relative, absolute = summary[f"std.{name}"], summary[f"std_absolute.{name}"]
        assert absolute == pytest.approx(relative * size[name], rel=0.02)
        assert float(listed[f"std_{name}"]) == pytest.approx(relative, rel=1e-8)
        assert float(listed[f"std_absolute_{name}"]) == pytest.approx(absolute, rel=1e-8)
        text = f"{100 * relative:.2g} % ({absolute:.3g} {unit})"
        assert f"{name} ± {text}" in printed
        for lines in (printed.splitlines(), call("show", "both", "accuracy").output.splitlines()):
            assert text in [row[2] for row in rows(lines, "accuracy: expected σ of the layout") if row[0] == name]
        sentence = re.search(r'<p class="answer".*?</p>', page)[0]
        (said,) = re.findall(rf'{name} to within ±<data value="([^"]+)">', sentence)
        (tile,) = re.findall(rf'<h2 class="name">{name}, .*?</dl>', page)
        (value,) = re.findall(r'<p class="value">± <data value="([^"]+)">[^<]+</data></p>', tile)
        (size_of_sigma,) = re.findall(rf'<dt>± expected σ</dt><dd><data value="([^"]+)" data-unit="{unit}">', tile)
        np.testing.assert_allclose([float(said), float(value), float(size_of_sigma)], [relative, relative, absolute], rtol=1e-9)
        exact = [float(value) for value in re.findall(r'<data value="([^"]+)"', page)]
        # headline, tile, and the row of all gauges
        assert sum(value == pytest.approx(relative, rel=1e-12) for value in exact) >= 3, name
        assert sum(value == pytest.approx(absolute, rel=1e-9) for value in exact) >= 2, name


def test_show_lists_tables_and_files_and_computes_nothing(printed, call, folder):
    results = folder / "results" / "both"
    before = {path: path.stat().st_mtime_ns for path in results.iterdir()}
    by = [call("show", str(run)).output for run in (results, "both", folder / "both.yaml")]
    assert by[0] == by[1] == by[2]
    tables = [tuple(re.split(r"  +", line)[:2]) for line in by[0].splitlines()]
    assert {("import", "mesh"), ("place", "gauges"), ("place", "budget"), ("validate", "estimates")} <= set(tables)
    assert str(results / "gauges.csv") in by[0].splitlines()
    assert {path: path.stat().st_mtime_ns for path in results.iterdir()} == before


def test_show_prints_a_table_by_the_beginning_of_its_name(printed, call, folder):
    (table,) = [each for each in Artefact(folder / "results" / "both" / "place.h5").tables if each.name == "budget"]
    lines = call("show", "both", "BUD").output.splitlines()
    assert lines[1] == table.title
    assert [re.split(r"  +", line) for line in lines[2:]] == [list(row) for row in (table.columns, *table.rows)]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("both", "h"), "several tables begin with 'h'"),
        (("both", "nothing"), "the run has no table 'nothing'"),
        (("absent",), "no results in this folder"),
    ],
)
def test_show_refuses_unclear_and_unknown_names(printed, call, words, text):
    done = call("show", *words)
    assert done.exit_code == 2
    assert text in done.output + (done.stderr or "")


def test_sentences_are_shortened_before_tables_and_a_line_counts_the_rest():
    numbers = Table("gauges: all", ("gauge", "x"), tuple((f"G{i}", "0") for i in range(12)), True)
    words = Table("advice", ("",), tuple((f"Sentence {i}.",) for i in range(8)), True)
    gauges, advice = shortened([numbers, words], 30, 10, "show run")
    assert len(gauges) == 2 + 12
    assert advice == ["advice", "Sentence 0.", "Sentence 1.", "… 6 more: show run advice"]
    gauges, advice = shortened([numbers, words], 12, 40, "show run")
    assert advice == ["advice", "Sentence 0.", "… 7 more: show run advice"]
    assert gauges[-1] == "… 8 more: show run gauges"
    assert sum(map(len, (gauges, advice))) + 2 == 12
