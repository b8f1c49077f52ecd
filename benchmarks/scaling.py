"""What a run costs against its size: `python -m benchmarks.scaling unknowns|gauges [--sizes N …] [--memory GIB] …`.

`unknowns`: a structure of hex20 as a Nastran deck, every stage by the command line in a process of its own. Two shapes,
because the factor of a thin one fills much less: "plate" (1 m × 0.5 m × 10 mm, one element through the wall) and "block" (a
cube of 0.5 m). `gauges`: pools of the cantilever of benchmarks/placement.py, the kernels that `screen`, `observe` and `place`
call, one process a size. Printed are processor seconds of one thread (a busy machine stretches the clock, and these hardly),
peak memory, and what is written to disk; then the cost model of docs/scaling.md, fitted to all sizes but the largest, and what it
predicts of the largest beside what was measured there.
--memory limits the address space of every process, so that a size that is too large is refused as on a smaller machine.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.placement import make_scenarios
from scipy.optimize import nnls

SHAPES = {"plate": ((1.0, 0.5, 0.01), (2, 1, 0)), "block": ((0.5, 0.5, 0.5), (1, 1, 1))}
"""Sides [m], and elements along each for one along the shortest way; 0: one only."""
UNKNOWNS, GAUGES = (10_000, 30_000, 100_000), (100, 1000, 5000)
"""Sizes that are done in ten minutes; --sizes names others, the largest of all the one that is predicted."""
STAGES = ("import", "modes", "rom", "train", "screen", "observe", "place", "spectrum", "validate", "report")
SOLVES = ("modes", "rom", "spectrum")
FACTOR = {"plate": (1.5, 1.1), "block": (2.0, 4 / 3)}
"""Powers of the unknowns that work and fill of nested dissection grow with in the plane and in space (the plane's fill is
N log N, by which a power of 1.1 goes here). Sources: George (1973); Lipton, Rose and Tarjan (1979)."""
KERNELS = ("screening", "observability", "solve", "elimination", "exchange", "certificate")
KEEP, FEW = 8, 40
"""Gauges that are kept, and the pool in which states are compared."""
GIB = 1024.0**3
SINGLE = {"OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": ""}
"""One thread; and bytecode is kept, as it is wherever nobody forbids it: without it every start takes 2 s more."""
HEX20 = (
    *((0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)),
    *((1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)),
    *((1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2)),
)
"""Nodes of a brick on the half steps of the grid, in Nastran's order."""
CONFIG = """
kind: placement
name: size
mesh: {file: size.bdf}
parameters:
  E: {property: youngs_modulus, region: 1, guess: 2.0e+11, range: [1.6e+11, 2.4e+11]}
loads:
  tip: {set: SET1-1, direction: [0, 0, 1], known: true, signal: {type: sine, frequency: 5.0, amplitude: 1.0e+2}}
damping: {type: modal, ratio: 0.01}
rom: {modes: 10}
train: {duration: 0.3, time_step: 1.0e-3}
gauges:
  direction: {type: axis, axis: [1, 0, 0]}
  noise_std: {relative_to_strongest: 0.01}
  exclude: [{normal_cone: {axis: [1, 0, 0], angle: 10}}, {normal_cone: {axis: [-1, 0, 0], angle: 10}}]
screen: {keep: 150}
place: {estimate: [E], keep: 4, instants: 2}
validate:
  truth: {model: modes, modes: 40, parameters: {E: 2.1e+11}}
  time_step: 1.0e-3
  duration: 0.3
  initial_std: {E: 0.1}
"""


def elements_of(shape: str, unknowns: int) -> tuple[int, int, int]:
    """Elements along each side, for about so many unknowns."""
    ratio = SHAPES[shape][1]
    a, b, c = ratio
    counts = [(max(1, a * k), max(1, b * k), max(1, c * k)) for k in range(1, 400)]
    return min(counts, key=lambda c: abs(np.log(3 * nodes_of(c) / unknowns)))


def nodes_of(elements: Sequence[int]) -> int:
    """Corners and the middles of edges."""
    a, b, c = elements
    corners = (a + 1) * (b + 1) * (c + 1)
    return corners + a * (b + 1) * (c + 1) + (a + 1) * b * (c + 1) + (a + 1) * (b + 1) * c


def write_deck(path: Path, sides: Sequence[float], elements: tuple[int, int, int]) -> None:
    """A brick of bricks, clamped at x = 0; the nodes of the other end are SET1-1."""
    half = 2 * np.array(elements) + 1
    place = np.stack(np.meshgrid(*(np.arange(h) for h in half), indexing="ij"), axis=-1).reshape(-1, 3)
    used = (place % 2).sum(axis=1) <= 1
    number = np.cumsum(used).reshape(half)
    position = place[used] / (half - 1) * sides
    first = 2 * np.stack(np.meshgrid(*(np.arange(e) for e in elements), indexing="ij"), axis=-1).reshape(-1, 1, 3)
    cells = number[tuple(np.moveaxis(first + np.array(HEX20), 2, 0))]
    root, tip = number[0][used.reshape(half)[0]], number[-1][used.reshape(half)[-1]]
    with path.open("w", encoding="ascii") as deck:
        deck.write("BEGIN BULK\nMAT1           1 2.1E+11              .3   7850.\nPSOLID         1       1\n")
        for node, (x, y, z) in enumerate(position, start=1):
            deck.write(f"GRID*   {node:16d}{'':16s}{x:16.10f}{y:16.10f}\n*       {z:16.10f}\n")
        for element, nodes in enumerate(cells, start=1):
            fields = "".join(f"{n:8d}" for n in nodes)
            deck.write(f"CHEXA   {element:8d}       1{fields[:48]}\n+       {fields[48:112]}\n+       {fields[112:]}\n")
        deck.write(f"SPC1           1     123{root[0]:8d}    THRU{root[-1]:8d}\n")
        deck.write(f"SET1           1{tip[0]:8d}    THRU{tip[-1]:8d}\nENDDATA\n")


@contextmanager
def limited(gib: float | None) -> Iterator[None]:
    """What is started meanwhile gets no more address space than that."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    if gib is not None:
        resource.setrlimit(resource.RLIMIT_AS, (int(gib * GIB), before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def spent(words: Sequence[str], memory: float | None) -> dict[str, Any]:
    """Run Python with these words to its end: exit code, processor and clock seconds, peak memory [GiB], what it said."""
    with tempfile.TemporaryFile("w+") as says, tempfile.TemporaryFile("w+") as errs:
        start = time.perf_counter()
        with limited(memory):
            process = subprocess.Popen([sys.executable, *words], stdout=says, stderr=errs, env=os.environ | SINGLE)
        # not process.wait(): the usage of this child alone
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        clock = time.perf_counter() - start
        for stream in (says, errs):
            stream.seek(0)
        return {
            "code": process.returncode,
            "seconds": usage.ru_utime + usage.ru_stime,
            "clock": clock,
            "peak": usage.ru_maxrss * 1024 / GIB,
            "says": says.read(),
            "errors": errs.read(),
        }


def unknowns(shape: str, size: int, folder: Path, until: str, memory: float | None) -> dict[str, Any]:
    """All stages on a deck of about that size; ends at the first that is refused."""
    elements = elements_of(shape, size)
    write_deck(folder / "size.bdf", SHAPES[shape][0], elements)
    (folder / "size.yaml").write_text(CONFIG, encoding="utf-8")
    found: dict[str, Any] = {"size": 3 * nodes_of(elements)}
    print(
        f"\n{shape}, {' × '.join(map(str, elements))} hex20, {found['size']} unknowns before the supports", flush=True
    )
    for stage in STAGES[: STAGES.index(until) + 1]:
        code = "from strainsight_cli.main import main; main()"
        words = ("-c", code, stage, str(folder / "size.yaml"), "--results", str(folder / "results"), "--jobs", "1")
        done = spent(words, memory)
        if done["code"]:
            said = " ".join(done["errors"].split())
            print(f"  {stage:10s} exit code {done['code']} after {done['seconds']:.1f} s: {said}", flush=True)
            break
        artefact = (folder / "results" / "size" / f"{stage}.h5").stat().st_size / GIB
        found |= {stage: done["seconds"], f"{stage} peak": done["peak"]}
        print(
            f"  {stage:10s} {done['seconds']:9.1f} s of processor {done['clock']:9.1f} s on the clock"
            f" {done['peak']:7.2f} GiB {1024 * artefact:9.1f} MiB on disk   load {os.getloadavg()[0]:.1f}",
            flush=True,
        )
    return found


def gauges(job: Mapping[str, Any]) -> dict[str, float]:
    """The kernels on one pool, in this process: processor seconds of each, and the peak over the imports [MiB]."""
    from tests.placement.whole_pools import eliminate

    from strainsight.loads.observability import observability
    from strainsight.placement.certificate import certify
    from strainsight.placement.exchange import exchange
    from strainsight.placement.scenario import solve_pool
    from strainsight.sensors.screening import screen

    pool, modes = job["size"], job["modes"]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    names = ("Fz", "Fy", "E")
    scenarios = make_scenarios(pool, modes, names[:2], job["scenarios"])
    rng = np.random.default_rng(0)
    position, level = rng.uniform(0, 1, (pool, 3)), rng.uniform(1, 2, pool)
    found: dict[str, float] = {"size": pool, "states": len(scenarios[0].F)}

    def timed(name: str, step: Any) -> Any:
        start = time.process_time()
        result = step()
        found[name] = time.process_time() - start
        return result

    timed("screening", lambda: screen(level, np.full(pool, 0.01), position, pool // 2, 1e-3))
    first = scenarios[0]
    seen = partial(
        observability, first.F, first.H, names=names, frequency=np.ones(modes),
        state_amplitude=1.0, raw_scale=np.ones(len(names)),
    )  # fmt: skip
    timed("observability", seen)
    timed("solve", lambda: [solve_pool(scenario) for scenario in scenarios])
    result = timed("elimination", lambda: eliminate(scenarios, KEEP))
    swapped = timed("exchange", lambda: exchange(result.pools, result.selected))
    bound = timed("certificate", lambda: certify(result.pools, swapped.gauges, swapped.cost[-1]))
    found["removals"], found["solves"], found["gap"] = len(result.removed), float(result.solves.sum()), bound.gap
    found["peak"] = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    return found


def law(rows: Sequence[Mapping[str, float]], key: str, powers: Sequence[float]) -> np.ndarray:
    """c ≥ 0 of key = Σ c_i size^powers_i through these rows, least squares of the relative error."""
    size, value = (np.array([row[name] for row in rows]) for name in ("size", key))
    units = size.max() ** np.array(powers)
    c, _ = nnls(size[:, None] ** powers / units / value[:, None], np.ones(len(rows)))
    return np.asarray(c / units)


def check(rows: Sequence[Mapping[str, float]], laws: Mapping[str, Sequence[float]]) -> None:
    """Fit all rows but the last, predict the last; a key that a refused size lacks is left out."""
    for key, powers in laws.items():
        *fitted, last = [row for row in rows if key in row] or [{}]
        if len(fitted) < 2:
            continue
        c = law(fitted, key, powers)
        said = float(c @ last["size"] ** np.array(powers))
        formula = " + ".join(f"{a:.2g} N^{p:.3g}" for a, p in zip(c, powers, strict=True) if a > 0)
        sizes = ", ".join(f"{row['size']:.0f}" for row in fitted)
        print(f"  {key:14s} {formula:36s} from {sizes}; at {last['size']:.0f}: ", end="")
        print(f"predicted {said:.3g}, measured {last[key]:.3g}, {last[key] / said:.2f}")


def all_unknowns(shape: str, sizes: Sequence[int], until: str, memory: float | None) -> None:
    rows = []
    for size in sizes:
        with tempfile.TemporaryDirectory() as folder:
            rows.append(unknowns(shape, size, Path(folder), until, memory))
    flops, fill = FACTOR[shape]
    print()
    check(rows, {stage: (0, 1, flops) if stage in SOLVES else (0, 1) for stage in STAGES})
    check(rows, {f"{stage} peak": (0, 1, fill) if stage in SOLVES else (0, 1) for stage in STAGES})


def one_pool(job: Mapping[str, Any], memory: float | None) -> dict[str, float]:
    """`gauges` in a process of its own, and its line."""
    done = spent(("-W", "ignore", __file__, "one", "--job", json.dumps(job)), memory)
    if done["code"]:
        raise SystemExit(f"{job}:\n{done['errors']}")
    found: dict[str, float] = json.loads(done["says"])
    print(
        f"{found['size']:7.0f} {found['states']:7.0f} {job['scenarios']:10d}"
        + "".join(f"{found[kernel]:14.3f}" for kernel in KERNELS)
        + f"{found['solves'] / found['removals'] / job['scenarios']:12.2f} {found['gap']:9.1e} {found['peak']:8.0f}"
        f" {os.getloadavg()[0]:5.1f}",
        flush=True,
    )
    return found


def all_gauges(sizes: Sequence[int], memory: float | None) -> None:
    print(f"processor seconds; eliminated down to {KEEP} gauges, three unknowns")
    heads = "".join(f"{kernel:>14s}" for kernel in KERNELS)
    print(f"{'gauges':>7s} {'states':>7s} {'scenarios':>10s}{heads}{'solves/rem':>12s} {'gap':>9s} {'MiB':>8s}  load")
    rows = [one_pool({"size": size, "modes": 10, "scenarios": 1}, memory) for size in sizes]
    check(rows, dict.fromkeys((*KERNELS, "peak"), (0, 1)))
    print("\nscenarios")
    for scenarios in (5, 20):
        one_pool({"size": sizes[0], "modes": 10, "scenarios": scenarios}, memory)
    print("\nstates")
    rows = [one_pool({"size": FEW, "modes": modes, "scenarios": 1}, memory) for modes in (10, 40, 100, 200)]
    check(
        [row | {"size": row["states"]} for row in rows],
        dict.fromkeys(("solve", "elimination", "certificate"), (0, 2, 3)),
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=("unknowns", "gauges", "one"))
    parser.add_argument("--sizes", nargs="+", type=int, metavar="N")
    parser.add_argument("--shapes", nargs="+", choices=tuple(SHAPES), default=tuple(SHAPES))
    parser.add_argument("--until", choices=STAGES, default=STAGES[-1], metavar="STAGE", help="the last stage to run")
    parser.add_argument("--memory", type=float, metavar="GIB", help="address space of each process")
    parser.add_argument("--job", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.part == "one":
        print(json.dumps(gauges(json.loads(chosen.job))))
    elif chosen.part == "gauges":
        all_gauges(sorted(chosen.sizes or GAUGES), chosen.memory)
    else:
        for shape in chosen.shapes:
            all_unknowns(shape, sorted(chosen.sizes or UNKNOWNS), chosen.until, chosen.memory)
