"""Shells and beams of the second order in decks: where their entries stand, the same model in all formats, what is refused."""

from __future__ import annotations

import meshio
import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.errors import DeckError
from strainsight.fem.checks import check_mesh
from strainsight.fem.model import build_model
from strainsight.mesh.assigned_sections import GivenSection
from strainsight.mesh.thin import BeamSection, Laminate, ShellSection

from ..refusals import expect_refusal

XY = [(0, 0), (2, 0), (2, 1), (0, 1), (1, 0), (2.1, 0.5), (1, 1.1), (0, 0.5), (3, 0), (2.6, 0.45), (2.5, 0)]
"""A quadrangle 1 to 8 and beside it a triangle 2, 9, 3 with 11, 10, 6 on its sides; two sides are curved."""
QUAD, TRI = (1, 2, 3, 4, 5, 6, 7, 8), (2, 9, 3, 11, 10, 6)
T, E, NU, RHO = 0.05, 2.1e11, 0.3, 7850.0

GRIDS = "".join(f"GRID,{i},,{x},{y},0.\n" for i, (x, y) in enumerate(XY, 1))
NASTRAN = f"""{GRIDS}CQUAD8,1,7,1,2,3,4,5,6
,7,8
CTRIA6,2,7,2,9,3,11,10,6
PSHELL,7,1,{T},1,,1
MAT1,1,2.1+11,,{NU},{RHO}
SPC1,1,123456,1,4,8
PLOAD2,3,2.,1,2
"""
ABAQUS = (
    "*NODE\n"
    + "".join(f"{i},{x},{y},0.\n" for i, (x, y) in enumerate(XY, 1))
    + f"""*ELEMENT, TYPE=S8R, ELSET=ALL
1, {", ".join(map(str, QUAD))}
*ELEMENT, TYPE=STRI65, ELSET=ALL
2, {", ".join(map(str, TRI))}
*SHELL SECTION, ELSET=ALL, MATERIAL=M
{T}
*MATERIAL, NAME=M
*ELASTIC
2.1E11, {NU}
*DENSITY
{RHO}
*BOUNDARY
1, 1, 6
4, 1, 6
8, 1, 6
*STEP
*STATIC
*DLOAD
ALL, P, 2.
*END STEP
"""
)
GMSH = (
    f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{len(XY)}\n"
    + "".join(f"{i} {x} {y} 0\n" for i, (x, y) in enumerate(XY, 1))
    + "$EndNodes\n$Elements\n2\n"
    + f"1 16 2 7 1 {' '.join(map(str, QUAD))}\n2 9 2 7 1 {' '.join(map(str, TRI))}\n$EndElements\n"
)


def made(path, text, **more):
    path.write_text(text)
    return read_mesh(path, **more)


def checked(mesh):
    with mesh.located():
        check_mesh(mesh)


def stiffness(mesh):
    return build_model(mesh, supported=False).stiffness.constant.toarray()


def test_all_formats_agree(tmp_path):
    """Connectivity, and the eigenvalues of K; the pressure of Nastran is along the normal, that of Abaqus too."""
    nastran, abaqus = made(tmp_path / "a.bdf", NASTRAN), made(tmp_path / "a.inp", ABAQUS)
    given = {"mesh.sections.skin": GivenSection(None, ShellSection(T))}
    gmsh = made(tmp_path / "a.msh", GMSH, sections=given)
    cells = [("quad8", [np.array(QUAD) - 1]), ("triangle6", [np.array(TRI) - 1])]
    meshio.Mesh(np.column_stack([XY, np.zeros(len(XY))]), cells).write(tmp_path / "a.vtu")
    vtu = read_mesh(tmp_path / "a.vtu", sections=given)
    for mesh in (nastran, abaqus, gmsh, vtu):
        assert [block.kind for block in mesh.shells] == ["quad8", "tri6"]
        np.testing.assert_array_equal(mesh.shells[0].nodes, [np.array(QUAD) - 1])
        np.testing.assert_array_equal(mesh.shells[1].nodes, [np.array(TRI) - 1])
    K = stiffness(nastran)
    np.testing.assert_allclose(stiffness(abaqus), K, atol=1e-9 * np.abs(K).max())
    force = [mesh.loads[name].force for mesh, name in ((nastran, "LOAD-3"), (abaqus, "DLOAD-1"))]
    np.testing.assert_allclose(force[1].sum(axis=0), force[0].sum(axis=0), rtol=1e-12, atol=1e-12)
    # on the quadrangle 2, on the triangle 1/2, and two thirds of length times bow of the sides outside
    assert force[0].sum(axis=0)[2] == pytest.approx(2 * (2.5 + 2 / 3 * (0.2 + 0.05)), rel=1e-12)


def test_quadratic_shell_fields_follow_nodes(tmp_path):
    text = NASTRAN.replace(",7,8\n", f",7,8,{T},{T},{T},{T},30.,.01\n").replace("11,10,6\n", "11,10,6\n,45.,-.02\n")
    quad, tri = made(tmp_path / "a.bdf", text).shells
    assert (quad.offset, tri.offset) == ([0.01], [-0.02])
    np.testing.assert_allclose(quad.axis, [[np.cos(np.pi / 6), 0.5, 0]])
    np.testing.assert_allclose(tri.axis, [[np.sqrt(0.5), np.sqrt(0.5), 0]])
    plies = NASTRAN.replace(f"PSHELL,7,1,{T},1,,1\n", "PCOMP,7\n,1,.02,0.,,1,.03,90.\n")
    assert isinstance(made(tmp_path / "b.bdf", plies).sections[7], Laminate)


@pytest.mark.parametrize(
    ("old", "new", "what", "line"),
    [
        (",7,8\n", ",7\n", r"the element has 3 of 4 mid-side nodes \(G8 is blank\)", 12),
        ("11,10,6\n", "11,,6\n", r"the element has 2 of 3 mid-side nodes \(G5 is blank\)", 14),
        ("GRID,5,,1,0,0.", "GRID,5,,1.6,0,0.", "node 5 of quad8 element 1 lies at 0.8 of the side", 12),
        ("GRID,7,,1,1.1,0.", "GRID,7,,1,1.9,0.", "node 7 of quad8 element 1 is 0.45 side lengths away from the straight", 12),
    ],
)
def test_errors_have_file_line_and_remedy(tmp_path, old, new, what, line):
    assert old in NASTRAN
    with expect_refusal(DeckError, what, where=f"a.bdf:{line}", remedy=""):
        checked(made(tmp_path / "a.bdf", NASTRAN.replace(old, new)))


def test_pressure_on_lower_face_is_reversed(tmp_path):
    def load(side):
        surface = f"*SURFACE, NAME=S\nALL, {side}\n*STEP"
        return made(tmp_path / "a.inp", ABAQUS.replace("*STEP", surface).replace("*DLOAD\nALL, P,", "*DSLOAD\nS, P,")).loads

    above, below = (next(iter(load(side).values())) for side in ("SPOS", "SNEG"))
    order = np.argsort(above.nodes), np.argsort(below.nodes)
    np.testing.assert_allclose(above.force[order[0]], -below.force[order[1]], atol=1e-12)


def test_lines_of_three_nodes_become_beams(tmp_path):
    text = GMSH.replace("Elements\n2\n", "Elements\n3\n").replace("$EndElements", "3 8 2 8 2 1 2 5\n$EndElements")
    section = BeamSection(1e-4, np.diag([1e-9, 2e-9]), torsion=3e-9)
    given = {"mesh.sections.bar": GivenSection(None, section, direction=(0.0, 1.0, 0.0))}
    beams = made(tmp_path / "a.msh", text, sections=given).beams
    assert [(own.kind, own.nodes.tolist()) for own in beams] == [("beam3", [[0, 1, 4]])]
    np.testing.assert_allclose(beams[0].axes[0], np.eye(3))
    with pytest.raises(DeckError, match="element 3 is a line of three nodes, which requires bending stiffness"):
        made(tmp_path / "a.msh", text, sections={"mesh.sections.bar": GivenSection(None, BeamSection(1e-4))})


def test_abaqus_b32_middle_node_order(tmp_path):
    """n1 by the fourth node, and its centroid off the nodes, against OFFSET2, along the axes of each place."""
    text = """*NODE
1, 1., 0., 0.
2, .7071067811865476, .7071067811865476, 0.
3, 0., 1., 0.
4, 1., 0., 5.
*ELEMENT, TYPE=B32R, ELSET=BAR
11, 1, 2, 3, 4
*BEAM SECTION, ELSET=BAR, SECTION=RECT, MATERIAL=M, OFFSET2=1.
.02, .03
*MATERIAL, NAME=M
*ELASTIC
2.1E11, .3
"""
    beams = made(tmp_path / "a.inp", text).beams
    assert beams[0].nodes.tolist() == [[0, 2, 1]]
    np.testing.assert_allclose(beams[0].axes[0][:, 1], [0, 0, 1], atol=1e-12)
    tangent = np.array([[0, 1, 0], [-1, 0, 0], [-np.sqrt(0.5), np.sqrt(0.5), 0]])
    # the parabola through three nodes of the quarter of a circle leaves these tangents by up to 11°
    off = beams[0].offset[0]
    np.testing.assert_allclose(np.linalg.norm(off, axis=1), 0.03, rtol=1e-12)
    np.testing.assert_allclose(off[2], -0.03 * np.cross(tangent[2], [0, 0, 1]), atol=1e-12)
    assert (np.einsum("ni,ni->n", off, np.cross(tangent, [0, 0, 1])) < -0.98 * 0.03).all()
