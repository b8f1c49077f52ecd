"""The consistency measures on samples whose statistics are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.distance import mahalanobis
from scipy.stats import chi2

from strainsight.estimation.consistency import nees, nis, verdict, whiteness, whiteness_band
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
        (1, 1, "as large as the noise you stated and independent"),
        (1, 1 / 9, "2.6 times larger than the noise you stated: check channels, known loads and the model"),
        (9, 9, "3.0 times smaller than the noise you stated: lower noise_std or process_noise"),
        (1 / 100, 1, "resembles the one before"),
        (1 / 100, 1, "; check channels, known loads and the model"),
        (1, 9, "; lower noise_std"),
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
    assert "raise" not in found.text
    assert found.consistent == (process == noise == 1)
    assert verdict(run.whitened[:, 0]).text == found.text


def test_a_verdict_on_a_record_of_zeros_says_what_is_missing():
    found = verdict(np.zeros((100, 2)))
    assert (found.ratio, found.correlation, found.consistent) == (0.0, 0.0, False)
    assert "all innovations are zero, as of channels that are not connected" in found.text


def test_a_verdict_on_coloured_innovations_of_the_right_size():
    white = np.random.default_rng(3).standard_normal((4000, 5))
    opposed = (white[1:] - 0.5 * white[:-1]) / np.sqrt(1.25)
    assert (
        "each undoes the one before (correlation -0.39): the filter overreacts; check channels, known loads and the model"
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
    low, high = np.sqrt(chi2.ppf([0.00135, 0.99865], 160_000) / 160_000)
    assert not (low < found.ratio < high) or abs(found.correlation) > found.chance
    assert found.consistent
    assert not verdict(innovations(size**1.5, 1.5 * correlation)).consistent
