"""The lug bracket of meshes/: its rings about holes against Kirsch, its sections against equilibrium, its frequencies against
CalculiX."""

from __future__ import annotations

import runpy
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from strainsight.decks.reader import read_mesh
from strainsight.fem.assembly import assemble
from strainsight.fem.factorisation import factorise
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.model import build_model, nodal
from strainsight.fem.modes import modes
from strainsight.gauges.candidates import candidates
from strainsight.gauges.rows import channel_rows
from strainsight.gauges.zones import NormalCone
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.units import to_si

from .conftest import make_mesh

MESHES = Path(__file__).parents[2] / "meshes"
E, NU, T, CENTRE = 2.1e11, 0.3, 0.012, 0.09
UPRIGHTS_LAST = (*range(12), 16, 17, 18, 19, 12, 13, 14, 15)
"""Nastran's order of a hex20 in the package's, and back."""


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(MESHES / "make_lug.py"))


@pytest.fixture(scope="module")
def lug():
    return to_si(read_mesh(MESHES / "lug.bdf.gz"), "mm", "t")


@pytest.fixture(scope="module")
def model(lug):
    return build_model(lug)


@pytest.fixture(scope="module")
def static(model):
    """Displacements (3n, 3) under a newton along x, y and z at the centre of the bore."""
    loads = [PointLoad(name, tuple(axis), node_id=2) for name, axis in zip("xyz", np.eye(3), strict=True)]
    K = model.stiffness.constant
    return nodal(model, factorise(K).solve(input_shape(model, loads)))[: 3 * len(model.mesh.position)]


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
def test_the_bolts_carry_all_of_the_force_and_its_moment(lug, static):
    forces = (assemble(lug)[0].constant @ static).reshape(-1, 3, 3)
    held = np.unique(lug.fixed[:, 0])
    for column, force in enumerate(np.eye(3)):
        reaction, bore = forces[held, :, column], forces[lug.averaging[0].nodes, :, column]
        moment = np.cross([0, 0, CENTRE], force)
        for carried, sign in ((reaction, -1), (bore, 1)):
            arm = lug.position[held if sign < 0 else lug.averaging[0].nodes]
            np.testing.assert_allclose(carried.sum(axis=0), sign * force, atol=1e-8)
            np.testing.assert_allclose(np.cross(arm, carried).sum(axis=0), sign * moment, atol=1e-9)


@pytest.mark.slow
def test_strain_across_a_section_carries_the_force_and_its_moment(lug, static):
    """Gauges on both faces half way up the trapezoid: σ_z over the section is the pull, its first moment along x that of the
    force along x; σ_z on the faces, linear through the plate, that of the force along y."""
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


def cantilever_in_bending():
    """First frequency [Hz] of the upright as a beam of varying width clamped at its foot, Rayleigh-Ritz with z² … z⁷."""
    g, w = np.polynomial.legendre.leggauss(400)
    s, w = (g + 1) / 2 * 0.108, w / 2 * 0.108
    above = s + 0.012 - CENTRE
    bore, eye = (np.sqrt(np.maximum(radius**2 - above**2, 0)) for radius in (0.015, 0.03))
    # the side from the foot, 50 mm out and 72 mm below the eye's centre, to where it touches the eye
    far = np.hypot(0.05, 0.072)
    tangent = np.sqrt(far**2 - 0.03**2)
    x, z = (0.03**2 * np.array([0.05, -0.072]) + 0.03 * tangent * np.array([0.072, 0.05])) / far**2
    side = np.interp(above, [-0.072, z], [0.05, x])
    width = 2 * (np.where(above < z, side, eye) - bore)
    power = np.arange(2, 8)
    shape = (s[:, None] / 0.108) ** power
    bend = power * (power - 1) * (s[:, None] / 0.108) ** (power - 2) / 0.108**2
    K = np.einsum("q,qi,qj->ij", w * E * width * T**3 / 12, bend, bend)
    M = np.einsum("q,qi,qj->ij", w * 7850 * width * T, shape, shape)
    return np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real.min()) / (2 * np.pi)


@pytest.mark.slow
def test_on_a_rigid_base_the_upright_bends_like_a_cantilever(lug, model):
    """Between a beam and a strip that cannot contract across, stiffer by 1/(1 − ν²), and shorter by the weld's leg of 6 in
    108 mm. The base plate makes the bracket softer than that."""
    base = np.flatnonzero(lug.position[:, 2] <= T + 1e-9)
    clamped = build_model(replace(lug, fixed=np.stack([np.repeat(base, 3), np.tile(range(3), len(base))], axis=1)))
    rigid = modes(clamped.stiffness.constant, clamped.mass.constant, 1)[0][0]
    beam = cantilever_in_bending()
    assert beam < rigid < beam / np.sqrt(1 - NU**2) / (1 - 6 / 108) ** 2
    assert modes(model.stiffness.constant, model.mass.constant, 1)[0][0] < rigid


def calculix_deck(mesh):
    """The solids and their clamps in CalculiX's words; the average in the bore holds nothing."""
    lines = ["*NODE,NSET=ALL"]
    lines += [f"{i},{x:.12g},{y:.12g},{z:.12g}" for i, (x, y, z) in zip(mesh.node_ids[1:], mesh.position[1:], strict=True)]
    for block in mesh.blocks:
        lines.append(f"*ELEMENT,TYPE={({'hex20': 'C3D20', 'wedge15': 'C3D15'})[block.kind]},ELSET=ALL")
        for e, nodes in zip(block.ids, mesh.node_ids[block.nodes], strict=True):
            fields = [str(v) for v in (e, *nodes)]
            lines += [",".join(fields[:11]) + ",", ",".join(fields[11:])]
    lines += ["*MATERIAL,NAME=STEEL", "*ELASTIC", f"{E},{NU}", "*DENSITY", "7850.", "*SOLID SECTION,ELSET=ALL,MATERIAL=STEEL"]
    lines += ["*BOUNDARY", *(f"{mesh.node_ids[n]},1,3" for n in np.unique(mesh.fixed[:, 0]))]
    return "\n".join([*lines, "*STEP", "*FREQUENCY", "10", "*END STEP", ""])


def frequencies(mesh):
    model = build_model(mesh)
    return modes(model.stiffness.constant, model.mass.constant, 10)[0]


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX is not installed")
@pytest.mark.parametrize(("welded", "within"), [(False, 5e-7), (True, 1e-4)])
def test_ten_frequencies_against_calculix_on_the_same_mesh(lug, tmp_path, welded, within):
    """It integrates a wedge15 with nine points, this package with eighteen; without the weld there is no difference."""
    mesh = lug if welded else replace(lug, blocks=tuple(block for block in lug.blocks if block.kind == "hex20"))
    (tmp_path / "lug.inp").write_text(calculix_deck(mesh))
    subprocess.run(["ccx", "lug"], cwd=tmp_path, check=True, stdout=subprocess.DEVNULL, timeout=900)
    rows = [line.split() for line in (tmp_path / "lug.dat").read_text().splitlines()]
    table = [float(row[1]) for row in rows if len(row) == 5 and row[0].isdigit()]
    calculix = np.sqrt(table[:10]) / (2 * np.pi)
    np.testing.assert_allclose(frequencies(mesh), calculix, rtol=within)
