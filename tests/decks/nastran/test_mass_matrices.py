"""CONM1 and CMASS: the matrix of a rigid body is that body, whatever asks for it; one along one axis moves with that alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import DeckError
from strainsight.fem.mass import mass_properties
from strainsight.fem.model import build_model
from strainsight.fem.nodal_forces import body_forces
from strainsight.mesh.joins import BodyForce
from strainsight.mesh.units import scaled, to_si
from strainsight.rom.inertia import inertia_invariants

from ...refusals import refusal_table
from ..conftest import TETRAHEDRON

TURNED = "CORD2R,7,,1.,2.,3.,2.,2.,3.\n+,1.,3.,3.\n"  # its z is x, its x is y, so its y is z
RIGID = "GRID,50,,1.,4.,5.\nRBE2,99,50,123456,1,2,3,4\n"
SPINNING = BodyForce(np.array([1.0, -2.0, 3.0]), np.array([0.3, 0.8, -0.5]), np.array([0.2, 0.1, -0.4]))


def particles():
    rng = np.random.default_rng(4)
    return rng.normal(size=(6, 3)), rng.uniform(0.5, 2, 6)


def card_of(M, number=90, node=50, cid=""):
    words = ["CONM1", str(number), str(node), cid, *(f"{M[i, j]:.14e}" for i in range(6) for j in range(i + 1))]
    lines = [words[:9], *(words[at : at + 8] for at in range(9, len(words), 8))]
    return "\n".join([",".join(lines[0]), *("," + ",".join(line) for line in lines[1:])]) + "\n"


def matrix_of(axes):
    """Σ dm DᵀD of D = [I, −r×] along axes (3, 3), one in a column."""
    M = np.zeros((6, 6))
    for r, dm in zip(particles()[0] @ axes, particles()[1], strict=True):
        D = np.hstack([np.eye(3), np.column_stack([np.cross(axis, r) for axis in np.eye(3)])])
        M += dm * D.T @ D
    return M


def body_of(tetrahedron):
    r, dm = particles()
    m = dm.sum()
    d = dm @ r / m
    J = sum(w * (q @ q * np.eye(3) - np.outer(q, q)) for w, q in zip(dm, r - d, strict=True))
    fields = ",".join(f"{v:.14e}" for v in (J[0, 0], -J[1, 0], J[1, 1], -J[2, 0], -J[2, 1], J[2, 2]))
    free = tetrahedron.replace("SPC1,1,123,1,2,3\n", "")
    return free + RIGID + f"CONM2,90,50,,{m:.14e},{d[0]:.14e},{d[1]:.14e},{d[2]:.14e}\n,{fields}\n"


def answers(mesh):
    model = build_model(mesh, supported=False)
    weight, centre = mass_properties(mesh)
    pulled = body_forces(mesh, SPINNING)
    return model.mass.constant.toarray(), weight, centre, pulled.nodes, pulled.force, pulled.moment


@pytest.mark.parametrize(("cid", "axes"), [("", np.eye(3)), ("7", np.eye(3)[:, [1, 2, 0]])])
def test_conm1_matrix_matches_rigid_body(read, tetrahedron, cid, axes):
    expected = read(body_of(tetrahedron))
    text = TURNED + body_of(tetrahedron).split("CONM2")[0] + card_of(matrix_of(axes), cid=cid)
    found = read(text)
    (point,) = found.point_masses
    assert (point.id, point.node) == (90, 4)
    assert point.turns
    for change in (lambda mesh: mesh, lambda mesh: scaled(mesh, 0.3), lambda mesh: to_si(mesh, "mm", "t")):
        for own, other in zip(answers(change(found)), answers(change(expected)), strict=True):
            np.testing.assert_allclose(own, other, rtol=1e-11, atol=1e-11 * np.abs(other).max())


def test_wtmass_scales_mass_matrix(read, tetrahedron):
    text = body_of(tetrahedron).split("CONM2")[0] + card_of(matrix_of(np.eye(3)))
    (own,), (half,) = read(text).point_masses, read(text + "PARAM,WTMASS,.5\n").point_masses
    np.testing.assert_allclose(half.matrix, own.matrix / 2, rtol=1e-14)
    assert half.mass == pytest.approx(own.mass / 2)


@pytest.mark.parametrize(
    "card", ["CMASS2,91,2.5,4,2", "CMASS2,91,2.5,,,4,2", "CMASS1,91,8,4,2,0,0\nPMASS,7,9.,8,2.5", "CMASS1,91,,4,2\nPMASS,91,2.5"]
)
@pytest.mark.parametrize("cd", ["", ",7"])
def test_cmass_acts_on_one_component(read, tetrahedron, card, cd):
    text = TURNED + tetrahedron.replace("GRID,4,,0.,0.,1.", f"GRID,4,,0.,0.,1.{cd}")
    mesh = read(f"{text}{card}\n")
    along = np.array([0.0, 0, 1]) if cd else np.array([0.0, 1, 0])
    plain = replace(mesh, point_masses=())
    added = build_model(mesh).mass.constant.toarray() - build_model(plain).mass.constant.toarray()
    z = build_model(mesh).constraint.transform[9:12].toarray()
    np.testing.assert_allclose(added, 2.5 * np.outer(along @ z, along @ z), atol=1e-10)
    assert mass_properties(mesh)[0] - mass_properties(plain)[0] == pytest.approx(2.5 / 3)


def test_cmass_on_rotation_is_moment_of_inertia(read, tetrahedron):
    mesh = read(f"{tetrahedron}{RIGID.replace('1,2,3,4', '4')}CMASS2,91,2.5,50,6\n")
    model = build_model(mesh, supported=False)
    row = model.constraint.reference_rows[4] + 2
    z = model.constraint.transform[[row]].toarray()[0]
    plain = build_model(replace(mesh, point_masses=()), supported=False)
    np.testing.assert_allclose((model.mass.constant - plain.mass.constant).toarray(), 2.5 * np.outer(z, z), atol=1e-12)


test_masses_that_cannot_be_taken_are_named = refusal_table(lambda card: f"{TETRAHEDRON}{card}\n", [
    ("CMASS2,91,2.5,4,2,3,1", "the mass acts on 2 components, but only a mass on exactly one component"),
    ("CMASS2,91,2.5,4,7", "component 7"),
    ("CMASS2,91,-2.5,4,1", "the mass matrix is not positive semidefinite"),
    ("CMASS1,91,5,4,1", "property 5 is not a PMASS of the deck"),
    ("CONM1,91,4,,1.,2.,1.", "the mass matrix is not positive semidefinite"),
], placed=False)


def test_a_mass_matrix_in_a_body_that_moves_freely_is_refused(read, tetrahedron):
    model = build_model(read(f"{tetrahedron}CMASS2,91,2.5,4,2\n"))
    with pytest.raises(DeckError, match="point mass 91 on node 4 has different masses along its axes"):
        inertia_invariants(model, np.eye(model.size))


