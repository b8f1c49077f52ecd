"""Stages that are foreseen from those before are the ones that are solved by themselves."""

from types import SimpleNamespace

import numpy as np
import pytest

from strainsight.multibody.advance import advance
from strainsight.multibody.bodies import RigidBody
from strainsight.multibody.forces import Gravity, Load, RelativeElement
from strainsight.multibody.frames import Frame
from strainsight.multibody.initial import Pose, state
from strainsight.multibody.joints import revolute, spherical
from strainsight.multibody.relations import place
from strainsight.multibody.system import assemble

NONE = np.zeros(0)


def pendulum():
    """Two bars on hinges across each other, in fast motion."""
    bars = [RigidBody(name, 1.0, np.array([0.5, 0.1, 0.0]), np.diag([0.1, 0.4, 0.45])) for name in ("upper", "lower")]
    joints = [
        spherical("eye", Frame("wall"), Frame("root", "upper")),
        revolute("hinge", Frame("tip", "upper", np.array([1.0, 0, 0])), Frame("start", "lower"), "y"),
    ]
    system = assemble(bars, joints, [Gravity(np.array([1.0, -9.0, 2.0]))])
    spin = np.array([0.0, 0.0, 3.0])
    poses = {"upper": Pose(spin=spin), "lower": Pose(np.array([1.0, 0, 0]), velocity=np.array([0, 3.0, 0]), spin=spin)}
    return system, *state(system, poses)


def bouncing():
    """A stone that falls onto a stiff Hertz contact, F = −k δ^1.5, and leaves it again."""

    def load(rho, rate, theta):
        deep = np.maximum(-rho, 0)
        return Load(-1e7 * deep**1.5, np.diag(1.5e7 * np.sqrt(deep)), None, np.zeros((1, 0)))

    height = (place(Frame("centre", "stone"), np.array([0, 0, 1.0])),)
    stone = RigidBody("stone", 2.0, np.zeros(3), np.eye(3))
    system = assemble([stone], [], [RelativeElement("floor", height, SimpleNamespace(load=load)), Gravity()])
    q, v = state(system, {})
    q[2] = 0.05
    return system, q, v


def run(system, q, v, steps, h, method="second_order"):
    """All steps, each from the end of the one before."""
    found, last = [], None
    for _ in range(steps):
        last = advance(system, q, v, (NONE, NONE), h, NONE, method, last=last)
        q, v = last.q, last.v
        found.append(last)
    return found


@pytest.mark.parametrize("method", ["second_order", "thesis"])
@pytest.mark.parametrize(("case", "h"), [(pendulum, 1e-3), (pendulum, 0.02), (bouncing, 2e-3)])
def test_a_step_with_a_past_is_the_step_without(case, h, method):
    system, q, v = case()
    for own in run(system, q, v, 150, h, method):
        alone = advance(system, q, v, (NONE, NONE), h, NONE, method)
        np.testing.assert_allclose(own.q, alone.q, rtol=0, atol=1e-12)
        np.testing.assert_allclose(h * own.v, h * alone.v, rtol=0, atol=1e-12)
        q, v = own.q, own.v


def test_the_stone_met_the_floor_and_left_it():
    height = np.array([own.q[2] for own in run(*bouncing(), 150, 2e-3)])
    assert height.min() < -1e-4
    assert height[-1] > 0
