"""How far a step follows a load: the formula against steps of a mass on a spring."""

import numpy as np
import pytest

from strainsight.multibody.band import SHARE, followed, relative_error
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
