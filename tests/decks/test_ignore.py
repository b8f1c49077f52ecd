"""What a deck has beyond what is supported: named, left out, or listed with its effect."""

from __future__ import annotations

import pytest

from strainsight.config.mesh import MeshFile, Tie
from strainsight.errors import DeckError
from strainsight.experiment.structure.mesh import checked, mesh_of
from strainsight.experiment.structure.mesh_tables import assumed_table
from strainsight.mesh.sanity import sanity_warnings

from ..wrong.decks import bar, inp
from .abaqus.test_deck import TETRAHEDRON as ABAQUS
from .conftest import TETRAHEDRON


def imported(tmp_path, text, ignore=(), name="deck.bdf"):
    (tmp_path / name).write_text(text)
    return mesh_of(MeshFile(file=name, ignore=tuple(ignore)), tmp_path / name)


def refused(tmp_path, text, **more):
    with pytest.raises(DeckError, match="unsupported cards that affect the model") as caught:
        imported(tmp_path, text, **more)
    return caught.value


SHELLS = (
    "CQUAD,70,3,1,2,3,4\nCQUAD,71,3,1,2,3,4\nPSHELL,3,1,.1\nPLOAD1,5,70,FX,FR,0.,1.\nPARAM,POST,-1\nTOPVAR,1\nEIGRL,1\n"
)


def test_unsupported_cards_are_refused_or_ignored(tmp_path):
    error = refused(tmp_path, TETRAHEDRON + SHELLS)
    assert f"2 × CQUAD (first at {tmp_path}/deck.bdf:9), 1 × PLOAD1 (first at {tmp_path}/deck.bdf:12)" in error.what
    assert error.where == f"{tmp_path}/deck.bdf:9"
    assert error.key == "mesh.file"
    assert error.remedy.startswith("Replace CQUAD by shells of eight or four nodes. If their effect is negligible")
    assert error.remedy.endswith("mesh.ignore: [CQUAD, PLOAD1]")
    assert "PLOAD1" not in refused(tmp_path, TETRAHEDRON + SHELLS, ignore=["PLOAD1"]).what
    mesh = imported(tmp_path, TETRAHEDRON + SHELLS, ["cquad", "PLOAD1", "CBAR"])
    assert {card: mesh.ignored[card] for card in ("CQUAD", "PLOAD1")} == {"CQUAD": 2, "PLOAD1": 1}
    assert mesh.notes[-1] == "the deck does not contain these cards of mesh.ignore: CBAR"
    assert mesh.effect["CQUAD"] == "structure"


@pytest.mark.parametrize(
    "card", ["PARAM,POST,-1", "EIGRL,1", "TLOAD1,5,6,,,7", "DAREA,6,4,3,1.", "DESVAR,1", "PSHEAR,3", "MAT3,9,1."]
)
def test_output_procedures_histories_and_properties_are_listed_only(tmp_path, card):
    mesh = imported(tmp_path, TETRAHEDRON + card + "\n")
    assert mesh.ignored[card.replace("PARAM,", "PARAM ").split(",")[0]] == 1
    assert mesh.unsupported == {}


@pytest.mark.parametrize(
    "card",
    [
        "CBEND,70,3,1,2", "RTRPLT,70,1", "RSPLINE,1,.1", "CDAMP2,70,1.,4,1", "NSM,1", "MATT1,1,9\nTEMP,9,1,1.",
        "ACCEL1,9",
    ],
)
def test_elements_ties_and_loads_are_refused(tmp_path, card):
    refused(tmp_path, TETRAHEDRON + card + "\n")


def test_supported_card_can_be_ignored(tmp_path):
    mesh = imported(tmp_path, TETRAHEDRON + "CELAS2,60,9.,4,3\nPLOAD4,1,99,1.\n", ["CELAS2", "PLOAD4"])
    assert (mesh.springs, mesh.loads) == ((), {})
    assert mesh.ignored == {"CELAS2": 1, "PLOAD4": 1}


def test_ignored_plate_locates_pressure(tmp_path):
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


def test_supported_abaqus_elements_can_be_ignored(tmp_path):
    text = ABAQUS + "*ELEMENT, TYPE=SPRING1, ELSET=SP\n60, 4\n*SPRING, ELSET=SP\n3\n1e5\n"
    text += "*ELEMENT, TYPE=MASS, ELSET=M\n61, 4\n*MASS, ELSET=M\n2.\n"
    both = imported(tmp_path, text, name="deck.inp")
    assert (len(both.springs), len(both.point_masses)) == (1, 1)
    mesh = imported(tmp_path, text, ["SPRING1", "Mass"], name="deck.inp")
    assert (mesh.springs, mesh.point_masses, mesh.notes) == ((), (), both.notes)
    assert {"*ELEMENT, TYPE=SPRING1", "*ELEMENT, TYPE=MASS"} <= set(mesh.ignored)
    with pytest.raises(DeckError, match=r"SPRING1 60 has no \*SPRING") as caught:
        imported(tmp_path, text, ["SPRING"], name="deck.inp")
    assert caught.value.remedy.endswith("mesh.ignore: [SPRING1])")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("deck.bdf", TETRAHEDRON + "SPC,1,4,1,.1\n"),
        ("deck.inp", ABAQUS + "*STEP\n*BOUNDARY, OP=MOD\n4, 3\n4, 1, 1, .1\n*END STEP\n"),
    ],
)
def test_enforced_displacement_is_fixed_or_free(tmp_path, name, text):
    mesh = imported(tmp_path, text, name=name)
    assert [3, 0] in mesh.fixed.tolist()
    assert sanity_warnings(mesh)[0].startswith(
        "1 × ENFORCED DISPLACEMENT with a nonzero value ignored: the enforced displacement is set to zero"
    )
    mesh = imported(tmp_path, text, ["enforced displacement"], name=name)
    assert [3, 0] not in mesh.fixed.tolist()
    assert mesh.ignored["ENFORCED DISPLACEMENT"] == 1
    assert "are free to move" in sanity_warnings(mesh)[0]


@pytest.mark.parametrize(
    ("name", "text", "card"),
    [
        ("deck.bdf", TETRAHEDRON + "TEMPD,9,1.\nSPCD,9,1,1,.1\n", "TEMPD"),
        ("deck.inp", ABAQUS + "*STEP\n*TEMPERATURE\n4, 20.\n*BASE MOTION, DOF=1\n*END STEP\n", "*TEMPERATURE"),
    ],
)
def test_constant_thermal_load_is_listed(tmp_path, name, text, card):
    mesh = imported(tmp_path, text, name=name)
    assert mesh.effect[card] == "none"
    assert not mesh.unsupported


def test_temperature_dependent_modulus_is_refused(tmp_path):
    text = ABAQUS.replace("*DENSITY", "1.9e11, .3, 400.\n*DENSITY") + "*STEP\n*TEMPERATURE\n4, 20.\n*END STEP\n"
    assert "TEMPERATURE" in refused(tmp_path, text, name="deck.inp").what


# A deck that asks for modes under a preload: an error by its name in every format, the first warning where it is ignored.
LOADED = "*STATIC\n*CLOAD\n5, 3, 1.\n*END STEP\n"
MODES = "*FREQUENCY\n4\n*END STEP"
CASES = "SPC = 1\nSUBCASE 1\n{}\nSUBCASE 2\n{}"
ASKED = {
    "NLGEOM": (inp(more=f"*STEP, NLGEOM\n{LOADED}*STEP\n{MODES}"), "*STEP, NLGEOM", "*STEP, NLGEOM"),
    "after a step of small ones": (
        inp(more=f"*STEP, NLGEOM=NO\n{LOADED}*STEP, NLGEOM\n{LOADED}*STEP\n{MODES}"), "*STEP, NLGEOM", "*STEP, NLGEOM",
    ),
    "PERTURBATION": (inp(more=f"*STEP\n{LOADED}*STEP, PERTURBATION\n{MODES}"), "*STEP, PERTURBATION", "*STEP, PERTURBATION"),
    "STATSUB": (bar(case=CASES.format("LOAD = 2", "STATSUB = 1\nMETHOD = 3")), "STATSUB = 1", "STATSUB"),
    "SOL 106": (bar("PARAM,LGDISP,1", case="SPC = 1\nMETHOD = 3").replace("SOL 103", "SOL 106"), "METHOD = 3", "SOL 106"),
    "SOL 400": (
        bar(case=CASES.format("ANALYSIS = NLSTATICS", "ANALYSIS = MODES")).replace("SOL 103", "SOL 400"),
        "ANALYSIS = MODES",
        "SOL 400",
    ),
}  # fmt: skip
NOT_ASKED = {
    "no preload": inp(more=f"*STEP, PERTURBATION\n{MODES}"),
    "a deck of Abaqus says so": inp(more=f"*STEP, NLGEOM=NO\n{LOADED}*STEP, NLGEOM=NO, PERTURBATION\n{MODES}"),
    "a static step without PERTURBATION after it": inp(more=f"*STEP\n{LOADED}*STEP\n{MODES}"),
    "the load comes after the modes": inp(more=f"*STEP\n{MODES}\n*STEP\n{LOADED}"),
    "buckling": bar(case=CASES.format("LOAD = 2", "STATSUB = 1\nMETHOD = 3")).replace("SOL 103", "SOL 105"),
    "small displacements": bar("PARAM,LGDISP,-1", case="SPC = 1\nMETHOD = 3").replace("SOL 103", "SOL 106"),
    "modes alone": bar(case="SPC = 1\nANALYSIS = MODES").replace("SOL 103", "SOL 400"),
}


def read(folder, text, ignore=()):
    path = folder / ("deck.bdf" if "BEGIN BULK" in text else "deck.inp")
    path.write_text(text)
    return mesh_of(MeshFile(file=path.name, ignore=tuple(ignore)), path)


@pytest.mark.parametrize("name", ASKED)
def test_preloaded_modes_are_refused_unless_ignored(name, tmp_path):
    text, line, by = ASKED[name]
    with pytest.raises(DeckError, match="unsupported cards that affect the model") as caught:
        read(tmp_path, text)
    assert f"1 × PRELOAD by {by} (first at" in caught.value.what
    assert text.splitlines()[int(caught.value.where.rpartition(":")[2]) - 1].strip() == line
    assert caught.value.remedy.endswith("mesh.ignore: [PRELOAD]")
    mesh = read(tmp_path, text, ["PRELOAD"])
    assert any(f"1 × PRELOAD by {by} ignored" in warning for warning in sanity_warnings(mesh))
    assert f"card PRELOAD by {by}" in {row[0] for row in assumed_table(mesh, "", free=False).rows}


def test_nlgeom_persists_between_steps(tmp_path):
    steps = f"*STEP, NLGEOM\n{LOADED}*STEP\n{LOADED}*STEP, NLGEOM=NO\n{LOADED}*STEP\n{MODES}"
    assert read(tmp_path, inp(more=steps), ["PRELOAD"]).ignored == {"PRELOAD by *STEP, NLGEOM": 2}


@pytest.mark.parametrize("name", NOT_ASKED)
def test_modes_without_preload_are_accepted(name, tmp_path):
    mesh = read(tmp_path, NOT_ASKED[name])
    assert not any("PRELOAD" in card for card in mesh.ignored)
    assert sanity_warnings(mesh) == ()


# A point mass on a node that nothing holds is left out, unless the config ties it.
LOOSE = TETRAHEDRON + "GRID,50,,1.,1.,1.\nGRID,51,,2.,1.,1.\nCONM2,90,50,,2.5\nCONM2,91,4,,3.\nSET1,7,1,2,3,4\n"


def import_checked(tmp_path, text, **more):
    (tmp_path / "deck.bdf").write_text(text)
    config = MeshFile(file="deck.bdf", **more)
    mesh = mesh_of(config, tmp_path / "deck.bdf")
    return mesh, checked(mesh, config)[0][0]


def test_element_without_region_is_noted_and_massless(tmp_path):
    mesh, weight = import_checked(tmp_path, LOOSE)
    assert [point.id for point in mesh.point_masses] == [91]
    assert mesh.notes[-1].startswith("a point mass of 2.5 kg omitted, because no element, tie, spring or support")
    assert mesh.notes[-1].endswith("node 50")
    assert weight == pytest.approx(7850 / 6 + 3)
    mesh, _ = import_checked(tmp_path, LOOSE + "CONM2,92,51,,4.\n")
    assert mesh.notes[-1].startswith("2 point masses with a total of 6.5 kg omitted")


@pytest.mark.parametrize("card", ["RBE2,20,50,123,4", "CELAS2,20,1.+6,50,1,4,1", "MPC,1,50,1,1.,4,1,-1."])
def test_supported_node_is_kept(tmp_path, card):
    (tmp_path / "deck.bdf").write_text(f"{LOOSE}{card}\n")
    mesh = mesh_of(MeshFile(file="deck.bdf"), tmp_path / "deck.bdf")
    assert len(mesh.point_masses) == 2
    assert not any("left out" in note for note in mesh.notes)


def test_tied_node_is_kept(tmp_path):
    ties = (Tie(type="averaging", set="SET1-7", reference=50),)
    mesh, weight = import_checked(tmp_path, LOOSE, ties=ties)
    assert len(mesh.point_masses) == 2
    assert weight == pytest.approx(7850 / 6 + 5.5)
