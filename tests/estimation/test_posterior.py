"""Densities of parameters from the points of a lattice."""

import numpy as np
import pytest
from scipy.stats import norm

from strainsight.estimation.lattice import lattice_about
from strainsight.estimation.posterior import marginal, peaks_of


def test_a_normal_posterior_on_a_lattice_of_its_own_standard_deviation_is_normal():
    point = np.arange(-5.0, 6.0)
    weight = norm.pdf(point)
    own = marginal(0.3 + 0.02 * point, weight / weight.sum(), 0.02, (0.0, 0.1))
    np.testing.assert_allclose(own.density, norm.pdf(own.value, 0.3, 0.02), atol=2e-4 * own.density.max())
    np.testing.assert_allclose(own.prior, norm.pdf(own.value, 0.0, 0.1))
    assert own.left == pytest.approx(0.2, rel=1e-4)
    assert own.peak == pytest.approx([0.3], abs=1e-3)
    assert own.share == pytest.approx([1.0])


def test_each_parameter_of_a_correlated_normal_posterior_has_its_marginal():
    mean, covariance = np.array([0.1, -0.2]), np.array([[4.0, 2.9], [2.9, 2.5]])
    lattice = lattice_about(mean, covariance, 1.0, 5.0)
    off = lattice.point - mean
    weight = np.exp(-0.5 * np.sum(off @ np.linalg.inv(covariance) * off, axis=1))
    weight /= weight.sum()
    for i in range(2):
        own = marginal(lattice.point[:, i], weight, float(lattice.step[i]), (0.0, 10.0))
        exact = norm.pdf(own.value, mean[i], np.sqrt(covariance[i, i]))
        np.testing.assert_allclose(own.density, exact, atol=2e-3 * exact.max())


def test_a_posterior_of_two_peaks_has_both_with_their_probabilities_and_keeps_its_moments():
    point = np.arange(-40, 120) * 0.1
    weight = 0.3 * norm.pdf(point, 0.0, 0.4) + 0.7 * norm.pdf(point, 8.0, 0.5)
    weight /= weight.sum()
    own = marginal(point, weight, 0.1, (0.0, 10.0))
    assert own.peak == pytest.approx([0.0, 8.0], abs=0.05)
    assert own.share == pytest.approx([0.3, 0.7], abs=1e-3)
    step = own.value[1] - own.value[0]
    mean = step * own.density @ own.value
    assert step * own.density.sum() == pytest.approx(1.0, abs=1e-6)
    assert mean == pytest.approx(weight @ point, rel=1e-6)
    assert step * own.density @ (own.value - mean) ** 2 == pytest.approx(weight @ (point - mean) ** 2, rel=1e-5)


def test_points_that_are_no_lattice_have_a_normal_density_of_their_moments():
    own = marginal(np.array([-1.0, 1.0]), np.array([0.5, 0.5]), np.inf, (0.0, 4.0))
    np.testing.assert_allclose(own.density, norm.pdf(own.value))
    assert own.left == pytest.approx(0.25)


@pytest.mark.parametrize(("distance", "peaks"), [(2.0, 1), (2.8, 1), (3.4, 2)])
def test_two_humps_are_two_peaks_where_less_than_half_of_the_lower_lies_between(distance, peaks):
    value = np.linspace(-6, 10, 801)
    density = norm.pdf(value) + norm.pdf(value, distance)
    between = 2 * norm.pdf(distance / 2) / density.max()
    assert (between < 0.5) == (peaks == 2)
    assert len(peaks_of(value, density)[0]) == peaks


def test_a_peak_that_holds_less_than_a_hundredth_is_none():
    value = np.linspace(-6, 16, 801)
    found, share = peaks_of(value, 0.995 * norm.pdf(value) + 0.005 * norm.pdf(value, 10.0))
    assert found == pytest.approx([0.0], abs=0.03)
    assert share == pytest.approx([0.995], abs=1e-6)
