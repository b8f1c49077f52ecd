"""Cost of the finite elements against size: `python -m benchmarks.fem [--most UNKNOWNS] [DECK …]`.

Import of a deck, K and M, factorisation, 20 modes: seconds each, size of the factor and peak memory, every size in its own
process. The sizes are thick spherical shells of curved tet10, from 10 000 unknowns to --most (1 000 000 unless told), beside
them meshes/hub-coarse.bdf.gz and the decks named, such as a finer hub by meshes/make_hub.py. The peers run on the small
sizes: scikit-fem for K and M on as many curved tet10, SciPy's SuperLU for the factor. What does not fit into memory is said.
At the end the exponents p of cost ~ size^p. Machines differ and are shared: read the load beside the times.
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
from collections.abc import Callable
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
SHELLS = ((2, 12), (3, 18), (5, 27), (8, 39), (12, 57))
"""Elements through the wall and along each side: 9 400 to 992 000 unknowns less the clamped ones."""
STEPS = ("import", "K and M", "factor", "20 modes")
PEER_LIMIT, REPEATED = 35_000, 50_000
GIB = 1024.0**3


def shell(layers: int, along: int) -> tuple[np.ndarray, np.ndarray]:
    """A quarter of a hollow sphere of radii 0.35 and 0.5 m: positions (n, 3) and tet10 (e, 10) in Nastran's order.

    Cubes cut into six tetrahedra each; nodes stand on the half steps of the grid, mid-side nodes on curved sides.
    """
    half = np.array([2 * along, 2 * along, 2 * layers])
    number = np.arange(np.prod(half + 1)).reshape(half + 1)
    u, v, w = (a.ravel() for a in np.meshgrid(*(np.linspace(-1, 1, h + 1) for h in half), indexing="ij"))
    direction = np.stack([np.tan(np.pi / 4 * u), np.tan(np.pi / 4 * v), np.ones_like(u)], axis=1)
    position = (0.425 + 0.075 * w)[:, None] * direction / np.linalg.norm(direction, axis=1)[:, None]
    cube = np.stack(np.meshgrid(*(np.arange(0, h, 2) for h in half), indexing="ij"), axis=-1).reshape(-1, 3)
    cells = []
    for order in permutations(range(3)):
        corner = np.concatenate([np.zeros((1, 3), int), np.cumsum(2 * np.eye(3, dtype=int)[list(order)], axis=0)])
        if np.linalg.det(corner[1:]) < 0:
            corner = corner[[0, 2, 1, 3]]
        middle = [(corner[a] + corner[b]) // 2 for a, b in ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))]
        places = cube[:, None] + np.concatenate([corner, middle])
        cells.append(number[places[..., 0], places[..., 1], places[..., 2]])
    return position, np.concatenate(cells)


def write_deck(path: Path, layers: int, along: int) -> None:
    """The shell as a Nastran deck, clamped along one rim."""
    position, cells = shell(layers, along)
    rim = np.arange((2 * along + 1) * (2 * layers + 1)) + 1
    with path.open("w", encoding="ascii") as deck:
        deck.write("BEGIN BULK\nMAT1           1 1.7E+11            .275   7100.\nPSOLID         1       1\n")
        for node, (x, y, z) in enumerate(position, start=1):
            deck.write(f"GRID*   {node:16d}{'':16s}{x:16.10f}{y:16.10f}\n*       {z:16.10f}\n")
        for element, nodes in enumerate(cells + 1, start=1):
            fields = "".join(f"{n:8d}" for n in nodes)
            deck.write(f"CTETRA  {element:8d}       1{fields[:48]}\n+       {fields[48:]}\n")
        deck.write(f"SPC1           1     123{rim[0]:8d}    THRU{rim[-1]:8d}\nENDDATA\n")


def resident() -> float:
    """[GiB] of this process now; none where the system does not say."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / GIB
    except OSError:
        return float("nan")


def timed(step: Callable[[], Any], repeats: int = 1) -> tuple[float, Any]:
    """Best wall time of so many, and the last result."""
    best, result = np.inf, None
    for _ in range(repeats):
        result = None
        start = time.perf_counter()
        result = step()
        best = min(best, time.perf_counter() - start)
    return best, result


def measure(deck: Path) -> dict[str, float]:
    """All steps on one deck, in this process."""
    from strainsight.decks.reader import read_mesh
    from strainsight.fem.factorisation import factorise
    from strainsight.fem.model import build_model
    from strainsight.fem.modes import modes

    found: dict[str, float] = {}
    found["import"], mesh = timed(lambda: read_mesh(deck))
    repeats = 3 if 3 * len(mesh.position) < REPEATED else 1
    found["K and M"], model = timed(lambda: build_model(mesh), repeats)
    found["unknowns"] = model.size
    K, M = model.stiffness.constant, model.mass.constant
    if repeats > 1:
        factorise(K)  # loads the library
    before = resident()
    found["factor"], factor = timed(lambda: factorise(K), repeats)
    found["factor GiB"] = resident() - before
    found["20 modes"], _ = timed(lambda: modes(K, M, 20, factor=factor), repeats)
    found["peak GiB"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / GIB
    found["load"] = os.getloadavg()[0]
    if model.size < PEER_LIMIT:
        found["scikit-fem"] = timed(scikit_fem(mesh))[0]
        sys.modules["pypardiso"] = None  # type: ignore[assignment]  # so that the package falls back to SuperLU
        found["SuperLU"] = timed(lambda: factorise(K), repeats)[0]
    return found


def scikit_fem(mesh: Any) -> Callable[[], tuple[Any, Any]]:
    """What assembles K and M of as many tetrahedra of second order by the peer, with as many quadrature points."""
    import skfem
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    corners = mesh.blocks[0].nodes[:, :4]
    used, local = np.unique(corners, return_inverse=True)
    other = skfem.MeshTet2.from_mesh(skfem.MeshTet(mesh.position[used].T, local.reshape(-1, 4).T))
    element = skfem.ElementVector(skfem.ElementTetP2())

    @skfem.BilinearForm
    def inertia(u: Any, v: Any, w: Any) -> Any:
        return 7100.0 * (u[0] * v[0] + u[1] * v[1] + u[2] * v[2])

    def both() -> tuple[Any, Any]:
        stiffness = linear_elasticity(*lame_parameters(1.7e11, 0.275))
        return (
            stiffness.assemble(skfem.Basis(other, element, intorder=2)),
            inertia.assemble(skfem.Basis(other, element, intorder=5)),
        )

    return both


def row(name: str, deck: Path) -> dict[str, float] | None:
    """Measure in a process of its own and print a line; None where it does not fit."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", __file__, "--measure", str(deck)], capture_output=True, text=True
    )
    if done.returncode:
        why = (done.stderr.strip() or f"ended with code {done.returncode}").splitlines()
        print(f"{name:22s} left out: {next((line for line in reversed(why) if 'Error' in line), why[-1])}", flush=True)
        return None
    found: dict[str, float] = json.loads(done.stdout)
    total = sum(found[step] for step in STEPS)
    print(
        f"{name:22s} {found['unknowns']:9.0f} "
        + " ".join(f"{found[step]:9.2f}" for step in STEPS)
        + f" {total:9.2f} {found['factor GiB']:9.2f} {found['peak GiB']:9.2f} {found['load']:6.1f}",
        flush=True,
    )
    return found


def main(most: int, decks: list[Path]) -> None:
    print(
        f"{os.cpu_count()} processors; seconds of wall time, the best of three below {REPEATED} unknowns; memory in GiB"
    )
    print(
        f"{'':22s} {'unknowns':>9s} "
        + " ".join(f"{s:>9s}" for s in (*STEPS, "sum", "factor", "peak"))
        + f" {'load':>6s}"
    )
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for layers, along in SHELLS:
            if 3 * (2 * along + 1) ** 2 * (2 * layers + 1) <= 1.05 * most:
                deck = Path(folder) / "shell.bdf"
                write_deck(deck, layers, along)
                rows.append(row(f"shell {layers} × {along} × {along}", deck))
    for deck in (ROOT / "meshes" / "hub-coarse.bdf.gz", *decks):
        row(deck.name, deck)
    fitted = [found for found in rows if found]
    if len(fitted) > 1:
        size = np.log([found["unknowns"] for found in fitted])
        print("shells: cost ~ size^p with p =", end="")
        for key in (*STEPS, "factor GiB", "peak GiB"):
            print(f"  {key} {np.polyfit(size, np.log([max(found[key], 1e-9) for found in fitted]), 1)[0]:.2f}", end="")
        print()
    for found in fitted:
        if "SuperLU" in found:
            print(
                f"peers at {found['unknowns']:.0f} unknowns: K and M by scikit-fem {found['scikit-fem']:.2f} s "
                f"({found['scikit-fem'] / found['K and M']:.1f} times as long), factor by SuperLU {found['SuperLU']:.2f} s "
                f"({found['SuperLU'] / found['factor']:.0f} times as long)"
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("decks", nargs="*", type=Path, metavar="DECK")
    parser.add_argument("--most", type=int, default=1_000_000, metavar="UNKNOWNS")
    parser.add_argument("--measure", type=Path, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.measure:
        print(json.dumps(measure(chosen.measure)))
    else:
        main(chosen.most, chosen.decks)
