"""Time and memory of the main job on the cantilever: `python -m benchmarks.cantilever`.

Prints the wall time of a first and of a second `run` of every configs/cantilever-*.yaml, the elimination alone, the
start-up of the command line, and the peak memory of the largest process. Machines differ and are shared: read the numbers
beside the peer that runs in the same script, numpy's matrix product.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
COMMAND = [str(Path(sys.executable).parent / "strainsight")]


def seconds(*words: str) -> float:
    """Wall time of one strainsight command, which must succeed."""
    start = time.perf_counter()
    subprocess.run([*COMMAND, *words], check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def product_seconds(n: int = 2000) -> float:
    """Wall time of one n × n matrix product: the peer."""
    A = np.random.default_rng(0).standard_normal((n, n))
    start = time.perf_counter()
    A @ A
    return time.perf_counter() - start


def elimination_seconds(results: Path, name: str) -> tuple[float, str]:
    """The elimination of a finished run once more, first scenario only, and what it removed."""
    from tests.placement.whole_pools import eliminate

    from strainsight.placement.scenario import Scenario
    from strainsight.runner.artefact import Artefact

    place = Artefact(results / name / "place.h5")
    F, H, Q, R, weight = (place[f"/augmented/{key}"][0] for key in ("F", "H", "Q", "R", "weight"))
    start = time.perf_counter()
    result = eliminate((Scenario(F, Q, H, R, weight),), keep=4)
    return time.perf_counter() - start, f"{len(R)} → 4, {len(F)} states, {result.solves.sum()} Riccati solves"


def main() -> None:
    product_seconds()
    print(f"{'peer: 2000 × 2000 product':44s} {product_seconds():8.3f} s")
    seconds("--help")
    print(f"{'strainsight --help':44s} {min(seconds('--help') for _ in range(5)):8.3f} s")
    with tempfile.TemporaryDirectory() as folder:
        results = Path(folder)
        # The input case takes its modulus from the first run.
        names = sorted(
            (path.stem for path in (ROOT / "configs").glob("cantilever-*.yaml")),
            key=lambda n: (n != "cantilever-youngs-modulus", n),
        )
        for name in names:
            config = str(ROOT / "configs" / f"{name}.yaml")
            print(f"{'run ' + name:44s} {seconds('run', config, '--results', folder):8.2f} s")
            print(f"{'  again, up to date':44s} {seconds('run', config, '--results', folder):8.2f} s")
            took, what = elimination_seconds(results, name)
            print(f"{'  elimination, one scenario':44s} {took:8.3f} s   {what}")
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024**2
    print(f"{'peak memory of the largest process':44s} {peak:8.2f} GiB")


if __name__ == "__main__":
    main()
