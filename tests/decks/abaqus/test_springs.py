"""Springs of Abaqus decks: the frequencies that CalculiX finds of the same deck, and what cannot be taken."""

from __future__ import annotations

import shutil
import subprocess

import numpy as np
import pytest

from strainsight.decks.abaqus.deck import read_abaqus
from strainsight.errors import DeckError
from strainsight.fem.model import build_model
from strainsight.fem.modes import modes

from .test_loads import bar

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


@pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX is not installed")
def test_frequencies_on_springs_are_those_of_calculix(tmp_path):
    path = tmp_path / "bar.inp"
    path.write_text(free(bar()) + SPRINGS + "*STEP\n*FREQUENCY\n8\n*END STEP\n")
    subprocess.run(["ccx", "bar"], cwd=tmp_path, check=True, stdout=subprocess.DEVNULL, timeout=60)
    rows = [line.split() for line in (tmp_path / "bar.dat").read_text().splitlines()]
    expected = np.sqrt([float(row[1]) for row in rows if len(row) == 5 and row[0].isdigit()][:8]) / (2 * np.pi)
    mesh = read_abaqus(path)
    assert [str(own) for own in mesh.springs][-2:] == ["SPRINGA 85", "SPRING2 86"]
    model = build_model(mesh)
    np.testing.assert_allclose(modes(model.stiffness.constant, model.mass.constant, 8)[0], expected, rtol=2e-6)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("*SPRING, ELSET=SA\n\n2.E7", "*SPRING, ELSET=SA, NONLINEAR\n0., 0.\n2., 3.", "NONLINEAR is not supported"),
        ("*SPRING, ELSET=SA\n\n2.E7\n", "", "SPRINGA 85: no \\*SPRING gives it a stiffness"),
        ("85, 900, 3", "85, 900", "SPRINGA 85: it does not stand on nodes"),
        ("1, 1\n1.E7", "1, 5\n1.E7", "one end is a translation, the other a rotation"),
        ("2\n3.E7", "9\n3.E7", "degree of freedom 9"),
        ("2\n3.E7", "2", "not a line of degrees of freedom and one of stiffness"),
        ("2\n3.E7", "2\n-3.E7", "negative"),
        ("900, -.5, .2, .1", "900, 0.8, .1, .08", "the nodes of SPRINGA 85 coincide"),
    ],
)
def test_springs_that_cannot_be_taken_are_named(read, old, new, what):
    text = free(bar()) + SPRINGS
    assert old in text
    text = text.replace(old, new)
    if "coincide" in what:
        mesh = read(free(bar()))
        x = mesh.position[mesh.node_index(3)]
        text = text.replace("900, 0.8, .1, .08", "900, " + ", ".join(map(repr, x.tolist())))
    with pytest.raises(DeckError, match=what):
        read(text)
