"""Elements, ties and loads that are not supported have to be named, and nothing else has."""

from __future__ import annotations

import pytest

from strainsight.cases.structure.mesh import mesh_of
from strainsight.config.mesh import MeshFile
from strainsight.errors import DeckError
from strainsight.mesh.sanity import sanity_warnings

from .abaqus.test_deck import TETRAHEDRON as ABAQUS
from .conftest import TETRAHEDRON


def imported(tmp_path, text, ignore=(), name="deck.bdf"):
    (tmp_path / name).write_text(text)
    return mesh_of(MeshFile(file=name, ignore=tuple(ignore)), tmp_path / name)


def refused(tmp_path, text, **more):
    with pytest.raises(DeckError, match="not supported, and the model is not the same without") as caught:
        imported(tmp_path, text, **more)
    return caught.value


SHELLS = (
    "CQUAD,70,3,1,2,3,4\nCQUAD,71,3,1,2,3,4\nPSHELL,3,1,.1\nPLOAD1,5,70,FX,FR,0.,1.\nPARAM,POST,-1\nTOPVAR,1\nEIGRL,1\n"
)


def test_card_count_line_and_remedy_are_named(tmp_path):
    error = refused(tmp_path, TETRAHEDRON + SHELLS)
    assert f"2 × CQUAD (first at {tmp_path}/deck.bdf:9), 1 × PLOAD1 (first at {tmp_path}/deck.bdf:12)" in error.what
    assert error.where == f"{tmp_path}/deck.bdf:9"
    assert error.key == "mesh.file"
    assert error.remedy.startswith("mesh CQUAD with eight or four nodes; if they do not matter")
    assert error.remedy.endswith("mesh.ignore: [CQUAD, PLOAD1]")
    assert "PLOAD1" not in refused(tmp_path, TETRAHEDRON + SHELLS, ignore=["PLOAD1"]).what


def test_a_missing_enddata_is_named_once(tmp_path):
    mesh = imported(tmp_path, "BEGIN BULK\n" + TETRAHEDRON, ["MISSING ENDDATA"])
    assert (mesh.ignored, len(mesh.notes)) == ({"MISSING ENDDATA": 1}, 1)
    assert (
        imported(tmp_path, TETRAHEDRON + "ENDDATA\n", ["MISSING ENDDATA"])
        .notes[-1]
        .startswith("mesh.ignore names MISSING")
    )


def test_what_is_named_is_left_out_and_listed(tmp_path):
    mesh = imported(tmp_path, TETRAHEDRON + SHELLS, ["cquad", "PLOAD1", "CBAR"])
    assert {card: mesh.ignored[card] for card in ("CQUAD", "PLOAD1")} == {"CQUAD": 2, "PLOAD1": 1}
    assert mesh.notes[-1] == "mesh.ignore names CBAR, of which the deck has none"
    assert mesh.effect["CQUAD"] == "structure"


@pytest.mark.parametrize(
    "card", ["PARAM,POST,-1", "EIGRL,1", "TLOAD1,5,6,,,7", "DAREA,6,4,3,1.", "DESVAR,1", "PSHEAR,3", "MAT3,9,1."]
)
def test_output_procedures_histories_and_properties_are_listed_only(tmp_path, card):
    mesh = imported(tmp_path, TETRAHEDRON + card + "\n")
    assert mesh.ignored[card.replace("PARAM,", "PARAM ").split(",")[0]] == 1
    assert mesh.unsupported == {}


@pytest.mark.parametrize("card", ["BGSET,1,2,3", "BCTSET,1,2,3", "BCONP,1,2,3", "BCONTACT,1", "BOLT,1,1"])
def test_bonded_faces_contact_and_preload_are_refused_as_ties_are(tmp_path, card):
    refused(tmp_path, TETRAHEDRON + card + "\n")


@pytest.mark.parametrize(
    "card",
    [
        "CBEND,70,3,1,2",
        "RTRPLT,70,1",
        "RSPLINE,1,.1",
        "CDAMP2,70,1.,4,1",
        "NSM,1",
        "MATT1,1,9\nTEMP,9,1,1.",
        "ACCEL1,9",
    ],
)
def test_elements_ties_and_loads_are_refused(tmp_path, card):
    refused(tmp_path, TETRAHEDRON + card + "\n")


def test_a_relation_that_no_one_selects_is_not(tmp_path):
    text = "SPC = 1\nBEGIN BULK\n" + TETRAHEDRON + "MPC,1,2,1,1.\nENDDATA\n"
    mesh = imported(tmp_path, text)
    assert (mesh.unsupported, mesh.relations) == ({}, ())
    assert mesh.ignored == {"MPC of a set that is not selected": 1}


def test_a_card_that_is_supported_may_be_left_out_too(tmp_path):
    mesh = imported(tmp_path, TETRAHEDRON + "CELAS2,60,9.,4,3\nPLOAD4,1,99,1.\n", ["CELAS2", "PLOAD4"])
    assert (mesh.springs, mesh.loads) == ((), {})
    assert mesh.ignored == {"CELAS2": 1, "PLOAD4": 1}


def test_a_plate_that_is_left_out_still_says_where_a_pressure_acts(tmp_path):
    mesh = imported(tmp_path, TETRAHEDRON + "CTRIA3,70,3,2,3,4\nPLOAD2,1,2.,70\n", ["CTRIA3"])
    assert mesh.loads["LOAD-1"].force.sum(axis=0) == pytest.approx([1, 1, 1])


def test_keywords_and_types_of_elements_of_abaqus(tmp_path):
    text = ABAQUS + "*ELEMENT, TYPE=M3D3, ELSET=SH\n30, 2, 3, 4\n*SHELL SECTION, ELSET=SH, MATERIAL=STEEL\n.1\n"
    text += "*TIE, NAME=T, CYCLIC SYMMETRY=YES\na, b\n"
    text += "*STEP\n*DLOAD\nEALL, BX, 1.\nEALL, P1, 1.\n*NODE PRINT\nU\n*END STEP\n"
    error = refused(tmp_path, text, name="deck.inp")
    assert f"1 × DLOAD BX (first at {tmp_path}/deck.inp:" in error.what
    assert error.remedy.endswith("mesh.ignore: [DLOAD BX, M3D3, TIE that is a symmetry]")
    mesh = imported(tmp_path, text, ["DLOAD BX", "M3D3", "*Tie that is a symmetry"], name="deck.inp")
    assert list(mesh.loads) == ["DLOAD-1"]
    assert imported(tmp_path, text, ["DLOAD", "M3D3", "TIE"], name="deck.inp").loads == {}


def test_types_of_elements_of_abaqus_that_are_supported_may_be_left_out_too(tmp_path):
    text = ABAQUS + "*ELEMENT, TYPE=SPRING1, ELSET=SP\n60, 4\n*SPRING, ELSET=SP\n3\n1e5\n"
    text += "*ELEMENT, TYPE=MASS, ELSET=M\n61, 4\n*MASS, ELSET=M\n2.\n"
    both = imported(tmp_path, text, name="deck.inp")
    assert (len(both.springs), len(both.point_masses)) == (1, 1)
    mesh = imported(tmp_path, text, ["SPRING1", "Mass"], name="deck.inp")
    assert (mesh.springs, mesh.point_masses, mesh.notes) == ((), (), both.notes)
    assert {"*ELEMENT, TYPE=SPRING1", "*ELEMENT, TYPE=MASS"} <= set(mesh.ignored)
    with pytest.raises(DeckError, match="SPRING1 60: no ") as caught:
        imported(tmp_path, text, ["SPRING"], name="deck.inp")
    assert caught.value.remedy.endswith("mesh.ignore: [SPRING1])")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("deck.bdf", TETRAHEDRON + "SPC,1,4,1,.1\n"),
        ("deck.inp", ABAQUS + "*STEP\n*BOUNDARY, OP=MOD\n4, 3\n4, 1, 1, .1\n*END STEP\n"),
    ],
)
def test_an_enforced_displacement_is_held_with_a_warning_or_free_where_it_is_named(tmp_path, name, text):
    mesh = imported(tmp_path, text, name=name)
    assert [3, 0] in mesh.fixed.tolist()
    assert sanity_warnings(mesh)[0].startswith("1 × ENFORCED DISPLACEMENT of another value than zero ignored: the motion is held")
    mesh = imported(tmp_path, text, ["enforced displacement"], name=name)
    assert [3, 0] not in mesh.fixed.tolist()
    assert mesh.ignored["ENFORCED DISPLACEMENT"] == 1
    assert "is free" in sanity_warnings(mesh)[0]


@pytest.mark.parametrize(
    ("name", "text", "card"),
    [
        ("deck.bdf", TETRAHEDRON + "TEMPD,9,1.\nSPCD,9,1,1,.1\n", "TEMPD"),
        ("deck.inp", ABAQUS + "*STEP\n*TEMPERATURE\n4, 20.\n*BASE MOTION, DOF=1\n*END STEP\n", "*TEMPERATURE"),
    ],
)
def test_heat_that_changes_no_stiffness_is_listed(tmp_path, name, text, card):
    mesh = imported(tmp_path, text, name=name)
    assert mesh.effect[card] == "none"
    assert not mesh.unsupported


def test_a_modulus_that_is_the_same_at_all_temperatures_does_not_depend_on_them(tmp_path):
    line = ABAQUS.split("*ELASTIC\n")[1].splitlines()[0]
    text = ABAQUS.replace(line, f"{line}, 0.\n{line}, 400.", 1) + "*STEP\n*TEMPERATURE\n4, 20.\n*END STEP\n"
    assert not imported(tmp_path, text, name="deck.inp").unsupported


def test_heat_that_changes_the_modulus_has_to_be_named(tmp_path):
    text = ABAQUS.replace("*DENSITY", "1.9e11, .3, 400.\n*DENSITY") + "*STEP\n*TEMPERATURE\n4, 20.\n*END STEP\n"
    assert "TEMPERATURE" in refused(tmp_path, text, name="deck.inp").what
