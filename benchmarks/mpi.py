"""Modes and static responses of the hub by PARDISO and over MPI: `python -m benchmarks.mpi [MESH] [--processes 1 2]`.

Each in a process of its own with one thread: seconds on the clock of the factor, of ten modes from it and of ten static
responses; most memory of this process and of the processes of MPI together [GiB]; largest difference of a frequency from
PARDISO's. The launcher is that of STRAINSIGHT_MPI without its `-n`, by default mpiexec.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np

from strainsight.contrib.mpi.session import LAUNCHER, WORKER, OverMpi
from strainsight.decks.reader import read_mesh
from strainsight.fem.factorisation import factorise
from strainsight.fem.model import build_model
from strainsight.fem.modes import modes
from strainsight.processes import peak_memory

ROOT = Path(__file__).parents[1]
MODES, RESPONSES = 10, 10
GIB = 1024.0**3


class Watch(threading.Thread):
    """The most memory that each process of MPI has held, by what the kernel says of it."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.peak: dict[str, int] = {}

    def run(self) -> None:
        while True:
            for folder in Path("/proc").glob("[0-9]*"):
                try:
                    words = (folder / "cmdline").read_bytes().split(b"\0")
                    if words[1:2] == [str(WORKER).encode()]:
                        lines = (folder / "status").read_text().splitlines()
                        high = next(line for line in lines if line.startswith("VmHWM"))
                        self.peak[folder.name] = 1024 * int(high.split()[1])
                except (OSError, StopIteration):
                    continue
            time.sleep(0.05)


def measured(mesh: Path, processes: int) -> dict[str, object]:
    """One row; processes: 0 is PARDISO."""
    model = build_model(read_mesh(mesh))
    K, M = model.stiffness.constant, model.mass.constant
    watch = Watch()
    watch.start()
    started = time.perf_counter()
    factor = OverMpi()(K) if processes else factorise(K)
    factored = time.perf_counter()
    frequency, _ = modes(K, M, MODES, factor=factor)
    found = time.perf_counter()
    factor.solve(np.random.default_rng(0).standard_normal((model.size, RESPONSES)))
    solved = time.perf_counter()
    return {
        "unknowns": model.size,
        "seconds": [factored - started, found - factored, solved - found],
        "memory": [(peak_memory() or 0) / GIB, sum(watch.peak.values()) / GIB],
        "frequency": list(frequency),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mesh", nargs="?", type=Path, default=ROOT / "meshes" / "hub-coarse.bdf.gz")
    parser.add_argument("--processes", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--one", type=int)
    asked = parser.parse_args()
    if asked.one is not None:
        print(json.dumps(measured(asked.mesh, asked.one)))
        return
    launcher = os.environ.get(LAUNCHER, "mpiexec").partition(" -n ")[0]
    known = None
    for count in (0, *asked.processes):
        own = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", LAUNCHER: f"{launcher} -n {count}"}
        command = [sys.executable, __file__, str(asked.mesh), "--one", str(count)]
        row = json.loads(subprocess.run(command, env={**os.environ, **own}, check=True, capture_output=True).stdout)
        frequency = np.array(row["frequency"])
        known = frequency if known is None else known
        times, memory = (" ".join(f"{value:7.2f}" for value in row[name]) for name in ("seconds", "memory"))
        who = f"SLEPc, {count} processes" if count else "PARDISO"
        print(
            f"{who:20s} {row['unknowns']} unknowns  [s] {times}  [GiB] {memory}  {np.abs(frequency / known - 1).max():.1e}"
        )


if __name__ == "__main__":
    main()
