"""PCOMP, PCOMPG, MAT8 and shells of them: plies by their definitions, errors with their remedy, and what is kept of a deck."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import DeckError
from strainsight.mesh.laminates import Lamina, Laminate, Ply

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


def changed(old, new):
    assert old in DECK
    return DECK.replace(old, new)


def test_plies_come_from_the_lower_face_up_and_blank_entries_from_the_ply_before(read):
    mesh = read(DECK)
    plies = (Ply(8, 0.1, 45.0), Ply(8, 0.1, -45.0), Ply(1, 0.2, 0.0))
    assert mesh.sections == {1: Laminate(plies, 2.5)}
    assert mesh.laminae == {8: Lamina(8, 1.4e11, 1e10, 0.3, 5e9, 4e9, 3e9, 1600.0)}
    assert (mesh.regions[1].name, mesh.regions[1].material, list(mesh.materials)) == ("PCOMP 1", 0, [1])
    (block,) = mesh.shells
    assert block.offset[0] == pytest.approx(0.5 - 0.1 + 0.2)  # ZOFFS to the plane, Z0 to the lower face, half of 0.4
    np.testing.assert_allclose(block.axis[0], [np.sqrt(0.75), 0.5, 0], atol=1e-12)
    assert mesh.ignored == {}


def test_middle_is_in_the_plane_without_z0(read):
    assert read(changed("PCOMP,1,-.1", "PCOMP,1,")).shells[0].offset[0] == pytest.approx(0.5)


def test_symmetric_laminate_is_written_half(read):
    (section,) = read(changed("PCOMP,1,-.1,2.5,,,,,", "PCOMP,1,,,,,,,SYM")).sections.values()
    assert [(ply.material, ply.angle) for ply in section.plies] == [(8, 45), (8, -45), (1, 0), (1, 0), (8, -45), (8, 45)]
    assert section.thickness == pytest.approx(0.8)


def test_pcompg_has_a_line_a_ply(read):
    old = DECK[DECK.index("PCOMP,1") : DECK.index("MAT8")]
    own = read(DECK.replace(old, "PCOMPG,1,-.1,2.5,,,,,\n,101,8,.1,45.,YES\n,102,,,-45.\n,103,1,.2,,YES\n")).sections
    assert own == read(DECK).sections


def test_shell_of_one_orthotropic_material_is_a_laminate_of_one_ply(read):
    old = DECK[DECK.index("PCOMP,1") : DECK.index("MAT8")]
    mesh = read(DECK.replace(old, "PSHELL,1,8,.1,8,,8,,3.\n"))
    assert mesh.sections == {1: Laminate((Ply(8, 0.1),), 3.0)}
    assert mesh.regions[1].material == 0
    assert mesh.ignored == {"MAT1 that no property refers to": 1}


def test_weight_in_a_deck_of_weights(read):
    mesh = read("PARAM,WTMASS,.5\n" + DECK)
    assert (mesh.laminae[8].density, mesh.sections[1].nonstructural) == (800.0, 1.25)
    assert mesh.density_of(1) == pytest.approx((0.2 * 800 + 0.2 * 3925) / 0.4)


def test_material_that_does_not_shear_and_damping_are_noted(read):
    mesh = read(changed("4.+9,3.+9,1600.", ",,1600.\n,,,,,,,,\n,.02"))
    assert mesh.laminae[8].g1z == mesh.laminae[8].g2z == np.inf
    assert any("MAT8 8 (GE .02)" in note for note in mesh.notes)
    assert any("without G1Z or G2Z" in note for note in mesh.notes)


@pytest.mark.parametrize(
    ("old", "new", "what", "line"),
    [
        ("2.5,,,,,\n", "2.5,,,,,MEM\n", "LAM is MEM", 6),
        ("-.1,2.5", "-.1,-2.5", "NSM is -2.5", 6),
        (",8,.1,45.", ",,.1,45.", "material of ply 1 .* is ''", 6),
        (",8,.1,45.", ",8,,45.", "thickness of ply 1 .* is ''", 6),
        (",8,.1,45.", ",8,0.,45.", "thickness of ply 1 is 0", 6),
        (",1,.2,,YES\n", ",7,.2,,YES\n", "material 7 of its plies is not in the deck", 6),
        (",8,.1,45.,YES,,,-45.,\n,1,.2,,YES\n", "", "no plies", 6),
        ("MAT1,1,2.1+11,,.3,7850.", "MAT9,1,2.1+11", "material 1 of its plies is a MAT9", 6),
        ("MAT1,1,2.1+11,,.3,7850.", "MAT1,1,2.1+11,,.3,7850.\nMAT1,8,2.1+11,,.3", "material id 8 stands twice", 9),
        ("1.4+11,1.+10", "0.,1.+10", "E1 is 0, not positive", 9),
        ("1.4+11,1.+10", "1.4+11,-1.", "E2 is -1", 9),
        (".3,5.+9", ".3,", "G12 .* is ''", 9),
        (".3,5.+9", "4.,5.+9", "NU12 is 4, its square not below E1/E2 = 14", 9),
        ("3.+9,1600.", "3.+9,-1.", "density is -1", 9),
        ("30.,.5", "30.,.5\n,,,.4,.4,.5,.4", "T3 makes it 0.5 thick", 5),
    ],
)
def test_what_is_wrong_is_named_with_file_and_line(read, old, new, what, line):
    with pytest.raises(DeckError, match=what) as caught:
        read(changed(old, new))
    assert caught.value.remedy
    assert caught.value.where.endswith(f"deck.bdf:{line}")
