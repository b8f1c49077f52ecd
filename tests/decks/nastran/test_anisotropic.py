"""MAT9 and MAT11 along CORDM, against tensors with four indices; errors with their remedy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import DeckError
from strainsight.fem.assembly import assemble_stiffness
from strainsight.fem.checks import check_mesh
from strainsight.fem.mass import mass_properties

from ...anisotropy import CONSTANTS, TURN, flexibility, strains, tensor, triclinic, turned, work, works_of

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
    """The brick with axes of `TURN` at `ORIGIN`."""
    points = [ORIGIN, ORIGIN + TURN[:, 2], ORIGIN + TURN[:, 0]]
    lines = [card("GRID", i, "", *x) for i, x in enumerate(BRICK, start=1)]
    lines += ["CHEXA,10,1,1,2,3,4,5,6", ",7,8", card("PSOLID", 1, 3, cordm), card(system, 5, 0, *np.ravel(points))]
    return "\n".join(["BEGIN BULK", *lines, material, "ENDDATA", ""])


def mat9(C, density=1600.0):
    return card("MAT9", 3, *C[np.triu_indices(6)], density)


MAT11 = card("MAT11", 3, *CONSTANTS[0], *CONSTANTS[1], *CONSTANTS[2], 1600.0)


@pytest.mark.parametrize(("cordm", "axes"), [("", np.eye(3)), ("0", np.eye(3)), ("5", TURN)])
def test_mat9_has_the_work_of_its_tensor(read, cordm, axes):
    mesh = read(deck(mat9(triclinic()), cordm))
    check_mesh(mesh)
    C, volume = turned(tensor(triclinic(), NASTRAN), axes), np.linalg.det(BRICK[[1, 3, 4]] - BRICK[0])
    found = works_of(assemble_stiffness(mesh), mesh.position)
    np.testing.assert_allclose(found, [volume * work(C, own) for own in strains()], rtol=1e-8)
    assert mass_properties(mesh)[0] == pytest.approx(1600.0 * volume)
    assert mesh.ignored == ({} if cordm == "5" else {"CORD2R that no card refers to": 1})
    assert mesh.notes == ()


def test_mat11_is_the_inverse_of_its_flexibility(read):
    """Stress that makes ε = S σ: the work of a strain by C is that of its stress by S."""
    mesh = read(deck(MAT11, "5"))
    S = turned(flexibility(*CONSTANTS), TURN)
    volume = np.linalg.det(BRICK[[1, 3, 4]] - BRICK[0])
    K = assemble_stiffness(mesh)
    for stress in 1e9 * np.array(strains()):
        z = (mesh.position @ np.einsum("ijkl,kl->ij", S, stress)).ravel()
        assert 0.5 * z @ (K @ z) == pytest.approx(volume * work(S, stress), rel=1e-8)


@pytest.mark.parametrize("system", ["CORD2C", "CORD2S"])
def test_axes_of_a_curved_system_are_those_at_each_point(read, system):
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


def test_mat1_written_as_mat9_is_the_same(read):
    E, nu = 2.1e11, 0.3
    lam, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    C = np.diag([2 * mu] * 3 + [mu] * 3)
    C[:3, :3] += lam
    fields = [f"{v:.16e}" for v in C[np.triu_indices(6)]]
    K, other = (
        assemble_stiffness(read(deck(text, cordm)))
        for text, cordm in (
            (card("MAT1", 3, f"{E:.16e}", "", str(nu), "7850."), "5"),
            (card("MAT9", 3, *fields, "7850."), "5"),
        )
    )
    assert abs(K - other).max() < 1e-12 * abs(K).max()


@pytest.mark.parametrize(
    ("material", "cordm", "what", "remedy"),
    [
        (mat9(np.diag([1.0, 1, 1, 1, 0, 1])), "", "the 5th of the diagonal of its stiffness is 0", "positive values"),
        (mat9(np.eye(6) + 1.5 * np.eye(6)[[1, 0, 2, 3, 4, 5]]), "", "least eigenvalue is -0.5", "off the diagonal"),
        (mat9(triclinic(), -1.0), "", "the density is -1, negative", "positive density"),
        (mat9(triclinic()), "-1", "CORDM is -1", "CORD2C"),
        (mat9(triclinic()), "6", "coordinate system 6", "add the card"),
        (MAT11.replace("3.0000000000e-01", "4."), "", "least eigenvalue is -", "E_i/E_j"),
        (MAT11.replace("1.4000000000e+11", "-1."), "", "E1 is -1, not positive", "positive modulus"),
        (MAT11 + "\nMAT1,3,2.1+11,,.3", "", "a MAT1 has it too", "its own id"),
        (MAT11 + "\n" + mat9(triclinic()), "", "material id 3 stands twice", "id"),
    ],
)
def test_what_is_wrong_is_named_with_its_remedy(read, material, cordm, what, remedy):
    with pytest.raises(DeckError, match=what) as error:
        read(deck(material, cordm))
    assert remedy in error.value.remedy


def test_what_no_solid_refers_to_and_damping_is_listed(read):
    lossy = MAT11.replace("MAT11,3", "MAT11,4")
    mesh = read(deck(card("MAT9", 3, *triclinic()[np.triu_indices(6)], 1600.0, *[""] * 7, 0.02) + "\n" + lossy))
    assert mesh.ignored == {"CORD2R that no card refers to": 1, "MAT11 that no solid refers to": 1}
    assert "structural damping GE is not imported" in mesh.notes[0]
