"""Spectral densities: those of scipy where all samples are there, and the mean square of what they are of."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from strainsight.signals.spectra import LONGEST, density, noise_density


@pytest.mark.parametrize("samples", [40, 1000, 100_000])
def test_of_a_whole_record_it_is_that_of_scipy(samples):
    values = np.random.default_rng(1).standard_normal(samples) + 7.0
    f, found = density(values, 1e-3)
    length = 2 * len(f) if samples > 40 else 16
    theirs = signal.welch(values, 1e3, window="hann", nperseg=length, noverlap=length // 2, detrend="constant")
    np.testing.assert_allclose(f, theirs[0][1:], rtol=1e-12)
    np.testing.assert_allclose(found, theirs[1][1:], rtol=1e-9)
    assert length <= LONGEST


def test_white_noise_lies_about_its_density_and_a_sine_holds_its_mean_square():
    rng = np.random.default_rng(2)
    f, found = density(3.0 * rng.standard_normal(200_000), 1e-4)
    assert found.mean() == pytest.approx(noise_density(3.0, 1e-4), rel=0.02)
    t = 1e-3 * np.arange(20_000)
    f, found = density(5.0 * np.sin(2 * np.pi * 50 * t), 1e-3)
    assert found.sum() * (f[1] - f[0]) == pytest.approx(12.5, rel=1e-3)
    assert f[np.argmax(found)] == pytest.approx(50, abs=f[1] - f[0])


def test_samples_that_are_missing_leave_the_density_where_it_is():
    rng = np.random.default_rng(3)
    values = rng.standard_normal(20_000)
    values[5_000:6_000] = np.nan
    values[17_003] = np.nan
    _, found = density(values, 0.01)
    assert np.isfinite(found).all()
    assert found.mean() == pytest.approx(noise_density(1.0, 0.01), rel=0.1)


def test_every_tenth_sample_missing_leaves_nothing_to_tell_and_says_so():
    values = np.random.default_rng(4).standard_normal(1000)
    values[::10] = np.nan
    for own in (values, np.full(50, np.nan), np.zeros(0), np.ones(5)):
        f, found = density(own, 0.1)
        assert len(f) == len(found) == 0


def test_no_signal_has_no_power():
    _, found = density(np.full(1000, 3.0), 0.1)
    assert found.max() < 1e-25
