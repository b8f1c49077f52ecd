"""Screening keeps the strongest signals that are not too near to one another."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import InfeasibleError
from strainsight.gauges.screening import screen, strongest_first


def on_a_line(x) -> np.ndarray:
    return np.column_stack([x, np.zeros(len(x)), np.zeros(len(x))])


def test_the_strongest_signals_are_kept_and_the_others_say_why():
    result = screen(np.array([1.0, 5.0, 3.0, 4.0]), 0.5, on_a_line([0.0, 1.0, 2.0, 3.0]), 2, 0.0)
    np.testing.assert_array_equal(result.kept, [1, 3])
    np.testing.assert_array_equal(result.snr, [2.0, 10.0, 6.0, 8.0])
    np.testing.assert_array_equal(result.reason, ["snr", "", "snr", ""])


def test_a_cluster_is_thinned_to_its_strongest():
    result = screen(np.array([3.0, 5.0, 4.0, 1.0]), 1.0, on_a_line([0.0, 0.1, 0.2, 5.0]), 2, 0.15)
    np.testing.assert_array_equal(result.kept, [1, 3])
    np.testing.assert_array_equal(result.reason, ["spacing", "", "spacing", ""])


def test_one_that_is_crowded_out_crowds_out_nobody():
    """1 is dropped beside 0; 2 is near to 1 only, and stays."""
    result = screen(np.array([3.0, 2.0, 1.0]), 1.0, on_a_line([0.0, 0.1, 0.2]), None, 0.15)
    np.testing.assert_array_equal(result.kept, [0, 2])


def test_gauges_exactly_the_spacing_apart_both_stay():
    result = screen(np.ones(11), 1.0, on_a_line(0.1 * np.arange(11)), None, 0.1)
    assert len(result.kept) == 11


def test_ties_go_to_the_lower_index_also_when_rounding_splits_them():
    rms = 1e-5 * (1 + 1e-13 * np.array([0.0, 3.0, 1.0, 2.0]))
    result = screen(rms, 1e-7, on_a_line([0.0, 1.0, 2.0, 3.0]), 2, 0.0)
    np.testing.assert_array_equal(result.kept, [0, 1])


def test_a_tie_is_a_share_of_the_strongest_and_counts_from_the_stronger():
    """Signals fall by 0.6 ties each: the second is a tie with the first, the third is not."""
    rms = 1 - 0.6e-8 * np.array([1.0, 0.0, 2.0, 3.0])
    np.testing.assert_array_equal(strongest_first(rms), [0, 1, 2, 3])
    np.testing.assert_array_equal(strongest_first(rms[[2, 0, 1, 3]]), [1, 2, 0, 3])
    weak = np.array([1e-3, 1e-3 + 0.9e-8, 1.0, 0.0])
    np.testing.assert_array_equal(strongest_first(weak), [2, 0, 1, 3])


def test_keeping_all_drops_by_spacing_only_and_nothing_without_one():
    rng = np.random.default_rng(0)
    rms, position = rng.uniform(0, 1, 300), rng.uniform(0, 1, (300, 3))
    result = screen(rms, 1e-3, position, None, 0.1)
    assert set(result.reason) == {"", "spacing"}
    assert len(screen(rms, 1e-3, position, None, 0.0).kept) == 300


@pytest.mark.parametrize("keep", [None, 40])
def test_the_kept_are_what_a_plain_double_loop_keeps(keep):
    rng = np.random.default_rng(1)
    rms, position = rng.uniform(0, 1, 400), rng.uniform(0, 1, (400, 3))
    kept: list[int] = []
    for i in sorted(range(400), key=lambda i: -rms[i]):
        apart = all(np.linalg.norm(position[i] - position[j]) >= 0.12 for j in kept)
        if apart and (keep is None or len(kept) < keep):
            kept.append(i)
    result = screen(rms, 1e-3, position, keep, 0.12)
    np.testing.assert_array_equal(result.kept, sorted(kept))
    np.testing.assert_array_equal(np.flatnonzero(result.reason == ""), sorted(kept))


def test_every_candidate_dropped_for_its_spacing_is_near_to_a_stronger_one_that_was_kept():
    rng = np.random.default_rng(2)
    rms, position = rng.uniform(0, 1, 400), rng.uniform(0, 1, (400, 3))
    result = screen(rms, 1e-3, position, 40, 0.12)
    for i in np.flatnonzero(result.reason == "spacing"):
        distance = np.linalg.norm(position[result.kept] - position[i], axis=1)
        assert np.any((distance < 0.12) & (rms[result.kept] > rms[i]))
    weakest = rms[result.kept].min()
    assert np.all(rms[result.reason == "snr"] < weakest)


@pytest.mark.parametrize("scale", [1e-300, 1e300])
def test_units_do_not_matter(scale):
    rms = np.array([1.0, 5.0, 3.0, 0.0]) * scale
    np.testing.assert_array_equal(screen(rms, 1e-3 * scale, on_a_line(np.arange(4)), 2, 0.5).kept, [1, 2])


def test_silent_candidates_are_all_alike():
    np.testing.assert_array_equal(screen(np.zeros(3), 1.0, on_a_line(np.arange(3)), 2, 0.0).kept, [0, 1])


@pytest.mark.parametrize(("keep", "spacing", "kept"), [(4, 1.5, [0, 2, 4]), (6, 0.0, [0, 1, 2, 3, 4])])
def test_where_fewer_than_asked_for_are_left_all_of_them_are_kept(keep, spacing, kept):
    np.testing.assert_array_equal(screen(np.ones(5), 1.0, on_a_line(np.arange(5.0)), keep, spacing).kept, kept)


@pytest.mark.parametrize("noise", [0.0, -1.0, np.nan, np.inf])
def test_noise_must_be_positive(noise):
    with pytest.raises(InfeasibleError, match="gauge noise"):
        screen(np.ones(3), noise, on_a_line(np.arange(3.0)), 1, 0.0)


def test_a_response_that_is_not_finite_is_refused():
    with pytest.raises(InfeasibleError, match="1 candidates have no finite response"):
        screen(np.array([1.0, np.nan]), 1.0, on_a_line([0.0, 1.0]), 1, 0.0)


def test_keeping_none_is_refused():
    with pytest.raises(InfeasibleError, match="0 of 3"):
        screen(np.ones(3), 1.0, on_a_line(np.arange(3.0)), 0, 0.0)


def test_the_signal_of_a_gauge_is_that_of_its_channels_together():
    """√(3² + 4²) = 5 against a single gauge of 4.9; one channel alone would lose."""
    rms, noise = np.array([3.0, 8.0, 4.9]), np.array([1.0, 2.0, 1.0])
    result = screen(rms, noise, on_a_line([0.0, 0.0, 1.0]), 1, 0.0, gauge=np.array([0, 0, 1]))
    np.testing.assert_array_equal(result.kept, [0])
    np.testing.assert_allclose(result.snr, [5.0, 4.9])
    np.testing.assert_array_equal(result.reason, ["", "snr"])


def test_bonded_gauges_are_kept_first_and_crowd_out_the_others_but_not_one_another():
    result = screen(
        np.array([9.0, 1.0, 1.0, 5.0, 4.0]),
        1.0,
        on_a_line([0.0, 0.1, 0.15, 1.0, 2.0]),
        3,
        0.2,
        bonded=np.array([False, True, True, False, False]),
    )
    np.testing.assert_array_equal(result.kept, [1, 2, 3])
    np.testing.assert_array_equal(result.reason, ["spacing", "", "", "", "snr"])


def test_more_bonded_than_kept_is_refused_with_the_number():
    with pytest.raises(InfeasibleError, match="1 of 3 candidates to keep, 2 are already bonded") as caught:
        screen(np.ones(3), 1.0, on_a_line(np.arange(3)), 1, 0.0, bonded=np.array([True, True, False]))
    assert "at least 2" in caught.value.remedy


def test_a_gauge_with_a_channel_beyond_its_range_is_dropped_unless_it_is_bonded():
    gauge = np.array([0, 0, 1, 1, 2, 3])
    result = screen(
        np.array([5.0, 5.0, 4.0, 4.0, 3.0, 9.0]),
        1.0,
        on_a_line([0.0, 0.0, 0.1, 0.1, 0.2, 5.0]),
        None,
        0.15,
        gauge=gauge,
        bonded=gauge == 3,
        largest=np.array([7.0, 10.1, 10.0, 2.0, 99.0, 99.0]),
        limit=np.array([10.0, 10.0, 10.0, 10.0, np.inf, 10.0]),
    )
    # What is dropped for its range crowds out nobody.
    np.testing.assert_array_equal(result.reason, ["range", "", "spacing", ""])
    with pytest.raises(InfeasibleError, match="all 4 candidates read more than their range") as caught:
        screen(np.ones(4), 1.0, on_a_line(np.arange(4)), 3, 0.0, largest=np.array([2, 2, 3, 4]), limit=np.ones(4))
    assert caught.value.key == "gauges.range"


@pytest.mark.parametrize("keep", [None, 25])
def test_rosettes_and_single_gauges_are_kept_as_a_plain_loop_keeps_them(keep):
    rng = np.random.default_rng(3)
    sizes = rng.integers(1, 4, 150)
    gauge = np.repeat(np.arange(150), sizes)
    place = rng.uniform(0, 1, (150, 3))
    rms, noise = rng.uniform(0, 1, len(gauge)), rng.uniform(0.5, 2, len(gauge))
    largest, bonded = 3 * rms, np.isin(np.arange(150), [7, 80, 81])
    snr = [sum((rms[gauge == g] / noise[gauge == g]) ** 2) ** 0.5 for g in range(150)]
    over = [bool(np.any(largest[gauge == g] > 2.7)) and not bonded[g] for g in range(150)]
    kept: list[int] = []
    for g in sorted(range(150), key=lambda g: (not bonded[g], -snr[g])):
        apart = bonded[g] or all(np.linalg.norm(place[g] - place[j]) >= 0.15 for j in kept)
        if apart and not over[g] and (keep is None or len(kept) < keep):
            kept.append(g)
    result = screen(
        rms,
        noise,
        place[gauge],
        keep,
        0.15,
        gauge=gauge,
        bonded=bonded[gauge],
        largest=largest,
        limit=np.full(len(gauge), 2.7),
    )
    np.testing.assert_array_equal(result.kept, sorted(kept))
    np.testing.assert_allclose(result.snr, snr)
    np.testing.assert_array_equal(result.reason == "range", over)


def test_no_rounding_orders_equal_signals():
    """Pairs of equals of every size, each with its partner too near: of every pair the lower one stays."""
    rng = np.random.default_rng(2)
    strength, x = np.repeat(rng.uniform(0.1, 1.0, 2_000), 2), np.repeat(np.arange(2_000.0), 2)
    shaken = strength * (1 + 1e-13 * rng.standard_normal(len(strength)))
    np.testing.assert_array_equal(screen(shaken, 1.0, on_a_line(x), None, 0.5).kept, 2 * np.arange(2_000))


def test_each_load_case_takes_in_turn_the_strongest_that_is_free():
    """Readings of the second case are a hundredth of those of the first, whose three strongest sit in a cluster."""
    rms = np.array([[9.0, 8.0, 7.0, 4.0, 3.0, 0.1, 0.2, 0.0], [0.01, 0.0, 0.0, 0.0, 0.01, 0.04, 0.03, 0.09]])
    position = on_a_line([0.0, 0.1, 0.2, 1.0, 2.0, 3.0, 4.0, 5.0])
    result = screen(rms, 0.5, position, 4, 0.25)
    np.testing.assert_array_equal(result.kept, [0, 3, 5, 7])
    np.testing.assert_array_equal(result.reason, ["", "spacing", "spacing", "", "snr", "", "snr", ""])
    np.testing.assert_allclose(result.snr, [18.0, 16.0, 14.0, 8.0, 6.0, 0.2, 0.4, 0.18])
    np.testing.assert_array_equal(screen(rms * [[1.0], [1e6]], 0.5, position, 4, 0.25).kept, result.kept)
    # what one case has no more of goes to the other
    assert len(screen(rms, 0.5, position, None, 0.25).kept) == 6


@pytest.mark.parametrize("spacing", [0.0, 0.1])
def test_cases_that_are_alike_keep_what_one_keeps(spacing):
    rng = np.random.default_rng(1)
    rms, position = rng.uniform(0, 1, 200), rng.uniform(0, 1, (200, 3))
    one = screen(rms, 1e-3, position, 60, spacing)
    for cases in (rms[None], np.array([rms, rms]), np.array([rms, 1e-3 * rms, 5 * rms])):
        np.testing.assert_array_equal(screen(cases, 1e-3, position, 60, spacing).kept, one.kept)
