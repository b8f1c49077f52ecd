"""The approximations of the exponential: their order, damping and periods, and which is chosen."""

from __future__ import annotations

from math import factorial

import numpy as np
import pytest

from strainsight.fem.pade import DEGREES, choose, pade


@pytest.mark.parametrize("degree", DEGREES)
def test_the_approximation_has_its_order_and_its_damping(degree):
    """R has the Taylor coefficients of eᶻ up to z^(2s−1) and no further, |R(iy)| ≤ 1 everywhere, and |R∞| < 1."""
    scheme = pade(degree)
    turn = np.arange(64)
    coefficient = np.fft.fft(scheme.at(np.exp(2j * np.pi * turn / 64)))[: 2 * degree + 1].real / 64
    error = np.abs(coefficient - [1 / factorial(k) for k in range(2 * degree + 1)])
    assert error[:-1].max() < 3e-14 < error[-1]
    y = np.geomspace(1e-2, 1e6, 2000)
    assert np.all(np.abs(scheme.at(1j * y)) <= 1 + 1e-13)
    assert abs(scheme.at(1e12j)) == pytest.approx(abs(scheme.infinity), rel=1e-6)
    assert abs(scheme.infinity) < 0.91
    assert np.all(scheme.pole.real > 0)


@pytest.mark.parametrize("y", [0.01, 0.3, 0.5, 0.9, 2.7, 3.0, 5.6, 7.0, 20.0])
def test_what_is_resolved_keeps_its_period_and_its_amplitude(y):
    scheme, substeps = choose(y)
    R = scheme.at(1j * y / substeps) ** substeps
    turned = np.angle(R * np.exp(-1j * y))
    assert abs(turned) <= 1.01e-4 * y
    assert abs(np.log(abs(R))) <= 1e-4 * y


def test_fewest_solves_and_never_more_factors_for_nothing():
    cost = {y: choose(y)[0].degree * choose(y)[1] // 2 for y in (0.1, 0.5, 1.0, 2.0, 4.0, 8.0)}
    assert cost == {0.1: 1, 0.5: 1, 1.0: 2, 2.0: 2, 4.0: 3, 8.0: 6}


# ---- one and few unknowns
