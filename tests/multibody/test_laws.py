"""Springs and dampers: slopes, closed forms of damped motion, and what they refuse."""

import numpy as np
import pytest
from scipy.linalg import expm

from strainsight.errors import NumericalError
from strainsight.multibody.bodies import Frame, RigidBody
from strainsight.multibody.forces import Gravity, Load, RelativeElement
from strainsight.multibody.initial import Pose, state, static_equilibrium
from strainsight.multibody.joints import prismatic, revolute
from strainsight.multibody.laws import LAWS, bushing, spring, torsion
from strainsight.multibody.relations import place
from strainsight.multibody.sensors import RelationSensor, readings
from strainsight.multibody.simulate import simulate
from strainsight.multibody.system import assemble

from .mechanisms import extrapolated, turned

M, K, C = 2.0, 200.0, 8.0
SIX = [3.0, 4.0, 5.0, 0.6, 0.7, 0.8]
KEYS = {
    "spring": {"stiffness": 30.0, "damping": 2.0, "length": 0.4},
    "bushing": {"stiffness": SIX, "damping": SIX[::-1]},
    "torsion": {"stiffness": 30.0, "damping": 2.0, "angle": 0.3, "axis": "y"},
    "friction": {"motion": "turn", "coulomb": 3.0, "viscous": 2.0, "speed": 1.5, "axis": "y"},
    "torque": {"axis": "y"},
    "actuator": {},
}
"""Keys of every law."""


@pytest.mark.parametrize("kind", LAWS)
def test_slopes_of_a_law_are_its_differences(kind):
    element = LAWS[kind]("law", Frame("i"), Frame("j"), **KEYS[kind])
    rng = np.random.default_rng(2)
    k, none = len(element.relations), np.full(len(element.inputs), 1.7)
    rho, rate, e = rng.uniform(0.3, 0.9, k), rng.normal(size=k), 1e-4
    found = element.law.load(rho, rate, none)
    for slopes, at in (
        (found.F_rho, lambda d: element.law.load(rho + d, rate, none).F),
        (found.F_rate, lambda d: element.law.load(rho, rate + d, none).F),
    ):
        if slopes is None:  # what does not feel the rate
            assert element.inputs
            continue
        columns = [(8 * (at(d) - at(-d)) - (at(2 * d) - at(-2 * d))) / (12 * e) for d in e * np.eye(k)]
        np.testing.assert_allclose(slopes, np.stack(columns, axis=1), rtol=0, atol=1e-9 * np.abs(slopes).max())


def slider(stiffness, damping, kind="bushing"):
    """A stone of M that slides along z, held at 0 by a spring and a damper; its coordinate is 2."""
    stone = RigidBody("stone", M, np.zeros(3), np.eye(3))
    if kind == "bushing":
        element = bushing(
            "law", Frame("wall"), Frame("end", "stone"), [0, 0, stiffness, 0, 0, 0], [0, 0, damping, 0, 0, 0]
        )
    else:
        hook = Frame("hook", None, np.array([0, 0, -3.0]))
        element = spring("law", hook, Frame("end", "stone"), stiffness, damping, 3.0)
    return assemble([stone], [prismatic("guide", Frame("rail"), Frame("centre", "stone"))], [element])


def wheel(stiffness, damping):
    """A wheel of moment of inertia M about z, held at 0 by a torsion spring and a damper."""
    disc = RigidBody("disc", 1.0, np.zeros(3), M * np.eye(3))
    element = torsion("law", Frame("wall"), Frame("end", "disc"), stiffness, damping)
    return assemble([disc], [revolute("hinge", Frame("rail"), Frame("centre", "disc"))], [element])


def angle_of(q):
    return np.arctan2(q[..., 4], q[..., 3])


@pytest.mark.parametrize(("method", "order"), [("second_order", 2), ("thesis", 1)])
@pytest.mark.parametrize(("kind", "damping"), [("bushing", C), ("spring", 2 * np.sqrt(K * M)), ("torsion", 100.0)])
def test_mass_on_spring_and_damper_approaches_its_closed_form_at_the_order_of_the_method(kind, damping, method, order):
    system = wheel(K, damping) if kind == "torsion" else slider(K, damping, kind)
    start = {"disc": Pose(rotation=turned(0.5))} if kind == "torsion" else {"stone": Pose(np.array([0, 0, 0.5]))}
    q, v = state(system, start)
    ends = []
    for steps in (100, 200, 400, 800):
        end = simulate(system, q, v, np.zeros((steps + 1, 0)), 0.5 / steps, np.zeros(0), method).q[-1]
        ends.append(angle_of(end) if kind == "torsion" else end[2])
    exact = (expm(0.5 * np.array([[0, 1], [-K / M, -damping / M]])) @ [0.5, 0.0])[0]
    assert np.log2((ends[2] - exact) / (ends[3] - exact)) == pytest.approx(order, abs=0.04)
    assert extrapolated(ends, order) == pytest.approx(exact, abs=1e-6)


@pytest.mark.parametrize("kind", sorted(LAWS.keys() - {"torque", "actuator"}))
def test_a_damper_takes_work_in_any_motion(kind):
    element = LAWS[kind]("law", Frame("i"), Frame("j"), **KEYS[kind])
    rng = np.random.default_rng(4)
    for _ in range(50):
        rho, rate = rng.uniform(0.1, 1.0, len(element.relations)), rng.normal(size=len(element.relations))
        F, held = (element.law.load(rho, x, np.zeros(0)).F for x in (rate, 0 * rate))
        assert (F - held) @ rate > 0


def test_a_stone_in_a_quadratic_drag_falls_as_its_closed_form():
    """v = v∞ tanh(g t / v∞), v∞ = √(mg/c): a law of ρ̇ alone, which no spring stands beside."""

    def load(rho, rho_dot, theta):
        return Load(C * rho_dot * np.abs(rho_dot), np.zeros((1, 1)), np.diag(2 * C * np.abs(rho_dot)), np.zeros((1, 0)))

    stone = RigidBody("stone", M, np.zeros(3), np.eye(3))
    drag = type("Drag", (), {"load": staticmethod(load)})()
    height = (place(Frame("centre", "stone"), np.array([0, 0, 1.0])),)
    system = assemble([stone], [], [RelativeElement("drag", height, drag), Gravity()])
    final, ends = np.sqrt(M * 9.81 / C), []
    for steps in (50, 100, 200, 400):
        ends.append(simulate(system, *state(system, {}), np.zeros((steps + 1, 0)), 0.2 / steps, np.zeros(0)).v[-1, 2])
    exact = -final * np.tanh(9.81 * 0.2 / final)
    assert np.log2((ends[2] - exact) / (ends[3] - exact)) == pytest.approx(2, abs=0.04)
    assert extrapolated(ends, 2) == pytest.approx(exact, abs=1e-7)


def test_a_rotational_damper_alone_turns_as_far_as_it_likes():
    """ω = ω₀ exp(−ct/I), over more than a whole turn."""
    system, exact = wheel(0.0, 1.0), 12.0 * np.exp(-1.0 / M)
    q, v = state(system, {"disc": Pose(spin=np.array([0, 0, 12.0]))})
    ends = []
    for steps in (100, 200, 400, 800):
        run = simulate(system, q, v, np.zeros((steps + 1, 0)), 1.0 / steps, np.zeros(0))
        ends.append(run.q[-1, 3] * run.v[-1, 4] - run.q[-1, 4] * run.v[-1, 3])
    assert np.unwrap(angle_of(run.q))[-1] > 2 * np.pi
    assert np.log2((ends[2] - exact) / (ends[3] - exact)) == pytest.approx(2, abs=0.04)
    assert extrapolated(ends, 2) == pytest.approx(exact, abs=1e-4)


def test_a_torsion_spring_that_is_turned_too_far_is_refused():
    system = wheel(1.0, 0.0)
    q, v = state(system, {"disc": Pose(spin=np.array([0, 0, 9.0]))})
    with pytest.raises(NumericalError, match=r"law: the torsion spring is rotated by 3\.\d+ rad .* limit is 3 rad"):
        simulate(system, q, v, np.zeros((201, 0)), 0.01, np.zeros(0))


def test_a_bushing_turns_as_the_right_hand_has_it():
    axes = turned(0.7)
    stone = RigidBody("stone", M, np.zeros(3), np.eye(3))
    element = bushing("law", Frame("wall", axes=axes), Frame("end", "stone", axes=axes), SIX, SIX)
    system = assemble([stone], [], [element])
    for k in range(3):
        move, spin = (
            state(system, {"stone": Pose(velocity=axes[:, k])}),
            state(system, {"stone": Pose(spin=axes[:, k])}),
        )
        for (q, v), expected in ((move, np.eye(6)[k]), (spin, np.eye(6)[3 + k])):
            rate = readings(system, [RelationSensor("rate", element.relations, rate=True)]).read(q, v)[0]
            np.testing.assert_allclose(rate, expected, atol=1e-15)


def test_a_wheel_on_a_torsion_spring_rests_at_its_angle():
    disc = RigidBody("disc", 1.0, np.zeros(3), np.eye(3))
    for axis in "xyz":
        element = torsion("law", Frame("wall"), Frame("end", "disc"), 5.0, 1.0, 0.4, axis)
        hinge = revolute("hinge", Frame("rail"), Frame("centre", "disc"), axis)
        system = assemble([disc], [hinge], [element])
        q, lam = static_equilibrium(system, state(system, {})[0], np.zeros(0), np.zeros(0))
        R, k = q[3:12].reshape(3, 3).T, "xyz".index(axis)
        a, b = (k + 1) % 3, (k + 2) % 3
        assert np.arctan2(R[b, a], R[a, a]) == pytest.approx(0.4, abs=1e-9)
        np.testing.assert_allclose(lam, 0, atol=1e-9)
