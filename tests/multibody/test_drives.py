"""Joints that are driven, accelerations, reactions and the forces of drives at an instant."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strainsight.errors import InfeasibleError
from strainsight.multibody.accelerations import balance, instant, measure, reaction
from strainsight.multibody.bodies import Frame, RigidBody
from strainsight.multibody.forces import Gravity, Load, PointForce, RelativeElement
from strainsight.multibody.initial import (
    Pose,
    constraints_at,
    nearest_state,
    project_position,
    project_velocity,
    state,
    static_equilibrium,
)
from strainsight.multibody.joints import DrivenRelation, Joint, between, fixed, revolute, spherical
from strainsight.multibody.laws import turning_gravity
from strainsight.multibody.relations import distance_squared, dot, offset
from strainsight.multibody.sensors import Accelerometer, position_sensor, readings
from strainsight.multibody.simulate import simulate
from strainsight.multibody.step import advance, slopes
from strainsight.multibody.system import assemble

from .mechanisms import differences, turned

MASS, ARM, INERTIA = 2.0, 0.5, 0.8
"""Of a pendulum: mass, its distance from the pivot, moment of inertia about the pivot."""


def angle(i, j):
    return DrivenRelation(dot(i, 1, j, 0), "turn", "angle", dot(i, 0, j, 0))


def driven_pendulum():
    wall, end = Frame("wall"), Frame("end", "bob")
    bob = RigidBody("bob", MASS, np.array([ARM, 0, 0]), np.diag([0.1, INERTIA, INERTIA]))
    joints = [revolute("pivot", wall, end), Joint("motor", (angle(wall, end),))]
    return assemble([bob], joints, [Gravity(np.array([0, -9.81, 0]))])


def turning(time):
    """p, ṗ of a turn by more than one whole turn."""
    return np.column_stack([4.0 * (1 - np.cos(2 * time)), 8.0 * np.sin(2 * time)])


def test_a_driven_arm_is_at_its_angle_through_more_than_a_whole_turn():
    """8 rad, past every place where the sine or the cosine of the angle alone would not tell it."""
    system, u = driven_pendulum(), turning(np.linspace(0, 1.5, 61))
    q, v = state(system, {"bob": Pose()})
    run = simulate(system, q, v, u, 0.025, np.zeros(0))
    np.testing.assert_allclose(run.q[:, 3:5], np.column_stack([np.cos(u[:, 0]), np.sin(u[:, 0])]), atol=1e-13)
    sideways = np.column_stack([-np.sin(u[:, 0]), np.cos(u[:, 0])])
    np.testing.assert_allclose(run.v[:, 3:5], u[:, 1:] * sideways, atol=1e-11)


def test_nearest_state_of_a_driven_arm_is_its_projection():
    """`project_position` and `project_velocity` solve the same by least squares."""
    system, u, rng = driven_pendulum(), turning(np.array([0.7]))[0], np.random.default_rng(4)
    q, v = state(system, {"bob": Pose(rotation=Rotation.from_euler("z", u[0]).as_matrix())})
    off, speed = q + 1e-3 * rng.normal(size=12), v + rng.normal(size=12)
    near = nearest_state(system, off, speed, u)
    place = project_position(system, off, u)
    np.testing.assert_allclose(near[0], place, rtol=0, atol=1e-14)
    np.testing.assert_allclose(near[1], project_velocity(system, place, speed, u), rtol=0, atol=1e-12)


@pytest.fixture
def driven(everything):
    """`everything` with an angle, a length and a displacement that are driven, and a load that acts through a law."""
    e, rng = everything, everything.rng
    rock = Frame("high", "rock", np.array([0.3, 0.1, 0.0]))
    arm = Frame(
        "side",
        "arm",
        np.array([0.1, 0.4, 0.2]),
        np.eye(3),
        0.2 * rng.normal(size=(3, 3)),
        0.2 * rng.normal(size=(3, 3)),
    )
    wall = Frame("wall", None, np.array([2.0, 1.0, 0.5]))
    held = [
        Joint("motor", (angle(Frame("low", "rock"), arm),)),
        Joint("cylinder", (DrivenRelation(distance_squared(wall, rock), "length", "length"),)),
        Joint("table", (DrivenRelation(offset(wall, 1, arm), "shift", "displacement"),)),
    ]
    push = RelativeElement("swell", (distance_squared(wall, arm),), Swell(), inputs=("p",))
    system = assemble(e.system.bodies, [*e.system.joints, *held], [*e.system.forces, push])
    rates = np.array([0.9, -0.4, 0.3])
    u = np.concatenate([e.u, [3.0, 0.7, 1.9, 0.0], rates])
    # drives that are where the system is
    free = assemble(e.system.bodies, e.system.joints, e.system.forces)
    G = [assemble(free.bodies, [*e.system.joints, Joint("x", (h.relations[0].relation,))], free.forces) for h in held]
    values = [constraints_at(s, e.q)[0][-1] for s in G]
    across = assemble(free.bodies, [*e.system.joints, Joint("x", (held[0].relations[0].across,))], free.forces)
    u[-6:-3] = [np.arctan2(values[0], constraints_at(across, e.q)[0][-1]), np.sqrt(values[1]), values[2]]
    q = project_position(system, e.q, u)
    v = project_velocity(system, q, e.v, u)
    return system, q, v, u, e.theta


class Swell:
    """F = p ρ²: a load that is not linear in the relation it acts through."""

    def load(self, rho, rho_dot, theta):
        return Load(theta[0] * rho**2, 2 * theta[0] * np.diag(rho), None, (rho**2)[:, None])


def test_the_rate_of_a_driven_constraint_is_its_difference_in_time(driven):
    system, q, v, u, _ = driven
    nd, e = 3, 1e-3

    def at(t):
        later = u.copy()
        later[-2 * nd : -nd] += t * u[-nd:]
        return constraints_at(system, q + t * v, later)[0]

    difference = (8 * (at(e) - at(-e)) - (at(2 * e) - at(-2 * e))) / (12 * e)
    _, B, rate = constraints_at(system, q, u)
    np.testing.assert_allclose(B @ v + rate, difference, atol=1e-10)
    np.testing.assert_allclose(difference, 0.0, atol=1e-10)


@pytest.mark.parametrize("method", ["second_order", "thesis"])
def test_slopes_of_a_driven_step_are_its_differences(driven, method):
    system, q, v, u, theta = driven
    n, h, nd = system.size, 0.02, 3
    w, x, end = np.zeros(n), np.concatenate([q, v]), u.copy()
    end[-2 * nd : -nd] += h * u[-nd:]

    def after(x, start, end, theta, w):
        new = advance(system, x[:n], x[n:], (start, end), h, theta, method, w)
        return np.concatenate([new.q, new.v])

    at = [x, u, end, theta, w]
    found = slopes(system, advance(system, q, v, (u, end), h, theta, method, w))
    named = (found.A, found.B_start, found.B_end, found.B_theta, found.B_w)
    for place_, (exact, size) in enumerate(zip(named, (1e-4, 1e-4, 1e-4, 1e-3, 1e-1), strict=True)):
        difference = differences(lambda z, i=place_: after(*at[:i], z, *at[i + 1 :]), at[place_], size)
        assert exact.shape == difference.shape
        for half in (slice(0, n), slice(n, None)):
            scale = max(np.abs(exact[half]).max(), 1e-3 * np.abs(found.B_end[half]).max())
            np.testing.assert_allclose(exact[half], difference[half], rtol=0, atol=1e-7 * scale)


def test_driven_constraints_hold_to_rounding_in_position_and_velocity(driven):
    system, q, v, u, theta = driven
    time = np.linspace(0, 0.2, 11)
    history = np.tile(u, (11, 1))
    history[:, -6:-3] += time[:, None] * u[-3:]
    run = simulate(system, q, v, history, 0.02, theta)
    for own, rate, now in zip(run.q, run.v, history, strict=True):
        phi, B, moved = constraints_at(system, own, now)
        assert np.abs(phi).max() < 1e-13
        assert np.abs(B @ rate + moved).max() < 1e-11


def test_drives_between_the_ends_of_a_step_follow_a_cubic_and_loads_a_line():
    table = driven_pendulum()
    system = assemble(
        table.bodies, table.joints, [*table.forces, PointForce("F", Frame("f", "bob"), np.eye(3)[0], ["F"])]
    )
    start, end = between(system.drives, 0.5, 0.3)

    def at(t):
        return np.array([2 + t, 1 - t + 3 * t**2 - 2 * t**3, -1 + 6 * t - 6 * t**2])

    np.testing.assert_allclose(start @ at(0.0) + end @ at(0.5), at(0.15), atol=1e-14)


def test_an_arm_held_by_its_drive_rests_at_the_angle():
    """Statics: p is where it is, and λ the moment of the weight."""
    system = driven_pendulum()
    q = project_position(system, state(system, {"bob": Pose()})[0], np.array([0.7, 0.0]))
    found, lam = static_equilibrium(system, q, np.array([0.7, 5.0]), np.zeros(0))
    np.testing.assert_allclose(found[3:5], [np.cos(0.7), np.sin(0.7)], atol=1e-13)
    assert lam[system.drives.row[0]] == pytest.approx(MASS * 9.81 * ARM * np.cos(0.7), rel=1e-12)


def test_a_drive_of_what_a_joint_holds_already_is_named():
    bob = RigidBody("bob", 1.0, np.zeros(3), np.eye(3))
    wall, end = Frame("wall"), Frame("end", "bob")
    system = assemble([bob], [fixed("weld", wall, end), Joint("motor", (angle(wall, end),))])
    with pytest.raises(InfeasibleError, match="motor"):
        project_position(system, state(system, {})[0], np.zeros(2))
    loose = assemble([bob], [spherical("ball", wall, end), Joint("motor", (angle(wall, end),))])
    turned_by = project_position(loose, state(loose, {})[0], np.array([0.3, 0.0]))
    assert Rotation.from_matrix(turned_by[3:12].reshape(3, 3).T).as_rotvec()[2] == pytest.approx(0.3, abs=0.05)


G = 9.81


def at(time):
    """The driven pendulum at an instant: system, q, v, u, p̈."""
    system, u = driven_pendulum(), turning(np.array([time]))[0]
    q = project_position(system, state(system, {"bob": Pose(rotation=turned(u[0]))})[0], u)
    return system, q, project_velocity(system, q, np.zeros(12), u), u, 16 * np.cos(2 * time)


@pytest.mark.parametrize("time", [0.0, 0.3, 0.7, 1.1])
def test_torque_of_the_drive_and_reaction_of_the_pivot_are_those_of_a_turning_arm(time):
    """T = J p̈ + m g a cos p;  F = m (a p̈ e_t − a ṗ² e_r − g): with the centripetal force that turns the mass."""
    system, q, v, u, second = at(time)
    found = instant(system, q, v, u, np.zeros(0), np.array([second]))
    p, rate = u
    assert found.drive[0] == pytest.approx(INERTIA * second + MASS * G * ARM * np.cos(p), rel=1e-11, abs=1e-9)
    radial, sideways = np.array([np.cos(p), np.sin(p), 0]), np.array([-np.sin(p), np.cos(p), 0])
    force = MASS * (ARM * second * sideways - ARM * rate**2 * radial + [0, G, 0])
    pivot, motor = system.joints
    wall, end = Frame("wall"), Frame("end", "bob")
    np.testing.assert_allclose(reaction(system, pivot, wall, end, q, found.lam, u), [*force, 0, 0, 0], atol=1e-10)
    np.testing.assert_allclose(reaction(system, motor, wall, end, q, found.lam, u), [0] * 5 + [found.drive[0]], atol=1e-10)


def test_accelerations_balance_the_forces_and_keep_the_constraints(driven):
    """M v̇ + c + f = Bᵀλ, and φ along q + vt + v̇t²/2, p + ṗt + p̈t²/2 has no second derivative."""
    system, q, v, u, theta = driven
    second = np.array([2.0, -1.0, 3.0])
    found = instant(system, q, v, u, theta, second)
    here = balance(system, q, v, u, theta, a=found.acceleration)
    scale = np.abs(here.load).max()
    np.testing.assert_allclose(here.load, here.B.T @ found.lam, atol=1e-11 * max(scale, np.abs(found.lam).max()))

    def phi(t):
        later = u.copy()
        later[-6:-3] += t * u[-3:] + 0.5 * t**2 * second
        return constraints_at(system, q + t * v + 0.5 * t**2 * found.acceleration, later)[0]

    e = 2e-3
    bend = (-phi(2 * e) + 16 * phi(e) - 30 * phi(0) + 16 * phi(-e) - phi(-2 * e)) / (12 * e**2)
    np.testing.assert_allclose(bend, 0.0, atol=1e-7 * np.abs(found.acceleration).max())


@pytest.mark.parametrize("place", [0, 1, 2, 3])
def test_a_reaction_does_the_work_of_its_constraints_on_any_rigid_motion(driven, place):
    """F·δp + M·δθ = (Bᵀλ)·δq of the rows of the joint, for a motion of the body of its second frame about any point, along any
    axes."""
    system, q, v, u, theta = driven
    lam = instant(system, q, v, u, theta, np.zeros(3)).lam
    joint = system.joints[place]
    _, B, _ = constraints_at(system, q, u)
    own = [k for k, name in enumerate(system.constraints) if name.startswith(f"{joint.name}:")]
    point = Frame("point", "arm" if place in (1, 3) else "rock", np.array([0.2, -0.3, 0.4]))
    work = B[own].T @ lam[own]
    axes = turned(0.5)
    found = reaction(system, joint, Frame("axes", None, np.zeros(3), axes), point, q, lam, u)
    r, R = q[system.of[point.body]][:3], q[system.of[point.body]][3:12].reshape(3, 3).T
    p = r + R @ point.origin
    for k, direction in enumerate(np.vstack([axes.T] * 2)):
        moved = np.zeros(system.size)
        span = system.of[point.body]
        if k < 3:
            moved[span.start : span.start + 3] = direction
        else:
            moved[span.start : span.start + 3] = np.cross(direction, r - p)
            moved[span.start + 3 : span.start + 12] = np.cross(direction, R.T).ravel()
        assert found[k] == pytest.approx(work @ moved, rel=1e-9, abs=1e-9 * np.abs(lam).max())


def test_slopes_of_an_accelerometer_are_its_differences(driven):
    system, q, v, u, theta = driven
    turning_g = turning_gravity("tilt", system.bodies, np.array([1.0, -9.0, 2.0]), np.array([0.0, 0.6, 0.8]))
    system = assemble(system.bodies, system.joints, [*system.forces, turning_g])
    u = np.insert(u, len(u) - 6, 0.3)
    second = np.array([2.0, -1.0, 3.0])
    frame = next(f.frame for f in system.forces if f.name == "push")
    rock = Frame("rock", "rock", np.array([0.1, 0.2, 0.3]))
    plain = Accelerometer("plain", rock, local_axes=False, gravity=False)
    both = readings(system, [Accelerometer("own", frame), plain, position_sensor("tip", frame)])
    found = measure(system, both, q, v, u, theta, second)
    assert both.channels[3:] == ("own 1", "own 2", "own 3", "plain 1", "plain 2", "plain 3")
    x = np.concatenate([q, v, u, theta])
    ends = np.cumsum([len(q), len(v), len(u), len(theta)])

    def at(x):
        return measure(system, both, *np.split(x, ends)[:4], second).y

    slopes = np.hstack([found.by_q, found.by_v, found.by_u, np.zeros((9, 6)), found.by_theta])
    for k, unit in enumerate(np.eye(len(x))):
        if ends[2] - 6 <= k < ends[2]:
            continue  # of p and ṗ, which are known
        e = 1e-3 * max(1.0, abs(x[k])) * unit
        difference = (8 * (at(x + e) - at(x - e)) - (at(x + 2 * e) - at(x - 2 * e))) / (12 * e[k])
        size = max(np.abs(slopes[:, k]).max(), 1e-6 * np.abs(found.y).max() / max(1.0, abs(x[k])))
        np.testing.assert_allclose(slopes[:, k], difference, rtol=0, atol=1e-7 * size, err_msg=str(k))
