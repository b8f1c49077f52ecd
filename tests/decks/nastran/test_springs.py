"""Springs of a deck: chains by hand, bushes in their systems, and what cannot be taken."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh

from strainsight.errors import DeckError
from strainsight.fem.model import build_model
from strainsight.fem.modes import modes
from strainsight.fem.springs import spring_operator
from strainsight.fem.ties import rotation_rows

CHAIN = """\
GRID,50,,2.,0.,0.
GRID,51,,3.,0.,0.
CONM2,90,50,,2.
CONM2,91,51,,3.
SPC1,1,23,50,51
SPC1,1,123,4
CELAS2,60,100.,50,1,51,1
CELAS1,61,7,51,1
PELAS,6,1.,,,7,50.
"""
"""Two masses along x, m = 2 and 3 kg, k = 100 N/m between them, 50 N/m from the second to the ground."""


def test_masses_on_springs_swing_as_by_hand(read, tetrahedron):
    """Held at all its nodes but the chain, the tetrahedron does not take part."""
    mesh = read(tetrahedron + CHAIN + "ENDDATA\n")
    assert [str(own) for own in mesh.springs] == ["CELAS1 61", "CELAS2 60"]
    model = build_model(mesh)
    assert model.size == 2
    K, M = np.array([[100.0, -100], [-100, 150]]), np.diag([2.0, 3])
    found = modes(model.stiffness.constant, model.mass.constant, 2)[0]
    np.testing.assert_allclose(found, np.sqrt(eigh(K, M, eigvals_only=True)) / (2 * np.pi), rtol=1e-10)
    assert mesh.ignored == {}


def matrix(mesh):
    """K of the springs on the six motions of nodes 50 and 51, which lead ties."""
    rows = rotation_rows(mesh)
    nodes = [mesh.node_index(number) for number in (50, 51)]
    at = [first + c for first in (*(3 * node for node in nodes), *(rows[node] for node in nodes)) for c in range(3)]
    return spring_operator(mesh, rows).constant.toarray()[np.ix_(at, at)]


TIED = "GRID,50,,2.,0.,0.\nGRID,51,,2.,0.,3.\nRBE2,80,50,123,2\nRBE2,81,51,123,3\n"


@pytest.mark.parametrize(
    ("card", "axes"),
    [
        ("CBUSH,60,7,50,51,,,,0", np.eye(3)),
        ("CBUSH,60,7,50,51,0.,1.,0.", [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
        ("CBUSH,60,7,50,51,1", [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]),
    ],
)
def test_a_bush_has_the_energy_of_its_springs(read, tetrahedron, card, axes):
    """½ Σ k s² for any motions, s between the motions of the two rigid arms that meet in the middle; rows of axes: x, y, z;
    of the last card y points to node 1 at the origin."""
    k = [3.0, 5, 7, 11, 13, 17]
    property_ = "PBUSH,7,K," + ",".join(map(str, k)) + "\n"
    axes, K = np.asarray(axes, float), matrix(read(f"{tetrahedron}{TIED}{card}\n{property_}ENDDATA\n"))
    rng = np.random.default_rng(0)
    uA, uB, tA, tB = rng.normal(size=(4, 3))
    apart = (uB + np.cross(tB, [0, 0, -1.5])) - (uA + np.cross(tA, [0, 0, 1.5]))
    s = np.concatenate([axes @ apart, axes @ (tB - tA)])
    z = np.concatenate([uA, uB, tA, tB])
    assert z @ K @ z == pytest.approx(np.sum(k * s**2))
    rigid = np.concatenate([uA, uA + np.cross(tA, [0, 0, 3.0]), tA, tA])
    np.testing.assert_allclose(K @ rigid, 0, atol=1e-12)


def test_a_spring_acts_along_the_system_of_its_node(read, tetrahedron):
    system = "CORD2R,5,,0.,0.,0.,1.,0.,0.\n+,0.,1.,0.\n"  # its z is x, its x is y
    text = system + tetrahedron.replace("GRID,4,,0.,0.,1.", "GRID,4,,0.,0.,1.,5") + "CELAS2,60,9.,4,3\nENDDATA\n"
    (own,) = read(text).springs
    np.testing.assert_allclose(own.value, [1, 0, 0], atol=1e-15)
    assert own.component.tolist() == [0, 1, 2]


def test_damping_of_springs_is_a_note(read, tetrahedron):
    notes = read(tetrahedron + "CELAS2,60,9.,4,3,,,.02\nCBUSH,61,7,4,,,,,0\nPBUSH,7,K,1.\n+,,B,2.\nENDDATA\n").notes
    assert "GE of 1 CELAS is not imported: damping comes from the config" in notes
    assert "B and GE of PBUSH are not imported: damping comes from the config" in notes


@pytest.mark.parametrize(
    ("cards", "what"),
    [
        ("CELAS1,60,7,4,3\n", "property 7 is no PELAS"),
        ("CELAS2,60,9.,4,7\n", "component 7 is not one"),
        ("CELAS2,60,9.,4,1,3,5\n", "one end is a translation, the other a rotation"),
        ("CELAS2,60,-9.,4,1\n", "negative"),
        ("CELAS2,60,9.\n", "has no end on a node"),
        ("CBUSH,60,7,4,,,,,0\n", "property 7 is no PBUSH"),
        ("CBUSH,60,7,4\nPBUSH,7,K,1.\n", "it has no axes of its own"),
        ("CBUSH,60,7,4,3\nPBUSH,7,K,1.,2.\n", "neither CID, GO nor X1 to X3"),
        ("CBUSH,60,7,4,3,,,,0\n+,.2\nPBUSH,7,K,1.\n", "S is .2"),
        ("CBUSH,60,7,4,3,,,,0\n+,,5,1.\nPBUSH,7,K,1.\n", "OCID puts the spring"),
        ("CBUSH,60,7,4,3,,,,0\nPBUSH,7,K,RIGID\n", "a stiffness is RIGID"),
        ("CBUSH,60,7,4,3,,,,0\nPBUSH,7,K,1.\n+,,M,2.\n", "has a mass M"),
        ("CELAS2,60,9.,4,1\nCELAS2,60,9.,4,2\n", "element id 60 stands twice"),
    ],
)
def test_springs_that_cannot_be_taken_are_named(read, tetrahedron, cards, what):
    with pytest.raises(DeckError, match=what):
        read(tetrahedron + cards + "ENDDATA\n")
