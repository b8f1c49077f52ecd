"""The inertia of a body in natural coordinates is that of its particles."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strainsight.errors import InfeasibleError
from strainsight.multibody.bodies import RigidBody, mass_matrix
from strainsight.multibody.inertia import as_inertia, inertia_load


@pytest.fixture
def motion(random_particles):
    rng = np.random.default_rng(1)
    cloud = random_particles(rng, count=7, modes=4)
    q = np.concatenate(
        [rng.normal(size=3), Rotation.random(random_state=2).as_matrix().T.ravel(), 0.5 * rng.normal(size=4)]
    )
    return cloud, q, rng.normal(size=16), rng.normal(size=16)


def jacobians(cloud, q):
    """∂p/∂q (P, 3, s) by complex steps: exact."""
    columns = [cloud.places(q + 1e-30j * e).imag / 1e-30 for e in np.eye(len(q))]
    return np.stack(columns, axis=-1)


def test_inertia_load_is_the_sum_of_mass_times_acceleration_on_the_particles(motion):
    cloud, q, v, a = motion
    t = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    # p is of degree four in time along this path: five points give its second derivative exactly
    path = np.stack([cloud.places(q + v * s + 0.5 * a * s**2) for s in t])
    acceleration = 2 * np.polyfit(t, path.reshape(5, -1), 4)[2].reshape(-1, 3)
    J = jacobians(cloud, q)
    M, g, _, _ = inertia_load(as_inertia(0, cloud.invariants()), q, v, a)
    np.testing.assert_allclose(
        g, np.einsum("p,pis,pi->s", cloud.m, J, acceleration), rtol=0, atol=1e-11 * np.abs(g).max()
    )
    np.testing.assert_allclose(M, np.einsum("p,pis,pit->st", cloud.m, J, J), rtol=0, atol=1e-13 * np.abs(M).max())


def test_derivatives_of_the_inertia_load(motion):
    cloud, q, v, a = motion
    body = as_inertia(0, cloud.invariants())
    _, g, by_q, by_v = inertia_load(body, q, v, a)
    # g is a polynomial of degree three in q and one in v: these differences are exact
    e = 0.1
    for k, unit in enumerate(np.eye(16)):

        def at(s, u=unit):
            return inertia_load(body, q + s * u, v, a)[1]

        slope = (8 * (at(e) - at(-e)) - (at(2 * e) - at(-2 * e))) / (12 * e)
        np.testing.assert_allclose(by_q[:, k], slope, rtol=0, atol=1e-12 * np.abs(g).max())
        rate = (inertia_load(body, q, v + unit, a)[1] - inertia_load(body, q, v - unit, a)[1]) / 2
        np.testing.assert_allclose(by_v[:, k], rate, rtol=0, atol=1e-12 * np.abs(g).max())


def test_mass_of_a_rigid_body_gives_the_kinetic_energy_of_its_particles(motion):
    cloud, _, v, _ = motion
    M = mass_matrix(cloud.rigid("rock"))
    speeds = v[:3] + cloud.x @ v[3:12].reshape(3, 3)
    assert v[:12] @ M @ v[:12] == pytest.approx(cloud.m @ np.sum(speeds**2, axis=1), rel=1e-13)


@pytest.mark.parametrize(
    ("mass", "inertia", "told"),
    [
        (0.0, np.eye(3), "mass of 0 kg"),
        (-1.0, np.eye(3), "mass of -1 kg"),
        (1.0, np.diag([1.0, 1.0, 3.0]), "no distribution of mass"),
        (1.0, np.arange(9.0).reshape(3, 3), "symmetric"),
    ],
)
def test_impossible_rigid_bodies_are_refused(mass, inertia, told):
    with pytest.raises(InfeasibleError, match=told):
        RigidBody("stone", mass, np.zeros(3), inertia)


def test_inertia_about_the_centre_instead_of_the_origin_is_refused():
    with pytest.raises(InfeasibleError, match="not the centre of mass"):
        RigidBody("rod", 1.0, np.array([0.5, 0, 0]), np.diag([0, 1 / 12, 1 / 12]))
