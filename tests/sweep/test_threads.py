"""Sweeps in threads: the same bits in the same order, as many at a time as are asked for."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from strainsight.sweep.sweep import serial
from strainsight.sweep.threads import in_threads, mapped, side_by_side
from strainsight.sweep.where import Where, opened, threads


def scaled(shared, point):
    return shared * point


def test_two_threads_find_the_same_bits_in_the_same_order():
    matrix, points, shares = np.random.default_rng(0).standard_normal((20, 30)), list(range(7)), []
    found = in_threads(lambda: 2)(scaled, points, matrix, shares.append)
    assert np.array_equal(found, serial(scaled, points, matrix))
    assert shares == pytest.approx(np.arange(1, 8) / 7)
    assert in_threads(lambda: 2)(scaled, [], matrix) == []


def test_two_at_a_time():
    both = threading.Barrier(2, timeout=30)
    assert in_threads(lambda: 2)(lambda shared, point: both.wait() is not None, range(4), None) == [True] * 4


def test_what_goes_wrong_in_one_is_raised():
    with pytest.raises(ZeroDivisionError):
        in_threads(lambda: 2)(lambda shared, point: shared / point, [1.0, 0, 2.0], 1)


def test_parts_take_the_threads_of_the_sweep_and_their_own_take_none():
    names = mapped(lambda part: threading.current_thread().name, range(4))
    assert set(names) == {threading.current_thread().name}
    with opened(Where(2)):
        assert threads() == 2
        assert threading.current_thread().name not in mapped(lambda part: threading.current_thread().name, range(4))
        assert mapped(lambda part: (part, threads()), range(4)) == [(0, 1), (1, 1), (2, 1), (3, 1)]


@pytest.mark.parametrize("jobs", [1, 2])
def test_two_functions_side_by_side(jobs):
    both = threading.Barrier(jobs, timeout=30)
    with opened(Where(jobs)):
        assert side_by_side(lambda: (both.wait(), 3)[1], lambda: (both.wait(), "b")[1]) == (3, "b")
        with pytest.raises(ZeroDivisionError):
            side_by_side(lambda: 1 / 0, lambda: [][1])
        with pytest.raises(IndexError):
            side_by_side(lambda: 1, lambda: [][1])
