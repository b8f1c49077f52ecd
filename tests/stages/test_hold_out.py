"""Factor on σ at positions without gauges, from the hold-out test."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.estimation.decision import check_ratio
from strainsight.experiment.hold_out import LeftOut, applied_factor, field_factor, field_in_words
from strainsight.records.estimated import HoldOut


def rows(*ratios, draws=50):
    """Hold-out results with these errors over σ; NaN: not evaluated."""
    claims = [None if np.isnan(ratio) else check_ratio(ratio, draws) for ratio in ratios]
    return tuple(LeftOut(f"G{i}", 1.0, ratio, 1.0, claim) for i, (ratio, claim) in enumerate(zip(ratios, claims, strict=True)))


@pytest.mark.parametrize(
    ("ratios", "factor"),
    [
        ((), 1.0),
        ((np.nan,), 1.0),
        ((0.5, 1.0, 1.05), 1.0),
        # one channel is overconfident, but all together are not
        ((0.2, 0.2, 1.6), 1.0),
        ((1.0, 2.0, np.nan), np.sqrt(2.5)),
        ((0.1, 4.0, 6.0), np.sqrt(52.01 / 3)),
    ],
)
def test_field_factor_is_the_rms_of_error_over_sigma_of_overconfident_channels(ratios, factor):
    assert field_factor(rows(*ratios)) == pytest.approx(factor, rel=1e-12)


def test_few_independent_errors_leave_sigma():
    """1.2σ is chance for one draw per channel, and is not for fifty."""
    assert field_factor(rows(1.2, 1.2, draws=1)) == 1.0
    assert field_factor(rows(1.4, 1.4)) == pytest.approx(1.4)


@pytest.mark.parametrize(
    ("factors", "applied", "words"),
    [((1.0,), 1.0, ""), ((None,), 1.0, ""), ((1.5, 2.5), 2.5, "multiplied by 1.5"), ((4.0, 1.0), np.nan, "withheld")],
)
def test_largest_factor_of_all_records_is_applied_and_above_three_sigma_is_withheld(factors, applied, words):
    each = [HoldOut(predicted=np.zeros(0), std=np.zeros(0), left_in=(), field_factor=factor) for factor in factors]
    assert applied_factor([None, *each]) == pytest.approx(applied, nan_ok=True)
    assert words in "".join(field_in_words(each[0]))
    assert bool(words) == bool(field_in_words(each[0]))
    assert field_in_words(None) == []
