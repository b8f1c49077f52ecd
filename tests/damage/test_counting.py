"""Rainflow: the standard's example, another implementation, and what no history may change."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
import rainflow as other

from strainsight.damage.counting import rainflow


def by_range(cycles):
    counts = Counter()
    for size, _, count in cycles:
        counts[size] += count
    return dict(sorted(counts.items()))


def in_order(cycles):
    cycles = np.asarray(cycles, dtype=float)
    return cycles[np.lexsort(cycles.T)]


def test_the_example_of_the_standard():
    """ASTM E1049-85, figure 6 (X1): −2 1 −3 5 −1 3 −4 4 −2."""
    cycles = rainflow(np.array([-2.0, 1, -3, 5, -1, 3, -4, 4, -2]))
    assert by_range(cycles) == {3: 0.5, 4: 1.5, 6: 0.5, 8: 1.0, 9: 0.5}
    assert cycles.tolist()[2] == [4.0, 1.0, 1.0]


@pytest.mark.parametrize("levels", [None, 3, 12])
def test_counts_are_those_of_another_implementation(levels):
    """Of noise, and of noise rounded to few levels, which has plateaus and equal ranges."""
    rng = np.random.default_rng(3)
    for steps in (5, 40, 2000):
        signal = rng.standard_normal(steps)
        if levels is not None:
            signal = np.round(signal * levels / 4)
        theirs = [(size, mean, count) for size, mean, count, _, _ in other.extract_cycles(signal)]
        np.testing.assert_allclose(in_order(rainflow(signal)), in_order(theirs), rtol=0, atol=1e-12)


def test_every_reversal_but_one_is_in_half_a_cycle():
    rng = np.random.default_rng(4)
    signal = rng.standard_normal(501)
    turns = 1 + np.count_nonzero(np.diff(np.sign(np.diff(signal)))) + 1
    assert 2 * rainflow(signal)[:, 2].sum() == turns - 1


def test_time_turned_round_has_the_same_cycles_where_the_largest_range_is_at_the_ends():
    """What is left over is then one range either way."""
    rng = np.random.default_rng(5)
    signal = np.concatenate([[-9.0], rng.uniform(-1, 1, 300), [9.0]])
    np.testing.assert_allclose(in_order(rainflow(signal[::-1])), in_order(rainflow(signal)), atol=1e-12)


def test_time_turned_round_changes_no_more_than_half_cycles():
    rng = np.random.default_rng(6)
    signal = rng.standard_normal(400)
    one, other_way = (by_range(np.round(rainflow(own), 9)) for own in (signal, signal[::-1]))
    left = sum(abs(one.get(size, 0) - other_way.get(size, 0)) for size in {*one, *other_way})
    halves = np.count_nonzero(rainflow(signal)[:, 2] == 0.5)
    assert left <= halves


def test_constant_and_monotone_signals():
    assert len(rainflow(np.full(9, 3.0))) == 0
    assert len(rainflow(np.zeros(1))) == 0
    assert rainflow(np.linspace(0, 5, 50)).tolist() == [[5.0, 2.5, 0.5]]


def test_a_signal_with_nan_is_refused():
    with pytest.raises(ValueError, match="NaN"):
        rainflow(np.array([0.0, np.nan, 1.0]))
