"""Anisotropic solids against tensors with four indices, lamination theory, Lekhnitskii's cylinder and invariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array

from strainsight.errors import DeckError, UserError
from strainsight.fem.affine import Parameter
from strainsight.fem.assembly import assemble, assemble_stiffness
from strainsight.fem.checks import check_mesh
from strainsight.fem.factorisation import factorise
from strainsight.fem.mass import mass_properties
from strainsight.fem.nodal_forces import pressure
from strainsight.fem.recovery import facet_strain, surface_model, surface_state
from strainsight.mesh.additions import with_face, with_properties
from strainsight.mesh.anisotropic import Anisotropic, Orientation, orthotropic, stiffness_fault
from strainsight.mesh.coordinates import BASIC, CoordinateSystem
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.kinds import ELEMENTS
from strainsight.mesh.units import rescaled, scaled, to_si
from strainsight.records.mesh import MeshColumns

from ..anisotropy import CONSTANTS, TURN, flexibility, strains, tensor, triclinic, turned, work, works_of

KINDS = [kind.name for kind in ELEMENTS]


def anisotropic(mesh, C, axes=TURN, density=1600.0):
    """All of it of C along axes."""
    orientation = Orientation(replace(BASIC, axes=np.asarray(axes)), np.eye(3))
    return replace(
        mesh,
        materials={},
        anisotropic={number: Anisotropic(number, C, density) for number in mesh.regions},
        orientations=dict.fromkeys(mesh.regions, orientation),
    )


def isotropic(E, nu):
    lam, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    C = np.diag([2 * mu] * 3 + [mu] * 3)
    C[:3, :3] += lam
    return C


@pytest.mark.parametrize("kind", KINDS)
def test_every_strain_of_a_distorted_body_has_the_work_of_the_turned_tensor(box, kind):
    """The axes lie anyhow; a linear field has no internal forces at inner nodes."""
    mesh = anisotropic(box(kind, (3, 3, 3), distort=0.3), triclinic())
    C, K = turned(tensor(triclinic()), TURN), assemble_stiffness(mesh)
    np.testing.assert_allclose(works_of(K, mesh.position), [work(C, own) for own in strains()], rtol=1e-12)
    force = K @ (mesh.position @ np.random.default_rng(3).normal(size=(3, 3)).T).ravel()
    inner = np.repeat(np.all((mesh.position > 1e-9) & (mesh.position < 1 - 1e-9), axis=1), 3)
    assert np.abs(force[inner]).max() < 1e-12 * np.abs(force).max()


@pytest.mark.parametrize("kind", KINDS)
def test_an_isotropic_material_by_its_matrix_is_the_same(box, kind):
    mesh = box(kind, (2, 2, 2), distort=0.3, material=(2.1e11, 0.3, 1600.0))
    (block,) = mesh.blocks
    other = replace(
        mesh,
        blocks=(replace(block, region=1 + block.ids % 2),),
        regions={1: mesh.regions[1], 2: replace(mesh.regions[1], id=2, material=9)},
        anisotropic={9: Anisotropic(9, isotropic(2.1e11, 0.3), 1600.0)},
        orientations={2: Orientation(replace(BASIC, axes=TURN), np.eye(3))},
    )
    K, same = (assemble_stiffness(own).toarray() for own in (mesh, other))
    assert np.abs(same - K).max() < 1e-12 * np.abs(K).max()
    facets = exterior_facets(mesh)
    z = np.random.default_rng(0).normal(size=(3 * len(mesh.position), 1))
    states = [surface_state(surface_model(own, facet_strain(own, facets), z), {}, np.ones(1)) for own in (mesh, other)]
    for name in ("strain", "stress", "von_mises", "principal"):
        a, b = (getattr(own, name) for own in states)
        assert np.abs(a - b).max() < 1e-11 * np.abs(a).max()


@pytest.mark.parametrize("angle", [0.0, 15.0, 45.0, 70.0, 90.0])
def test_a_bar_pulled_off_its_axes_follows_lamination_theory(box, angle):
    """1/E_x = c⁴/E₁ + (1/G₁₂ − 2ν₁₂/E₁) s²c² + s⁴/E₂,  ν_xy and η_xy,x as Jones gives them (Mechanics of Composite Materials,
    2.97): of the strain S σ of the turned tensor the stress of the surface is σ_xx alone."""
    mesh = box("hex8", (6, 2, 2), size=(1.0, 0.1, 0.08), distort=0.25)
    axes, sigma = np.eye(3), 1e6
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    axes[:2, :2] = [[c, -s], [s, c]]
    mesh = anisotropic(mesh, orthotropic(*CONSTANTS), axes)
    (e1, e2, _), (nu12, _, _), (g12, _, _) = CONSTANTS
    modulus = 1 / (c**4 / e1 + (1 / g12 - 2 * nu12 / e1) * s**2 * c**2 + s**4 / e2)
    ratio = modulus * (nu12 / e1 * (s**4 + c**4) - (1 / e1 + 1 / e2 - 1 / g12) * s**2 * c**2)
    coupled = modulus * ((2 / e1 + 2 * nu12 / e1 - 1 / g12) * s * c**3 - (2 / e2 + 2 * nu12 / e1 - 1 / g12) * s**3 * c)
    strain = sigma * turned(flexibility(*CONSTANTS), axes)[:, :, 0, 0]
    found = [strain[0, 0], strain[1, 1], 2 * strain[0, 1]]
    np.testing.assert_allclose(found, sigma / modulus * np.array([1, -ratio, coupled]), rtol=1e-12, atol=1e-20)
    facets, z = exterior_facets(mesh), (mesh.position @ strain).reshape(-1, 1)
    state = surface_state(surface_model(mesh, facet_strain(mesh, facets), z), {}, np.ones(1))
    np.testing.assert_allclose(state.stress, np.tile([sigma, 0, 0, 0, 0, 0], (len(facets.kind), 1)), atol=1e-7 * sigma)


def ring(box, kind, counts, inner=0.5, outer=1.0):
    """A quarter of a ring: x of a box the radius, y the angle, z its axis; axes of the material radial, tangential, axial."""
    mesh = box(kind, counts)
    r, angle = inner + (outer - inner) * mesh.position[:, 0], 0.5 * np.pi * mesh.position[:, 1]
    place = np.column_stack([r * np.cos(angle), r * np.sin(angle), 0.1 * mesh.position[:, 2]])
    mesh = anisotropic(replace(mesh, position=place), orthotropic(*CONSTANTS))
    return replace(
        mesh, orientations={1: Orientation(CoordinateSystem("cylindrical", np.zeros(3), np.eye(3)), np.eye(3))}
    )


@pytest.mark.parametrize(
    ("kind", "counts", "displacement", "stress"), [("hex20", (6, 6, 1), 1e-5, 5e-4), ("hex8", (16, 12, 1), 2e-3, 3e-3)]
)
def test_a_cylindrically_orthotropic_cylinder_under_pressure_is_lekhnitskiis(box, kind, counts, displacement, stress):
    """Plane strain, ρ = r/b, c = a/b, k² = β_rr/β_θθ, β_ij = S_ij − S_iz S_jz/S_zz (Lekhnitskii, Anisotropic Plates, 1968):

    σ_r = p c^(k+1)/(1 − c^2k) (ρ^(k−1) − ρ^(−k−1)),   σ_θ = p k c^(k+1)/(1 − c^2k) (ρ^(k−1) + ρ^(−k−1))
    """
    mesh = ring(box, kind, counts)
    radius = np.hypot(*mesh.position[:, :2].T)
    facets, p = exterior_facets(mesh), 1e6
    corners = radius[facets.nodes[:, :4]]
    bore = np.flatnonzero(np.all(np.abs(corners - 0.5) < 1e-9, axis=1))
    load = pressure(with_face(mesh, "bore", facets, bore), "bore")
    f = np.zeros((len(mesh.position), 3))
    f[load.nodes] = p * load.force
    held = np.abs(mesh.position) < 1e-9
    held[:, 2] = True
    free = np.flatnonzero(~held.ravel())
    K = csr_array(assemble_stiffness(mesh))
    z = np.zeros(f.size)
    z[free] = factorise(csr_array(K[free][:, free])).solve(f.ravel()[free][:, None])[:, 0]
    S = flexibility(*CONSTANTS)
    beta = {(i, j): S[i, i, j, j] - S[i, i, 2, 2] * S[j, j, 2, 2] / S[2, 2, 2, 2] for i in (0, 1) for j in (0, 1)}
    k, c = np.sqrt(beta[0, 0] / beta[1, 1]), 0.5
    share = p * c ** (k + 1) / (1 - c ** (2 * k))

    def stresses(rho):
        return share * (rho ** (k - 1) - rho ** (-k - 1)), share * k * (rho ** (k - 1) + rho ** (-k - 1))

    radial, hoop = stresses(radius)
    assert radial[radius < 0.5 + 1e-9] == pytest.approx(-p, rel=1e-9)
    exact = radius * (beta[0, 1] * radial + beta[1, 1] * hoop)
    moved = np.einsum("nc,nc->n", z.reshape(-1, 3)[:, :2], mesh.position[:, :2]) / radius
    assert np.abs(moved - exact).max() < displacement * exact.max()

    state = surface_state(surface_model(mesh, facet_strain(mesh, facets), z[:, None]), {}, np.ones(1))
    centre = mesh.position[facets.nodes[bore, :4]].mean(axis=1)
    tangent = np.column_stack([-centre[:, 1], centre[:, 0]]) / np.hypot(*centre[:, :2].T)[:, None]
    xx, yy, xy = state.stress[bore][:, [0, 1, 3]].T
    found = xx * tangent[:, 0] ** 2 + yy * tangent[:, 1] ** 2 + 2 * xy * tangent[:, 0] * tangent[:, 1]
    np.testing.assert_allclose(found, stresses(0.5)[1], rtol=stress)


@pytest.mark.parametrize("kind", ["hex8", "tet10"])
def test_a_body_turned_and_moved_with_its_cylindrical_axes_has_the_same_stiffness(box, kind):
    mesh = ring(box, kind, (2, 2, 1))
    at = np.array([3.0, -2.0, 1.0])
    there = replace(
        mesh,
        position=mesh.position @ TURN.T + at,
        orientations={1: Orientation(CoordinateSystem("cylindrical", at, TURN), np.eye(3))},
    )
    K, other = (assemble_stiffness(own).toarray() for own in (mesh, there))
    R = np.kron(np.eye(len(mesh.position)), TURN)
    assert np.abs(R.T @ other @ R - K).max() < 1e-12 * np.abs(K).max()


def test_units_and_size_take_the_axes_with_them(box):
    mesh = ring(box, "hex8", (2, 2, 1))
    away = Orientation(CoordinateSystem("cylindrical", np.array([0.2, 0.1, 0.0]), np.eye(3)), np.eye(3))
    mesh = replace(mesh, orientations={1: away})
    millimetres = replace(
        mesh,
        position=1e3 * mesh.position,
        orientations={1: rescaled(away, 1e3)},
        anisotropic={1: replace(mesh.anisotropic[1], stiffness=1e-6 * mesh.anisotropic[1].stiffness, density=1.6e-9)},
    )
    K, same, double = (assemble_stiffness(own) for own in (mesh, to_si(millimetres, "mm", "t"), scaled(mesh, 2.0)))
    assert abs(same - K).max() < 1e-12 * abs(K).max()
    assert abs(double - 2 * K).max() < 1e-12 * abs(K).max()
    assert to_si(millimetres, "mm", "t").anisotropic[1].density == pytest.approx(1600.0)


def test_a_factor_of_the_stiffness_is_free_and_a_modulus_is_not(box):
    mesh = anisotropic(box("hex8"), triclinic())
    stiffness, _ = assemble(mesh, [Parameter("s", "stiffness_factor", (1,), 1.0)])
    changed = with_properties(mesh, [1], stiffness_factor=1.3, density=900.0)
    K = assemble_stiffness(changed)
    assert mass_properties(changed)[0] == pytest.approx(900.0)
    assert abs(stiffness.at({"s": 1.3}) - K).max() < 1e-13 * abs(K).max()
    with pytest.raises(UserError, match="region 1 \\(a solid of an anisotropic material") as error:
        assemble(mesh, [Parameter("E", "youngs_modulus", (1,), 2e11)])
    assert "stiffness_factor" in error.value.remedy
    z = np.random.default_rng(0).normal(size=(3 * len(mesh.position), 1))
    model = surface_model(
        mesh, facet_strain(mesh, exterior_facets(mesh)), z, [Parameter("s", "stiffness_factor", (1,), 1.0)]
    )
    once, more = (surface_state(model, {"s": s}, np.ones(1), np.eye(2), ["s"]) for s in (1.0, 1.3))
    np.testing.assert_allclose(more.stress, 1.3 * once.stress)
    np.testing.assert_allclose(once.stress_std**2, once.stress**2 + once.stress**2)  # of q and of s, each of σ = 1


def test_a_record_keeps_it(box):
    mesh = ring(box, "hex8", (1, 1, 1))
    other = MeshColumns.of(mesh).restore()
    assert (assemble_stiffness(other) != assemble_stiffness(mesh)).nnz == 0
    assert other.anisotropic[1].density == 1600.0
    plain = MeshColumns.of(box("hex8"))
    assert plain.anisotropic is None
    assert plain.orientations is None


def test_what_no_material_can_be_is_refused_with_its_eigenvalue(box):
    C = orthotropic(*CONSTANTS)
    C[0, 1] = C[1, 0] = 1.1 * np.sqrt(C[0, 0] * C[1, 1])
    what, remedy = stiffness_fault(C)
    scale = np.sqrt(np.diag(C))
    assert f"{np.linalg.eigvalsh(C / np.outer(scale, scale))[0]:.3g}" in what
    assert "off-diagonal" in remedy
    with pytest.raises(DeckError, match="not positive definite"):
        check_mesh(anisotropic(box("hex8"), C))
    assert "diagonal entry 5 is 0" in stiffness_fault(np.diag([1.0, 1, 1, 1, 0, 1]))[0]
    assert stiffness_fault(isotropic(1e7, 0.4999)) is None
