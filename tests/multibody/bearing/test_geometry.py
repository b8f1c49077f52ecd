"""Geometry and Hertzian contact of a bearing."""

from __future__ import annotations

from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import dblquad

from strainsight.errors import UserError
from strainsight.multibody.bearing.hertz import (
    contact_ellipse,
    peak_pressure,
    point_contact,
)

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
