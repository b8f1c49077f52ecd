"""What more processes and a Dask cluster of this machine bring: `python -m benchmarks.sweeps [times]`.

A bar of bricks in two materials (25 000 unknowns): `rom` with eleven points of the parameters (eight to build from, three to
check), and `validate` with 322 runs of the filter in six batches; times: so many times the points to build from, and the
repeats. Each stage with one process, with two, and on two Dask workers (one thread each, on loopback). Printed are the seconds
that it took, and the processor seconds of the process itself and of the busiest other: their sum is what it takes where every
process has a core to itself, whatever else the machine does meanwhile. The artefacts are compared: they must be the same.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import psutil

COUNTS, SIZE, TIP = (60, 12, 10), (1.0, 0.1, 0.08), 100_000
STAGES = ("rom", "validate")
SAMPLES, REPEATS = 8, 150
SINGLE = {"OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
CONFIG = """
kind: placement
name: beam
mesh: {{file: beam.bdf}}
parameters:
  E: {{property: youngs_modulus, region: 1, guess: 1.9e+11, range: [1.6e+11, 2.4e+11]}}
  E2: {{property: youngs_modulus, region: 2, guess: 7.0e+10, range: [6.0e+10, 8.0e+10]}}
loads:
  tip: {{node: 100000, direction: [0, 0, 1], known: true, signal: {{type: sine, frequency: 20.0, amplitude: 1.0e+3}}}}
damping: {{type: modal, ratio: 0.01}}
rom: {{modes: 6, parameter_samples: {samples}, tolerance: 1.0e-3}}
train: {{duration: 0.3, time_step: 1.0e-3}}
gauges:
  direction: {{type: axis, axis: [1, 0, 0]}}
  noise_std: {{relative_to_strongest: 0.01}}
screen: {{keep: 40, minimum_spacing: 0.02}}
place: {{estimate: [E], keep: 4, instants: 2}}
validate:
  truth: {{model: rom, parameters: {{E: 2.1e+11}}}}
  time_step: 1.0e-3
  duration: 0.3
  initial_std: {{E: 0.1}}
  random_sets: 10
  repeats: {repeats}
"""


def write_project(folder: Path, times: int) -> None:
    """The deck and its config."""
    grid = np.stack(np.meshgrid(*(np.arange(c + 1) for c in COUNTS), indexing="ij"), axis=-1)
    number = 1 + np.arange(grid[..., 0].size).reshape(grid.shape[:3])
    place = grid.reshape(-1, 3) * np.array(SIZE) / np.array(COUNTS)
    cards = [["GRID", n, "", *(f"{x:.5f}" for x in at)] for n, at in enumerate(place, start=1)]
    cards.append(["GRID", TIP, "", SIZE[0], SIZE[1] / 2, SIZE[2] / 2])
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    for e, (i, j, k) in enumerate(np.ndindex(*COUNTS), start=1):
        cards.append(["CHEXA", e, 1 + 2 * i // COUNTS[0], *(number[i + a, j + b, k + c] for a, b, c in corners)])
    cards += [["RBE2", 1, TIP, 123456, *number[-1].flat], ["SPC1", 1, 123, *number[0].flat]]
    cards += [
        ["PSOLID", 1, 1],
        ["PSOLID", 2, 2],
        ["MAT1", 1, 2.1e11, "", 0.3, 7850.0],
        ["MAT1", 2, 7.0e10, "", 0.33, 2700.0],
    ]
    lines = ["SOL 103", "CEND", "SPC = 1", "BEGIN BULK", *map(written, cards), "ENDDATA", ""]
    (folder / "beam.bdf").write_text("\n".join(lines), encoding="ascii")
    (folder / "beam.yaml").write_text(
        CONFIG.format(samples=1 + SAMPLES * times, repeats=REPEATS * times), encoding="utf-8"
    )


def written(card: list[object]) -> str:
    """Nastran's free format, eight fields a line after the first."""
    words = [str(word) for word in card]
    return "\n,".join([",".join(words[:9]), *(",".join(words[i : i + 8]) for i in range(9, len(words), 8))])


@contextmanager
def cluster(folder: Path) -> Iterator[tuple[str, list[psutil.Process]]]:
    """The address of a scheduler with two workers of one thread each, and those."""
    dask, log = [sys.executable, "-m", "dask"], folder / "scheduler.log"
    with log.open("wb") as says, (folder / "workers.log").open("wb") as nothing:
        words = [
            *dask,
            "scheduler",
            "--host",
            "127.0.0.1",
            "--port",
            "0",
            "--no-dashboard",
            "--dashboard-address",
            ":0",
        ]
        scheduler = subprocess.Popen(words, stdout=says, stderr=says)
        workers: list[subprocess.Popen[bytes]] = []
        try:
            while (found := re.search(r"Scheduler at:\s+(\S+)", log.read_text())) is None:
                if scheduler.poll() is not None:
                    raise SystemExit(log.read_text())
            words = [*dask, "worker", found[1], "--nthreads", "1", "--no-nanny", "--no-dashboard"]
            words += ["--dashboard-address", ":0", "--local-directory", str(folder)]
            for _ in range(2):
                workers.append(subprocess.Popen(words, stdout=nothing, stderr=nothing, env=os.environ | SINGLE))
            yield found[1], [psutil.Process(worker.pid) for worker in workers]
        finally:
            for process in [*workers, scheduler]:
                process.kill()
                process.wait()


def timed(stage: str, folder: Path, workers: list[psutil.Process], *options: str) -> tuple[np.ndarray, str]:
    """Seconds of the stage alone, run anew, processor seconds of its process and of the busiest other; its artefact's digest."""
    from strainsight.runner.artefact import Artefact

    words = [stage, str(folder / "beam.yaml"), "--results", str(folder / "results"), "--force", *options]
    code = "from strainsight_cli.main import main; main()"
    before = {worker: spent(worker) for worker in workers}
    own, others = 0.0, dict[psutil.Process, float]()
    with (folder / "says").open("w+") as says:
        process = psutil.Popen([sys.executable, "-c", code, *words], stdout=says, stderr=says, env=os.environ | SINGLE)
        while process.poll() is None:
            with suppress(psutil.NoSuchProcess):
                own = spent(process)
                others |= {child: spent(child) for child in process.children(recursive=True)}
            time.sleep(0.05)
        if process.returncode:
            raise SystemExit((folder / "says").read_text())
    busiest = max([0.0, *others.values(), *(spent(worker) - before[worker] for worker in workers)])
    artefact = Artefact(folder / "results" / "beam" / f"{stage}.h5")
    return np.array([artefact.header.seconds or 0.0, own, busiest]), artefact.digest


def spent(process: psutil.Process) -> float:
    """Processor seconds so far."""
    times = process.cpu_times()
    return float(times.user + times.system)


def main() -> None:
    with tempfile.TemporaryDirectory() as name, cluster(Path(name)) as (address, workers):
        folder = Path(name)
        write_project(folder, int(sys.argv[1]) if len(sys.argv) > 1 else 1)
        timed("validate", folder, [])
        ways = {"one process": ("--jobs", "1"), "two processes": ("--jobs", "2"), "two workers": ("--dask", address)}
        print("stage                      seconds   processor: own   busiest other   sum   load")
        for stage in STAGES:
            digests = set()
            for way, options in ways.items():
                (seconds, own, busiest), digest = timed(stage, folder, workers, *options)
                digests.add(digest)
                print(
                    f"{stage:9s} {way:14s} {seconds:9.1f} {own:16.1f} {busiest:15.1f} {own + busiest:5.1f}"
                    f"   {os.getloadavg()[0]:.1f}",
                    flush=True,
                )
            if len(digests) > 1:
                raise SystemExit(f"{stage}: not the same results")


if __name__ == "__main__":
    main()
