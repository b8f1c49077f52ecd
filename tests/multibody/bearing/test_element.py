"""The bearing element: load, tangent and slopes, and the equilibrium of its balls."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from strainsight.errors import InfeasibleError
from strainsight.multibody.bearing.element import ball_loads, bearing_load
from strainsight.multibody.bearing.equilibrium import displacement

from .bearings import angular_contact_218, pitch_bearing, uneven

SCALE = np.array([1, 1, 1, 0.25, 0.25])


def preloaded_alike(preload):
    """A bearing whose outer grooves are so much wider that all four contacts are equally stiff."""
    bearing = uneven(preload=preload)
    bearing = replace(bearing, radius_inner_right=bearing.radius_inner_left, nominal=())

    def difference(r):
        table = replace(bearing, radius_outer_left=r, radius_outer_right=r, nominal=()).contacts.table
        return table[2, 3] / table[0, 3] - 1

    r = brentq(difference, 0.0304, 0.034, xtol=1e-17)
    return replace(bearing, radius_outer_left=r, radius_outer_right=r, nominal=())


def test_preload_stiffness_is_the_closed_form():
    bearing = preloaded_alike(3e-5)
    K, delta, s, c, R = bearing.contacts.table[0, 3], 3e-5, np.sin(0.75), np.cos(0.75), 0.25
    steep, Q = 1.5 * K * delta**0.5, K * delta**1.5
    stiff = []
    for r in (bearing.radius_inner_left, bearing.radius_outer_left):
        d = r - 0.03
        across = Q / d
        stiff.append((steep * s**2 + across * c**2, steep * c**2 + across * s**2, (steep - across) * s * c, d))
    (ax_i, rad_i, mixed, reach), (ax_o, rad_o, _, _) = stiff
    arm, x = R + reach * c, reach * s
    axial = 2 * ax_i * ax_o / (ax_i + ax_o)
    radial = 2 * rad_i * rad_o / (rad_i + rad_o)
    tilt = 2 * (ax_i * arm**2 - 2 * mixed * arm * x + rad_i * x**2) - 2 * (ax_i * arm - mixed * x) ** 2 / (ax_i + ax_o)
    expected = np.diag([axial, radial / 2, radial / 2, tilt / 2, tilt / 2]) * bearing.balls
    load = bearing_load(bearing, np.zeros(5))
    np.testing.assert_allclose(np.diagonal(load.tangent), np.diagonal(expected), rtol=1e-11)
    assert np.abs((load.tangent - expected) / np.outer(SCALE, SCALE)).max() < 1e-11 * axial * bearing.balls
    assert np.abs(load.force / SCALE).max() < 1e-10 * bearing.balls * Q
    assert load.energy == pytest.approx(bearing.balls * 1.6 * K * delta**2.5, rel=1e-11)


def random_states(count, seed):
    """Displacements from 1 nm to 30 mm in random directions, bearings of both conventions between play and tightness."""
    rng = np.random.default_rng(seed)
    bearings = [
        uneven(groove_centres=convention, preload=preload, speed=speed)
        for convention in ("follow", "fixed")
        for preload in (-1e-3, -1e-5, 0.0, 3e-5)
        for speed in (0.0, 30.0)
    ]
    for n in range(count):
        yield bearings[n % len(bearings)], 10 ** rng.uniform(-9, -1.5) * rng.standard_normal(5) / SCALE, rng


def test_a_thousand_random_displacements_are_solved_with_a_positive_semidefinite_tangent():
    loose = 0
    for bearing, q, _ in random_states(1000, 0):
        load = bearing_load(bearing, q)
        tangent = load.tangent / np.outer(SCALE, SCALE)
        values = np.linalg.eigvalsh(tangent)
        assert np.array_equal(tangent, tangent.T)
        assert np.isfinite(load.slopes).all()
        assert values[0] >= -1e-12 * values[-1]
        loose += np.abs(load.force).max() < 1e-3
    assert loose > 50


def test_every_ball_is_in_equilibrium_by_the_scalar_equations():
    for bearing, q, _ in random_states(300, 1):
        found = ball_loads(bearing, q)
        Q, sine, cosine = found.force, np.sin(found.contact_angle), np.cos(found.contact_angle)
        axial = Q * sine @ [1, -1, 1, -1]
        radial = Q * cosine @ [1, 1, -1, -1] + bearing.contacts.centrifugal[0]
        rounding = 1e-15 * np.max(1.5 * bearing.contacts.table[:, 3] * np.sqrt(np.maximum(found.approach, 0)), axis=1)
        assert np.all(np.hypot(axial, radial) <= 1e-8 * Q.sum(axis=1) + rounding + 1e-6)


def test_the_energy_is_convex_in_the_displacement():
    for bearing, q, rng in random_states(300, 3):
        other = q + np.linalg.norm(q) * rng.standard_normal(5)
        at, there = bearing_load(bearing, q), bearing_load(bearing, other)
        slack = 1e-12 * (abs(at.energy) + abs(there.energy) + abs(at.force @ (other - q))) + 1e-12
        assert there.energy >= at.energy + at.force @ (other - q) - slack
        assert (there.force - at.force) @ (other - q) >= -slack


def test_a_ring_within_its_clearance_feels_nothing():
    bearing = pitch_bearing(preload=-1e-3)
    load = bearing_load(bearing, np.array([1e-4, 2e-4, -1e-4, 1e-4, 5e-5]))
    assert np.abs(load.force).max() < 1e-6
    assert np.abs(load.tangent).max() < 1e-2
    assert load.energy < 1e-9


def test_forces_fade_without_a_jump_where_contact_is_lost():
    bearing = pitch_bearing(preload=-2e-5)
    touch = 2 * 2e-5 * np.sqrt(2)
    # centres of il and or are 2ℓ apart along 45°; the ring touches where a shift has taken up both gaps
    reach = bearing.contacts.table[0, 2] + bearing.contacts.table[3, 2]
    arm = 2 * (bearing.radius_inner_left - 0.03)
    at = brentq(lambda x: np.hypot(arm * np.sqrt(0.5) + x, arm * np.sqrt(0.5)) - reach, 0, 2 * touch)
    axial = [bearing_load(bearing, np.array([at + gap, 0, 0, 0, 0])).force[0] for gap in (-1e-9, 1e-12, 1e-10, 1e-8)]
    assert axial[0] < 1e-4
    # two contacts in series, Hertz: F ∝ gap^1.5
    np.testing.assert_allclose(axial[3] / axial[2], 1e3, rtol=1e-3)
    assert 0 <= axial[1] < axial[2]


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
    with pytest.raises(InfeasibleError, match="no equilibrium under the load"):
        displacement(pitch_bearing(), np.array([load, 0, 0, 0, load]))
