"""Other rules, against their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import qr

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
    with pytest.raises(ConfigError, match="no candidate gauge responds"):
        effective_independence(np.zeros((5, 2)), 3)


def test_only_allowed_sets_are_drawn_and_fewer_where_they_are_rare():
    no_neighbours = random_sets(12, 3, 100, 5, lambda chosen: bool(np.diff(chosen).min() > 1))
    assert no_neighbours.shape == (100, 3)
    assert np.diff(no_neighbours, axis=1).min() > 1
    assert np.array_equal(random_sets(12, 3, 9, 5, lambda chosen: True), random_sets(12, 3, 9, 5))
    assert random_sets(12, 3, 4, 5, lambda chosen: False).shape == (0, 3)
    assert 0 < len(random_sets(40, 3, 10, 5, lambda chosen: chosen.tolist()[:2] == [0, 1])) < 10


def mixed(seed, k, *, singles=6, pairs=5, triples=5):
    """Units of one, two and three channels: blocks (units, 3, k) with rows of zeros, and the channels of each."""
    rng = np.random.default_rng(seed)
    blocks = np.zeros((singles + pairs + triples, 3, k))
    for i, size in enumerate([1] * singles + [2] * pairs + [3] * triples):
        blocks[i, :size] = rng.normal(size=(size, k))
    return blocks, [block[block.any(axis=1)] for block in blocks]


def test_efi_removes_the_block_of_the_smallest_trace_of_its_hat_block():
    blocks, channels = mixed(5, 4)
    left = list(range(len(blocks)))
    while len(left) > 5:
        hat = np.linalg.inv(sum(channels[g].T @ channels[g] for g in left))
        leverage = [np.trace(channels[g] @ hat @ channels[g].T) for g in left]
        assert (
            np.linalg.matrix_rank(np.vstack([channels[g] for i, g in enumerate(left) if i != np.argmin(leverage)])) == 4
        )
        left.pop(int(np.argmin(leverage)))
    assert effective_independence(blocks, 5).tolist() == left


def test_efi_keeps_a_single_gauge_that_alone_sees_a_mode():
    # its leverage is 1, that of each of the three rosettes 5/3
    blocks = np.zeros((4, 3, 6))
    blocks[0, 0, 0] = 1.0
    blocks[1:, :, 1:] = np.random.default_rng(0).normal(size=(3, 3, 5))
    blocks[1:, :, 1:] /= np.linalg.norm(blocks[1:, :, 1:], axis=2, keepdims=True)
    assert 0 in effective_independence(blocks, 3)


def test_qr_takes_units_in_the_order_of_their_first_pivot():
    blocks, _ = mixed(2, 7)
    blocks[-5:] *= 3
    rest, taken = blocks.reshape(-1, 7).copy(), []
    for _ in range(7):
        best = int(np.argmax(np.linalg.norm(rest, axis=1)))
        if best // 3 not in taken:
            taken.append(best // 3)
        unit = rest[best] / np.linalg.norm(rest[best])
        rest = rest - np.outer(rest @ unit, unit)
    assert 3 < len(taken) < 7
    for keep in (3, len(taken)):
        assert qr_pivoting(blocks, keep).tolist() == sorted(taken[:keep])
    assert len(set(qr_pivoting(blocks, 12).tolist())) == 12


def test_d_optimal_adds_blocks_by_the_determinant():
    blocks, channels = mixed(8, 5)
    rng = np.random.default_rng(8)
    noise = rng.uniform(0.5, 2, blocks.shape[:2])
    root = rng.normal(size=(5, 5))
    prior = root @ root.T + 0.1 * np.eye(5)
    information, taken = np.linalg.inv(prior), []
    added = [(h.T / r[: len(h)]) @ h for h, r in zip(channels, noise, strict=True)]
    for _ in range(6):
        gain = [-np.inf if g in taken else np.linalg.slogdet(information + added[g])[1] for g in range(len(added))]
        taken.append(int(np.argmax(gain)))
        information += added[taken[-1]]
    assert d_optimal(blocks, noise, prior, 6).tolist() == sorted(taken)


@pytest.mark.parametrize("unit", [1e-3, 0.1, 1.0])
@pytest.mark.parametrize("seed", range(4))
def test_d_optimal_where_the_prior_is_about_as_sharp_as_a_gauge(seed, unit):
    """There the 1 of the update counts; by the definition, without the update."""
    rng = np.random.default_rng(seed)
    rows, prior = rng.normal(size=(15, 4)), unit * np.diag(rng.uniform(0.2, 2, 4))
    taken = []
    for _ in range(7):
        gain = {g: np.linalg.slogdet(np.eye(4) + prior @ rows[[*taken, g]].T @ rows[[*taken, g]])[1] for g in range(15)}
        taken.append(max(set(range(15)) - set(taken), key=gain.get))
    assert d_optimal(rows, np.ones(15), prior, 7).tolist() == sorted(taken)


def test_efi_uses_as_many_modes_as_any_gauges_left_have_channels():
    rosettes = np.random.default_rng(6).normal(size=(9, 3, 8))
    rosettes[:2, 2] = 0.0
    # a motion that no gauge sees
    rosettes[:, :, 6] = 0.0
    left = list(range(9))
    while len(left) > 2:
        hat = np.linalg.inv(sum(rosettes[g, :, :4].T @ rosettes[g, :, :4] for g in left))
        leverage = [np.trace(rosettes[g, :, :4] @ hat @ rosettes[g, :, :4].T) for g in left]
        left.pop(int(np.argmin(leverage)))
    assert effective_independence(rosettes, 2).tolist() == left


RULES = {
    "random": lambda keep: random_sets(5, keep, 1, 0)[0],
    "EFI": lambda keep: effective_independence(np.vander(np.arange(1.0, 6.0), 3), keep),
    "QR": lambda keep: qr_pivoting(np.vander(np.arange(1.0, 6.0), 3), keep),
    "D-optimal": lambda keep: d_optimal(np.vander(np.arange(1.0, 6.0), 3), np.ones(5), np.eye(3), keep),
}


@pytest.mark.parametrize("rule", RULES)
def test_an_impossible_count_is_refused_and_the_whole_pool_is_none(rule):
    for keep in (0, 6):
        with pytest.raises(ConfigError, match="of the 5 candidate gauges"):
            RULES[rule](keep)
    assert RULES[rule](5).tolist() == list(range(5))
    assert len(RULES[rule](1)) == 1


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_qr_takes_what_is_independent_in_any_unit(unit):
    """Two motions, and a third that shows in one gauge by 1e-5; beyond these the pivots of LAPACK are rounding."""
    rng = np.random.default_rng(9)
    rows = rng.normal(size=(12, 2)) @ rng.normal(size=(2, 5))
    rows[3] = 0.0
    first = qr(rows.T, mode="r", pivoting=True)[1][:2].tolist()
    odd = next(g for g in range(12) if g not in (3, *first))
    rows[odd] += 1e-5 * np.linalg.norm(rows[odd]) * rng.normal(size=5)
    left = np.setdiff1d(np.arange(12), [*first, odd])
    second = left[qr(rows[left].T, mode="r", pivoting=True)[1][:2]].tolist()
    for keep in range(1, 6):
        assert qr_pivoting(unit * rows, keep).tolist() == sorted([*first, odd, *second][:keep])


def test_gains_of_rounding_are_ties_of_the_d_optimal_set():
    for seed in range(3):
        rows = 1e-9 * np.random.default_rng(seed).standard_normal((8, 3))
        rows[[5, 6, 7]] = np.eye(3)
        assert d_optimal(rows, np.ones(8), np.eye(3), 5).tolist() == [0, 1, 5, 6, 7]
