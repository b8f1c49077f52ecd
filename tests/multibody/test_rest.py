"""Equilibria and starts that the joints allow."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strainsight.errors import InfeasibleError, NumericalError
from strainsight.multibody.bodies import Frame, RigidBody
from strainsight.multibody.coupled import coupled_modes
from strainsight.multibody.forces import Gravity, Load, PointForce, PointMoment, RelativeElement
from strainsight.multibody.initial import (
    Pose,
    constraints_at,
    project_position,
    project_velocity,
    state,
    static_equilibrium,
)
from strainsight.multibody.joints import Joint, fixed, prismatic, revolute, spherical
from strainsight.multibody.laws import LinearLaw, spring, torsion
from strainsight.multibody.relations import bearing_displacements, coincidence, dot, place
from strainsight.multibody.simulate import simulate
from strainsight.multibody.step import step
from strainsight.multibody.system import assemble

BOB = RigidBody("bob", 1.0, np.array([1.0, 0, 0]), np.diag([1e-4, 1.0001, 1.0001]))
DOWN = Gravity(np.array([0, -9.81, 0]))


def test_pendulum_under_a_side_force_hangs_along_the_resultant():
    tip = Frame("tip", "bob", np.array([1.0, 0, 0]))
    force = PointForce("wind", tip, np.array([1.0, 0, 0]), ["F"])
    system = assemble([BOB], [revolute("pivot", Frame("wall"), Frame("end", "bob"))], [DOWN, force])
    q, _ = state(system, {})
    found, lam = static_equilibrium(system, q, np.array([5.0]), np.zeros(0))
    resultant = np.array([5.0, -9.81, 0])
    np.testing.assert_allclose(found[3:6], resultant / np.linalg.norm(resultant), atol=1e-10)
    np.testing.assert_allclose(lam[6:9], -resultant, atol=1e-9)
    assert np.abs(constraints_at(system, found)[0]).max() < 1e-14


def test_mass_hangs_from_a_flexible_body_as_far_as_both_give(random_particles):
    """A weight on a 5×5 spring on a clamped hub: the displacement is (Φ K⁻¹Φᵀ + k⁻¹) times the weight."""
    rng = np.random.default_rng(4)
    hub = random_particles(rng).flexible("hub", np.diag([1e6, 2e6, 3e6]), clamped=True)
    shape, turn = 0.1 * rng.normal(size=(3, 3)), np.zeros((3, 3))
    outer, ring = Frame("outer", "hub", displacement=shape, rotation=turn), Frame("ring", "stone")
    stone = RigidBody("stone", 10.0, np.zeros(3), np.eye(3))
    k = np.diag([1e6, 2e6, 3e6, 1e5, 1e5])
    mount = RelativeElement("bearing", bearing_displacements(outer, ring), LinearLaw(k, np.zeros(5)))
    held = Joint("spin", (dot(outer, 1, ring, 2),))
    weight = PointForce("F", ring, np.eye(3), ["x", "y", "z"])
    system = assemble([hub, stone], [held], [mount, weight])
    load = np.array([10.0, 20.0, -30.0])
    found, _ = static_equilibrium(system, state(system, {})[0], load, np.zeros(0))
    eta = np.linalg.solve(np.diag([1e6, 2e6, 3e6]), shape.T @ load)
    np.testing.assert_allclose(found[:3], eta, rtol=1e-7)
    np.testing.assert_allclose(found[3:6], shape @ eta + load / np.diag(k)[:3], rtol=1e-7)


def test_equilibrium_of_everything_is_where_the_damped_motion_ends(everything):
    e = everything
    found, lam = static_equilibrium(e.system, e.q, e.u, e.theta)
    moved = step(e.system, found, np.zeros(e.system.size), e.u, 0.1, e.theta)
    np.testing.assert_allclose(moved.q, found, atol=1e-9)
    joints = slice(e.system.rigid, None)
    np.testing.assert_allclose(moved.lam[joints], lam[joints], atol=1e-6 * np.abs(lam).max())


def test_mechanism_that_nothing_holds_is_named():
    top = RigidBody("top", 1.0, np.zeros(3), np.eye(3))
    system = assemble([top], [revolute("pivot", Frame("wall"), Frame("end", "top"))], [DOWN])
    with pytest.raises(InfeasibleError, match="no stiffness restrains body top"):
        static_equilibrium(system, state(system, {})[0], np.zeros(0), np.zeros(0))


def test_spring_hangs_by_its_stiffness():
    stone = RigidBody("stone", 2.0, np.zeros(3), np.eye(3))
    ends = [
        spring(
            f"rope {k}",
            Frame(f"hook {k}", None, np.array([x, 0, z])),
            Frame(f"eye {k}", "stone", np.array([x, -1.0, z])),
            300.0,
            1.0,
            0.9,
        )
        for k, (x, z) in enumerate([(1.0, 0.0), (-0.5, 0.8), (-0.5, -0.8)])
    ]
    system = assemble([stone], [], [*ends, DOWN])
    found, _ = static_equilibrium(
        system, state(system, {"stone": Pose(np.array([0, -0.1, 0]))})[0], np.zeros(0), np.zeros(0)
    )
    np.testing.assert_allclose(found[:3], [0, 1.0 - 0.9 - 2.0 * 9.81 / 900.0, 0], atol=1e-9)


def test_slow_and_fast_motions_of_one_bench_are_both_found_and_rounding_is_none():
    """1 kg on 1 mN/m beside 1 kg on 100 MN/m: six decades apart; a pendulum held level has no stiffness at all."""
    ground = Frame("ground", None)
    bodies, forces, frames = [], [], []
    for name, k in (("slow", 1e-3), ("fast", 1e8)):
        body = RigidBody(name, 1.0, np.zeros(3), np.eye(3))
        frame = Frame(name, name)
        bodies.append(body)
        frames.append(frame)
        forces.append(RelativeElement(name, (coincidence(ground, frame, 0),), LinearLaw(np.array([[k]]), np.zeros(1))))
    system = assemble(bodies, (), forces)
    q, v = state(system, {})
    found = coupled_modes(system, q, v, np.zeros(0), np.zeros(0)).held_frequency
    np.testing.assert_allclose(found, np.sqrt([1e-3, 1e8]) / (2 * np.pi), rtol=1e-3)
    level = assemble([BOB], [revolute("hinge", Frame("pivot", None), Frame("end", "bob"))], [DOWN])
    q, v = state(level, {})
    assert len(coupled_modes(level, q, v, np.zeros(0), np.zeros(0)).held_frequency) == 0


def test_a_force_that_ends_on_the_way_is_approached_in_smaller_steps():
    """F = a/(1 − ρ) ends at ρ = 1, which Newton's first step from 0 would overshoot: at rest a/(1 − z) is the load."""

    def load(rho, rho_dot, theta):
        if rho[0] >= 1:
            raise NumericalError("beyond the end")
        return Load(1.0 / (1 - rho), np.diag(1.0 / (1 - rho) ** 2), None, np.zeros((1, 0)))

    stone = RigidBody("stone", 2.0, np.zeros(3), np.eye(3))
    end = Frame("centre", "stone")
    stop = RelativeElement("stop", (coincidence(Frame("wall"), end, 2),), SimpleNamespace(load=load))
    lift = PointForce("lift", end, np.array([0, 0, 1.0]), ["F"])
    system = assemble([stone], [prismatic("guide", Frame("rail"), end)], [stop, lift])
    found, _ = static_equilibrium(system, state(system, {})[0], np.array([20.0]), np.zeros(0))
    assert found[2] == pytest.approx(1 - 1 / 20.0, rel=1e-9)


def test_a_force_that_allows_no_equilibrium_is_named():
    """A torsion spring of 1 N m/rad under 4 N m: it would have to turn by 4 rad."""
    disc = RigidBody("disc", 1.0, np.zeros(3), np.eye(3))
    end = Frame("end", "disc")
    wind = PointMoment("wind", end, np.array([0, 0, 1.0]), ["M"])
    hinge = revolute("hinge", Frame("wall"), end)
    system = assemble([disc], [hinge], [torsion("coil", Frame("rim"), Frame("eye", "disc"), 1.0), wind])
    with pytest.raises(NumericalError, match="coil: the torsion spring is rotated by"):
        static_equilibrium(system, state(system, {})[0], np.array([4.0]), np.zeros(0))


BALL = RigidBody("ball", 2.0, np.array([0.5, 0, 0]), np.diag([1.0, 2.0, 2.0]))
ROD = RigidBody("rod", 1.0, np.array([0.5, 0, 0]), np.diag([0.0, 1 / 3, 1 / 3]))


def frame(name, body, *origin):
    return Frame(name, body, np.array([*origin] or [0, 0, 0], dtype=float))


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
        (
            Pose(np.array([0, 0.1, 0])),
            "residual 0.1 in the position constraint 'joint: global y position of end relative to wall'",
        ),
        (
            Pose(velocity=np.array([0, 0, 2.0])),
            "residual 2 in the velocity constraint 'joint: global z position of end relative to wall'",
        ),
        (
            Pose(rotation=np.diag([1.0, 1.0, 1.2])),
            "residual 0.44 in the position constraint 'scalar product of the z axis and the z axis of body ball'",
        ),
    ):
        with pytest.raises(InfeasibleError, match=told):
            simulate(system, *state(system, {"ball": pose}), np.zeros((2, 0)), 0.01, np.zeros(0))


def test_spin_turns_the_body_about_the_global_axis():
    system = assemble([BALL])
    R, spin = Rotation.from_rotvec([0.3, -0.5, 1.0]).as_matrix(), np.array([1.0, 2.0, 3.0])
    _, v = state(system, {"ball": Pose(rotation=R, spin=spin)})
    for k in range(3):
        np.testing.assert_allclose(v[3 + 3 * k : 6 + 3 * k], np.cross(spin, R[:, k]), atol=1e-15)


def test_inconsistent_joints_are_named():
    """A ball held at two points 1 m apart on the body by places 1.2 m apart on the ground."""
    joints = [
        spherical("left", frame("hook", None), frame("end", "ball")),
        spherical("right", frame("eye", None, 1.2, 0, 0), frame("nose", "ball", 1, 0, 0)),
    ]
    system = assemble([BALL], joints)
    with pytest.raises(InfeasibleError, match="cannot all be satisfied") as refused:
        project_position(system, state(system, {})[0])
    assert "left: global x position of end relative to hook" in str(refused.value)
    assert "right: global x position of nose relative to eye" in str(refused.value)


def test_redundant_joints_are_named_with_what_they_follow_from():
    joints = [
        fixed("weld", frame("wall", None), frame("end", "ball")),
        Joint("again", (place(frame("nose", "ball", 1, 0, 0), np.array([0, 1.0, 0])),)),
    ]
    system = assemble([BALL], joints)
    with pytest.raises(InfeasibleError, match="1 of 13 constraints are redundant") as refused:
        project_position(system, state(system, {})[0])
    assert "again: global position of nose" in str(refused.value)
    assert "weld: " in str(refused.value)


def test_constraint_that_nothing_can_change_is_named():
    idle = Joint("idle", (dot(frame("wall", None), 0, frame("floor", None), 1),))
    system = assemble([BALL], [idle])
    with pytest.raises(InfeasibleError, match="scalar product of the x axis of wall and the y axis of floor' restrains no"):
        project_position(system, state(system, {})[0])


def test_motion_without_mass_is_named():
    loose = assemble([BALL, ROD], [spherical("joint", frame("nose", "ball", 1, 0, 0), frame("end", "rod"))])
    q, _ = state(loose, {"rod": Pose(np.array([1.0, 0, 0]))})
    with pytest.raises(InfeasibleError, match="body rod can move without inertia"):
        project_position(loose, q)
    held = assemble([BALL, ROD], [revolute("joint", frame("nose", "ball", 1, 0, 0), frame("end", "rod"))])
    np.testing.assert_allclose(project_position(held, q), q, atol=1e-15)


def test_disproportionate_inertia_is_named():
    planet = RigidBody("planet", 1e30, np.zeros(3), 1e30 * np.eye(3))
    system = assemble([BALL, planet], [spherical("joint", frame("wall", None), frame("end", "ball"))])
    with pytest.raises(InfeasibleError, match=r"the inertia of body planet is about \de\+\d+ times the smallest inertia"):
        project_position(system, state(system, {})[0])


def test_joints_leave_the_motions_they_are_named_for():
    wall, end = frame("wall", None), frame("end", "ball")
    for joint, free in ((spherical, 3), (revolute, 1), (prismatic, 1), (fixed, 0)):
        system = assemble([BALL], [joint("joint", wall, end)])
        q = project_position(system, state(system, {})[0])
        assert 12 - np.linalg.matrix_rank(constraints_at(system, q)[1]) == free
    system = assemble([BALL], [prismatic("slide", wall, end)])
    v = project_velocity(system, state(system, {})[0], np.array([0, 0, 1.0, *np.zeros(9)]))
    np.testing.assert_allclose(v, [0, 0, 1.0, *np.zeros(9)], atol=1e-15)
