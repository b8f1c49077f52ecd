"""Text tables as catman, DIAdem and LabVIEW export them: read, or refused with the key of the config and its value."""

from __future__ import annotations

import re
from typing import get_args

import numpy as np
import pytest

from strainsight.config.estimate import FileFormat
from strainsight.errors import UserError
from strainsight.measurements.csv_layout import TextFormat
from strainsight.measurements.reader import FORMATS, read_recording

from ..refusals import expect_refusal

COUNT = 300
T = 1e-3 * np.arange(COUNT)
A = np.round(100 * np.sin(40 * T), 6)
F = np.round(2.5 * np.cos(9 * T), 6)
TIME = "Zeit  1 - Standardmessrate"
ABOVE = ["HBM catmanEasy V5.3", "Bremsversuch 3", "", "Anzahl Kanäle:\t3", "T0 = 22.11.2021 09:42:17"]
LVM = """LabVIEW Measurement\t
Writer_Version\t2
Reader_Version\t2
Separator\tTab
Decimal_Separator\t,
Multi_Headings\tNo
X_Columns\tOne
Time_Pref\tAbsolute
Operator\tSYSTEM
Date\t2021/11/22
Time\t09:42:17,1234567
***End_of_Header***\t
\t
Channels\t2\t\t
Samples\t300\t300\t
Date\t2021/11/22\t2021/11/22\t
Time\t09:42:17,1234567\t09:42:17,1234567\t
Y_Unit_Label\tum/m\tkN\t
X_Dimension\tTime\tTime\t
X0\t0,0000000000000000E+0\t0,0000000000000000E+0\t
Delta_X\t0,001000\t0,001000\t
***End_of_Header***\t\t\t
X_Value\tG1\tF\tComment"""


def rows(mark, decimal=","):
    return [mark.join(f"{x:.6f}".replace(".", decimal) for x in row) for row in zip(T, A, F, strict=True)]


def written(path, lines):
    path.write_bytes(("\r\n".join(lines) + "\r\n").encode("cp1252"))
    return path


def read(path, channels=("G1", "F"), time="Time", **form):
    return read_recording(path, list(channels), time=time, time_unit="s", form=TextFormat(**form, key="estimate.text"))


def the_record(found, names=("G1", "F")):
    np.testing.assert_allclose(found.time, T, atol=1e-15)
    for name, values, unit in zip(names, (A, F), (("µm/m", "um/m"), ("kN",)), strict=True):
        np.testing.assert_array_equal(found.channels[name], values)
        assert found.units[name] in unit


def advised(path, key, **options):
    with pytest.raises(UserError) as caught:
        read(path, **options)
    found = re.search(rf"`estimate\.text\.{key}: (.*?)`", caught.value.remedy)
    assert found, str(caught.value)
    return found[1]


@pytest.mark.parametrize("mark", ["\t", ";"])
@pytest.mark.parametrize("below", [True, False])
def test_catman_export_is_read(tmp_path, mark, below):
    names = [TIME, "MX840A_0 hw Kanal_1", "Kraft"]
    units = ["s", "µm/m", "kN"]
    head = (
        [mark.join(names), mark.join(units)]
        if below
        else [mark.join(f"{n} [{u}]" for n, u in zip(names, units, strict=True))]
    )
    options = {"channels": names[1:], "time": TIME}
    path = written(tmp_path / "catman.asc", [*ABOVE, *head, *rows(mark)])
    line = int(advised(path, "header_line", **options))
    assert line == 6
    assert advised(path, "decimal", header_line=line, **options) == '","'
    the_record(read(path, header_line=line, decimal=",", **options), names[1:])


def test_ambiguous_delimiter_is_refused(tmp_path):
    path = written(tmp_path / "a.csv", ["Time [s];G1, links [um/m];F [kN]", *rows(";")])
    assert advised(path, "delimiter", channels=("G1, links", "F")) == '";"'
    the_record(read(path, ("G1, links", "F"), delimiter=";", decimal=","), ("G1, links", "F"))


@pytest.mark.parametrize(
    ("decimal", "cells", "values"),
    [
        (",", ["3.998,93", "1.003.998,93", "-12,5"], [3998.93, 1003998.93, -12.5]),
        (".", ["1,234.5", "-1,012,533.25", "999.5"], [1234.5, -1012533.25, 999.5]),
        (".", ["1'234.5", "1 234.5", "1\u00a0234.5"], [1234.5, 1234.5, 1234.5]),
        (".", ["+ 0.081", "- 1.5", "+.5"], [0.081, -1.5, 0.5]),
        (",", ["+ 0,081", "- 1.234,5", "+ 2"], [0.081, -1234.5, 2.0]),
    ],
)
def test_thousands_separators_and_spaced_signs(tmp_path, decimal, cells, values):
    lines = [f"{i};{cell}" for i, cell in enumerate(cells)]
    path = written(tmp_path / "a.csv", ["Time;G1", *lines])
    np.testing.assert_array_equal(read(path, ("G1",), decimal=decimal).channels["G1"], values)


@pytest.mark.parametrize(("decimal", "cell"), [(".", "1,234"), (",", "1.234"), (".", "1 234"), (".", "1.234,5")])
def test_ambiguous_thousands_separator_is_refused(tmp_path, decimal, cell):
    path = written(tmp_path / "a.csv", ["Time;G1", f"0;{cell}", "1;2"])
    with expect_refusal(UserError, "in column 'G1' is not a number", remedy="thousands") as caught:
        read(path, ("G1",), decimal=decimal)
    assert "missing" not in caught.value.remedy
    assert ("decimal:" in caught.value.remedy) == ("," in cell)


@pytest.mark.parametrize("decimal", [",", "."])
def test_labview_header_defines_format(tmp_path, decimal):
    head = LVM.replace("Decimal_Separator\t,", f"Decimal_Separator\t{decimal}").split("\n")
    path = written(tmp_path / "a.lvm", [*head, *rows("\t", decimal)])
    the_record(read(path, time="X_Value"))
    lines = rows("\t", decimal)
    lines[7] += "\tfirst brake"
    lines[8] += "\t"
    found = read(written(path, [*head, *lines]), time="X_Value")
    the_record(found)
    assert found.place(0).endswith("a.lvm:24")


@pytest.mark.parametrize(
    ("change", "said", "remedy"),
    [
        (("X_Columns\tOne", "X_Columns\tNo"), "times are not written", "one column"),
        (("X_Columns\tOne", "X_Columns\tMulti"), "every channel has a separate time", "one column"),
        (("***End_of_Header***\t\t\t", ""), r"does not have two lines \*\*\*End_of_Header\*\*\*", "export the test data again"),
    ],
)
def test_unsupported_labview_files_are_refused(tmp_path, change, said, remedy):
    path = written(tmp_path / "a.lvm", [*LVM.replace(*change).split("\n"), *rows("\t")])
    with expect_refusal(UserError, said, remedy=remedy):
        read(path, time="X_Value")


def test_second_labview_segment_is_refused(tmp_path):
    path = written(tmp_path / "a.lvm", [*LVM.split("\n"), *rows("\t"), "", *LVM.split("\n")[13:], *rows("\t")])
    with expect_refusal(UserError, f"a.lvm:{24 + COUNT + 1}  ", remedy="a new table (segment of the recording) begins here"):
        read(path, time="X_Value")


def test_text_lines_are_skipped_by_prefix(tmp_path):
    path = written(tmp_path / "a.csv", ["Time;G1;F", "DT_DOUBLE;DT_DOUBLE;DT_DOUBLE", "s;µm/m;kN", *rows(";")])
    assert advised(path, "comment", decimal=",") == '"DT_DOUBLE"'
    the_record(read(path, decimal=",", comment="DT_DOUBLE"))


@pytest.mark.parametrize(
    ("cells", "seconds"),
    [
        (["22.11.2021 09:42:17,100", "22.11.2021 09:42:17,200"], [0, 0.1]),
        (["2024-05-03T10:00:00.00+02:00", "2024-05-03T10:00:00.01+02:00", "2024-05-03T08:00:00.02Z"], [0, 0.01, 0.02]),
        (["2024/5/3 9:00:00", "2024/5/5 9:00:00"], [0, 172800]),
        (["23:59:59.999999", "00:00:00.000000"], [0, 1e-6]),
        (["5/3/2024 11:59:59.5 AM", "5/3/2024 12:00:00.5 PM"], [0, 1]),
        (["12:59:59 pm", "01:00:00 pm"], [0, 1]),
        (["03-May-2024 10:00:00", "03-May-2024 10:00:02"], [0, 2]),
        (["10:00:00:010", "10:00:00:020"], [0, 0.01]),
    ],
)
@pytest.mark.parametrize("decimal", [",", "."])
def test_clock_times_are_seconds_since_the_first(tmp_path, cells, seconds, decimal):
    path = written(tmp_path / "a.csv", ["Time (-)\tG1", *(f"{cell}\t1" for cell in cells)])
    for name in ("Time", "Time (-)"):
        np.testing.assert_allclose(read(path, ("G1",), time=name, decimal=decimal).time, seconds, rtol=0, atol=1e-12)


def test_rate_replaces_time(tmp_path):
    path = written(tmp_path / "a.csv", ["G1 [um/m],F [kN]", "0.0,2.5", ",2.4", "24.9,2.3"])
    recording = read_recording(path, ["F", "G1"], rate=100.0)
    np.testing.assert_array_equal(recording.time, [0, 0.01, 0.02])
    np.testing.assert_array_equal(recording.channels["G1"], [0, np.nan, 24.9])
    assert recording.units == {"F": "kN", "G1": "um/m"}
    assert recording.place(2).endswith("a.csv:4")
    path = written(tmp_path / "one.csv", ["G1", "1", "1", "2"])
    np.testing.assert_array_equal(read_recording(path, ["G1"], rate=100.0).channels["G1"], [1, 1, 2])


def test_sample_counter_is_not_time(tmp_path):
    path = written(tmp_path / "a.csv", ["Sample No,G1 [um/m]", "1,0.0", "2,12.5", "3,24.9"])
    with expect_refusal(UserError, r"No' counts samples \(1, 2, …\) instead of defining the time", remedy="rate"):
        read(path, ("G1",), time="Sample No")
    assert read_recording(path, ["G1"], rate=2e3).time[-1] == 1e-3


def test_trailing_delimiter_is_accepted(tmp_path):
    the_record(
        read(written(tmp_path / "a.csv", ["Time;G1;F", "s;µm/m;kN", *(f"{row};" for row in rows(";"))]), decimal=",")
    )
    path = written(tmp_path / "b.csv", ["Time,G1,F", *(f"{row}," for row in rows(",", "."))])
    with pytest.raises(UserError, match=r"the line '0\.000000,0\.000000,2\.500000,' has 4 cells, but the table has 3 columns"):
        read(path)


def test_config_lists_all_formats():
    assert get_args(FileFormat) == ("auto", *FORMATS)
