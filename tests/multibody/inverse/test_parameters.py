"""Coordinates without bounds: every value can be built, the slopes are the differences, and what cannot be is refused."""

import numpy as np
import pytest

from strainsight.errors import InfeasibleError
from strainsight.multibody.bearing.geometry import PARAMETERS
from strainsight.multibody.inverse.parameters import parameter_coordinates

RING = np.array([0.06, 0.0318, 0.0317, 0.0319, 0.032, 1e-5])
NAMES = ["E", *(f"b.{name}" for name in PARAMETERS)]
THETA = np.array([2e11, *RING])
RADII = [f"b.{name}" for name in PARAMETERS[1:5]]
SETS = [
    ["E"],
    ["b.ball_diameter"],
    ["b.preload"],
    ["b.radius_inner_left"],
    ["b.radius_outer_right", "E", "b.ball_diameter"],
    ["b.ball_diameter", *RADII],
    [*RADII, "b.preload", "E"],
]


def of(free, theta=THETA, **bearings):
    return parameter_coordinates(NAMES, free, theta, bearings or {"b": RING})


@pytest.mark.parametrize("free", SETS, ids=" ".join)
def test_there_and_back_with_slopes_that_are_the_differences(free):
    found = of(free)
    xi = found.xi(THETA)
    back, slopes = found.theta(xi)
    np.testing.assert_allclose(back, THETA, rtol=1e-13)
    for k in range(len(free)):
        d = np.zeros(len(free))
        d[k] = 1e-5 * max(1.0, abs(xi[k]))
        difference = (found.theta(xi + d)[0] - found.theta(xi - d)[0]) / (2 * d[k])
        np.testing.assert_allclose(slopes[:, k], difference, rtol=1e-7, atol=1e-12 * np.abs(THETA).min())
    assert [NAMES[at] for at in found.free] == free


@pytest.mark.parametrize("free", SETS[1:], ids=" ".join)
def test_every_value_is_a_bearing_that_can_be_built(free):
    found, rng = of(free), np.random.default_rng(0)
    for _ in range(200):
        _, D, *radii, preload = found.theta(found.xi(THETA) + 3 * rng.normal(size=len(free)))[0]
        known = 0.0 if "b.preload" in free else preload
        assert D > 0
        assert min(radii) > 0.5 * D + known


def test_values_by_hand():
    np.testing.assert_allclose(of(["E"]).xi(THETA), np.log(2e11))
    np.testing.assert_allclose(of(["b.preload"]).xi(THETA), 10.0)
    plain = THETA.copy()
    plain[-1] = 0.0
    assert of(["b.radius_outer_left"], plain).xi(plain)[0] == pytest.approx(np.log(2 * 0.0319 / 0.06 - 1))
    assert of(["b.ball_diameter"], plain).xi(plain)[0] == pytest.approx(np.log(2 * 0.0317 / 0.06 - 1))
    assert of(["b.ball_diameter", "b.radius_inner_right"], plain).xi(plain)[0] == pytest.approx(
        np.log(2 * 0.0318 / 0.06 - 1)
    )
    assert of(["b.ball_diameter", *RADII]).xi(THETA)[0] == pytest.approx(np.log(0.06))


def test_values_that_are_no_parameter_come_from_the_bearing():
    found = parameter_coordinates(["b.ball_diameter"], ["b.ball_diameter"], [0.06], {"b": RING})
    assert found.xi([0.06])[0] == pytest.approx(np.log(2 * (0.0317 - 1e-5) / 0.06 - 1))


@pytest.mark.parametrize("free", SETS, ids=" ".join)
def test_spread_of_the_coordinates_is_that_of_the_values(free):
    """Draws in θ, turned into ξ one by one."""
    found, rng = of(free), np.random.default_rng(1)
    std = 1e-5 * np.abs(THETA[found.free])
    drawn = np.tile(THETA, (4000, 1))
    drawn[:, found.free] += std * rng.normal(size=(4000, len(free)))
    xi = np.array([found.xi(theta) for theta in drawn])
    np.testing.assert_allclose(found.std(THETA, std), xi.std(axis=0), rtol=0.05)
    P = found.covariance(THETA, std)
    scale = np.sqrt(np.diag(P))
    drawn_correlation = np.atleast_2d(np.corrcoef(xi.T))
    np.testing.assert_allclose(P / np.outer(scale, scale), drawn_correlation, atol=0.06)


def test_what_cannot_be_is_refused():
    with pytest.raises(
        InfeasibleError, match=r"b\.radius_inner_left of 0\.029 is not above the ball's radius of 0\.03001"
    ):
        of(["b.radius_inner_left"]).xi(np.array([2e11, 0.06, 0.029, *RING[2:]]))
    with pytest.raises(InfeasibleError, match=r"b\.ball_diameter of 0\.064 is 0 or not below the 0\.06338 m"):
        of(["b.ball_diameter"]).xi(np.array([2e11, 0.064, *RING[1:]]))
    with pytest.raises(InfeasibleError, match="E of -1 is 0"):
        of(["E"], np.array([-1.0, *RING]))
    with pytest.raises(InfeasibleError, match="nothing tells the size of bearing b"):
        of(["b.preload"], c=RING)
