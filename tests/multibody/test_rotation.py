"""Free rotation of rigid bodies."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from strainsight.multibody.bodies import RigidBody
from strainsight.multibody.forces import PointForce, PointMoment
from strainsight.multibody.frames import Frame
from strainsight.multibody.initial import Pose, state
from strainsight.multibody.simulate import simulate
from strainsight.multibody.system import assemble

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
        run = simulate(system, q, v, np.tile(moment, (steps, 1)), 2.0 / steps, np.zeros(0))
        ends.append(run.q[-1, 3:12])
    R, _ = euler(moment, 2.0)
    for k in range(1, 5):
        ends = [(2**k * fine - coarse) / (2**k - 1) for coarse, fine in pairwise(ends)]
    np.testing.assert_allclose(ends[0].reshape(3, 3).T, R, atol=2e-5)


def test_momentum_of_a_rigid_body_changes_by_the_impulse_of_the_force_exactly():
    """Its mass matrix is constant: Σ M (v' − v)/h = Σ f over the rows of r, whatever the step."""
    centre = np.array([0.3, -0.2, 0.5])
    body = RigidBody("stone", 3.0, centre, INERTIA + 3.0 * (centre @ centre * np.eye(3) - np.outer(centre, centre)))
    corner = Frame("corner", "stone", np.array([1.0, 0.0, 0.0]))
    system = assemble([body], [], [PointForce("F", corner, np.array([1.0, 2.0, 0.0]), ["F"])])
    q, v = state(system, {"stone": Pose(velocity=np.array([1.0, 0, 0]), spin=SPIN)})
    run = simulate(system, q, v, np.full((20, 1), 0.7), 0.05, np.zeros(0))
    momentum = (run.v @ system.mass.T)[:, :3]
    np.testing.assert_allclose(momentum[-1] - momentum[0], 0.7 * np.array([1.0, 2.0, 0.0]), atol=1e-12)
