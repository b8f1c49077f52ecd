"""Processor time and memory of stages, here and at another commit: `python -m benchmarks.stages COMMIT [job …]`.

Every command runs in turn with the code of this checkout and with that of the commit, with the same packages, one thread and
warm caches: the ratio of two neighbours changes less than the times on a busy machine. A job is one command; what it needs
has been computed before by the same code. `run cold` starts without compiled code.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from benchmarks import long_record

ROOT = Path(__file__).resolve().parent.parent
ROUNDS, SAMPLES = 3, 60_000
"""Rounds of a job; samples of the record of `estimate`, of eight gauges at 1 kHz."""
MAIN = "cantilever-youngs-modulus.yaml"
JOBS: dict[str, tuple[str, ...]] = {
    "status": ("status", MAIN),
    "place": ("place", MAIN, "--force"),
    "validate": ("validate", MAIN, "--force"),
    "report": ("report", MAIN, "--force"),
    "run": ("run", MAIN, "--force"),
    "run cold": ("run", MAIN, "--force"),
    "estimate": ("estimate", "long.yaml", "--force"),
    "test": ("test", "long.yaml", "--force"),
}


@dataclass(frozen=True)
class Code:
    """A checkout and the folder in which its commands run."""

    root: Path
    folder: Path

    def call(self, *words: str, cold: bool = False) -> tuple[float, float]:
        """Processor time [s] and peak memory [GiB] of a command."""
        paths = os.pathsep.join(str(self.root / part) for part in ("pipeline", "cli"))
        env = os.environ | {"PYTHONPATH": paths} | dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        with tempfile.TemporaryDirectory() as cache:
            env |= {"NUMBA_CACHE_DIR": cache} if cold else {}
            command, *rest = words
            more = () if command == "status" else ("--jobs", "1", "--quiet")
            line = [sys.executable, "-c", "from strainsight_cli.main import main; main()", command, *rest, *more]
            process = subprocess.Popen(
                line, cwd=self.folder, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
            )
            message = process.stderr.read() if process.stderr is not None else b""
            _, status, usage = os.wait4(process.pid, 0)
        if os.waitstatus_to_exitcode(status) not in (0, long_record.INCONSISTENT):
            sys.exit(f"{' '.join(words)} at {self.root}: {message.decode(errors='replace')}")
        return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 2**20


def prepared(root: Path, folder: Path, jobs: Sequence[str]) -> Code:
    """The code with its inputs, all stages of which are up to date."""
    folder.mkdir()
    for name in ("configs", "meshes"):
        (folder / name).symlink_to(ROOT / name)
    shutil.copy(ROOT / "configs" / MAIN, folder / MAIN)
    text = (folder / MAIN).read_text(encoding="utf-8").replace("../meshes", "meshes")
    (folder / MAIN).write_text(text, encoding="utf-8")
    code = Code(root, folder)
    code.call("run", MAIN)
    if {"estimate", "test"} & set(jobs):
        long_record.config(folder)
        code.call("place", "long.yaml")
        long_record.record(folder, SAMPLES)
        code.call("test", "long.yaml")
    return code


def compare(commit: str, jobs: Sequence[str]) -> dict[str, dict[str, float]]:
    """job → {time [s], reference_time [s], ratio, memory [GiB], reference_memory [GiB]}; medians over the rounds."""
    with tempfile.TemporaryDirectory() as scratch:
        tree = Path(scratch) / "reference"
        subprocess.run(["git", "worktree", "add", "--detach", str(tree), commit], cwd=ROOT, check=True, capture_output=True)
        try:
            codes = [prepared(root, Path(scratch) / name, jobs) for root, name in ((ROOT, "now"), (tree, "before"))]
            rows = {}
            for job in jobs:
                rounds = np.array(
                    [[code.call(*JOBS[job], cold=job == "run cold") for code in codes] for _ in range(ROUNDS)]
                )
                seconds, memory = np.median(rounds[..., 0], axis=0), rounds[..., 1].max(axis=0)
                ratio = float(np.median(rounds[:, 1, 0] / rounds[:, 0, 0]))
                rows[job] = dict(zip(("time", "reference_time", "ratio"), (*seconds.tolist(), ratio), strict=True))
                rows[job] |= {"memory": float(memory[0]), "reference_memory": float(memory[1])}
                print(
                    f"| {job} | {seconds[1]:.2f} s | {seconds[0]:.2f} s | {ratio:.2f} | {memory[1]:.2f}, {memory[0]:.2f} GiB |",
                    flush=True,
                )
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", str(tree)], cwd=ROOT, check=True)
    return rows


if __name__ == "__main__":
    if len(sys.argv) < 2 or not set(sys.argv[2:]) <= set(JOBS):
        sys.exit(f"python -m benchmarks.stages COMMIT [job …], jobs: {', '.join(JOBS)}")
    print("| job | before | now | ratio | peak memory before, now |\n|---|---|---|---|---|")
    compare(sys.argv[1], sys.argv[2:] or tuple(JOBS))
