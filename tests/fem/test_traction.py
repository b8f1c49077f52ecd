"""Loads on faces: uniform stress, Lamé's tube, Saint-Venant's torsion, and a pin that bears by the cosine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.spatial.transform import Rotation

from strainsight.errors import UserError
from strainsight.fem.factorisation import factorise
from strainsight.fem.loads import PointLoad, input_shape, nodal_forces
from strainsight.fem.misaligned import MISALIGNMENTS, misaligned_shape, misalignment_shapes
from strainsight.fem.model import build_model, nodal
from strainsight.gauges.faces import Pick, faces_of, picked
from strainsight.mesh.additions import with_face
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.merging import merged

from ..bodies import NU, E, body, held
from ..solids import SOLIDS


def named(mesh, **near):
    """The mesh with faces named by a point each."""
    facets = exterior_facets(mesh)
    faces = faces_of(mesh.position, facets)
    for name, point in near.items():
        mesh = with_face(mesh, name, facets, picked(Pick(near=(point,)), faces, mesh.position, facets))
    return mesh


def displaced(mesh, load):
    model = build_model(mesh)
    return nodal(model, factorise(model.stiffness.constant).solve(input_shape(model, [load]))).reshape(-1, 3)


def shaken(u, v, w):
    """A bar of 2 × 1 × 1 m whose inner nodes are off the grid."""
    x = np.array([u / 2, v / 2, w / 2])
    inside = np.prod(np.sin(np.pi * x / [2, 1, 1]))
    return x + 0.06 * inside * np.array([1, -1, 0.5])


def rollers(mesh):
    x = mesh.position
    for axis in range(3):
        mesh = held(mesh, np.isclose(x[:, axis], 0), (axis,))
    return mesh


@pytest.mark.parametrize("kind", list(SOLIDS))
def test_a_force_spread_evenly_over_an_end_stretches_a_bar_uniformly(kind):
    """Whatever meshes it: u = F/(EA) (x, −ν y, −ν z), the patch test."""
    mesh = rollers(named(body(kind, (4, 2, 2), shaken), end=(2, 0.5, 0.5)))
    u = displaced(mesh, PointLoad("pull", (3.0, 0, 0), node_set="end"))
    np.testing.assert_allclose(u, mesh.position * [1, -NU, -NU] / E, atol=1e-9 * 2 / E)


def quarter_tube(inner, outer, around, across, along, length):
    """A quarter of a tube about z."""

    def chart(u, v, w):
        r, phi = inner + (outer - inner) * u / across, np.pi / 2 * v / around
        return r * np.cos(phi), r * np.sin(phi), length * w / along

    return body("hex20", (across, around, along), chart)


def test_pressure_in_a_bore_widens_a_tube_as_lame_says():
    """Plane strain, u(a) = (1 + ν) p a / E · (a²(1 − 2ν) + b²)/(b² − a²)  (Timoshenko and Goodier, 1970, art. 28)."""
    a, b = 1.0, 2.0
    mesh = named(quarter_tube(a, b, 6, 6, 1, 0.3), bore=(a * np.sqrt(0.5), a * np.sqrt(0.5), 0.15))
    x = mesh.position
    mesh = held(held(held(mesh, np.isclose(x[:, 1], 0), (1,)), np.isclose(x[:, 0], 0), (0,)), np.ones(len(x), bool), (2,))
    u = displaced(mesh, PointLoad("p", node_set="bore", pressure=True))
    at_bore = np.isclose(np.hypot(x[:, 0], x[:, 1]), a)
    expected = (1 + NU) * a / E * (a**2 * (1 - 2 * NU) + b**2) / (b**2 - a**2)
    np.testing.assert_allclose(np.hypot(*u[at_bore, :2].T), expected, rtol=1e-3)


def test_a_moment_on_the_end_of_a_round_bar_twists_it_as_saint_venant_says():
    """The traction ω × r is that of the theory, so that φ = M z/(G J) at every section, J = π (b⁴ − a⁴)/2."""
    a, b, length = 0.5, 1.0, 4.0

    def chart(u, v, w):
        r, phi = a + (b - a) * u / 2, 2 * np.pi * (v / 16)
        return r * np.cos(phi), r * np.sin(phi), length * w / 4

    seam = body("hex20", (2, 16, 4), chart)
    mesh = merged(seam, 1e-9)
    mesh = held(named(mesh, end=(0.75, 0, length)), np.isclose(mesh.position[:, 2], 0))
    u = displaced(mesh, PointLoad("T", node_set="end", moment=(0, 0, 5.0)))
    x = mesh.position
    r2 = x[:, 0] ** 2 + x[:, 1] ** 2
    turn = (x[:, 0] * u[:, 1] - x[:, 1] * u[:, 0]) / r2
    J, G = np.pi * (b**4 - a**4) / 2, E / (2 * (1 + NU))
    np.testing.assert_allclose(turn, x[:, 2] / (G * J), atol=2e-3 * length / (G * J))


@pytest.fixture(scope="module")
def bored():
    """A tube of bore 1 m about z, 0.5 m long, with its bore named."""

    def chart(u, v, w):
        r, phi = 1 + u / 2, 2 * np.pi * v / 24
        return r * np.cos(phi), r * np.sin(phi), 0.5 * w

    return named(merged(body("hex20", (2, 24, 1), chart), 1e-9), bore=(0, 0, 0.25))


def test_a_pin_bears_with_the_cosine_on_the_half_that_it_presses(bored):
    """p = 2 cos φ/(π R b) by the resultant ∫ p cos φ R b dφ = 1; moments of the forces as those of that pressure."""
    d = np.array([np.cos(0.3), np.sin(0.3), 0.0])
    own = nodal_forces(bored, PointLoad("pin", node_set="bore", bearing=tuple(2 * d)))
    x, f = bored.position[own.nodes], own.force
    np.testing.assert_allclose(f.sum(axis=0), d, atol=1e-3)
    assert f.sum(axis=0) @ d == pytest.approx(1, abs=1e-12)
    np.testing.assert_allclose(np.cross(x - [0, 0, 0.25], f).sum(axis=0), 0, atol=1e-3)
    pressing = (x / np.linalg.norm(x[:, :2], axis=1)[:, None]) @ d
    assert np.abs(f[pressing < -np.sin(np.pi / 12) - 1e-6]).max() < 1e-12  # beyond facets of 15° that the rim cuts

    def expected(power):
        def p(phi, z):
            return np.cos(phi) * 2 / (np.pi * 0.5) * np.cos(phi) * np.cos(phi) ** power

        return dblquad(p, 0, 0.5, -np.pi / 2, np.pi / 2)[0]

    for power in (0, 1, 2):
        found = np.sum((f @ d) * np.clip(pressing, 0, None) ** power)
        assert found == pytest.approx(expected(power), rel=0.01)


def test_a_pin_that_pulls_a_flat_face_from_outside_is_refused():
    mesh = named(body("hex8", (2, 2, 2), lambda *u: u), top=(1, 1, 2))
    with pytest.raises(UserError, match="is turned against the bearing load"):
        nodal_forces(mesh, PointLoad("pin", node_set="top", bearing=(0, 0, 1.0)))


@pytest.mark.parametrize("load", [{"pressure": True}, {"bearing": (1.0, 0, 0)}])
def test_what_presses_needs_an_area(bored, load):
    with pytest.raises(UserError, match="which has no area"):
        nodal_forces(bored, PointLoad("p", node_id=1, **load))


def test_a_pressure_cannot_be_misaligned_and_a_bearing_load_turns_as_a_whole(bored):
    mesh = held(bored, np.isclose(np.hypot(*bored.position[:, :2].T), 2))
    model = build_model(mesh)
    pin, pressed = PointLoad("pin", node_set="bore", bearing=(1.0, 0, 0)), PointLoad("p", node_set="bore", pressure=True)
    shapes = misalignment_shapes(model, [pin, pressed])
    assert shapes.shape[1:] == (2, MISALIGNMENTS)
    assert shapes.any(axis=(0, 2)).tolist() == [True, False]
    far = misaligned_shape(model, pressed, np.array([0.3, 0.2]), np.array([0.01, 0.02]))
    np.testing.assert_array_equal(far, input_shape(model, [pressed])[:, 0])
    small = 1e-6
    for i in range(MISALIGNMENTS):
        step = small * np.eye(MISALIGNMENTS)[i]
        moved = [misaligned_shape(model, pin, s * step[:2], s * step[2:]) for s in (1, -1)]
        np.testing.assert_allclose((moved[0] - moved[1]) / (2 * small), shapes[:, 0, i], atol=1e-8)


def test_loads_on_a_face_turn_with_the_body():
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    plain = named(body("tet10", (2, 2, 2), lambda *u: np.array(u)), top=(1, 1, 2))
    mesh = replace(plain, position=plain.position @ turn.T)
    for key, vector in (("direction", (1.0, 2.0, 0.5)), ("bearing", (0.1, 0.2, -1.0))):
        one = nodal_forces(plain, PointLoad("F", node_set="top", **{key: vector}))
        other = nodal_forces(mesh, PointLoad("F", node_set="top", **{key: tuple(turn @ vector)}))
        np.testing.assert_allclose(other.force, one.force @ turn.T, atol=1e-12)
