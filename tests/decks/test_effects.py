"""What a card that is not supported would do, by what the manuals of Nastran and Abaqus say of it."""

from __future__ import annotations

import pytest

from strainsight.decks.abaqus import deck as abaqus
from strainsight.decks.effects import effects
from strainsight.decks.nastran import deck as nastran
from strainsight.decks.reader import read_mesh
from strainsight.mesh.sanity import sanity_warnings

from ..stages.test_bad_input import ABAQUS
from .conftest import TETRAHEDRON


@pytest.mark.parametrize("card", ["PARAM", "EIGRL", "TABDMP1", "MOMENT", "*CLOAD moment", "*DLOAD"])
def test_cards_that_steer_or_load_change_no_structure(card):
    reader = abaqus if card.startswith("*") else nastran
    assert effects([card], reader.STRUCTURAL, reader.CONTROL) == {card: "none"}


@pytest.mark.parametrize("card", ["CQUAD4", "RBAR", "MPC", "*TIE", "*ELEMENT, TYPE=S4R", "CELAS2", "DMIG"])
def test_cards_that_add_stiffness_mass_or_ties_change_it(card):
    reader = abaqus if card.startswith("*") else nastran
    assert effects([card], reader.STRUCTURAL, reader.CONTROL) == {card: "structure"}


@pytest.mark.parametrize("card", ["MPC of a set that is not selected", "MAT1 that no property refers to", "CORD3G"])
def test_of_others_nothing_is_known(card):
    assert effects([card], nastran.STRUCTURAL, nastran.CONTROL) == {}


def test_the_reader_of_a_deck_says_it(tmp_path):
    path = tmp_path / "a.bdf"
    path.write_text(TETRAHEDRON + "PSOLID,2,1\nCQUAD,70,3,1,2,3,4\nRSPLINE,1\nPLOAD1,1\nPARAM,POST,-1\nTOPVAR,1\n")
    mesh = read_mesh(path)
    assert mesh.ignored == {"CQUAD": 1, "PARAM POST": 1, "PLOAD1": 1, "RSPLINE": 1, "TOPVAR": 1}
    assert mesh.effect == {"CQUAD": "structure", "PARAM POST": "none", "PLOAD1": "none", "RSPLINE": "structure"}


@pytest.mark.parametrize(
    ("step", "count"), [("*STEP, NLGEOM", 1), ("*STEP, NLGEOM=YES", 1), ("*STEP, NLGEOM=NO", 0), ("*STEP", 0)]
)
def test_a_preload_that_stiffens_leads_the_warnings(tmp_path, step, count):
    path = tmp_path / "a.inp"
    path.write_text(f"{ABAQUS}{step}\n*STATIC\n*CLOAD\n4, 3, 100.\n*END STEP\n")
    mesh = read_mesh(path)
    assert mesh.ignored.get("*STEP, NLGEOM", 0) == count
    said = sanity_warnings(mesh)
    assert len(said) == count
    assert all("not that under the preload of this step" in text for text in said)
