"""Sweeps on two Dask workers: the same bits, whatever dies; and addresses that are none, refused within seconds."""

from __future__ import annotations

import http.server
import os
import signal
import sys
import threading
import time

import numpy as np
import pytest
import sweep_tasks as tasks

from strainsight.contrib import dask_cluster as module
from strainsight.errors import ConfigError, StrainsightError, UserError
from strainsight.parallel import serial, watched
from strainsight.runner.sweep_location import Where, opened

pytest.importorskip("distributed")
MATRIX = np.random.default_rng(0).standard_normal((200, 300))
HERE = module.versions()


def test_two_workers_find_the_same_bits_in_the_same_order(cluster):
    points, shares = list(range(20)), []
    with opened(Where(dask=cluster.address)) as sweep:
        found = watched(sweep, shares.append)(tasks.product, points, MATRIX)
        where = sweep(tasks.process, points, None)
        assert sweep(tasks.product, [], MATRIX) == []
    assert np.array_equal(found, serial(tasks.product, points, MATRIX))
    assert set(where) == {worker.pid for worker in cluster.workers}
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_warnings_and_errors_come_back(cluster):
    with opened(Where(dask=cluster.address)) as sweep:
        with pytest.warns(UserWarning, match="beware of 2"):
            assert sweep(tasks.warned, list(range(4)), "beware of") == [0, 1, 2, 3]
        with pytest.raises(ConfigError, match="three is too many") as failed:
            sweep(tasks.refused, list(range(6)), None)
        assert (failed.value.key, failed.value.remedy) == ("validate.repeats", "take two")
        assert sweep(tasks.warned, [0, 1], "") == [0, 1]  # and the cluster goes on


@pytest.mark.slow
def test_a_worker_killed_in_the_middle_loses_nothing(doomed, monkeypatch):
    monkeypatch.setattr(module, "DESERTED", 1.0)
    points, victim = list(range(16)), doomed.workers[0]

    def kill(share: float) -> None:
        if share > 0.3 and victim.poll() is None:
            victim.kill()
            victim.wait()

    with opened(Where(dask=doomed.address)) as sweep:
        found = sweep(tasks.slow_product, points, MATRIX, kill)
        assert set(sweep(tasks.process, points, None)) == {doomed.workers[1].pid}
        doomed.workers[1].kill()
        with pytest.raises(UserError, match="no worker for 1 s"):
            sweep(tasks.product, points, MATRIX)
    assert victim.poll() is not None
    assert np.array_equal(found, serial(tasks.product, points, MATRIX))


@pytest.mark.slow
def test_a_task_that_ends_one_worker_after_the_other_ends_the_sweep(doomed):
    with (
        opened(Where(dask=doomed.address)) as sweep,
        pytest.raises(StrainsightError, match="killed by the same task") as end,
    ):
        sweep(tasks.deadly, [0], os.getpid())
    assert "--memory-limit" in str(end.value)


@pytest.mark.slow
def test_a_scheduler_that_goes(doomed):
    with opened(Where(dask=doomed.address)) as sweep, pytest.raises(UserError, match="the connection to the Dask "
    "scheduler was lost"):
        sweep(tasks.slow_product, list(range(40)), MATRIX, lambda share: doomed.scheduler.kill())


def refusal(address: str) -> str:
    start = time.monotonic()
    with pytest.raises(UserError) as failed, opened(Where(dask=address)):
        raise AssertionError("connected")
    assert time.monotonic() - start < 15
    return str(failed.value)


@pytest.mark.parametrize(
    "address", ["127.0.0.1:1", "nonsense", "host:port", "", "http://127.0.0.1:80", "tls://127.0.0.1:1"]
)
def test_no_scheduler_there(address):
    said = refusal(address)
    assert f"--dask: no Dask scheduler at {address}" in said
    assert "dask scheduler" in said.splitlines()[1]


def test_something_else_answers(monkeypatch):
    monkeypatch.setattr(module, "PATIENCE", 1.0)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), http.server.BaseHTTPRequestHandler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        assert "no Dask scheduler at" in refusal(f"127.0.0.1:{server.server_port}")
        server.shutdown()


def test_another_version_is_refused_before_anything_is_computed(cluster, monkeypatch):
    monkeypatch.setattr(module, "versions", lambda: HERE | {"numpy": "0.1"})
    said = refusal(cluster.address)
    assert f"numpy {np.__version__} (0.1 on this computer)" in said
    assert "same versions" in said


def test_a_worker_of_the_same_version_and_other_sources_is_refused(cluster, monkeypatch):
    with opened(Where(dask=cluster.address)) as sweep:
        monkeypatch.setattr(module, "sources", lambda: "0" * 16)
        with pytest.raises(UserError, match=r"worker .* has a different installation: checksum of the source code "
        r"of strainsight .* \(0+ on this computer\)"):
            sweep(tasks.product, [1], MATRIX)


@pytest.mark.slow
def test_a_scheduler_that_stands_still_is_named_after_the_stated_time(doomed, monkeypatch):
    monkeypatch.setattr(module, "SILENT", 2.0)
    began = time.monotonic()
    with opened(Where(dask=doomed.address)) as sweep, pytest.raises(UserError, match="has not answered for 2 s"):
        sweep(tasks.slow_product, list(range(40)), MATRIX, lambda share: doomed.scheduler.send_signal(signal.SIGSTOP))
    assert time.monotonic() - began < 60.0


@pytest.mark.slow
def test_a_worker_that_stands_still_is_named_after_the_stated_time(doomed, monkeypatch):
    monkeypatch.setattr(module, "FROZEN", 3.0)
    monkeypatch.setattr(module, "ANSWER", 3.0)
    began = time.monotonic()

    def stop(share: float) -> None:
        for worker in doomed.workers:
            worker.send_signal(signal.SIGSTOP)

    with opened(Where(dask=doomed.address)) as sweep, pytest.raises(UserError, match=r"worker tcp.* not answered for 3 s"):
        sweep(tasks.slow_product, list(range(40)), MATRIX, stop)
    with pytest.raises(UserError, match=r"a worker of the .* not answered for 3 s"), opened(Where(dask=doomed.address)):
        pass
    assert time.monotonic() - began < 60.0


@pytest.mark.slow
def test_a_worker_that_computes_for_long_is_waited_for(cluster, monkeypatch):
    monkeypatch.setattr(module, "FROZEN", 3.0)
    with opened(Where(dask=cluster.address)) as sweep:
        assert sweep(tasks.longer, [7.0], None) == [7.0]


@pytest.mark.slow
def test_distributed_is_not_installed(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert "pip install 'strainsight[dask]'" in refusal("127.0.0.1:8786")
