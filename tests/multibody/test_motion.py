"""Motion against closed forms, published values and other integrators: a pendulum, mechanisms, Radau's method."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from strainsight.multibody.bodies import Frame, RigidBody
from strainsight.multibody.forces import Gravity, PointMoment
from strainsight.multibody.initial import Pose, constraints_at, project_position, project_velocity, state
from strainsight.multibody.joints import pin, revolute
from strainsight.multibody.laws import spring
from strainsight.multibody.simulate import simulate, simulate_radau
from strainsight.multibody.system import assemble

from .inverse.benches import bench
from .inverse.test_smoother import walked
from .mechanisms import at, extrapolated, planar, turned


def pendulum(metre=1.0, kilogram=1.0):
    """A point mass on a massless rod of 1 m, released from x = −1; in other units of length and mass."""
    inertia = np.diag([0.0, 1.0, 1.0]) * kilogram * metre**2
    bob = RigidBody("bob", kilogram, np.array([metre, 0.0, 0.0]), inertia)
    system = assemble(
        [bob], [revolute("pivot", Frame("wall"), Frame("end", "bob"))], [Gravity(np.array([0.0, -9.81 * metre, 0.0]))]
    )
    return system, *state(system, {"bob": Pose(rotation=np.diag([-1.0, -1.0, 1.0]))})


def swing(steps, method="second_order", **units):
    system, q, v = pendulum(**units)
    if method == "radau":
        return system, simulate_radau(system, q, v, np.zeros((steps + 1, 0)), 1.0 / steps, np.zeros(0))
    return system, simulate(system, q, v, np.zeros((steps + 1, 0)), 1.0 / steps, np.zeros(0), method)


@pytest.mark.parametrize(("method", "order"), [("second_order", 2), ("thesis", 1)])
def test_bob_is_where_the_benchmark_has_it_and_the_error_is_of_the_order_of_the_method(method, order):
    exact = np.array([0.98629175, -0.16501085])
    ends = [swing(n, method)[1].q[-1, 3:5] for n in (100, 200, 400, 800)]
    errors = [np.linalg.norm(end - exact) for end in ends]
    assert np.log2(errors[2] / errors[3]) == pytest.approx(order, abs=0.06)
    np.testing.assert_allclose(extrapolated(ends, order), exact, atol=2e-6)


@pytest.mark.parametrize(("method", "steps"), [("second_order", 200), ("thesis", 200), ("radau", 20)])
def test_constraints_hold_to_rounding_in_position_and_velocity(method, steps):
    system, run = swing(steps, method)
    for q, v in zip(run.q, run.v, strict=True):
        phi, B, _ = constraints_at(system, q)
        assert np.abs(phi).max() < 1e-14
        assert np.abs(B @ v).max() < 1e-13 * max(1.0, np.abs(v).max())


def test_nothing_depends_on_the_units():
    _, run = swing(100)
    _, other = swing(100, metre=1000.0, kilogram=1e-3)
    np.testing.assert_allclose(other.q[:, 3:12], run.q[:, 3:12], atol=1e-11)
    np.testing.assert_allclose(other.v[:, 3:12], run.v[:, 3:12], atol=1e-10)


def test_multiplier_of_the_pivot_is_the_reaction():
    system, q, v = pendulum()
    q, v = state(system, {"bob": Pose(rotation=np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1.0]]))})
    run = simulate(system, q, v, np.zeros((2, 0)), 0.01, np.zeros(0))
    assert system.constraints[7] == "pivot: global y position of end relative to wall"
    np.testing.assert_allclose(run.lam[0, 6:9], [0.0, 9.81, 0.0], atol=1e-12)


def four_bars(windows=2):
    """N windows of rods of 1 m and 1 kg: uprights A_kB_k from the ground, couplers B_kB_{k+1}."""
    rod = np.array([0.5, 0.0])
    bodies = [planar(f"up{k}", 1.0, rod, 1 / 12) for k in range(windows + 1)]
    bodies += [planar(f"across{k}", 1.0, rod, 1 / 12) for k in range(windows)]
    joints = [revolute(f"A{k}", at(f"ground{k}", None, k), at(f"foot{k}", f"up{k}")) for k in range(windows + 1)]
    for k in range(windows):
        joints.append(revolute(f"B{k}", at(f"top{k}", f"up{k}", 1), at(f"left{k}", f"across{k}")))
        # the loop is closed in the plane: a third revolute joint would hold what the others hold already
        joints.append(pin(f"C{k}", at(f"top{k + 1}", f"up{k + 1}", 1), at(f"right{k}", f"across{k}", 1)))
    system = assemble(bodies, joints, [Gravity(np.array([0.0, -9.81, 0.0]))])
    poses = {
        f"up{k}": Pose(np.array([k, 0, 0.0]), turned(np.pi / 2), spin=np.array([0, 0, -1.0]))
        for k in range(windows + 1)
    }
    poses |= {f"across{k}": Pose(np.array([k, 1.0, 0]), velocity=np.array([1.0, 0, 0])) for k in range(windows)}
    return system, *state(system, poses)


def exact_four_bars(time, windows=2):
    """B₀ = (cos θ, sin θ): uprights turn, couplers only translate, so one angle moves all of the mass."""
    uprights, couplers = windows + 1, windows
    inertia, weight = uprights / 3 + couplers, 9.81 * (uprights / 2 + couplers)
    run = solve_ivp(
        lambda t, y: [y[1], -weight / inertia * np.cos(y[0])], (0, time), [np.pi / 2, -1.0], rtol=1e-12, atol=1e-12
    )
    return np.array([np.cos(run.y[0, -1]), np.sin(run.y[0, -1])])


def test_reduction_of_the_four_bars_gives_the_published_place():
    np.testing.assert_allclose(exact_four_bars(10.0), [0.3284581115, 0.9445185382], atol=1e-8)


def test_two_four_bars_pass_their_singular_position_and_are_where_the_reduction_has_them():
    system, q, v = four_bars()
    np.testing.assert_allclose(project_position(system, q), q, atol=1e-14)
    np.testing.assert_allclose(project_velocity(system, q, v), v, atol=1e-14)
    ends = []
    for steps in (250, 500, 1000, 2000):
        run = simulate(system, q, v, np.zeros((steps + 1, 0)), 1.0 / steps, np.zeros(0))
        ends.append(run.q[-1, 3:5])
        phi, B, _ = constraints_at(system, run.q[-1])
        assert np.abs(phi).max() < 1e-13
        assert np.abs(B @ run.v[-1]).max() < 1e-12
    exact = exact_four_bars(1.0)
    assert np.linalg.norm(ends[2] - exact) / np.linalg.norm(ends[3] - exact) == pytest.approx(4.0, abs=0.05)
    np.testing.assert_allclose(extrapolated(ends, 2), exact, atol=1e-7)


def test_bob_is_where_the_benchmark_has_it_and_the_error_is_of_fifth_order():
    ends = [swing(n, "radau")[1].q[-1, 3:5] for n in (10, 20, 40, 80)]
    np.testing.assert_allclose(ends[-1], [0.98629175, -0.16501085], atol=1e-8)
    errors = [np.linalg.norm(end - ends[-1]) for end in ends[:-1]]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(5, abs=0.5)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(5, abs=0.5)


def test_a_bench_of_modes_up_to_392_hz_reads_as_by_an_explicit_method():
    """Loads that are straight over 10 ms, from rest, 50 ms; displacements are of 5e-4 m, and their bends shake 392 Hz."""
    b = bench()
    corners = np.array([[0, 0, 0], [4e3, -2e3, 3e3], [9e3, -1e3, 1e3], [5e3, 2e3, -2e3], [1e3, 4e3, 2e3], [0, 3e3, 6e3]])

    def loads(h):
        t = h * np.arange(round(0.05 / h) + 1)
        return np.column_stack([np.interp(t, 0.01 * np.arange(6), own) for own in corners.T])

    explicit, off = walked(b, loads(1e-3), 1e-3), []
    for parts in (1, 2):
        found = simulate_radau(b.system, b.q, np.zeros_like(b.q), loads(1e-3 / parts), 1e-3 / parts, b.theta)
        states = zip(found.q[parts::parts], found.v[parts::parts], strict=True)
        off.append(np.abs([b.sensors.read(q, v)[0] for q, v in states] - explicit).max())
    assert np.abs(explicit).max() > 4e-4
    assert off[0] < 5e-9
    assert off[1] < off[0] / 8


MASS = np.array([0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498])
INERTIA = np.array([2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5])
START = np.array([
    -0.0617138900142764496358948458001, 0.0, 0.455279819163070380255912382449, 0.222668390165885884674473185609,
    0.487364979543842550225598953530, -0.222668390165885884674473185609, 1.23054744454982119249735015568,
])  # fmt: skip
"""β, Θ, γ, Φ, δ, Ω, ε [rad] at rest."""
END = np.array([
    15.81077119629904, -15.75637105984298, 0.04082224013073101, -0.5347301163226948,
    0.5244099658805304, 0.5347301163226948, 1.048080741042263,
])  # fmt: skip
"""The same after 0.03 s."""
A, B, C = np.array([-0.06934, -0.00227]), np.array([-0.03635, 0.03273]), np.array([0.014, 0.072])


def squeezer():
    """Andrews' squeezer: K1 turns on O and drives K2; K2 meets K3 (on B), K4 (on K5 on A) and K6 (on K7 on A) in F.

    The data and angles are those of the IVP test set: K1 β, K2 β + Θ, K3 γ, K4 Φ + δ, K5 δ, K6 Ω + ε, K7 ε.
    """
    beta, theta, gamma, phi, delta, omega, epsilon = START
    d, e, rr, ss, sc, sd, u, zf, zt = 0.028, 0.02, 0.007, 0.035, 0.018, 0.02, 0.04, 0.02, 0.04
    centres = [
        [0.00092, 0],
        [-0.0115, 0],
        [0.01043, -0.01874],
        [0, 0.01421 - e],
        [0.00916, 0.02308],
        [zf - 0.01421, 0],
        [0.01228, 0.00449],
    ]
    bodies = [planar(f"K{k + 1}", MASS[k], centres[k], INERTIA[k]) for k in range(7)]
    angles = [beta, beta + theta, gamma, phi + delta, delta, omega + epsilon, epsilon]
    R = [turned(angle) for angle in angles]
    G, H = A + zt * R[4][:2, 0], A - u * R[6][:2, 1]
    origins = [np.zeros(2), rr * R[0][:2, 0], B, G, A, H, A]
    meeting = at("F2", "K2", -d)
    joints = [
        revolute("O", at("O0", None), at("O1", "K1")),
        revolute("E", at("E1", "K1", rr), at("E2", "K2")),
        revolute("B", at("B0", None, *B), at("B3", "K3")),
        revolute("A5", at("A0", None, *A), at("A5", "K5")),
        revolute("G", at("G5", "K5", zt), at("G4", "K4")),
        revolute("A7", at("A0", None, *A), at("A7", "K7")),
        revolute("H", at("H7", "K7", 0, -u), at("H6", "K6")),
        pin("F3", meeting, at("F3", "K3", 0, -ss)),
        pin("F4", meeting, at("F4", "K4", 0, -e)),
        pin("F6", meeting, at("F6", "K6", zf)),
    ]
    drive = PointMoment("drive", at("shaft", "K1"), np.array([0.0, 0.0, 1.0]), ["torque"])
    pull = spring("spring", at("D", "K3", sd, -sc), at("C", None, *C), 4530.0, length=0.07785)
    system = assemble(bodies, joints, [drive, pull])
    poses = {
        body.name: Pose(np.array([*origin, 0.0]), turn) for body, origin, turn in zip(bodies, origins, R, strict=True)
    }
    return system, *state(system, poses)


def first_axes(system, q):
    """cos and sin of every body's angle (7, 2)."""
    return np.array([q[own.start + 3 : own.start + 5] for own in system.of.values()])


def cosines_and_sines(angles):
    beta, theta, gamma, phi, delta, omega, epsilon = angles
    turned = np.array([beta, beta + theta, gamma, phi + delta, delta, omega + epsilon, epsilon])
    return np.stack([np.cos(turned), np.sin(turned)], axis=1)


def ends_of(time, numbers):
    system, q, v = squeezer()
    runs = [simulate(system, q, v, np.full((n + 1, 1), 0.033), time / n, np.zeros(0)) for n in numbers]
    return [first_axes(system, run.q[-1]) for run in runs]


def test_squeezer_reaches_its_published_end_at_second_order():
    ends, exact = ends_of(0.03, (250, 500, 1000)), cosines_and_sines(END)
    errors = [np.linalg.norm(end - exact) for end in ends]
    np.testing.assert_allclose(np.log2([errors[0] / errors[1], errors[1] / errors[2]]), 2, atol=0.05)
    np.testing.assert_allclose(extrapolated(ends, 2), exact, rtol=0, atol=2e-5)
