"""The error of a load, and what it is relative to, on histories whose error is known."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.estimation.metrics import input_error, load_scale, settling_time


def test_the_error_of_a_load_is_over_its_own_rms_after_the_first_tenth():
    """A sine of amplitude a has an RMS of a/√2, whatever it did before."""
    truth = 4.0 * np.sin(2 * np.pi * np.arange(100) / 30)
    truth[:10] = 1e6
    scale, zero = load_scale(truth, 1e9)
    assert not zero
    assert scale == pytest.approx(4.0 / np.sqrt(2))
    error = np.full((100, 3), [0.5, 0.0, -1.0])
    error[:10] = 1e6
    np.testing.assert_allclose(input_error(error, 2.0), [0.25, 0.0, 0.5])


@pytest.mark.parametrize("left", [0.0, 1e-12])
def test_the_error_of_a_load_that_is_zero_is_over_its_amplitude(left):
    """In a file that another program turned, zero may be 1e-16 of what it was."""
    truth = np.concatenate([np.full(10, 3.0), np.full(90, left)])
    assert load_scale(truth, 50.0) == (50.0, True)


def test_an_estimate_has_settled_from_when_on_it_stays_near():
    """Within 1 % of 2: never where the last sample is outside, and at the last one where it alone is inside; a truth of zero
    settles where it is met."""
    time = np.arange(5.0)
    assert settling_time(time, np.array([3.0, 2.0, 2.4, 2.01, 2.0]), 2.0, 0.01) == 3.0
    assert settling_time(time, np.array([3.0, 3.0, 3.0, 3.0, 2.0]), 2.0, 0.01) == 4.0
    assert settling_time(time, np.array([2.0, 2.0, 2.0, 2.0, 3.0]), 2.0, 0.01) == np.inf
    assert settling_time(time, np.full(5, np.nan), 2.0, 0.01) == np.inf
    assert settling_time(time, np.full(5, -2.0), -2.0, 0.01) == 0.0
    assert settling_time(time, np.array([1.0, 1.0, 0.0, 0.0, 0.0]), 0.0, 0.01) == 2.0
