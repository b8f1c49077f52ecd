"""Where the ring comes to rest: published values and residuals."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import InfeasibleError, UserError
from strainsight.multibody.bearing.element import ball_loads, bearing_load
from strainsight.multibody.bearing.equilibrium import displacement

from .bearings import angular_contact_218, pitch_bearing, uneven


def test_218_bearing_under_axial_load_has_the_published_angle_and_deflection():
    """Two-point limit, Jones and Harris: 41.4927° and 35.873 µm under 17.8 kN."""
    bearing = angular_contact_218()
    q = displacement(bearing, np.array([17.8e3, 0, 0, 0, 0]))
    balls = ball_loads(bearing, q)
    np.testing.assert_allclose(np.degrees(balls.contact_angle[:, [0, 3]]), 41.4927, atol=5e-5)
    assert 1e6 * q[0] == pytest.approx(35.873, abs=5e-4)
    assert np.abs(q[1:]).max() < 1e-12
    # only inner left and outer right touch
    assert not balls.force[:, 1:3].any()
    np.testing.assert_allclose(balls.force[:, 0], 17.8e3 / 16 / np.sin(np.radians(41.49275)), rtol=1e-6)


def test_two_point_limit_is_the_geometry_of_jones():
    """δ_a = A sin(β − α)/cos β,  A = r_i + r_o − D, at any axial load."""
    bearing = angular_contact_218()
    A = 2 * bearing.radius_inner_left - bearing.ball_diameter
    for load in (10.0, 1e3, 4e4):
        q = displacement(bearing, np.array([load, 0, 0, 0, 0]))
        beta = ball_loads(bearing, q).contact_angle[0, 0]
        assert q[0] == pytest.approx(A * np.sin(beta - bearing.contact_angle) / np.cos(beta), rel=1e-9)


@pytest.mark.parametrize("preload", [-2e-4, 0.0, 3e-5])
def test_the_ring_rests_where_the_load_is_met(preload):
    rng = np.random.default_rng(4)
    for bearing in (uneven(preload=preload), pitch_bearing(preload=preload, speed=3.0)):
        for _ in range(10):
            F = 10 ** rng.uniform(2, 5) * rng.standard_normal(5)
            found = bearing_load(bearing, displacement(bearing, F)).force
            assert np.abs(found - F).max() <= 1e-8 * np.abs(F).max()


def test_a_start_elsewhere_leads_to_the_same_place():
    bearing, F = uneven(preload=1e-5), np.array([3e3, -2e4, 1e4, 500.0, 800.0])
    elsewhere = displacement(bearing, F, start=np.array([1e-3, 2e-3, 0, -3e-3, 1e-3]))
    np.testing.assert_allclose(elsewhere, displacement(bearing, F), rtol=1e-9)


def test_a_free_ring_stays_where_it_is():
    assert not displacement(uneven(), np.zeros(5)).any()
    start = np.array([1e-5, 0, 2e-5, 0, 0])
    np.testing.assert_array_equal(displacement(uneven(preload=-1e-4), np.zeros(5), start), start)


@pytest.mark.parametrize("load", [1e9, 1e14, 1e200])
def test_a_load_beyond_the_contacts_is_refused(load):
    """The request is at fault, not the computation."""
    with pytest.raises(InfeasibleError, match="no equilibrium under the load"):
        displacement(pitch_bearing(), np.array([load, 0, 0, 0, load]))


def test_a_load_that_is_no_five_numbers_is_refused():
    with pytest.raises(UserError, match="bearing load"):
        displacement(uneven(), np.array([1.0, 2.0]))
    with pytest.raises(UserError, match="bearing start"):
        displacement(uneven(), np.zeros(5), np.full(5, np.inf))
