"""Coupled modes, stability and the state space."""

import numpy as np
import pytest

from strainsight.multibody.bodies import RigidBody
from strainsight.multibody.coupled import coupled_modes, growth
from strainsight.multibody.forces import Gravity
from strainsight.multibody.frames import Frame
from strainsight.multibody.initial import Pose, state
from strainsight.multibody.joints import revolute
from strainsight.multibody.laws.actuators import follower_force
from strainsight.multibody.laws.torsion import torsion
from strainsight.multibody.sensors import RelationSensor, readings
from strainsight.multibody.spectrum import coupled_frequencies
from strainsight.multibody.static import static_equilibrium
from strainsight.multibody.system import assemble

from .mechanisms import turned

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


def test_a_wheel_that_nothing_holds_is_neither_stable_nor_falling():
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
    """y = −C A⁻¹ B Δu for a constant load, and its modes are those of the spectrum."""
    e = everything
    q, _ = static_equilibrium(e.system, e.q, e.u, e.theta)
    modes = coupled_modes(e.system, q, 0 * q, e.u, e.theta)
    np.testing.assert_allclose(
        modes.frequency[modes.squares > 0], coupled_frequencies(e.system, q, 0 * q, e.u, e.theta), rtol=1e-9
    )
    ring = next(f for f in e.system.forces if f.name == "ring")
    sensor = readings(e.system, [RelationSensor("ring", ring.relations)])
    C = sensor.read(q, 0 * q)[1] @ modes.shapes
    gain = C @ np.linalg.solve(modes.K, modes.B)
    for k, step in enumerate(np.eye(len(e.u)) * 1e-3):
        ends = [static_equilibrium(e.system, q, e.u + sign * step, e.theta, near=True)[0] for sign in (1, -1)]
        difference = (sensor.read(ends[0], 0 * q)[0] - sensor.read(ends[1], 0 * q)[0]) / 2e-3
        np.testing.assert_allclose(gain[:, k], difference, atol=1e-6 * np.abs(gain).max())
