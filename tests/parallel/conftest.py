"""A Dask cluster on loopback, as a user starts it: `dask scheduler` and two `dask worker`, processes of their own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
PATIENCE = 60.0
"""[s] for a process to come up: the machine may be busy."""


@dataclass(frozen=True)
class Cluster:
    """Address of the scheduler, its process and those of its workers."""

    address: str
    scheduler: subprocess.Popen[bytes]
    workers: tuple[subprocess.Popen[bytes], ...]


@contextmanager
def cluster_of(folder: Path) -> Iterator[Cluster]:
    """Torn down whatever happens. A task may end one worker, not two."""
    started: list[subprocess.Popen[bytes]] = []

    def start(name: str, *words: str) -> subprocess.Popen[bytes]:
        path = os.pathsep.join([str(HERE), *filter(None, [os.environ.get("PYTHONPATH")])])
        with (folder / f"{name}.log").open("wb") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "dask", *words],
                stdout=log,
                stderr=log,
                cwd=folder,
                env=os.environ | {"PYTHONPATH": path, "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1"},
                start_new_session=True,
            )
        started.append(process)
        return process

    def said(name: str, word: str) -> str:
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            for line in (folder / f"{name}.log").read_text(errors="replace").splitlines():
                if word in line:
                    return line
            time.sleep(0.05)
        raise AssertionError((folder / f"{name}.log").read_text(errors="replace"))

    try:
        quiet = ("--no-dashboard", "--dashboard-address", ":0")
        scheduler = start("scheduler", "scheduler", "--host", "127.0.0.1", "--port", "0", *quiet)
        address = said("scheduler", "Scheduler at:").split()[-1]
        own = tuple(
            start(f"worker{i}", "worker", address, "--host", "127.0.0.1", "--nthreads", "1", "--no-nanny", *quiet,
                  "--local-directory", str(folder / f"space{i}"))
            for i in range(2)
        )  # fmt: skip
        for i in range(2):
            said(f"worker{i}", "Registered to")
        yield Cluster(address, scheduler, own)
    finally:
        for process in reversed(started):
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory) -> Iterator[Cluster]:
    """Two workers that no test harms. Of one file: with nothing to do they and their scheduler take a tenth of a core."""
    with cluster_of(tmp_path_factory.mktemp("cluster")) as own:
        yield own


@pytest.fixture
def doomed(tmp_path) -> Iterator[Cluster]:
    with cluster_of(tmp_path) as own:
        yield own


@pytest.fixture
def eager(monkeypatch) -> None:
    """Other processes at once, however little there is to do."""
    from strainsight import parallel

    monkeypatch.setattr(parallel, "WORTH", 0.0)
