"""A load history is read from the text tables that people have; what is wrong with one has its line."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.cases.recorded import recorded
from strainsight.config.loads import Recorded
from strainsight.errors import UserError

COLUMNS = Recorded(type="csv", file="own.csv", time_column="time", value_column="F")
KEY = "loads.tip.signal"


@pytest.fixture
def table(tmp_path):
    def written(text: str):
        path = tmp_path / "load.csv"
        path.write_text(text, encoding="utf-8")
        return path

    return written


@pytest.mark.parametrize(
    "text",
    [
        "time,F\n0,1500\n0.5,-2500\n",
        "F,other,time\n1500,x,0\n-2500,y,0.5\n",
        "time;F\n0,0;1500,0\n0,5;-2500,0\n",
        "sep=;\r\ntime;F\r\n0;1500\r\n0,5;-2500\r\n",
        "time\tF\n0\t1500\n0,5\t-2500\n",
        '# of the test bench\n"time","F"\n"0,0","1500"\n"0,5","-2500"\n',
        "time [s];F [kN]\n0;1,5\n0,5;-2,5\n",
        "time [ms],F [N]\n0,1500\n500,-2500\n",
    ],
)
def test_the_same_history_however_it_is_written(table, text):
    found = recorded(KEY, COLUMNS, table(text))
    np.testing.assert_array_equal(found.time, [0.0, 0.5])
    np.testing.assert_array_equal(found.value, [1500.0, -2500.0])


@pytest.mark.parametrize(
    ("text", "line", "what", "remedy"),
    [
        ("time,F\n0,0,1,5\n0,5,2,5\n", ":2", "4 cells where the names are 2", "with ';'"),
        ("time,F\n0,1\n0.5,1\n0.5,2\n", ":4", "does not increase from 0.5 s to 0.5 s", "drop repeated times"),
        ("# one\ntime;F\n0;1\n1;x\n2;3\n", ":4", "'x' under 'F' is no number", "give a number"),
        ("time,F\n0,1\n1,\n2,3\n", ":3", "no sample under 'F'", "no gaps"),
        ("time;F\n0,5;1\n1.5;2\n", ":2", "'0,5' under 'time' is no number", "decimal mark"),
        ("time;f\n0;1\n1;2\n", ":1", "no column 'F'", "did you mean f?"),
        ("time;F [um/m]\n0;1\n1;2\n", "", "'F' is in um/m", "the column of the load"),
    ],
)
def test_what_is_wrong_is_reported_with_the_file(table, text, line, what, remedy):
    path = table(text)
    with pytest.raises(UserError) as caught:
        recorded(KEY, COLUMNS, path)
    assert caught.value.key == (f"{KEY}.value_column" if "no column" in what else KEY)
    assert caught.value.where == (f"{path}{line}" if line else None)
    assert what in caught.value.what
    assert remedy in caught.value.remedy
