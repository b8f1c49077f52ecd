"""A pendulum: the order of the step, its constraints, its energy, its units."""

import numpy as np
import pytest

from strainsight.multibody.bodies import RigidBody
from strainsight.multibody.forces import Gravity
from strainsight.multibody.frames import Frame
from strainsight.multibody.initial import Pose, constraints_at, state
from strainsight.multibody.joints import revolute
from strainsight.multibody.simulate import simulate
from strainsight.multibody.system import assemble

from .mechanisms import extrapolated


def pendulum(metre=1.0, kilogram=1.0):
    """A point mass on a massless rod of 1 m, released from x = −1; in other units of length and mass."""
    inertia = np.diag([0.0, 1.0, 1.0]) * kilogram * metre**2
    bob = RigidBody("bob", kilogram, np.array([metre, 0.0, 0.0]), inertia)
    system = assemble(
        [bob], [revolute("pivot", Frame("wall"), Frame("end", "bob"))], [Gravity(np.array([0.0, -9.81 * metre, 0.0]))]
    )
    return system, *state(system, {"bob": Pose(rotation=np.diag([-1.0, -1.0, 1.0]))})


def swing(steps, method="second_order", **units):
    system, q, v = pendulum(**units)
    return system, simulate(system, q, v, np.zeros((steps + 1, 0)), 1.0 / steps, np.zeros(0), method)


@pytest.mark.parametrize(("method", "order"), [("second_order", 2), ("thesis", 1)])
def test_bob_is_where_the_benchmark_has_it_and_the_error_is_of_the_order_of_the_method(method, order):
    exact = np.array([0.98629175, -0.16501085])
    ends = [swing(n, method)[1].q[-1, 3:5] for n in (100, 200, 400, 800)]
    errors = [np.linalg.norm(end - exact) for end in ends]
    assert np.log2(errors[2] / errors[3]) == pytest.approx(order, abs=0.06)
    np.testing.assert_allclose(extrapolated(ends, order), exact, atol=2e-6)


def test_bob_is_right_to_a_tenth_of_a_millimetre_with_steps_of_2_5_ms():
    assert np.linalg.norm(swing(400)[1].q[-1, 3:5] - [0.98629175, -0.16501085]) < 1e-4


@pytest.mark.parametrize("method", ["second_order", "thesis"])
def test_constraints_hold_to_rounding_in_position_and_velocity(method):
    system, run = swing(200, method)
    for q, v in zip(run.q, run.v, strict=True):
        phi, B = constraints_at(system, q)
        assert np.abs(phi).max() < 1e-14
        assert np.abs(B @ v).max() < 1e-13 * max(1.0, np.abs(v).max())


def test_energy_falls_at_every_step_of_implicit_euler_and_not_at_all_as_the_step_shrinks():
    lost = []
    for steps in (200, 400):
        _, run = swing(steps, "thesis")
        energy = 0.5 * np.sum(run.v[:, 3:6] ** 2, axis=1) + 9.81 * run.q[:, 4]
        assert np.all(np.diff(energy) < 0)
        lost.append(energy[0] - energy[-1])
    assert lost[0] / lost[1] == pytest.approx(2.0, abs=0.1)


def test_nothing_depends_on_the_units():
    _, run = swing(100)
    _, other = swing(100, metre=1000.0, kilogram=1e-3)
    np.testing.assert_allclose(other.q[:, 3:12], run.q[:, 3:12], atol=1e-11)
    np.testing.assert_allclose(other.v[:, 3:12], run.v[:, 3:12], atol=1e-10)


def test_multiplier_of_the_pivot_is_the_reaction():
    system, q, v = pendulum()
    q, v = state(system, {"bob": Pose(rotation=np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1.0]]))})
    run = simulate(system, q, v, np.zeros((2, 0)), 0.01, np.zeros(0))
    assert system.constraints[7] == "pivot: y of end on wall"
    np.testing.assert_allclose(run.lam[0, 6:9], [0.0, 9.81, 0.0], atol=1e-12)
