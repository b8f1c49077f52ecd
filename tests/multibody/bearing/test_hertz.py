"""Hertz's contact against closed forms, Harris' table, mpmath and the pressure itself."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import dblquad

from strainsight.multibody.bearing.hertz import (
    contact_ellipse,
    groove_contact,
    groove_curvatures,
    peak_pressure,
    point_contact,
)

MODULUS = 1.15e11

# F(ρ), a*, b*, δ*: Harris, Rolling Bearing Analysis, 4th edition, table 6.1
HARRIS = [
    (0.1075, 1.0760, 0.9318, 0.9974),
    (0.3204, 1.2623, 0.8114, 0.9761),
    (0.4795, 1.4556, 0.7278, 0.9429),
    (0.5916, 1.6440, 0.6687, 0.9077),
    (0.6716, 1.8258, 0.6245, 0.8733),
    (0.7332, 2.011, 0.5881, 0.8394),
    (0.83495, 2.494, 0.5186, 0.7602),
    (0.90999, 3.233, 0.4499, 0.6636),
    (0.95738, 4.395, 0.3830, 0.5551),
    (0.983797, 6.448, 0.3150, 0.4352),
    (0.995112, 10.222, 0.2497, 0.3176),
]


def test_two_spheres_touch_as_the_circle_of_the_closed_form():
    R = 0.03
    K, share = point_contact(1 / R, 1 / R, MODULUS)
    assert share == pytest.approx(0.5, abs=1e-15)
    assert pytest.approx(4 / 3 * MODULUS * np.sqrt(R), rel=1e-14) == K


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


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_slopes_in_ball_and_groove_are_those_of_differences(side):
    D, r, rest = 0.06, 0.0315, (2.3, np.cos(0.8), side, MODULUS)
    _, by_ball, by_groove = groove_contact(D, r, *rest)
    h = 3e-7
    assert by_ball == pytest.approx(
        (groove_contact(D + h, r, *rest)[0] - groove_contact(D - h, r, *rest)[0]) / (2 * h), rel=1e-7
    )
    assert by_groove == pytest.approx(
        (groove_contact(D, r + h, *rest)[0] - groove_contact(D, r - h, *rest)[0]) / (2 * h), rel=1e-7
    )


def test_an_inner_raceway_is_convex_and_an_outer_one_concave():
    D, r, d_m, cosine = 0.06, 0.0315, 0.8, np.cos(0.7)
    gamma = D * cosine / d_m
    for side, radius in ((1.0, D / 2 * (1 - gamma) / gamma), (-1.0, -D / 2 * (1 + gamma) / gamma)):
        along, across = groove_curvatures(D, r, d_m, cosine, side)
        assert (along, across) == (pytest.approx(2 / D + 1 / radius), pytest.approx(2 / D - 1 / r))
