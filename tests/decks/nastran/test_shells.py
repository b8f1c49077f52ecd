"""Shells and laminates of Nastran decks by their definitions; errors with their remedy."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import DeckError
from strainsight.mesh.thin import Lamina, Laminate, Ply

from ...refusals import refusal_table

FLAT = """\
GRID,1,,0.,0.,0.
GRID,2,,2.,0.,0.
GRID,3,,2.,1.,0.
GRID,4,,0.,1.,0.
GRID,5,,4.,0.,0.
CQUAD4,10,1,1,2,3,4
CTRIA3,11,2,2,5,3
PSHELL,1,1,.1,1,,1
PSHELL,2,1,.2
MAT1,1,2.1+11,,.3,7850.
"""


def changed(old, new):
    assert old in FLAT
    return FLAT.replace(old, new)


def test_shells_are_imported_by_kind_with_ids_and_lines(read):
    mesh = read(FLAT + "SET3,5,ELEM,10,11\n")
    quad, triangle = mesh.shells
    assert (quad.kind, quad.ids.tolist(), quad.nodes.tolist(), quad.region.tolist()) == ("quad4", [10], [[0, 1, 2, 3]], [1])
    assert (triangle.kind, triangle.ids.tolist(), triangle.nodes.tolist()) == ("tri3", [11], [[1, 4, 2]])
    assert np.isnan(quad.axis).all()
    assert not quad.offset.any()
    assert mesh.blocks == mesh.beams == ()
    assert {i: (region.name, region.material) for i, region in mesh.regions.items()} == {1: ("PSHELL 1", 1), 2: ("PSHELL 2", 1)}
    assert mesh.where("element", 11).endswith("deck.bdf:7")
    assert mesh.element_sets["SET3-5"].tolist() == [10, 11]
    assert mesh.ignored == {}
    assert mesh.notes[1:] == ()


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ("1,1,.1,1,,1", (0.1, 1, 5 / 6, 0)),
        ("1,1,.1,1,2.5,1,.7,3.", (0.1, 2.5, 0.7, 3)),
        ("1,1,.1,1", (0.1, 1, np.inf, 0)),
        ("1,1,.1", (0.1, 0, 0, 0)),
        ("1,1,.1,0,,0,,.5", (0.1, 0, 0, 0.5)),
        ("1,1,.1,1,,1\n,.05,-.05", (0.1, 1, 5 / 6, 0)),
    ],
)
def test_pshell_defines_thickness_bending_shear_and_mass(read, fields, expected):
    section = read(changed("1,1,.1,1,,1", fields)).sections[1]
    assert (section.thickness, section.bending, section.shear, section.nonstructural) == pytest.approx(expected)


QUAD, TRIANGLE = "CQUAD4,10,1,1,2,3,4", "CTRIA3,11,2,2,5,3"
SYSTEM = "CORD2R,7,,0.,0.,0.,{}\n"


@pytest.mark.parametrize(
    ("old", "new", "axis", "offset"),
    [
        (QUAD, "CQUAD4        10       1       1       2       3       4     30.     .25", (np.sqrt(3) / 2, 0.5, 0), 0.25),
        (QUAD, "CQUAD4*               10               1               1               2*\n"
         "*                      3               4             30.             .25", (np.sqrt(3) / 2, 0.5, 0), 0.25),
        (QUAD, QUAD + ",30.,.25", (np.sqrt(3) / 2, 0.5, 0), 0.25),
        (QUAD, "CQUADR,10,1,1,2,3,4,30.,.25", (np.sqrt(3) / 2, 0.5, 0), 0.25),
        # counted the other way round the normal is −z, and a positive angle turns clockwise as seen from +z
        (QUAD, "CQUAD4,10,1,2,1,4,3,30.", (-np.sqrt(3) / 2, 0.5, 0), 0),
        (TRIANGLE, TRIANGLE + ",90.,-.5", (0, 1, 0), -0.5),
        (QUAD, f"{QUAD},7\n{SYSTEM.format('0.,0.,1.')},1.,1.,0.", (np.sqrt(0.5), np.sqrt(0.5), 0), 0),
    ],
)  # fmt: skip
def test_shell_material_angle_system_and_offset(read, old, new, axis, offset):
    block = read(changed(old, new)).shells[old == TRIANGLE]
    assert block.offset.tolist() == [offset]
    np.testing.assert_allclose(block.axis, [axis], atol=1e-15)


def test_a_material_system_along_the_normal_is_refused(read):
    with pytest.raises(DeckError, match="the x axis of the material coordinate system 7 is normal to the shell"):
        read(changed(QUAD, f"{QUAD},7\n{SYSTEM.format('1.,1.,0.')},0.,0.,1."))


def test_two_shells_on_the_same_nodes_are_noted(read):
    (note,) = read(FLAT + "CQUAD4,12,1,3,4,1,2\n").doubts
    assert note.startswith("CQUAD4 12 has the same nodes as CQUAD4 10 (1 duplicate element in total)")


def test_warped_quadrilateral_is_noted_or_refused(read):
    """Corners lie by the least singular value over two off the plane nearest to them; 1.5/√5 where two are lifted by 3."""
    mesh = read(changed("GRID,3,,2.,1.,0.", "GRID,3,,2.,1.,.5"))
    x = mesh.position[:4]
    off = np.linalg.svd(x - x.mean(axis=0))[1][2] / 2
    diagonals = np.linalg.norm(x[2] - x[0]), np.linalg.norm(x[3] - x[1])
    (note,) = mesh.notes[1:]
    assert note.startswith("warped shells (1 in total): corners are more than 0.05")
    assert f"(largest {off / np.mean(diagonals):.2g}, CQUAD4 10)" in note
    assert read(changed("GRID,3,,2.,1.,0.", "GRID,3,,2.,1.,.4")).notes[1:] == ()
    with pytest.raises(DeckError, match=r"0\.67 of the mean diagonal off the mean plane \(limit 0\.3\)"):
        read(FLAT.replace("GRID,3,,2.,1.,0.", "GRID,3,,2.,1.,3.").replace("GRID,1,,0.,0.,0.", "GRID,1,,0.,0.,3."))


test_errors_have_file_and_line = refusal_table(changed, [
    ("CQUAD4,10,1,1,2,3,4", "CQUAD4,10,1,1,2,3,3", "has the same node twice", 6),
    ("CQUAD4,10,1,1,2,3,4", "CQUAD4,10,1,1,3,2,4", "has no area|folded", 6),
    ("GRID,3,,2.,1.,0.", "GRID,3,,1.,.5,0.", "corner of 180° or more", 6),
    ("PSHELL,1,1,.1,1,,1", "PSHEAR,1", "property 1 is a PSHEAR, but must be a PSHELL", 6),
    ("CQUAD4,10,1,1,2,3,4", "CQUAD4,10,1,1,2,3,4\n,,,.1,.1,.2,.1", r"T3 defines a thickness of 0\.2 at a corner", 6),
    ("PSHELL,1,1,.1,1,,1", "PSHELL,1,1,0.,1,,1", "thickness is 0", 8),
    ("PSHELL,1,1,.1,1,,1", "PSHELL,1,,.1,1,,1", "MID1 is blank", 8),
    ("PSHELL,1,1,.1,1,,1", "PSHELL,1,1,.1,2,,1", r"material 2 of MID2 \(bending\) is not a MAT1, MAT2 or MAT8", 8),
    ("PSHELL,1,1,.1,1,,1", "PSHELL,1,1,.1,-1,,1", "MID2 is -1 \\(plane strain", 8),
    ("PSHELL,1,1,.1,1,,1", "PSHELL,1,1,.1,1,,1,0.", "TS/T = 0", 8),
])


def totals(mesh, name):
    load = mesh.loads[name]
    return load.force.sum(axis=0), np.cross(mesh.position[load.nodes], load.force).sum(axis=0)


@pytest.mark.parametrize(
    ("cards", "force", "place"),
    [
        ("PLOAD2,1,3.,10\n", 3 * 2.0, [1, 0.5]),
        ("PLOAD,1,3.,4,3,2,1\n", -3 * 2.0, [1, 0.5]),
        ("PLOAD,1,3.,2,5,3\n", 3 * 1.0, [8 / 3, 1 / 3]),
        ("PLOAD4,1,10,3.,,,,THRU,11\n", 3 * 3.0, [(2 + 8 / 3) / 3, (1 + 1 / 3) / 3]),
    ],
)
def test_a_pressure_acts_along_the_normal_at_the_centre(read, cards, force, place):
    total, moment = totals(read(FLAT + cards), "LOAD-1")
    np.testing.assert_allclose(total, [0, 0, force], atol=1e-14)
    np.testing.assert_allclose(moment, np.cross([*place, 0], total), atol=1e-14)


def test_pload4_varies_between_corners_or_follows_vector(read):
    """p = x/2 on the square of 2 by 1: ∫ p dA = 1, ∫ p x dA = 4/3; along −y with its vector."""
    total, moment = totals(read(FLAT + "PLOAD4,1,10,0.,1.,1.,0.\n"), "LOAD-1")
    np.testing.assert_allclose(total, [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(moment, [0.5, -4 / 3, 0], atol=1e-15)
    total, _ = totals(read(FLAT + "PLOAD4,1,10,3.\n,,0.,-2.,0.\n"), "LOAD-1")
    np.testing.assert_allclose(total, [0, -6, 0], atol=1e-15)


# PCOMP, PCOMPG, MAT8 and shells of them: plies by their definitions, errors with their remedy, and what is kept of a deck.
DECK = """\
GRID,1,,0.,0.,0.
GRID,2,,2.,0.,0.
GRID,3,,2.,1.,0.
GRID,4,,0.,1.,0.
CQUAD4,10,1,1,2,3,4,30.,.5
PCOMP,1,-.1,2.5,,,,,
,8,.1,45.,YES,,,-45.,
,1,.2,,YES
MAT8,8,1.4+11,1.+10,.3,5.+9,4.+9,3.+9,1600.
MAT1,1,2.1+11,,.3,7850.
"""


def changed_plies(old, new):
    assert old in DECK
    return DECK.replace(old, new)


def test_pcomp_plies_are_read_bottom_up_with_defaults(read):
    mesh = read(DECK)
    plies = (Ply(8, 0.1, 45.0), Ply(8, 0.1, -45.0), Ply(1, 0.2, 0.0))
    assert mesh.sections == {1: Laminate(plies, 2.5)}
    assert mesh.laminae == {8: Lamina(8, 1.4e11, 1e10, 0.3, 5e9, 4e9, 3e9, 1600.0)}
    assert (mesh.regions[1].name, mesh.regions[1].material, list(mesh.materials)) == ("PCOMP 1", 0, [1])
    (block,) = mesh.shells
    assert block.offset[0] == pytest.approx(0.5 - 0.1 + 0.2)  # ZOFFS to the plane, Z0 to the lower face, half of 0.4
    np.testing.assert_allclose(block.axis[0], [np.sqrt(0.75), 0.5, 0], atol=1e-12)
    assert mesh.ignored == {}


def test_laminate_is_centred_without_z0(read):
    assert read(changed_plies("PCOMP,1,-.1", "PCOMP,1,")).shells[0].offset[0] == pytest.approx(0.5)


def test_symmetric_laminate_is_mirrored(read):
    (section,) = read(changed_plies("PCOMP,1,-.1,2.5,,,,,", "PCOMP,1,,,,,,,SYM")).sections.values()
    assert [(ply.material, ply.angle) for ply in section.plies] == [(8, 45), (8, -45), (1, 0), (1, 0), (8, -45), (8, 45)]
    assert section.thickness == pytest.approx(0.8)


def test_pcompg_reads_one_line_per_ply(read):
    old = DECK[DECK.index("PCOMP,1") : DECK.index("MAT8")]
    own = read(DECK.replace(old, "PCOMPG,1,-.1,2.5,,,,,\n,101,8,.1,45.,YES\n,102,,,-45.\n,103,1,.2,,YES\n")).sections
    assert own == read(DECK).sections


def test_orthotropic_pshell_is_single_ply_laminate(read):
    old = DECK[DECK.index("PCOMP,1") : DECK.index("MAT8")]
    mesh = read(DECK.replace(old, "PSHELL,1,8,.1,8,,8,,3.\n"))
    assert mesh.sections == {1: Laminate((Ply(8, 0.1),), 3.0)}
    assert mesh.regions[1].material == 0
    assert mesh.ignored == {"MAT1 that no property refers to": 1}


def test_wtmass_scales_laminate_density(read):
    mesh = read("PARAM,WTMASS,.5\n" + DECK)
    assert (mesh.laminae[8].density, mesh.sections[1].nonstructural) == (800.0, 1.25)
    assert mesh.density_of(1) == pytest.approx((0.2 * 800 + 0.2 * 3925) / 0.4)


test_what_is_wrong_is_named_with_file_and_line_of_composites = refusal_table(changed_plies, [
    ("2.5,,,,,\n", "2.5,,,,,MEM\n", "LAM is MEM", 6),
    (",8,.1,45.", ",8,0.,45.", "thickness of ply 1 is 0", 6),
    (",8,.1,45.,YES,,,-45.,\n,1,.2,,YES\n", "", "no plies", 6),
    ("MAT1,1,2.1+11,,.3,7850.", "MAT9,1,2.1+11", "material 1 of the plies is a MAT9", 6),
    ("1.4+11,1.+10", "0.,1.+10", "E1 is 0, not positive", 9),
    (".3,5.+9", "4.,5.+9", "NU12 is 4, but its square must be less than E1/E2 = 14", 9),
])
