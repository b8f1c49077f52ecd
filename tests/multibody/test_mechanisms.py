"""Published mechanisms with closed loops."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from strainsight.errors import InfeasibleError
from strainsight.multibody.forces import Gravity
from strainsight.multibody.initial import Pose, constraints_at, project_position, project_velocity, state
from strainsight.multibody.joints import pin, revolute
from strainsight.multibody.simulate import simulate
from strainsight.multibody.system import assemble

from .mechanisms import at, extrapolated, planar, turned


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
        phi, B = constraints_at(system, run.q[-1])
        assert np.abs(phi).max() < 1e-13
        assert np.abs(B @ run.v[-1]).max() < 1e-12
    exact = exact_four_bars(1.0)
    assert np.linalg.norm(ends[2] - exact) / np.linalg.norm(ends[3] - exact) == pytest.approx(4.0, abs=0.05)
    np.testing.assert_allclose(extrapolated(ends, 2), exact, atol=1e-7)


@pytest.mark.slow
def test_two_four_bars_are_at_their_published_place_after_ten_seconds():
    """They pass the singular position many times; steps of 5 ms."""
    system, q, v = four_bars()
    run = simulate(system, q, v, np.zeros((2001, 0)), 5e-3, np.zeros(0))
    np.testing.assert_allclose(run.q[-1, 3:5], [0.3284581115, 0.9445185382], rtol=0, atol=1e-3)


def test_third_revolute_joint_of_a_planar_loop_is_refused_by_name():
    rod = np.array([0.5, 0.0])
    bodies = [planar("left", 1.0, rod, 1 / 12), planar("top", 1.0, rod, 1 / 12), planar("right", 1.0, rod, 1 / 12)]
    joints = [
        revolute("A", at("ground A", None), at("foot A", "left")),
        revolute("D", at("ground D", None, 1), at("foot D", "right")),
        revolute("B", at("head A", "left", 1), at("start", "top")),
        revolute("C", at("head D", "right", 1), at("end", "top", 1)),
    ]
    system = assemble(bodies, joints)
    upright = {"left": Pose(rotation=turned(np.pi / 2)), "right": Pose(np.array([1.0, 0, 0]), turned(np.pi / 2))}
    q, _ = state(system, upright | {"top": Pose(np.array([0, 1.0, 0]))})
    with pytest.raises(InfeasibleError, match="3 of 38 constraints are redundant") as refused:
        project_position(system, q)
    assert "C: " in str(refused.value)
    assert "follows from" in str(refused.value)
    assert "pin" in str(refused.value)
    joints[-1] = pin("C", at("head D", "right", 1), at("end", "top", 1))
    np.testing.assert_allclose(project_position(assemble(bodies, joints), q), q, atol=1e-14)
