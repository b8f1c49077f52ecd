"""The elbow of a trend and gauges that are redundant."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.placement.recommendation import alike, gains, worth_keeping


def test_noise_that_averages_halves_sigma_with_four_times_the_gauges():
    """T = 1/n: the n + 1st gauge lowers σ by 1 − √(n/(n + 1)), which falls below 5 % at n = 10."""
    n = np.arange(50, 1, -1)
    np.testing.assert_allclose(gains(1 / n)[:3], 1 - np.sqrt([2 / 3, 3 / 4, 4 / 5]), rtol=1e-14)
    assert worth_keeping(1 / n, 2) == next(k for k in range(2, 50) if 1 - np.sqrt(k / (k + 1)) < 0.05) == 10


@pytest.mark.parametrize(("trace", "keep", "worth"), [([1.0, 1.0, 1.0], 4, 4), ([1.0, 1.0, 4.0], 4, 5), ([2.0], 7, 7)])
def test_the_elbow_is_where_the_last_worthy_gauge_is(trace, keep, worth):
    assert worth_keeping(np.array(trace), keep) == worth


def test_rows_are_alike_by_their_angle_whatever_length_and_sign():
    tilt = np.deg2rad(8.0)  # cos = 0.9903
    steps = np.array([[np.cos(k * tilt), np.sin(k * tilt), 0.0] for k in range(3)]) * [[1], [-5], [1e-6]]
    rows = np.vstack([steps, [0, 0, 1], [0, 0, 0], [0, 1e-9, -1]])
    assert alike(rows) == [(0, 1, 2), (3, 5)]
    assert alike(rows[[0, 2, 3, 4]]) == []
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    assert alike(rows @ turn) == alike(rows)


def test_gauges_of_several_channels_are_alike_where_they_span_the_same_space():
    rng = np.random.default_rng(1)
    plane, mix = rng.standard_normal((2, 6)), rng.standard_normal((2, 2))
    basis = np.linalg.qr(plane.T)[0].T
    out = np.linalg.svd(basis)[2][2]
    tilted = [[basis[0], np.cos(a) * basis[1] + np.sin(a) * out] for a in np.deg2rad([7.0, 9.0])]
    single = np.array([basis[0], np.zeros(6)])
    rows = np.stack([plane, mix @ plane, *np.array(tilted), single, 3 * single, np.zeros((2, 6))])
    # 7° are within 0.99, 9° are not, but two gauges 2° apart are, and chain
    assert alike(rows[[0, 1, 2, 4, 5, 6]]) == [(0, 1, 2), (3, 4)]
    assert alike(rows[[0, 1, 3, 4, 6]]) == [(0, 1)]
    assert alike(rows[:4]) == [(0, 1, 2, 3)]
    assert alike(rows[[0, 4]]) == []


def test_one_channel_in_a_block_is_a_row():
    rows = np.random.default_rng(4).standard_normal((30, 2))
    padded = np.zeros((30, 3, 2))
    padded[:, 1] = rows
    assert alike(padded) == alike(rows) == alike(rows[:, None])
    assert len(alike(rows)) > 1
