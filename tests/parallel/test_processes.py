"""Sweeps in this process, in several and in threads: the same bits, nothing lost, as many at a time as are asked for."""

from __future__ import annotations

import os
import threading
import warnings

import numpy as np
import pytest
import sweep_tasks as tasks

from strainsight import parallel
from strainsight.errors import ConfigError
from strainsight.parallel import in_threads, mapped, serial, side_by_side, threads, watched
from strainsight.runner.sweep_location import Where, opened

pytestmark = pytest.mark.usefixtures("eager")
MATRIX = np.random.default_rng(0).standard_normal((200, 300))


def test_two_processes_find_the_same_bits_in_the_same_order():
    points = list(range(9))
    alone = serial(tasks.product, points, MATRIX)
    with opened(Where(2)) as sweep:
        assert np.array_equal(sweep(tasks.product, points, MATRIX), alone)
        assert os.getpid() not in sweep(tasks.process, points, None)[1:]
    with opened(Where(1)) as sweep:
        assert set(sweep(tasks.process, points, None)) == {os.getpid()}


def test_little_work_stays_here(monkeypatch):
    monkeypatch.setattr(parallel, "WORTH", 5.0)
    with opened(Where(2)) as sweep:
        assert set(sweep(tasks.process, list(range(5)), None)) == {os.getpid()}


def test_as_many_processes_as_the_memory_holds():
    with opened(Where(8), memory=lambda: 1e6) as sweep:
        assert set(sweep(tasks.process, list(range(5)), None)) == {os.getpid()}


@pytest.mark.parametrize("jobs", [1, 2])
def test_progress_comes_to_one(jobs):
    shares: list[float] = []
    with opened(Where(jobs)) as sweep:
        watched(sweep, shares.append)(tasks.product, list(range(4)), MATRIX)
    assert shares == [0.25, 0.5, 0.75, 1.0]


def test_a_warning_of_another_process_is_given_here():
    with opened(Where(2)) as sweep, warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        assert sweep(tasks.warned, list(range(4)), "beware of") == [0, 1, 2, 3]
    assert [str(warning.message) for warning in said] == ["beware of 2"]


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_keeps_its_place_and_remedy(jobs):
    with opened(Where(jobs)) as sweep, pytest.raises(ConfigError, match="three is too many") as failed:
        sweep(tasks.refused, list(range(6)), None)
    assert (failed.value.key, failed.value.remedy) == ("validate.repeats", "take two")


@pytest.mark.slow
def test_a_killed_process_loses_nothing(tmp_path):
    with opened(Where(2)) as sweep, pytest.warns(UserWarning, match=r"was killed.*--jobs 1"):
        found = sweep(tasks.killed_once, list(range(8)), str(tmp_path / "once"))
    assert found == [k**2 for k in range(8)]
    assert (tmp_path / "once").exists()


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
