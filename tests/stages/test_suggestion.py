"""What `strainsight init` takes from a deck is in the deck."""

from __future__ import annotations

import pytest

from strainsight.config.load import load_config
from strainsight.config.template import template
from strainsight.stages.suggestion import suggestion

DECK = """\
GRID,1
GRID,2,,{L}
GRID,3,,,{L}
GRID,4,,,,{L}
GRID,9,,{L},{L},{L}
CTETRA,10,{small},1,2,3,4
CTETRA,20,7,2,3,4,9
CTETRA,21,7,1,2,3,9
PSOLID,{small},1
PSOLID,7,2
MAT1,1,{E},,.3,{rho}
MAT1,2,{E},,.3,{rho}
SET1,5,1,2
{more}
"""


def deck(path, L="1.", E="2.1+11", rho="7850.", more="SPC1,1,123,1,2,3"):
    path.write_text(DECK.format(L=L, E=E, rho=rho, more=more, small=3))
    return path


@pytest.mark.parametrize(
    ("L", "E", "rho", "units"),
    [
        ("1.", "2.1+11", "7850.", ("m", "kg")),
        ("1000.", "2.1+5", "7.85-9", ("mm", "t")),
        ("1000.", "2.1+8", "7.85-6", ("mm", "kg")),
        ("39.4", "3.046+7", "7.345-4", ("in", "lbf*s2/in")),
    ],
)
def test_units_are_those_in_which_the_material_makes_sense(tmp_path, L, E, rho, units):
    found = suggestion(deck(tmp_path / "a.bdf", L, E, rho))
    assert (found.length_unit, found.mass_unit) == units
    assert found.youngs_modulus == pytest.approx(2.1e11, rel=1e-3)


@pytest.mark.parametrize(
    ("more", "node"),
    [
        ("SPC1,1,123,1,2,3", 9),
        ("SPC1,1,123,1,2,3\nFORCE,1,4,,1.,0.,0.,1.", 4),
        ("SPC1,1,123,1,2,3\nFORCE,1,4,,1.,0.,0.,1.\nGRID,50,,2.,2.,2.\nRBE2,60,50,123,9", 50),
        ("SPC1,1,123456,50\nGRID,50,,2.,2.,2.\nRBE2,60,50,123,9", 1),
    ],
)
def test_the_loaded_node_can_move(tmp_path, more, node):
    assert suggestion(deck(tmp_path / "a.bdf", more=more)).node == node


def test_the_largest_region_is_the_free_one_and_the_rest_is_as_the_deck_states_it(tmp_path):
    found = suggestion(deck(tmp_path / "a.bdf", more=""))
    assert (found.region, found.materials, found.supports, found.node_set) == (7, True, False, "SET1-5")


@pytest.mark.parametrize("more", ["", "SPC1,1,123,1,2,3"])
def test_the_config_made_of_it_is_valid(tmp_path, more):
    path = tmp_path / "own.yaml"
    path.write_text(template("a.bdf", suggestion(deck(tmp_path / "a.bdf", more=more))), encoding="utf-8")
    data = load_config(path).data
    assert bool(data["mesh"]["supports"]) == (not more)
    assert data["parameters"]["E"]["guess"] == pytest.approx(2.1e11, rel=1e-3)


FORCES = "FORCE,7,4,,4.,0.,0.,1.\nFORCE,7,9,,3.,0.,1.,0."


@pytest.mark.parametrize(
    ("forces", "name", "force"),
    [
        (FORCES, "FORCE-7", 5.0),
        (f"FORCE,5,1,,1.,0.,0.,1.\n{FORCES}", "FORCE-7", 5.0),  # 1 is held
        (f"FORCE,5,4,,1.,0.,0.,1.\nFORCE,5,9,,1.,0.,0.,-1.\n{FORCES}", "FORCE-7", 5.0),  # 5 is in balance
        ("FORCE,5,1,,1.,0.,0.,1.", None, 1e4),
    ],
)
def test_the_load_is_that_of_the_deck_where_it_has_one_that_acts(tmp_path, forces, name, force):
    path = deck(tmp_path / "a.bdf", "1000.", "2.1+5", "7.85-9", f"SPC1,1,123,1,2,3\n{forces}")
    found = suggestion(path)
    assert (found.deck_load, found.force) == (name, pytest.approx(force))
    own = tmp_path / "own.yaml"
    own.write_text(template("a.bdf", found), encoding="utf-8")
    tip = load_config(own).model.loads["tip"]
    assert tip.deck_load == name
    assert (tip.node, tip.direction) == ((None, None) if name else (found.node, (0, 0, 1)))
    assert tip.signal.amplitude == pytest.approx(force)
