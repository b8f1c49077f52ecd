"""Cost of results of another program: `python -m benchmarks.results [--unknowns N] [--modes M]`.

A bar of linear hexahedra along x with its exact modes and static response, as a text file of CalculiX (.frd) of N unknowns, 10⁶
unless told, and what is done with it, each in its own process: its mesh, its modes and response one after the other, and the
model of `mesh.results` with all its checks, from the file alone. Seconds and peak memory of each, of which the packages alone are
the first. Machines differ and are shared: read the load beside the times.
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
from pathlib import Path

import numpy as np

E, RHO, LENGTH, SIDE = 2.1e11, 7850.0, 2.0, 0.4
GIB = 1024.0**3
STEPS = ("packages", "mesh", "results", "model")


def bar(unknowns: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3) and hexahedra (e, 8) of a bar of about so many unknowns, two and a half times as long as it is thick."""
    across = round((unknowns / 3 / 2.5) ** (1 / 3))
    counts = np.array([round(2.5 * across), across, across])
    number = np.arange(np.prod(counts + 1)).reshape(counts + 1)
    axes = [np.linspace(0, size, count + 1) for size, count in zip((LENGTH, SIDE, SIDE), counts, strict=True)]
    position = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    i, j, k = (a.ravel() for a in np.meshgrid(*(np.arange(c) for c in counts), indexing="ij"))
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    return position, np.stack([number[i + a, j + b, k + c] for a, b, c in corners], axis=1)


def write(path: Path, unknowns: int, modes: int) -> int:
    """The file; returns its unknowns."""
    position, cells = bar(unknowns)
    ids, x = np.arange(1, len(position) + 1), position[:, 0]
    k = (2 * np.arange(1, modes + 1) - 1) * np.pi / (2 * LENGTH)
    area = SIDE**2
    with path.open("w") as file:
        file.write(f"    1C\n    1UMAT    1STEEL\n    2C{'':18}{len(ids):12d}{'':37}1\n")
        _rows(file, ids, position)
        file.write(f"    3C{'':18}{len(cells):12d}{'':37}1\n")
        for number, own in enumerate((cells + 1).tolist(), start=1):
            file.write(f" -1{number:10d}    1    0    1\n -2" + "".join(f"{node:10d}" for node in own) + "\n")
        file.write(" -3\n")
        _block(file, ids, x / (E * area), f"    1PSTEP{1:26d}{1:12d}{1:12d}\n", 1.0, 0)
        for i in range(modes):
            head = f"    1PSTEP{i + 2:26d}{1:12d}{2:12d}\n    1PGM                1.000000E+00\n    1PMODE{i + 1:26d}\n"
            shape = np.sqrt(2 / (RHO * area * LENGTH)) * np.sin(k[i] * x)
            _block(file, ids, shape, head, k[i] * np.sqrt(E / RHO) / (2 * np.pi), 2)
        file.write(" 9999\n")
    return 3 * len(ids)


def _block(file, ids, along_x, head: str, value: float, analysis: int) -> None:
    file.write(f"{head}  100CL  101{value:#12.9g}"[: len(head) + 24])
    file.write(f"{len(ids):12d}{'':20}{analysis:2d}{1:5d}{'':10} 1\n -4  DISP        4    1\n")
    file.write("".join(f" -5  D{c}          1    2{c:5d}    0\n" for c in (1, 2, 3)))
    file.write(" -5  ALL         1    2    0    0    1ALL\n")
    _rows(file, ids, np.column_stack([along_x, np.zeros((len(ids), 2))]))


def _rows(file, ids, values) -> None:
    for start in range(0, len(ids), 100_000):
        part = slice(start, start + 100_000)
        rows = zip(ids[part].tolist(), *values[part].T.tolist(), strict=True)
        file.writelines(f" -1{n:10d}{a:12.5E}{b:12.5E}{c:12.5E}\n" for n, a, b, c in rows)
    file.write(" -3\n")


def measured(step: str, path: Path) -> dict[str, float]:
    """One step in this process."""
    from strainsight.config.loads import LoadSection
    from strainsight.config.mesh import MeshFile
    from strainsight.decks.reader import read_mesh
    from strainsight.experiment.structure.mesh import mesh_of
    from strainsight.experiment.structure.results import model_of_results
    from strainsight.foreign.results.reader import read_responses

    start = time.perf_counter()
    found = 0.0
    if step == "mesh":
        found = float(len(read_mesh(path).position))
    if step == "results":
        found = float(sum(len(own.node_ids) for own in read_responses(path)))
    if step == "model":
        steel = {"regions": "all", "youngs_modulus": E, "poisson_ratio": 0.0, "density": RHO}
        results = {"file": str(path), "loads": {"end": {"step": 1}}}
        faces = {"end": {"near": (LENGTH, SIDE / 2, SIDE / 2)}}
        config = MeshFile.model_validate(
            {"file": str(path), "materials": {"steel": steel}, "results": results, "faces": faces}
        )
        signal = {"type": "sine", "frequency": 1.0, "amplitude": 1.0}
        load = LoadSection.model_validate({"set": "end", "direction": (1.0, 0.0, 0.0), "known": False, "signal": signal})
        mesh = mesh_of(config, path)
        found = float(model_of_results(config, mesh, (), {"mesh.results.file": path}, {"end": load}).model.size)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024.0
    return {"seconds": time.perf_counter() - start, "peak": peak / GIB, "found": found}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--unknowns", type=int, default=1_000_000)
    parser.add_argument("--modes", type=int, default=10)
    parser.add_argument("--step", nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.step:
        print(json.dumps(measured(given.step[0], Path(given.step[1]))))
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bar.frd"
        start = time.perf_counter()
        size = write(path, given.unknowns, given.modes)
        print(f"{size} unknowns, {given.modes} modes and 1 response: {path.stat().st_size / 1e6:.0f} MB, ", end="")
        print(f"written in {time.perf_counter() - start:.0f} s; load {os.getloadavg()[0]:.1f}")
        for step in STEPS:
            run = [sys.executable, __file__, "--step", step, str(path)]
            done = json.loads(subprocess.run(run, check=True, capture_output=True, text=True).stdout)
            print(f"{step:10s}{done['seconds']:8.1f} s{done['peak']:8.2f} GiB")


if __name__ == "__main__":
    main()
