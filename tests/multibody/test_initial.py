"""Consistent starts, and the systems that have none."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strainsight.errors import InfeasibleError
from strainsight.multibody.bodies import RigidBody
from strainsight.multibody.frames import Frame
from strainsight.multibody.initial import Pose, constraints_at, project_position, project_velocity, state
from strainsight.multibody.joints import Joint, fixed, prismatic, revolute, spherical
from strainsight.multibody.relations import dot, place
from strainsight.multibody.simulate import simulate
from strainsight.multibody.system import assemble

BALL = RigidBody("ball", 2.0, np.array([0.5, 0, 0]), np.diag([1.0, 2.0, 2.0]))
ROD = RigidBody("rod", 1.0, np.array([0.5, 0, 0]), np.diag([0.0, 1 / 3, 1 / 3]))


def frame(name, body, *origin):
    return Frame(name, body, np.array([*origin] or [0, 0, 0], dtype=float))


def test_projected_state_satisfies_position_and_velocity_constraints():
    system = assemble([BALL], [revolute("hinge", frame("wall", None), frame("end", "ball"))])
    rng = np.random.default_rng(0)
    q, v = state(system, {"ball": Pose(0.1 * rng.normal(size=3), Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix())})
    q = project_position(system, q)
    v = project_velocity(system, q, rng.normal(size=12))
    phi, B = constraints_at(system, q)
    assert np.abs(phi).max() < 1e-15
    assert np.abs(B @ v).max() < 1e-15
    assert np.linalg.norm(v) > 0.1


def test_projection_of_the_velocity_is_the_nearest_in_kinetic_energy_of_the_scale():
    system = assemble([BALL], [spherical("joint", frame("wall", None), frame("end", "ball"))])
    q, _ = state(system, {})
    rng = np.random.default_rng(1)
    wild, other = rng.normal(size=12), rng.normal(size=12)
    near, allowed = project_velocity(system, q, wild), project_velocity(system, q, other)
    assert (system.metric**2 * (wild - near)) @ allowed == pytest.approx(0, abs=1e-13)


def test_run_from_an_inconsistent_state_is_refused_by_name():
    system = assemble([BALL], [spherical("joint", frame("wall", None), frame("end", "ball"))])
    for pose, told in (
        (Pose(np.array([0, 0.1, 0])), "joint: y of end on wall is 0.1"),
        (Pose(velocity=np.array([0, 0, 2.0])), "the rate of joint: z of end on wall is 2"),
        (Pose(rotation=np.diag([1.0, 1.0, 1.2])), "body ball: Rz·Rz of its frame is 0.44"),
    ):
        with pytest.raises(InfeasibleError, match=told):
            simulate(system, *state(system, {"ball": pose}), np.zeros((2, 0)), 0.01, np.zeros(0))


def test_spin_turns_the_body_about_the_global_axis():
    system = assemble([BALL])
    R, spin = Rotation.from_rotvec([0.3, -0.5, 1.0]).as_matrix(), np.array([1.0, 2.0, 3.0])
    _, v = state(system, {"ball": Pose(rotation=R, spin=spin)})
    for k in range(3):
        np.testing.assert_allclose(v[3 + 3 * k : 6 + 3 * k], np.cross(spin, R[:, k]), atol=1e-15)


def test_contradictory_joints_are_named():
    """A ball held at two points 1 m apart on the body by places 1.2 m apart on the ground."""
    joints = [
        spherical("left", frame("hook", None), frame("end", "ball")),
        spherical("right", frame("eye", None, 1.2, 0, 0), frame("nose", "ball", 1, 0, 0)),
    ]
    system = assemble([BALL], joints)
    with pytest.raises(InfeasibleError, match="cannot all be satisfied") as refused:
        project_position(system, state(system, {})[0])
    assert "left: x of end on hook" in str(refused.value)
    assert "right: x of nose on eye" in str(refused.value)


def test_redundant_joints_are_named_with_what_they_follow_from():
    joints = [
        fixed("weld", frame("wall", None), frame("end", "ball")),
        Joint("again", (place(frame("nose", "ball", 1, 0, 0), np.array([0, 1.0, 0])),)),
    ]
    system = assemble([BALL], joints)
    with pytest.raises(InfeasibleError, match="1 of 13 constraints are redundant") as refused:
        project_position(system, state(system, {})[0])
    assert "again: place of nose" in str(refused.value)
    assert "weld: " in str(refused.value)


def test_constraint_that_nothing_can_change_is_named():
    idle = Joint("idle", (dot(frame("wall", None), 0, frame("floor", None), 1),))
    system = assemble([BALL], [idle])
    with pytest.raises(InfeasibleError, match=r"idle: x of wall · y of floor: no coordinate"):
        project_position(system, state(system, {})[0])


def test_motion_without_mass_is_named():
    """A straight rod can spin about itself for nothing, unless a joint holds that."""
    loose = assemble([BALL, ROD], [spherical("joint", frame("nose", "ball", 1, 0, 0), frame("end", "rod"))])
    q, _ = state(loose, {"rod": Pose(np.array([1.0, 0, 0]))})
    with pytest.raises(InfeasibleError, match="body rod can move without moving any mass"):
        project_position(loose, q)
    held = assemble([BALL, ROD], [revolute("joint", frame("nose", "ball", 1, 0, 0), frame("end", "rod"))])
    np.testing.assert_allclose(project_position(held, q), q, atol=1e-15)


def test_a_body_out_of_all_proportion_is_named():
    """Not its joints, nor its rigidity, is at fault."""
    planet = RigidBody("planet", 1e30, np.zeros(3), 1e30 * np.eye(3))
    system = assemble([BALL, planet], [spherical("joint", frame("wall", None), frame("end", "ball"))])
    with pytest.raises(InfeasibleError, match="the inertia of body planet is too large beside the rest"):
        project_position(system, state(system, {})[0])


def test_unknown_and_twin_names_are_refused():
    with pytest.raises(InfeasibleError, match="two bodies are called ball"):
        assemble([BALL, BALL])
    with pytest.raises(InfeasibleError, match="there is no body bal") as refused:
        assemble([BALL], [spherical("joint", frame("wall", None), frame("end", "bal"))])
    assert "did you mean ball?" in str(refused.value)
    with pytest.raises(InfeasibleError, match="there is no body bull"):
        state(assemble([BALL]), {"bull": Pose()})
    with pytest.raises(InfeasibleError, match="right-handed"):
        Frame("skew", None, axes=np.diag([1.0, 1.0, -1.0]))


def test_joints_leave_the_motions_they_are_named_for():
    wall, end = frame("wall", None), frame("end", "ball")
    for joint, free in ((spherical, 3), (revolute, 1), (prismatic, 1), (fixed, 0)):
        system = assemble([BALL], [joint("joint", wall, end)])
        q = project_position(system, state(system, {})[0])
        assert 12 - np.linalg.matrix_rank(constraints_at(system, q)[1]) == free
    system = assemble([BALL], [prismatic("slide", wall, end)])
    v = project_velocity(system, state(system, {})[0], np.array([0, 0, 1.0, *np.zeros(9)]))
    np.testing.assert_allclose(v, [0, 0, 1.0, *np.zeros(9)], atol=1e-15)
