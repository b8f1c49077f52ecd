"""Loads on faces against Lamé and Saint-Venant, a pin that bears by the cosine; bodies on springs, and what moves freely."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from strainsight.errors import DeckError, UserError
from strainsight.fem.affine import Parameter
from strainsight.fem.factorisation import factorise
from strainsight.fem.loads import (
    MISALIGNMENTS,
    PointLoad,
    input_shape,
    misaligned_shape,
    misalignment_shapes,
    nodal_forces,
)
from strainsight.fem.model import build_model, nodal
from strainsight.fem.modes import modes
from strainsight.mesh.additions import face_springs, node_springs, with_face
from strainsight.mesh.connectivity import merged
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.joins import RigidElement, Springs
from strainsight.mesh.units import scaled, to_si
from strainsight.rom.reduction import only_scales
from strainsight.sensors.edges import obstacles
from strainsight.sensors.faces import Pick, faces_of, picked

from ..bodies import NU, RHO, E, body, held, with_nodes
from ..mesh.boxes import both
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
    with pytest.raises(UserError, match="points out of the material everywhere on face"):
        nodal_forces(mesh, PointLoad("pin", node_set="top", bearing=(0, 0, 1.0)))


@pytest.mark.parametrize("load", [{"pressure": True}, {"bearing": (1.0, 0, 0)}])
def test_pressure_load_requires_a_face(bored, load):
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


SIZE = np.array([2.0, 1.0, 1.5])
MASS = RHO * SIZE.prod()
K = np.array([3.0e5, 2.0e5, 5.0e5])


def rigid(kind="hex8", stiffer=1e3):
    """A box of nearly no strain, about the middle of its bottom."""
    mesh = body(kind, (2, 1, 1), lambda u, v, w: (u - 1, v - 0.5, 1.5 * w))
    material = replace(mesh.materials[1], youngs_modulus=stiffer * mesh.materials[1].youngs_modulus)
    return replace(mesh, materials={1: material})


def frequencies(mesh, count=6):
    model = build_model(mesh)
    return modes(model.stiffness.constant, model.mass.constant, count)[0]


def of_rigid_body(k, K_turn, arm):
    """√(k/m) of a body whose centre lies `arm` above the middle of its springs: 2 × 2 for each of x and y with the turn about
    the other, z and the turn about z alone; K_turn (3,) about that middle."""
    J = MASS / 12 * (SIZE @ SIZE - SIZE**2)
    found = [k[2] / MASS, K_turn[2] / J[2]]
    for c, other, sign in ((0, 1, -1), (1, 0, 1)):
        stiffness = np.array([[k[c], sign * arm * k[c]], [sign * arm * k[c], K_turn[other] + arm**2 * k[c]]])
        found += eigh(stiffness, np.diag([MASS, J[other]]), eigvals_only=True).tolist()
    return np.sqrt(np.sort(found)) / (2 * np.pi)


def swings_on(mesh, springs, square):
    """Frequencies of the box on springs below it, whose mean squares along x and y are these."""
    turn = [K[2] * square[1], K[2] * square[0], K[0] * square[1] + K[1] * square[0]]
    found = frequencies(replace(mesh, springs=(springs,)))
    np.testing.assert_allclose(found, of_rigid_body(K, turn, SIZE[2] / 2), rtol=2e-5)


@pytest.mark.parametrize("kind", list(SOLIDS))
def test_a_box_on_a_bed_of_springs_swings_as_a_rigid_body(kind):
    """K_turn = ∫ k/A r² dA over the bottom of 2 × 1 m, whatever meshes it."""
    mesh = named(rigid(kind), bottom=(0, 0, 0))
    swings_on(mesh, face_springs(mesh, "bed", "bottom", K.tolist()), SIZE**2 / 12)


def test_springs_at_four_corners_share_the_stiffness():
    mesh = rigid()
    x = mesh.position
    corners = np.flatnonzero((np.abs(x[:, 0]) == 1) & (x[:, 2] == 0))
    assert len(corners) == 4
    swings_on(mesh, node_springs("bungees", corners, [*K, 0, 0, 0]), SIZE**2 / 4)


def test_a_spring_may_act_on_a_node_that_turns_with_a_reference_node():
    mesh, turn = rigid(), np.array([4.0e5, 6.0e5, 5.0e5])
    n, bottom = len(mesh.position), np.flatnonzero(mesh.position[:, 2] == 0)
    mesh = replace(
        with_nodes(mesh, [0.3, 0.1, -1.0], [0, 0, 0]),
        rigid=(RigidElement(1, n, bottom, (0, 1, 2)), RigidElement(2, n, np.array([n + 1]), (0, 1, 2, 3, 4, 5))),
        springs=(node_springs("mount", np.array([n + 1]), [*K, *turn]),),
    )
    np.testing.assert_allclose(frequencies(mesh), of_rigid_body(K, turn, SIZE[2] / 2), rtol=2e-5)


def test_a_part_between_springs_is_free_without_one_of_them():
    first = rigid()
    n = len(first.position)
    mesh = both(first, replace(first, position=first.position + np.array([0, 0, 5])))
    mesh = held(mesh, np.arange(2 * n) < n)
    ends, axes = np.flatnonzero((np.abs(first.position[:, 0]) == 1) & (first.position[:, 2] == 0)), range(3)
    pairs = [(node, c) for node in ends for c in axes]
    between = Springs(
        "between",
        np.ones(len(pairs)),
        np.repeat(np.arange(len(pairs)), 2),
        np.array([[node, node + n] for node, _ in pairs]).ravel(),
        np.repeat([c for _, c in pairs], 2),
        np.tile([1.0, -1.0], len(pairs)),
    )
    build_model(replace(mesh, springs=(between,)))
    without = between.stiffness * np.array([c != 1 for _, c in pairs])
    with pytest.raises(UserError, match=f"translation y of the part with node {n + 1}"):
        build_model(replace(mesh, springs=(replace(between, stiffness=without),)))


def test_free_motions_of_sprung_body_are_reported():
    mesh = rigid()
    corners = np.flatnonzero(mesh.position[:, 2] == 0)
    for k, words in (([0, 0, 1.0], "translation x, translation y, rotation about z"), ([1.0, 1.0, 0], "translation z")):
        with pytest.raises(UserError, match="can move freely") as caught:
            build_model(replace(mesh, springs=(node_springs("s", corners, [*k, 0, 0, 0]),)))
        assert all(word in caught.value.what for word in words.split(", "))
    soft = node_springs("s", corners, [1e-3] * 3 + [0] * 3)
    build_model(replace(mesh, springs=(soft,)))
    with pytest.raises(UserError, match="can move freely"):
        build_model(replace(mesh, springs=(replace(soft, stiffness=0 * soft.stiffness),)))


def test_spring_on_missing_rotation_is_refused():
    mesh = rigid()
    one = Springs("CELAS2 9", np.ones(1), np.zeros(1, int), np.zeros(1, int), np.array([4]), np.ones(1))
    with pytest.raises(DeckError, match="CELAS2 9 acts on rotations of node 1, which has no rotations"):
        build_model(replace(mesh, springs=(node_springs("s", np.arange(8), [1.0] * 3 + [0] * 3), one)))


def test_units_and_size_leave_the_frequencies_of_a_body_what_they_are():
    """In mm and t all of ω² = k/m stays; a body s times as large has its frequencies over s."""
    mesh = rigid()
    three = np.array([0, 0, 1]), np.array([0, 0, 1]), np.array([0, 1, 2]), np.array([1.0, 0.5, 1.0])
    arm = Springs("arm", np.full(2, 1e5), *three)
    mesh = replace(mesh, springs=(node_springs("s", np.arange(4), [*K, 0, 0, 0]), arm))
    expected = frequencies(mesh)
    in_mm = replace(
        mesh,
        position=1e3 * mesh.position,
        materials={
            1: replace(mesh.materials[1], youngs_modulus=mesh.materials[1].youngs_modulus / 1e6, density=RHO / 1e12)
        },
        springs=tuple(replace(own, stiffness=own.stiffness / 1e3) for own in mesh.springs),
    )
    np.testing.assert_allclose(frequencies(to_si(in_mm, "mm", "t")), expected, rtol=1e-6)
    np.testing.assert_allclose(frequencies(scaled(mesh, 2.0)), expected / 2, rtol=1e-6)
    turning = Springs("t", np.ones(1), *[np.zeros(1, int)] * 2, np.array([4]), np.ones(1))
    lever = Springs("l", np.ones(1), np.zeros(2, int), np.zeros(2, int), np.array([0, 4]), np.array([1.0, 3.0]))
    si = to_si(replace(in_mm, springs=(turning, lever)), "mm", "t").springs
    assert si[0].stiffness[0] == pytest.approx(1e-3)  # N mm/rad
    assert si[1].stiffness[0] == pytest.approx(1e3)  # N/mm
    np.testing.assert_allclose(si[1].value, [1, 3e-3])
    assert scaled(replace(mesh, springs=(turning,)), 2.0).springs[0].stiffness[0] == 8


def test_error_of_free_body_suggests_soft_springs():
    mesh = named(rigid(stiffer=1.0), bottom=(0, 0, 0))
    with pytest.raises(UserError, match="can move freely") as caught:
        build_model(mesh)
    k, first = (
        float(word) for word in re.findall(r"stiffness: (\S+)`.*first elastic mode \((\S+) Hz", caught.value.remedy)[0]
    )
    free = build_model(mesh, supported=False)
    elastic = modes(free.stiffness.constant, free.mass.constant, 7, shift=-1e6)[0][6]
    assert first == pytest.approx(elastic, rel=0.01)
    assert np.sqrt(k / MASS) / (2 * np.pi) == pytest.approx(elastic / 10, rel=0.05)
    found = frequencies(replace(mesh, springs=(face_springs(mesh, "bed", "bottom", [k] * 3),)), 7)
    assert found[5] < 0.2 * found[6]
    assert found[6] == pytest.approx(elastic, rel=0.05)
    corners = np.flatnonzero(mesh.position[:, 2] == 0)
    with pytest.raises(UserError, match="can move freely") as caught:
        build_model(replace(mesh, springs=(node_springs("s", corners, [1.0, 1.0, 0, 0, 0, 0]),)))
    assert "soft springs" not in caught.value.remedy


def test_gauges_keep_clear_of_springs():
    mesh = rigid()
    facets = exterior_facets(mesh)
    sprung = replace(mesh, springs=(node_springs("s", np.array([0]), [1.0] * 3 + [0] * 3),))
    assert not len(obstacles(mesh, facets, np.zeros(0, int))["supports"])
    np.testing.assert_array_equal(obstacles(sprung, facets, np.zeros(0, int))["supports"][0, 0], mesh.position[0])


def test_stiffness_is_affine_in_the_factor_of_named_springs():
    """K(θ) is that of a mesh whose springs are stiffened; the others and the solid keep theirs."""
    mesh = face_springs_on_two_ends()
    s = Parameter("s", "stiffness_factor", (), 1.0, ("foundation",))
    E = Parameter("E", "youngs_modulus", (1,), mesh.materials[1].youngs_modulus)
    model = build_model(mesh, (s, E))
    assert not only_scales(model)
    stiffer = [replace(own, stiffness=1.7 * own.stiffness) if own.name == "foundation" else own for own in mesh.springs]
    softer = replace(mesh.materials[1], youngs_modulus=0.4 * E.reference)
    again = build_model(replace(mesh, springs=tuple(stiffer), materials={1: softer})).stiffness.constant
    K = model.stiffness.at({"s": 1.7, "E": 0.4 * E.reference})
    assert abs(K - again).max() < 1e-12 * abs(again).max()
    assert set(model.mass.terms) == set()


def face_springs_on_two_ends():
    mesh = rigid(stiffer=1.0)
    nodes = np.flatnonzero(mesh.position[:, 2] == 0)
    ends = [np.flatnonzero(mesh.position[:, 0] == x) for x in (-1.0, 1.0)]
    named = ("foundation", nodes), ("left", ends[0]), ("right", ends[1])
    return replace(mesh, springs=tuple(node_springs(name, own, [*K, 0, 0, 0]) for name, own in named))


@pytest.mark.parametrize(
    ("first", "second", "what", "remedy"),
    [
        (("foundations",), ("left",), "no spring 'foundations'", "did you mean foundation?"),
        (("foundation",), ("f*", "right"), "parameters a and b both define the stiffness of spring foundation", "Remove one"),
        (("idle",), ("left",), "the springs of parameter a have no stiffness", "name other springs"),
    ],
)  # fmt: skip
def test_springs_of_parameters_exist_and_have_one_parameter(first, second, what, remedy):
    mesh = face_springs_on_two_ends()
    mesh = replace(mesh, springs=(*mesh.springs, replace(mesh.springs[0], name="idle", stiffness=0 * mesh.springs[0].stiffness)))
    own = [Parameter(name, "stiffness_factor", (), 1.0, springs) for name, springs in (("a", first), ("b", second))]
    with pytest.raises(UserError, match=re.escape(what)) as error:
        build_model(mesh, own)
    assert remedy in error.value.remedy
