"""A table is read back as it was written, and a spreadsheet finds no formula in it."""

from __future__ import annotations

import csv
import io

import pytest
from hypothesis import given
from hypothesis import strategies as st

from strainsight.cases.structure.bonded_file import NEEDED, read_bonded
from strainsight.csv_cells import FORMULA, csv_bytes, plain_cell
from strainsight.decks.matrices.files import csv_columns
from strainsight.errors import DeckError
from strainsight.measurements.csv_file import read_csv

NAMES = [
    '=HYPERLINK("http://x","y")', "a,b", "+1+1", "-2+3|'calc'!A0", "@SUM(A1)", "\t=1", "\r=1", "\n=1", "'", "''", "'=1",
    "'quoted", 'say "so"', '"', "line\nbreak", "line\rbreak", "a\r\nb", "a;b", "＝1", "-5", "+1e5", "-inf", "1_0", "+1_0", "σ",
    "x" * 999,
]  # fmt: skip


def read(content: bytes) -> list[list[str]]:
    return list(csv.reader(io.StringIO(content.decode(), newline="")))


@given(st.lists(st.lists(st.one_of(st.text(), st.sampled_from(NAMES)), min_size=1, max_size=4), max_size=4))
def test_any_text_is_read_back_and_no_text_begins_like_a_formula(rows):
    rows = [[cell.encode(errors="replace").decode() for cell in row] for row in rows]
    written = read(csv_bytes(rows))
    assert [[plain_cell(cell) for cell in row] for row in written] == rows
    for cell in (cell for row in written for cell in row if cell[:1] and cell[0] in FORMULA):
        float(cell)  # but numbers, which a spreadsheet shows as they are


def test_numbers_stay_numbers():
    cells = ["1", "-0.5", "+2", "1e-09", "-1.25e+11", "inf", "-inf", "nan", ""]
    assert csv_bytes([cells]).decode() == ",".join(cells) + "\n"


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
    with pytest.raises(DeckError, match=r"gauges\.csv:3  is no line of a table") as caught:
        read_bonded(tmp_path / "gauges.csv")
    assert caught.value.remedy
