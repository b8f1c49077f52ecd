"""The rule for verdicts on draws whose statistics are known: its false alarms are its level, in any unit, once and often."""

from __future__ import annotations

from math import comb

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom, chi2

from strainsight.estimation.draws import draw_truth
from strainsight.estimation.filter import run_filter
from strainsight.estimation.verdict import (
    ALLOWED,
    LEVEL,
    OVERCONFIDENT,
    TOO_CAUTIOUS,
    band_of,
    benefit_of,
    chi_square_band,
    claim_of,
    expected_ratio,
    judged,
    not_identified,
    samples_alike,
    word_of,
)

from ..shared import slowly


def few(count, tries, share):
    """Whether so many of the tries are what a share explains, in 9999 of 10 000 cases."""
    return count <= binom.ppf(0.9999, tries, share)


def test_the_band_of_a_mean_square_is_that_of_tables():
    rng = np.random.default_rng(1)
    means = np.mean(rng.standard_normal((20000, 10, 4)) ** 2, axis=(1, 2))
    low, high = chi_square_band(4, 10, 0.95)
    assert np.mean((means > low) & (means < high)) == pytest.approx(0.95, abs=0.01)
    assert chi_square_band(1, level=0.95) == pytest.approx((0.000982, 5.0239), rel=1e-3)  # Abramowitz and Stegun, table 26.8


@pytest.mark.parametrize("draws", [1, 30])
def test_of_sigmas_that_hold_27_in_ten_thousand_are_called_wrong(draws):
    """As many on either side: the number of false alarms is binomial."""
    e = np.random.default_rng(4).standard_normal((100_000, draws))
    ratio, (low, high) = np.sqrt(np.mean(e**2, axis=1)), band_of(draws)
    for outside in (ratio < low, ratio > high):
        count = np.count_nonzero(outside)
        assert binom.ppf(1e-4, 100_000, 0.00135) <= count <= binom.ppf(1 - 1e-4, 100_000, 0.00135)


@pytest.mark.parametrize(("draws", "off", "found"), [(1, 10.0, 0.7), (20, 2.0, 0.9), (20, 0.4, 0.97), (500, 1.3, 0.999)])
def test_a_sigma_that_is_wrong_is_found_the_surer_the_more_draws(draws, off, found):
    """Power by χ² itself: P(off² χ²_n / n outside the band)."""
    e = off * np.random.default_rng(7).standard_normal((2000, draws))
    ratio, (low, high) = np.sqrt(np.mean(e**2, axis=1)), band_of(draws)
    share = np.mean((ratio < low) | (ratio > high))
    expected = chi2.cdf(draws * (low / off) ** 2, draws) + chi2.sf(draws * (high / off) ** 2, draws)
    assert share == pytest.approx(expected, abs=4 * np.sqrt(expected * (1 - expected) / 2000) + 1e-3)
    assert share > found


def test_many_draws_do_not_speak_up_for_less_than_a_tenth():
    """A million draws show an error of a per cent beyond doubt; one of a tenth matters."""
    assert [judged(ratio, 10**6).verdict for ratio in (0.85, 0.95, 1.0, 1.05, 1.15)] == [
        "too cautious", "consistent", "consistent", "consistent", "overconfident"
    ]  # fmt: skip
    assert chi_square_band(1, 10**6)[1] < 1.005


def test_a_claim_is_judged_by_as_many_draws_as_there_are():
    """Twice the claimed σ: nothing out of the ordinary once, impossible twenty times (χ²₂₀ beyond 80: 4e-9)."""
    once, often = claim_of(np.array(2.0), np.array(1.0)), claim_of(np.full(20, -0.2), np.full(20, 0.1))
    assert (once.draws, often.draws) == (1, 20)
    assert (once.ratio, often.ratio) == pytest.approx((2.0, 2.0))
    assert (once.verdict, often.verdict) == ("consistent", "overconfident")
    assert once.band[1] == pytest.approx(3.2053, abs=1e-3)  # two-sided 0.00135 of a normal
    assert claim_of(np.full(20, 0.3), np.ones(20)).verdict == "too cautious"


@pytest.mark.parametrize("unit", [1e-11, 1e-3, 1e9])
def test_a_verdict_knows_no_unit(unit):
    rng = np.random.default_rng(8)
    error, std = rng.standard_normal((300, 3)), rng.uniform(0.5, 2.0, (300, 3))
    ours, other = (claim_of(factor * error, factor * std, alike=samples_alike(error / std)) for factor in (1.0, unit))
    assert (ours.draws, ours.verdict) == (other.draws, other.verdict)
    assert ours.ratio == pytest.approx(other.ratio, rel=1e-12)


def test_what_is_no_number_is_not_consistent():
    assert word_of(np.nan, band_of(3)) == "overconfident"
    assert word_of(np.inf, band_of(3)) == "overconfident"


def in_time(rho, samples, many, seed=6):
    """x' = ρx + √(1 − ρ²) w of variance 1: (samples, many)."""
    w = np.random.default_rng(seed).standard_normal((samples + 500, many))
    return lfilter([np.sqrt(1 - rho**2)], [1, -rho], w, axis=0)[500:]


@pytest.mark.parametrize("rho", [*slowly(0.0), 0.9])
def test_samples_that_follow_each_other_count_as_so_many_independent_ones(rho):
    """The mean of x² over n samples scatters by 2/n Σ ρ_k² = 2/n (1 + ρ²)/(1 − ρ²), k over all lags."""
    n, x = 400, in_time(rho, 400, 8_000)
    alike = samples_alike(x)
    assert alike == pytest.approx((1 + rho**2) / (1 - rho**2), rel=0.03)
    assert np.var(np.mean(x**2, axis=0)) == pytest.approx(2 * alike / n, rel=0.05)
    assert claim_of(x[:, 0], np.ones(n), alike=alike).draws == int(n / alike)


def test_an_error_that_does_not_change_is_one_draw():
    for samples in (200, 1000):
        assert claim_of(np.full(samples, 0.3), np.ones(samples), alike=samples_alike(np.full(samples, 0.3))).draws == 1
    assert samples_alike(np.zeros(10)) == 1.0


def test_white_noise_on_a_slow_error_does_not_hide_it():
    """By its neighbours alone, half noise and half a lasting error would count as 1000/1.7 draws; it is few."""
    x = np.random.default_rng(9).standard_normal(1000) + 1.0
    assert 1000 / samples_alike(x) < 6


@pytest.mark.parametrize("rho", [0.0, 0.99])
def test_records_of_correlated_errors_raise_no_more_alarms_than_the_level(rho):
    """Each judged by a number of draws that it has to tell itself: few more than 27 in ten thousand, 1 % at most."""
    x = in_time(rho, 2000, 500)
    wrong = sum(claim_of(own, np.ones(2000), alike=samples_alike(own)).verdict != "consistent" for own in x.T)
    assert few(wrong, 500, max(0.01, 1 - LEVEL))


def test_loads_of_a_filter_that_holds_are_consistent(make_beam, make_filter):
    """Truths from the filter's own model: the error of a load in time is correlated, and judged by what it is worth."""
    model = make_filter(make_beam(modes=4), ("tip",))
    nothing, P0, many = np.zeros((1500, 3, 0)), np.diag([0.0] * 8 + [1.0]), 40
    x, y = draw_truth(model, np.zeros(9), P0, nothing, list(range(many)))
    run = run_filter(model, np.zeros(9), P0, nothing, y)
    scaled = ((run.mean[:, :, 8] - x[:, :, 8]) / run.std[:, :, 8])[150:]
    claims = [claim_of(own, np.ones(len(own)), alike=samples_alike(own)) for own in scaled.T]
    assert few(sum(claim.verdict != "consistent" for claim in claims), many, 0.01)
    assert max(claim.draws for claim in claims) < len(scaled)
    twice = [claim_of(2 * own, np.ones(len(own)), alike=samples_alike(own)) for own in scaled.T]
    assert sum(claim.verdict == "overconfident" for claim in twice) > 0.9 * many


def test_lost_draws_and_claims_of_nothing_are_no_draws():
    claim = claim_of(np.array([1.0, np.nan, 5.0, 1.0]), np.array([1.0, 1.0, 0.0, np.inf]))
    assert (claim.draws, claim.ratio) == (1, 1.0)
    assert claim_of(np.array([np.nan]), np.array([1.0])) is None
    assert claim_of(np.zeros(0), np.zeros(0)) is None


def test_the_expected_ratio_is_what_draws_of_the_posterior_would_be_off():
    rng = np.random.default_rng(4)
    for mean, std, posterior, width in ((0.0, 1.0, 0.0, 1.0), (0.3, 0.2, -0.5, 0.7), (2.0, 5.0, 1.0, 0.1)):
        error = posterior + width * rng.standard_normal(1_000_000) - mean
        assert expected_ratio(mean, std, posterior, width) == pytest.approx(np.sqrt(np.mean(error**2)) / std, rel=5e-3)


def test_a_claim_is_overconfident_whose_mean_is_2_sigma_off_or_whose_sigma_is_half():
    for far in (-3.0, -2.01, 0.0, 1.0, 2.01):
        for width in (0.3, 0.9, 2.01, 9.0):
            wrong = word_of(expected_ratio(7.0, 0.01, 7.0 + 0.01 * far, 0.01 * width), ALLOWED) == OVERCONFIDENT
            assert wrong == (far**2 + width**2 > 4)
            assert wrong or (abs(far) <= 2 and width <= 2)
    assert word_of(expected_ratio(0.0, 0.0, 0.0, 1.0), ALLOWED) == OVERCONFIDENT
    assert word_of(expected_ratio(np.nan, np.nan, 0.0, 1.0), ALLOWED) == OVERCONFIDENT
    assert word_of(expected_ratio(0.0, 3.0, 0.0, 1.0), ALLOWED) == TOO_CAUTIOUS


def test_starts_must_agree_within_what_one_draw_may_be_off():
    estimate = np.array([[1.00, 1.0, 1.0, 1.00], [1.02, 1.0, 1.4, 1.02], [1.01, np.nan, 1.2, 1.05]])
    std = np.full((3, 4), 0.01)
    np.testing.assert_array_equal(not_identified(estimate, std), [False, True, True, True])
    np.testing.assert_array_equal(not_identified(estimate, 2 * std), [False, True, True, False])
    edge = band_of(1)[1]
    np.testing.assert_array_equal(not_identified(np.array([[0.0, 0.0], [0.99 * edge, 1.01 * edge]]), np.ones((2, 2))), [0, 1])


def test_a_layout_that_is_like_random_ones_is_rarely_called_better():
    """Layouts and sets from one distribution: the layout's rank among n + 1 is uniform, and "shown" are the ranks of the sign
    test, counted here by binomial coefficients."""
    rng, n = np.random.default_rng(10), 10
    words = [benefit_of(draw[0], draw[1:]).verdict for draw in rng.exponential(size=(5000, n + 1))]
    tails = np.cumsum([comb(n, k) for k in range(n + 1)]) / 2**n
    shown = int(np.count_nonzero(tails <= 0.05))
    assert shown == 2  # none or one of ten
    assert words.count("shown") / 5000 == pytest.approx(shown / (n + 1), abs=0.02)
    assert words.count("none") / 5000 == pytest.approx(6 / (n + 1), abs=0.03)  # five to ten of ten


def test_the_median_of_the_random_sets_decides_whether_placing_gains_nothing():
    errors = np.arange(1.0, 12.0)
    for own in (0.5, 2.5, 5.5, 6.0, 9.0):
        found = benefit_of(own, errors)
        assert (found.verdict == "none") == (np.median(errors) <= own)
        assert found.as_well == np.count_nonzero(errors <= own)
    assert benefit_of(0.5, errors).verdict == "shown"
    assert benefit_of(3.5, errors).verdict == "not shown"


def test_sets_that_diverged_did_worse_and_a_layout_that_did_is_no_gain():
    assert benefit_of(1.0, np.full(10, np.nan)).verdict == "shown"
    assert benefit_of(np.nan, np.ones(10)).verdict == "none"
    assert benefit_of(1.0, np.full(4, 9.0)) is None
