"""The time step: control, the band of its matrix, and stages that are foreseen from those before."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from strainsight.errors import NumericalError
from strainsight.multibody.bodies import Frame, RigidBody
from strainsight.multibody.coupled import SHARE, load_error, relative_error, resolved_frequency
from strainsight.multibody.forces import Gravity, Load, PointForce, RelativeElement
from strainsight.multibody.initial import Pose, state
from strainsight.multibody.joints import prismatic, revolute, spherical
from strainsight.multibody.laws import bushing
from strainsight.multibody.relations import place
from strainsight.multibody.simulate import BLOCK, simulate, simulate_controlled
from strainsight.multibody.step import advance, step
from strainsight.multibody.system import assemble

from .test_laws import K, M, slider
from .test_motion import pendulum

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


def test_force_that_is_not_finite_is_named_with_its_body():
    bad = law(lambda r: np.full(1, np.nan), lambda r: np.zeros(1))
    system = assemble([STONE], [], [RelativeElement("broken", HEIGHT, bad)])
    q, v = state(system, {})
    with pytest.raises(NumericalError, match=r"force broken is not finite") as refused:
        step(system, q, v, np.zeros(0), 0.01, np.zeros(0))
    assert "0.01 s" in str(refused.value)


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


def test_failed_run_reports_time():
    """A force that breaks as the falling stone passes z = −1 m, after √(2/9.81) s."""
    brittle = law(lambda r: np.where(r > -1, 0.0, np.nan), lambda r: np.zeros(1))
    system = assemble([STONE], [], [RelativeElement("brittle", HEIGHT, brittle), Gravity()])
    with pytest.raises(NumericalError, match=r"at t = 0\.4[3-5]\d* s: .* force brittle is not finite"):
        simulate(system, *state(system, {}), np.zeros((101, 0)), 0.01, np.zeros(0))


EXACT = np.array([0.98629175, -0.16501085])
"""The bob after one second (IFToMM)."""


def none(time):
    return np.zeros((len(time), 0))


@pytest.mark.parametrize("h", [1.0, 0.25, 0.01])
def test_the_bob_is_where_the_benchmark_has_it_whatever_the_step(h):
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



def test_load_between_steps_is_detected():
    """A push that is over before the first step ends: momentum J moves a mass on a spring by J/(mω) sin ωt."""
    system = slider(K, 0.0)
    push = PointForce("F", Frame("at", "stone"), np.array([0, 0, 1.0]), ["F"])
    system = assemble(system.bodies, system.joints, [*system.forces, push])
    q, v = state(system, {"stone": Pose()})

    def loads(time):
        return np.where((time > 0.02) & (time < 0.04), 1e2 * np.sin(np.pi * (time - 0.02) / 0.02), 0.0)[:, None]

    found = simulate_controlled(system, q, v, loads, 0.5, 1, np.zeros(0), "second_order", 1e-5)
    time = np.linspace(0, 0.5, 2001)
    fine = simulate(system, q, v, loads(time), time[1], np.zeros(0))
    assert abs(found.run.q[-1, 2]) > 0.05 * 1.27 / np.sqrt(K * M)
    assert found.run.q[-1, 2] == pytest.approx(fine.q[-1, 2], abs=3e-5)


def test_unreachable_tolerance_is_refused_with_time():
    """More digits than a number has."""
    system = slider(K, 0.0)
    q, v = state(system, {"stone": Pose(np.array([0, 0, 0.5]))})
    with pytest.raises(NumericalError, match=r"at t = 0 s the step of 0\.1 s, divided into 1024 substeps, has a relative error"):
        simulate_controlled(system, q, v, none, 0.1, 10, np.zeros(0), "second_order", 1e-14)


MASS, HZ = 2.0, 3.0


@pytest.mark.parametrize("method", ["second_order", "thesis"])
@pytest.mark.parametrize(("load", "h"), [(0.4, 0.02), (1.5, 0.02), (2.0, 0.1)])
def test_a_mass_on_a_spring_is_off_by_what_the_formula_says(method, load, h):
    stone = RigidBody("stone", MASS, np.zeros(3), np.eye(3))
    omega, damping = 2 * np.pi * HZ, 0.02
    element = bushing(
        "law", Frame("wall"), Frame("end", "stone"), [0, 0, MASS * omega**2, 0, 0, 0], [0, 0, 2 * MASS * omega * damping, 0, 0, 0]
    )
    push = PointForce("F", Frame("at", "stone"), np.array([0, 0, 1.0]), ["F"])
    system = assemble([stone], [prismatic("guide", Frame("rail"), Frame("centre", "stone"))], [element, push])
    turning = 2 * np.pi * load
    steps = round(6 / load / h) + int(20 / h)
    time = h * np.arange(steps + 1)
    exact = 1 / (MASS * (omega**2 - turning**2 + 2j * damping * omega * turning))
    q, v = state(system, {"stone": Pose(np.array([0, 0, exact.real]), velocity=np.array([0, 0, (1j * turning * exact).real]))})
    run = simulate(system, q, v, np.cos(turning * time)[:, None], h, np.zeros(0), method)
    late = time > time[-1] - 2 / load
    wave = np.stack([np.cos(turning * time), -np.sin(turning * time)], axis=1)[late]
    real, imag = np.linalg.lstsq(wave, run.q[late, 2], rcond=None)[0]
    # a light damper changes little away from resonance
    assert abs((real + 1j * imag) / exact - 1) == pytest.approx(
        relative_error(np.array([load]), HZ, h, method)[0], rel=0.25, abs=1e-4
    )


@pytest.mark.parametrize("method", ["second_order", "thesis"])
def test_resolved_frequency_limits_mode_error(method):
    modes, h = np.array([2.1, 2.4, 40.0, 55.0]), 0.02
    edge = resolved_frequency(modes, h, method)
    inside = np.linspace(0.01, 0.99, 50) * edge
    assert max(relative_error(inside, f, h, method).max() for f in modes) <= SHARE
    assert max(relative_error(np.array([1.02 * edge]), f, h, method)[0] for f in modes) > SHARE


@pytest.mark.parametrize("method", ["second_order", "thesis"])
def test_load_error_of_sine_matches_formula(method):
    modes, h = np.array([2.1, 40.0]), 0.02
    time = h * np.arange(2001)
    loads = np.stack([5.0 + np.sin(2 * np.pi * 0.75 * time), 0 * time + 3.0, np.sin(2 * np.pi * 11.0 * time)], axis=1)
    slow, none, quick = load_error(loads, modes, h, method)
    assert slow == pytest.approx(max(relative_error(np.array([0.75]), f, h, method)[0] for f in modes), rel=0.02)
    assert none == 0.0
    assert quick > 0.1


def test_load_error_is_energy_weighted():
    modes, h = np.array([2.1]), 0.05
    time = h * np.arange(4001)
    parts = [np.sin(2 * np.pi * f * time) for f in (0.3, 1.7)]
    one, other = (load_error(part[:, None], modes, h, "second_order")[0] for part in parts)
    both = load_error((3 * parts[0] + parts[1])[:, None], modes, h, "second_order")[0]
    assert both == pytest.approx(np.sqrt((9 * one**2 + other**2) / 10), rel=1e-3)


NONE = np.zeros(0)


def double_pendulum():
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
@pytest.mark.parametrize(("case", "h"), [(double_pendulum, 1e-3), (double_pendulum, 0.02), (bouncing, 2e-3)])
def test_extrapolated_start_does_not_change_step(case, h, method):
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


def test_simulation_in_blocks_takes_the_steps_of_advance():
    """To the last bit, across the end of a block."""
    system, q, v = pendulum()
    steps, done, last = BLOCK + 6, [], None
    run = simulate(system, q, v, np.zeros((steps + 1, 0)), 0.01, np.zeros(0), progress=done.append)
    assert done == [BLOCK, steps]
    for k in range(steps):
        last = advance(system, q, v, (np.zeros(0), np.zeros(0)), 0.01, np.zeros(0), "second_order", last=last)
        q, v = last.q, last.v
        np.testing.assert_array_equal(run.q[k + 1], q)
        np.testing.assert_array_equal(run.v[k + 1], v)
        np.testing.assert_array_equal(run.lam[k], last.stages[-1].lam)
