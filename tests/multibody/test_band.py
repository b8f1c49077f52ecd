"""How far a step follows a load: the formula against steps of a mass on a spring."""

import numpy as np
import pytest

from strainsight.multibody.band import SHARE, followed, missed, relative_error
from strainsight.multibody.bodies import RigidBody
from strainsight.multibody.forces import PointForce
from strainsight.multibody.frames import Frame
from strainsight.multibody.initial import Pose, state
from strainsight.multibody.joints import prismatic
from strainsight.multibody.laws.linear import bushing
from strainsight.multibody.simulate import simulate
from strainsight.multibody.system import assemble

M, HZ = 2.0, 3.0


@pytest.mark.parametrize("method", ["second_order", "thesis"])
@pytest.mark.parametrize(("load", "h"), [(0.4, 0.02), (1.5, 0.02), (2.0, 0.1)])
def test_a_mass_on_a_spring_is_off_by_what_the_formula_says(method, load, h):
    """After its free motion has died in a damper of nearly nothing at all: amplitude and phase of the last periods."""
    stone = RigidBody("stone", M, np.zeros(3), np.eye(3))
    omega, damping = 2 * np.pi * HZ, 0.02
    element = bushing(
        "law", Frame("wall"), Frame("end", "stone"), [0, 0, M * omega**2, 0, 0, 0], [0, 0, 2 * M * omega * damping, 0, 0, 0]
    )
    push = PointForce("F", Frame("at", "stone"), np.array([0, 0, 1.0]), ["F"])
    system = assemble([stone], [prismatic("guide", Frame("rail"), Frame("centre", "stone"))], [element, push])
    turning = 2 * np.pi * load
    steps = round(6 / load / h) + int(20 / h)
    time = h * np.arange(steps + 1)
    exact = 1 / (M * (omega**2 - turning**2 + 2j * damping * omega * turning))
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
def test_below_the_band_all_modes_are_followed_and_just_above_one_is_not(method):
    modes, h = np.array([2.1, 2.4, 40.0, 55.0]), 0.02
    edge = followed(modes, h, method)
    inside = np.linspace(0.01, 0.99, 50) * edge
    assert max(relative_error(inside, f, h, method).max() for f in modes) <= SHARE
    assert max(relative_error(np.array([1.02 * edge]), f, h, method)[0] for f in modes) > SHARE


def test_the_band_of_second_order_grows_with_the_step_refined_and_ends_at_the_first_mode():
    modes = np.array([2.1, 40.0])
    edges = [followed(modes, h, "second_order") for h in (0.1, 0.05, 0.02, 0.005)]
    assert np.all(np.diff(edges) > 0)
    assert edges[-1] < 2.1
    assert followed(modes, 0.02, "thesis") < 0.5 * followed(modes, 0.02, "second_order")


@pytest.mark.parametrize("method", ["second_order", "thesis"])
def test_of_a_sine_the_step_misses_what_it_is_off_by_and_of_a_constant_nothing(method):
    modes, h = np.array([2.1, 40.0]), 0.02
    time = h * np.arange(2001)
    loads = np.stack([5.0 + np.sin(2 * np.pi * 0.75 * time), 0 * time + 3.0, np.sin(2 * np.pi * 11.0 * time)], axis=1)
    slow, none, quick = missed(loads, modes, h, method)
    assert slow == pytest.approx(max(relative_error(np.array([0.75]), f, h, method)[0] for f in modes), rel=0.02)
    assert none == 0.0
    assert quick > 0.1


def test_two_loads_in_one_miss_as_their_energies_say():
    modes, h = np.array([2.1]), 0.05
    time = h * np.arange(4001)
    parts = [np.sin(2 * np.pi * f * time) for f in (0.3, 1.7)]
    one, other = (missed(part[:, None], modes, h, "second_order")[0] for part in parts)
    both = missed((3 * parts[0] + parts[1])[:, None], modes, h, "second_order")[0]
    assert both == pytest.approx(np.sqrt((9 * one**2 + other**2) / 10), rel=1e-3)
