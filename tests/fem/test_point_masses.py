"""A point mass with offset and inertia is the rigid body it stands for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import DeckError
from strainsight.fem.mass import mass_properties
from strainsight.fem.model import build_model, nodal
from strainsight.mesh.joins import PointMass, RigidElement

OFFSET = np.array([0.3, -0.2, 0.5])
INERTIA = np.array([[2.0, 0.3, -0.1], [0.3, 1.5, 0.2], [-0.1, 0.2, 1.0]]) * 1e3


@pytest.fixture(scope="module")
def bar(box):
    """A bar whose tip follows node 900; 901 lies off it."""
    mesh = box("hex8", (3, 1, 1), size=(3.0, 1.0, 1.0), clamp_root=True)
    n = len(mesh.position)
    tip = np.flatnonzero(np.isclose(mesh.position[:, 0], 3.0))
    reference = np.array([3.2, 0.6, 0.4])
    return replace(
        mesh,
        node_ids=np.append(mesh.node_ids, [900, 901]),
        position=np.vstack([mesh.position, reference, reference + OFFSET]),
        rigid=(RigidElement(1, n, tip, (0, 1, 2)),),
    )


def mass_of(mesh):
    return build_model(mesh).mass.constant.toarray()


@pytest.mark.parametrize("inertia", [np.zeros((3, 3)), INERTIA])
@pytest.mark.parametrize("components", [(0, 1, 2), (0, 1, 2, 3, 4, 5)])
def test_an_offset_is_a_rigid_arm(bar, inertia, components):
    """To a node that follows in rotation too where it has inertia."""
    n = len(bar.position) - 2
    with_offset = replace(bar, point_masses=(PointMass(4, n, 500.0, OFFSET, inertia),))
    arm = RigidElement(2, n, np.array([n + 1]), components)
    on_arm = replace(bar, rigid=(*bar.rigid, arm), point_masses=(PointMass(4, n + 1, 500.0, inertia=inertia),))
    expected, found = mass_of(with_offset), mass_of(on_arm)
    lost = inertia.any() and len(components) == 3
    assert np.allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max()) != lost


def test_energy_of_a_turning_body_has_its_inertia_and_that_of_its_centre(bar):
    """ωᵀJω + m |ω × (x + d)|² beside that of the bar."""
    free = replace(bar, fixed=np.zeros((0, 2), dtype=np.int64), position=bar.position - 1.0)
    n = len(bar.position) - 2
    heavy = build_model(replace(free, point_masses=(PointMass(4, n, 500.0, OFFSET, INERTIA),)), supported=False)
    plain = build_model(free, supported=False)
    omega = np.array([0.3, -0.8, 0.5])
    z = np.zeros(heavy.constraint.transform.shape[0])
    z[: 3 * len(free.position)] = np.cross(omega, free.position).ravel()
    z[heavy.constraint.reference_rows[n] :][:3] = omega
    z = z[heavy.constraint.free_rows]
    np.testing.assert_allclose(
        nodal(heavy, z[:, None])[: 3 * n, 0], np.cross(omega, free.position[:n]).ravel(), atol=1e-13
    )
    centre = free.position[n] + OFFSET
    expected = omega @ INERTIA @ omega + 500.0 * np.sum(np.cross(omega, centre) ** 2)
    assert z @ (heavy.mass.constant - plain.mass.constant) @ z == pytest.approx(expected, rel=1e-12)


def test_a_node_without_rotations_takes_the_mass_only(bar):
    node = int(np.flatnonzero(np.isclose(bar.position[:, 0], 1.0))[0])
    at_node = PointMass(4, node, 500.0)
    off = replace(at_node, offset=OFFSET, inertia=INERTIA)
    expected = mass_of(replace(bar, point_masses=(at_node,)))
    np.testing.assert_array_equal(mass_of(replace(bar, point_masses=(off,))), expected)
    difference = expected - mass_of(bar)
    assert np.trace(difference) == pytest.approx(3 * 500.0)
    assert np.count_nonzero(np.abs(difference) > 1e-6) == 3


def test_the_centre_of_mass_is_that_of_all_parts(bar):
    n = len(bar.position) - 2
    masses = (PointMass(4, n, 500.0, OFFSET, INERTIA), PointMass(5, 3, 20.0))
    mass, centre = mass_properties(replace(bar, point_masses=masses))
    parts = [(3 * 7850.0, np.array([1.5, 0.5, 0.5])), (500.0, bar.position[n + 1]), (20.0, bar.position[3])]
    assert mass == pytest.approx(sum(m for m, _ in parts), rel=1e-12)
    np.testing.assert_allclose(centre, sum(m * x for m, x in parts) / mass, rtol=1e-12)


def test_bodies_that_cannot_be_are_refused(bar):
    n = len(bar.position) - 2
    with pytest.raises(DeckError, match="point mass 4 is -1 kg"):
        build_model(replace(bar, point_masses=(PointMass(4, n, -1.0),)))
    skew = np.eye(3) + np.eye(3, k=1)
    with pytest.raises(DeckError, match="the inertia of point mass 4 is not symmetric"):
        build_model(replace(bar, point_masses=(PointMass(4, n, 1.0, inertia=skew),)))
