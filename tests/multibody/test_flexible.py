"""Free and clamped flexible bodies against analytic motions."""

import numpy as np
import pytest

from strainsight.errors import InfeasibleError
from strainsight.multibody.bodies import FlexibleBody
from strainsight.multibody.equations import mass_at
from strainsight.multibody.forces import PointForce
from strainsight.multibody.frames import Frame
from strainsight.multibody.initial import Pose, state
from strainsight.multibody.joints import fixed
from strainsight.multibody.sensitivity import sensitivities
from strainsight.multibody.simulate import simulate
from strainsight.multibody.step import step
from strainsight.multibody.system import assemble


def continuous_poles(system, q, v, u, theta, h):
    """λ of ẋ = Fx from the derivative of one implicit Euler step, z = 1/(1 − hλ), where z ≠ 0."""
    z = np.linalg.eigvals(sensitivities(system, step(system, q, v, u, h, theta)).A)
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


def test_spinning_body_stretches_by_its_centrifugal_force(particles):
    """A mass m on a radial spring k at radius a: k s = m ω²(a + s), in steady rotation."""
    ring = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    shapes = np.zeros((8, 3, 1))
    shapes[6, 0, 0], shapes[7, 0, 0] = 1.0, -1.0
    cloud = particles(np.array([5.0] * 6 + [0.5] * 2), np.vstack([ring, [[2.0, 0, 0], [-2.0, 0, 0]]]), shapes)
    k, omega = 40.0, 3.0
    system = assemble([cloud.flexible("rotor", np.array([[2 * k]]), np.array([[2.0]]))])
    stretch = 0.5 * omega**2 * 2.0 / (k - 0.5 * omega**2)
    pose = Pose(spin=np.array([0, 0, omega]), modal=np.array([stretch]))
    for h, error in ((2e-3, 0.02), (1e-3, 0.01)):
        run = simulate(system, *state(system, {"rotor": pose}), np.zeros((int(1 / h) + 1, 0)), h, np.zeros(0))
        assert np.abs(run.q[:, 12] - stretch).max() < error * stretch
    about_z = sum(5.0 * (r[0] ** 2 + r[1] ** 2) for r in ring) + 2 * 0.5 * (2.0 + run.q[-1, 12]) ** 2
    spin = run.v[-1, 3:12] @ np.cross([0, 0, 1], run.q[-1, 3:12].reshape(3, 3)).ravel() / 2
    assert about_z * spin == pytest.approx(omega * (20.0 + (2 + stretch) ** 2), rel=0.01)


def momentum(cloud, q, v):
    """Linear and angular momentum of the particles, their velocities by a complex step."""
    speed = cloud.places(q + 1e-30j * v).imag / 1e-30
    place = cloud.places(q)
    return np.concatenate([cloud.m @ speed, cloud.m @ np.cross(place, speed)])


def test_free_flexible_body_keeps_its_momentum_as_the_step_shrinks(random_particles):
    rng = np.random.default_rng(5)
    cloud = random_particles(rng)
    system = assemble([cloud.flexible("potato", np.diag([30.0, 50.0, 80.0]))])
    pose = Pose(
        np.ones(3), np.eye(3), rng.normal(size=3), rng.normal(size=3), 0.3 * rng.normal(size=3), rng.normal(size=3)
    )
    q, v = state(system, {"potato": pose})
    drifts = []
    for steps in (250, 500, 1000):
        run = simulate(system, q, v, np.zeros((steps + 1, 0)), 1.0 / steps, np.zeros(0))
        drifts.append(momentum(cloud, run.q[-1], run.v[-1]) - momentum(cloud, q, v))
    scale = np.abs(momentum(cloud, q, v)).max()
    limit = (8 * drifts[2] - 6 * drifts[1] + drifts[0]) / 3
    assert np.abs(drifts[2]).max() < 0.02 * scale
    np.testing.assert_allclose(limit, 0, atol=1e-4 * scale)


def test_energy_of_a_clamped_mode_decays_as_implicit_euler_must(particles):
    """E' = E/(1 + h²ω²) at every step, for every mode, and no other damping."""
    n = 4
    omega2 = np.array([1.0, 9.0, 100.0, 1e4])
    cloud = particles(np.ones(n), np.eye(n, 3), np.stack([np.eye(3)[:, [k % 3]] * np.eye(n)[k] for k in range(n)]))
    body = cloud.flexible("hub", np.diag(omega2), clamped=True)
    system = assemble([body])
    rng = np.random.default_rng(0)
    q, v = rng.normal(size=n), rng.normal(size=n)
    h = 0.02
    run = simulate(system, q, v, np.zeros((51, 0)), h, np.zeros(0), "thesis")
    energy = run.v**2 + omega2 * run.q**2
    np.testing.assert_allclose(energy[1:], energy[:-1] / (1 + h**2 * omega2), rtol=1e-12)


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


def test_mass_matrix_follows_the_body(random_particles):
    rng = np.random.default_rng(9)
    cloud = random_particles(rng)
    system = assemble([cloud.rigid("other"), cloud.flexible("potato", np.eye(3))])
    q, v = state(
        system, {"potato": Pose(modal=np.array([0.1, 0.2, 0.3]), velocity=np.ones(3), spin=np.array([1.0, 2, 3]))}
    )
    speed = cloud.places(q[12:] + 1e-30j * v[12:]).imag / 1e-30
    assert v @ mass_at(system, q) @ v == pytest.approx(cloud.m @ np.sum(speed**2, axis=1), rel=1e-13)


def test_shapes_without_mass_and_matrices_of_another_size_are_refused(random_particles):
    inv = random_particles(np.random.default_rng(0)).invariants()
    with pytest.raises(InfeasibleError, match="not positive definite"):
        FlexibleBody("hub", True, np.eye(3), np.diag([1.0, 1.0, 0.0]), np.zeros((3, 3)), inv)
    with pytest.raises(InfeasibleError, match="stiffness is not 3×3"):
        FlexibleBody("hub", True, np.eye(2), np.eye(3), np.zeros((3, 3)), inv)
