"""The lazy order is the whole stable order, whatever ties and infinities there are."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.ordering import TIE, ascending_ties, index_of_largest, tied_order


@pytest.mark.parametrize("count", [1, 64, 1000])
def test_order_is_that_of_a_stable_sort(count):
    rng = np.random.default_rng(count)
    for values in (
        np.linspace(1.0, 2.0, count)[rng.permutation(count)],
        rng.integers(0, 5, count).astype(float),
        np.where(rng.random(count) < 0.5, np.inf, rng.integers(0, 1000, count)),
        np.zeros(count),
        np.full(count, np.inf),
    ):
        assert list(ascending_ties(values)) == np.argsort(values, kind="stable").tolist()


def test_rounding_does_not_order_what_is_equal():
    rng = np.random.default_rng(0)
    values = np.array([3.0, 1.0, 2.0, 1.0, -np.inf, 3.0, np.inf, 1.0, 0.0, np.inf, -np.inf])
    wanted = [4, 10, 8, 1, 3, 7, 2, 0, 5, 6, 9]
    for _ in range(20):
        shaken = values * (1 + 1e-13 * rng.standard_normal(len(values)))
        assert tied_order(shaken).tolist() == wanted
        assert index_of_largest(shaken[:4]) == 0
    many = np.repeat(rng.random(500), 4)
    assert (
        list(ascending_ties(many * (1 + 1e-13 * rng.standard_normal(2000)))) == np.argsort(many, kind="stable").tolist()
    )


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("values", "place"), [([1.0, np.inf, np.inf], 1), ([-np.inf, -1.0], 1), ([-np.inf, -np.inf], 0), ([np.inf], 0)]
)
def test_an_infinity_is_the_largest_and_a_tie_with_others(values, place):
    assert index_of_largest(np.array(values)) == place


def test_near_zero_the_larger_numbers_tell_what_is_rounding():
    values = np.array([1e-17, 0.5, -2e-17, 0.0, 1e-3])
    assert tied_order(values).tolist() == [2, 3, 0, 4, 1]
    assert tied_order(values, 1e-12).tolist() == [0, 2, 3, 4, 1]


def test_zero_may_be_the_largest():
    assert index_of_largest(np.array([-1.0, 0.0, -2.0, 0.0])) == 1
    assert index_of_largest(np.array([-np.inf, -np.inf, 0.0])) == 2


def test_what_comes_first_is_worse_than_the_best_by_a_tie_at_most():
    values = 1 + 0.4 * TIE * np.arange(1000)[::-1]
    order = values[tied_order(values)]
    assert np.all(order <= np.minimum.accumulate(order[::-1])[::-1] * (1 + TIE))
    assert order[0] > values.min()
    assert values[index_of_largest(values)] >= values.max() * (1 - TIE)


@pytest.mark.parametrize("least", [0.0, 1e-3])
def test_numbers_one_by_one_come_in_the_same_order(least):
    rng = np.random.default_rng(3)
    near = rng.random(50)[rng.integers(0, 50, 400)] * (1 + 3 * TIE * rng.random(400))
    for values in (near, -near, near - 0.5):
        assert list(ascending_ties(values, least)) == tied_order(values, least).tolist()
