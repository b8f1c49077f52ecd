"""Anisotropic solids (MAT9, MAT11) and their layers (PCOMPS) against tensors with four indices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import DeckError
from strainsight.fem.assembly import assemble_stiffness
from strainsight.fem.checks import check_mesh
from strainsight.fem.mass import mass_properties

from ...anisotropy import CONSTANTS, TURN, flexibility, strains, tensor, triclinic, turned, work, works_of
from ...refusals import expect_refusal, refusal_table
from ..abaqus.test_anisotropic import MIDDLES, about, check_layers, inverse

NASTRAN = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
"""MAT9: G44 is of xy, G55 of yz, G66 of zx (Quick Reference Guide)."""
CORNERS = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], float)
BRICK = CORNERS @ np.array([[1.0, 0.1, 0.2], [-0.3, 0.9, 0.1], [0.1, -0.2, 1.2]])
"""Corners of a parallelepiped."""
ORIGIN = np.array([4.0, -3.0, 2.0])


def card(name, *values):
    fields = [name, *(v if isinstance(v, (str, int)) else f"{v:.10e}" for v in values)]
    lines = [fields[:9], *(["", *fields[i : i + 8]] for i in range(9, len(fields), 8))]
    return "\n".join(",".join(map(str, line)) for line in lines)


def deck(material, cordm="", system="CORD2R"):
    points = [ORIGIN, ORIGIN + TURN[:, 2], ORIGIN + TURN[:, 0]]
    lines = [card("GRID", i, "", *x) for i, x in enumerate(BRICK, start=1)]
    lines += ["CHEXA,10,1,1,2,3,4,5,6", ",7,8", card("PSOLID", 1, 3, cordm), card(system, 5, 0, *np.ravel(points))]
    return "\n".join(["BEGIN BULK", *lines, material, "ENDDATA", ""])


def mat9(C, density=1600.0):
    return card("MAT9", 3, *C[np.triu_indices(6)], density)


MAT11 = card("MAT11", 3, *CONSTANTS[0], *CONSTANTS[1], *CONSTANTS[2], 1600.0)


@pytest.mark.parametrize(("cordm", "axes"), [("", np.eye(3)), ("0", np.eye(3)), ("5", TURN)])
def test_mat9_energy_matches_tensor(read, cordm, axes):
    mesh, volume = read(deck(mat9(triclinic()), cordm)), np.linalg.det(BRICK[[1, 3, 4]] - BRICK[0])
    check_layers(mesh, turned(tensor(triclinic(), NASTRAN), axes), volume)
    assert mass_properties(mesh)[0] == pytest.approx(1600.0 * volume)
    assert mesh.ignored == ({} if cordm == "5" else {"CORD2R that no card refers to": 1})
    assert mesh.notes == ()


def test_mat11_stiffness_is_inverse_compliance(read):
    volume = np.linalg.det(BRICK[[1, 3, 4]] - BRICK[0])
    check_layers(read(deck(MAT11, "5")), turned(inverse(flexibility(*CONSTANTS)), TURN), volume)


@pytest.mark.parametrize("system", ["CORD2C", "CORD2S"])
def test_material_axes_follow_curved_system(read, system):
    """A brick far from the axis sees one direction, e_r e_θ e_z or e_r e_θ e_φ at its middle, to the angle that it spans."""
    middle = BRICK.mean(axis=0) - ORIGIN
    x, y, z = middle @ TURN
    if system == "CORD2C":
        r = np.array([x, y, 0]) / np.hypot(x, y)
        local = np.column_stack([r, [-r[1], r[0], 0], [0, 0, 1]])
    else:
        r = np.array([x, y, z]) / np.linalg.norm(middle)
        phi = np.array([-y, x, 0]) / np.hypot(x, y)
        local = np.column_stack([r, np.cross(phi, r), phi])
    C = turned(tensor(triclinic(), NASTRAN), TURN @ local)
    text = deck(mat9(triclinic()), "5", system)
    mesh = read(text)
    small = BRICK.mean(axis=0) + 1e-4 * (mesh.position - BRICK.mean(axis=0))
    found = works_of(assemble_stiffness(replace(mesh, position=small)), small)
    volume = 1e-12 * np.linalg.det(BRICK[[1, 3, 4]] - BRICK[0])
    np.testing.assert_allclose(found, [volume * work(C, own) for own in strains()], rtol=1e-3)


test_errors_have_remedy = refusal_table(deck, [
    (mat9(np.diag([1.0, 1, 1, 1, 0, 1])), "", "diagonal entry 5 is 0"),
    (mat9(np.eye(6) + 1.5 * np.eye(6)[[1, 0, 2, 3, 4, 5]]), "", "smallest eigenvalue is -0.5"),
    (mat9(triclinic()), "6", "coordinate system 6"),
    (MAT11.replace("3.0000000000e-01", "4."), "", "smallest eigenvalue of .* is -"),
    (MAT11 + "\nMAT1,3,2.1+11,,.3", "", "material id 3 is used twice, also by a"),
], placed=False)


# PCOMPS along CORDM, against tensors with four indices; errors with file, line and remedy.
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


def layered_deck(head=(5, 13, "", "", "", "", ""), plies=PLIES, nodes=IN_NASTRAN, name="CHEXA", more=()):
    lines = [card("GRID", i, "", *x) for i, x in enumerate(NODES, start=1)]
    lines += [card(name, 10, 1, *nodes), card("PCOMPS", 1, *head, *(field for ply in plies for field in ply))]
    lines += [MAT11, "MAT1,1,2.+11,,.3,7800.", "MAT8,8,1.4+11,1.+10,.3,5.+9,4.+9,3.+9,1600."]
    lines += [card("CORD2R", 5, 0, 0.0, 0.0, 0.0, *AXES[:, 2], *AXES[:, 0]), *more]
    return "\n".join(["BEGIN BULK", *lines, "ENDDATA", ""])


def test_solid_plies_are_weighted_and_rotated(read):
    mesh = read(layered_deck())
    check_layers(mesh, 0.6 * STEEL + 0.2 * sum(turned(CARBON, AXES @ about(3, angle)) for angle in (30, -45)), VOLUME)
    assert mesh.regions[1].name == "PCOMPS 1"
    mass, centre = mass_properties(mesh)
    assert mass == pytest.approx(VOLUME * (0.4 * 1600 + 0.6 * 7800), rel=1e-9)
    np.testing.assert_allclose(centre, np.full(3, 0.5) @ LEAN, rtol=1e-9)


@pytest.mark.parametrize(("psdir", "lies"), [("", np.eye(3)), (23, np.array([[0, -1.0, 0], [1, 0, 0], [0, 0, 1]]))])
def test_psdir_first_digit_is_ply_direction(read, psdir, lies):
    mesh = read(layered_deck((5, psdir, "", "", "", "", ""), [(1, 3, 1.0, 20.0)]))
    check_layers(mesh, turned(CARBON, AXES @ lies @ about(3, 20)), VOLUME)


@pytest.mark.parametrize("psdir", [12, 32, 21, 31])
def test_psdir_second_digit_is_stacking_direction(read, psdir):
    """A system whose axis of that number is the third of system 5: the same material axes from the first digit on."""
    along, across = psdir // 10 - 1, psdir % 10 - 1
    system = np.empty((3, 3))
    system[:, along], system[:, across] = AXES[:, 0], AXES[:, 2]
    rest = 3 - along - across
    system[:, rest] = np.cross(system[:, (rest + 1) % 3], system[:, (rest + 2) % 3])
    other = card("CORD2R", 6, 0, 0.0, 0.0, 0.0, *system[:, 2], *system[:, 0])
    mesh = read(layered_deck((6, psdir, "", "", "", "", ""), [(1, 3, 1.0, 20.0)], more=[other]))
    check_layers(mesh, turned(CARBON, AXES @ about(3, 20)), VOLUME)


def test_first_ply_is_at_first_facet(read):
    """And stays there where the element is numbered left-handed; a blank material and thickness are those before."""
    plies = (1, 1, 1.0, "", "", "", "", ""), (2, 3, 1.0, "", "", "", "", ""), (3, "", "", 10.0)
    upward = (7800 * 1 / 6 + 1600 * (3 / 6 + 5 / 6)) / (7800 + 2 * 1600)
    for nodes in ((*range(1, 9),), (1, 4, 3, 2, 5, 8, 7, 6)):
        mesh = read(layered_deck(plies=plies, nodes=nodes))
        _, centre = mass_properties(mesh)
        np.testing.assert_allclose(centre, [0.5, 0.5, upward] @ LEAN, rtol=1e-9)


@pytest.mark.parametrize("nodes", [(1, 2, 3, 5, 6, 7)])
def test_wedges_have_layers_from_triangle_to_triangle(read, nodes):
    mesh = read(layered_deck(nodes=nodes, name="CPENTA"))
    check_mesh(mesh)
    assert mass_properties(mesh)[0] == pytest.approx(0.5 * VOLUME * (0.4 * 1600 + 0.6 * 7800), rel=1e-9)


def test_deviating_stacking_axis_is_noted_or_refused(read):
    assert any("off the element normal (element 10)" in note for note in read(layered_deck()).notes)
    with expect_refusal(DeckError, "off the layer normal that CORDM and PSDIR define", remedy="reorder the nodes"):
        read(layered_deck(nodes=(5, 8, 7, 6, 1, 4, 3, 2)))
    with pytest.raises(DeckError, match="off the layer normal that CORDM"):
        read(layered_deck((5, 12, "", "", "", "", "")))


def test_symmetric_layers_allow_both_stacking_directions(read):
    one, three = [(1, 3, 1.0, 20.0)], [(1, 3, 0.25, 30.0, "", "", "", ""), (2, 1, 0.5, "", "", "", "", ""), (3, 3, 0.25, 30.0)]
    for plies in (one, three):
        upright, turned_over = (
            assemble_stiffness(read(layered_deck(plies=plies, nodes=nodes))).toarray()
            for nodes in ((*range(1, 9),), (5, 8, 7, 6, 1, 4, 3, 2))
        )
        np.testing.assert_allclose(turned_over, upright, rtol=1e-9, atol=1e-9 * abs(upright).max())


test_errors_have_file_line_and_remedy = refusal_table(lambda options: layered_deck(**options), [
    ({"plies": [(1, 3, 0.0, 0.0)]}, "the thickness of ply 1 is 0, not positive", 25),
    ({"plies": [(1, 9, 1.0)]}, "material 9 is not in the deck", 25),
    ({"head": (5, 33, "", "", "", "", "")}, "PSDIR is 33", 25),
    ({"head": ("", 13, "", "", "", "", "")}, "CORDM is blank", 25),
    ({"head": (77, 13, "", "", "", "", "")}, "coordinate system 77", 25),
    ({"name": "CTETRA", "nodes": (1, 2, 4, 5)}, "tet4 element 10 cannot have layers", 23),
])
