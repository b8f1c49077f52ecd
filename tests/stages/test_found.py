"""The table of an import: sentences in its last column, and words that fit their number."""

from __future__ import annotations

from strainsight.decks.reader import read_mesh
from strainsight.stages.pages.found import found_tables

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
FORCE,7,4,,10.,0.,0.,1.
SET1,5,1,2
SET1,6,4
EIGRL,1
"""


def test_sentences_stand_in_the_last_column(tmp_path):
    rows = table(tmp_path, warnings=("one is odd",))
    assert ("warning", "", "one is odd") in rows
    sentences = [row for row in rows if row[0] in ("warning", "note")]
    assert all(how_many == "" and detail for _, how_many, detail in sentences)


def test_one_is_not_said_as_many(tmp_path):
    found = {what: (how_many, detail) for what, how_many, detail in table(tmp_path)}
    assert found["load FORCE-7"][0] == "1 node"
    assert found["node set SET1-6"][0] == "1 node"
    assert found["node set SET1-5"][0] == "2 nodes"
    assert found["fixed"] == ("9 components", "3 nodes")
    assert found["MPC 5"] == ("2 motions", "node 4 component 1 follows")
    assert found["point mass 30"] == ("0.833333 kg", "node 4, along x, y, z 0, 2.5, 0 kg")
    assert found["ignored"] == ("EIGRL", "1 time, of no effect here")


def table(folder, warnings=()):
    path = folder / "a.bdf"
    path.write_text(DECK)
    (found,) = found_tables(read_mesh(path), None, (), warnings)
    return found.rows
