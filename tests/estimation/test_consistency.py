"""The consistency measures on samples whose statistics are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.distance import mahalanobis

from strainsight.estimation.consistency import (
    chi_square_band,
    claim_of,
    nees,
    nis,
    not_identified,
    samples_alike,
    verdict,
    whiteness,
    whiteness_band,
)
from strainsight.estimation.draws import draw_truth
from strainsight.estimation.filter import run_filter


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


@pytest.mark.parametrize("draws", [1, 20])
def test_of_claims_that_hold_27_in_ten_thousand_lie_outside_the_band(draws):
    """Drawn from the claim itself, and from one that is twice too sure or too cautious."""
    e = np.random.default_rng(4).standard_normal((100_000, draws))
    ratio = np.sqrt(np.mean(e**2, axis=1))
    low, high = claim_of(e[0], np.ones(draws)).band
    # 270 are expected on 100 000, 135 on each side: four deviations of a count.
    for outside in (ratio < low, ratio > high):
        assert abs(np.count_nonzero(outside) - 135) < 4 * np.sqrt(135)
    if draws == 20:  # one draw of three times σ is luck, and so is none of half of it; twenty are not
        assert np.mean(3 * ratio > high) > 0.999
        assert np.mean(ratio / 3 < low) > 0.999


def test_a_claim_is_judged_by_as_many_draws_as_there_are():
    """Twice the claimed σ: nothing out of the ordinary once, impossible twenty times (χ²₂₀ beyond 80: 4e-9)."""
    once, often = claim_of(np.array(2.0), np.array(1.0)), claim_of(np.full(20, -0.2), np.full(20, 0.1))
    assert (once.draws, often.draws) == (1, 20)
    assert (once.ratio, often.ratio) == pytest.approx((2.0, 2.0))
    assert (once.verdict, often.verdict) == ("as claimed", "overconfident")
    assert once.band[1] == pytest.approx(3.2053, abs=1e-3)  # two-sided 0.00135 of a normal
    assert claim_of(np.full(20, 0.3), np.ones(20)).verdict == "cautious"


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_samples_that_follow_each_other_count_as_so_many_independent_ones(rho):
    """x' = ρx + √(1 − ρ²) w: the mean of x² over n samples scatters by 2/n (1 + ρ²)/(1 − ρ²)."""
    rng, n = np.random.default_rng(6), 400
    x = np.empty((n, 20_000))
    x[0] = rng.standard_normal(20_000)
    for k in range(1, n):
        x[k] = rho * x[k - 1] + np.sqrt(1 - rho**2) * rng.standard_normal(20_000)
    alike = samples_alike(x)
    assert alike == pytest.approx((1 + rho**2) / (1 - rho**2), rel=0.02)
    assert np.var(np.mean(x**2, axis=0)) == pytest.approx(2 * alike / n, rel=0.05)
    assert claim_of(x[:, 0], np.ones(n), alike=alike).draws == int(n / alike)


def test_lost_draws_and_claims_of_nothing_are_no_draws():
    claim = claim_of(np.array([1.0, np.nan, 5.0, 1.0]), np.array([1.0, 1.0, 0.0, np.inf]))
    assert (claim.draws, claim.ratio) == (1, 1.0)
    assert claim_of(np.array([np.nan]), np.array([1.0])) is None
    assert claim_of(np.zeros(0), np.zeros(0)) is None


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
    estimate = np.array([[1.00, 1.0, 1.0, 1.00], [1.02, 1.0, 1.4, 1.02], [1.01, np.nan, 1.2, 1.05]])
    std = np.full((3, 4), 0.01)
    np.testing.assert_array_equal(not_identified(estimate, std), [False, True, True, True])
    np.testing.assert_array_equal(not_identified(estimate, 2 * std), [False, True, True, False])


@pytest.mark.parametrize(
    ("process", "noise", "said"),
    [
        (1, 1, "as large as the noise you stated and independent"),
        (1, 1 / 9, "2.6 times larger than the noise you stated: raise R or Q"),
        (9, 9, "3.0 times smaller than the noise you stated: lower R or Q"),
        (1 / 100, 1, "resembles the one before"),
        (1 / 100, 1, "; raise Q"),
        (1, 9, "; lower R"),
    ],
)
def test_a_verdict_names_what_was_stated_wrongly(make_beam, make_filter, process, noise, said):
    """The truth is drawn from the model; the filter is told `process` times its Q and `noise` times its R."""
    model = make_filter(make_beam(modes=4), ("tip",))
    nothing, P0 = np.zeros((2000, 3, 0)), np.diag([0.0] * 8 + [1.0])
    _, y = draw_truth(model, np.zeros(9), P0, nothing, [0])
    run = run_filter(replace(model, Q=process * model.Q, r=noise * model.r), np.zeros(9), P0, nothing, y)
    found = verdict(run.whitened)
    assert said in found.text
    assert found.consistent == (process == noise == 1)
    assert verdict(run.whitened[:, 0]).text == found.text


def test_a_verdict_on_coloured_innovations_of_the_right_size():
    white = np.random.default_rng(3).standard_normal((4000, 5))
    opposed = (white[1:] - 0.5 * white[:-1]) / np.sqrt(1.25)
    assert (
        "each undoes the one before (correlation -0.39): the filter overreacts; lower Q and raise R"
        in verdict(opposed).text
    )
    assert verdict(white).consistent
    assert verdict(white).band[0] < 1 < verdict(white).band[1]
    white[::2] = np.nan
    assert verdict(white).consistent
    assert not verdict(np.full((10, 3), np.nan)).consistent


@pytest.mark.parametrize(("size", "correlation"), [(1.08, 0.0), (1 / 1.08, 0.0), (1.0, 0.08), (1.0, -0.08)])
def test_a_long_record_is_judged_by_what_matters_not_by_its_length(size, correlation):
    """160 000 innovations show an error of a per cent beyond doubt; the verdict speaks up from ten on, on either side."""
    rng = np.random.default_rng(5)

    def innovations(off, neighbours):
        """White noise e and b with e(k) + b e(k − 1), whose neighbours correlate by b/(1 + b²)."""
        b = (1 - np.sqrt(1 - 4 * neighbours**2)) / (2 * neighbours) if neighbours else 0.0
        white = rng.standard_normal((40001, 4))
        return off * (white[1:] + b * white[:-1]) / np.sqrt(1 + b**2)

    found = verdict(innovations(size, correlation))
    assert found.ratio == pytest.approx(size, rel=0.01)
    assert found.correlation == pytest.approx(correlation, abs=0.01)
    assert not (found.band[0] < found.ratio < found.band[1]) or abs(found.correlation) > found.chance
    assert found.consistent
    assert not verdict(innovations(size**1.5, 1.5 * correlation)).consistent
