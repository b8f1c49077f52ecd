"""Steps that are divided by what halving them changes."""

import numpy as np
import pytest

from strainsight.errors import NumericalError
from strainsight.multibody.controlled import simulate_controlled
from strainsight.multibody.forces import PointForce
from strainsight.multibody.frames import Frame
from strainsight.multibody.initial import Pose, state
from strainsight.multibody.simulate import simulate
from strainsight.multibody.system import assemble

from .test_laws import K, M, slider
from .test_mechanisms import exact_four_bars, four_bars
from .test_pendulum import pendulum

EXACT = np.array([0.98629175, -0.16501085])
"""The bob after one second (IFToMM)."""


def none(time):
    return np.zeros((len(time), 0))


@pytest.mark.parametrize("h", [1.0, 0.25, 0.01])
def test_the_bob_is_where_the_benchmark_has_it_whatever_the_step(h):
    """A step of a second, or a hundred: errors of the steps add up to less than the tolerance."""
    found = simulate_controlled(*pendulum(), none, h, round(1 / h), np.zeros(0), "second_order", 1e-5)
    assert np.linalg.norm(found.run.q[-1, 3:5] - EXACT) < 1e-5


def test_a_tighter_tolerance_takes_more_parts_and_leaves_less_error():
    parts, errors = [], []
    for tolerance in (1e-3, 1e-4, 1e-5):
        found = simulate_controlled(*pendulum(), none, 0.1, 10, np.zeros(0), "second_order", tolerance)
        parts.append(found.parts.sum())
        errors.append(np.linalg.norm(found.run.q[-1, 3:5] - EXACT))
        assert errors[-1] < tolerance
    assert parts[0] < parts[1] < parts[2]
    assert errors[0] > errors[1] > errors[2]


def test_the_four_bars_cross_their_singular_position_in_steps_of_a_tenth():
    system, q, v = four_bars()
    found = simulate_controlled(system, q, v, none, 0.1, 10, np.zeros(0), "second_order", 1e-4)
    np.testing.assert_allclose(found.run.q[-1, 3:5], exact_four_bars(1.0), rtol=0, atol=1e-4)


def test_a_load_between_the_steps_is_seen():
    """A push that is over before the first step ends: momentum J moves a mass on a spring by J/(mω) sin ωt."""
    system = slider(K, 0.0)
    push = PointForce("F", Frame("at", "stone"), np.array([0, 0, 1.0]), ["F"])
    system = assemble(system.bodies, system.joints, [*system.forces, push])
    q, v = state(system, {"stone": Pose()})

    def loads(time):
        return np.where((time > 0.02) & (time < 0.04), 1e2 * np.sin(np.pi * (time - 0.02) / 0.02), 0.0)[:, None]

    found = simulate_controlled(system, q, v, loads, 0.5, 1, np.zeros(0), "second_order", 1e-5)
    time = np.linspace(0, 0.5, 20001)
    fine = simulate(system, q, v, loads(time), time[1], np.zeros(0))
    assert abs(found.run.q[-1, 2]) > 0.05 * 1.27 / np.sqrt(K * M)
    assert found.run.q[-1, 2] == pytest.approx(fine.q[-1, 2], abs=3e-5)


def test_what_no_division_makes_as_right_as_asked_for_is_refused_with_its_time():
    """More digits than a number has."""
    system = slider(K, 0.0)
    q, v = state(system, {"stone": Pose(np.array([0, 0, 0.5]))})
    with pytest.raises(NumericalError, match=r"at t = 0 s the step of 0\.1 s is .* off in 1024 parts"):
        simulate_controlled(system, q, v, none, 0.1, 10, np.zeros(0), "second_order", 1e-14)
