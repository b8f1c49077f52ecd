"""The composite wing of tests/stages/wing_record.py by CalculiX: `python -m benchmarks.wing_by_calculix CCX` writes its data.

Quadratic shells (S8R, plies as layers of one element) on a mesh of its own; stringers are blades that stand on the skins, where
the deck has bars. CalculiX finds the modes and what each load does at rest; gauges read the strain at the points of integration
of the element below them, linear from there to their place on its face. No code of strainsight is used.
"""

from __future__ import annotations

import runpy
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

RECORD = SimpleNamespace(
    **runpy.run_path(str(Path(__file__).resolve().parents[1] / "tests" / "stages" / "wing_record.py"))
)
LOADS, MODES, SOFTER, GUESS, DIVISIONS = RECORD.LOADS, RECORD.MODES, RECORD.SOFTER, RECORD.GUESS, RECORD.DIVISIONS
FINER = (24, 96, 8)
"""Divisions of the mesh of CalculiX."""
LAYUPS = runpy.run_path(str(RECORD.MESHES / "make_wing.py"))["LAYUPS"]
LARGER = 1000.0
"""Static loads of CalculiX, for the digits that it prints."""

GAUGES = (
    (71, True, 0.0),
    (85, True, 0.0),
    (78, False, 0.0),
    (459, True, 45.0),
    (470, False, 45.0),
    (839, True, -45.0),
    (849, True, 0.0),
    (1038, False, 0.0),
)
"""Element of a skin, whether its upper face, angle to the span on it [°]: middles of elements in the inner two thirds."""


def responses(places: Sequence[Any], ccx: str, divisions: tuple[int, int, int] = FINER) -> Any:
    """Of the wing with another E1, by CalculiX."""
    wing = _read(RECORD.deck_text(divisions))
    below = [_below(place, wing) for place in places]
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "wing.inp").write_text(_input(wing, sorted(set(below))))
        subprocess.run([ccx, "-i", "wing"], cwd=folder, check=True, capture_output=True, timeout=7200)
        said = (Path(folder) / "wing.dat").read_text()
    n, m = len(LOADS), MODES
    points, strains, motions = (_tables(said, word) for word in ("global coordinates", "strains", "displacements"))
    frequency = [float(row[3]) for row in map(str.split, said.splitlines()) if len(row) == 5 and _is_mode(row)][:m]
    read = np.array(
        [
            [_strain(place, element, at, own) for place, element in zip(places, below, strict=True)]
            for at, own in zip(points, strains, strict=True)
        ]
    )
    force = np.zeros((m, n))
    for i, (node, card, axis) in enumerate(LOADS.values()):
        own = _spread(wing, node, card, axis)
        for k in range(m):
            moved = {int(row[0]): row[1:4] for row in motions[n + k]}
            force[k, i] = sum(moved[id] @ f for id, f in own.items())
    return RECORD.Responses(np.array(frequency), force, read[n:].T, read[:n].T / LARGER)


def main(ccx: str) -> None:
    """Write data/wing.npz."""
    wing, places = _read(RECORD.deck_text()), []
    for element, up, angle in GAUGES:
        half, nodes = wing.half(element), wing.quads[element][1]
        x = np.array([wing.grid[node] for node in nodes])
        n = np.cross(x[2] - x[0], x[3] - x[1])
        n *= (1 if n[2] > 0 else -1) * (1 if up else -1) / np.linalg.norm(n)
        span = np.array([0.0, 1.0, 0.0]) - n[1] * n
        d = np.cos(np.radians(angle)) * span + np.sin(np.radians(angle)) * np.cross(n, span)
        places.append(RECORD.Place(element, x.mean(axis=0) + half * n, n, d / np.linalg.norm(d)))
    own = responses(places, ccx)
    vectors: dict[str, Any] = {
        name: np.array([getattr(place, name) for place in places]) for name in ("position", "normal", "direction")
    }
    np.savez_compressed(RECORD.DATA, element=[place.element for place in places], **vectors, **vars(own))


@dataclass(frozen=True)
class Wing:
    """Of the deck: nodes [mm]; elements with property and nodes; bars as both nodes and their offset along z; nodes that a
    reference node is the average of; nodes that are held; x of the plies."""

    grid: dict[int, np.ndarray]
    quads: dict[int, tuple[int, list[int]]]
    bars: list[tuple[int, int, float]]
    averages: dict[int, list[int]]
    held: list[int]
    axis: np.ndarray

    def half(self, element: int) -> float:
        """Half the thickness [mm]."""
        angles, ply = LAYUPS[self.quads[element][0]]
        return len(angles) * ply


def _read(deck: str) -> Wing:
    rows: list[list[str]] = []
    for line in deck.splitlines():
        if line.startswith(","):
            rows[-1] += line.split(",")[1:]
        else:
            rows.append(line.split(","))

    def of(card: str) -> list[list[str]]:
        return [row for row in rows if row[0] == card]

    def nodes(row: list[str], start: int) -> list[int]:
        return [int(own) for own in row[start:] if own]

    (axes,) = of("CORD2R")
    root, up, along = (np.array(axes[i : i + 3], dtype=float) for i in (3, 6, 9))
    z = (up - root) / np.linalg.norm(up - root)
    x = along - root - ((along - root) @ z) * z
    return Wing(
        {int(row[1]): np.array(row[3:6], dtype=float) for row in of("GRID")},
        {int(row[1]): (int(row[2]), [int(n) for n in row[3:7]]) for row in of("CQUAD4")},
        [(int(row[3]), int(row[4]), float(row[13])) for row in of("CBAR")],
        {int(row[3]): nodes(row, 7) for row in of("RBE3")},
        [n for row in of("SPC1") for n in nodes(row, 3)],
        x / np.linalg.norm(x),
    )


def _input(wing: Wing, watched: Sequence[int]) -> str:
    """Input of CalculiX: S8R of straight sides, laminates by the axes of their elements, blades for bars; loads and modes."""
    used = {node for _, ring in wing.quads.values() for node in ring}
    grid, middle = {node: wing.grid[node] for node in used}, {}

    def with_middles(ring: Sequence[int]) -> list[int]:
        for a, b in zip(ring, [*ring[1:], ring[0]], strict=True):
            if (min(a, b), max(a, b)) not in middle:
                middle[min(a, b), max(a, b)] = max(grid) + 1
                grid[max(grid) + 1] = (grid[a] + grid[b]) / 2
        return [*ring, *(middle[min(a, b), max(a, b)] for a, b in zip(ring, [*ring[1:], ring[0]], strict=True))]

    rings = {element: with_middles(ring) for element, (_, ring) in wing.quads.items()}
    edge: dict[tuple[int, float], int] = {}
    blades = []
    for first, last, z in wing.bars:
        for node in (first, last):
            if (node, z) not in edge:
                edge[node, z] = max(grid) + 1
                grid[max(grid) + 1] = grid[node] + [0.0, 0.0, 2 * z]
        blades.append(with_middles([first, last, edge[last, z], edge[first, z]]))
    lines = ["*NODE", *(f"{id},{x[0]:.9g},{x[1]:.9g},{x[2]:.9g}" for id, x in grid.items())]
    lines += ["*ELEMENT,TYPE=S8R,ELSET=ALL", *(",".join(map(str, (id, *ring))) for id, ring in rings.items())]
    lines += ["*ELEMENT,TYPE=S8R,ELSET=BLADES"]
    lines += [",".join(map(str, (id, *ring))) for id, ring in enumerate(blades, start=max(rings) + 1)]
    lines += ["*MATERIAL,NAME=ALUMINIUM", "*ELASTIC", "7.2E4,0.33", "*DENSITY", "2.8E-9"]
    lines += ["*SHELL SECTION,ELSET=BLADES,MATERIAL=ALUMINIUM", "3.0"]
    lines += ["*MATERIAL,NAME=PLY", "*ELASTIC,TYPE=ENGINEERING CONSTANTS"]
    lines += [f"{SOFTER * GUESS},9.E3,9.E3,0.3,0.3,0.3,4.8E3,4.8E3", "3.2E3,294.", "*DENSITY", "1.55E-9"]
    alike: dict[tuple[float, ...], list[int]] = {}
    for element, (region, ring) in wing.quads.items():
        x = np.array([wing.grid[node] for node in ring])
        n = np.cross(x[2] - x[0], x[3] - x[1])
        n /= np.linalg.norm(n)
        a = wing.axis - (wing.axis @ n) * n
        alike.setdefault((region, *np.round(a / np.linalg.norm(a), 4), *np.round(n, 4)), []).append(element)
    sections = []
    for number, (key, elements) in enumerate(alike.items()):
        angles, ply = LAYUPS[int(key[0])]
        a, n = np.array(key[1:4]), np.array(key[4:])
        for angle in sorted(set(angles)):
            c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
            along, across = c * a + s * np.cross(n, a), c * np.cross(n, a) - s * a
            axes = ",".join(f"{v:.7f}" for v in (*along, *across))
            lines += [f"*ORIENTATION,NAME=O{number}A{angle + 90}", axes]
        sections += [f"*ELSET,ELSET=E{number}", *(f"{id}," for id in elements)]
        sections += [f"*SHELL SECTION,ELSET=E{number},COMPOSITE"]
        sections += [f"{ply},,PLY,O{number}A{angle + 90}" for angle in (*angles, *reversed(angles))]
    root = [id for id, x in grid.items() if abs(x[1]) < 1e-9]
    lines += [*sections, "*BOUNDARY", *(f"{id},1,6" for id in root)]
    lines += ["*ELSET,ELSET=WATCHED", *(f"{id}," for id in watched)]
    loaded = sorted({id for ids in wing.averages.values() for id in ids})
    lines += ["*NSET,NSET=LOADED", *(f"{id}," for id in loaded)]
    said = ["*EL PRINT,ELSET=WATCHED,GLOBAL=YES", "E,COORD", "*NODE PRINT,NSET=LOADED", "U", "*END STEP"]
    for load in LOADS.values():
        spread = _spread(wing, *load)
        forces = [
            f"{id},{c + 1},{LARGER * f[c]:.12g}" for id, f in spread.items() for c in range(3) if abs(f[c]) > 1e-15
        ]
        lines += ["*STEP", "*STATIC", "*CLOAD,OP=NEW", *forces, *said]
    return "\n".join([*lines, "*STEP", "*FREQUENCY", str(MODES), *said, ""])


def _spread(wing: Wing, node: int, card: str, axis: Sequence[float]) -> dict[int, np.ndarray]:
    """Forces of a unit load on the nodes whose average `node` is: F/k, and ω × r of a moment."""
    ids = wing.averages[node]
    r = np.array([wing.grid[id] for id in ids])
    r -= r.mean(axis=0)
    if card == "FORCE":
        return {id: np.array(axis) / len(ids) for id in ids}
    inertia = sum(np.dot(own, own) * np.eye(3) - np.outer(own, own) for own in r)
    omega = np.linalg.solve(inertia, axis)
    return {id: np.cross(omega, own) for id, own in zip(ids, r, strict=True)}


def _below(place: Any, wing: Wing) -> int:
    """The element whose middle is nearest, of those that a gauge could lie on."""
    best = (np.inf, 0)
    for element, (_, ring) in wing.quads.items():
        x = np.array([wing.grid[node] for node in ring])
        n = np.cross(x[2] - x[0], x[3] - x[1])
        n *= np.sign(n @ place.normal) / np.linalg.norm(n)
        off = x.mean(axis=0) + wing.half(element) * n - place.position
        if n @ place.normal > 0.95 and abs(off @ n) < 1.5:
            best = min(best, (float(np.linalg.norm(off)), element))
    return best[1]


def _strain(place: Any, element: int, points: np.ndarray, strains: np.ndarray) -> float:
    """Along the gauge: least squares over the points of the element, linear along it at every height."""
    own = points[:, 0] == element
    d = place.direction
    E = strains[own, 2:8]
    seen = E[:, :3] @ d**2 + 2 * (E[:, 3] * d[0] * d[1] + E[:, 4] * d[0] * d[2] + E[:, 5] * d[1] * d[2])
    local = (points[own, 2:5] - place.position) @ np.stack([d, np.cross(place.normal, d), place.normal], axis=1)
    x, y, z = (local / np.abs(local).max(axis=0)).T
    P = np.stack([np.ones_like(x), x, y], axis=1)
    return float(np.linalg.lstsq(np.concatenate([P, P * z[:, None]], axis=1), seen, rcond=None)[0][0])


def _tables(said: str, word: str) -> list[np.ndarray]:
    """Tables of results with this word in their heading, in order."""
    found: list[list[list[float]]] = []
    inside = False
    for line in said.splitlines():
        row = line.split()
        if row and not row[0].isdigit():
            inside = word in line
            if inside:
                found.append([])
        elif row and inside:
            found[-1].append([float(value) for value in row])
    return [np.array(own) for own in found]


def _is_mode(row: list[str]) -> bool:
    return row[0].isdigit() and all("E" in value for value in row[1:])


if __name__ == "__main__":
    main(sys.argv[1])
