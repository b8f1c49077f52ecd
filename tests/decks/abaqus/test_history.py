"""Supports and elements as the steps of a deck leave them: frequencies of CalculiX, and the choices where steps differ."""

from __future__ import annotations

import re
import shutil
import subprocess

import numpy as np
import pytest

from strainsight.errors import ChoiceError, DeckError
from strainsight.fem.model import build_model
from strainsight.fem.modes import modes

from ...solids import SOLIDS

CUBES, POINTS = 4, {}


def _row() -> str:
    """Four C3D20 along x, each a set of its own, E1 to E4, with the faces ROOT, MIDDLE and TIP."""
    corners = np.array(SOLIDS["hex20"].corners) * [0.1, 0.05, 0.03]
    local = np.vstack([corners, *((corners[[a]] + corners[[b]]) / 2 for a, b in SOLIDS["hex20"].edges)])
    numbers, elements = {}, ""
    for i in range(CUBES):
        points = map(tuple, np.round(local + np.array([0.1 * i, 0, 0]), 9).tolist())
        nodes = [str(numbers.setdefault(point, len(numbers) + 1)) for point in points]
        elements += f"*ELEMENT, TYPE=C3D20, ELSET=E{i + 1}\n{i + 1}, {', '.join(nodes[:10])},\n{', '.join(nodes[10:])}\n"
    faces = {"ROOT": 0.0, "MIDDLE": 0.2, "TIP": 0.4}
    sets = "".join(
        f"*NSET, NSET={name}\n" + "".join(f"{number}\n" for point, number in numbers.items() if point[0] == x)
        for name, x in faces.items()
    )
    nodes = "".join(f"{number}, {', '.join(map(str, point))}\n" for point, number in numbers.items())
    return (
        f"*NODE, NSET=NALL\n{nodes}{elements}{sets}*ELSET, ELSET=EALL\nE1, E2, E3, E4\n*MATERIAL, NAME=M\n*ELASTIC\n2.1e11, .3\n"
        "*DENSITY\n7850.\n*SOLID SECTION, ELSET=EALL, MATERIAL=M\n"
    )


ROW = _row()
ROOT, TIP, MIDDLE = (f"\n{name}, 1, 3\n" for name in ("ROOT", "TIP", "MIDDLE"))
MODES = "*FREQUENCY\n4\n"


def step(*lines: str, analysis: str = "*STATIC\n") -> str:
    return f"*STEP\n{analysis}{''.join(lines)}*END STEP\n"


def removed(*sets: str, how: str = "*MODEL CHANGE, TYPE=ELEMENT, REMOVE") -> str:
    return f"{how}\n" + "".join(f"{name}\n" for name in sets)


ADDED = "*Model Change, type = element, add = with strain"
HELD = "*BOUNDARY" + ROOT
DECKS = {
    "removed": HELD + step(removed("E4")) + step(analysis=MODES),
    "removed by number": HELD + step(removed("3", "4")) + step(analysis=MODES),
    "removed in two steps": HELD + step(removed("E4")) + step(removed("E3")) + step(analysis=MODES),
    "removed and added": HELD + step(removed("E3", "E4")) + step(removed("E3", how=ADDED)) + step(analysis=MODES),
    "added last": HELD + step(removed("E3", "E4")) + step(removed("E3", "E4", how=ADDED)) + step(analysis=MODES),
    "new in the frequency step": step(HELD, "*BOUNDARY" + TIP) + step("*BOUNDARY, OP=NEW" + ROOT, analysis=MODES),
    "more in the frequency step": HELD + step() + step("*BOUNDARY" + TIP, analysis=MODES),
    "mod in the frequency step": step(HELD) + step("*BOUNDARY, OP=MOD" + MIDDLE, analysis=MODES),
    "new in the static step": HELD + step("*BOUNDARY, OP=NEW" + TIP) + step(analysis=MODES),
    "of three steps": step(HELD) + step("*BOUNDARY" + TIP) + step("*BOUNDARY" + MIDDLE) + step(analysis=MODES),
    "replaced twice": (
        step("*BOUNDARY" + TIP) + step("*BOUNDARY,OP=NEW" + MIDDLE) + step("*BOUNDARY,op=new" + ROOT, analysis=MODES)
    ),
    "moved in the static step": step("*BOUNDARY\nROOT, 1, 2\nROOT, 3, 3, 1e-5\n") + step(HELD, analysis=MODES),
    "static steps after it": step(HELD) + step(analysis=MODES) + step("*BOUNDARY" + TIP),
}


def frequencies(mesh) -> np.ndarray:
    model = build_model(mesh)
    return modes(model.stiffness.constant, model.mass.constant, 4)[0]


@pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX is not installed")
@pytest.mark.parametrize("name", DECKS)
def test_frequencies_are_those_of_calculix(read, tmp_path, name):
    mesh = read(ROW + DECKS[name])
    assert not mesh.unsupported
    assert not mesh.ignored
    subprocess.run(["ccx", "deck"], cwd=tmp_path, check=True, stdout=subprocess.DEVNULL, timeout=60)
    table = (tmp_path / "deck.dat").read_text().partition("E I G E N V A L U E   O U T P U T")[2]
    found = [float(row[3]) for row in re.findall(r"^ +\d+ +(\S+) +(\S+) +((\S+)) +", table, re.MULTILINE)][:4]
    np.testing.assert_allclose(frequencies(mesh), found, rtol=1e-5)


def test_what_is_removed_is_in_no_set_region_or_mass(read):
    mesh = read(ROW + DECKS["removed"])
    assert [ids.tolist() for ids in (mesh.blocks[0].ids, mesh.element_sets["EALL"])] == [[1, 2, 3]] * 2
    assert "E4" not in mesh.element_sets
    assert any("without 1 element (*MODEL CHANGE)" in note for note in mesh.notes)
    ignored = read(ROW + DECKS["removed"], ignore=["MODEL CHANGE"])
    assert ignored.blocks[0].ids.tolist() == [1, 2, 3, 4]


def test_a_point_mass_is_removed_by_its_set(read):
    mass = "*ELEMENT, TYPE=MASS, ELSET=P\n77, 5\n*MASS, ELSET=P\n2.\n"
    assert len(read(ROW + mass + HELD + step(analysis=MODES)).point_masses) == 1
    assert read(ROW + mass + HELD + step(removed("P")) + step(analysis=MODES)).point_masses == ()


def test_elements_of_an_instance_are_removed_by_its_set(read):
    """The second of two instances goes; what is left is the model of the first one alone."""
    part = "*PART, NAME=P\n" + ROW.split("*MATERIAL")[0].replace("*ELSET, ELSET=EALL\nE1, E2, E3, E4\n", "")
    part += "*ELSET, ELSET=EALL\nE1, E2, E3, E4\n*SOLID SECTION, ELSET=EALL, MATERIAL=M\n*END PART\n"
    head = part + "*ASSEMBLY, NAME=A\n*INSTANCE, NAME=I1, PART=P\n*END INSTANCE\n{}*END ASSEMBLY\n"
    head += "*MATERIAL, NAME=M\n*ELASTIC\n2.1e11, .3\n*DENSITY\n7850.\n"
    one = read(head.format("") + "*BOUNDARY\nI1.ROOT, 1, 3\n" + step(analysis=MODES))
    second = "*INSTANCE, NAME=I2, PART=P\n0., 1., 0.\n*END INSTANCE\n"
    for entry, more in (("I2.EALL", ""), ("OUT", "*ELSET, ELSET=OUT, INSTANCE=I2\nEALL\n")):
        steps = "*BOUNDARY\nI1.ROOT, 1, 3\n" + step(removed(entry)) + step(analysis=MODES)
        both = read(head.format(second + more) + steps)
        assert both.blocks[0].ids.tolist() == one.blocks[0].ids.tolist()
        np.testing.assert_allclose(frequencies(both), frequencies(one), rtol=1e-12)


DIFFERENT = step(HELD, analysis=MODES) + step("*BOUNDARY, OP=NEW" + TIP, analysis=MODES)


@pytest.mark.parametrize(
    ("steps", "what"),
    [
        (DIFFERENT, "supports"),
        (step(HELD) + step("*BOUNDARY" + TIP), "supports"),
        (HELD + step(removed("E4")) + step(removed("E3")), "elements"),
    ],
)
def test_steps_that_differ_are_a_choice(read, steps, what):
    with pytest.raises(ChoiceError, match=f"steps 1 and 2 have different {what}") as caught:
        read(ROW + steps)
    assert (caught.value.key, caught.value.sets) == ("step", (1, 2))
    assert "mesh.step: 2" in caught.value.remedy
    first, second = (read(ROW + steps, step=number) for number in (1, 2))
    assert (first.fixed.tolist(), first.blocks[0].ids.tolist()) != (second.fixed.tolist(), second.blocks[0].ids.tolist())


@pytest.mark.parametrize(
    ("steps", "what"),
    [
        (step(removed("NONE")), "element set 'NONE' is not in the deck"),
        (step(removed("E1", how="*MODEL CHANGE")), "neither ADD nor REMOVE"),
        (step(removed("E1", how="*MODEL CHANGE, TYPE=TIE, REMOVE")), "neither ELEMENT nor CONTACT PAIR"),
        (removed("E1") + step(analysis=MODES), "stands before the first"),
        (step("*BOUNDARY, SUBMODEL\nROOT, 1\n"), "motions of another model"),
    ],
)
def test_changes_that_cannot_be_taken_are_named(read, steps, what):
    with pytest.raises(DeckError, match=what):
        read(ROW + HELD + steps)


def test_a_step_that_is_not_there_and_one_that_programs_read_differently_are_named(read):
    with pytest.raises(DeckError, match=r"step 3 \(mesh.step\) is not in the deck"):
        read(ROW + DIFFERENT, step=3)
    local = HELD + step("*BOUNDARY" + TIP, analysis=MODES) + step(analysis=MODES)
    with pytest.raises(DeckError, match="supports of step 2 are not the same in all programs"):
        read(ROW + local)
    assert read(ROW + local, step=1).fixed.shape == (48, 2)


def test_a_contact_pair_that_is_removed_is_open(read):
    surfaces = "*SURFACE, NAME=A\nE1, S6\n*SURFACE, NAME=B\nE3, S4\n*CONTACT PAIR, INTERACTION=I\nA, B\n"
    surfaces += "*SURFACE INTERACTION, NAME=I\n"
    for lines, count in (("*MODEL CHANGE, TYPE=CONTACT PAIR, REMOVE\na, b\n", 1), ("", 0)):
        mesh = read(ROW + HELD + surfaces + step(lines) + step(analysis=MODES), contact="bonded")
        assert sum("open: *MODEL CHANGE removes it" in text for text in mesh.contacts) == count
