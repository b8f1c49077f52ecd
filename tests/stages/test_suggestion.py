"""What `strainsight init` takes from a deck is in the deck."""

from __future__ import annotations

import json

import numpy as np
import pytest

from strainsight.config.template import template
from strainsight.stages.suggestion import suggestion

DECK = """\
GRID,1
GRID,2,,{L}
GRID,3,,,{L}
GRID,4,,,,{L}
GRID,9,,{L},{L},{L}
CTETRA,10,3,1,2,3,4
CTETRA,20,7,2,3,4,9
CTETRA,21,7,1,2,3,9
PSOLID,3,1
PSOLID,7,2
MAT1,1,{E},,.3,{rho}
MAT1,2,{E},,.3,{rho}
SET1,5,1,2
{more}
"""


def deck(path, L="1.", E="2.1+11", rho="7850.", more="SPC1,1,123,1,2,3"):
    path.write_text(DECK.format(L=L, E=E, rho=rho, more=more))
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


def test_units_that_make_no_sense_are_left_blank(tmp_path):
    """MPa beside kg/mm³, as many decks have it: E is 2.1e5 Pa in m and kg."""
    found = suggestion(deck(tmp_path / "a.bdf", "1000.", "2.1+5", "7.85-6"))
    assert (found.length_unit, found.mass_unit, found.youngs_modulus, found.places) == ("", "", None, ())
    assert "  # E = 2.1e+05 and ρ = 7.85e-06 are implausible in all common units" in template("a.bdf", found)
    assert "no carrier of the catalogue fits" in template("a.bdf", suggestion(deck(tmp_path / "b.bdf", "0.001")))


def places(path, kind):
    return [(own.name, own.supported) for own in suggestion(path).places if own.kind == kind]


@pytest.mark.parametrize(
    ("more", "nodes"),
    [
        ("SPC1,1,123,1,2,3", []),
        ("SPC1,1,123,1,2,3\nGRID,50,,2.,2.,2.\nRBE2,60,50,123,9", [("50", False)]),
        ("SPC1,1,123456,50\nGRID,50,,2.,2.,2.\nRBE2,60,50,123,9", [("50", True)]),
        ("SPC1,1,123,1,2,3\nRBE3,60,,9,456,1.,123,2,3\n,4", []),  # a rotation alone
    ],
)
def test_a_tie_offers_its_reference_and_no_node_of_a_solid_is_made_up(tmp_path, more, nodes):
    assert places(deck(tmp_path / "a.bdf", more=more), "node") == nodes


def test_the_largest_region_is_the_free_one_and_the_rest_is_as_the_deck_states_it(tmp_path):
    found = suggestion(deck(tmp_path / "a.bdf", more=""))
    assert (found.region, found.lacking, found.supports) == (7, (), False)
    assert places(tmp_path / "a.bdf", "set") == [("SET1-5", False)]


FORCES = "FORCE,7,4,,4.,0.,0.,1.\nFORCE,7,9,,3.,0.,1.,0."
BALANCE = "FORCE,5,4,,1.,0.,0.,1.\nFORCE,5,9,,1.,0.,0.,-1."


@pytest.mark.parametrize(
    ("forces", "loads"),
    [
        (f"FORCE,5,1,,1.,0.,0.,1.\n{FORCES}", [("FORCE-5", True), ("FORCE-7", False)]),  # 1 is held
        (f"{BALANCE}\n{FORCES}", [("FORCE-5", False), ("FORCE-7", False)]),
    ],
)
def test_loads_of_the_deck_are_offered_with_size_direction_and_place(tmp_path, forces, loads):
    path = deck(tmp_path / "a.bdf", "1000.", "2.1+5", "7.85-9", f"SPC1,1,123,1,2,3\nSET1,6,4,9\n{forces}")
    assert places(path, "deck_load") == loads
    found = {load.name: load for load in suggestion(path).loads}
    assert found["FORCE-7"].force == pytest.approx(5.0)
    assert found["FORCE-7"].what == "5 N along (0, 0.6, 0.8) at set SET1-6, centre (500, 500, 1000) mm"
    if "FORCE,5,1" in forces:
        assert found["FORCE-5"].what == "1 N along (0, 0, 1) at node 1, (0, 0, 0) mm"
    else:  # ± 1 N along z at (0, 0, 1) and (1, 1, 1) m
        assert (found["FORCE-5"].factor, found["FORCE-5"].what.split(" at ")[0]) == (True, "1.414 N m about (-0.707, 0.707, 0)")


def test_faces_are_offered_in_metres_whatever_the_unit_of_the_deck(tmp_path):
    found = suggestion(deck(tmp_path / "a.bdf", "1000.", "2.1+5", "7.85-9"))
    faces = [own for own in found.places if own.kind == "face"]
    points = np.array([json.loads(own.name) for own in faces])
    assert np.all(np.abs(points) <= 1)
    assert faces[0].what.startswith("0.866 m², flat")


def test_a_deck_without_mass_lacks_densities_and_keeps_its_moduli(tmp_path):
    found = suggestion(deck(tmp_path / "a.bdf", "1000.", "2.1+5", "", ""))
    assert found.length_unit == "mm"
    assert [own.regions for own in found.lacking] == [(3,), (7,)]
    assert (found.lacking[0].youngs_modulus, found.lacking[0].poisson_ratio) == (pytest.approx(2.1e11), 0.3)
    assert not suggestion(deck(tmp_path / "a.bdf", "1000.", "2.1+5", "", "CONM2,90,1,,0.5")).lacking


def test_a_frame_of_beams_has_its_sides_and_its_sets(tmp_path):
    """Three bars in line, 40 × 30 mm: four faces from end to end; a set of the nodes at the clamp is offered as held."""
    lines = ["CEND", "SPC = 1", "BEGIN BULK", "SPC1,1,123456,1", "SET1,7,1", "MAT1,1,2.1+11,,0.3,7850."]
    lines += [f"GRID,{i + 1},,{0.5 * i},0.,0." for i in range(4)]
    lines += [f"CBAR,{i},1,{i},{i + 1},0.,1.,0." for i in (1, 2, 3)]
    lines += ["PBARL,1,1,,BAR", ",0.03,0.04", "ENDDATA"]
    (tmp_path / "frame.bdf").write_text("\n".join(lines), encoding="ascii")
    found = suggestion(tmp_path / "frame.bdf")
    assert not found.no_surface
    assert [(place.name, place.supported) for place in found.places if place.kind == "set"] == [("SET1-7", True)]
    faces = [place for place in found.places if place.kind == "face"]
    assert len(faces) == 4
