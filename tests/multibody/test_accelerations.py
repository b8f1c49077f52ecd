"""Accelerations, reactions and the forces of drives at an instant."""

import numpy as np
import pytest

from strainsight.multibody.accelerations import instant, measured, reaction
from strainsight.multibody.equations import balance
from strainsight.multibody.frames import Frame
from strainsight.multibody.initial import Pose, constraints_at, project_position, project_velocity, state
from strainsight.multibody.laws.turning import turning_gravity
from strainsight.multibody.sensors import Accelerometer, position_sensor, readings
from strainsight.multibody.system import assemble

from .mechanisms import turned
from .test_drives import ARM, INERTIA, MASS, driven, driven_pendulum, turning  # noqa: F401

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


def test_accelerations_balance_the_forces_and_keep_the_constraints(driven):  # noqa: F811
    """M v̇ + c + f = Bᵀλ, and φ along q + vt + v̇t²/2, p + ṗt + p̈t²/2 has no second derivative."""
    system, q, v, u, theta = driven
    second = np.array([2.0, -1.0, 3.0])
    found = instant(system, q, v, u, theta, second)
    none = np.zeros(system.constrained)
    here = balance(system, q, v, found.acceleration, none, none, u, theta, system.at(theta))
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
def test_a_reaction_does_the_work_of_its_constraints_on_any_rigid_motion(driven, place):  # noqa: F811
    """F·δp + M·δθ = (Bᵀλ)·δq of the rows of the joint, for a motion of the body of its second frame about any point, along any
    axes."""
    system, q, v, u, theta = driven
    lam = instant(system, q, v, u, theta, np.zeros(3)).lam
    joint = system.joints[place]
    _, B = constraints_at(system, q, u)
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


def test_slopes_of_an_accelerometer_are_its_differences(driven):  # noqa: F811
    system, q, v, u, theta = driven
    turning_g = turning_gravity("tilt", system.bodies, np.array([1.0, -9.0, 2.0]), np.array([0.0, 0.6, 0.8]))
    system = assemble(system.bodies, system.joints, [*system.forces, turning_g])
    u = np.insert(u, len(u) - 6, 0.3)
    second = np.array([2.0, -1.0, 3.0])
    frame = next(f.frame for f in system.forces if f.name == "push")
    rock = Frame("rock", "rock", np.array([0.1, 0.2, 0.3]))
    plain = Accelerometer("plain", rock, own=False, gravity=False)
    both = readings(system, [Accelerometer("own", frame), plain, position_sensor("tip", frame)])
    found = measured(system, both, q, v, u, theta, second)
    assert both.channels[3:] == ("own 1", "own 2", "own 3", "plain 1", "plain 2", "plain 3")
    x = np.concatenate([q, v, u, theta])
    ends = np.cumsum([len(q), len(v), len(u), len(theta)])

    def at(x):
        return measured(system, both, *np.split(x, ends)[:4], second).y

    slopes = np.hstack([found.by_q, found.by_v, found.by_u, np.zeros((9, 6)), found.by_theta])
    for k, unit in enumerate(np.eye(len(x))):
        if ends[2] - 6 <= k < ends[2]:
            continue  # of p and ṗ, which are known
        e = 1e-3 * max(1.0, abs(x[k])) * unit
        difference = (8 * (at(x + e) - at(x - e)) - (at(x + 2 * e) - at(x - 2 * e))) / (12 * e[k])
        size = max(np.abs(slopes[:, k]).max(), 1e-6 * np.abs(found.y).max() / max(1.0, abs(x[k])))
        np.testing.assert_allclose(slopes[:, k], difference, rtol=0, atol=1e-7 * size, err_msg=str(k))
