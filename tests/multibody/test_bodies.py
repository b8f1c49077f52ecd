"""Bodies: inertia, flexible bodies, and bodies that joints couple."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strainsight.errors import InfeasibleError
from strainsight.multibody.bodies import Frame, RigidBody, as_inertia, inertia_load, mass_matrix
from strainsight.multibody.coupled import coupled_modes, growth
from strainsight.multibody.forces import Gravity, PointForce
from strainsight.multibody.initial import Pose, state, static_equilibrium
from strainsight.multibody.joints import fixed, revolute
from strainsight.multibody.laws import follower_force, torsion
from strainsight.multibody.sensors import RelationSensor, readings
from strainsight.multibody.step import _joined, slopes, step
from strainsight.multibody.system import assemble

from .mechanisms import turned


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
        (1.0, np.diag([1.0, 1.0, 3.0]), "no mass distribution"),
        (1.0, np.arange(9.0).reshape(3, 3), "symmetric"),
    ],
)
def test_impossible_rigid_bodies_are_refused(mass, inertia, told):
    with pytest.raises(InfeasibleError, match=told):
        RigidBody("stone", mass, np.zeros(3), inertia)


def test_inertia_about_the_centre_instead_of_the_origin_is_refused():
    with pytest.raises(InfeasibleError, match="not about the centre of mass"):
        RigidBody("rod", 1.0, np.array([0.5, 0, 0]), np.diag([0, 1 / 12, 1 / 12]))


def continuous_poles(system, q, v, u, theta, h):
    """λ of ẋ = Fx from the derivative of one implicit Euler step, z = 1/(1 − hλ), where z ≠ 0."""
    z = np.linalg.eigvals(slopes(system, _joined([step(system, q, v, u, h, theta)])).A)
    z = z[np.abs(z) > 1e-6]
    return (1 - 1 / z) / h


@pytest.fixture
def beam(particles):
    """A free slender beam of unit EI, mass and length along x, deflection x², …, x¹¹ in y: frame fixed to its end."""
    x, weight = np.polynomial.legendre.leggauss(24)
    x, weight = 0.5 * (x + 1), 0.5 * weight
    powers = np.arange(2, 12)
    to_orthonormal = np.linalg.inv(np.linalg.qr(np.sqrt(weight)[:, None] * x[:, None] ** powers)[1])
    shapes = np.zeros((24, 3, 10))
    shapes[:, 1] = x[:, None] ** powers @ to_orthonormal
    bending = powers * (powers - 1) * x[:, None] ** (powers - 2) @ to_orthonormal
    K = bending.T @ (weight[:, None] * bending)
    places = np.zeros((24, 3))
    places[:, 0] = x
    # a little width gives the spin about the axis its inertia
    wide = np.concatenate([places + 1e-4 * np.array(side) for side in ([0, 0, 1], [0, 0, -1], [0, 1, 0], [0, -1, 0])])
    cloud = particles(np.tile(weight / 4, 4), wide, np.tile(shapes, (4, 1, 1)))
    return cloud.flexible("beam", K)


def test_free_beam_vibrates_at_the_free_free_frequencies(beam):
    system = assemble([beam])
    q, v = state(system, {"beam": Pose(np.array([1.0, 2.0, 3.0]))})
    poles = continuous_poles(system, q, v, np.zeros(0), np.zeros(0), 1e-3)
    frequency = np.sort(poles.imag[poles.imag > 1.0])
    np.testing.assert_allclose(frequency[:2], [4.7300407449**2, 7.8532046241**2], rtol=1e-5)
    assert np.abs(poles.real[np.abs(poles.imag) < 200]).max() < 1e-4 * frequency[0]


def test_built_in_beam_vibrates_at_the_cantilever_frequencies(beam):
    root = Frame("root", "beam", displacement=np.zeros((3, 10)), rotation=np.zeros((3, 10)))
    system = assemble([beam], [fixed("wall", Frame("ground"), root)])
    q, v = state(system, {})
    poles = continuous_poles(system, q, v, np.zeros(0), np.zeros(0), 1e-3)
    frequency = np.sort(poles.imag[poles.imag > 1e-3])
    np.testing.assert_allclose(frequency[:3], [1.8751040687**2, 4.6940911330**2, 7.8547574382**2], rtol=2e-5)


def test_clamped_body_steps_as_its_linear_equations(random_particles):
    rng = np.random.default_rng(2)
    cloud = random_particles(rng)
    K, C, phi = np.diag([20.0, 30.0, 50.0]) + 2, 0.1 * np.eye(3), rng.normal(size=(3, 3))
    body = cloud.flexible("hub", K, C, clamped=True)
    frame = Frame("tip", "hub", np.ones(3), np.eye(3), phi, np.zeros((3, 3)))
    system = assemble([body], [], [PointForce("F", frame, np.eye(3), ["x", "y", "z"])])
    q, v, u, h = rng.normal(size=3), rng.normal(size=3), rng.normal(size=3), 0.03
    new = step(system, q, v, u, h, np.zeros(0))
    M = body.mass
    velocity = np.linalg.solve(M + h * C + h * h * K, M @ v + h * (phi.T @ u - K @ q))
    np.testing.assert_allclose(new.v, velocity, rtol=1e-12)
    np.testing.assert_allclose(new.q, q + h * velocity, rtol=1e-12)


NONE = np.zeros(0)
G, LENGTH, INERTIA = 9.81, 0.4, 0.6


def pendulum(angle, damping=0.0):
    """2 kg at LENGTH from the pivot, standing at an angle from the x axis, gravity along −y."""
    bob = RigidBody("bob", 2.0, np.array([LENGTH, 0, 0]), np.diag([0.1, INERTIA, INERTIA]))
    wall, end = Frame("wall"), Frame("end", "bob")
    forces = [Gravity(np.array([0, -G, 0]))] + [torsion("oil", wall, end, 0.0, damping)] * (damping > 0)
    system = assemble([bob], [revolute("pivot", wall, end)], forces)
    return system, *state(system, {"bob": Pose(rotation=turned(angle))})


def test_a_hanging_pendulum_swings_and_one_on_its_head_falls_each_at_its_own_rate():
    omega = np.sqrt(2.0 * G * LENGTH / INERTIA)
    system, q, v = pendulum(-np.pi / 2)
    modes = coupled_modes(system, q, v, NONE, NONE)
    assert modes.frequency * 2 * np.pi == pytest.approx([omega], rel=1e-12)
    assert growth(system, modes) == (0.0, "")
    system, q, v = pendulum(np.pi / 2)
    modes = coupled_modes(system, q, v, NONE, NONE)
    np.testing.assert_allclose(modes.squares, [-(omega**2)], rtol=1e-12)
    rate, body = growth(system, modes)
    assert rate == pytest.approx(omega, rel=1e-10)
    assert body == "bob"


def test_damping_ratio_and_eigenvalues_are_those_of_the_damped_pendulum():
    omega, c = np.sqrt(2.0 * G * LENGTH / INERTIA), 0.5
    system, q, v = pendulum(-np.pi / 2, c)
    modes = coupled_modes(system, q, v, NONE, NONE)
    zeta = c / (2 * INERTIA * omega)
    assert modes.damping == pytest.approx([zeta], rel=1e-10)
    np.testing.assert_allclose(modes.eigenvalues.real, -zeta * omega, rtol=1e-10)
    np.testing.assert_allclose(np.abs(modes.eigenvalues.imag), omega * np.sqrt(1 - zeta**2), rtol=1e-10)


def test_free_wheel_is_marginally_stable():
    disc = RigidBody("disc", 1.0, np.zeros(3), np.eye(3))
    system = assemble([disc], [revolute("axle", Frame("wall"), Frame("hub", "disc"))])
    q, v = state(system, {})
    modes = coupled_modes(system, q, v, NONE, NONE)
    np.testing.assert_array_equal(modes.squares, [0.0])
    assert growth(system, modes) == (0.0, "")


def ziegler():
    """Two rods of 1 m, masses 2 and 1 at their ends, springs of 1 N m/rad, and a force along the second one."""
    tiny = 1e-6
    bodies = [
        RigidBody(name, m, np.array([1.0, 0, 0]), np.diag([tiny, m, m]) + tiny * np.eye(3))
        for name, m in (("first", 2.0), ("second", 1.0))
    ]
    wall, root = Frame("wall"), Frame("root", "first")
    knee, foot = Frame("knee", "first", np.array([1.0, 0, 0])), Frame("foot", "second")
    tip = Frame("tip", "second", np.array([1.0, 0, 0]))
    joints = [revolute("a", wall, root), revolute("b", knee, foot)]
    forces = [torsion("ca", wall, root, 1.0), torsion("cb", knee, foot, 1.0), follower_force("P", tip, np.array([-1.0, 0, 0]))]
    system = assemble(bodies, joints, forces)
    return system, *state(system, {"second": Pose(np.array([1.0, 0, 0]))})


def test_a_column_under_a_follower_force_flutters_from_zieglers_load_on():
    """P l/c = 7/2 − √2, where no static method finds anything (Ziegler 1952)."""
    system, q, v = ziegler()
    critical = 3.5 - np.sqrt(2)
    for share, flutters in ((0.5, False), (0.999, False), (1.001, True), (1.2, True)):
        modes = coupled_modes(system, q, v, np.array([share * critical]), NONE)
        assert (growth(system, modes)[0] > 0) == flutters


def test_the_state_space_at_rest_is_the_difference_of_two_equilibria(everything):
    """y = −C A⁻¹ B Δu for a constant load."""
    e = everything
    q, _ = static_equilibrium(e.system, e.q, e.u, e.theta)
    modes = coupled_modes(e.system, q, 0 * q, e.u, e.theta)
    ring = next(f for f in e.system.forces if f.name == "ring")
    sensor = readings(e.system, [RelationSensor("ring", ring.relations)])
    C = sensor.read(q, 0 * q)[1] @ modes.shapes
    gain = C @ np.linalg.solve(modes.K, modes.B)
    for k, change in enumerate(np.eye(len(e.u)) * 1e-3):
        ends = [static_equilibrium(e.system, q, e.u + sign * change, e.theta, near=True)[0] for sign in (1, -1)]
        difference = (sensor.read(ends[0], 0 * q)[0] - sensor.read(ends[1], 0 * q)[0]) / 2e-3
        np.testing.assert_allclose(gain[:, k], difference, atol=1e-6 * np.abs(gain).max())
