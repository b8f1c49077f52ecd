"""What bearings can be built, and what its parameters move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.multibody.bearing.geometry import PARAMETERS

from .bearings import pitch_bearing, uneven


def test_grooves_that_follow_touch_the_free_ball_at_the_free_angle_whatever_ball_and_radii_are():
    bearing = uneven()
    for theta in (bearing.parameters, bearing.parameters + np.array([2e-4, 3e-4, 1e-4, 5e-4, 2e-4, 0.0])):
        table = bearing.with_parameters(theta).contacts.table
        np.testing.assert_allclose(np.hypot(table[:, 0], table[:, 1]), table[:, 2], rtol=1e-14)
        np.testing.assert_allclose(np.abs(table[:, 0] / table[:, 1]), np.tan(bearing.contact_angle), rtol=1e-14)


def test_fixed_grooves_stay_where_the_nominal_has_them_and_the_ball_becomes_interference():
    bearing = uneven(groove_centres="fixed")
    changed = bearing.with_parameters(bearing.parameters + np.array([4e-5, 1e-5, 0.0, 0.0, 0.0, 3e-6]))
    np.testing.assert_array_equal(changed.contacts.table[:, :2], bearing.contacts.table[:, :2])
    interference = bearing.contacts.table[:, 2] - changed.contacts.table[:, 2]
    np.testing.assert_allclose(interference, [1.3e-5, 2.3e-5, 2.3e-5, 2.3e-5], atol=1e-17)


def test_the_nominal_outlives_a_chain_of_changes():
    bearing = uneven(groove_centres="fixed")
    there_and_back = bearing.with_parameters(bearing.parameters * 1.0001).with_parameters(bearing.parameters)
    assert there_and_back == bearing


def test_parameters_are_in_the_order_of_their_names():
    bearing = uneven(preload=1e-5)
    assert bearing.parameters.tolist() == [getattr(bearing, name) for name in PARAMETERS]
    assert bearing.with_parameters(bearing.parameters) == bearing


@pytest.mark.parametrize("place", [1, 2, 3, 4])
@pytest.mark.parametrize("convention", ["follow", "fixed"])
def test_a_groove_as_narrow_as_the_ball_is_refused_at_any_trial_value_with_both_radii(place, convention):
    bearing = pitch_bearing(groove_centres=convention)
    theta = bearing.parameters
    theta[place] = 0.03
    with pytest.raises(UserError, match=r"groove of radius 30\.000000 mm does not pass a ball of radius 30\.000000 mm"):
        bearing.with_parameters(theta)


def test_a_ball_that_outgrows_its_grooves_is_refused():
    theta = pitch_bearing().parameters
    theta[0] = 0.0637
    with pytest.raises(
        UserError, match=r"inner left groove of radius 31\.8\d+ mm does not pass a ball of radius 31\.85"
    ):
        pitch_bearing().with_parameters(theta)
    theta = pitch_bearing().parameters
    theta[5] = 1.9e-3
    with pytest.raises(UserError, match="1900 µm of preload"):
        pitch_bearing().with_parameters(theta)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"balls": 2}, "2 balls"),
        ({"contact_angle": 1.6}, "contact angle of 91.67°"),
        ({"ball_diameter": -0.06}, "ball_diameter is -0.06"),
        ({"pitch_diameter": 0.05}, "pitch circle"),
        ({"ball_diameter": 1e-170}, r"times as wide as the ball"),
        ({"ball_diameter": 0.0636 * (1 - 1e-12)}, "does not pass"),
        ({"preload": float("nan")}, "preload is nan"),
        ({"poisson_ratio": 0.5}, "ratio 0.5"),
        ({"groove_centres": "float"}, "groove centres 'float'"),
        ({"nominal": (0.06, 0.03)}, "nominal values"),
        ({"nominal": (0.06, 0.03, 0.03, 0.03, 0.03)}, "nominal inner left groove"),
    ],
)
def test_bearings_that_cannot_be_built_are_refused_with_the_value(change, message):
    with pytest.raises(UserError, match=message):
        replace(pitch_bearing(), **change)


def test_a_wrong_number_of_parameters_is_refused():
    with pytest.raises(UserError, match=r"shape \(5,\)"):
        pitch_bearing().with_parameters(np.ones(5))


def test_balls_press_outwards_by_their_mass_and_orbit():
    bearing = uneven(speed=50.0, density=7850.0)
    force, slope = bearing.contacts.centrifugal

    def exact(D):
        orbit = 25 * (1 - D * np.cos(0.75) / 0.5)
        return np.pi / 6 * 7850 * D**3 * orbit**2 * 0.25

    assert force == pytest.approx(exact(0.06), rel=1e-14)
    assert slope == pytest.approx((exact(0.06 + 1e-6) - exact(0.06 - 1e-6)) / 2e-6, rel=1e-8)
