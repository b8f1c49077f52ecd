"""Every PARAM by its name: what counts, what changes the structure and does not count, and what has no effect here."""

from __future__ import annotations

import pytest

from strainsight.mesh.sanity import sanity_warnings


@pytest.mark.parametrize(
    ("line", "name", "effect"),
    [
        ("PARAM,POST,-1", "POST", "none"),
        ("PARAM,AUTOSPC,YES", "AUTOSPC", "none"),
        ("PARAM,COUPMASS,1", "COUPMASS", "none"),
        ("PARAM,LGDISP,1", "LGDISP", "structure"),
        ("PARAM,INREL,-1", "INREL", "structure"),
        ("PARAM,CM1,2.", "CM1", "structure"),
        ("PARAM,CK1,1.1", "CK1", "structure"),
        ("PARAM,OWNNAME,3", "OWNNAME", None),
    ],
)
@pytest.mark.parametrize("where", ["bulk data", "case control"])
def test_a_parameter_is_listed_by_its_name_with_what_it_does(read, tetrahedron, line, name, effect, where):
    bulk, control = (f"{line}\n" if place == where else "" for place in ("bulk data", "case control"))
    mesh = read(f"SOL 103\nCEND\nSPC = 1\n{control}BEGIN BULK\n{tetrahedron}{bulk}ENDDATA\n")
    assert mesh.ignored == {f"PARAM {name}": 1}
    assert mesh.effect.get(f"PARAM {name}") == effect


@pytest.mark.parametrize("line", ["PARAM,CM1,1.", "PARAM,LGDISP,0", "PARAM,WTMASS,.5"])
def test_what_counts_here_and_what_states_the_usual_is_not_listed(read, tetrahedron, line):
    assert read(f"{tetrahedron}{line}\nENDDATA\n").ignored == {}


@pytest.mark.parametrize(
    ("value", "lumped"), [("-1", True), ("0", True), ("1", False), ("-1\nPARAM,COUPMASS,1", False)]
)
def test_mass_of_solids_is_lumped_where_a_deck_says_so(read, tetrahedron, value, lumped):
    mesh = read(f"{tetrahedron}PARAM,COUPMASS,{value}\nENDDATA\n")
    assert mesh.lumped == lumped
    assert not any("lumped" in text for text in sanity_warnings(mesh))


def test_beside_shells_lumped_mass_is_one_warning(read, tetrahedron):
    more = "CTRIA3,70,7,1,2,3\nPSHELL,7,1,.1,1,,1\nPARAM,COUPMASS,-1\n"
    mesh = read(f"{tetrahedron}{more}ENDDATA\n")
    assert not mesh.lumped
    assert sum("lumped" in text for text in sanity_warnings(mesh)) == 1


def test_supports_that_no_line_of_the_case_control_selects_are_reported(read, tetrahedron):
    for control, count in (
        ("", 0),
        ("SOL 103\nCEND\nDISP = ALL\nBEGIN BULK\n", 1),
        ("SOL 103\nCEND\nSPC = 1\nBEGIN BULK\n", 0),
    ):
        mesh = read(f"{control}{tetrahedron}ENDDATA\n")
        notes = [note for note in mesh.doubts if "the case control selects no supports" in note]
        assert len(notes) == count
        assert len(mesh.fixed) > 0
