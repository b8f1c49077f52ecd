"""PSHELL of several or anisotropic materials: against one MAT1, lamination theory by slices, beams in closed form, and errors."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import DeckError, UserError
from strainsight.fem.affine import Parameter
from strainsight.fem.assembly import assemble
from strainsight.fem.checks import check_mesh
from strainsight.fem.mass import mass_properties
from strainsight.fem.recovery import facet_strain, surface_model, surface_state
from strainsight.fem.shells_and_beams import thin_operators
from strainsight.mesh.additions import with_material, with_properties
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.thin_faces import with_faces
from strainsight.mesh.units import scaled, to_si
from strainsight.records.mesh import MeshColumns

from ...fem.laminate_models import CARBON, by_slices, tensor_stiffness
from ...refusals import expect_refusal, refusal_table

E, NU, T = 2.1e11, 0.3, 0.1
G = E / (2 + 2 * NU)
Q = E / (1 - NU**2) * np.array([[1, NU, 0], [NU, 1, 0], [0, 0, (1 - NU) / 2]])
SKEW = """\
GRID,1,,0.,0.,0.
GRID,2,,2.,.2,0.
GRID,3,,2.1,1.1,.3
GRID,4,,-.1,1.,.1
GRID,5,,4.,.3,.2
CQUAD4,10,1,1,2,3,4,25.,.05
CTRIA3,11,1,2,5,3,-40.
"""
PLY = "MAT8,8,1.4+11,1.+10,.3,5.+9,4.5+9,3.+9,1600.\n"


def mat2(number, matrix, density=""):
    values = [f"{v:.16e}" for v in np.asarray(matrix)[np.triu_indices(len(matrix))]]
    if len(values) == 3:  # of shear across: G11, G12, G22 stand in fields 1, 2, 4
        values = [values[0], values[1], "", values[2], "", ""]
    return ",".join(["MAT2", str(number), *values, str(density)]) + "\n"


def operators(mesh):
    check_mesh(mesh)
    return [own.constant.toarray() for own in thin_operators(mesh)]


def near(found, expected, rtol=1e-12):
    for a, b in zip(found, expected, strict=True):
        assert np.abs(a - b).max() < rtol * np.abs(b).max()


@pytest.mark.parametrize(
    ("plain", "own"),
    [
        ("1,1,.1,1,,1,,3.", "1,2,.1,2,,3,,3."),
        ("1,1,.1,1,2.5,1,.7", "1,2,.1,2,2.5,3,.7"),
        ("1,1,.1,1", "1,2,.1,2"),
        ("1,1,.1,,,,,3.", "1,2,.1,,,,,3."),
    ],
)
def test_mat2_written_from_a_mat1_is_the_same(read, plain, own):
    materials = f"MAT1,1,{E:.3e},,{NU},7850.\n" + mat2(2, Q, 7850.0) + mat2(3, G * np.eye(2))
    a, b = (read(SKEW + f"PSHELL,{text}\n" + materials) for text in (plain, own))
    near(operators(b), operators(a))
    assert mass_properties(b)[0] == pytest.approx(mass_properties(a)[0], rel=1e-12)
    states = []
    # flat: on warped shells the face of a laminate, and of these, has the plane of the element and not of the facet
    level = SKEW.replace(",.3\n", ",0.\n").replace(",.1\n", ",0.\n").replace(",.2\n", ",0.\n")
    for mesh in (with_faces(read(level + f"PSHELL,{text}\n" + materials)) for text in (plain, own)):
        z = np.random.default_rng(0).normal(size=(3 * len(mesh.position), 1))
        rows = facet_strain(mesh, exterior_facets(mesh))
        states.append(surface_state(surface_model(mesh, rows, z), {}, np.ones(1)))
    near([states[1].strain, states[1].stress], [states[0].strain, states[0].stress], 1e-11)
    assert b.ignored == {"MAT1 that no property refers to": 1} | ({} if ",3," in own else {"MAT2 that no property refers to": 1})


def test_pshell_uses_separate_mat1_for_membrane_bending_shear(read):
    """In membrane, bending and shear as a MAT1 of all three with that modulus has it alone; the mass is of MID1."""
    mat1 = "MAT1,1,2.0+11,,.3,7850.\nMAT1,2,7.0+10,,.2,2700.\nMAT1,3,1.0+9,,.4,50.\n"
    section = read(SKEW + "PSHELL,1,1,.1,2,1.5,3,.9,2.\n" + mat1).sections[1]
    for matrix, modulus, nu in ((section.membrane, 2e11, 0.3), (section.bending / 1.5, 7e10, 0.2)):
        expected = modulus / (1 - nu**2) * np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]])
        np.testing.assert_allclose(matrix, expected, rtol=1e-12, atol=1.0)
    np.testing.assert_allclose(section.shear, 0.9 * 1e9 / 2.8 * np.eye(2), rtol=1e-12)
    assert (section.density, section.thickness, section.nonstructural, section.uniform) == (7850.0, 0.1, 2.0, False)


def test_pshell_equivalent_of_laminate_matches_pcomp(read):
    """A/t, 12 D/t³, −B/t² and S/t of [0/30] by sums over slices, as MID1, MID2, MID4 and MID3: stiffness and mass of PCOMP."""
    plies = "PCOMP,1,,,,,,,\n,8,.02,0.,YES,8,.03,30.,YES\n"
    whole = read(SKEW + plies + PLY)
    t = 0.05
    A, B, D, S = by_slices(whole.sections[1], whole)
    matrices = mat2(1, A / t, 1600.0) + mat2(2, 12 * D / t**3) + mat2(3, S / t) + mat2(4, -B / t**2)
    own = read(SKEW + "PSHELL,1,1,.05,2,1.,3,1.\n,,,4\n" + matrices)
    assert np.abs(B).max() > 0.01 * t * np.abs(A).max()
    near(operators(own), operators(whole), 1e-8)  # of 4000 slices


def test_shell_face_stress_matches_rotated_tensor(read):
    matrix, _ = tensor_stiffness(CARBON, 0.4)
    square = "GRID,1,,0.,0.,0.\nGRID,2,,2.,0.,0.\nGRID,3,,2.,1.,0.\nGRID,4,,0.,1.,0.\nCQUAD4,10,1,1,2,3,4,40.\n"
    mesh = with_faces(read(square + "PSHELL,1,2,.1,2,2.,3\n" + mat2(2, matrix) + mat2(3, 1e9 * np.eye(2))))
    gradient = np.array([[1e-3, 2e-4], [5e-4, -3e-4]])
    z = np.zeros((len(mesh.position), 3))
    z[:, :2] = mesh.position[:, :2] @ gradient.T
    facets = exterior_facets(mesh)
    state = surface_state(surface_model(mesh, facet_strain(mesh, facets), z.reshape(-1, 1)), {}, np.ones(1))
    along, _ = tensor_stiffness(CARBON, 0.4 + np.radians(40))
    strain = np.array([gradient[0, 0], gradient[1, 1], gradient[0, 1] + gradient[1, 0]])
    expected = np.zeros(6)
    expected[[0, 1, 3]] = along @ strain
    wide = np.abs(facets.nodes[:, :4]).min(axis=1) >= 0
    np.testing.assert_allclose(state.stress[wide], np.tile(expected, (wide.sum(), 1)), atol=1e-9 * np.abs(expected).max())


def test_shell_of_several_materials_has_no_face_stress(read):
    mesh = with_faces(read(SKEW + "PSHELL,1,1,.1,2,,1\nMAT1,1,2.+11,,.3,1.\nMAT1,2,1.+11,,.3\n"))
    rows = facet_strain(mesh, exterior_facets(mesh))
    assert np.isfinite(rows.matrix.data).all()
    with expect_refusal(DeckError, r"region 1 \(PSHELL 1\) has different materials for membrane", remedy="MID1 = MID2"):
        surface_model(mesh, rows, np.ones((3 * len(mesh.position), 1)))


def test_general_shell_accepts_factor_but_no_modulus_parameter(read):
    mesh = read(SKEW + "PSHELL,1,1,.1,2,,1\nMAT1,1,2.+11,,.3,1000.\nMAT1,2,1.+11,,.3\n")
    K, M = thin_operators(mesh, [Parameter("s", "stiffness_factor", (1,), 1.0), Parameter("r", "density", (1,), 1000.0)])
    other = operators(with_properties(mesh, [1], stiffness_factor=1.3, density=800.0))
    near([own.toarray() for own in (K.at({"s": 1.3}), M.at({"r": 800.0}))], other)
    with expect_refusal(UserError, "a shell of several or anisotropic materials", remedy="stiffness_factor"):
        assemble(mesh, [Parameter("E", "youngs_modulus", (1,), 2e11)])
    with pytest.raises(UserError, match="separate materials"):
        with_material(mesh, None, 2e11, 0.3, 7850.0)


def test_general_shell_survives_units_and_records(read):
    text = SKEW + "PSHELL,1,1,.1,2,,\nMAT1,1,2.+11,,.3,1000.\nMAT1,2,1.+11,,.3\n"
    mesh = read(text)
    operators_of = operators(mesh)
    near(operators(MeshColumns.of(mesh).restore()), operators_of, 1e-15)
    inches = to_si(mesh, "in", "g")
    scale = np.tile(np.repeat([1.0, 0.0254], 3), len(mesh.thin_nodes))
    near(operators(inches), [1e-3 * scale[:, None] * X * scale for X in operators_of], 1e-9)
    size = np.tile(np.repeat([1.0, 2.0], 3), len(mesh.thin_nodes))
    near(operators(scaled(mesh, 2.0)), [f * size[:, None] * X * size for f, X in zip((2, 8), operators_of, strict=True)], 1e-9)
    assert read("PARAM,WTMASS,.5\n" + text).density_of(1) == 500.0


test_errors_have_remedy = refusal_table(lambda cards: SKEW + cards, [
    ("PSHELL,1,1,.1,,,2\n" + mat2(1, Q) + mat2(2, np.eye(2)), "MID3 requires MID2"),
    ("PSHELL,1,1,.1,1,,2\n,,,3\n" + mat2(1, Q) + mat2(2, np.eye(2)) + mat2(3, Q), "and bending stiffness: .* is not positive"),
    (
        "PSHELL,1,1,.1\n" + mat2(1, np.diag([1.0, 1, 0])),
        "membrane stiffness: the stiffness matrix is not positive definite: diagonal entry 3",
    ),
    ("PSHELL,1,1,.1,1,,2\n" + mat2(1, Q) + mat2(2, [[1.0, 2.0], [2.0, 1.0]]), "transverse shear stiffness: .* eigenvalue is -1"),
], placed=False)
