"""Newton's iteration of the step: where it is hard, and what it says where it fails."""

from types import SimpleNamespace

import numpy as np
import pytest

from strainsight.errors import NumericalError
from strainsight.multibody.bodies import RigidBody
from strainsight.multibody.equations import balance, input_slopes
from strainsight.multibody.forces import Gravity, Load, PointForce, RelativeElement
from strainsight.multibody.frames import Frame
from strainsight.multibody.initial import constraints_at, state
from strainsight.multibody.joints import revolute, spherical
from strainsight.multibody.laws.spring import spring
from strainsight.multibody.relations import place
from strainsight.multibody.simulate import simulate
from strainsight.multibody.step import step
from strainsight.multibody.system import assemble

STONE = RigidBody("stone", 2.0, np.zeros(3), np.eye(3))
HEIGHT = (place(Frame("centre", "stone"), np.array([0, 0, 1.0])),)


def law(F, slope):
    return SimpleNamespace(load=lambda rho, rate, theta: Load(F(rho), np.diag(slope(rho)), None, np.zeros((len(rho), 0))))


def one_sided(k):
    """Hertz: F = −k δ^1.5 pushing up where δ = −ρ > 0."""
    return law(lambda r: -k * np.maximum(-r, 0) ** 1.5, lambda r: 1.5 * k * np.sqrt(np.maximum(-r, 0)))


def test_stone_falls_onto_a_hertz_contact_and_rests_on_it():
    """A contact that the first trial state of a step does not feel: k δ^1.5 = m g in the end."""
    k = 1e9
    system = assemble([STONE], [], [RelativeElement("floor", HEIGHT, one_sided(k)), Gravity()])
    q, v = state(system, {})
    q[2] = 0.05
    run = simulate(system, q, v, np.zeros((401, 0)), 0.01, np.zeros(0))
    assert run.q[-1, 2] == pytest.approx(-((2 * 9.81 / k) ** (2 / 3)), rel=1e-6)


def test_the_step_solves_its_equations_whatever_the_guess(everything):
    e = everything
    first = step(e.system, e.q, e.v, e.u, 0.02, e.theta)
    again = step(e.system, e.q, e.v, e.u, 0.02, e.theta, guess=first)
    np.testing.assert_allclose(again.q, first.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(again.v, first.v, rtol=0, atol=1e-10)
    phi, B = constraints_at(e.system, first.q)
    assert np.abs(phi).max() < 1e-14
    assert np.abs(B @ first.v).max() < 1e-13


def test_extra_generalised_force_acts_as_the_input_it_imitates(everything):
    e = everything
    shifted = e.u + np.array([1.0, 0, 0, 0, 0, 0, 0])
    by_input = step(e.system, e.q, e.v, shifted, 0.01, e.theta)
    m = np.zeros(e.system.constrained)
    at = balance(e.system, by_input.q, by_input.v, 0 * e.v, m, m, e.u, e.theta, e.system.at(e.theta))
    w = -input_slopes(e.system, at, by_input.q)[:, 0]
    by_force = step(e.system, e.q, e.v, e.u, 0.01, e.theta, w=w)
    np.testing.assert_allclose(by_force.q, by_input.q, atol=1e-13)
    np.testing.assert_allclose(by_force.v, by_input.v, atol=1e-11)


def test_force_that_is_not_finite_is_named_with_its_body():
    bad = law(lambda r: np.full(1, np.nan), lambda r: np.zeros(1))
    system = assemble([STONE], [], [RelativeElement("broken", HEIGHT, bad)])
    q, v = state(system, {})
    with pytest.raises(NumericalError, match=r"force broken is not finite") as refused:
        step(system, q, v, np.zeros(0), 0.01, np.zeros(0))
    assert "0.01 s" in str(refused.value)


def test_step_without_solution_says_what():
    """A stone held at two points 1 m apart on it by joints 2 m apart: no state satisfies both."""
    joints = [
        spherical("left", Frame("hook"), Frame("end", "stone")),
        revolute("right", Frame("eye", None, np.array([2.0, 0, 0])), Frame("nose", "stone", np.array([1.0, 0, 0]))),
    ]
    system = assemble([STONE], joints, [Gravity()])
    q, v = state(system, {})
    with pytest.raises(NumericalError, match=r"the step of 0.01 s was not solved") as refused:
        step(system, q, v, np.zeros(0), 0.01, np.zeros(0))
    assert "left: " in str(refused.value) or "right: " in str(refused.value)
    assert "take a smaller time step" in str(refused.value)


def test_trial_state_where_a_force_does_not_exist_is_approached_by_half():
    """A force F = a/(1 − ρ) that ends at ρ = 1, where the first trial state of a long step overshoots."""

    def load(rho, rho_dot, theta):
        if rho[0] >= 1:
            raise NumericalError("beyond the end")
        return Load(1.0 / (1 - rho), np.diag(1.0 / (1 - rho) ** 2), None, np.zeros((1, 0)))

    lift = PointForce("lift", Frame("centre", "stone"), np.array([0, 0, 1.0]), ["F"])
    system = assemble([STONE], [], [RelativeElement("end", HEIGHT, SimpleNamespace(load=load)), lift])
    q, v = state(system, {})
    h, F = 1.0, 20.0
    new = step(system, q, v, np.array([F]), h, np.zeros(0))
    z = new.q[2]
    assert z < 1
    assert 2.0 * z / h**2 + 1.0 / (1 - z) == pytest.approx(F, rel=1e-12)


def test_run_says_when_it_fails():
    """A force that breaks as the falling stone passes z = −1 m, after √(2/9.81) s."""
    brittle = law(lambda r: np.where(r > -1, 0.0, np.nan), lambda r: np.zeros(1))
    system = assemble([STONE], [], [RelativeElement("brittle", HEIGHT, brittle), Gravity()])
    with pytest.raises(NumericalError, match=r"at t = 0\.4[3-5]\d* s: .* force brittle is not finite"):
        simulate(system, *state(system, {}), np.zeros((101, 0)), 0.01, np.zeros(0))


def test_points_of_a_spring_that_coincide_are_refused():
    system = assemble([STONE], [], [spring("spring", Frame("wall"), Frame("end", "stone"), 100.0)])
    with pytest.raises(NumericalError, match="spring: its end points 'wall' and 'end' are 0 m apart"):
        step(system, *state(system, {}), np.zeros(0), 0.01, np.zeros(0))
