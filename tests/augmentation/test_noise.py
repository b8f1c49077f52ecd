"""Intensities of the noise, and the discrete numbers of the thesis they stand for."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.augmentation.linearisation import Unknowns
from strainsight.augmentation.noise import gauge_intensity, process_intensity
from strainsight.errors import ConfigError

UNKNOWNS = Unknowns(("F",), ("E",), {"F": 1e4}, {"E": 2e11})


def test_default_intensities_stand_on_the_unknowns_alone():
    Q = process_intensity(3, UNKNOWNS, {"F": 20.0}, {"E": 0.05})
    np.testing.assert_allclose(Q, np.diag([0, 0, 0, 0, 0, 0, 0.1 * 2 * np.pi * 20, 0.0025]), rtol=1e-14)
    noisy = process_intensity(3, UNKNOWNS, {"F": 20.0}, {"E": 0.05}, velocity=np.array([1.0, 2.0, 3.0]))
    assert np.diag(noisy)[:6].tolist() == [0, 0, 0, 1, 2, 3]


@pytest.mark.parametrize("h", [1e-3, 2e-4])
def test_thesis_rule_gives_its_discrete_covariance_at_the_stated_step(h):
    omega = 2 * np.pi * 20
    Q = process_intensity(2, UNKNOWNS, {"F": 20.0}, {"E": 3.0}, rule="thesis", h=h)
    np.testing.assert_allclose(np.diag(Q)[-2:] * h, [(h * omega) ** 2, (h * 3.0) ** 2])
    printed = process_intensity(2, UNKNOWNS, {"F": 20.0}, {"E": 3.0}, rule="as_printed", h=h)
    np.testing.assert_allclose(np.diag(printed)[-2:], [(h * omega) ** 2, (h * 3.0) ** 2])


def test_a_rule_that_needs_a_step_asks_for_it_and_a_missing_guess_is_named():
    with pytest.raises(ConfigError, match="time step"):
        process_intensity(2, UNKNOWNS, {"F": 20.0}, {"E": 3.0}, rule="thesis")
    with pytest.raises(ConfigError, match="frequency of F"):
        process_intensity(2, UNKNOWNS, {}, {"E": 3.0})


def test_gauge_intensity_is_variance_times_sampling_step():
    np.testing.assert_allclose(gauge_intensity(np.array([1e-6, 2e-6]), 1e-3), [1e-15, 4e-15])
    np.testing.assert_allclose(gauge_intensity(np.array([1e-6]), 1e-3, "as_printed"), [1e-12])
