"""The bearing: its geometry, Hertzian contact, load, tangent and slopes, and the equilibrium of its balls."""

from __future__ import annotations

from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.optimize import brentq

from strainsight.errors import InfeasibleError, UserError
from strainsight.multibody.bearing.element import ball_loads, bearing_load, displacement
from strainsight.multibody.bearing.geometry import (
    contact_ellipse,
    peak_pressure,
    point_contact,
)

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


def test_a_ball_that_outgrows_its_grooves_is_refused():
    theta = pitch_bearing().parameters
    theta[0] = 0.0637
    with pytest.raises(
        UserError, match=r"inner left groove of radius 31\.8\d+ mm is too small for a ball of radius 31\.85"
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
        ({"contact_angle": 1.6}, "contact angle is 91.67°"),
        ({"ball_diameter": -0.06}, "ball_diameter is -0.06"),
        ({"pitch_diameter": 0.05}, "pitch diameter"),
        ({"ball_diameter": 1e-170}, r"times the ball radius"),
        ({"ball_diameter": 0.0636 * (1 - 1e-12)}, "is too small"),
        ({"preload": float("nan")}, "preload is nan"),
        ({"poisson_ratio": 0.5}, "ratio 0.5"),
        ({"groove_centres": "float"}, "groove centres 'float'"),
        ({"nominal": (0.06, 0.03)}, "nominal dimensions"),
        ({"nominal": (0.06, 0.03, 0.03, 0.03, 0.03)}, "nominal inner left groove"),
    ],
)
def test_bearings_that_cannot_be_built_are_refused_with_the_value(change, message):
    with pytest.raises(UserError, match=message):
        replace(pitch_bearing(), **change)


MODULUS = 1.15e11

# F(ρ), a*, b*, δ*: Harris, Rolling Bearing Analysis, 4th edition, table 6.1
HARRIS = [
    (0.1075, 1.0760, 0.9318, 0.9974),
    (0.7332, 2.011, 0.5881, 0.8394),
    (0.95738, 4.395, 0.3830, 0.5551),
    (0.995112, 10.222, 0.2497, 0.3176),
]


@pytest.mark.parametrize(("difference", "a_star", "b_star", "delta_star"), HARRIS)
def test_ellipses_are_those_of_harris_table(difference, a_star, b_star, delta_star):
    total = 80.0
    along, across = total * (1 + difference) / 2, total * (1 - difference) / 2
    K, _ = point_contact(along, across, MODULUS)
    # δ = δ* [3Q/(2 Σρ E*)]^⅔ Σρ/2,  a = a* [3Q/(2 Σρ E*)]^⅓
    Q = 5e3
    unit = (3 * Q / (2 * total * MODULUS)) ** (1 / 3)
    delta = (Q / K) ** (2 / 3)
    b, a = contact_ellipse(along, across, MODULUS, np.array(delta))
    np.testing.assert_allclose(
        [a / unit, b / unit, 2 * delta / (unit**2 * total)], [a_star, b_star, delta_star], rtol=6e-4
    )


@pytest.mark.parametrize("ratio", [1.0, 1 + 1e-9, 1.001, 2.0, 30.0, 1e3, 1e6])
def test_contact_constant_and_slopes_are_those_of_mpmath(ratio):
    def exact(along, across):
        def residual(log_k):
            k = mp.exp(log_k)
            E, F = mp.ellipe(1 - k * k), mp.ellipk(1 - k * k)
            return mp.log((E / k**2 - F) / (F - E)) - mp.log(across / along)

        x = mp.findroot(residual, (-2 * mp.log(across / along) / 3, -mp.log(across / along) * 5 / 8))
        m = 1 - mp.exp(2 * x)
        E, F = mp.ellipe(m), mp.ellipk(m)
        return 2 * mp.pi * MODULUS / (3 * F) * mp.sqrt(2 * (F - E) / (m * F * along))

    along = 7.0
    K, share = point_contact(along, along * ratio, MODULUS)
    swapped, other = point_contact(along * ratio, along, MODULUS)
    assert (swapped, other) == (pytest.approx(K, rel=1e-15), pytest.approx(1 - share, abs=1e-15))
    if ratio < 1.0001:
        # the exact formula is 0/0 at the circle; K is smooth there
        assert pytest.approx(4 / 3 * MODULUS / np.sqrt(along) * ratio**-0.25, rel=1e-13) == K
        return
    with mp.workdps(50):
        x, y, h = mp.mpf(along), mp.mpf(along) * mp.mpf(ratio), mp.mpf(10) ** -15
        found = exact(x, y)
        by_x = (exact(x * (1 + h), y) - exact(x * (1 - h), y)) / (2 * h * found)
        by_y = (exact(x, y * (1 + h)) - exact(x, y * (1 - h))) / (2 * h * found)
    assert pytest.approx(float(found), rel=1e-13) == K
    assert (-share / 2, -(1 - share) / 2) == (
        pytest.approx(float(by_x), rel=1e-11),
        pytest.approx(float(by_y), rel=1e-11),
    )


def test_pressure_carries_the_force_and_presses_the_centre_in_by_the_approach():
    along, across, delta = 40.0, 2.0, 5e-5
    K, _ = point_contact(along, across, MODULUS)
    a, b = contact_ellipse(along, across, MODULUS, np.array(delta))
    p0 = peak_pressure(K * np.array(delta) ** 1.5, a, b)
    assert 2 / 3 * np.pi * a * b * p0 == pytest.approx(K * delta**1.5, rel=1e-14)
    # Boussinesq: u = ∫ p/(π E* r) dA, in polar coordinates scaled to the ellipse
    lift, _ = dblquad(
        lambda s, t: p0 * np.sqrt(1 - s * s) / (np.pi * MODULUS) * a * b / np.hypot(a * np.cos(t), b * np.sin(t)),
        0, 2 * np.pi, 0, 1, epsabs=0, epsrel=1e-9,
    )  # fmt: skip
    assert lift == pytest.approx(delta, rel=1e-8)
