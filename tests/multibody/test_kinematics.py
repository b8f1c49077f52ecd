"""Rotations, relations of frames and sensors: values and slopes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from strainsight.multibody.accelerations import balance
from strainsight.multibody.bodies import Frame, RigidBody
from strainsight.multibody.forces import PointMoment
from strainsight.multibody.initial import Pose, state
from strainsight.multibody.relations import (
    bearing_displacements,
    coincidence,
    compile_products,
    distance_squared,
    dot,
    offset,
    relation_rows,
)
from strainsight.multibody.sensors import RelationSensor, StrainSensor, axis_sensor, position_sensor, readings
from strainsight.multibody.simulate import simulate
from strainsight.multibody.step import GAIN, LAG
from strainsight.multibody.system import assemble

from .mechanisms import extrapolated

INERTIA = np.diag([1.0, 2.0, 2.5])
SPIN = np.array([0.3, 2.0, 0.2])
"""Near the unstable axis: the body turns over."""


def euler(moment, duration):
    """R and ω after the duration from I ω̇ + ω × Iω = RᵀT in body axes, and the quaternion of the body."""

    def rate(t, y):
        R = Rotation.from_quat(y[3:]).as_matrix()
        w = y[:3]
        turn = np.array(
            [[0, w[2], -w[1], w[0]], [-w[2], 0, w[0], w[1]], [w[1], -w[0], 0, w[2]], [-w[0], -w[1], -w[2], 0]]
        )
        return np.concatenate([np.linalg.solve(INERTIA, R.T @ moment - np.cross(w, INERTIA @ w)), 0.5 * turn @ y[3:]])

    y = solve_ivp(rate, (0, duration), [*SPIN, 0, 0, 0, 1], method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    return Rotation.from_quat(y[3:]).as_matrix(), y[:3]


@pytest.mark.parametrize("moment", [np.zeros(3), np.array([0.5, -1.0, 0.8])])
def test_body_turns_by_eulers_equations(moment):
    frame = Frame("root", "top")
    system = assemble(
        [RigidBody("top", 3.0, np.zeros(3), INERTIA)], [], [PointMoment("T", frame, np.eye(3), ["Tx", "Ty", "Tz"])]
    )
    q, v = state(system, {"top": Pose(spin=SPIN)})
    ends = []
    for steps in (100, 200, 400, 800, 1600):
        run = simulate(system, q, v, np.tile(moment, (steps + 1, 1)), 2.0 / steps, np.zeros(0))
        ends.append(run.q[-1, 3:12])
    R, _ = euler(moment, 2.0)
    np.testing.assert_allclose(extrapolated(ends, 2).reshape(3, 3).T, R, atol=1e-7)


@pytest.mark.parametrize("turn", [0.02, 0.1])
def test_what_turns_freely_lags_by_the_square_of_a_step_s_angle_and_keeps_its_spin_to_the_fourth_power(turn):
    """Implicit Euler brakes it, by φ²/2 of its spin a step."""
    h, steps = turn / 10.0, 50
    system = assemble([RigidBody("top", 3.0, np.zeros(3), np.diag([1.0, 1.0, 1.5]))])
    q, v = state(system, {"top": Pose(spin=np.array([0, 0, 10.0]))})
    run = simulate(system, q, v, np.zeros((steps + 1, 0)), h, np.zeros(0))
    angle = np.unwrap(np.arctan2(run.q[:, 4], run.q[:, 3]))[-1]
    assert 1 - angle / (turn * steps) == pytest.approx(LAG * turn**2, rel=0.05)
    spin = np.linalg.norm(run.v[:, 3:12], axis=1) / np.sqrt(2)
    assert spin[-1] / spin[0] - 1 == pytest.approx(GAIN * turn**4 * steps, rel=0.05)
    braked = simulate(system, q, v, np.zeros((2, 0)), h, np.zeros(0), "thesis").v[-1, 3:12]
    assert np.linalg.norm(braked) / np.sqrt(2) / 10.0 == pytest.approx(1 - turn**2 / 2, abs=turn**4)


def all_relations(everything):
    system, q, v = everything.system, everything.q, everything.v
    return system.products, q, v


def test_gradients_are_the_differences_of_the_values(everything):
    p, q, v = all_relations(everything)
    q = q + 0.1 * everything.rng.normal(size=len(q))
    _, G, G_rate = relation_rows(p, q, v)
    # of degree four in q: a five-point difference is exact
    e = 0.05
    for k, unit in enumerate(np.eye(len(q))):

        def at(s, u=unit):
            return relation_rows(p, q + s * u, v)

        near, far = [at(e), at(-e)], [at(2 * e), at(-2 * e)]
        slope = (8 * (near[0][0] - near[1][0]) - (far[0][0] - far[1][0])) / (12 * e)
        np.testing.assert_allclose(G[:, k], slope, rtol=0, atol=1e-11 * max(1, np.abs(G).max()))
        rate = (8 * (near[0][1] - near[1][1]) - (far[0][1] - far[1][1])) @ v / (12 * e)
        np.testing.assert_allclose(G_rate[:, k], rate, rtol=0, atol=1e-11 * max(1, np.abs(G_rate).max()))


def test_curvature_is_the_difference_of_the_gradients(everything):
    x, e = everything, 0.05
    n, m = x.system.size, x.system.constrained
    mu = x.rng.normal(size=m)
    H = balance(x.system, x.q, x.v, x.u, x.theta, mu=mu).constraint_stiffness
    for k, unit in enumerate(np.eye(n)):

        def slope(s, u=unit):
            return mu @ relation_rows(x.system.products, x.q + s * u, x.v)[1][:m]

        difference = (8 * (slope(e) - slope(-e)) - (slope(2 * e) - slope(-2 * e))) / (12 * e)
        np.testing.assert_allclose(H[:, k], difference, rtol=0, atol=1e-11 * np.abs(H).max())


def test_relations_have_their_geometric_values():
    turn = np.array([[np.cos(0.3), -np.sin(0.3), 0], [np.sin(0.3), np.cos(0.3), 0], [0, 0, 1.0]])
    i, j = Frame("i"), Frame("j", None, np.array([1.0, 2.0, 3.0]), turn)
    relations = [
        coincidence(i, j, 1),
        dot(i, 0, j, 1),
        offset(j, 0, i),
        distance_squared(i, j),
        *bearing_displacements(i, j),
    ]
    rho = relation_rows(compile_products(relations, []), np.zeros(0), np.zeros(0))[0]
    along = -np.cos(0.3) - 2 * np.sin(0.3)
    np.testing.assert_allclose(rho, [2.0, -np.sin(0.3), along, 14.0, 1.0, 2.0, 3.0, 0.0, np.sin(0.3)], atol=1e-15)


def test_tilts_of_a_bearing_are_small_right_handed_angles(particles):
    cloud = particles(np.ones(4), np.vstack([np.eye(3), np.zeros(3)]), np.zeros((4, 3, 0)))
    ring = Frame("ring", "inner")
    system = assemble([cloud.rigid("inner")])
    p = compile_products(bearing_displacements(Frame("outer"), ring), system.bodies)
    for axis, row in ((1, 3), (2, 4)):
        q, v = state(system, {"inner": Pose(spin=np.eye(3)[axis])})
        _, G, *_ = relation_rows(p, q, v)
        np.testing.assert_allclose(G @ v, np.eye(5)[row], atol=1e-15)


def test_slopes_of_all_sensors_are_their_differences(everything):
    e = everything
    tip = Frame("tip", "arm", np.ones(3), np.eye(3), np.ones((3, 3)), np.eye(3))
    strain = StrainSensor("gauge", "hub", np.arange(8.0).reshape(2, 4))
    displacements = bearing_displacements(Frame("wall"), tip)
    sensors = [
        position_sensor("tip", tip), position_sensor("tip speed", tip, rate=True), strain,
        axis_sensor("nose", tip, 0), RelationSensor("ring", displacements), RelationSensor("ring rate", displacements, rate=True),
    ]  # fmt: skip
    both = readings(e.system, sensors)
    y, by_q, by_v = both.read(e.q, e.v)
    assert len(both.channels) == len(y) == 21
    assert both.channels[:3] == ("gauge 1", "gauge 2", "tip: global position of tip")
    np.testing.assert_allclose(y[:2], strain.rows @ e.q[:4])
    n, size = len(e.q), 0.05
    for k, unit in enumerate(np.eye(n)):

        def at(s, u=unit):
            return both.read(e.q + s * u, e.v)[0]

        slope = (8 * (at(size) - at(-size)) - (at(2 * size) - at(-2 * size))) / (12 * size)
        np.testing.assert_allclose(by_q[:, k], slope, atol=1e-11)
        np.testing.assert_allclose(by_v[:, k], both.read(e.q, e.v + unit)[0] - y, atol=1e-11)


def test_position_of_a_frame_is_that_of_its_particle(random_particles, everything):
    e = everything
    corner = Frame("corner", "rock", np.array([1.0, 2.0, 3.0]))
    y, *_ = readings(e.system, [position_sensor("corner", corner), axis_sensor("x", corner, 1)]).read(e.q, e.v)
    own = e.q[e.system.of["rock"]]
    R = own[3:].reshape(3, 3).T
    np.testing.assert_allclose(y, np.concatenate([own[:3] + R @ [1.0, 2.0, 3.0], R[:, 1]]), atol=1e-15)
