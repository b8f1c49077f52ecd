"""Bodies on springs: natural frequencies of rigid bodies and chains by hand, and what still moves freely."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from strainsight.errors import DeckError, UserError
from strainsight.fem.affine import Parameter
from strainsight.fem.model import build_model
from strainsight.fem.modes import modes
from strainsight.gauges.clearance import obstacles
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.joins import RigidElement, Springs
from strainsight.mesh.scaling import scaled
from strainsight.mesh.suspension import face_springs, node_springs
from strainsight.mesh.units import to_si
from strainsight.rom.snapshots import only_scales

from ..bodies import RHO, body, held, with_nodes
from ..fem.test_traction import named
from ..mesh.boxes import both
from ..solids import SOLIDS

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


def test_what_springs_leave_free_is_named():
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


def test_a_spring_on_a_rotation_that_is_not_there_is_named():
    mesh = rigid()
    one = Springs("CELAS2 9", np.ones(1), np.zeros(1, int), np.zeros(1, int), np.array([4]), np.ones(1))
    with pytest.raises(DeckError, match="CELAS2 9 acts on rotations of node 1, which has none"):
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


def test_the_error_of_a_free_body_says_which_soft_springs_would_do():
    mesh = named(rigid(stiffer=1.0), bottom=(0, 0, 0))
    with pytest.raises(UserError, match="can move freely") as caught:
        build_model(mesh)
    k, first = (
        float(word) for word in re.findall(r"stiffness: (\S+)`.*first elastic mode, (\S+) Hz", caught.value.remedy)[0]
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
        (("foundation",), ("f*", "right"), "parameters a and b are both the stiffness of the spring foundation", "keep one"),
        (("idle",), ("left",), "the springs of parameter a have no stiffness", "name others"),
    ],
)  # fmt: skip
def test_springs_of_parameters_are_there_and_of_one_parameter_each(first, second, what, remedy):
    mesh = face_springs_on_two_ends()
    mesh = replace(mesh, springs=(*mesh.springs, replace(mesh.springs[0], name="idle", stiffness=0 * mesh.springs[0].stiffness)))
    own = [Parameter(name, "stiffness_factor", (), 1.0, springs) for name, springs in (("a", first), ("b", second))]
    with pytest.raises(UserError, match=re.escape(what)) as error:
        build_model(mesh, own)
    assert remedy in error.value.remedy
