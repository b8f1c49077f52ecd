"""Meshes of meshes/: the cantilever against beam theory, the hub by formulae, the lug bracket by Kirsch and equilibrium of a
section, and frequencies by CalculiX on the same meshes."""

from __future__ import annotations

import hashlib
import runpy
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh, expm
from scipy.optimize import brentq
from scipy.sparse.linalg import spsolve

from strainsight.decks.reader import read_mesh
from strainsight.fem.assembly import assemble
from strainsight.fem.factorisation import factorise
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.mass import mass_properties
from strainsight.fem.model import build_model, nodal
from strainsight.fem.modes import modes
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.units import to_si
from strainsight.sensors.candidates import candidates
from strainsight.sensors.strain_operator import channel_rows
from strainsight.sensors.zones import NormalCone

from ..frd import calculix
from .conftest import make_mesh

MESHES = Path(__file__).parents[2] / "meshes"
R, WALL, FLANGE, FACE, BORE, IRON = 0.5, 0.15, -0.315, 0.43, 0.15, 7100.0
E, NU, T, CENTRE = 2.1e11, 0.3, 0.012, 0.09
UPRIGHTS_LAST = (*range(12), 16, 17, 18, 19, 12, 13, 14, 15)
"""Nastran's order of a hex20 in the package's, and back."""


@pytest.fixture(scope="module")
def hub():
    return read_mesh(MESHES / "hub-coarse.bdf.gz")


@pytest.mark.slow
def test_the_hub_is_the_one_in_the_list_of_checksums(hub):
    listed = dict(reversed(line.split()) for line in (MESHES / "hub.sha256").read_text().splitlines())
    assert set(listed) == {"hub-coarse.bdf.gz", "hub.bdf.gz"}
    for name, digest in listed.items():
        assert hashlib.sha256((MESHES / name).read_bytes()).hexdigest() == digest
    assert hub.ignored == {"EIGRL": 1}
    assert [len(hub.node_sets[f"SET1-{number}"]) for number in (21, 22, 23)] == [len(hub.rigid[1].nodes)] * 3


def solid_volume():
    """Spherical shell less three flat faces with their bores and less what the shaft's flange cuts off."""

    def cap(radius, height):
        return np.pi * height**2 * (radius - height / 3)

    r = R - WALL
    ball = 4 / 3 * np.pi * (R**3 - r**3)
    bore = np.pi * BORE**2 * FACE - 2 / 3 * np.pi * (r**3 - (r**2 - BORE**2) ** 1.5)
    return ball - 3 * (cap(R, R - FACE) + bore) - (cap(R, R + FLANGE) - cap(r, r + FLANGE))


@pytest.mark.slow
def test_mass_is_density_times_volume(hub):
    """Of the solid, by formulae, which straight sides would miss by 4e-4."""
    mass, centre = mass_properties(hub)
    assert mass == pytest.approx(IRON * solid_volume(), rel=2e-6)
    assert np.all(np.abs(centre[:2]) < 1e-6)


def four_point_mass(mesh, fields):
    """ΦᵀMΦ (r, r) of nodal fields (n, 3, r) with the rule of degree 2 that CalculiX uses for a C3D10's mass.

    It is not exact even on straight elements, where NᵀN has degree 4; this package's is.
    """
    dL = np.array([[-1.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 1.0]])
    first, second = np.array([(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]).T
    nodes, near = mesh.blocks[0].nodes, (5 + 3 * np.sqrt(5)) / 20
    M = np.zeros((fields.shape[2],) * 2)
    for corner in range(4):
        L = np.full(4, (1 - near) / 3)
        L[corner] = near
        N = np.concatenate([L * (2 * L - 1), 4 * L[first] * L[second]])
        dN = np.hstack([dL * (4 * L - 1), 4 * (dL[:, first] * L[second] + dL[:, second] * L[first])])
        J = np.einsum("di,eik->edk", dN, mesh.position[nodes])
        u = np.einsum("i,eikr->ekr", N, fields[nodes])
        M += IRON / 24 * np.einsum("e,ekr,eks->rs", np.linalg.det(J), u, u, optimize=True)
    return M


def by_calculix(folder, mesh):
    """Its first ten frequencies [Hz]; it prints seven digits of ω²."""
    calculix(folder, mesh, [], 10)
    rows = [line.split() for line in (folder / "model.dat").read_text().splitlines()]
    table = [float(row[1]) for row in rows if len(row) == 5 and row[0].isdigit()]
    return np.sqrt(table[:10]) / (2 * np.pi)


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX is not installed")
def test_ten_frequencies_of_the_hub_against_calculix_on_the_same_mesh(hub, tmp_path):
    """To six digits with CalculiX's rule for the mass, to 1e-5 with this package's. There are more modes than are compared, so
    that the last ones can mix too."""
    model, exact = build_model(hub), by_calculix(tmp_path, hub)
    frequency, shapes = modes(model.stiffness.constant, model.mass.constant, 16)
    assert np.allclose(frequency[:10], exact, rtol=1e-5)
    M = four_point_mass(hub, nodal(model, shapes).reshape(len(hub.position), 3, -1))
    same_rule = np.sqrt(eigh(np.diag(frequency**2), M, eigvals_only=True))
    assert np.allclose(same_rule[:10], exact, rtol=5e-7)


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(MESHES / "make_lug.py"))


@pytest.fixture(scope="module")
def lug():
    return to_si(read_mesh(MESHES / "lug.bdf.gz"), "mm", "t")


def kirsch(x, y, a):
    """Displacement [a/E] and strain [1/E] (k, 3) = ε_x, ε_y, ε_xy about a hole of radius a, unit tension along x, ν = 0.

    Kirsch 1898; Timoshenko and Goodier, Theory of Elasticity, section 35. At ν = 0 a plate of any thickness is in this state.
    """
    r, t = np.hypot(x, y), np.arctan2(y, x)
    q = a / r
    u = np.cos(t) / q + q * (2 * np.cos(t) + np.cos(3 * t) / 2) - q**3 * np.cos(3 * t) / 2
    v = q * (np.sin(3 * t) / 2 - np.sin(t)) - q**3 * np.sin(3 * t) / 2
    radial = (1 - q**2) / 2 + (1 - 4 * q**2 + 3 * q**4) / 2 * np.cos(2 * t)
    hoop = (1 + q**2) / 2 - (1 + 3 * q**4) / 2 * np.cos(2 * t)
    shear = -(1 + 2 * q**2 - 3 * q**4) / 2 * np.sin(2 * t)
    c, s = np.cos(t), np.sin(t)
    strain = [radial * c**2 + hoop * s**2 - 2 * shear * s * c, radial * s**2 + hoop * c**2 + 2 * shear * s * c]
    return np.column_stack([u, v]), np.column_stack([*strain, (radial - hoop) * s * c + shear * (c**2 - s**2)])


def test_the_rings_of_a_bolt_hole_have_kirschs_strain(script):
    """The square about a bolt hole alone, its outer sides moved as Kirsch says: 3 at the sides of the hole, −1 at its ends."""
    a = script["BOLT_RADIUS"]
    blocks = script["square_ring"]((0.0, 0.0), a, (22.0, 24.0), script["AROUND"], script["grown"](4, script["GROWTH"]))
    layers = script["even"](0.0, 12.0, 2)
    cells = np.concatenate([script["extruded"](block, layers) for block in blocks])
    solids = script["joined"](cells, np.zeros((0, 15, 3)))
    position = solids.position
    mesh = make_mesh(position, [("hex20", solids.hexahedra[:, UPRIGHTS_LAST], 1)], material=(1.0, 0.0, 1.0))
    K = assemble(mesh)[0].constant
    x, y, z = position.T
    outer = (np.abs(np.abs(x) - 22) < 1e-9) | (np.abs(np.abs(y) - 24) < 1e-9)
    u = np.zeros((len(position), 3))
    u[:, :2] = a * kirsch(x, y, a)[0]
    held = np.zeros((len(position), 3), dtype=bool)
    held[outer, :2] = held[z == 0, 2] = True
    free = np.flatnonzero(~held)
    u[~held] = 0.0
    u = u.ravel()
    u[free] = spsolve(K[free][:, free].tocsc(), -(K @ u)[free])
    # along the rim, from end to end of an element: the strain at its middle
    rim = np.flatnonzero((np.abs(np.hypot(x, y) - a) < 1e-5) & (z == 12))
    rim = rim[np.argsort(np.arctan2(y[rim], x[rim]))]
    first, last = np.roll(rim, 1), np.roll(rim, -1)
    along = position[last] - position[first]
    hoop = np.sum((u.reshape(-1, 3)[last] - u.reshape(-1, 3)[first]) * along, axis=1) / np.sum(along**2, axis=1)
    exact = 1 - 2 * np.cos(2 * np.arctan2(y[rim], x[rim]))
    assert exact.max() == pytest.approx(3, abs=0.02)
    np.testing.assert_allclose(hoop, exact, atol=0.04)
    # gauges along and across the tension at the middle of every facet, next to the rim and farther away
    gauges = candidates(mesh, exterior_facets(mesh), (1, 0, 0), (0.0, 90.0), include=[NormalCone((0, 0, 1), 1.0)])
    found = channel_rows(position, gauges, u.reshape(-1, 1))[:, 0]
    at, d = gauges.position, gauges.direction
    strain = kirsch(at[:, 0], at[:, 1], a)[1]
    expected = strain[:, 0] * d[:, 0] ** 2 + strain[:, 1] * d[:, 1] ** 2 + 2 * strain[:, 2] * d[:, 0] * d[:, 1]
    assert expected.max() > 2
    np.testing.assert_allclose(found, expected, atol=0.05)


@pytest.mark.slow
def test_strain_across_a_section_carries_the_force_and_its_moment(lug):
    """Under a newton along x, y and z at the centre of the bore, by gauges on both faces half way up the trapezoid: σ_z over the
    section is the pull, its first moment along x that of the force along x; σ_z on the faces, linear through the plate, that of
    the force along y."""
    model = build_model(lug)
    loads = [PointLoad(name, tuple(axis), node_id=2) for name, axis in zip("xyz", np.eye(3), strict=True)]
    static = nodal(model, factorise(model.stiffness.constant).solve(input_shape(model, loads)))[: 3 * len(lug.position)]
    gauges = candidates(lug, exterior_facets(lug), (0, 0, 1), (0.0, 90.0), include=[NormalCone((0, 1, 0), 1.0)])
    chosen = gauges.take(np.flatnonzero(np.abs(gauges.position[:, 2] - 0.0334) < 1e-3))
    strain = channel_rows(lug.position, chosen, static).reshape(-1, 2, 3)
    stress = E / (1 - NU**2) * (strain[:, 0] + NU * strain[:, 1])
    x, z, side = chosen.position[::2, 0], chosen.position[::2, 2], np.sign(chosen.normal[::2, 1])
    assert len(x) == 2 * 14
    assert np.ptp(z) < 1e-9
    area = (np.ptp(x) / 13) * T / 2
    arm = CENTRE - z[0]
    # the linear part of the stress within each of the fourteen strips is left out: 1/14² of the moment
    assert area * np.sum(stress[:, 0] * x) == pytest.approx(-arm, rel=0.01)
    assert area * np.sum(stress[:, 1] * side) * T / 6 == pytest.approx(-arm, rel=0.01)
    assert area * np.sum(stress[:, 2]) == pytest.approx(1, rel=0.01)


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX is not installed")
@pytest.mark.parametrize(("welded", "within"), [(False, 5e-7), (True, 1e-4)])
def test_ten_frequencies_of_the_lug_against_calculix_on_the_same_mesh(lug, tmp_path, welded, within):
    """It integrates a wedge15 with nine points, this package with eighteen; without the weld there is no difference."""
    mesh = lug if welded else replace(lug, blocks=tuple(block for block in lug.blocks if block.kind == "hex20"))
    model = build_model(mesh)
    frequency, _ = modes(model.stiffness.constant, model.mass.constant, 10)
    np.testing.assert_allclose(frequency, by_calculix(tmp_path, mesh), rtol=within)


L, B, H = 2.0, 0.25, 0.19
RHO = 7850.0
G, AREA, POLAR = E / (2 * (1 + NU)), B * H, B * H * (B**2 + H**2) / 12


def timoshenko(inertia, count):
    """Roots of the clamped-free determinant of w′ = ψ + Q/kGA, ψ′ = M/EI, M′ = −Q − ρIω²ψ, Q′ = −ρAω²w.

    Shear coefficient of a rectangle after Cowper (1966): k = 10(1 + ν)/(12 + 11ν).
    """
    k = 10 * (1 + NU) / (12 + 11 * NU)

    def determinant(omega):
        s = E * inertia
        A = np.array(
            [
                [0, 1, 0, s / (k * G * AREA)],
                [0, 0, 1, 0],
                [0, -RHO * inertia * omega**2 / s, 0, -1],
                [-RHO * AREA * omega**2 / s, 0, 0, 0],
            ]
        )
        return np.linalg.det(expm(A * L)[2:, 2:])

    grid = 2 * np.pi * np.arange(5.0, 1500.0, 5.0)
    value = [determinant(omega) for omega in grid]
    roots = [
        brentq(determinant, a, b) for a, b, fa, fb in zip(grid, grid[1:], value, value[1:], strict=False) if fa * fb < 0
    ]
    return np.array(roots[:count]) / (2 * np.pi)


def saint_venant():
    """f = √(GJ/ρI_p)/4L with the torsion series of a rectangle."""
    n = np.arange(1, 60, 2)
    J = B * H**3 * (1 / 3 - 64 / np.pi**5 * H / B * np.sum(np.tanh(n * np.pi * B / (2 * H)) / n**5))
    return np.sqrt(G * J / (RHO * POLAR)) / (4 * L)


def rayleigh_love():
    """f = √(E/ρ)/4L / √(1 + ν² I_p/A (π/2L)²): the lateral inertia of the Poisson contraction."""
    return np.sqrt(E / RHO) / (4 * L) / np.sqrt(1 + NU**2 * POLAR / AREA * (np.pi / (2 * L)) ** 2)


def families(mesh, count=10):
    """Frequencies by family: which of bending z, bending y, torsion and stretching has most of a mode's motion."""
    model = build_model(mesh)
    frequency, shapes = modes(model.stiffness.constant, model.mass.constant, count)
    x, y, z = (mesh.position - 0.5 * (mesh.position.min(axis=0) + mesh.position.max(axis=0))).T
    fields = nodal(model, shapes).reshape(len(x), 3, count)
    station = np.unique(np.round(x, 9), return_inverse=True)[1]
    size = np.bincount(station)

    def mean(values):
        return (np.bincount(station, values) / size)[station]

    found = {"z": [], "y": [], "torsion": [], "axial": []}
    for f, field in zip(frequency, np.moveaxis(fields, 2, 0), strict=True):
        twist = mean(y * field[:, 2] - z * field[:, 1]) / mean(y**2 + z**2)
        share = {
            "z": np.sum(mean(field[:, 2]) ** 2),
            "y": np.sum(mean(field[:, 1]) ** 2),
            "torsion": np.sum(twist**2 * (y**2 + z**2)),
            "axial": np.sum(mean(field[:, 0]) ** 2),
        }
        kind = max(share, key=lambda k: share[k])
        assert share[kind] > 0.8 * sum(share.values())
        found[kind].append(f)
    return {kind: np.array(values) for kind, values in found.items()}


def test_the_example_deck_within_one_percent_of_theory_the_axial_mode_within_a_thousandth():
    mesh = read_mesh(Path(__file__).parents[2] / "meshes" / "cantilever.bdf")
    assert mass_properties(mesh)[0] == pytest.approx(RHO * L * AREA, rel=1e-12)
    found = families(mesh)
    assert np.allclose(found["z"][:3], timoshenko(B * H**3 / 12, 3), rtol=7e-3)
    assert np.allclose(found["y"][:3], timoshenko(H * B**3 / 12, 3), rtol=7e-3)
    assert found["torsion"][0] == pytest.approx(saint_venant(), rel=7e-3)
    assert found["axial"][0] == pytest.approx(rayleigh_love(), rel=1e-3)


def test_axial_mode_within_a_thousandth_where_the_root_may_contract(box):
    """The root held along the axis only (and, on its two symmetry lines, across them): Rayleigh-Love to 1e-4."""
    mesh = box("hex20", (20, 2, 2), (L, B, H), material=(E, NU, RHO))
    x, y, z = mesh.position.T
    root = np.isclose(x, 0)
    held = [(root, 0), (root & np.isclose(y, B / 2), 1), (root & np.isclose(z, H / 2), 2)]
    fixed = np.vstack([np.column_stack([np.flatnonzero(where), np.full(where.sum(), c)]) for where, c in held])
    assert families(replace(mesh, fixed=fixed))["axial"][0] == pytest.approx(rayleigh_love(), rel=1e-4)
