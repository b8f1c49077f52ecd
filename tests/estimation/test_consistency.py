"""The consistency measures on samples whose statistics are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import mahalanobis

from strainsight.estimation.consistency import chi_square_band, nees, nis, not_identified, whiteness, whiteness_band


def test_nees_is_the_squared_mahalanobis_distance_in_any_unit():
    rng = np.random.default_rng(0)
    X = rng.normal(size=(3, 3))
    P, e = X @ X.T, rng.normal(size=3)
    expected = mahalanobis(e, np.zeros(3), np.linalg.inv(P)) ** 2 / 3
    assert nees(e, P) == pytest.approx(expected, rel=1e-10)
    unit = np.array([1e11, 1.0, 1e-9])
    assert nees(e * unit, P * np.outer(unit, unit)) == pytest.approx(expected, rel=1e-10)


def test_bands_hold_what_they_promise():
    rng = np.random.default_rng(1)
    means = np.mean(rng.standard_normal((20000, 10, 4)) ** 2, axis=(1, 2))
    low, high = chi_square_band(4, 10)
    assert np.mean((means > low) & (means < high)) == pytest.approx(0.95, abs=0.01)
    assert chi_square_band(1) == pytest.approx((0.000982, 5.0239), rel=1e-3)  # Abramowitz and Stegun, table 26.8


def test_nis_counts_only_the_gauges_that_measured():
    assert nis(np.array([1.0, np.nan, 3.0])) == pytest.approx(5.0)
    assert np.isnan(nis(np.full(3, np.nan)))


def test_whiteness_tells_white_from_coloured():
    rng = np.random.default_rng(2)
    white = rng.standard_normal((2000, 300, 2))
    inside = np.abs(whiteness(white)) < whiteness_band(2000, 2)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.03)
    coloured = white[1:] + 0.5 * white[:-1]
    np.testing.assert_allclose(whiteness(coloured), 0.4, atol=0.08)  # moving average: 0.5/(1 + 0.25)


def test_starts_must_agree_within_three_deviations():
    estimate = np.array([[1.00, 1.0, 1.0], [1.02, 1.0, 1.4], [1.01, np.nan, 1.2]])
    std = np.full((3, 3), 0.01)
    np.testing.assert_array_equal(not_identified(estimate, std), [False, True, True])
