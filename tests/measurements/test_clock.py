"""One uniform clock: gaps of whole steps are filled, everything else is refused at its place."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.measurements.clock import Clock, to_step, uniform_clock
from strainsight.measurements.records import Recording


def recording(time):
    time = np.asarray(time, float)
    return Recording(time, {}, {}, "test.csv", np.array([[0, 2]]))


@pytest.mark.parametrize("start", [0.0, -3.0, 1.7e9])
def test_a_clean_clock_is_found_as_it_is(start):
    clock = uniform_clock(recording(start + np.arange(5000) / 1024))
    assert clock.step == pytest.approx(1 / 1024, rel=1e-9)
    assert clock.start == pytest.approx(start, abs=1e-6)
    assert (clock.count, clock.notes) == (5000, ())


def test_printed_times_give_the_true_step():
    # 2048 Hz with six decimals: intervals of 488 and 489 µs, whose median is 0.06 % low, half a step after 850 samples.
    time = np.round(np.arange(200_000) / 2048, 6)
    clock = uniform_clock(recording(time))
    assert clock.step == pytest.approx(1 / 2048, rel=1e-9)
    assert clock.count == 200_000
    assert abs(clock.time - time).max() < 0.6e-6


def test_gaps_of_whole_steps_are_filled_and_reported():
    kept = np.r_[0:100, 112:300, 301:1000]
    rng = np.random.default_rng(0)
    clock = uniform_clock(recording(kept * 1e-3 + rng.uniform(-2e-5, 2e-5, kept.size)))
    np.testing.assert_array_equal(clock.row, kept)
    # A line through n stamps with errors s has a slope known to s √12 / n^1.5.
    assert clock.step == pytest.approx(1e-3, rel=4 * 0.0116 * np.sqrt(12) / 1000**1.5)
    assert [note[: note.index("put")] for note in clock.notes] == [
        "12 rows without samples were ",
        "1 row without samples was ",
    ]
    assert "test.csv:102" in clock.notes[0]
    spread = clock.spread(kept.astype(float))
    np.testing.assert_array_equal(spread[kept], kept)
    assert np.count_nonzero(np.isnan(spread)) == 13
    with pytest.raises(UserError, match=r"12 samples are missing after 0.09\d+ s, and more in 1 other places"):
        uniform_clock(recording(kept * 1e-3), fill=False)


def test_single_stamps_off_the_clock_are_corrected_with_a_note():
    time = 0.01 * np.arange(1000)
    time[[400, 700]] += [0.004, -0.003]
    clock = uniform_clock(recording(time))
    np.testing.assert_allclose(clock.time, 0.01 * np.arange(1000), atol=1e-9)
    assert clock.notes == (
        "the time 4.004 s (test.csv:402) is off the uniform clock: 4 s was taken",
        "the time 6.997 s (test.csv:702) is off the uniform clock: 7 s was taken",
    )


def test_stamps_that_are_all_inexact_are_refused_with_the_rate_as_remedy():
    time = 0.01 * np.arange(1000) + np.random.default_rng(0).uniform(-3e-3, 3e-3, 1000)
    with pytest.raises(UserError, match="the clock jumps") as caught:
        uniform_clock(recording(time))
    assert "time: {rate: 100, unit: Hz}" in caught.value.remedy


def test_many_gaps_are_reported_briefly():
    kept = np.flatnonzero(np.random.default_rng(3).random(100_000) > 0.1)
    kept = kept - kept[0]
    clock = uniform_clock(recording(kept * 1e-3))
    np.testing.assert_array_equal(clock.row, kept)
    assert len(clock.notes) == 11
    assert "other gaps" in clock.notes[-1]


def jump(at, size, count=1000, step=1e-3):
    time = np.arange(count) * step
    time[at:] += size
    return time


@pytest.mark.parametrize(
    ("time", "said", "line"),
    [
        (jump(400, 0.0104), r"jumps by 0.0114 s from 0.399 to 0.4104 s: 11.4 steps of 0.001 s", 402),
        (jump(400, -0.0005), r"jumps by 0.0005 s", 402),
        (jump(400, -0.0105), r"steps back by 0.0095 s, from 0.399 to 0.3895 s", 402),
        (jump(400, -0.001), r"0.399 s stands twice", 402),
        (jump(999, 1e6), r"would have 1e\+09 with its gaps filled", 1001),
        (jump(999, 1e12), r"3000 years off", 1001),
        (np.cumsum(np.r_[np.full(500, 1e-3), np.full(499, 1.3e-3)]), r"and so in many places", 502),
        (np.arange(1000)[::-1] * 1e-3, r"steps back.*the first of 999 places", 3),
        (np.zeros(1000), r"stands twice, the first of 999", 3),
        (np.arange(1000) * 1e-3 + 8e-5 * (np.arange(1000) == 700), r"is 7.99 % of a step off", 702),
        (np.geomspace(1e-300, 1e10, 1000), r"jumps|would have", None),
    ],
)
def test_faults_are_refused_at_their_place(time, said, line):
    with pytest.raises(UserError, match=said) as caught:
        uniform_clock(recording(time))
    if line:
        assert caught.value.where == f"test.csv:{line}"
    assert caught.value.remedy


def test_more_jitter_is_taken_where_it_is_allowed():
    time = np.arange(1000) * 1e-3 + 8e-5 * (np.arange(1000) == 700)
    assert uniform_clock(recording(time), jitter=0.1).count == 1000


def test_a_finer_step_leaves_rows_between_and_a_coarser_one_takes_every_kth():
    clock = Clock(2.0, 1e-3, 10, np.array([0, 1, 2, 4, 5, 7, 8, 9]))
    fine, taken, notes = to_step(clock, 0.25e-3)
    np.testing.assert_array_equal(taken, np.arange(8))
    np.testing.assert_allclose(fine.time[fine.row], clock.time[clock.row], rtol=1e-15)
    assert fine.count == 37
    assert "3 rows without samples stand between two samples" in notes[0]
    coarse, taken, notes = to_step(clock, 2e-3)
    np.testing.assert_allclose(coarse.time, [2, 2.002, 2.004, 2.006, 2.008])
    np.testing.assert_array_equal(coarse.row, [0, 1, 2, 4])
    np.testing.assert_allclose(coarse.time[coarse.row], clock.time[clock.row][taken])
    assert "content above 250 Hz folds back" in notes[0]
    same, taken, notes = to_step(clock, 1e-3)
    assert (same.count, notes, len(taken)) == (10, (), 8)


def test_six_digits_of_a_step_are_the_same_step():
    found, _, notes = to_step(Clock(0.0, 4.88281e-4, 10**6, np.arange(10**6)), 1 / 2048)
    assert found.step == 1 / 2048
    assert "0.51 ppm" in notes[0]


@pytest.mark.parametrize("step", [0.7e-3, 1.5e-3, 1.0002e-3, 0.0, -1.0, float("inf")])
def test_other_ratios_are_refused(step):
    with pytest.raises(UserError) as caught:
        to_step(Clock(0.0, 1e-3, 1000, np.arange(1000)), step)
    assert caught.value.remedy
