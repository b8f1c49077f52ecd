"""Values between samples against sines in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.signals.interpolation import fill_gaps, interpolate, join_by_lines, share_above

COUNT, MARGIN = 401, 40
INDEX = np.arange(COUNT)


def sine(t, frequency):
    return np.sin(2 * np.pi * frequency * t + 0.7)


@pytest.mark.parametrize(("frequency", "error"), [(0.1, 1e-6), (0.2, 1e-4), (0.25, 5e-4), (0.3, 5e-3)])
@pytest.mark.parametrize("factor", [2, 4])
def test_spline_follows_a_sine_up_to_a_third_of_the_sampling_rate(frequency, error, factor):
    fine = np.arange(factor * (COUNT - 1) + 1) / factor
    inside = (fine > MARGIN) & (fine < COUNT - MARGIN)
    found = interpolate(sine(INDEX, frequency), factor)
    np.testing.assert_allclose(found[inside], sine(fine, frequency)[inside], atol=error)
    np.testing.assert_array_equal(found[::factor], sine(INDEX, frequency))


def test_polynomials_of_the_degree_of_the_spline_are_exact_to_the_ends():
    t = np.linspace(-1, 1, 30)
    fine = np.linspace(-1, 1, 59)
    np.testing.assert_allclose(interpolate(t**7 - t**3, 2), fine**7 - fine**3, atol=1e-10)


@pytest.mark.parametrize("samples", [2, 3, 4, 5, 6, 9])
def test_few_samples_on_a_line_stay_on_it(samples):
    np.testing.assert_allclose(interpolate(np.arange(samples) * 2.0, 2), np.arange(2 * samples - 1), atol=1e-12)


@pytest.mark.parametrize("spacing", [2, 5, 10])
def test_a_table_of_two_rates_has_the_band_of_the_slower_one(spacing):
    true = sine(INDEX, 0.2 / spacing)
    sparse = np.where(INDEX % spacing == 0, true, np.nan)
    inside = slice(8 * spacing, COUNT - 8 * spacing)
    np.testing.assert_allclose(fill_gaps(sparse)[inside], true[inside], atol=1e-3)


def test_a_gap_does_not_raise_the_noise_of_its_neighbours():
    """The spline through all samples would, by a factor of 40."""
    noise = np.random.default_rng(0).standard_normal(COUNT)
    noise[200:210] = np.nan
    assert np.abs(fill_gaps(noise)[200:210]).max() < 5


def test_lines_and_share_of_fast_motion():
    np.testing.assert_allclose(join_by_lines(np.array([0.0, np.nan, 4.0]), 2), [0, 1, 2, 3, 4])
    both = 3.0 * sine(INDEX, 0.05) + 4.0 * sine(INDEX, 0.4)
    assert share_above(both, 0.2) == pytest.approx(0.8, abs=0.01)
    assert share_above(both + 100.0, 0.2) == pytest.approx(4 / np.sqrt(2 * 100**2 + 25), rel=0.01)
    assert share_above(np.zeros(COUNT), 0.1) == 0.0
