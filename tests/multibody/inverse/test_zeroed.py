"""What zeroed sensors are taken to have read: an equilibrium followed from answer to answer."""

import numpy as np
import pytest
from tests.multibody.inverse.benches import bench

from strainsight.errors import InfeasibleError
from strainsight.multibody.bodies import RigidBody
from strainsight.multibody.forces import Load, RelativeElement
from strainsight.multibody.frames import Frame
from strainsight.multibody.inverse import zeroed
from strainsight.multibody.inverse.followed import followed, rest_at
from strainsight.multibody.inverse.parameters import parameter_coordinates
from strainsight.multibody.inverse.zeroed import zero_at_rest
from strainsight.multibody.joints import prismatic
from strainsight.multibody.laws.linear import bushing
from strainsight.multibody.relations import offset
from strainsight.multibody.static import static_equilibrium
from strainsight.multibody.system import assemble

LOADS = np.array([2e4, -1e4, 1.5e4])
ALL = np.ones(9, dtype=bool)


@pytest.fixture(scope="module")
def loaded():
    """A bench with a free modulus and ball diameter, and its zero under loads."""
    b = bench(free=("ball_diameter",), modulus=True)
    coordinates = parameter_coordinates(b.system.parameters, ("E", "b.ball_diameter"), b.theta, {"b": b.bearing.parameters})
    q = static_equilibrium(b.system, b.q, LOADS, b.theta)[0]
    return b, coordinates, q


def sought(loaded, xi):
    """From the unloaded state, by no answer of before."""
    b, coordinates, _ = loaded
    q = static_equilibrium(b.system, b.q, LOADS, coordinates.theta(xi)[0])[0]
    return b.sensors.read(q, np.zeros_like(q))[0]


def test_followed_answers_are_those_sought_from_the_start(loaded):
    b, coordinates, q = loaded
    zero = zero_at_rest(b.system, b.sensors, ALL, q, LOADS, coordinates)
    first, rng = coordinates.xi(b.theta), np.random.default_rng(3)
    for size in (1e-6, 1e-3, 0.3):
        for _ in range(4):
            xi = first + size * np.array([1.0, 1e-3]) * rng.normal(size=2)
            expected = sought(loaded, xi)
            np.testing.assert_allclose(zero(xi)[0], expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_its_slopes_are_those_of_differences(loaded):
    b, coordinates, q = loaded
    zero = zero_at_rest(b.system, b.sensors, ALL, q, LOADS, coordinates)
    xi = coordinates.xi(b.theta) + np.array([0.05, 1e-4])
    zero(coordinates.xi(b.theta))
    slopes = zero(xi)[1]
    for j, step in enumerate((1e-4, 1e-6)):
        ends = [sought(loaded, xi + sign * step * np.eye(2)[j]) for sign in (1, -1)]
        by_hand = (ends[0] - ends[1]) / (2 * step)
        np.testing.assert_allclose(slopes[:, j], by_hand, rtol=0, atol=1e-4 * np.abs(by_hand).max())


def test_one_that_cannot_be_followed_is_sought(loaded, monkeypatch):
    """A modulus fifty times as large, and Newton's iteration that is given one step."""
    b, coordinates, q = loaded
    zero = zero_at_rest(b.system, b.sensors, ALL, q, LOADS, coordinates)
    xi = coordinates.xi(b.theta)
    zero(xi)
    far = xi + np.array([np.log(50.0), 0.0])
    monkeypatch.setattr("strainsight.multibody.inverse.followed.STEPS", 1)
    expected = sought(loaded, far)
    np.testing.assert_allclose(zero(far)[0], expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_only_so_many_are_remembered_and_only_zeroed_channels_count(loaded, monkeypatch):
    b, coordinates, q = loaded
    monkeypatch.setattr(zeroed, "REMEMBERED", 2)
    which = np.arange(9) < 4
    zero = zero_at_rest(b.system, b.sensors, which, q, LOADS, coordinates)
    xi = coordinates.xi(b.theta)
    for k in range(4):
        offset, slopes = zero(xi + 1e-3 * k)
        assert np.all(offset[:4] != 0)
        assert not offset[4:].any()
        assert not slopes[4:].any()


class Unknown:
    """F = θρ."""

    def load(self, rho, rho_dot, theta):
        return Load(theta[0] * rho, theta[0] * np.eye(1), None, rho[:, None])


def test_a_motion_that_becomes_free_on_the_way_is_refused_as_from_the_start():
    """Two stones on rails, one on a spring that is known, one on a spring that is not and goes."""
    stones = [RigidBody(name, 2.0, np.zeros(3), np.eye(3)) for name in ("held", "loose")]
    rails = [prismatic(own.name, Frame("rail"), Frame("centre", own.name)) for own in stones]
    known = bushing("known", Frame("wall"), Frame("end", "held"), [0, 0, 100.0, 0, 0, 0], [0.0] * 6)
    unknown = RelativeElement("unknown", (offset(Frame("wall"), 2, Frame("end", "loose")),), Unknown(), ("k",))
    system = assemble(stones, rails, [known, unknown])
    q = np.tile(np.concatenate([np.zeros(3), np.eye(3).ravel()]), 2)
    rest = rest_at(system, q, np.zeros(0), np.array([50.0]))
    assert followed(system, rest, np.zeros(0), np.array([1.0])).theta == 1.0
    for seek, start in ((rest_at, q), (followed, rest)):
        with pytest.raises(InfeasibleError, match="nothing holds body loose"):
            seek(system, start, np.zeros(0), np.array([1e-11]))
