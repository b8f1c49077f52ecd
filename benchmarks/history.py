"""One entry of the history: `make history`, or `python -m benchmarks.history [REFERENCE]`.

Five jobs, each done by this package and by another program in turn, seven times, in one process of one thread. The ratio of
the two processor times says how many times as long the other one takes; kept are its median, its least and its largest
value. Both see the same machine in the same second, so that a busy one changes the ratio less than the times. Before a
ratio is kept the two results are compared. One file a commit, that of the last change to the package; measured anew it is
replaced. Then the stages are compared with those of a reference, the last release or else the commit of the last entry.
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))

import json
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks import bearing, fem, placement, stages
from benchmarks import filter as filters

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "benchmarks" / "history"
MEASURED = "pipeline"
"""The folder whose last commit an entry belongs to."""
PACKAGES = ("numpy", "scipy", "numba", "scikit-fem", "filterpy")
ROUNDS = 7


@dataclass(frozen=True)
class Job:
    """The same job twice. `apart` of the two results has to be below `agree`; `own` is called so many `times` in a row, and
    the peer does one part in `share` of the work.
    """

    what: str
    peer: str
    own: Callable[[], Any]
    theirs: Callable[[], Any]
    apart: Callable[[Any, Any], float]
    agree: float
    times: int = 1
    share: int = 1


def assembly() -> Job:
    from strainsight.decks.reader import read_mesh
    from strainsight.fem.assembly import assemble

    with tempfile.TemporaryDirectory() as folder:
        deck = Path(folder) / "shell.bdf"
        fem.write_deck(deck, 2, 12)
        mesh = read_mesh(deck)

    def apart(own: Any, theirs: Any) -> float:
        """Of the mass: our sides are curved, those of the peer straight."""
        return abs(own[1].constant.sum() / theirs[1].sum() - 1)

    return Job(
        f"stiffness and mass of {len(mesh.blocks[0].ids)} tet10",
        "scikit-fem",
        lambda: assemble(mesh),
        fem.scikit_fem(mesh),
        apart,
        agree=1e-2,
        times=3,
    )


def riccati() -> Job:
    from scipy.linalg import solve_continuous_are

    from strainsight.placement.riccati import information, solve_anew
    from strainsight.placement.scenario import solve_pool

    pool = solve_pool(placement.make_scenarios(100, 10, ("Fz",), 1)[0])
    F, Q, rows = pool.scenario.F, pool.scenario.Q, pool.stacked(np.arange(0, 100, 25))
    return Job(
        f"Riccati equation of {len(F)} states and 4 gauges",
        "SciPy",
        lambda: solve_anew(F, Q, information(rows)),
        lambda: solve_continuous_are(F.T, rows.T, Q, np.eye(len(rows))),
        lambda own, theirs: float(np.linalg.norm(own - theirs) / np.linalg.norm(own)),
        agree=1e-8,
        times=50,
    )


def elimination() -> Job:
    from tests.placement.whole_pools import eliminate

    from strainsight.placement.scenario import solve_pool

    scenario = placement.make_scenarios(40, 10, ("Fz",), 1)[0]
    limits, balanced = placement.make_limits(40, "count"), solve_pool(scenario).scenario
    return Job(
        "elimination from 40 gauges to 4",
        "every candidate at every step, by SciPy",
        lambda: eliminate((scenario,), limits).removed.tolist(),
        lambda: placement.peer_in_full(balanced, compress=True),
        lambda own, theirs: sum(a != b for a, b in zip(own, theirs, strict=True)) / len(own),
        agree=1e-9,
        times=3,
    )


def steps_of_the_filter() -> Job:
    from strainsight.estimation.filter import run_filter

    model, runs, steps, share = filters.cantilever(), 100, 1000, 10
    measured = filters.NOISE * np.random.default_rng(0).standard_normal((steps, runs, 4))
    part = runs // share

    def own() -> Any:
        return run_filter(model, np.zeros(model.size), filters.prior(model), np.zeros((steps, 3, 0)), measured)

    return Job(
        f"Kalman filter, {runs} runs of {steps} steps, {model.size} states",
        "filterpy",
        own,
        lambda: filters.by_filterpy(model, measured[:, :part]),
        lambda run, ends: float(np.abs((ends - run.mean[-1, :part]) / run.std[-1, :part]).max()),
        agree=1e-6,
        times=3,
        share=share,
    )


def load_of_a_bearing() -> Job:
    from strainsight.multibody.bearing.element import bearing_load

    there, q = bearing.pitch_bearing(preload=2e-5), np.array([1e-4, 2e-5, -3e-5, 1e-4, -5e-5])

    def apart(load: Any, plain: Any) -> float:
        pairs = ((load.force, plain[0]), (load.tangent, plain[1]))
        return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in pairs)

    return Job(
        "load and tangent of a bearing of 128 balls",
        "plain NumPy",
        lambda: bearing_load(there, q, slopes=False),
        lambda: bearing.plain_numpy(there, q),
        apart,
        agree=1e-6,
        times=500,
    )


JOBS = {
    "assembly": assembly,
    "riccati": riccati,
    "elimination": elimination,
    "filter": steps_of_the_filter,
    "bearing": load_of_a_bearing,
}


def measured(job: Job) -> dict[str, Any]:
    """{what, peer, own [s], theirs [s], ratio, least, largest, apart} of a job; medians over the rounds, processor times."""
    apart = job.apart(job.own(), job.theirs())  # compiles and loads, too
    if not apart <= job.agree:
        sys.exit(f"{job.what}: {apart:.1e} apart from {job.peer}, {job.agree:.0e} is allowed: no ratio of the two")
    rounds = np.array(
        [
            (
                processor_seconds(job.own, job.times),
                processor_seconds(job.theirs, max(job.times // 10, 1)) * job.share,
            )
            for _ in range(ROUNDS)
        ]
    )
    ratios = rounds[:, 1] / rounds[:, 0]
    numbers = {
        "own": np.median(rounds[:, 0]),
        "theirs": np.median(rounds[:, 1]),
        "ratio": np.median(ratios),
        "least": ratios.min(),
        "largest": ratios.max(),
        "apart": apart,
    }
    return {"what": job.what, "peer": job.peer} | {name: float(f"{x:.3g}") for name, x in numbers.items()}


def processor_seconds(work: Callable[[], Any], times: int) -> float:
    start = time.process_time()
    for _ in range(times):
        work()
    return (time.process_time() - start) / times


def git(*words: str) -> str:
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"an entry belongs to a commit, and git does not name it: {done.stderr.strip()}")
    return done.stdout.strip()


def processor() -> str:
    """Its model, where the system says."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(": ")[2] for line in lines if line.startswith("model name")), platform.machine())


def reference_commit() -> str:
    """The commit of the last release, or of the last entry."""
    tags = git("tag", "--list", "v*", "--sort=-version:refname").split()
    if tags:
        return git("rev-parse", f"{tags[0]}^{{commit}}")
    entries = (json.loads(path.read_text(encoding="utf-8")) for path in FOLDER.glob("*.json"))
    return str(max(entries, key=lambda entry: entry["committed"])["commit"])


def main() -> None:
    if git("status", "--porcelain", "--", MEASURED):
        sys.exit(f"{MEASURED}/ has changes that no commit holds: commit them first, then measure")
    commit, committed = git("log", "-1", "--format=%H %cI", "--", MEASURED).split()
    entry: dict[str, Any] = {
        "commit": commit,
        "committed": datetime.fromisoformat(committed).astimezone(UTC).isoformat(),
        "measured": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": {
            "processor": processor(),
            "cores": os.cpu_count(),
            "system": f"{platform.system()} {platform.machine()}",
            "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        },
        "versions": {"python": platform.python_version()} | {name: version(name) for name in PACKAGES},
        "ratios": {},
    }
    for name in JOBS:
        entry["ratios"][name] = found = measured(JOBS[name]())
        print(
            f"{found['what']:50s} {found['own']:9.3g} s, {found['peer']} {found['ratio']:g} times as long"
            f" ({found['least']:g} to {found['largest']:g})",
            flush=True,
        )
    reference = sys.argv[1] if len(sys.argv) > 1 else reference_commit()
    entry["reference"], entry["stages"] = reference, stages.compare(reference, tuple(stages.JOBS))
    path = FOLDER / f"{entry['committed'][:10]}-{commit[:7]}.json"
    path.write_text(json.dumps(entry, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    print(path)


if __name__ == "__main__":
    main()
