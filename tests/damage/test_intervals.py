"""Intervals of draws."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.damage.intervals import interval_of


@pytest.mark.parametrize("count", [40, 100, 333])
def test_it_holds_one_more_draw_in_95_of_100(count):
    """Of any distribution: here of a skew one with tails."""
    rng = np.random.default_rng(12)
    draws = np.exp(2 * rng.standard_normal((count + 1, 20_000)))
    found, truth = interval_of(draws[:-1]), draws[-1]
    inside = np.mean((found.low <= truth) & (truth <= found.high))
    assert inside == pytest.approx(0.95, abs=5 * np.sqrt(0.95 * 0.05 / 20_000))


def test_places_are_those_of_numpys_weibull_rule():
    draws = np.random.default_rng(13).standard_normal((97, 5))
    found = interval_of(draws)
    for own, q in ((found.median, 0.5), (found.low, 0.025), (found.high, 0.975)):
        np.testing.assert_allclose(own, np.quantile(draws, q, axis=0, method="weibull"), rtol=1e-12)


def test_infinite_draws_are_the_largest():
    draws = np.arange(100.0)[:, None] * np.ones(3)
    draws[99:, 0], draws[50:, 1], draws[:, 2] = np.inf, np.inf, np.inf
    found = interval_of(draws)
    assert found.high.tolist() == [pytest.approx(97.475), np.inf, np.inf]
    assert np.isfinite(found.median[0])
    assert np.isfinite(found.low[1])
    assert found.low[2] == np.inf


def test_too_few_draws_are_refused():
    with pytest.raises(ValueError, match="39 draws"):
        interval_of(np.zeros((39, 2)))
