"""Free rotation of rigid bodies."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from strainsight.multibody.advance import GAIN, LAG
from strainsight.multibody.bodies import RigidBody
from strainsight.multibody.forces import Gravity, PointForce, PointMoment
from strainsight.multibody.frames import Frame
from strainsight.multibody.initial import Pose, state
from strainsight.multibody.joints import spherical
from strainsight.multibody.simulate import simulate
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


def test_fast_top_keeps_its_tilt():
    """A disc on a rod that spins with 100 rad/s under its weight, 1 s in steps of 1 ms, beside Lagrange's equations of its
    angles: φ̇ sin²θ I₁ + I₃ω₃ cos θ and I₃ω₃ are constant, I₁ θ̈ = I₁ φ̇² sin θ cos θ − I₃ω₃ φ̇ sin θ + m g l sin θ."""
    m, length, I1, I3, tilt, spin, steps = 2.0, 0.3, 0.22, 0.05, 0.6, 100.0, 1000
    L = I3 * spin
    turning = L * np.cos(tilt)

    def rate(t, y):
        s, c = np.sin(y[0]), np.cos(y[0])
        drift = (turning - L * c) / (I1 * s * s)
        return [y[1], drift * drift * s * c - (L * drift * s - m * 9.81 * length * s) / I1, drift]

    found = solve_ivp(rate, (0, 1.0), [tilt, 0.0, 0.0], rtol=1e-12, atol=1e-12).y[:, -1]
    axis = np.array([np.sin(found[0]) * np.sin(found[2]), -np.sin(found[0]) * np.cos(found[2]), np.cos(found[0])])
    leaning = Rotation.from_rotvec([tilt, 0, 0]).as_matrix()
    body = RigidBody("top", m, np.array([0, 0, length]), np.diag([I1, I1, I3]))
    system = assemble([body], [spherical("foot", Frame("floor"), Frame("tip", "top"))], [Gravity()])
    q, v = state(system, {"top": Pose(rotation=leaning, spin=spin * leaning[:, 2])})
    run = simulate(system, q, v, np.zeros((steps + 1, 0)), 1.0 / steps, np.zeros(0))
    own = run.q[-1, 9:12]
    assert np.arccos(own[2]) == pytest.approx(np.arccos(axis[2]), abs=1e-3)
    np.testing.assert_allclose(own, axis, rtol=0, atol=3e-3)


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


def test_momentum_of_a_rigid_body_changes_by_the_impulse_of_the_force_exactly():
    """Its mass matrix is constant: Σ M (v' − v)/h = Σ f over the rows of r, whatever the step."""
    centre = np.array([0.3, -0.2, 0.5])
    body = RigidBody("stone", 3.0, centre, INERTIA + 3.0 * (centre @ centre * np.eye(3) - np.outer(centre, centre)))
    corner = Frame("corner", "stone", np.array([1.0, 0.0, 0.0]))
    system = assemble([body], [], [PointForce("F", corner, np.array([1.0, 2.0, 0.0]), ["F"])])
    q, v = state(system, {"stone": Pose(velocity=np.array([1.0, 0, 0]), spin=SPIN)})
    run = simulate(system, q, v, np.full((21, 1), 0.7), 0.05, np.zeros(0))
    momentum = (run.v @ system.mass.T)[:, :3]
    np.testing.assert_allclose(momentum[-1] - momentum[0], 0.7 * np.array([1.0, 2.0, 0.0]), atol=1e-12)
