"""Channels whose last value is repeated, and those that only look so."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.measurements.held import held_samples, release

COUNT = 400
INDEX = np.arange(COUNT)
MOVING = 50 * np.sin(0.05 * INDEX) + np.random.default_rng(1).standard_normal(COUNT)


def held(n, values=MOVING, phase=0):
    return values[np.maximum((INDEX - phase) // n * n + phase, 0)]


@pytest.mark.parametrize("n", [2, 5, 20])
@pytest.mark.parametrize("phase", [0, 1])
def test_first_sample_of_every_run_remains(n, phase):
    found, notes = release("F", held(n, phase=phase), 1e-3)
    fresh = np.flatnonzero(np.isfinite(found))
    np.testing.assert_array_equal(np.diff(fresh), n)
    assert fresh[0] == phase
    np.testing.assert_array_equal(found[fresh], MOVING[fresh])
    assert f"runs of {n} equal ones, a channel of {1000 / n:.4g} Hz" in notes[0]
    assert f"(n − 1)/2 = {(n - 1) / 2:g} samples late" in notes[0]


def test_rest_and_missing_samples_hide_no_repetition():
    values = held(4, np.where(INDEX < 100, 0.0, MOVING))
    values[[0, 250]] = np.nan
    found, _ = release("F", values, 1e-3)
    assert np.isfinite(found).sum() == COUNT // 4 - 1


@pytest.mark.parametrize(
    "values",
    [
        MOVING,
        np.zeros(COUNT),
        np.round(INDEX / 5.0),  # a slow ramp in steps of the resolution
        np.round(5 * np.sin(0.02 * INDEX)),
        np.where(INDEX % 2 == 0, MOVING, np.nan),
        np.repeat(np.arange(4.0) ** 2, 100),  # four dead weights
        np.clip(MOVING, -20, 20),
    ],
)
def test_other_equal_samples_are_left_alone(values):
    assert held_samples(values) is None
    found, notes = release("F", values, 1e-3)
    assert found is values
    assert notes == ()


def test_rates_without_a_whole_ratio_are_refused():
    values = MOVING[np.floor(np.floor(INDEX / 3.4) * 3.4).astype(int)]
    with pytest.raises(UserError, match=r"runs of 3 and 4 equal ones: a channel of 250 to 333\.3 Hz"):
        release("F", values, 1e-3)
