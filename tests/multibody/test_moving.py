"""Motors, cylinders, loads that turn, friction and gravity that turns: closed forms, and the loads they must equal."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from strainsight.multibody.accelerations import balance
from strainsight.multibody.bearing.element import BearingLaw, Drag
from strainsight.multibody.bodies import Frame, RigidBody
from strainsight.multibody.forces import Gravity, PointForce, PointMoment
from strainsight.multibody.initial import Pose, state
from strainsight.multibody.joints import Joint, prismatic, revolute
from strainsight.multibody.laws import (
    actuator,
    follower_force,
    follower_moment,
    friction,
    torque,
    turning_gravity,
)
from strainsight.multibody.simulate import simulate
from strainsight.multibody.step import advance, slopes
from strainsight.multibody.system import assemble

from .bearing.bearings import pitch_bearing
from .mechanisms import differences, extrapolated, turned
from .test_drives import angle

MASS, INERTIA, G = 2.0, 0.7, 9.81


def wheel(*forces):
    disc = RigidBody("disc", MASS, np.zeros(3), INERTIA * np.eye(3))
    return assemble([disc], [revolute("hinge", Frame("wall"), Frame("hub", "disc"))], forces)


def turn_of(run):
    return np.unwrap(np.arctan2(run.q[:, 4], run.q[:, 3]))


def test_a_block_slides_v_squared_over_twice_mu_g_and_stops():
    """µ = 0.3, from 2 m/s; it then creeps by no more than its share of the speed."""
    mu, speed = 0.3, 2e-3
    block = RigidBody("block", MASS, np.zeros(3), np.eye(3))
    rub = friction("rub", Frame("floor"), Frame("foot", "block"), "slide", mu * MASS * G, 0.0, speed, "x")
    system = assemble([block], [prismatic("rail", Frame("floor"), Frame("foot", "block"), "x")], [rub])
    q, v = state(system, {"block": Pose(velocity=np.array([2.0, 0, 0]))})
    run = simulate(system, q, v, np.zeros((201, 0)), 5e-3, np.zeros(0))
    assert run.q[-1, 0] == pytest.approx(4 / (2 * mu * G), rel=2e-4)
    assert abs(run.v[-1, 0]) < 1e-6
    np.testing.assert_allclose(run.v[:130, 0], 2 - mu * G * run.time[:130], atol=1e-3)


def test_a_wheel_runs_out_against_coulomb_and_viscous_friction():
    """I ω̇ = −T − cω: ω = (ω₀ + T/c) exp(−ct/I) − T/c, through more than a whole turn."""
    T, c, w = 0.5, 0.4, 12.0
    ends = []
    system = wheel(friction("rub", Frame("wall"), Frame("hub", "disc"), "turn", T, c, 1e-2))
    q, v = state(system, {"disc": Pose(spin=np.array([0, 0, w]))})
    for steps in (200, 400, 800):
        run = simulate(system, q, v, np.zeros((steps + 1, 0)), 1.0 / steps, np.zeros(0))
        ends.append(turn_of(run)[-1])
    exact = (w + T / c) * INERTIA / c * (1 - np.exp(-c / INERTIA)) - T / c
    assert exact > 2 * np.pi
    assert extrapolated(ends, 2) == pytest.approx(exact, abs=1e-5)


@pytest.mark.parametrize("kind", ["torque", "moment", "force"])
def test_what_turns_with_the_wheel_spins_it_up_and_does_its_work(kind):
    """½ I ω² = T φ after many turns, of a motor, a moment and a force on the rim, each in its own axes."""
    rim = Frame("rim", "disc", np.array([0.5, 0, 0]), turned(np.pi / 2))
    force = {
        "torque": torque("u", Frame("wall"), Frame("hub", "disc")),
        "moment": follower_moment("u", rim, np.array([0, 0, 1.0])),
        "force": follower_force("u", rim, np.array([1.0, 0, 0])),
    }[kind]
    system, T = wheel(force), 3.0
    u = np.full((801, 1), T / 0.5 if kind == "force" else T)
    run = simulate(system, *state(system, {}), u, 0.005, np.zeros(0))
    phi, spin = turn_of(run)[-1], np.linalg.norm(run.v[-1, 3:6])
    assert phi == pytest.approx(T / INERTIA * 16 / 2, rel=2e-3)
    assert 0.5 * INERTIA * spin**2 == pytest.approx(T * phi, rel=2e-3)


def loads(everything, own, u):
    """M a + c + f of `everything` with a force more, at rest."""
    e = everything
    system = assemble(e.system.bodies, e.system.joints, [*e.system.forces, own])
    given = np.concatenate([e.u, np.atleast_1d(u)])
    return balance(system, e.q, 0 * e.q, given, e.theta).load


@pytest.mark.parametrize("body", ["hub", "arm", "rock"])
def test_a_load_in_the_axes_of_a_frame_is_the_one_along_them_in_space(everything, body):
    e, rng = everything, np.random.default_rng(5)
    direction = np.array([0.6, 0.0, 0.8])
    n = len(e.q[e.system.modal(body)])
    shapes = [1e-6 * rng.normal(size=(3, n)) for _ in range(2)] if n else [None, None]
    frame = Frame("at", body, np.array([0.3, -0.2, 0.5]), turned(0.4), *shapes)
    own = e.system.of[body]
    R = np.eye(3) if own.stop - own.start == n else e.q[own][3:12].reshape(3, 3).T
    along = (R @ turned(0.4) @ direction)[:, None]
    for follower, plain in ((follower_force, PointForce), (follower_moment, PointMoment)):
        found = loads(everything, follower("more", frame, direction), 7.0)
        np.testing.assert_allclose(found, loads(everything, plain("more", frame, along, ["more"]), 7.0), atol=2e-5)


def test_gravity_turned_by_an_angle_is_gravity_in_that_direction(everything):
    g, axis, phi = np.array([1.0, 2.0, -9.0]), np.array([0, 0.6, 0.8]), 2.1
    along = (axis @ g) * axis
    there = along + np.cos(phi) * (g - along) + np.sin(phi) * np.cross(axis, g)
    found = loads(everything, turning_gravity("w", everything.system.bodies, g, axis), phi)
    np.testing.assert_allclose(found, loads(everything, Gravity(there, "w"), np.zeros(0)), atol=1e-10)


def test_slopes_of_a_step_with_all_of_them_are_its_differences(everything):
    e = everything
    tip, low = Frame("tip", "arm", np.array([0.2, 0.1, 0.4])), Frame("low", "rock", np.array([-0.5, 0.3, 0.1]))
    more = [
        follower_force("a", tip, np.array([0.6, 0, 0.8])),
        follower_moment("b", low, np.array([0, 1.0, 0])),
        torque("c", tip, low, "x"),
        actuator("d", tip, low),
        turning_gravity("e", e.system.bodies, np.array([0, 3.0, -5.0]), np.array([0, 0, 1.0])),
        friction("f", tip, low, "turn", 2.0, 0.3, 0.5, "y"),
        friction("g", tip, low, "slide", 2.0, 0.3, 0.5, "x"),
    ]
    system = assemble(e.system.bodies, e.system.joints, [*e.system.forces, *more])
    n, h = system.size, 0.02
    u = np.concatenate([e.u, [3.0, -2.0, 4.0, 1.5, 0.8]])
    x = np.concatenate([e.q, e.v])

    def after(x, u):
        new = advance(system, x[:n], x[n:], (u, u), h, e.theta, "second_order")
        return np.concatenate([new.q, new.v])

    found = slopes(system, advance(system, e.q, e.v, (u, u), h, e.theta, "second_order"))
    exact, difference = found.B_start + found.B_end, differences(lambda z: after(x, z), u, 1e-2)
    np.testing.assert_allclose(exact, difference, atol=1e-7 * np.abs(exact).max())
    difference = differences(lambda z: after(z, u), x, 2e-5)
    np.testing.assert_allclose(found.A, difference, atol=1e-6 * np.abs(found.A).max())


def test_a_pendulum_on_a_driven_arm_swings_as_its_own_equation_has_it():
    """One angle in minimal coordinates by DOP853; the motor does the work that the energy grows by."""
    L, l, m, p0 = 0.8, 0.5, 1.5, np.pi / 2
    arm = RigidBody("arm", 1.0, np.array([L / 2, 0, 0]), np.diag([1e-2, 0.3, 0.3]))
    bob = RigidBody("bob", m, np.array([l, 0, 0]), np.diag([1e-3, m * l * l + 1e-3, m * l * l + 1e-3]))
    wall, root, end, top = Frame("wall"), Frame("root", "arm"), Frame("end", "arm", np.array([L, 0, 0])), Frame("top", "bob")
    joints = [revolute("a", wall, root), Joint("motor", (angle(wall, root),)), revolute("b", end, top)]
    system = assemble([arm, bob], joints, [Gravity(np.array([0, -G, 0]))])

    def p(t):
        return p0 + 1.5 * (1 - np.cos(2 * t)), 3 * np.sin(2 * t), 6 * np.cos(2 * t)

    def swing(t, y):
        a, rate, second = p(t)
        b, spin = y
        J = m * l * l + 1e-3
        # base point at L(cos a, sin a): J b̈ = −m l (ẍ·e_b′) − m g l cos b
        ax, ay = -L * (second * np.sin(a) + rate**2 * np.cos(a)), L * (second * np.cos(a) - rate**2 * np.sin(a))
        return [spin, (-m * l * (-ax * np.sin(b) + ay * np.cos(b)) - m * G * l * np.cos(b)) / J]

    exact = solve_ivp(swing, (0, 1.5), [0.0, 0.0], method="DOP853", rtol=1e-11, atol=1e-12).y[0, -1]
    poses = {"arm": Pose(rotation=turned(p0)), "bob": Pose(position=np.array([0, L, 0]))}
    ends = []
    for steps in (300, 600, 1200):
        time = np.linspace(0, 1.5, steps + 1)
        u = np.column_stack(p(time)[:2])
        run = simulate(system, *state(system, poses), u, time[1], np.zeros(0))
        ends.append(np.unwrap(np.arctan2(run.q[:, 16], run.q[:, 15]))[-1])
    assert extrapolated(ends, 2) == pytest.approx(exact, abs=2e-7)
    assert (ends[0] - exact) / (ends[1] - exact) == pytest.approx(4.0, abs=0.2)


RING = np.array([2e-5, -1e-5, 3e-5, 1e-5, -2e-5])
"""A displacement of a pitch bearing under load."""


@pytest.mark.parametrize("turn", [0.0, 2.0, -3.0])
def test_slopes_of_a_bearing_with_friction_and_damping_are_its_differences(turn):
    law = BearingLaw(pitch_bearing(), ("ball_diameter",), Drag(50.0, 0.006, 20.0, 0.1, np.array([1e4, 2e4, 2e4, 3e3, 3e3])))
    theta = np.array([pitch_bearing().ball_diameter])
    rho, rate = np.concatenate([RING, [np.cos(turn), np.sin(turn)]]), np.array([1e-4, 2e-4, -1e-4, 1e-4, 0, 0.02, 0.05])
    found = law.load(rho, rate, theta)
    scale = np.array([1e-10] * 5 + [1e-4] * 2)  # a ball that loses contact bends the rest
    for exact, at, sizes in (
        (found.F_rho, lambda d: law.load(rho + d, rate, theta).F, scale),
        (found.F_rate, lambda d: law.load(rho, rate + d, theta).F, np.full(7, 1e-3)),
    ):
        columns = [(8 * (at(d) - at(-d)) - (at(2 * d) - at(-2 * d))) / (12 * d.max()) for d in np.diag(sizes)]
        for k, column in enumerate(columns):
            np.testing.assert_allclose(exact[:, k], column, atol=1e-6 * max(np.abs(column).max(), 1.0))
    d = 1e-9
    column = (law.load(rho, rate, theta + d).F - law.load(rho, rate, theta - d).F) / (2 * d)
    np.testing.assert_allclose(found.F_theta[:, 0], column, rtol=1e-5, atol=1e-5 * np.abs(column).max())


def test_friction_of_a_turning_bearing_is_the_makers_formula_of_what_its_balls_carry():
    """M = T₀ + µ/2 (4.4 M + D F_a + 3.81 D F_r), at any angle, and work is taken."""
    bearing, mu = pitch_bearing(), 0.006
    law = BearingLaw(bearing, (), Drag(moment=50.0, coefficient=mu, speed=1e-4))
    plain = BearingLaw(bearing).load(RING, np.zeros(5), np.zeros(0)).F
    D = bearing.pitch_diameter
    tilt, radial = np.hypot(*plain[3:]), np.hypot(*plain[1:3])
    expected = 50 + mu / 2 * (4.4 * tilt + D * abs(plain[0]) + 3.81 * D * radial)
    for turn in (0.1, 3.0, -2.0):
        x, y = np.cos(turn), np.sin(turn)
        F = law.load(np.concatenate([RING, [x, y]]), np.concatenate([np.zeros(5), [-y, x]]), np.zeros(0)).F
        np.testing.assert_allclose(F[:5], plain, rtol=1e-12)
        assert F[5:] @ [-y, x] == pytest.approx(expected, rel=2e-3)
