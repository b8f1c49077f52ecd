"""What a config refers to is asked for at `import`: nodes, sets, histories; and the table of an import."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.config.loads import UNITS, LoadSection, RecordedSection
from strainsight.decks.reader import read_mesh
from strainsight.errors import UserError
from strainsight.experiment.recorded import LOADS, QUANTITY, recorded
from strainsight.experiment.structure.mesh_tables import build_mesh_tables
from strainsight.experiment.structure.references import on_one_node

from ..edges.beam import TIP, bricks, finished
from ..fem.test_thin import straight
from ..mesh.test_shell_faces import plate, strip

GAUGES = {"direction": {"type": "axis", "axis": [1, 0, 0], "angles": [0.0]}, "noise_std": {"relative_to_strongest": 0.01}}
SENSOR = {"quantity": "displacement", "noise_std": {"value": 1e-6}, "surface": "lid"}
MODULUS = {"property": "youngs_modulus", "region": 1, "guess": 210000.0, "range": [1.8e5, 2.2e5]}


@pytest.mark.parametrize(
    ("changes", "key", "what"),
    [
        ({"loads.tip.node": 99999}, "loads.tip", "node 99999, which does not exist"),
        ({"loads.tip.node": None, "loads.tip.set": "tipp"}, "loads.tip", "node set 'tipp', which does not exist"),
        ({"parameters.E.guess": {"from": "other"}, "parameters.E.region": 7}, "parameters.E.region", "no region 7"),
        ({"parameters": {"E": MODULUS}, "validate.truth.parameters": {"E": 2e5}}, "parameters.E.guess", "of the deck is 2.1e"),
        ({"gauges": GAUGES | {"exclude": [{"near_set": {"set": "rim", "distance": 0.1}}]}}, "gauges.exclude.0", "'rim'"),
        ({"motion_sensors": {"laser": SENSOR}}, "motion_sensors.laser.surface", "no face, element set or node set 'lid'"),
    ],
)
def test_what_is_not_in_the_mesh_is_named_at_once(tmp_path, changes, key, what):
    with pytest.raises(UserError, match=what) as caught:
        finished(tmp_path, "import", bricks((4, 2, 2)), changes)
    assert caught.value.key == key


def test_a_force_on_one_node_of_a_solid_or_a_shell_is_warned_of_and_one_on_a_tie_or_a_beam_is_not(tmp_path):
    solid = finished(tmp_path / "solid", "import", bricks((4, 2, 2), tip=False), {"loads.tip.node": 45})
    assert any("loads.tip is a concentrated force on node 45 of a solid" in text for text in solid["import"].warnings)
    tie = finished(tmp_path / "tie", "import", bricks((4, 2, 2)), {"loads.tip.node": TIP})
    assert not any("a concentrated force on" in text for text in tie["import"].warnings)
    signal = {"type": "sine", "frequency": 1.0, "amplitude": 1.0}
    push = LoadSection(node=100, direction=(0.0, 0.0, 1.0), known=True, signal=signal)
    shells = plate(*strip())
    assert "a concentrated force on node 100 of a shell" in on_one_node({"push": push}, shells)[0]
    assert not on_one_node({"push": push}, replace(shells, beams=(straight(1).beams[0],)))


def test_runs_that_differ_in_their_loads_alone_share_the_modes(tmp_path):
    """The mesh is what `import` writes; that it looks at loads too changes nothing in it."""
    one = finished(tmp_path / "one", "modes", bricks((4, 2, 2)), {})
    other = finished(tmp_path / "other", "modes", bricks((4, 2, 2)), {"loads.tip.direction": [1, 0, 0]})
    assert one["import"].digest == other["import"].digest
    assert one["modes"].key == other["modes"].key


COLUMNS = RecordedSection(type="csv", file="own.csv", time_column="time", value_column="F")
KEY = "loads.tip.signal"
MEANT = {"KN": "kN?", "kp": "kgf?", "tf": "kN (1 tf", "NM": "Nm?", "mn": "mN or MN?"}


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
        "time;F\n0,0;1500,0\n0,5;-2500,0\n",
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
        ("time,F\n0,1\n0.5,1\n0.5,2\n", ":4", "does not increase from 0.5 s to 0.5 s", "delete lines with repeated times"),
        ("time,F\n0,1\n1,\n2,3\n", ":3", "missing value in column 'F'", "must not have gaps"),
        ("time;f\n0;1\n1;2\n", ":1", "column 'F' not found", "did you mean f?"),
        *(
            (f"time;F [{unit}]\n0;1\n1;2\n", "", f"unknown unit {unit} of column 'F'", f"did you mean {meant}")
            for unit, meant in MEANT.items()
        ),
        ("time;F [volt]\n0;1\n1;2\n", "", "unknown unit volt of column 'F'", "known units: m/s2, "),
    ],
)
def test_what_is_wrong_is_reported_with_the_file(table, text, line, what, remedy):
    path = table(text)
    with pytest.raises(UserError) as caught:
        recorded(KEY, COLUMNS, path)
    assert caught.value.key == (f"{KEY}.value_column" if "not found" in what else KEY)
    assert caught.value.where == (f"{path}{line}" if line else None)
    assert what in caught.value.what
    assert remedy in caught.value.remedy


def test_a_unit_in_round_brackets_that_is_almost_one_is_asked_about_and_other_words_are_none(table):
    with pytest.raises(UserError, match=r"did you mean kgf\?"):
        recorded(KEY, COLUMNS.model_copy(update={"value_column": "F (kp)"}), table("time;F (kp)\n0;1\n1;2\n"))
    for name in ("F (top)", "F (2)"):
        found = recorded(KEY, COLUMNS.model_copy(update={"value_column": name}), table(f"time;{name}\n0;1\n1;2\n"))
        assert found.value.tolist() == [1.0, 2.0]


def test_a_force_is_in_no_unit_of_a_moment_and_every_unit_of_a_load_is_one_of_a_quantity(table):
    path = table("time;F [N*m]\n0;1\n1;2\n")
    assert recorded(KEY, COLUMNS, path, ("moment",)).value.tolist() == [1.0, 2.0]
    with pytest.raises(UserError, match="which is not a unit of force"):
        recorded(KEY, COLUMNS, path, ("force",))
    assert {*UNITS.values(), "N"} == {*QUANTITY}
    assert {*QUANTITY.values()} == {*LOADS}


DECK = """\
GRID,1
GRID,2,,1.
GRID,3,,,1.
GRID,4,,,,1.
CTETRA,10,3,1,2,3,4
PSOLID,3,1
MAT1,1,2.1+11,,.3,7850.
SPC1,1,123,1,2,3
RBE2,20,4,123,2,3
MPC,5,4,1,1.,1,1,-1.
CMASS2,30,2.5,4,2
EIGRL,1
"""


def test_the_table_of_an_import_has_what_was_found_with_numbers_and_nodes(tmp_path):
    path = tmp_path / "a.bdf"
    path.write_text(DECK)
    (table,) = build_mesh_tables(read_mesh(path), None, (), ("one is odd",))
    assert ("warning", "", "one is odd") in table.rows
    found = {what: (how_many, detail) for what, how_many, detail in table.rows}
    assert found["fixed"] == ("9 components", "3 nodes")
    assert found["MPC 5"] == ("2 motions", "dependent degree of freedom: node 4 component 1")
    assert found["point mass 30"] == ("0.833333 kg", "node 4, along x, y, z 0, 2.5, 0 kg")
    assert found["ignored"] == ("EIGRL", "1 time, without effect")
