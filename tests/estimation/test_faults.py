"""Faults of channels: how each is undone, and what is seen of it in the channel alone."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.estimation.faults import (
    Explained,
    Fault,
    at_limit,
    channel_check,
    chosen,
    dead_density,
    delay,
    roughly,
    shifted,
    undone,
)

RNG = np.random.default_rng(1)
SAMPLES = RNG.standard_normal((60, 3))


@pytest.mark.parametrize(
    ("fault", "made"),
    [
        (Fault("sign", 1), lambda y: y * [1, -1, 1]),
        (Fault("scale", 2, 1e-3), lambda y: y * [1, 1, 1e-3]),
        (Fault("swapped", 0, 2), lambda y: y[:, [2, 1, 0]]),
    ],
)
def test_what_a_fault_does_is_undone(fault, made):
    np.testing.assert_allclose(undone(fault, made(SAMPLES))[0], SAMPLES, rtol=1e-12)


def test_a_factor_changes_the_density_by_its_jacobian():
    """Of a density in y, p(y/s)/s for every sample that is there."""
    y = SAMPLES.copy()
    y[:7, 1] = np.nan
    assert undone(Fault("scale", 1, 1e6), y)[1] == pytest.approx(-53 * np.log(1e6))


@pytest.mark.parametrize("n", [3, -3])
def test_a_delay_is_undone_but_for_the_end(n):
    late = shifted(SAMPLES[:, 0], -n)
    back = shifted(late, n)
    there = np.isfinite(back)
    assert there.sum() == 57
    np.testing.assert_array_equal(back[there], SAMPLES[there, 0])


def test_only_rows_of_equal_extreme_samples_are_clipped():
    wave = np.sin(0.1 * np.arange(400))
    assert not at_limit(wave).any()
    clipped = np.clip(wave, -0.7, 0.7)
    assert at_limit(clipped).sum() == np.count_nonzero(np.abs(wave) >= 0.7)
    one_side = np.minimum(wave, 0.7)
    np.testing.assert_array_equal(at_limit(one_side), wave >= 0.7)
    assert not at_limit(np.full(50, 2.0)).any()


def test_a_channel_against_its_prediction():
    y = np.column_stack([SAMPLES[:, 0], -2 * SAMPLES[:, 0], np.full(60, 3.0)])
    y[5, 0] = np.nan
    check = channel_check(y, np.column_stack([SAMPLES[:, 0], SAMPLES[:, 0], SAMPLES[:, 0]]), np.full((60, 3), 0.5))
    np.testing.assert_allclose(check.correlation[:2], [1, -1], atol=1e-12)
    assert np.isnan(check.correlation[2])
    rms = np.sqrt(np.mean(SAMPLES[:, 0] ** 2))
    np.testing.assert_allclose(check.residual[:2], [0, 6 * rms], atol=1e-12)
    np.testing.assert_allclose(check.measured[1:], [2 * rms, 3])


def test_a_channel_without_samples_has_no_numbers():
    check = channel_check(np.full((5, 1), np.nan), np.ones((5, 1)), np.ones((5, 1)))
    assert np.isnan([check.measured, check.residual, check.correlation]).all()


def test_the_delay_that_fits_is_found_and_a_change_of_sign_is_none():
    t = np.arange(500)
    foreseen = np.sin(2 * np.pi * t / 60) + 0.3 * np.sin(2 * np.pi * t / 23)
    found = delay(shifted(foreseen, -7), foreseen, np.full(500, 0.01), 0.01)
    assert found == Fault("late", 0, 7)
    turned = delay(-foreseen, foreseen, np.full(500, 0.01), 0.01)
    assert turned is not None
    assert roughly(turned, -foreseen, foreseen, np.full(500, 0.01), 0.01) < roughly(
        Fault("sign", 0), -foreseen, foreseen, np.full(500, 0.01), 0.01
    )


def test_noise_alone_is_as_dense_as_its_own_normal_density():
    from scipy.stats import norm

    y = 4.0 + 0.3 * RNG.standard_normal(200)
    expected = norm.logpdf(y, y.mean(), y.std()).sum() + 200 * np.log(0.25)
    assert dead_density(y, 0.25) == pytest.approx(expected)
    assert np.isfinite(dead_density(np.zeros(10), 0.25))


def explained(kind, evidence, ratio=1.0, channel=0, amount=0.0):
    return Explained(Fault(kind, channel, amount), evidence, ratio)


@pytest.mark.parametrize(
    ("found", "named"),
    [
        ([explained("sign", 0), explained("offset", -500)], "sign"),
        ([explained("sign", 0), explained("offset", -3)], None),
        ([explained("sign", 0, ratio=4.0), explained("offset", -500)], "offset"),
        ([explained("sign", 0, ratio=1.3), explained("offset", -5)], "offset"),
        ([explained("sign", 0, ratio=1.3), explained("offset", -5, ratio=1.25)], None),
        ([explained("sign", 0, ratio=1.6)], None),
        ([explained("sign", -995), explained("offset", -999)], None),
        ([explained("angle", 0, amount=45.0), explained("angle", -1, amount=-45.0)], "angle"),
        ([explained("late", 0, amount=3), explained("late", -2, amount=4)], "late"),
        ([explained("sign", 0), explained("sign", -1, channel=1)], None),
        ([explained("sign", -np.inf)], None),
        ([], None),
    ],
)
def test_one_fault_is_named_where_no_other_explains_the_record_as_well(found, named):
    best, candidates = chosen(-1000, found, believable=1.5, margin=20, apart=10)
    assert (best.fault.kind if best else None) == named
    assert best is None or best in candidates
