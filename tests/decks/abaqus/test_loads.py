"""Loads, steps and springs of Abaqus decks."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.decks.abaqus.deck import read_abaqus
from strainsight.errors import ChoiceError, DeckError
from strainsight.fem.nodal_forces import with_body_forces
from strainsight.mesh.kinds import kind_of

from ...bodies import body
from ...refusals import expect_refusal, refusal_table
from ..programs import displacements, frequencies, needs_calculix, printed_displacements, printed_frequencies

LOADS = {
    "DLOAD-1": "*DLOAD, OP=NEW\n2, P4, 3.E4\nALL, P1, -1.E4\n",
    "DLOAD-2": "*DLOAD, OP=NEW\nALL, GRAV, 9.81, 0., .6, -.8\n",
    "DLOAD-3": "*DLOAD, OP=NEW\nALL, CENTRIF, 4.E4, .1, -.5, 0., 0., .6, .8\n",
    "DSLOAD-1": "*DSLOAD, OP=NEW\nEND, P, 2.E4\n",
}


def bent(u, v, w):
    return 0.4 * u, 0.3 * v + 0.05 * u, 0.25 * w + 0.02 * u * u


STEEL = "*ELASTIC\n2.1E11, .3\n*DENSITY\n7850."


def bricks(mesh, held, material=STEEL, section=""):
    """A deck of C3D20, held at some nodes (n,)."""
    lines = ["*NODE, NSET=NALL"]
    lines += [f"{n}, {x!r}, {y!r}, {z!r}" for n, (x, y, z) in zip(mesh.node_ids, mesh.position.tolist(), strict=True)]
    lines += ["*ELEMENT, TYPE=C3D20, ELSET=ALL"]
    (block,) = mesh.blocks
    assert len(kind_of(block.kind).nodes) == 20
    for e, nodes in zip(block.ids, mesh.node_ids[block.nodes], strict=True):
        lines += [", ".join(map(str, (e, *nodes[:15]))) + ",", ", ".join(map(str, nodes[15:]))]
    lines += ["*MATERIAL, NAME=STEEL", material, f"*SOLID SECTION, ELSET=ALL, MATERIAL=STEEL{section}"]
    return "\n".join([*lines, "*BOUNDARY", *(f"{n}, 1, 3" for n in mesh.node_ids[held]), ""])


def bar():
    """Two C3D20 in a row, bent, held at x = 0."""
    mesh = body("hex20", (2, 1, 1), bent)
    return bricks(mesh, mesh.position[:, 0] == 0) + "*SURFACE, NAME=END\n2, S4\n"


@needs_calculix
def test_displacements_match_calculix(tmp_path):
    path = tmp_path / "bar.inp"
    steps = [f"*STEP\n*STATIC\n{load}*NODE PRINT, NSET=NALL\nU\n*END STEP\n" for load in LOADS.values()]
    # *DSLOAD takes nothing away from what *DLOAD of the step before has put on
    steps[-1] = steps[-1].replace("*DSLOAD", "*DLOAD, OP=NEW\n*DSLOAD")
    path.write_text(bar() + "".join(steps))
    mesh = with_body_forces(read_abaqus(path))
    names = [name for name in mesh.loads if mesh.loads[name].force.size]
    printed = printed_displacements(path).reshape(len(LOADS), -1, 3)
    for u, expected in zip(displacements(mesh, *names), printed, strict=True):
        np.testing.assert_allclose(u, expected, atol=2e-6 * np.abs(expected).max())


def test_cload_moment_is_imported(read):
    text = bar() + "*CLOAD\n5, 4, 3.\n5, 6, -1.\n*CLOAD\n5, 1, 2.\n"
    mesh = read(text)
    loads = mesh.loads
    assert any(note.startswith("*CLOAD: node 5 has no rotations, so moments are applied as couples") for note in mesh.notes)
    led = read(bar() + "*NODE\n99, 0., 0., 9.\n*MPC\nBEAM, 5, 99\n*CLOAD\n99, 4, 3.\n5, 1, 2.\n")
    assert not any("no rotations, so moments" in note for note in led.notes)
    np.testing.assert_array_equal(loads["CLOAD-1"].moment, [[3, 0, -1]])
    np.testing.assert_array_equal(loads["CLOAD-1"].force, [[0, 0, 0]])
    assert loads["CLOAD-2"].moment is None


def test_gravity_without_set_includes_point_masses(read):
    text = bar() + "*ELEMENT, TYPE=MASS, ELSET=M\n90, 3\n*MASS, ELSET=M\n5.\n"
    text += "*DLOAD\n, GRAV, 2., 0., 0., -3.\nALL, GRAV, 2., 0., 0., -3.\n"
    (load,) = with_body_forces(read(text)).loads.values()
    (other,) = with_body_forces(read(text.replace(", GRAV, 2., 0., 0., -3.\nALL", "ALL"))).loads.values()
    lost = load.force.sum(axis=0) - 2 * other.force.sum(axis=0)
    np.testing.assert_allclose(lost, [0, 0, -10], atol=1e-9)


test_invalid_loads_are_refused = refusal_table(lambda cards: bar() + cards, [
    ("*DLOAD\nALL, P7, 1.\n", "'P7' is not a facet of a hex20"),
    ("*DLOAD\nALL, GRAV, 9.81\n", "the direction of GRAV is zero"),
    ("*DSLOAD\nTOP, P, 1.\n", "surface 'TOP' is not in the deck"),
], placed=False)


# Supports and elements as the steps of a deck leave them: frequencies of CalculiX, and the choices where steps differ.
def _row() -> str:
    """Four C3D20 along x, each a set of its own, E1 to E4, with the faces ROOT, MIDDLE and TIP."""
    mesh = body("hex20", (4, 1, 1), lambda u, v, w: (0.1 * u, 0.05 * v, 0.03 * w))
    numbered = list(zip(mesh.node_ids.tolist(), mesh.position.round(9).tolist(), strict=True))
    text = "*NODE, NSET=NALL\n" + "".join(f"{number}, {', '.join(map(str, x))}\n" for number, x in numbered)
    for e, nodes in enumerate(mesh.node_ids[mesh.blocks[0].nodes].tolist(), start=1):
        text += f"*ELEMENT, TYPE=C3D20, ELSET=E{e}\n{e}, {', '.join(map(str, nodes[:10]))},\n{', '.join(map(str, nodes[10:]))}\n"
    for name, face in {"ROOT": 0.0, "MIDDLE": 0.2, "TIP": 0.4}.items():
        text += f"*NSET, NSET={name}\n" + "".join(f"{number}\n" for number, x in numbered if x[0] == face)
    return f"{text}*ELSET, ELSET=EALL\nE1, E2, E3, E4\n*MATERIAL, NAME=M\n{STEEL}\n*SOLID SECTION, ELSET=EALL, MATERIAL=M\n"


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
    "removed and added": HELD + step(removed("E3", "E4")) + step(removed("E3", how=ADDED)) + step(analysis=MODES),
    "new in the frequency step": step(HELD, "*BOUNDARY" + TIP) + step("*BOUNDARY, OP=NEW" + ROOT, analysis=MODES),
    "mod in the frequency step": step(HELD) + step("*BOUNDARY, OP=MOD" + MIDDLE, analysis=MODES),
    "replaced twice": (
        step("*BOUNDARY" + TIP) + step("*BOUNDARY,OP=NEW" + MIDDLE) + step("*BOUNDARY,op=new" + ROOT, analysis=MODES)
    ),
    "moved in the static step": step("*BOUNDARY\nROOT, 1, 2\nROOT, 3, 3, 1e-5\n") + step(HELD, analysis=MODES),
    "static steps after it": step(HELD) + step(analysis=MODES) + step("*BOUNDARY" + TIP),
}


@needs_calculix
@pytest.mark.parametrize("name", DECKS)
def test_frequencies_match_calculix(read, tmp_path, name):
    mesh = read(ROW + DECKS[name])
    assert not mesh.unsupported
    assert not mesh.ignored
    np.testing.assert_allclose(frequencies(mesh, 4), printed_frequencies(tmp_path / "deck.inp", 4), rtol=1e-5)


def test_removed_elements_are_excluded_everywhere(read):
    mesh = read(ROW + DECKS["removed"])
    assert [ids.tolist() for ids in (mesh.blocks[0].ids, mesh.element_sets["EALL"])] == [[1, 2, 3]] * 2
    assert "E4" not in mesh.element_sets
    assert any("*MODEL CHANGE removes 1 element" in note for note in mesh.notes)
    ignored = read(ROW + DECKS["removed"], ignore=["MODEL CHANGE"])
    assert ignored.blocks[0].ids.tolist() == [1, 2, 3, 4]


DIFFERENT = step(HELD, analysis=MODES) + step("*BOUNDARY, OP=NEW" + TIP, analysis=MODES)


@pytest.mark.parametrize(
    ("steps", "what"),
    [
        (DIFFERENT, "supports"),
        (step(HELD) + step("*BOUNDARY" + TIP), "supports"),
        (HELD + step(removed("E4")) + step(removed("E3")), "elements"),
    ],
)
def test_differing_steps_require_choice(read, steps, what):
    with expect_refusal(ChoiceError, f"steps 1 and 2 have different {what}", remedy="mesh.step: 2") as caught:
        read(ROW + steps)
    assert (caught.value.key, caught.value.choices) == ("step", (1, 2))
    first, second = (read(ROW + steps, step=number) for number in (1, 2))
    assert (first.fixed.tolist(), first.blocks[0].ids.tolist()) != (second.fixed.tolist(), second.blocks[0].ids.tolist())


test_invalid_model_changes_are_refused = refusal_table(lambda steps: ROW + HELD + steps, [
    (step(removed("NONE")), "element set 'NONE' is not in the deck"),
    (step(removed("E1", how="*MODEL CHANGE, TYPE=TIE, REMOVE")), "TYPE=TIE is not supported"),
    (step("*BOUNDARY, SUBMODEL\nROOT, 1\n"), r"a submodel \(SUBMODEL\) or a subroutine \(USER\) are not supported"),
], placed=False)


def test_missing_and_ambiguous_steps_are_refused(read):
    with pytest.raises(DeckError, match=r"step 3 \(mesh.step\) is not in the deck"):
        read(ROW + DIFFERENT, step=3)
    local = HELD + step("*BOUNDARY" + TIP, analysis=MODES) + step(analysis=MODES)
    with pytest.raises(DeckError, match="the supports of step 2 are ambiguous: supports of an earlier perturbation"):
        read(ROW + local)
    assert read(ROW + local, step=1).fixed.shape == (48, 2)


def test_removed_contact_pair_is_open(read):
    surfaces = "*SURFACE, NAME=A\nE1, S6\n*SURFACE, NAME=B\nE3, S4\n*CONTACT PAIR, INTERACTION=I\nA, B\n"
    surfaces += "*SURFACE INTERACTION, NAME=I\n"
    for lines, count in (("*MODEL CHANGE, TYPE=CONTACT PAIR, REMOVE\na, b\n", 1), ("", 0)):
        mesh = read(ROW + HELD + surfaces + step(lines) + step(analysis=MODES), contact="bonded")
        assert sum("open, because *MODEL CHANGE removes" in text for text in mesh.contacts) == count


# Springs of Abaqus decks: the frequencies that CalculiX finds of the same deck, and what cannot be taken.
SPRINGS = """\
*NODE
900, -.5, .2, .1
*ELEMENT, TYPE=SPRING1, ELSET=S1
80, 5
81, 2
82, 30
*SPRING, ELSET=S1
3
4.E7
*ELEMENT, TYPE=SPRING1, ELSET=S2
83, 5
84, 30
*SPRING, ELSET=S2
2
3.E7
*ELEMENT, TYPE=SPRINGA, ELSET=SA
85, 900, 3
*SPRING, ELSET=SA

2.E7
*ELEMENT, TYPE=SPRING2, ELSET=SB
86, 3, 900
*SPRING, ELSET=SB
1, 1
1.E7
*BOUNDARY
900, 1, 3
"""


def free(text):
    start = text.index("*BOUNDARY")
    return text[:start] + text[text.index("*SURFACE", start) :]


@needs_calculix
def test_spring_frequencies_match_calculix(tmp_path):
    path = tmp_path / "bar.inp"
    path.write_text(free(bar()) + SPRINGS + "*STEP\n*FREQUENCY\n8\n*END STEP\n")
    mesh = read_abaqus(path)
    assert [str(own) for own in mesh.springs][-2:] == ["SPRINGA 85", "SPRING2 86"]
    np.testing.assert_allclose(frequencies(mesh, 8), printed_frequencies(path, 8), rtol=2e-6)


test_invalid_springs_are_refused = refusal_table((free(bar()) + SPRINGS).replace, [
    ("*SPRING, ELSET=SA\n\n2.E7", "*SPRING, ELSET=SA, NONLINEAR\n0., 0.\n2., 3.", "NONLINEAR is not supported"),
    ("*SPRING, ELSET=SA\n\n2.E7\n", "", r"SPRINGA 85 has no \*SPRING"),
    ("1, 1\n1.E7", "1, 5\n1.E7", "the spring connects a translation with a rotation"),
    ("2\n3.E7", "2\n-3.E7", "negative"),
], placed=False)
