"""What is written stays in its folder whatever links lie there; tables are read back as they were written."""

from __future__ import annotations

import csv
import io
import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from strainsight.errors import DeckError, UserError
from strainsight.experiment.structure.bonded_gauges import NEEDED, read_bonded
from strainsight.foreign.matrices.files import csv_columns
from strainsight.measurements.csv_file import read_csv
from strainsight.pages.chart.files import write_figures
from strainsight.runner.runner import locked
from strainsight.text import FORMULA, csv_bytes, plain_cell
from strainsight.writing import make_folder, open_file, write_file
from strainsight_cli import runlog
from strainsight_cli.main import app

from .robustness.small import write_project


@pytest.fixture
def outside(tmp_path) -> Path:
    """A folder of somebody, with files under every name that a run writes or removes."""
    folder = tmp_path / "outside"
    folder.mkdir()
    for name in ("file", ".part-thesis.docx", "gauges.csv", "run.log", ".lock", "figures.csv", "a.svg"):
        (folder / name).write_text("mine")
    return folder


def untouched(outside: Path) -> bool:
    names = {path.name for path in outside.iterdir()}
    return len(names) == 7 and all(path.read_text() == "mine" for path in outside.iterdir())


def test_a_file_replaces_a_link_and_leaves_alone_what_it_leads_to(tmp_path, outside):
    for name, target in (("link", outside / "file"), ("dangling", outside / "new"), ("relative", "outside/file")):
        (tmp_path / name).symlink_to(target)
        write_file(tmp_path / name, b"ours")
        assert (tmp_path / name).read_bytes() == b"ours"
        assert not (tmp_path / name).is_symlink()
    assert untouched(outside)


def test_a_pipe_a_device_and_a_folder_are_no_files(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "device").symlink_to("/dev/null")
    (tmp_path / "folder").mkdir()
    for name in ("pipe", "device", "folder"):
        with pytest.raises(UserError, match="is not a regular file"):
            write_file(tmp_path / name, b"ours")
    assert (tmp_path / "device").is_symlink()


def test_a_folder_that_is_a_link_is_refused(tmp_path, outside):
    (tmp_path / "link").symlink_to(outside)
    with pytest.raises(UserError, match=r"link .*is a link to .*outside") as caught:
        make_folder(tmp_path / "link")
    assert "--results" in caught.value.remedy
    make_folder(tmp_path / "link" / "below")  # folders above may be links
    (outside / "below").rmdir()
    with pytest.raises(UserError, match="is a link"), locked(tmp_path / "link"):
        pass
    assert untouched(outside)


def test_a_log_replaces_a_link(tmp_path, outside):
    (tmp_path / "run.log").symlink_to(outside / "run.log")
    runlog.append(tmp_path / "run.log", "a line\n")
    assert (tmp_path / "run.log").read_text() == "a line\n"
    os.close(open_file(tmp_path / "run.log", os.O_RDWR))
    assert (tmp_path / "run.log").read_text() == "a line\n"
    assert untouched(outside)


def test_figures_replace_links_and_refuse_a_folder_that_is_one(tmp_path, outside):
    folder = tmp_path / "results" / "figures"
    folder.mkdir(parents=True)
    for name in ("figures.csv", "a.svg"):
        (folder / name).symlink_to(outside / name)
    write_figures(folder, {"a.svg": b"ours", "figures.csv": b"figure\na\n"})
    write_figures(folder, {"figures.csv": b"figure\n"})
    assert not (folder / "a.svg").exists()
    (tmp_path / "results" / "link").symlink_to(outside)
    (tmp_path / "linked").symlink_to("results")
    for refused in (tmp_path / "results" / "link", tmp_path / "linked" / "figures"):
        with pytest.raises(UserError, match="is a link"):
            write_figures(refused, {"a.svg": b"ours"})
    assert untouched(outside)


def test_no_command_writes_through_a_link(tmp_path, outside, monkeypatch):
    project = tmp_path / "project"
    write_project(project)
    monkeypatch.chdir(project)

    def refused(*words: str) -> str:
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 2, done.output
        assert untouched(outside)
        return done.output + done.stderr

    (project / "results").mkdir()
    (project / "results" / "beam").symlink_to(outside)
    assert "is a link" in refused("import", "beam.yaml")
    (project / "results" / "beam").unlink()
    (project / "results").rmdir()
    (project / "results").symlink_to(outside)
    for command in ("run", "status", "figures"):
        assert "is a link to" in refused(command, "beam.yaml")
    (project / "results").unlink()
    (project / "new.yaml").symlink_to(outside / "new.yaml")
    assert "the file already exists" in refused("init", "beam.bdf", "-o", "new.yaml")
    (project / "lug.yaml").symlink_to(outside / "new.yaml")
    assert "the file already exists" in refused("example", "lug")
    done = CliRunner().invoke(app, ["init", "beam.bdf", "-o", "new.yaml", "--force"])
    assert done.exit_code == 0, done.output
    assert not (project / "new.yaml").is_symlink()
    assert untouched(outside)


NAMES = [
    '=HYPERLINK("http://x","y")', "a,b", "+1+1", "-2+3|'calc'!A0", "@SUM(A1)", "\t=1", "\r=1", "\n=1", "'", "''", "'=1",
    "'quoted", 'say "so"', '"', "line\nbreak", "line\rbreak", "a\r\nb", "a;b", "＝1", "-5", "+1e5", "-inf", "1_0", "+1_0", "σ",
    "x" * 999,
]  # fmt: skip


def read(content: bytes) -> list[list[str]]:
    return list(csv.reader(io.StringIO(content.decode(), newline="")))


@settings(suppress_health_check=[HealthCheck.too_slow], deadline=None)  # the first alphabet takes seconds on a busy machine
@given(st.lists(st.lists(st.one_of(st.text(), st.sampled_from(NAMES)), min_size=1, max_size=4), max_size=4))
def test_any_text_is_read_back_and_no_text_begins_like_a_formula(rows):
    rows = [[cell.encode(errors="replace").decode() for cell in row] for row in rows]
    written = read(csv_bytes(rows))
    assert [[plain_cell(cell) for cell in row] for row in written] == rows
    for cell in (cell for row in written for cell in row if cell[:1] and cell[0] in FORMULA):
        float(cell)  # but numbers, which a spreadsheet shows as they are


def test_gauges_of_any_name_are_read_back(tmp_path):
    rows = [[name, "0.1", "-0.2", "0", "1", "0", "0", f"={name}"] for name in NAMES]
    (tmp_path / "gauges.csv").write_bytes(csv_bytes([[*NEEDED, "notes"], *rows]))
    assert list(read_bonded(tmp_path / "gauges.csv")) == NAMES
    lines = dict(csv_columns(tmp_path / "gauges.csv", NEEDED))
    assert [cells["notes"] for cells in lines.values()] == [f"={name}" for name in NAMES]
    (tmp_path / "two.csv").write_text(f'{",".join(NEEDED)}\n"a\nb",1,2,3,4,5,6\n\nc,1,2,3,4,5,6\n')
    assert list(dict(csv_columns(tmp_path / "two.csv", NEEDED))) == [2, 5]


def test_channels_of_such_names_are_read_from_a_measurement(tmp_path):
    names = [name for name in NAMES if not set(name) & set("\r\n[]();\t")]
    (tmp_path / "measured.csv").write_bytes(
        csv_bytes([["time [s]", *(f"{name} [m/m]" for name in names)], *([f"{t}", *["-1e-06"] * len(names)] for t in range(4))])
    )
    recording = read_csv(tmp_path / "measured.csv", names, time="time", time_unit=None)
    assert list(recording.channels) == names


def test_a_quote_that_is_not_closed_is_named_with_its_line(tmp_path):
    (tmp_path / "gauges.csv").write_text(f"{','.join(NEEDED)}\nG1,0,0,0,1,0,0\n" + '"' + "x" * 200_000)
    with pytest.raises(DeckError, match=r"gauges\.csv:3  the line is not a valid table row") as caught:
        read_bonded(tmp_path / "gauges.csv")
    assert caught.value.remedy
