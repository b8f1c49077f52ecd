"""What gauges tell of the states, as a sum and as a factor: the same matrix by either way."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.placement.information import CANCELLED, Information, as_information, information


@pytest.mark.parametrize("count", [1, 4, 5, 30])
def test_the_factor_is_no_larger_than_the_states_and_its_square_is_the_sum(count):
    rows = np.random.default_rng(count).normal(size=(count, 4))
    known = information(rows)
    assert known.factor.shape == (min(count, 4), 4)
    np.testing.assert_allclose(known.factor.T @ known.factor, sum(np.outer(h, h) for h in rows), atol=1e-13 * count)
    np.testing.assert_allclose(known.G, sum(np.outer(h, h) for h in rows), atol=1e-13 * count)
    d, block = np.array([1.0, 10, 0.1, 3]), np.array([[1.0, 2, 3, 4], [0, 0, 1, 0]])
    for changed, truth in ((known.scaled(d), rows * d), (known.with_rows(block), np.vstack([rows, block]))):
        np.testing.assert_allclose(changed.G, truth.T @ truth, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(changed.factor.T @ changed.factor, truth.T @ truth, rtol=1e-12, atol=1e-12)


def test_a_sum_alone_has_no_factor():
    alone = as_information(np.eye(3))
    assert as_information(alone) is alone
    block = np.ones((1, 3))
    for known in (alone, alone.scaled(np.ones(3)), alone.with_rows(block)):
        assert known.factor is None
        assert known.needed(np.eye(3)) is None
    np.testing.assert_array_equal(alone.with_rows(block).G, np.eye(3) + 1)
    np.testing.assert_array_equal(alone.squared(2 * np.eye(3)), 4 * np.eye(3))


@pytest.mark.parametrize("beyond", [False, True])
def test_the_factor_is_needed_where_the_diagonals_are_so_many_times_the_trace(beyond):
    """One gauge that reads x + y, and what is known of the two is their sum: Σ PᵢᵢGᵢᵢ = 2 and tr(P G) = 2(1 − c)."""
    ratio = CANCELLED * (1.001 if beyond else 0.999)
    P = np.array([[1.0, 1 / ratio - 1], [1 / ratio - 1, 1.0]])
    known = information(np.ones((1, 2)))
    assert np.diag(P) @ np.diag(known.G) == pytest.approx(ratio * np.trace(P @ known.G))
    assert (known.needed(P) is not None) == beyond
    np.testing.assert_allclose(known.squared(P), P @ np.ones((2, 2)) @ P, rtol=1e-12)


def test_the_factor_keeps_digits_that_the_sum_has_lost():
    """A gauge of precision 1e-9 reads x + y: P h is 1e-9 of P, and P hhᵀ P of it 1e-18, beyond any sum of doubles."""
    rows, e = np.array([[1.0, 1.0], [1e-5, 0.0]]) * 1e9, 1e-9
    P = np.array([[1.0, -1 + e], [-1 + e, 1.0]])
    Ph = (P @ rows.T).T
    truth = sum(np.outer(v, v) for v in Ph)
    np.testing.assert_allclose(information(rows).squared(P), truth, rtol=1e-6)
    assert isinstance(information(rows), Information)
