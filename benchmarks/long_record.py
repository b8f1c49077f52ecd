"""A long record of a test: `python -m benchmarks.long_record [samples]`, 10⁶ of eight gauges at 1 kHz where no number is given.

The tip force of the cantilever, unknown, by eight gauges with the default tolerances: the training simulation again and
again, with
noise. The record is a CSV file in a temporary folder, and `strainsight estimate` a process of its own. Prints the size of the
file, what was forecast, how long it took and, on Linux, the largest memory of the process.
"""

from __future__ import annotations

import csv
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from ruamel.yaml import YAML

from strainsight.runner.artefact import Artefact

ROOT = Path(__file__).resolve().parent.parent
COMMAND = str(Path(sys.executable).parent / "strainsight")
GAUGES = tuple(f"G{i + 1}" for i in range(8))
STEP = 1e-3
INCONSISTENT = 3
"""Exit code of an inconsistent record: the training simulation repeats, and so does its end."""


def config(folder: Path) -> Path:
    """cantilever-input.yaml without a parameter, with eight gauges and a test."""
    own = YAML(typ="safe").load(ROOT / "configs" / "cantilever-input.yaml")
    own |= {"name": "long", "parameters": {}, "train": {"duration": 1.0, "time_step": STEP}}
    own["mesh"]["file"] = str(ROOT / "meshes" / "cantilever.bdf")
    own["place"] |= {"keep": len(GAUGES), "certificate": False}
    own["validate"] |= {"truth": {"model": "perturbed"}, "time_step": STEP}
    channels = [{"gauge": name, "channel": name, "unit": "um/m"} for name in GAUGES]
    own["estimate"] = {
        "file": "record.csv",
        "as_placed": True,
        "time": {"channel": "time", "unit": "s"},
        "channels": channels,
    }
    path = folder / "long.yaml"
    YAML(typ="safe").dump(own, path)
    return path


def record(folder: Path, samples: int) -> Path:
    """The training simulation of the gauges that were placed, which is periodic, with noise."""
    with (folder / "results" / "long" / "gauges.csv").open(encoding="utf-8") as lines:
        places = [[float(row[f"position_{axis}"]) for axis in "xyz"] for row in csv.DictReader(lines)]
    train = Artefact(folder / "results" / "long" / "train.h5")
    at = [int(np.argmin(np.abs(train["/gauges/position"] - place).sum(axis=1))) for place in places]
    period = 1e6 * train["/coordinate"][:-1] @ train["/gauges/row"][at].T
    noise = 0.01 * np.sqrt(np.mean(period**2, axis=0)).max()
    rng, path = np.random.default_rng(1), folder / "record.csv"
    with path.open("w", encoding="utf-8") as file:
        file.write(",".join(["time", *GAUGES]) + "\n")
        for start in range(0, samples, 10_000):
            k = np.arange(start, min(samples, start + 10_000))
            values = period[k % len(period)] + noise * rng.standard_normal((len(k), len(GAUGES)))
            lines = np.column_stack([STEP * k, values]).tolist()
            file.write("".join(("%.3f" + ",%.6f" * len(GAUGES) + "\n") % tuple(line) for line in lines))
    return path


def main() -> None:
    samples = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = config(folder)
        subprocess.run([COMMAND, "place", path.name], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        print(f"{record(folder, samples).stat().st_size / 1e6:.0f} MB")
        before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        done = subprocess.run([COMMAND, "estimate", path.name], cwd=folder, capture_output=True, text=True)
        if done.returncode not in (0, INCONSISTENT):
            sys.exit(done.stderr)
        own = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = own.ru_utime + own.ru_stime - before.ru_utime - before.ru_stime
        print(done.stderr.strip())
        print(next(line for line in done.stdout.splitlines() if line.startswith("estimate")))
        print(f"{time.perf_counter() - start:.0f} s, {spent:.0f} s of processor time, {own.ru_maxrss / 2**20:.2f} GiB")


if __name__ == "__main__":
    main()
