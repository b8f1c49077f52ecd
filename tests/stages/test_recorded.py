"""A load history is read from the text tables that people have; what is wrong with one has its line."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.cases.recorded import LOADS, QUANTITY, recorded
from strainsight.config.loads import UNITS, Recorded
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
        *(
            (f"time;F [{unit}]\n0;1\n1;2\n", "", f"'F' is in {unit}", f"did you mean {meant}")
            for unit, meant in (
                *(("KN", "kN?"), ("kn", "kN?"), ("kNewton", "kN?"), ("kp", "kgf?"), ("tf", "kN (1 tf"), ("klb", "kip?")),
                *(("knewton", "kN?"), ("NM", "Nm?"), ("mn", "mN or MN?"), ("N-m", "N m?"), ("N/mm2", "MPa?")),
            )
        ),
        ("time;F [volt]\n0;1\n1;2\n", "", "'F' is in volt", "known units: m/s2, "),
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


def test_a_unit_in_round_brackets_that_is_almost_one_is_asked_about_and_other_words_are_none(table):
    for name, meant in (("F (KN)", "kN"), ("F (kp)", "kgf"), ("F (klb)", "kip")):
        with pytest.raises(UserError) as caught:
            recorded(KEY, COLUMNS.model_copy(update={"value_column": name}), table(f"time;{name}\n0;1\n1;2\n"))
        assert f"did you mean {meant}?" in str(caught.value)
    for name in ("F (top)", "F (z)", "F [-]", "F (2)"):
        column = "F" if "[" in name else name
        found = recorded(KEY, COLUMNS.model_copy(update={"value_column": column}), table(f"time;{name}\n0;1\n1;2\n"))
        assert found.value.tolist() == [1.0, 2.0]


def test_a_force_is_in_no_unit_of_a_moment(table):
    path = table("time;F [N*m]\n0;1\n1;2\n")
    assert recorded(KEY, COLUMNS, path, ("moment",)).value.tolist() == [1.0, 2.0]
    with pytest.raises(UserError, match="no unit of a load that is a force"):
        recorded(KEY, COLUMNS, path, ("force",))


def test_every_unit_of_a_load_is_one_of_a_quantity():
    assert {*UNITS.values(), "N"} == {*QUANTITY}
    assert {*QUANTITY.values()} == {*LOADS}
