"""PCOMPS along CORDM, against tensors with four indices; errors with file, line and remedy."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import DeckError
from strainsight.fem.assembly import assemble_stiffness
from strainsight.fem.checks import check_mesh
from strainsight.fem.mass import mass_properties

from ...anisotropy import CONSTANTS, flexibility, strains, tensor, turned, work, works_of
from ..abaqus.test_anisotropic import inverse
from ..abaqus.test_composite_solids import MIDDLES, about
from .test_anisotropic import CORNERS, MAT11, card

LEAN = np.array([[1.0, 0.1, 0.05], [-0.3, 0.9, 0.1], [0.0, 0.1, 1.2]])
"""A parallelepiped: its edges, one in a row."""
NODES = np.vstack([CORNERS, MIDDLES]) @ LEAN
VOLUME = np.linalg.det(LEAN)
AXES = about(1, -8) @ about(3, 25)
"""Of system 5, whose z is some 15° off the normal of the first facet."""
G = 2e11 / 2.6
STEEL = tensor(G * np.diag([2.0, 2, 2, 1, 1, 1]) + 1.5 * G * np.pad(np.ones((3, 3)), (0, 3)))
CARBON = inverse(flexibility(*CONSTANTS))
IN_NASTRAN = (*range(1, 13), 17, 18, 19, 20, 13, 14, 15, 16)
"""Middles of sides: bottom, uprights, top."""
PLIES = (1, 3, 0.2, 30.0, "", "", "", ""), (2, 1, 0.6, "", "", "", "", ""), (3, 3, 0.2, -45.0)


def deck(head=(5, 13, "", "", "", "", ""), plies=PLIES, nodes=IN_NASTRAN, name="CHEXA", more=()):
    lines = [card("GRID", i, "", *x) for i, x in enumerate(NODES, start=1)]
    lines += [card(name, 10, 1, *nodes), card("PCOMPS", 1, *head, *(field for ply in plies for field in ply))]
    lines += [MAT11, "MAT1,1,2.+11,,.3,7800.", "MAT8,8,1.4+11,1.+10,.3,5.+9,4.+9,3.+9,1600."]
    lines += [card("CORD2R", 5, 0, 0.0, 0.0, 0.0, *AXES[:, 2], *AXES[:, 0]), *more]
    return "\n".join(["BEGIN BULK", *lines, "ENDDATA", ""])


def check(mesh, C):
    check_mesh(mesh)
    found = works_of(assemble_stiffness(mesh), mesh.position)
    np.testing.assert_allclose(found, [VOLUME * work(C, own) for own in strains()], rtol=1e-8)


def test_plies_count_by_their_share_and_turn_about_the_axis_across(read):
    mesh = read(deck())
    check(mesh, 0.6 * STEEL + 0.2 * sum(turned(CARBON, AXES @ about(3, angle)) for angle in (30, -45)))
    assert mesh.regions[1].name == "PCOMPS 1"
    mass, centre = mass_properties(mesh)
    assert mass == pytest.approx(VOLUME * (0.4 * 1600 + 0.6 * 7800), rel=1e-9)
    np.testing.assert_allclose(centre, np.full(3, 0.5) @ LEAN, rtol=1e-9)


@pytest.mark.parametrize(("psdir", "lies"), [("", np.eye(3)), (23, np.array([[0, -1.0, 0], [1, 0, 0], [0, 0, 1]]))])
def test_the_first_digit_of_psdir_is_along_plies_at_0(read, psdir, lies):
    mesh = read(deck((5, psdir, "", "", "", "", ""), [(1, 3, 1.0, 20.0)]))
    check(mesh, turned(CARBON, AXES @ lies @ about(3, 20)))


@pytest.mark.parametrize("psdir", [12, 32, 21, 31])
def test_the_second_digit_is_across(read, psdir):
    """A system whose axis of that number is the third of system 5: the same material axes from the first digit on."""
    along, across = psdir // 10 - 1, psdir % 10 - 1
    system = np.empty((3, 3))
    system[:, along], system[:, across] = AXES[:, 0], AXES[:, 2]
    rest = 3 - along - across
    system[:, rest] = np.cross(system[:, (rest + 1) % 3], system[:, (rest + 2) % 3])
    other = card("CORD2R", 6, 0, 0.0, 0.0, 0.0, *system[:, 2], *system[:, 0])
    mesh = read(deck((6, psdir, "", "", "", "", ""), [(1, 3, 1.0, 20.0)], more=[other]))
    check(mesh, turned(CARBON, AXES @ about(3, 20)))


def test_the_first_ply_is_at_the_first_facet(read):
    """And stays there where the element is numbered left-handed; a blank material and thickness are those before."""
    plies = (1, 1, 1.0, "", "", "", "", ""), (2, 3, 1.0, "", "", "", "", ""), (3, "", "", 10.0)
    upward = (7800 * 1 / 6 + 1600 * (3 / 6 + 5 / 6)) / (7800 + 2 * 1600)
    for nodes in ((*range(1, 9),), (1, 4, 3, 2, 5, 8, 7, 6)):
        mesh = read(deck(plies=plies, nodes=nodes))
        _, centre = mass_properties(mesh)
        np.testing.assert_allclose(centre, [0.5, 0.5, upward] @ LEAN, rtol=1e-9)


@pytest.mark.parametrize("nodes", [(1, 2, 3, 5, 6, 7)])
def test_wedges_have_layers_from_triangle_to_triangle(read, nodes):
    mesh = read(deck(nodes=nodes, name="CPENTA"))
    check_mesh(mesh)
    assert mass_properties(mesh)[0] == pytest.approx(0.5 * VOLUME * (0.4 * 1600 + 0.6 * 7800), rel=1e-9)


def test_isotropic_plies_need_no_axes(read):
    check(read(deck(("", "", "", "", "", "", ""), [(1, 1, 1.0, 45.0)])), STEEL)


def test_axes_off_the_normal_are_noted_and_another_axis_is_refused(read):
    assert any("off the normal of elements (10)" in note for note in read(deck()).notes)
    with pytest.raises(DeckError, match="off the axis of CORDM that PSDIR puts across them") as error:
        read(deck(nodes=(5, 8, 7, 6, 1, 4, 3, 2)))
    assert "number the nodes" in error.value.remedy
    with pytest.raises(DeckError, match="off the axis of CORDM"):
        read(deck((5, 12, "", "", "", "", "")))


def test_layers_that_are_alike_from_both_sides_may_be_counted_from_either(read):
    """One ply, or 30°, 0° and 30°: of an element that stands on its head the stiffness is the same."""
    one, three = [(1, 3, 1.0, 20.0)], [(1, 3, 0.25, 30.0, "", "", "", ""), (2, 1, 0.5, "", "", "", "", ""), (3, 3, 0.25, 30.0)]
    for plies in (one, three):
        upright, turned_over = (
            assemble_stiffness(read(deck(plies=plies, nodes=nodes))).toarray()
            for nodes in ((*range(1, 9),), (5, 8, 7, 6, 1, 4, 3, 2))
        )
        np.testing.assert_allclose(turned_over, upright, rtol=1e-9, atol=1e-9 * abs(upright).max())


def test_what_no_element_refers_to_is_counted(read):
    mesh = read(deck(more=["PCOMPS,7", ",1,99,0."]))
    assert mesh.ignored == {"MAT8 that no property refers to": 1, "PCOMPS that no element refers to": 1}


@pytest.mark.parametrize(
    ("options", "what", "remedy"),
    [
        ({"plies": [(1, 3, 0.0, 0.0)]}, "the thickness of ply 1 is 0, not positive", "positive thickness"),
        (
            {"plies": [(1, 3, 1.0, "", "", "", "", ""), (2, 3, -1.0)]},
            "the thickness of ply 2 is -1",
            "positive thickness",
        ),
        ({"plies": [(1, 9, 1.0)]}, "material 9 is not in the deck", "add a MAT1"),
        ({"plies": [(1, 8, 1.0)]}, "material 8 is a MAT8", "MAT9 or MAT11"),
        ({"plies": [("", "", "")]}, "it has no plies", "second line"),
        ({"head": (5, 33, "", "", "", "", "")}, "PSDIR is 33", "12, 13, 21, 23, 31 or 32"),
        ({"head": ("", 13, "", "", "", "", "")}, "CORDM is blank", "CORD2R"),
        ({"head": (-1, 13, "", "", "", "", "")}, "CORDM is -1", "0 for the basic"),
        ({"head": (77, 13, "", "", "", "", "")}, "coordinate system 77", "add the card"),
        ({"name": "CTETRA", "nodes": (1, 2, 4, 5)}, "tet4 element 10 can have no layers", "CHEXA and CPENTA"),
        ({"more": ["PSOLID,1,1"]}, "stands twice", "own id"),
    ],
)
def test_what_is_wrong_is_named_with_file_line_and_remedy(read, options, what, remedy):
    text = deck(**options)
    with pytest.raises(DeckError, match=what) as error:
        read(text)
    lines = text.split("\n")
    assert lines[int(error.value.where.rpartition(":")[2]) - 1].startswith("PCOMPS")
    assert remedy in error.value.remedy
