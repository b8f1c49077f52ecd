"""Long use of one process: memory stays where it is, and the last results are the first ones to the bit.

STRAINSIGHT_STEPS=10_000_000 STRAINSIGHT_PLACEMENTS=1000 pytest tests/robustness/test_soak.py, which is `make soak`: as many as
that; without them a share.
"""

from __future__ import annotations

import ctypes
import gc
import os
import re
import time
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from typer.testing import CliRunner

from strainsight import parallel
from strainsight.estimation.filter import run_filter
from strainsight.estimation.model import FilterModel
from strainsight.estimation.reduced import DrivenModel
from strainsight.estimation.run import FilterRun
from strainsight.runner.artefact import Artefact
from strainsight_cli.main import app

from ..estimation.conftest import make_beam, make_filter

STEPS = int(os.environ.get("STRAINSIGHT_STEPS", "40_000"))
PLACEMENTS = int(os.environ.get("STRAINSIGHT_PLACEMENTS", "12"))
BLOCK = 5_000
"""Steps of one call of the filter; the next goes on from its mean and covariance, as a stream is filtered."""
WARM = 1 / 3
"""Share of the whole after which nothing may be new to the process."""
ROOM = 1024
"""[KiB] that memory may grow by after that."""
MODES, GAUGES = 4, 4
WHOLE = 50
"""Every so many placements all other stages run as well, a bench's among them, two processes at a time; in a share none."""

pytestmark = pytest.mark.skipif(not Path("/proc/self/status").is_file(), reason="reads its memory in /proc")


@dataclass(frozen=True)
class Held:
    """What a process holds: memory [KiB], objects that Python tracks, open files, threads, children, shared memory."""

    memory: int
    objects: int
    files: int
    threads: int
    children: int
    shared: int


def held() -> Held:
    """After what is no longer needed has been given back to the system."""
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    status = Path("/proc/self/status").read_text()
    count = {name: int(re.search(rf"{name}:\s+(\d+)", status)[1]) for name in ("VmRSS", "Threads")}
    children = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
    own = [path for path in Path("/dev/shm").iterdir() if re.search(rf"[-_]{os.getpid()}[-_]", path.name)]
    files = len(os.listdir("/proc/self/fd"))
    return Held(count["VmRSS"], len(gc.get_objects()), files, count["Threads"], len(children), len(own))


class Curve:
    """What is held as work is done, told at every tenth of it: `STRAINSIGHT_…` runs take long."""

    def __init__(self, count: int, capsys):
        self.count, self.capsys, self.points = count, capsys, []
        self.began, self.said = time.perf_counter(), 0

    def point(self, done: int) -> None:
        self.points.append(held())
        if done * 10 // self.count > self.said:
            self.said = done * 10 // self.count
            now = self.points[-1]
            self.say(f"{done:>9} {now.memory / 1024:.2f} MiB, {now.objects} objects, {self.seconds:.0f} s")

    @property
    def seconds(self) -> float:
        return time.perf_counter() - self.began

    def say(self, text: str) -> None:
        with self.capsys.disabled():
            print(f"\n  {text}", end="", flush=True)

    def is_flat(self) -> None:
        """Nothing grows after the warm-up."""
        warm = self.points[int(len(self.points) * WARM) :]
        memory = [now.memory for now in warm]
        assert len(warm) > 1
        assert max(memory) - memory[0] < ROOM, memory
        assert warm[-1].objects - warm[0].objects < 4 * len(warm), warm
        assert len({replace(now, memory=0, objects=0) for now in warm}) == 1, warm


def steady(A: np.ndarray, H: np.ndarray, Q: np.ndarray, R: np.ndarray) -> np.ndarray:
    """P after the update where it no longer moves, by SciPy's Riccati solver on states of unit size."""
    P = solve_discrete_are(A.T, H.T, Q, R)
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    return P - K @ H @ P


class Truth:
    """xₖ₊₁ = A xₖ + wₖ and its readings, a block at a time; every third block lacks a sample now and then."""

    def __init__(self, A: np.ndarray, model: FilterModel, P: np.ndarray):
        self.A, self.H = A, model.H
        self.factor, self.noise = covariance_root(model.process), np.sqrt(model.noise)
        self.rng, self.blocks = np.random.default_rng(3), 0
        self.x = covariance_root(P) @ self.rng.standard_normal(len(P))

    def block(self) -> tuple[np.ndarray, np.ndarray]:
        """States (BLOCK, n) and samples (BLOCK, m)."""
        drawn = self.rng.standard_normal((BLOCK, len(self.x))) @ self.factor.T
        states, x = np.empty_like(drawn), self.x
        for k, w in enumerate(drawn):
            x = states[k] = self.A @ x + w
        self.x = x.copy()
        samples = states @ self.H.T + self.noise * self.rng.standard_normal((BLOCK, GAUGES))
        self.blocks += 1
        if self.blocks % 3 == 0:
            samples[: BLOCK // 10][self.rng.random((BLOCK // 10, GAUGES)) < 0.02] = np.nan
        return states, samples


def covariance_root(P: np.ndarray) -> np.ndarray:
    """F with F Fᵀ = P, for P of entries of very unlike size."""
    d = np.sqrt(np.diag(P))
    values, V = np.linalg.eigh(P / np.outer(d, d))
    return d[:, None] * V * np.sqrt(np.maximum(values, 0.0))


def same(one: FilterRun, other: FilterRun) -> bool:
    pairs = [(getattr(one, field.name), getattr(other, field.name)) for field in fields(FilterRun)]
    return all(a is b or np.array_equal(a, b, equal_nan=True) for a, b in pairs)


@pytest.mark.slow
def test_the_filter_over_many_steps(capsys):
    """A stream of one run: in the end P is that of SciPy's Riccati solver, errors and innovations are as large as claimed."""
    model, nothing = make_filter(make_beam(MODES, 0.05), ("tip",), q_velocity=1.0), np.zeros((BLOCK, 3, 0))
    A = DrivenModel(model, nothing[:1]).step(np.zeros((1, model.size)), 0)[1][0]
    start = np.diag([1e-6] * MODES + [1e-3] * MODES + [1.0])
    truth = Truth(A, model, start)
    d = np.sqrt(np.diag(model.process))
    rest = steady(A * d / d[:, None], model.H * d, model.process / np.outer(d, d), np.diag(model.noise))
    rest *= np.outer(d, d)
    precision = np.linalg.inv(rest / np.outer(d, d))

    mean, P = np.zeros(model.size), start
    first, nees, nis = None, [], []
    curve = Curve(STEPS, capsys)
    for block in range(STEPS // BLOCK):
        states, samples = truth.block()
        run = run_filter(model, mean, P, nothing, samples)
        if first is None:
            first = (mean, P, samples, run)
        mean, P = run.mean[-1, 0], run.last[0]
        deviation = np.sqrt(np.diag(P))
        assert np.array_equal(P, P.T)
        assert np.linalg.eigvalsh(P / np.outer(deviation, deviation))[0] > 0
        settled = slice(BLOCK // 2, None)
        error = (run.mean[1:, 0] - states)[settled] / d
        nees.append(np.mean(np.einsum("ki,ij,kj->k", error, precision, error)) / model.size)
        nis.append(np.nanmean(run.whitened[settled] ** 2))
        if (block + 1) % max(1, STEPS // BLOCK // 200) == 0:
            curve.point((block + 1) * BLOCK)
    off = np.abs((P - rest) / np.outer(deviation, deviation)).max()
    curve.say(f"NEES {np.mean(nees[1:]):.4f}, NIS {np.mean(nis):.5f}, each over its dimension")
    curve.say(f"P of the end and of SciPy differ by {off:.1e} of the deviations")
    curve.is_flat()
    assert off < 1e-9
    for means in (nees[1:], nis):
        assert abs(np.mean(means) - 1) < 4 * np.std(means) / np.sqrt(len(means))
    assert first is not None
    assert same(run_filter(model, first[0], first[1], nothing, first[2]), first[3])


@pytest.mark.slow
def test_placements_in_one_process(project, capsys, monkeypatch):
    monkeypatch.setattr(parallel, "WORTH", 5.0)  # whole runs may have sweeps by others
    runner, results = CliRunner(), str(project / "again")
    folder = project / "again" / "beam"

    def done(*words: str) -> None:
        said = runner.invoke(app, [*words, "--results", results])
        assert said.exit_code == 0, said.output

    def found() -> dict[str, str]:
        return {path.name: Artefact(path).digest for path in folder.glob("*.h5")} | {
            name: (folder / name).read_text() for name in ("gauges.csv", "gauges.unv")
        }

    def whole() -> None:
        done("run", str(project / "beam.yaml"), "--force", "--jobs", "2")
        done("run", str(project / "bench.yaml"), "--force", "--jobs", "2")

    if PLACEMENTS >= WHOLE:
        whole()
    done("place", str(project / "beam.yaml"))
    first = found()
    every = max(2, PLACEMENTS // 100)
    curve = Curve(PLACEMENTS, capsys)
    for placed in range(1, PLACEMENTS + 1):
        done("place", str(project / "beam.yaml"), "--force", "--jobs", "1")
        assert Artefact(folder / "place.h5").digest == first["place.h5"]
        if placed % WHOLE == 0:
            whole()
            assert found() == first
        if placed % every == 0:
            curve.point(placed)
    assert found() == first
    curve.is_flat()
