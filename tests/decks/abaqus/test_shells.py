"""Shells of Abaqus decks: sections, normals, offsets, axes and pressures by their definitions; errors with their remedy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import DeckError
from strainsight.mesh.thin import Lamina, Laminate, Ply

from ...refusals import refusal_table

FLAT = """\
*NODE
1, 0., 0., 0.
2, 2., 0., 0.
3, 2., 1., 0.
4, 0., 1., 0.
5, 4., 0., 0.
*ELEMENT, TYPE=S4, ELSET=QUAD
10, 1, 2, 3, 4
*ELEMENT, TYPE=S3, ELSET=TRI
11, 2, 5, 3
*MATERIAL, NAME=STEEL
*ELASTIC
2.1e11, .3
*DENSITY
7850.
*SHELL SECTION, ELSET=QUAD, MATERIAL=STEEL
.1
*SHELL SECTION, ELSET=TRI, MATERIAL=STEEL, OFFSET=.25
.2, 5
"""


QUAD = "ELSET=QUAD, MATERIAL=STEEL\n.1\n"
PLIES = """ELSET=QUAD, COMPOSITE
.1, 3, MAT, 30.
*ORIENTATION, NAME=O, SYSTEM=CYLINDRICAL
0., 0., 0., 0., 0., 1.
"""


def changed(old, new):
    assert old in FLAT
    return FLAT.replace(old, new)


def test_shells_are_imported_by_kind_with_sections_and_lines(read):
    mesh = read(FLAT)
    quad, triangle = mesh.shells
    assert (quad.kind, quad.ids.tolist(), quad.nodes.tolist(), quad.region.tolist()) == ("quad4", [10], [[0, 1, 2, 3]], [1])
    assert (triangle.kind, triangle.ids.tolist(), triangle.nodes.tolist()) == ("tri3", [11], [[1, 4, 2]])
    assert {i: (region.name, region.material) for i, region in mesh.regions.items()} == {1: ("QUAD", 1), 2: ("TRI", 1)}
    assert {i: section.thickness for i, section in mesh.sections.items()} == {1: 0.1, 2: 0.2}
    # OFFSET=.25 puts the nodes a quarter of .2 above the middle
    np.testing.assert_allclose([*quad.offset, *triangle.offset], [0, -0.05])
    assert np.isnan(quad.axis).all()
    assert mesh.where("element", 11).endswith("deck.inp:10")
    assert {name: ids.tolist() for name, ids in mesh.element_sets.items()} == {"QUAD": [10], "TRI": [11]}
    assert mesh.blocks == mesh.beams == mesh.notes == ()
    assert mesh.ignored == {}


def test_plies_of_composites_and_of_one_lamina(read):
    """From the lower face up, as Nastran's PCOMP has them."""
    text = FLAT[: FLAT.index("*SHELL SECTION")] + (
        "*SHELL SECTION, ELSET=QUAD, COMPOSITE, SYMMETRIC, DENSITY=2., OFFSET=.25\n"
        ".001, 3, CARBON, 0.\n.002, 3, Carbon, 30.\n.004, 3, STEEL\n"
        "*SHELL SECTION, ELSET=TRI, COMPOSITE, ORIENTATION=SKEW\n.001, , CARBON\n.002, , CARBON, -60.\n"
        "*ORIENTATION, NAME=SKEW\n1., 2., 0., -2., 1., 0.\n3, 0.\n"
        "*MATERIAL, NAME=CARBON\n*ELASTIC, TYPE=LAMINA\n1.4e11, 1.e10, .3, 5.e9, 4.e9, 3.e9\n*DENSITY\n1600.\n"
    )
    mesh = read(text)
    ((carbon, lamina),) = mesh.laminae.items()
    ((steel, _),) = mesh.materials.items()
    half = (Ply(carbon, 0.001, 0.0), Ply(carbon, 0.002, 30.0), Ply(steel, 0.004, 0.0))
    lower = Laminate((Ply(carbon, 0.001, 0.0), Ply(carbon, 0.002, -60.0)))
    assert mesh.sections == {1: Laminate((*half, *half[::-1]), 2.0), 2: lower}
    assert replace(lamina, name="") == Lamina(carbon, 1.4e11, 1e10, 0.3, 5e9, 4e9, 3e9, 1600.0)
    quad, triangle = mesh.shells
    np.testing.assert_allclose([*quad.offset, *triangle.offset], [-0.25 * 0.014, 0], atol=1e-18)
    np.testing.assert_allclose(triangle.axis, [[np.sqrt(0.2), np.sqrt(0.8), 0]])
    one = read(text.replace("COMPOSITE, ORIENTATION=SKEW\n.001, , CARBON\n.002, , CARBON, -60.", "MATERIAL=CARBON\n.003"))
    assert one.sections[2] == Laminate((Ply(carbon, 0.003),))


@pytest.mark.parametrize(
    ("given", "offset"), [("SPOS", -0.05), ("sneg", 0.05), ("-.5", 0.05), ("0.", 0.0), ("1.5", -0.15)]
)
def test_shell_offset_is_in_thicknesses(read, given, offset):
    mesh = read(changed("ELSET=QUAD, MATERIAL=STEEL", f"ELSET=QUAD, MATERIAL=STEEL, OFFSET={given}"))
    assert mesh.shells[0].offset.tolist() == pytest.approx([offset])


@pytest.mark.parametrize(
    ("lines", "axis"),
    [
        ("0., 1., 0., -1., 0., 0.\n3, 0.", (0, 1, 0)),
        ("0., 0., 1., 1., 0., 0.", (1, 0, 0)),
        ("1., 0., 0., 0., 1., 0., 0., 0., 0.\n2", (0, 0, 1)),
        ("2., 1., 0., 0., 3., 0., 1., 1., 0.\n3, 0.", (1, 0, 0)),
        ("1., 0., 0., 0., 1., 0.\n3, 30.", None),
    ],
)
def test_shell_orientation_projects_next_axis(read, lines, axis):
    text = changed("ELSET=QUAD, MATERIAL=STEEL", "ELSET=QUAD, MATERIAL=STEEL, ORIENTATION=ori")
    mesh = read(text + f"*ORIENTATION, NAME=Ori\n{lines}\n")
    np.testing.assert_allclose(mesh.shells[0].axis[0], np.full(3, np.nan) if axis is None else axis, atol=1e-15)
    assert any("orientation ORI" in note for note in mesh.notes) == (axis is None)


def test_shells_move_with_instance(read):
    body = FLAT[: FLAT.index("*MATERIAL")] + "*SHELL SECTION, ELSET=QUAD, MATERIAL=STEEL, ORIENTATION=O\n.1\n"
    body += "*SHELL SECTION, ELSET=TRI, MATERIAL=STEEL\n.2\n*ORIENTATION, NAME=O\n1., 0., 0., 0., 1., 0.\n3, 0.\n"
    material = FLAT[FLAT.index("*MATERIAL") : FLAT.index("*SHELL")]
    places = "*INSTANCE, NAME=A, PART=P\n*END INSTANCE\n"
    places += "*INSTANCE, NAME=B, PART=P\n0., 0., 5.\n0., 0., 5., 0., 1., 5., 90.\n*END INSTANCE\n"
    mesh = read(f"*PART, NAME=P\n{body}*END PART\n*ASSEMBLY, NAME=S\n{places}*END ASSEMBLY\n{material}")
    quads = mesh.shells[0]
    assert len(quads.ids) == 2
    np.testing.assert_allclose(quads.axis, [[1, 0, 0], [0, 0, -1]], atol=1e-15)
    np.testing.assert_allclose(mesh.position[quads.nodes[1]], [[0, 0, 5], [0, 0, 3], [0, 1, 3], [0, 1, 5]], atol=1e-14)
    assert [region.name for region in mesh.regions.values()] == ["A.QUAD", "A.TRI", "B.QUAD", "B.TRI"]


def test_dload_and_dsload_pressure_signs(read):
    """The quadrangle has an area of 2, the triangle one of 1, and both the normal z."""
    text = FLAT + "*SURFACE, NAME=TOP\nQUAD, SPOS\n*SURFACE, NAME=BELOW\nQUAD, SNEG\nTRI, S1\n"
    text += "*DLOAD\nQUAD, P, 3.\n*DLOAD\n11, P, -1.\n*DSLOAD\nTOP, P, 3.\n*DSLOAD\nBELOW, P, 3.\n"
    loads = read(text).loads
    total = {name: load.force.sum(axis=0).tolist() for name, load in loads.items()}
    assert total["DLOAD-1"] == pytest.approx([0, 0, 6])
    assert total["DLOAD-2"] == pytest.approx([0, 0, -1])
    assert total["DSLOAD-1"] == pytest.approx([0, 0, -6])
    assert total["DSLOAD-2"] == pytest.approx([0, 0, 9])
    np.testing.assert_allclose(loads["DLOAD-1"].force[:, 2], np.full(4, 1.5))


def test_shell_body_force_scales_with_thickness(read):
    load = read(FLAT + "*ELSET, ELSET=ALL\nQUAD, TRI\n*DLOAD\nALL, BY, 5.\n").loads["DLOAD-1"]
    np.testing.assert_allclose(load.force.sum(axis=0), [0, 2, 0], atol=1e-15)
    np.testing.assert_allclose(load.force[:, 1], [0.25, 0.25 + 1 / 3, 0.25 + 1 / 3, 0.25, 1 / 3])


def test_shell_surfaces_have_area_or_edge_weights(read):
    text = FLAT + "*SURFACE, NAME=BOTH\nQUAD\nTRI,\n*SURFACE, NAME=EDGE\nQUAD, E2\nTRI, S5\n*NODE\n99, 0., 0., 9.\n"
    text += "*COUPLING, CONSTRAINT NAME=C, REF NODE=99, SURFACE=EDGE\n*DISTRIBUTING\n1, 3\n"
    mesh = read(text)
    assert mesh.node_sets["BOTH"].tolist() == [1, 2, 3, 4, 5]
    # E2 is 2-3 and one long; S5 is the third edge of a triangle in CalculiX, 3-2 here
    assert mesh.node_sets["EDGE"].tolist() == [2, 3]
    np.testing.assert_allclose(mesh.averaging[0].weight, [1, 1])
    for surface in ("BOTH", "EDGE"):
        with pytest.raises(DeckError, match=r"no facets|on neither side"):
            read(text + f"*DSLOAD\n{surface}, P, 1.\n")


def test_shell_rotations_are_used(read):
    text = FLAT + "*NODE\n99, 4., 0., 1.\n*BOUNDARY\n1, ENCASTRE\n4, 4, 5\n2, XSYMM\n*CLOAD\n3, 5, 7.\n"
    text += "*SURFACE, TYPE=NODE, NAME=END\n5\n*COUPLING, CONSTRAINT NAME=C, REF NODE=99, SURFACE=END\n*KINEMATIC\n1, 3\n4, 6\n"
    mesh = read(text)
    assert {(0, c) for c in range(6)} | {(3, 3), (3, 4), (1, 0), (1, 4), (1, 5)} == {tuple(p) for p in mesh.fixed.tolist()}
    assert mesh.rigid[0].components == (0, 1, 2, 3, 4, 5)
    assert mesh.loads["CLOAD-1"].moment.tolist() == [[0, 7, 0]]
    assert mesh.notes == ()
    pinned = read(text.replace("*KINEMATIC\n1, 3\n4, 6", "*KINEMATIC\n1, 3"))
    assert pinned.rigid[0].components == (0, 1, 2)


def test_unsupported_shell_keywords_are_listed(read):
    mesh = read(FLAT + "*NORMAL\n1, 10, 0., 0., 1.\n*TRANSVERSE SHEAR STIFFNESS\n1., 1., 0.\n*SECTION POINTS\n1\n")
    assert set(mesh.unsupported) == {"*NORMAL", "*TRANSVERSE SHEAR STIFFNESS"}
    assert mesh.unsupported["*NORMAL"].endswith("deck.inp:20")
    normals = read(FLAT.replace("2., 1., 0.", "2., 1., 0., 0., 0., 1.").replace("4., 0., 0.", "4., 0., 0.,,,"))
    assert (set(normals.unsupported), normals.ignored) == ({"*NODE with a normal"}, {"*NODE with a normal": 1})
    quadratic = read(FLAT + "*NODE\n6,1.,0.\n7,2.,.5\n8,1.,1.\n9,0.,.5\n*ELEMENT, TYPE=S9R5\n12, 1,2,3,4,6,7,8,9,1\n")
    assert set(quadratic.unsupported) == {"*ELEMENT, TYPE=S9R5"}


test_errors_have_file_and_line = refusal_table(changed, [
    ("10, 1, 2, 3, 4", "10, 1, 3, 2, 4", "S4 10: the element (has no area|is folded)", 8),
    ("11, 2, 5, 3", "11, 2, 1, 5", "S3 11: the element has no area", 10),
    ("*SHELL SECTION, ELSET=QUAD, MATERIAL=STEEL\n.1\n", "", r"S4 10 has no section \(1 such element in total\)", 8),
    (QUAD, PLIES.replace("MAT, 30.", "STEEL, SKEW"), "ply 1 has a separate orientation 'SKEW', which is not supported", 17),
    (QUAD, PLIES.replace("MAT", "STEEL").replace(".1,", "0.,"), "thickness of ply 1 is 0, not positive", 17),
    (QUAD, PLIES.replace("MAT", "STEEL").replace("COMPOSITE", "COMPOSITE, ORIENTATION=O"), "O at .* not supported for", 16),
    ("*ELASTIC\n2.1e11, .3", "*ELASTIC, TYPE=LAMINA\n2.1e11, 1.e10, .3, 5.e9, 4.e9", "G23 .* is blank", 13),
    ("*ELASTIC\n2.1e11, .3", "*ELASTIC, TYPE=ANISO\n2.1e11, .3", "TYPE=ANISO is not supported: beams", 12),
    ("ELSET=QUAD, MATERIAL=STEEL", "ELSET=QUAD, MATERIAL=STEEL, NODAL THICKNESS", "variable thickness is not supported", 16),
    ("*SHELL SECTION, ELSET=QUAD", "*SHELL GENERAL SECTION, ELSET=QUAD", "this keyword is not supported", 16),
    ("*SHELL SECTION, ELSET=QUAD", "*SOLID SECTION, ELSET=QUAD", "contains S4 10, to which this section does not", 16),
    (".2, 5\n", ".2\n*SURFACE, NAME=S\nQUAD, S7\n", "'S7' is not a side or edge of S4 10", 21),
])
