"""The claimed σ is the real error (§4.6): truths of the model, other truths, and the statistics of consistency."""

from __future__ import annotations

from dataclasses import replace
from math import comb

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.spatial.distance import mahalanobis
from scipy.stats import binom, chi2

from strainsight.estimation.consistency import after_start, check_innovations, nees, nis, whiteness, whiteness_band
from strainsight.estimation.decision import (
    ALLOWED,
    LEVEL,
    OVERCONFIDENT,
    TOO_CAUTIOUS,
    Claim,
    Decision,
    autocorrelation_time,
    band_of,
    benefit_of,
    check_ratio,
    chi_square_band,
    claim_of,
    exit_code_in,
    expected_ratio,
    not_identified,
    word_of,
)
from strainsight.estimation.filter import run_filter
from strainsight.estimation.smoother import smooth
from strainsight.loads.input_models import Matern, Oscillator
from strainsight.text import number

from ..shared import slowly
from .conftest import make_beam, make_filter, sine
from .truth import draw_truth

SEEDS = range(200)


def honesty(error, std):
    """Real error over claimed one, √(mean e²) / √(mean σ²) over time and runs, after the first tenth; both (T + 1, B, k)."""
    return np.sqrt(np.mean(after_start(error) ** 2, axis=(0, 1)) / np.mean(after_start(std) ** 2, axis=(0, 1)))


@pytest.mark.parametrize(
    ("inputs", "parameters", "modes", "steps", "options"),
    [
        ((), ("E",), 2, 150, {}),
        *slowly(((), ("rho",), 2, 300, {"accelerometers": 1, "q_velocity": 0.1})),
        (("tip",), (), 6, 600, {"models": {"tip": Oscillator(20.0)}, "accelerometers": 1, "q_velocity": 0.1}),
        (("tip",), (), 6, 600, {"models": {"tip": Matern(10.0, 2.5)}, "every": 2}),
    ],
)
def test_claimed_sigma_equals_rms_error(inputs, parameters, modes, steps, options):
    beam = make_beam(modes=modes)
    known = () if inputs else ("tip",)
    model = make_filter(beam, inputs=inputs, parameters=parameters, known=known, **options)
    hertz = 35.0 if "rho" in parameters else 20.0
    u = sine(model.h * np.arange(steps), model.h, 1e4, hertz)[:, :, : len(known)]
    mean, P0 = np.zeros(model.size), np.zeros((model.size, model.size))
    P0[model.position, model.position] = 1.0 if inputs else 0.03**2
    truth, y = draw_truth(model, mean, P0, u, SEEDS)
    run = run_filter(model, mean, P0, u, y, keep="all" if inputs else "mean")
    assert np.all(run.lost < 0)
    unknown = model.position
    error = run.mean[..., unknown] - truth[..., unknown]
    assert honesty(error, run.std[..., unknown])[0] == pytest.approx(1.0, abs=0.05)

    over_runs = nees(error[1:], run.unknown_covariance[1:]).mean(axis=1)
    low, high = chi_square_band(1, len(SEEDS), 0.95)
    assert low < over_runs.mean() < high
    assert np.mean((over_runs > low) & (over_runs < high)) > 0.8

    assert 0.99 < np.nanmean(nis(run.whitened)) < 1.01
    seen = run.whitened[model.every - 1 :: model.every]
    assert np.mean(np.abs(whiteness(seen)) < whiteness_band(*seen.shape[::2], 0.95)) > 0.9
    if inputs:
        smoothed = smooth(model, run)
        late = smoothed.mean[..., unknown] - truth[..., unknown]
        assert honesty(late, smoothed.std[..., unknown])[0] == pytest.approx(1.0, abs=0.05)
        assert np.mean(late**2) < 0.3 * np.mean(error**2)


def test_nees_is_the_squared_mahalanobis_distance_in_any_unit():
    rng = np.random.default_rng(0)
    X = rng.normal(size=(3, 3))
    P, e = X @ X.T, rng.normal(size=3)
    expected = mahalanobis(e, np.zeros(3), np.linalg.inv(P)) ** 2 / 3
    assert nees(e, P) == pytest.approx(expected, rel=1e-10)
    unit = np.array([1e11, 1.0, 1e-9])
    assert nees(e * unit, P * np.outer(unit, unit)) == pytest.approx(expected, rel=1e-10)


def test_nis_counts_only_the_gauges_that_measured():
    assert nis(np.array([1.0, np.nan, 3.0])) == pytest.approx(5.0)
    assert np.isnan(nis(np.full(3, np.nan)))


def test_whiteness_tells_white_from_coloured():
    rng = np.random.default_rng(2)
    white = rng.standard_normal((2000, 300, 2))
    inside = np.abs(whiteness(white)) < whiteness_band(2000, 2, 0.95)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.03)
    assert whiteness_band(2000, 2) == pytest.approx(3 / np.sqrt(4000), rel=1e-3)  # what ±3 σ hold of one draw
    coloured = white[1:] + 0.5 * white[:-1]
    np.testing.assert_allclose(whiteness(coloured), 0.4, atol=0.08)  # moving average: 0.5/(1 + 0.25)


@pytest.mark.parametrize(
    ("process", "noise", "said"),
    [
        (1, 1, "as large as expected from the configured noise, and successive innovations are uncorrelated"),
        (1, 1 / 9, "2.6 times as large as expected from the configured noise: check channels, known loads and the model"),
        (9, 9, "σ is cautious: the innovations are 3.0 times smaller than expected from the configured noise"),
        (9, 9, "The measurements are consistent with the model; to reduce σ, lower noise_std or process_noise"),
        (1 / 100, 1, "successive innovations are correlated (0."),
        (1 / 100, 1, "; check channels, known loads and the model"),
        (1, 9, "to reduce σ, lower noise_std"),
    ],
)
def test_innovation_check_identifies_wrong_noise(process, noise, said):
    model = make_filter(make_beam(modes=4), ("tip",))
    nothing, P0 = np.zeros((2000, 3, 0)), np.diag([0.0] * 8 + [1.0])
    _, y = draw_truth(model, np.zeros(9), P0, nothing, [0])
    run = run_filter(replace(model, Q=process * model.Q, r=noise * model.r), np.zeros(9), P0, nothing, y)
    found = check_innovations(run.whitened)
    assert said in found.text
    assert "raise" not in found.text
    assert found.consistent == (process >= 1 and noise >= 1)
    assert check_innovations(run.whitened[:, 0]).text == found.text


def test_innovation_check_reports_zero_record():
    found = check_innovations(np.zeros((100, 2)))
    assert (found.ratio, found.correlation, found.consistent) == (0.0, 0.0, False)
    assert "all innovations are exactly zero: check whether the channels are connected" in found.text


def test_innovation_check_detects_coloured_innovations():
    white = np.random.default_rng(3).standard_normal((4000, 5))
    opposed = (white[1:] - 0.5 * white[:-1]) / np.sqrt(1.25)
    assert (
        "alternate in sign (correlation -0.39): the filter gain is too large; check channels, known loads and the model"
        in check_innovations(opposed).text
    )
    assert check_innovations(white).consistent
    assert check_innovations(white).band[0] < 1 < check_innovations(white).band[1]
    white[::2] = np.nan
    assert check_innovations(white).consistent
    assert not check_innovations(np.full((10, 3), np.nan)).consistent


@pytest.mark.parametrize(("size", "correlation"), [(1.08, 0.0), (1 / 1.08, 0.0), (1.0, 0.08), (1.0, -0.08)])
def test_innovation_check_ignores_small_deviations_in_long_records(size, correlation):
    rng = np.random.default_rng(5)

    def innovations(off, neighbours):
        """White noise e and b with e(k) + b e(k − 1), whose neighbours correlate by b/(1 + b²)."""
        b = (1 - np.sqrt(1 - 4 * neighbours**2)) / (2 * neighbours) if neighbours else 0.0
        white = rng.standard_normal((40001, 4))
        return off * (white[1:] + b * white[:-1]) / np.sqrt(1 + b**2)

    found = check_innovations(innovations(size, correlation))
    assert found.ratio == pytest.approx(size, rel=0.01)
    assert found.correlation == pytest.approx(correlation, abs=0.01)
    low, high = np.sqrt(chi2.ppf([0.00135, 0.99865], 160_000) / 160_000)
    assert not (low < found.ratio < high) or abs(found.correlation) > found.chance
    assert found.consistent
    worse = check_innovations(innovations(size**1.5, 1.5 * correlation))
    assert worse.consistent == ("σ is cautious" in worse.text) == (size < 1)


def few(count, tries, share):
    """Whether so many of the tries are what a share explains, in 9999 of 10 000 cases."""
    return count <= binom.ppf(0.9999, tries, share)


def test_chi_square_band_matches_tables():
    rng = np.random.default_rng(1)
    means = np.mean(rng.standard_normal((20000, 10, 4)) ** 2, axis=(1, 2))
    low, high = chi_square_band(4, 10, 0.95)
    assert np.mean((means > low) & (means < high)) == pytest.approx(0.95, abs=0.01)
    assert chi_square_band(1, level=0.95) == pytest.approx(
        (0.000982, 5.0239), rel=1e-3
    )  # Abramowitz and Stegun, table 26.8


@pytest.mark.parametrize("draws", [1, 30])
def test_false_alarm_rate_is_27_in_ten_thousand(draws):
    e = np.random.default_rng(4).standard_normal((100_000, draws))
    ratio, (low, high) = np.sqrt(np.mean(e**2, axis=1)), band_of(draws)
    for outside in (ratio < low, ratio > high):
        count = np.count_nonzero(outside)
        assert binom.ppf(1e-4, 100_000, 0.00135) <= count <= binom.ppf(1 - 1e-4, 100_000, 0.00135)


def test_deviations_below_ten_percent_are_consistent():
    assert [check_ratio(ratio, 10**6).result for ratio in (0.85, 0.95, 1.0, 1.05, 1.15)] == [
        "too cautious", "consistent", "consistent", "consistent", "overconfident"
    ]  # fmt: skip
    assert chi_square_band(1, 10**6)[1] < 1.005


def test_claim_band_depends_on_number_of_draws():
    once, often = claim_of(np.array(2.0), np.array(1.0)), claim_of(np.full(20, -0.2), np.full(20, 0.1))
    assert (once.draws, often.draws) == (1, 20)
    assert (once.ratio, often.ratio) == pytest.approx((2.0, 2.0))
    assert (once.result, often.result) == ("consistent", "overconfident")
    assert once.band[1] == pytest.approx(3.2053, abs=1e-3)  # two-sided 0.00135 of a normal
    assert claim_of(np.full(20, 0.3), np.ones(20)).result == "too cautious"


@pytest.mark.parametrize("unit", [1e-11, 1e-3, 1e9])
def test_claim_is_invariant_to_units(unit):
    rng = np.random.default_rng(8)
    error, std = rng.standard_normal((300, 3)), rng.uniform(0.5, 2.0, (300, 3))
    time = autocorrelation_time(error / std)
    ours, other = (claim_of(factor * error, factor * std, samples_per_draw=time) for factor in (1.0, unit))
    assert (ours.draws, ours.result) == (other.draws, other.result)
    assert ours.ratio == pytest.approx(other.ratio, rel=1e-12)


def in_time(rho, samples, many, seed=6):
    """x' = ρx + √(1 − ρ²) w of variance 1: (samples, many)."""
    w = np.random.default_rng(seed).standard_normal((samples + 500, many))
    return lfilter([np.sqrt(1 - rho**2)], [1, -rho], w, axis=0)[500:]


@pytest.mark.parametrize("rho", [*slowly(0.0), 0.9])
def test_autocorrelation_time_counts_independent_samples(rho):
    """The mean of x² over n samples scatters by 2/n Σ ρ_k² = 2/n (1 + ρ²)/(1 − ρ²), k over all lags."""
    n, x = 400, in_time(rho, 400, 8_000)
    time = autocorrelation_time(x)
    assert time == pytest.approx((1 + rho**2) / (1 - rho**2), rel=0.03)
    assert np.var(np.mean(x**2, axis=0)) == pytest.approx(2 * time / n, rel=0.05)
    assert claim_of(x[:, 0], np.ones(n), samples_per_draw=time).draws == int(n / time)


def test_constant_error_counts_as_one_draw():
    for samples in (200, 1000):
        error = np.full(samples, 0.3)
        assert claim_of(error, np.ones(samples), samples_per_draw=autocorrelation_time(error)).draws == 1
    assert autocorrelation_time(np.zeros(10)) == 1.0


def test_autocorrelation_time_detects_slow_error_in_noise():
    x = np.random.default_rng(9).standard_normal(1000) + 1.0
    assert 1000 / autocorrelation_time(x) < 6


@pytest.mark.parametrize("rho", [0.0, 0.99])
def test_correlated_errors_keep_false_alarm_rate(rho):
    x = in_time(rho, 2000, 500)
    wrong = sum(claim_of(own, np.ones(2000), samples_per_draw=autocorrelation_time(own)).result != "consistent" for own in x.T)
    assert few(wrong, 500, max(0.01, 1 - LEVEL))


def test_claim_ignores_diverged_and_empty_draws():
    claim = claim_of(np.array([1.0, np.nan, 5.0, 1.0]), np.array([1.0, 1.0, 0.0, np.inf]))
    assert (claim.draws, claim.ratio) == (1, 1.0)
    assert claim_of(np.array([np.nan]), np.array([1.0])) is None
    assert claim_of(np.zeros(0), np.zeros(0)) is None


def test_expected_ratio_matches_posterior_draws():
    rng = np.random.default_rng(4)
    for mean, std, posterior, width in ((0.0, 1.0, 0.0, 1.0), (0.3, 0.2, -0.5, 0.7), (2.0, 5.0, 1.0, 0.1)):
        error = posterior + width * rng.standard_normal(1_000_000) - mean
        assert expected_ratio(mean, std, posterior, width) == pytest.approx(np.sqrt(np.mean(error**2)) / std, rel=5e-3)


def test_ratio_above_two_is_overconfident():
    for far in (-3.0, -2.01, 0.0, 1.0, 2.01):
        for width in (0.3, 0.9, 2.01, 9.0):
            wrong = word_of(expected_ratio(7.0, 0.01, 7.0 + 0.01 * far, 0.01 * width), ALLOWED) == OVERCONFIDENT
            assert wrong == (far**2 + width**2 > 4)
            assert wrong or (abs(far) <= 2 and width <= 2)
    assert word_of(expected_ratio(0.0, 0.0, 0.0, 1.0), ALLOWED) == OVERCONFIDENT
    assert word_of(expected_ratio(np.nan, np.nan, 0.0, 1.0), ALLOWED) == OVERCONFIDENT
    assert word_of(expected_ratio(0.0, 3.0, 0.0, 1.0), ALLOWED) == TOO_CAUTIOUS


def test_starts_must_agree_within_band_of_one_draw():
    estimate = np.array([[1.00, 1.0, 1.0, 1.00], [1.02, 1.0, 1.4, 1.02], [1.01, np.nan, 1.2, 1.05]])
    std = np.full((3, 4), 0.01)
    np.testing.assert_array_equal(not_identified(estimate, std), [False, True, True, True])
    np.testing.assert_array_equal(not_identified(estimate, 2 * std), [False, True, True, False])
    edge = band_of(1)[1]
    np.testing.assert_array_equal(
        not_identified(np.array([[0.0, 0.0], [0.99 * edge, 1.01 * edge]]), np.ones((2, 2))), [0, 1]
    )


def test_benefit_is_rarely_shown_for_random_layouts():
    """The rank among n + 1 is uniform, and "shown" are the ranks of the sign test, by binomial coefficients."""
    rng, n = np.random.default_rng(10), 10
    words = [benefit_of(draw[0], draw[1:]).result for draw in rng.exponential(size=(5000, n + 1))]
    tails = np.cumsum([comb(n, k) for k in range(n + 1)]) / 2**n
    shown = int(np.count_nonzero(tails <= 0.05))
    assert shown == 2  # none or one of ten
    assert words.count("shown") / 5000 == pytest.approx(shown / (n + 1), abs=0.02)
    assert words.count("none") / 5000 == pytest.approx(6 / (n + 1), abs=0.03)  # five to ten of ten


def test_benefit_none_above_median_of_random_sets():
    errors = np.arange(1.0, 12.0)
    for own in (0.5, 2.5, 5.5, 6.0, 9.0):
        found = benefit_of(own, errors)
        assert (found.result == "none") == (np.median(errors) <= own)
        assert found.as_well == np.count_nonzero(errors <= own)
    assert benefit_of(0.5, errors).result == "shown"
    assert benefit_of(3.5, errors).result == "not shown"


def test_diverged_sets_count_as_worse():
    assert benefit_of(1.0, np.full(10, np.nan)).result == "shown"
    assert benefit_of(np.nan, np.ones(10)).result == "none"
    assert benefit_of(1.0, np.full(4, 9.0)) is None


@pytest.mark.parametrize(
    ("ratio", "most", "shown"),
    [
        (25.2, 3.2145, ("25", "3.21")),
        (3.2199, 3.2145, ("3.22", "3.21")),
        (3.2149, 3.2141, ("3.215", "3.214")),
        (2.0, 2.0, ("2", "2")),
    ],
)
def test_ratio_above_limit_is_printed_with_enough_digits(ratio, most, shown):
    words = Claim("test", 1, ratio, (0.0, most), "overconfident").words(number)
    assert words == "overconfident (error {} times the claimed σ; at most {} for a calibrated σ)".format(*shown)


WRONG, BEYOND = "the measurements are inconsistent", {"E": "E is beyond"}


@pytest.mark.parametrize(
    ("decision", "withheld", "message", "code"),
    [
        (Decision(), "", "", 0),
        (Decision(accept=True), "", "", 0),
        (Decision(WRONG), f"σ is withheld: {WRONG}", f"σ is withheld: {WRONG}", 3),
        (Decision(WRONG, accept=True), "", f"accepted: {WRONG}", 0),
        (
            Decision(WRONG, "", False, ("no load",), BEYOND, "widen"),
            f"σ is withheld: {WRONG}; E is beyond",
            None,
            3,
        ),
        (
            Decision("", "", False, ("no load", ""), BEYOND, "widen"),
            "σ is withheld: no load; E is beyond: widen",
            None,
            0,
        ),
    ],
)
def test_decision_withholds_sigma_and_sets_the_exit_code(decision, withheld, message, code):
    assert decision.withheld == withheld
    assert decision.message == (withheld if message is None else message)
    assert decision.exit_code == exit_code_in(decision.numbers) == code
    assert decision.numbers.get("withheld", "") == withheld
