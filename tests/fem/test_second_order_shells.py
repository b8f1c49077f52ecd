"""Shells of the second order: curved sides and surfaces, and structures of them: gauges, mass, laminates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from strainsight.errors import DeckError
from strainsight.fem.model import build_model, nodal
from strainsight.fem.recovery import facet_strain
from strainsight.fem.shells import shell_masses, shell_stiffnesses
from strainsight.fem.shells.matrices import Resistance
from strainsight.mesh.facets import LOWER, UPPER, exterior_facets
from strainsight.mesh.kinds import facet_of
from strainsight.mesh.model import Material
from strainsight.mesh.thin import ShellSection
from strainsight.mesh.thin_faces import with_faces
from strainsight.sensors.candidates import candidates
from strainsight.sensors.strain_operator import channel_rows
from strainsight.sensors.surface_paths import skin_of

from .shell_models import SECOND, isotropic, on_line, rigid_motions, rows, sheet, stiffness, summed, unit_square
from .test_shell_elements import bent, motions


@pytest.mark.parametrize("kind", SECOND)
def test_bent_patches_with_curved_sides_tend_to_constant_curvature(kind):
    """Energy of bending and twist with every side inside bowed by a tenth of it, however thin the plate is, the outline held in
    the state: 6e-4 too large at most with 4 × 4, 1e-4 with 16 × 16 elements."""

    def error(n: int, t: float) -> float:
        a, b, cells = unit_square(n, n, kind)
        middle = ((2 * n * a) % 2 == 1) | ((2 * n * b) % 2 == 1)
        outline = (a % 1 == 0) | (b % 1 == 0)
        bow = np.where(middle & ~outline, 0.1 / n, 0.0)
        xy = np.column_stack([a + bow * np.sin(31 * b), b + bow * np.cos(17 * a)])
        kappa = np.array([0.02, -0.05, 0.06])
        K = stiffness(np.column_stack([xy, 0 * a]), cells, 1.0, 0.25, t)
        u = motions(xy, np.zeros(3), kappa).ravel()
        held, free = rows(outline), rows(~outline)
        u[free] = spsolve(K[free][:, free], -K[free][:, held] @ u[held])
        D = isotropic(1.0, 0.25, t, 1)[2][0]
        return float(u @ K @ u / (kappa @ D @ kappa) - 1)

    assert 0 <= error(4, 1e-2) < 6e-4
    assert 0 <= error(4, 1e-3) < 7e-4
    assert 0 <= error(16, 1e-2) < 1e-4


def test_quads_bend_in_their_plane_as_a_beam_whatever_their_corners():
    """u = κ x y, v = −κ(x² + ν y²)/2 on trapezoids: ε_xx = κ y, and inner nodes follow those of the outline."""
    a, b, cells = unit_square(4, 2, "quad8")
    x = np.column_stack([4 * a + np.interp(4 * a, range(5), [0, 0.3, -0.3, 0.3, 0]) * (1 - 2 * b), 2 * b - 1, 0 * a])
    nu, kappa = 0.3, 0.2
    K = stiffness(x, cells, 1.0, nu, 0.01)
    X, Y = x[:, 0], x[:, 1]
    exact = np.zeros((len(x), 6))
    exact[:, 0], exact[:, 1], exact[:, 5] = kappa * X * Y, -kappa * (X**2 + nu * Y**2) / 2, -kappa * X
    outline = (a % 1 == 0) | (b % 1 == 0)
    held, free = rows(outline), rows(~outline)
    u = exact.ravel().copy()
    u[free] = spsolve(K[free][:, free], -K[free][:, held] @ u[held])
    np.testing.assert_allclose(u, exact.ravel(), atol=1e-9)


@pytest.mark.parametrize("kind", SECOND)
def test_nothing_locks_however_thin_it_is(kind):
    """Deflections times t³ of a clamped cylinder's panel under a moment along its end, which bends without stretch."""
    a, b, cells = unit_square(4, 2, kind)
    x = np.column_stack([np.sin(a), 0.5 * b, np.cos(a)])
    found = []
    for t in (1e-2, 1e-3, 1e-4):
        K = stiffness(x, cells, 1.0, 0.0, t)
        f = np.zeros((len(x), 6))
        f[a == 1, 4] = 1.0
        free = np.setdiff1d(np.arange(6 * len(x)), rows(a == 0))
        found.append(t**3 * f.ravel()[free] @ spsolve(K[free][:, free], f.ravel()[free]))
    np.testing.assert_allclose(found, found[0], rtol=2e-2)


def test_quads_and_triangles_have_the_mass_of_a_half_cylinder():
    """ρ t π R L to 1e-4 with six along the arc."""
    for kind in SECOND:
        a, b, cells = unit_square(6, 1, kind)
        x = np.column_stack([np.cos(np.pi * a), np.sin(np.pi * a), 2 * b])
        R = rigid_motions(x)[:, :3]
        e = len(cells)
        M = summed(shell_masses(x[cells], np.ones(e), np.zeros(e), np.zeros(e), np.arange(e)), cells, len(x))
        np.testing.assert_allclose(R.T @ (M @ R), 2 * np.pi * np.eye(3), atol=6e-4)


@pytest.mark.parametrize("kind", SECOND)
def test_what_is_folded_is_refused_by_its_id(kind):
    good = bent(kind) * [1, 1, 0]
    x = good.copy()
    x[len(x) // 2] = x[: len(x) // 2].mean(axis=0) * 2 - x[len(x) // 2]
    with pytest.raises(DeckError, match=r"folded shells of . nodes \(1 in total\): 12") as error:
        shell_stiffnesses(np.stack([good, x]), Resistance(*isotropic(1.0, 0.3, 0.1, 2)), np.zeros(2), np.array([11, 12]))
    assert error.value.entity == ("element", 12)


E, RHO, T = 2.0e11, 7800.0, 0.01
L, B = 1.0, 0.1
OFF_CENTRE = {"quad8": 0.03, "tri6": 0.03}


def panel(kind, n, m, place, section=ShellSection(T), nu=0.0, **more):  # noqa: B008
    """Clamped at a = 0: the mesh, a and b of its own nodes."""
    mesh = sheet(kind, n, m, place, section, Material(1, E, nu, RHO), axis=(1.0, 0.0, 0.0), **more)
    return with_faces(mesh), *unit_square(n, m, kind)[:2]


def flat(a, b):
    return np.column_stack([L * a, B * b, 0 * a])


def ends(mesh, a, b, force, moment=None):
    """Displacements under a force and a moment (3,) on the line a = 1, constant along it."""
    model, share = build_model(mesh), on_line(a == 1, b, "quad8")
    f = np.zeros(model.constraint.transform.shape[0])
    for node in np.flatnonzero(share):
        f[3 * node : 3 * node + 3] += share[node] * np.array(force)
        if moment is not None:
            f[model.constraint.rotations(np.array([node]))[0]] += share[node] * np.array(moment)
    return nodal(model, spsolve(model.stiffness.constant.tocsc(), model.constraint.transform.T @ f)[:, None])


@pytest.mark.parametrize("kind", SECOND)
def test_gauges_of_any_angle_read_membrane_and_bending_on_both_faces(kind):
    """Pulled by F and bent by M about y with ν = 0: ε_xx = F/(E A) ± M t/(2 E I), and ε cos² α along α, everywhere."""
    mesh, a, b = panel(kind, 4, 1, flat)
    F, M = 2e3, 5.0
    z = ends(mesh, a, b, (F, 0, 0), (0, M, 0))
    facets = exterior_facets(mesh)
    for side, sign in ((UPPER, 1), (LOWER, -1)):
        pool = candidates(mesh, facets.some(facets.facet == side), axis=np.array([1.0, 0, 0]), angles=(0, 30, 45, 90))
        expected = (F / (E * B * T) + sign * M * T / 2 / (E * B * T**3 / 12)) * np.cos(np.radians(pool.angle)) ** 2
        np.testing.assert_allclose(channel_rows(mesh.position, pool, z)[:, 0], expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("kind", SECOND)
def test_a_bent_arc_has_the_same_strain_everywhere_on_its_faces(kind):
    """A strip along an arc of 60°, R/t = 100, four elements, bent by moments at its end with ν = 0: ± M t/(2 E I) to 0.8 % at
    the middle and off it. The functions of the facets alone have 2 to 17 % more or less there."""
    R = 1.0

    def arc(a, b):
        return np.column_stack([R * np.sin(np.pi / 3 * a), 0.1 * b, R * np.cos(np.pi / 3 * a)])

    mesh, a, b = panel(kind, 4, 1, arc)
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
