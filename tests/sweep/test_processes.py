"""Sweeps in this process and in several: the same bits, nothing lost, and no more processes than there is memory for."""

from __future__ import annotations

import os
import warnings

import numpy as np
import pytest
import sweep_tasks as tasks

from strainsight.errors import ConfigError
from strainsight.sweep import processes
from strainsight.sweep.sweep import serial, watched
from strainsight.sweep.where import Where, opened

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
    monkeypatch.setattr(processes, "WORTH", 5.0)
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
