"""A deck that asks for modes under a preload: an error by its name in every format, the first warning where it is ignored."""

from __future__ import annotations

import pytest

from strainsight.cases.structure.mesh import mesh_of
from strainsight.config.mesh import MeshFile
from strainsight.errors import DeckError
from strainsight.mesh.sanity import sanity_warnings
from strainsight.stages.pages.assumed import assumed_table

from ..wrong.decks import bar, inp

LOADED = "*STATIC\n*CLOAD\n5, 3, 1.\n*END STEP\n"
MODES = "*FREQUENCY\n4\n*END STEP"
CASES = "SPC = 1\nSUBCASE 1\n{}\nSUBCASE 2\n{}"
ASKED = {
    "NLGEOM": (inp(more=f"*STEP, NLGEOM\n{LOADED}*STEP\n{MODES}"), "*STEP, NLGEOM", "*STEP, NLGEOM"),
    "NLGEOM=YES, a harmonic": (
        inp(more=f"*STEP, NLGEOM=YES\n{LOADED}*STEP\n*STEADY STATE DYNAMICS\n1., 9.\n*END STEP"),
        "*STEP, NLGEOM=YES",
        "*STEP, NLGEOM",
    ),
    "after a step of small ones": (
        inp(more=f"*STEP, NLGEOM=NO\n{LOADED}*STEP, NLGEOM\n{LOADED}*STEP\n{MODES}"), "*STEP, NLGEOM", "*STEP, NLGEOM",
    ),
    "PERTURBATION": (inp(more=f"*STEP\n{LOADED}*STEP, PERTURBATION\n{MODES}"), "*STEP, PERTURBATION", "*STEP, PERTURBATION"),
    "STATSUB": (bar(case=CASES.format("LOAD = 2", "STATSUB = 1\nMETHOD = 3")), "STATSUB = 1", "STATSUB"),
    "STATSUB(PRELOAD)": (bar(case=CASES.format("LOAD = 2", "  statsub (PRELOAD) = 1")), "statsub (PRELOAD) = 1", "STATSUB"),
    "SOL 106": (
        bar("PARAM,LGDISP,1", case="SPC = 1\nMETHOD = 3").replace("SOL 103", "SOL 106"), "METHOD = 3", "SOL 106",
    ),
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
    "temperature at the start": inp(more="*INITIAL CONDITIONS, TYPE=TEMPERATURE\nNALL, 20."),
}


def read(folder, text, ignore=()):
    path = folder / ("deck.bdf" if "BEGIN BULK" in text else "deck.inp")
    path.write_text(text)
    return mesh_of(MeshFile(file=path.name, ignore=tuple(ignore)), path)


@pytest.mark.parametrize("name", ASKED)
def test_modes_under_a_preload_are_refused_with_their_line(name, tmp_path):
    text, line, by = ASKED[name]
    with pytest.raises(DeckError, match="the model is not the same without") as caught:
        read(tmp_path, text)
    assert f"1 × PRELOAD by {by} (first at" in caught.value.what
    assert text.splitlines()[int(caught.value.where.rpartition(":")[2]) - 1].strip() == line
    assert caught.value.remedy.endswith("mesh.ignore: [PRELOAD]")


@pytest.mark.parametrize("name", ASKED)
def test_named_in_the_config_it_leads_warnings_and_what_the_model_assumes(name, tmp_path):
    text, _, by = ASKED[name]
    mesh = read(tmp_path, text, ["PRELOAD"])
    said = sanity_warnings(mesh)
    assert any(own.startswith(f"1 × PRELOAD by {by} ignored: the deck asks for modes under a preload") for own in said)
    rows = {row[0]: row[2] for row in assumed_table(mesh, "", free=False).rows}
    assert rows[f"card PRELOAD by {by}"].startswith("not as the deck has it: the deck asks for modes under a preload")
    assert not any("names PRELOAD" in note for note in mesh.notes)


def test_displacements_stay_large_from_step_to_step_until_a_deck_says_no(tmp_path):
    steps = f"*STEP, NLGEOM\n{LOADED}*STEP\n{LOADED}*STEP, NLGEOM=NO\n{LOADED}*STEP\n{MODES}"
    assert read(tmp_path, inp(more=steps), ["PRELOAD"]).ignored == {"PRELOAD by *STEP, NLGEOM": 2}


@pytest.mark.parametrize("name", NOT_ASKED)
def test_modes_without_one_are_no_error_and_no_warning(name, tmp_path):
    mesh = read(tmp_path, NOT_ASKED[name])
    assert not any("PRELOAD" in card for card in mesh.ignored)
    assert sanity_warnings(mesh) == ()
