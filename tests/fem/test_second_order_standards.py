"""Shells of the second order on standard problems and as structures: gauges, mass, laminates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from strainsight.fem.affine import Parameter
from strainsight.fem.mass import mass_properties
from strainsight.fem.model import build_model, nodal
from strainsight.fem.modes import modes
from strainsight.fem.recovery import facet_strain
from strainsight.gauges.candidates import candidates
from strainsight.gauges.locate import locate
from strainsight.gauges.rows import channel_rows
from strainsight.gauges.walk import skin_of
from strainsight.mesh.facets import LOWER, UPPER, exterior_facets
from strainsight.mesh.kinds import facet_of
from strainsight.mesh.laminates import Lamina, Laminate, Ply
from strainsight.mesh.model import Material, Mesh, Region
from strainsight.mesh.shell_faces import with_faces
from strainsight.mesh.thin import ShellBlock, ShellSection

from ..shared import slowly
from .second_order import KINDS, curved, cylinder, hemisphere, on_line, plate, roof, square, straight, twisted
from .shell_models import unit_square

ATOL = 2e-3

STRAIGHT = {
    ("quad8", "regular"): (0.999, 0.987, 0.990, 0.945),
    ("quad8", "trapezoids"): (1.000, 0.971, 0.992, 0.945),
    ("quad8", "parallelograms"): (1.000, 0.987, 0.992, 0.945),
    ("tri6", "regular"): (0.997, 0.983, 0.992, 0.946),
    ("tri6", "trapezoids"): (0.997, 0.896, 0.989, 0.931),
    ("tri6", "parallelograms"): (0.998, 0.953, 0.992, 0.946),
}


@pytest.mark.parametrize(("kind", "shape"), STRAIGHT)
def test_straight_cantilever(kind, shape):
    np.testing.assert_allclose(straight(kind, shape), STRAIGHT[kind, shape], atol=ATOL)


@pytest.mark.parametrize("kind", KINDS)
def test_fine_meshes_of_the_straight_cantilever_tend_to_beam_theory(kind):
    """With four rows: bending within 1 %, twist within 1 % of Saint-Venant's, 6/(G J) with J = 0.229 b t³ at b/t = 2."""
    expected = np.array([1, 1, 1, 6 / (1e7 / 2.6 * 0.229 * 0.2 * 0.1**3) / 0.03208])
    np.testing.assert_allclose(straight(kind, "regular", 24, 4) / expected, 1.0, atol=0.01)


def test_curved_beam():
    np.testing.assert_allclose(curved("quad8"), (1.006, 0.957), atol=ATOL)
    np.testing.assert_allclose(curved("tri6"), (1.012, 0.950), atol=ATOL)
    for kind in KINDS:
        np.testing.assert_allclose(curved(kind, 24, 4), (1.0, 1.0), atol=0.02)


@pytest.mark.parametrize("kind", KINDS)
def test_twisted_beam(kind):
    """Within 0.5 % with the 12 × 2 elements of the paper, within 1.1 % with 6 × 1."""
    np.testing.assert_allclose(twisted(kind), (1.0, 1.0), atol=0.005)
    np.testing.assert_allclose(twisted(kind, 6, 1), (1.0, 1.0), atol=0.011)


PLATES = {
    ("simple", "uniform"): ((4.062, 12.97), (0.998, 1.009), (1.000, 1.001)),
    ("simple", "point"): ((11.60, 16.96), (0.995, 0.948), (0.994, 0.888)),
    ("clamped", "uniform"): ((1.26, 2.56), (0.998, 1.018), (1.001, 1.020)),
    ("clamped", "point"): ((5.60, 7.23), (0.991, 0.977), (0.985, 0.754)),
}
"""Deflections of plates 2 × 2 and 2 × 10 by theory, and over it those of quads and triangles, 4 × 4 for a quarter. The theory
of the uniform load on clamped ones has three digits: finer meshes tend to 1.004 and 1.017."""


@pytest.mark.parametrize(("support", "load"), PLATES)
def test_rectangular_plates(support, load):
    for long, theory, *found in zip((2.0, 10.0), *PLATES[support, load], strict=True):
        for kind, ratio in zip(KINDS, found, strict=True):
            assert plate(kind, 4, long, support, load) / theory == pytest.approx(ratio, abs=ATOL)


SURFACES = {
    (roof, "quad8"): {2: 0.981, 3: 0.995, 4: 0.995, 5: 0.995},
    (roof, "tri6"): {2: 0.794, 3: 0.937, 4: 0.973, 5: 0.986},
    (hemisphere, "quad8"): {4: 0.839, 6: 0.976, 8: 0.990},
    (hemisphere, "tri6"): {4: 0.840, 6: 0.921, 8: 0.956, 16: 0.990},
    (cylinder, "quad8"): {4: 0.948, 8: 0.989, 16: 1.004},
    (cylinder, "tri6"): {4: 0.812, 8: 0.931, 16: 0.990},
}
"""By elements a side, of twice as many spaces between nodes."""


@pytest.mark.parametrize(("problem", "kind"), [*list(SURFACES)[:-1], *slowly((cylinder, "tri6"))])
def test_curved_surfaces(problem, kind):
    """The finest mesh is within 2 % of the reference."""
    table = SURFACES[problem, kind]
    found = [problem(kind, n) for n in table]
    np.testing.assert_allclose(found, list(table.values()), atol=ATOL)
    assert abs(found[-1] - 1) <= 0.02


E, NU, RHO, T = 2.0e11, 0.3, 7800.0, 0.01
L, B = 1.0, 0.1
OFF_CENTRE = {"quad8": 0.03, "tri6": 0.03}


def panel(kind, n, m, place, section=None, offset=0.0, **more):
    """Shells over 0 … 1 squared, clamped at a = 0; place: a, b → x (n, 3). The mesh, a and b of its own nodes."""
    a, b, cells = square(n, m, kind) if kind in KINDS else unit_square(n, m, kind)
    e = len(cells)
    block = ShellBlock(kind, np.arange(1, e + 1), cells, np.ones(e, int), np.full(e, offset), np.tile([1.0, 0, 0], (e, 1)))
    fixed = np.array([(i, c) for i in np.flatnonzero(a == 0) for c in range(6)])
    mesh = Mesh(
        np.arange(1, len(a) + 1),
        place(a, b),
        (),
        {1: Region(1, "PSHELL 1", 1)},
        {1: Material(1, E, NU, RHO)},
        fixed,
        shells=(block,),
        sections={1: section or ShellSection(T)},
        **more,
    )
    return with_faces(mesh), a, b


def flat(a, b):
    return np.column_stack([L * a, B * b, 0 * a])


def ends(mesh, a, b, force, moment=None):
    """Displacements under a force and a moment (3,) on the line a = 1, constant along it."""
    model, share = build_model(mesh), on_line(a == 1, b)
    f = np.zeros(model.constraint.transform.shape[0])
    for node in np.flatnonzero(share):
        f[3 * node : 3 * node + 3] += share[node] * np.array(force)
        if moment is not None:
            f[model.constraint.rotations(np.array([node]))[0]] += share[node] * np.array(moment)
    return nodal(model, spsolve(model.stiffness.constant.tocsc(), model.constraint.transform.T @ f)[:, None])


@pytest.mark.parametrize("kind", KINDS)
def test_gauges_of_any_angle_read_membrane_and_bending_on_both_faces(kind):
    """Pulled by F and bent by M about y with ν = 0: ε_xx = F/(E A) ± M t/(2 E I), and ε cos² α along α, everywhere."""
    mesh, a, b = panel(kind, 4, 1, flat)
    mesh = replace(mesh, materials={1: Material(1, E, 0.0, RHO)})
    F, M = 2e3, 5.0
    z = ends(mesh, a, b, (F, 0, 0), (0, M, 0))
    facets = exterior_facets(mesh)
    for side, sign in ((UPPER, 1), (LOWER, -1)):
        pool = candidates(mesh, facets.some(facets.facet == side), axis=np.array([1.0, 0, 0]), angles=(0, 30, 45, 90))
        expected = (F / (E * B * T) + sign * M * T / 2 / (E * B * T**3 / 12)) * np.cos(np.radians(pool.angle)) ** 2
        np.testing.assert_allclose(channel_rows(mesh.position, pool, z)[:, 0], expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("kind", KINDS)
def test_a_bent_arc_has_the_same_strain_everywhere_on_its_faces(kind):
    """A strip along an arc of 60°, R/t = 100, four elements, bent by moments at its end with ν = 0: ± M t/(2 E I) to 0.8 % at
    the middle and off it. The functions of the facets alone have 2 to 17 % more or less there."""
    R = 1.0

    def arc(a, b):
        return np.column_stack([R * np.sin(np.pi / 3 * a), 0.1 * b, R * np.cos(np.pi / 3 * a)])

    mesh, a, b = panel(kind, 4, 1, arc)
    mesh = replace(mesh, materials={1: Material(1, E, 0.0, RHO)})
    z = ends(mesh, a, b, (0, 0, 0), (0, 1.0, 0))
    expected = T / 2 / (E * 0.1 * T**3 / 12)
    facets = exterior_facets(mesh)
    strain = (facet_strain(mesh, facets).matrix @ z[:, 0]).reshape(-1, 6)
    sign = np.where(facets.facet == UPPER, 1, -1)
    bent = sign * (strain[:, 0] + strain[:, 2])  # trace in the plane of the arc: no strain across it
    np.testing.assert_allclose(bent, expected, rtol=8e-3)
    skin = skin_of(mesh.position, facets.some(facets.facet == UPPER))
    pool = candidates(mesh, skin.facets, axis=np.array([0.0, 1, 0]), angles=(90,))
    corners = np.array([[-0.8, 0.1]] if kind == "quad8" else [[0.1, 0.6]])
    N = facet_of(kind).shape(corners)[0]
    x = np.einsum("k,mkc->mc", N, mesh.position[pool.nodes[:, : len(N)]])
    around = np.stack([x[:, 2], 0 * x[:, 0], -x[:, 0]], axis=1)
    around /= np.linalg.norm(around, axis=1)[:, None]
    moved = replace(pool, local=np.repeat(corners, len(pool.local), axis=0), direction=around)
    np.testing.assert_allclose(channel_rows(mesh.position, moved, z)[:, 0], expected, rtol=OFF_CENTRE[kind])


@pytest.mark.parametrize("kind", KINDS)
def test_a_clicked_place_on_a_curved_face_is_found(kind):
    """A point of a cylinder, half the thickness above it, lies on the upper face to a thousandth of the radius."""

    def arc(a, b):
        return np.column_stack([np.sin(a), b, np.cos(a)])

    mesh, *_ = panel(kind, 4, 4, arc)
    skin = skin_of(mesh.position, exterior_facets(mesh))
    place = (1 + T / 2) * np.array([[np.sin(0.37), 0, np.cos(0.37)]]) + [[0, 0.41, 0]]
    found = locate(skin, place)
    assert found.distance[0] < 1e-4
    assert skin.facets.facet[found.facet[0]] == UPPER


@pytest.mark.parametrize("kind", KINDS)
def test_mass_centre_offset_and_what_is_not_of_the_material(kind):
    mesh, *_ = panel(kind, 3, 2, flat, ShellSection(T, nonstructural=3.0), offset=0.02)
    mass, centre = mass_properties(mesh)
    assert mass == pytest.approx(RHO * L * B * T + 3.0 * L * B)
    np.testing.assert_allclose(centre, [L / 2, B / 2, 0.02], atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_laminates_move_as_those_of_many_linear_shells(kind):
    """[0/30] bends when it is pulled: its tip under a force along x, and its first frequencies, are within 1.2 % of 48 × 6
    quads of four nodes."""
    lamina = Lamina(5, 1.3e11, 9e9, 0.3, 5e9, 5e9, 3e9, 1600.0)
    section = Laminate((Ply(5, 0.004, 0.0), Ply(5, 0.006, 30.0)), 0.0)
    found = {}
    for own, n, m in ((kind, 8, 1), ("quad4", 48, 6)):
        mesh, a, b = panel(own, n, m, flat, section, laminae={5: lamina})
        model = build_model(mesh)
        frequency, _ = modes(model.stiffness.constant, model.mass.constant, 3)
        middle = np.flatnonzero((a == 1) & (b == 0.5))[0]
        share = np.zeros(len(a))
        share[(a == 1) & (b % 1 == 0)] = 0.5
        f = np.zeros(model.constraint.transform.shape[0])
        f[3 * np.flatnonzero(share)] = 0.5
        z = nodal(model, spsolve(model.stiffness.constant.tocsc(), model.constraint.transform.T @ f)[:, None])
        found[own] = np.array([z[3 * middle + 2, 0], *frequency])
    np.testing.assert_allclose(found[kind], found["quad4"], rtol=1.2e-2)


@pytest.mark.parametrize("kind", KINDS)
def test_stiffness_and_mass_are_affine_in_modulus_and_density(kind):
    mesh, *_ = panel(kind, 2, 1, flat)
    parameters = (Parameter("E", "youngs_modulus", (1,), E), Parameter("rho", "density", (1,), RHO))
    model, theta = build_model(mesh, parameters), {"E": 1.3 * E, "rho": 0.8 * RHO}
    other = build_model(replace(mesh, materials={1: Material(1, 1.3 * E, NU, 0.8 * RHO)}))
    for own, whole in ((model.stiffness, other.stiffness), (model.mass, other.mass)):
        at = own.at({name: theta[name] for name in own.parameters})
        assert abs(at - whole.constant).max() < 1e-12 * abs(whole.constant).max()
