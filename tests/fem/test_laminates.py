"""Shells of plies: against lamination theory by other means, Navier's solutions, published values, and invariances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from strainsight.errors import UserError
from strainsight.fem.affine import Parameter
from strainsight.fem.mass import mass_properties
from strainsight.fem.model import build_model, nodal
from strainsight.fem.modes import modes
from strainsight.fem.recovery import facet_strain, surface_model, surface_state
from strainsight.fem.shells_and_beams import of_laminate, thin_operators
from strainsight.mesh.additions import with_properties
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Material
from strainsight.mesh.thin import Lamina, ShellSection
from strainsight.mesh.thin_faces import with_faces

from .laminate_models import CARBON, STEEL, by_slices, navier, plate, stack

LAYUPS = {
    "cross": stack([0, 90], 1e-3),
    "symmetric": stack([0, 90, 45, -45, -45, 45, 90, 0], 1.25e-4),
    "angles": stack([30, -30], 5e-4),
    "any": stack([10, 55, -70, 0], [1e-3, 2e-4, 5e-4, 7e-4], [1, 2, 1, 1]),
    "sandwich": stack([0, 0, 90], [1e-3, 2e-2, 1e-3], [1, 3, 1]),
}


@pytest.mark.parametrize("name", LAYUPS)
def test_resistance_is_that_of_slices(name):
    mesh = plate(LAYUPS[name], 1, 1, 1.0, 1.0)
    own = of_laminate(mesh, 1)
    A, B, D, S = by_slices(LAYUPS[name], mesh)
    h = LAYUPS[name].thickness
    for found, expected, scale in ((own.A, A, 1), (own.B, B, h), (own.D, D, h * h)):
        assert np.abs(found - expected).max() < 1e-11 * np.abs(A).max() * scale
    np.testing.assert_allclose(own.S, S, rtol=1e-6, atol=1e-6 * np.abs(S).max())


def test_plies_of_one_material_are_a_homogeneous_shell():
    plies = plate(stack([0, 30, 77], [1e-3, 4e-3, 2e-3], 2), 3, 2, 0.4, 0.3, offset=0.002)
    mesh = replace(
        plies,
        sections={1: ShellSection(7e-3)},
        regions={1: replace(plies.regions[1], material=2)},
    )
    (K, M), (K1, M1) = ([X.at({}) for X in thin_operators(own)] for own in (plies, mesh))
    assert abs(K - K1).max() < 1e-12 * abs(K1).max()
    assert abs(M - M1).max() < 1e-12 * abs(M1).max()


def test_ply_that_does_not_shear():
    """Without G1z and G2z: a strip has the deflection of bending alone, to a thousandth of that by shear."""
    rigid = replace(CARBON, g1z=np.inf, g2z=np.inf)
    mesh = replace(plate(stack([0, 90, 0], 1e-3), 1, 1, 1.0, 1.0), laminae={1: rigid})
    own = of_laminate(mesh, 1)
    assert np.linalg.eigvalsh(own.S)[0] == pytest.approx(125 * (np.trace(own.A[:2, :2]) - 2 * own.A[0, 1] + 4 * own.A[2, 2]))


def simply_supported(n, a, b, angle_ply):
    """Held at the edges as Navier's sums are: w, the motion along the edge (angle-ply: across it), its rotation."""
    i, j = (part.ravel() for part in np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij"))
    at_x, at_y = np.flatnonzero((i == 0) | (i == n)), np.flatnonzero((j == 0) | (j == n))
    # normal of x turns about y: θ_y along x; at x = 0 the rotation along the edge, about x, is held
    x_held, y_held = ((0, 2, 3), (1, 2, 4)) if angle_ply else ((1, 2, 3), (0, 2, 4))
    return [(k, c) for k in at_x for c in x_held] + [(k, c) for k in at_y for c in y_held]


def deflection_and_frequency(laminate, n, a, b, angle_ply):
    mesh = plate(laminate, n, n, a, b, fixed=simply_supported(n, a, b, angle_ply), axis=(1.0, 0.0, 0.0))
    model = build_model(mesh)
    x, y = mesh.position[:, 0], mesh.position[:, 1]
    # consistent load of q = sin sin, as bilinear in every element: M of unit density and thickness on its nodal values
    unit = replace(mesh, sections={1: replace(laminate, nonstructural=1.0)}, laminae={1: replace(CARBON, density=0.0)})
    q = np.zeros((len(x), 6))
    q[:, 2] = np.sin(np.pi * x / a) * np.sin(np.pi * y / b)
    f = (thin_operators(unit)[1].at({}) @ q.ravel()).reshape(-1, 6)[:, 2]
    forces = np.zeros((len(x), 3))
    forces[:, 2] = f
    T = nodal(model, np.eye(model.size))
    z = spsolve(model.stiffness.at({}).tocsc(), T.T @ forces.ravel())
    w = (T @ z).reshape(-1, 3)[:, 2]
    return w[(n // 2) * (n + 1) + n // 2], modes(model.stiffness.at({}), model.mass.at({}), 1)[0][0]


@pytest.mark.parametrize(
    ("angles", "angle_ply"),
    [([0, 90, 0], False), ([0, 90], False), ([45, -45], True), ([30, -30, 30, -30], True)],
)
def test_navier(angles, angle_ply):
    """Deflection and lowest frequency, extrapolated from two meshes to none: order 2."""
    a, b, h = 0.5, 0.4, 5e-3
    laminate = stack(angles, h / len(angles))
    mesh = plate(laminate, 1, 1, a, b)
    rho = CARBON.density
    K, M, load = navier(*by_slices(laminate, mesh), (rho * h, 0.0, rho * h**3 / 12), a, b, 1, 1, angle_ply)
    w = np.linalg.solve(K, load)[2]
    frequency = np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real.min()) / (2 * np.pi)
    found = np.array([deflection_and_frequency(laminate, n, a, b, angle_ply) for n in (6, 12)])
    error = found / (w, frequency) - 1
    assert np.abs(error[1]).max() < 0.02
    extrapolated = (4 * found[1] - found[0]) / 3 / (w, frequency) - 1
    assert np.abs(extrapolated).max() < 1e-3


def test_nafems_laminated_strip():
    """R0031/1: a strip [0/90/0/90/0/90/0] in three-point bending, a quarter of it; −1.06 mm and 683.9 MPa below the load."""
    material = Lamina(1, 1e11, 5e9, 0.4, 3e9, 2e9, 2e9, 1000.0)
    t = np.array([1, 1, 1, 4, 1, 1, 1]) * 1e-4
    laminate = stack([0, 90, 0, 90, 0, 90, 0], t)
    n, m, a, b = 25, 5, 0.025, 0.005
    i, j = (part.ravel() for part in np.meshgrid(np.arange(n + 1), np.arange(m + 1), indexing="ij"))
    fixed = [(k, c) for k in np.flatnonzero(i == 0) for c in (0, 4)]  # x = 0: below the load
    fixed += [(k, c) for k in np.flatnonzero(j == 0) for c in (1, 3)]
    fixed += [(k, 2) for k in np.flatnonzero(i == 15)]
    mesh = with_faces(replace(plate(laminate, n, m, a, b, fixed=fixed), laminae={1: material}))
    model = build_model(mesh)
    forces = np.zeros((len(mesh.position), 3))
    at = np.flatnonzero(i == 0)
    forces[at, 2] = -1e4 / 2 * (b / m) * np.where((j[at] == 0) | (j[at] == m), 0.5, 1.0)  # 10 N/mm, half on this part
    T = nodal(model, np.eye(model.size))
    z = spsolve(model.stiffness.at({}).tocsc(), T.T @ forces.ravel())
    assert (T @ z)[2] == pytest.approx(-1.06e-3, rel=0.01)
    # stress along the strip, at the centres of the facets along its middle: linear from the load to the support at 15 mm
    facets = exterior_facets(mesh)
    s = Parameter("s", "stiffness_factor", (1,), 1.0)
    state = surface_state(surface_model(mesh, facet_strain(mesh, facets), T @ z, (s,)), {"s": 1.0}, np.ones(1))
    near = mesh.position[facets.nodes[:, :4], :].mean(axis=1)
    for x, side in ((0.5e-3, -1), (4.5e-3, -1), (0.5e-3, 1)):
        own = np.argmin(np.linalg.norm(near - (x, 0.5e-3, side * 0.5e-3), axis=1))
        assert state.stress[own, 0] == pytest.approx(-side * 683.9e6 * (1 - x / 0.015), rel=0.01)
    doubled = surface_state(surface_model(mesh, facet_strain(mesh, facets), T @ z, (s,)), {"s": 2.0}, np.ones(1))
    np.testing.assert_allclose(doubled.stress, 2 * state.stress)


def test_stress_on_faces_of_isotropic_plies_is_that_of_a_homogeneous_shell():
    plies = plate(stack([20, 50], 2e-3, 2), 3, 2, 0.3, 0.2, axis=(1.0, 1.0, 0.0))
    alike = replace(plies, sections={1: ShellSection(4e-3)}, regions={1: replace(plies.regions[1], material=2)})
    states = []
    for mesh in (with_faces(plies), with_faces(alike)):
        z = np.random.default_rng(1).normal(size=3 * len(mesh.position))
        model = surface_model(mesh, facet_strain(mesh, exterior_facets(mesh)), z)
        states.append(surface_state(model, {}, np.ones(1), np.array([[0.04]])))
    for name in ("strain", "stress", "von_mises", "stress_std", "von_mises_std"):
        own, other = (getattr(state, name) for state in states)
        np.testing.assert_allclose(own, other, rtol=1e-10, atol=1e-10 * np.abs(other).max())


@pytest.mark.parametrize("kind", ["quad4", "tri3"])
@pytest.mark.parametrize("name", LAYUPS)
def test_first_node_of_an_element_has_no_effect(kind, name):
    reference = None
    for turned in range(3):
        mesh = plate(LAYUPS[name], 3, 2, 0.3, 0.25, kind, axis=(1.0, 0.3, 0.0), turned=turned)
        mesh.position[5, :2] += (0.02, 0.013)
        K, M = (X.at({}).toarray() for X in thin_operators(mesh))
        if reference is not None:
            assert np.abs(K - reference[0]).max() < 1e-9 * np.abs(K).max()
            assert np.abs(M - reference[1]).max() < 1e-12 * np.abs(M).max()
        reference = K, M


def test_angles_go_from_the_material_axis():
    """A laminate turned by its plies is one turned by its axis, and side 1-2 is the axis where none is given; but for shear,
    whose rule has the axes of the laminate."""
    rigid = {1: replace(CARBON, g1z=np.inf, g2z=np.inf)}
    turned = [plate(stack([30 + 20, -10 + 20, 90 + 20], 1e-3), 2, 2, 0.3, 0.25)]
    c, s = np.cos(np.radians(20)), np.sin(np.radians(20))
    turned.append(plate(stack([30, -10, 90], 1e-3), 2, 2, 0.3, 0.25, axis=(c, s, 0.7)))
    K = [thin_operators(replace(mesh, laminae=rigid))[0].at({}) for mesh in turned]
    assert abs(K[0] - K[1]).max() < 1e-12 * abs(K[0]).max()


def test_mass_is_that_of_the_plies():
    laminate = replace(stack([0, 0], [1e-3, 3e-3], [2, 1]), nonstructural=2.0)
    mesh = plate(laminate, 2, 2, 0.3, 0.25, offset=0.01)
    mass, centre = mass_properties(mesh)
    per_area = np.array([STEEL.density * 1e-3, CARBON.density * 3e-3, 2.0])
    z = 0.01 + np.array([-1.5e-3, 0.5e-3, 0.0])
    assert mass == pytest.approx(per_area.sum() * 0.3 * 0.25, rel=1e-12)
    np.testing.assert_allclose(centre, [0.15, 0.125, per_area @ z / per_area.sum()], rtol=1e-12)
    # turned about x through the nodes: ∫ρ(y² + z²)
    M = thin_operators(mesh)[1].at({})
    x = mesh.position
    spin = np.zeros((len(x), 6))
    spin[:, 2], spin[:, 3] = x[:, 1], 1.0
    thick = np.array([1e-3, 3e-3, 0.0])
    expected = 0.3 * 0.25 * (per_area.sum() * 0.25**2 / 3 + per_area @ (z**2 + thick**2 / 12))
    assert spin.ravel() @ M @ spin.ravel() == pytest.approx(expected, rel=1e-9)


def test_factor_and_density_of_a_laminate_are_affine():
    """K(θ) and M(θ) are those of plies with other moduli and densities; other regions stay."""
    mesh = plate(replace(LAYUPS["any"], nonstructural=1.0), 2, 2, 0.3, 0.25)
    rho = mesh.density_of(1)
    t = np.array([1e-3, 2e-4, 5e-4, 7e-4])
    assert rho == pytest.approx((t @ [1600, 7800, 1600, 1600]) / t.sum())
    parameters = (Parameter("s", "stiffness_factor", (1,), 1.0), Parameter("rho", "density", (1,), rho))
    K, M = thin_operators(mesh, parameters)
    other = replace(
        mesh,
        laminae={1: Lamina(1, *(1.2 * v for v in (1.4e11, 1.0e10)), 0.3, *(1.2 * v for v in (5e9, 4.5e9, 3e9)), 800.0)},
        materials={2: Material(2, 1.2 * 2e11, 0.3, 3900.0)},
    )
    K1, M1 = (X.at({}) for X in thin_operators(other))
    assert abs(K.at({"s": 1.2}) - K1).max() < 1e-13 * abs(K1).max()
    assert abs(M.at({"rho": rho / 2}) - M1).max() < 1e-13 * abs(M1).max()
    again = [X.at({}) for X in thin_operators(with_properties(mesh, (1,), density=rho / 2, stiffness_factor=1.2))]
    assert abs(again[0] - K1).max() < 1e-13 * abs(K1).max()
    assert abs(again[1] - M1).max() < 1e-13 * abs(M1).max()
    fibres = plate(LAYUPS["cross"], 2, 2, 0.3, 0.25)
    with pytest.raises(UserError, match="without isotropic plies") as error:
        thin_operators(fibres, (Parameter("E", "youngs_modulus", (1,), 1e11),))
    assert "stiffness_factor" in str(error.value.remedy)
