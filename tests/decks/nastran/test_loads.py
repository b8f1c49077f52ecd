"""Point masses and forces: where the deck puts them, in whatever system it writes them."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import DeckError

# cylinder about the line x = 1, y = 2; its r at (1, 4, ·) is the y axis, its θ the −x axis
CYLINDER = "CORD2C,6,,1.,2.,3.,1.,2.,4.\n+,2.,2.,3.\n"
TURNED = "CORD2R,7,,1.,2.,3.,2.,2.,3.\n+,1.,3.,3.\n"  # its z is x, its x is y, so its y is z
RIGID = "GRID,50,,1.,4.,5.\nRBE2,99,50,123456,4\nENDDATA\n"


def mass(read, tetrahedron, card):
    (point,) = read(CYLINDER + TURNED + tetrahedron + card + "\n" + RIGID).point_masses
    return point


@pytest.mark.parametrize(
    ("cid", "given", "offset"),
    [
        ("", ".1,.2,.3", (0.1, 0.2, 0.3)),
        ("6", ".1,.2,.3", (-0.2, 0.1, 0.3)),
        ("7", ".1,.2,.3", (0.3, 0.1, 0.2)),
        ("-1", "1.1,4.2,5.3", (0.1, 0.2, 0.3)),
    ],
)
def test_the_offset_of_a_mass_lies_along_its_system(read, tetrahedron, cid, given, offset):
    point = mass(read, tetrahedron, f"CONM2,90,50,{cid},3.,{given}")
    assert (point.id, point.node, point.mass) == (90, 4, 3.0)
    np.testing.assert_allclose(point.offset, offset, atol=1e-15)
    assert not point.inertia.any()


@pytest.mark.parametrize(("cid", "axes"), [("", np.eye(3)), ("7", np.eye(3)[:, [1, 2, 0]]), ("-1", np.eye(3))])
def test_inertia_is_that_of_the_body_it_was_computed_for(read, tetrahedron, cid, axes):
    """I11 = ∫(x₂² + x₃²) dm, I21 = ∫ x₁x₂ dm of a few particles; the tensor is Σ m (r² I − r rᵀ)."""
    rng = np.random.default_rng(1)
    r, m = rng.normal(size=(5, 3)), rng.uniform(0.5, 2, 5)
    x = r @ axes
    moments = [np.sum(m * (x[:, (i + 1) % 3] ** 2 + x[:, (i + 2) % 3] ** 2)) for i in range(3)]
    products = {(i, j): np.sum(m * x[:, i] * x[:, j]) for i, j in ((1, 0), (2, 0), (2, 1))}
    values = (moments[0], products[1, 0], moments[1], products[2, 0], products[2, 1], moments[2])
    fields = ",".join(f"{value:.12f}" for value in values)
    point = mass(read, tetrahedron, f"CONM2,90,50,{cid},3.\n+,{fields}")
    expected = sum(mi * (ri @ ri * np.eye(3) - np.outer(ri, ri)) for mi, ri in zip(m, r, strict=True))
    np.testing.assert_allclose(point.inertia, expected, atol=1e-11)


def test_wtmass_scales_inertia_and_not_the_offset(read, tetrahedron):
    point = mass(read, tetrahedron, "PARAM,WTMASS,.5\nCONM2,90,50,,3.,.1\n+,2.,,2.,,,2.")
    assert point.mass == 1.5
    np.testing.assert_array_equal(point.inertia, np.eye(3))
    np.testing.assert_array_equal(point.offset, [0.1, 0, 0])


def test_offset_and_inertia_at_a_node_without_rotations_are_a_note(read, tetrahedron):
    (note,) = read(tetrahedron + "CONM2,90,3,,3.,0.,0.,.1\nCONM2,91,2,,3.\n" + RIGID).notes
    assert note.startswith("CONM2 90: node 3 has no rotations")
    assert read(tetrahedron + "CONM2,90,4,,3.,0.,0.,.1\n" + RIGID).notes == ()


@pytest.mark.parametrize(
    ("card", "what"),
    [
        ("CONM2,90,50,8,3.", "coordinate system 8 is no CORD1 or CORD2"),
        ("CONM2,90,50,,3.\n+,1.,,1.,,,-1.", "principal moments -1, 1, 1"),
        ("CONM2,90,50,,3.\n+,1.,2.,1.,,,1.", "principal moments -1, 1, 3"),
        ("CONM2,90,50,,3.\n+,-1.,,,,,", "principal moments -1, 0, 0"),
        ("FORCE,1,77,,1.,1.", "node 77 is not in the deck"),
        ("FORCE,1,4,8,1.,1.", "coordinate system 8 is no CORD1 or CORD2"),
        ("FORCE,1,4,,,1.", "the force .* is ''"),
    ],
)
def test_masses_and_forces_that_cannot_be_taken_are_named(read, tetrahedron, card, what):
    with pytest.raises(DeckError, match=what) as caught:
        read(tetrahedron + card + "\n" + RIGID)
    assert caught.value.where.endswith("deck.bdf:9")


def test_forces_of_a_set_add_up_in_the_basic_system(read, tetrahedron):
    cards = "FORCE,3,50,,2.,1.,0.,-1.\nFORCE,3,50,6,3.,1.,2.,3.\nFORCE,3,4,7,1.,1.\nFORCE,12,4,,5.,,1.\n"
    mesh = read(CYLINDER + TURNED + tetrahedron + cards + RIGID)
    assert list(mesh.loads) == ["FORCE-3", "FORCE-12"]
    found = dict(zip(mesh.loads["FORCE-3"].nodes.tolist(), mesh.loads["FORCE-3"].force, strict=True))
    np.testing.assert_allclose(found[4], [2 - 6, 3, -2 + 9], atol=1e-14)
    np.testing.assert_allclose(found[3], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(mesh.loads["FORCE-12"].force, [[0, 5, 0]])
    assert mesh.ignored == {}
