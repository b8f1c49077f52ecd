"""Solids, coordinates and materials arrive as other programs read them; what is wrong is named with its line."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.decks.nastran.deck import read_nastran
from strainsight.errors import DeckError
from strainsight.fem.checks import check_materials
from strainsight.fem.mass import mass_properties
from strainsight.mesh.additions import with_material

from ...refusals import expect_refusal, refusal_table
from ...solids import SOLIDS
from ..conftest import TETRAHEDRON

OWN = [kind for kind, solid in SOLIDS.items() if solid.nastran]


def one_element(kind: str, mirror: list[int] | None = None) -> str:
    solid = SOLIDS[kind]
    points = solid.points(solid.nastran_edges) * (mirror or [1, 1, 1])
    ids = [50 - i for i in range(len(points))]
    lines = [f"GRID    {i:8d}        " + "".join(f"{x:8.4f}" for x in p) for i, p in zip(ids, points, strict=True)]
    fields = ["7", "1", *map(str, ids)]
    for i in range(0, len(fields), 8):
        lines.append((solid.nastran if i == 0 else "+").ljust(8) + "".join(f"{f:>8}" for f in fields[i : i + 8]))
    return "\n".join([*lines, "PSOLID  1       1", "MAT1    1       2.1+11          .3      7850.", "ENDDATA", ""])


def test_a_blank_property_id_is_the_element_id(read, tetrahedron):
    mesh = read(tetrahedron.replace("CTETRA,10,1,", "CTETRA,1,,"))
    assert list(mesh.blocks[0].region) == [1]


@pytest.mark.parametrize(
    ("mat1", "E", "nu", "rho", "doubt"),
    [
        ("MAT1,1,2.1+11,,.3,7850.", 2.1e11, 0.3, 7850.0, None),
        ("MAT1,1,2.6+11,1.+11", 2.6e11, 0.3, 0.0, None),
        ("MAT1,1,,1.+11,.3,1.", 2.6e11, 0.3, 1.0, None),
        ("MAT1,1,2.6+11,1.001+11,.3,1.", 2.6e11, 0.3, 1.0, None),
        ("MAT1,1,2.1+11", 2.1e11, 0.0, 0.0, "MAT1 1 defines only E: NU = 0"),
        ("MAT1,1,2.1+11,1.+11,.3", 2.1e11, 0.3, 0.0, "MAT1 1: G = 1e+11 is 1.238 times E/2(1 + NU)"),
    ],
)
def test_mat1_completes_third_elastic_constant(
    read, tetrahedron, mat1, E, nu, rho, doubt
):
    mesh = read(tetrahedron.replace("MAT1,1,2.1+11,,.3,7850.", mat1))
    material = mesh.materials[1]
    assert (material.youngs_modulus, material.poisson_ratio, material.density) == pytest.approx((E, nu, rho))
    if doubt:
        assert [own.startswith(doubt) for own in (*mesh.notes, *mesh.doubts)] == [False, True]


@pytest.mark.parametrize("kind", OWN)
def test_left_handed_solids_are_corrected(read, kind):
    """A mirrored solid weighs the same, about the mirrored centre, and its nodes stay where they are."""
    right = read("BEGIN BULK\n" + one_element(kind))
    left = read("BEGIN BULK\n" + one_element(kind, [1, 1, -1]))
    (own,), (other,) = left.blocks, right.blocks
    assert set(own.nodes[0].tolist()) == set(other.nodes[0].tolist())
    mass, centre = mass_properties(right)
    mirrored, at = mass_properties(left)
    assert mirrored == pytest.approx(mass, rel=1e-12)
    np.testing.assert_allclose(at, centre * [1, 1, -1], atol=1e-12)
    assert right.notes == ()
    (note,) = left.notes
    assert note.startswith("1 of 1 solid elements had a left-handed node order in the deck, which is corrected: C")


def test_only_left_handed_solids_are_corrected(read, tetrahedron):
    mesh = read(tetrahedron + "GRID,20,,1.,1.,1.\nCTETRA,5,1,2,4,3,20\n")
    assert mesh.blocks[0].nodes[0].tolist() == [0, 1, 2, 3]
    x = mesh.position[mesh.blocks[0].nodes]
    assert (np.linalg.det(x[:, 1:] - x[:, :1]) > 0).all()
    assert "1 of 2 solid elements had a left-handed node order in the deck, which is corrected: CTETRA 5 " in mesh.notes[-1]


@pytest.mark.parametrize("form", ["PARAM,WTMASS,.5", "  param, wtmass, .5", "PARAM WTMASS = .5"])
def test_wtmass_in_case_control_is_used(read, tetrahedron, form):
    deck = f"SOL 103\nCEND\n{form}\nBEGIN BULK\n{tetrahedron}CONM2,90,4,,3.\n"
    mesh = read(deck + "PARAM,WTMASS,.5\nENDDATA\n")
    assert (mesh.materials[1].density, mesh.point_masses[0].mass) == (3925.0, 1.5)
    assert read(deck + "ENDDATA\n").materials[1].density == 3925.0
    with expect_refusal(DeckError, r"the factor WTMASS is 0\.5 here, but 0\.2 at", where="deck.bdf:3"):
        read(deck + "PARAM,WTMASS,.2\nENDDATA\n")


test_errors_have_file_and_line = refusal_table(TETRAHEDRON.replace, [
    ("GRID,4,,0.,0.,1.", "GRID,3,,0.,0.,1.", "node id 3 is used twice .*deck.bdf:3", 4),
    ("GRID,4,,0.,0.,1.", "GRID,4,,0.,0.,one", "'one', not a number", 4),
    ("GRID,4,,0.,0.,1.", "GRDSET,,5\nGRID,4,,0.,0.,1.", "coordinate system 5 is not a CORD1 or CORD2 of the deck", 1),
    ("CTETRA,10,1,1,2,3,4", "CTETRA,10,1,1,2,3,5", "node 5 is not in the deck", 5),
    ("CTETRA,10,1,1,2,3,4", "CTETRA,10,1,1,2,3,3", "has the same node twice", 5),
    ("CTETRA,10,1,1,2,3,4", "CTETRA,10,1,1,2,3", "the element has 3 nodes, but a CTETRA needs", 5),
    ("CTETRA,10,1,1,2,3,4", "CTETRA,10,2,1,2,3,4", r"property 2 is not a PSOLID of the deck \(1 tet4 elements without PS", 5),
    ("CTETRA,10,1,1,2,3,4", "CPYRA,10,1,1,2,3,4,1", "CPYRA solids are not supported", 5),
    ("CTETRA,10,1,1,2,3,4", "CPYRAM,10,1,1,2,3,4,1,2\n,3,4,1,2,3,4,1", "the element has 13 nodes, but a CPYRAM needs", 5),
    ("CTETRA,10,1,1,2,3,4", "CTETRA,10,1,1,2,3,4\nCTETRA,10,1,2,1,3,4", "element id 10 is used twice", 6),
    ("CTETRA,10,1,1,2,3,4", "CTETRA,10,1,1,2,3,4\nCTETRA,11,1,2,3,1,4", "the same nodes as CTETRA 10", 6),
    ("CTETRA,10,1,1,2,3,4", "CBEND,10,1,1,2", "the deck contains no solid, shell or beam elements", "deck.bdf"),
    ("PSOLID,1,1", "PSOLID,1,2", "material 2 is not in the deck", 6),
    ("PSOLID,1,1", "PSOLID,1,1\nPSOLID,1,1", r"property id 1 is used twice \(first at", 7),
    ("PSOLID,1,1", "PSOLID,1,1,,,,,PFLUID", "PFLUID", 6),
    ("MAT1,1,2.1+11,,.3,7850.", "MAT1,1,-2.1+11,,.3,7850.", "Young's modulus is -2.1e\\+11", 7),
    ("MAT1,1,2.1+11,,.3,7850.", "MAT1,1,2.1+11,,.5,7850.", "Poisson's ratio is 0.5", 7),
    ("MAT1,1,2.1+11,,.3,7850.", "MAT1,1,,1.+11,,7850.", "defines only G", 7),
    ("MAT1,1,2.1+11,,.3,7850.", "MAT1,1,,,,7850.", "the card has neither E nor G nor NU", 7),
    ("MAT1,1,2.1+11,,.3,7850.", "MAT1,1,2.1+11,,.3,7850.\nPARAM,WTMASS,0.", "not positive", 8),
])


def test_nodes_elements_and_ties_have_source_lines(read, tetrahedron, tmp_path):
    text = tetrahedron + "GRID,50,,5.,5.,5.\nRBE3,98,,50,123,1.,123,1,2\n+,3\nRBE2,99,50,456,4\n"
    (tmp_path / "more.bdf").write_text("$\nGRID,60,,1.,1.,1.\nCTETRA,3,1,2,3,4,60\n")
    mesh = read(text + "INCLUDE 'more.bdf'\n")
    lines = {("node", 4): 4, ("node", 50): 9, ("element", 10): 5, ("tie", 98): 10, ("tie", 99): 12}
    for (kind, number), line in lines.items():
        assert mesh.where(kind, number) == f"{tmp_path / 'deck.bdf'}:{line}"
    assert mesh.where("node", 60) == f"{tmp_path / 'more.bdf'}:2"
    assert mesh.where("element", 3) == f"{tmp_path / 'more.bdf'}:3"


@pytest.mark.parametrize(
    ("lacking", "instead"), [("MAT1", ""), ("PSOLID", ""), ("MAT1", "MAT1,1"), ("MAT1", "MAT1,1,,,,7850.")]
)
def test_materials_may_come_from_config(tmp_path, tetrahedron, lacking, instead):
    text = "\n".join(instead if line.startswith(lacking) else line for line in tetrahedron.splitlines())
    (tmp_path / "a.bdf").write_text(text)
    mesh = read_nastran(tmp_path / "a.bdf", materials_required=False)
    assert [region.material in mesh.materials for region in mesh.regions.values()] == [False]
    check_materials(with_material(mesh, None, 2e11, 0.3, 7850.0))
    with pytest.raises(DeckError, match=r"has no material|does not exist"):
        check_materials(mesh)
    with pytest.raises(DeckError, match=r", or define the material in the config \(mesh\.materials\)"):
        read_nastran(tmp_path / "a.bdf")
