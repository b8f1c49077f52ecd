"""Text tables come back as they were written, and every line that does not fit is named."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.measurements import csv_file
from strainsight.measurements.csv_file import read_csv
from strainsight.measurements.csv_layout import TextFormat

from ..refusals import expect_refusal

PLAIN = "time [s],a [um/m],b [um/m]\n0,1.5,-2\n0.001,2.5,-3\n0.002,3.5,-4\n"


@pytest.fixture
def read(tmp_path):
    def from_content(content, channels=("a", "b"), time="time", **options):
        path = tmp_path / "test.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_csv(path, channels, time=time, **options)

    return from_content


def expect_plain(recording):
    np.testing.assert_allclose(recording.time, [0, 1e-3, 2e-3], rtol=1e-15)
    np.testing.assert_array_equal(recording.channels["a"], [1.5, 2.5, 3.5])
    np.testing.assert_array_equal(recording.channels["b"], [-2, -3, -4])
    assert recording.units == {"a": "um/m", "b": "um/m"}


@pytest.mark.parametrize(
    "content",
    [
        PLAIN,
        PLAIN.replace("\n", "\r\n"),
        PLAIN.replace("\n", "\r"),
        "\ufeff" + PLAIN,
        PLAIN.replace(",", ";"),
        PLAIN.replace(",", "\t"),
        PLAIN.replace(",", " , "),
        "sep=;\n" + PLAIN.replace(",", ";"),
        "# made by a logger; 1,2,3\n\n" + PLAIN,
        PLAIN + "# the end\n\n",
        "b [um/m],time [s],text,a [um/m]\n-2,0,x,1.5\n-3,0.001,,2.5\n-4,0.002,#DIV/0!,3.5\n",
        'b [um/m],time [s],"text, quoted",a [um/m]\n-2,0,"x,y",1.5\n-3,0.001,,"2.5"\n-4,0.002,"",3.5\n',
        "time,a,b\n[s],[um/m],[um/m]\n0,1.5,-2\n0.001,2.5,-3\n0.002,3.5,-4\n",
        "time [ms],a (um/m),b (um/m)\n0,1.5,-2\n1,2.5,-3\n2,3.5,-4\n",
        "time (ms),a [um/m],b [um/m]\n0,1.5e0,-2E+0\n1,+2.5,-3.\n2,3.5,-4\n",
    ],
)
def test_equivalent_csv_forms_agree(read, content):
    expect_plain(read(content))


def test_decimal_commas_between_commas_are_refused_with_a_remedy(read):
    with expect_refusal(UserError, "the line '0,001,2,5' has 4 cells, but the table has 2 columns", where=":2", remedy="';'"):
        read("time [s],a [um/m]\n0,001,2,5\n", ["a"])


@pytest.mark.parametrize("quoted", [False, True])
def test_missing_samples_are_nan(read, quoted):
    table = "time [s],a [um/m],b [um/m]\n0,,1\n1,nan,\n2, ,NaN\n3,4,5\n"
    found = read(table.replace("4,", '"4",') if quoted else table)
    np.testing.assert_array_equal(found.channels["a"], [np.nan, np.nan, np.nan, 4])
    np.testing.assert_array_equal(found.channels["b"], [1, np.nan, np.nan, 5])


def test_missing_words_from_config(read):
    table = "time [s],a [um/m]\n0,1\n1,NA\n2,-9999\n"
    found = read(table, ["a"], form=TextFormat(missing=("NA", "-9999")))
    np.testing.assert_array_equal(found.channels["a"], [1, np.nan, np.nan])
    # A word that is a number is a word, too: where no other line of the block is odd.
    found = read("time [s],a [um/m]\n0,1\n1,-9999\n2,-9999.5\n", ["a"], form=TextFormat(missing=("-9999",)))
    np.testing.assert_array_equal(found.channels["a"], [1, np.nan, -9999.5])
    with pytest.raises(UserError, match="'NA' in column 'a'"):
        read(table, ["a"])


def test_comment_resembling_row_is_skipped(read):
    found = read("note,time [s],a [um/m]\nx,0,1\n# out,1,2\ny,2,3\n", ["a"])
    np.testing.assert_array_equal(found.time, [0, 2])
    assert found.place(1).endswith(":4")


def test_header_line_setting_and_comment_header(read):
    body = "0,1.5,-2\n0.001,2.5,-3\n0.002,3.5,-4\n"
    expect_plain(read("logger 7\nrate;1000\n\ntime [s],a [um/m],b [um/m]\n" + body, form=TextFormat(header_line=4)))
    expect_plain(read("# time [s],a [um/m],b [um/m]\n" + body, form=TextFormat(header_line=1)))
    with pytest.raises(UserError, match="no names"):
        read("# time [s],a [um/m],b [um/m]\n" + body)


def test_channel_name_with_or_without_unit(read):
    found = read(PLAIN, ["a [um/m]", "b"])
    assert list(found.channels) == ["a [um/m]", "b"]
    assert found.units["a [um/m]"] == "um/m"


def test_brackets_without_unit_belong_to_name(read):
    found = read("time [s],gauge (left),strain[0],strain[1]\n0,1,2,3\n1,4,5,6\n", ["gauge (left)", "strain[1]"])
    assert found.units == {"gauge (left)": None, "strain[1]": None}
    np.testing.assert_array_equal(found.channels["strain[1]"], [3, 6])


@pytest.mark.parametrize("block", [64, 100, 129, 1 << 22])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_block_size_does_not_change_result(read, monkeypatch, block, end):
    monkeypatch.setattr(csv_file, "BLOCK", block)
    rng = np.random.default_rng(1)
    a = np.where(rng.random(300) < 0.1, np.nan, rng.normal(size=300))
    rows = [f"{k},{'' if np.isnan(v) else v:.17g}" if not np.isnan(v) else f"{k}," for k, v in enumerate(a)]
    for at in (250, 120, 7):
        rows.insert(at, "# a remark")
    found = read(end.join(["time [s],a [um/m]", *rows]) + end, ["a"])
    np.testing.assert_array_equal(found.channels["a"], a)
    np.testing.assert_array_equal(found.time, np.arange(300))
    lines = [i for i, row in enumerate(rows, start=2) if not row.startswith("#")]
    assert [found.place(k).rpartition(":")[2] for k in range(300)] == [str(line) for line in lines]


HEAD = "time [s],a [um/m],b [um/m]\n"
FAULTS = {
    # content, line, what is said, word of the remedy
    "a word": (HEAD + "0,1,2\n0.001,oops,3\n", 3, "'oops' in column 'a' is not a number", ""),
    "a cut line": (HEAD + "0,1,2\n0.001,1\n", 3, r"the line '0\.001,1' has 2 cells, but the table has 3 columns", ""),
    "no time": (HEAD + "0,1,2\n,1,2\n", 3, "the sample has no time: ',1,2'", ""),
    "infinite": (HEAD + "0,1,2\n1,inf,2\n", 3, "'inf' in column 'a' is not a finite number", ""),
    "underscores": (HEAD + "0,1,2\n1,1_000,2\n", 3, "'1_000' in column 'a' is not a number", ""),
    "open quote": (HEAD + '0,1,2\n1,"2,3\n', 3, "is not a valid table row", ""),
    "binary": (HEAD + "0,1,2\n1,\0\0,2\n", 3, "the file is binary, not a text table", ""),
    "too few units": (HEAD + "[s],[um/m]\n0,1,2\n", 2, "the line of units has 2 cells, but the table has 3 columns", ""),
    "other units": (HEAD + "[s],[mm],[um/m]\n0,1,2\n", 2, "is um/m in the line of column names", ""),
    "a date alone": (HEAD + "2024-05-01,1,2\n", 2, r"write the time in seconds, or as clock time: 10:00:00\.01, 2024-05-03", ""),
    "a number below clock times": (HEAD + "12:00:00,1,2\n7,1,2\n", 3, "'7' in column 'time' is not a clock time later than", ""),
    "no such column": ("time [s],aa,b\n0,1,2\n", None, "column 'a' not found", "did you mean aa?"),
    "twice": ("time [s],a,a,b\n0,1,2,3\n", None, "the columns 2, 3 have the same name 'a'", "unique name"),
    "two delimiters": ("time [s];a;b, left\n0;1;2\n", None, "commas and semicolons", "the delimiter"),
    "no names": ("0,1,2\n1,2,3\n", None, "no names", "line of column names"),
    "no unit of time": ("time,a,b\n0,1,2\n1,2,3\n", None, "the file does not define the unit of the time", "time [s]"),
    "no numbers": ("time [s],a,b\n", None, "the table has no numbers", "again"),
    "one sample": ("time [s],a,b\n0,1,2\n", None, "only one sample", "two"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_named_with_their_line_and_a_remedy(read, fault):
    content, line, said, remedy = FAULTS[fault]
    with expect_refusal(UserError, said, where=line and f"test.csv:{line}", remedy=remedy):
        read(content)


def test_time_unit_in_config_or_file(read):
    np.testing.assert_allclose(read("time,a\n0,1\n1,2\n", ["a"], time_unit="ms").time, [0, 1e-3])
    with pytest.raises(UserError, match="the time unit is s in the config, but ms in the file"):
        read("time [ms],a\n0,1\n1,2\n", ["a"], time_unit="s")
