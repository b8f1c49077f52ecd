"""Other rules, against their definitions."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import ConfigError
from strainsight.placement.baselines import d_optimal, effective_independence, qr_pivoting, random_sets


def test_random_sets_are_seeded_distinct_and_cover_the_pool():
    sets = random_sets(20, 4, 200, seed=1)
    assert sets.shape == (200, 4)
    assert np.all(np.diff(sets, axis=1) > 0)
    assert np.array_equal(sets, random_sets(20, 4, 200, seed=1))
    assert not np.array_equal(sets, random_sets(20, 4, 200, seed=2))
    counts = np.bincount(sets.ravel(), minlength=20)
    assert counts.min() > 15
    assert counts.max() < 70


@pytest.mark.parametrize(("modes", "keep"), [(3, 5), (4, 4), (7, 4)])
def test_efi_removes_the_gauge_that_the_determinant_misses_least(modes, keep):
    rows = np.random.default_rng(modes).normal(size=(15, modes))
    used = rows[:, : min(modes, keep)]
    left = list(range(15))
    while len(left) > keep:
        without = [np.delete(used[left], i, axis=0) for i in range(len(left))]
        determinant = [np.linalg.det(other.T @ other) for other in without]
        left.pop(int(np.argmax(determinant)))
    assert effective_independence(rows, keep).tolist() == left


def test_efi_passes_over_modes_that_show_nothing_new():
    rows = np.random.default_rng(0).normal(size=(12, 3))
    more = np.column_stack([rows[:, 0], 2 * rows[:, 0], np.zeros(12), rows[:, 1]])
    assert effective_independence(more, 4).tolist() == effective_independence(rows[:, [0, 1]], 4).tolist()
    with pytest.raises(ConfigError, match="no gauge of the pool answers"):
        effective_independence(np.zeros((5, 2)), 3)


def test_qr_takes_the_row_that_is_least_explained():
    rows = np.random.default_rng(2).normal(size=(25, 6))
    rest, taken = rows.copy(), []
    for _ in range(4):
        best = int(np.argmax(np.linalg.norm(rest, axis=1)))
        taken.append(best)
        unit = rest[best] / np.linalg.norm(rest[best])
        rest = rest - np.outer(rest @ unit, unit)
    assert qr_pivoting(rows, 4).tolist() == sorted(taken)
    assert len(set(qr_pivoting(rows, 9).tolist())) == 9


def test_d_optimal_raises_the_determinant_most_at_every_step():
    rng = np.random.default_rng(3)
    rows, variance = rng.normal(size=(18, 5)), rng.uniform(0.5, 2, 18)
    root = rng.normal(size=(5, 5))
    prior = root @ root.T + 0.1 * np.eye(5)
    information, taken = np.linalg.inv(prior), []
    for _ in range(6):
        gain = [
            -np.inf if g in taken else np.linalg.slogdet(information + np.outer(rows[g], rows[g]) / variance[g])[1]
            for g in range(18)
        ]
        taken.append(int(np.argmax(gain)))
        information += np.outer(rows[taken[-1]], rows[taken[-1]]) / variance[taken[-1]]
    assert d_optimal(rows, variance, prior, 6).tolist() == sorted(taken)


@pytest.mark.parametrize("keep", [0, 6])
def test_an_impossible_count_is_refused(keep):
    for rule in (lambda: random_sets(5, keep, 1, 0), lambda: qr_pivoting(np.ones((5, 2)), keep)):
        with pytest.raises(ConfigError, match="out of a pool of 5"):
            rule()
