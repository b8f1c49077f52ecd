"""The record of a composite wing that MYSTRAN made: `python tests/stages/wing_record.py MYSTRAN` writes data/wing.npz anew.

MYSTRAN reads the deck of meshes/make_wing.py with its plies, E1 of them 5 % below that of the deck. It finds 30 modes and what
each load moves at rest; gauges read the gradient of the bilinear displacement of the element below them, on its face, from the
displacements and rotations that MYSTRAN prints. Modes follow loads that are straight between samples exactly, with 1.7 %
of damping where 2 % is stated, and what the others add is at rest. No code of strainsight is used.

Three loads at the tip are unknown, up, back and a torque; a shaker at half span is known.
"""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

MESHES = Path(__file__).parents[2] / "meshes"
DATA = Path(__file__).parent / "data" / "wing.npz"
DIVISIONS = (12, 48, 4)
GUESS, SOFTER = 1.3e5, 0.95
"""E1 [MPa] of the deck, what the truth has of it."""
DAMPING, MODES = 0.017, 30
RATE, DURATION = 500.0, 2.0
"""Samples a second, length [s]."""
LOADS = {
    "lift": (2, "FORCE", (0.0, 0.0, 1.0)),
    "drag": (2, "FORCE", (1.0, 0.0, 0.0)),
    "twist": (2, "MOMENT", (0.0, 1.0, 0.0)),
    "shaker": (3, "FORCE", (0.0, 0.0, 1.0)),
}
"""Node, card, direction."""
SIZES = {"lift": 200.0, "drag": 70.0, "twist": 4.0e4, "shaker": 40.0}
"""RMS [N, N mm]."""
CASE = """\
mesh: {file: wing.bdf, length_unit: mm, mass_unit: t}
parameters:
  E1: {property: e1, region: [1, 2, 3], guess: 1.3e+11, range: [1.1e+11, 1.5e+11]}
loads:
  lift: {node: 2, direction: [0, 0, 1], known: false, process_noise: {model: integrated_random_walk, frequency: 4.0},
         signal: {type: multisine, lowest: 0.5, highest: 4.0, count: 8, amplitude: 280}}
  drag: {node: 2, direction: [1, 0, 0], known: false, process_noise: {model: integrated_random_walk, frequency: 4.0},
         signal: {type: multisine, lowest: 0.5, highest: 4.0, count: 8, amplitude: 100}}
  twist: {node: 2, moment: [0, 1, 0], known: false, process_noise: {model: integrated_random_walk, frequency: 4.0},
         signal: {type: multisine, lowest: 0.5, highest: 4.0, count: 8, amplitude: 56}}
  shaker: {node: 3, direction: [0, 0, 1], known: true,
           signal: {type: multisine, lowest: 15.0, highest: 60.0, count: 20, amplitude: 56}}
damping: {type: modal, ratio: 0.02}
rom: {modes: 6, parameter_samples: 3, tolerance: 1.0e-4}
"""
"""Mesh, unknowns, loads, damping and reduction of a config."""
BANDS = {"lift": (0.5, 4.0), "drag": (0.5, 4.0), "twist": (0.5, 4.0), "shaker": (15.0, 60.0)}
"""[Hz]"""

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


@dataclass(frozen=True)
class Place:
    """A gauge on an element (id): position (3,) of its middle [mm], normal (3,) out of the face, direction (3,)."""

    element: int
    position: np.ndarray
    normal: np.ndarray
    direction: np.ndarray


@dataclass(frozen=True)
class Responses:
    """frequency (m,) [Hz]; of modes of unit mass (t mm²): force (m, loads), strain (gauges, m); static (gauges, loads): strain
    under a newton or a newton millimetre at rest."""

    frequency: np.ndarray
    force: np.ndarray
    strain: np.ndarray
    static: np.ndarray


def deck_text(divisions: tuple[int, int, int] = DIVISIONS) -> str:
    return str(runpy.run_path(str(MESHES / "make_wing.py"))["deck"](*divisions, composite=True))


def responses(deck: str, places: Sequence[Place], mystran: Path, softer: float = SOFTER) -> Responses:
    """Of the deck with another E1, by two runs of MYSTRAN."""
    grid, quads = _read(deck)
    seen = sorted({2, 3, *(node for place in places for node in quads[place.element][1])})
    bulk = deck[deck.index("BEGIN BULK") :]
    assert "MAT8,2,1.3+5," in bulk
    bulk = bulk.replace("MAT8,2,1.3+5,", f"MAT8,2,{softer * GUESS:.1f},")
    listed = ", ".join(map(str, seen))
    case = ["ECHO = NONE", "SPC = 1", *_wrapped(f"SET 1 = {listed}"), "DISP(PRINT) = 1"]
    cards = ["PARAM,SOLLIB,SPARSE", f"EIGRL,1,,,{MODES},,,,MASS"]
    for k, (node, card, axis) in enumerate(LOADS.values(), start=1):
        cards.append(f"{card},{k},{node},0,1.0,{','.join(map(str, axis))}")
    subcases = [line for k in range(1, len(LOADS) + 1) for line in (f"SUBCASE {k}", f"LOAD = {k}")]
    with tempfile.TemporaryDirectory() as folder:
        modes = _solved(mystran, Path(folder), "modes", ["SOL 103", "CEND", *case, "METHOD = 1"], cards, bulk)
        rest = _solved(mystran, Path(folder), "rest", ["SOL 101", "CEND", *case, *subcases], cards, bulk)
    shape, moved = _motions(modes, seen), _motions(rest, seen)
    frequency = [float(row[4]) for row in map(str.split, modes.splitlines()) if _is_frequency(row)]
    own = [seen.index(node) for node, _, _ in LOADS.values()]
    part = [axis if card == "FORCE" else (0.0, 0.0, 0.0, *axis) for _, card, axis in LOADS.values()]
    force = np.stack([shape[:, i, : len(a)] @ a for i, a in zip(own, part, strict=True)], axis=1)
    rows = [_row(place, grid, quads[place.element]) for place in places]
    strain, static = (
        np.stack([np.einsum("nk,mnk->m", row, field[:, [seen.index(node) for node in nodes]]) for nodes, row in rows])
        for field in (shape, moved)
    )
    return Responses(np.array(frequency), force, strain, static)


def record(own: Responses, histories: Mapping[str, np.ndarray]) -> np.ndarray:
    """Strain (samples, gauges) from rest; loads are straight between samples.

    Of q̈ + 2ζω q̇ + ω² q = f with f = f₀ + s t: q = (f − 2ζs/ω)/ω² − … + e^{−ζωt}(a cos ω_d t + b sin ω_d t).
    """
    f = np.stack([histories[name] for name in LOADS], axis=1)
    h, total = 1 / RATE, f @ (own.static - own.strain @ (own.force / (2 * np.pi * own.frequency[:, None]) ** 2)).T
    for frequency, by, seen in zip(own.frequency, own.force, own.strain.T, strict=True):
        w = 2 * np.pi * frequency
        decay, wd = DAMPING * w, w * np.sqrt(1 - DAMPING**2)
        c, s, e = np.cos(wd * h), np.sin(wd * h), np.exp(-decay * h)
        g = f @ by
        q, v = 0.0, 0.0
        for k in range(len(g) - 1):
            slope = (g[k + 1] - g[k]) / h
            start, rate = g[k] / w**2 - 2 * DAMPING * slope / w**3, slope / w**2
            a = q - start
            b = (v - rate + decay * a) / wd
            q = start + rate * h + e * (a * c + b * s)
            v = rate + e * ((wd * b - decay * a) * c - (wd * a + decay * b) * s)
            total[k + 1] += seen * q
    return total


def loads(seed: int = 1) -> dict[str, np.ndarray]:
    """Histories [N, N mm] of noise in a band, which begin smoothly from nothing."""
    n = round(RATE * DURATION) + 1
    rng, found = np.random.default_rng(seed), {}
    frequency = np.fft.rfftfreq(2 * n, 1 / RATE)
    rise = np.clip(np.arange(n) / RATE / 0.1, 0, 1)
    for name, (low, high) in BANDS.items():
        inside = (frequency >= low) & (frequency <= high)
        series = np.fft.irfft(inside * (rng.standard_normal(len(inside)) + 1j * rng.standard_normal(len(inside))))[:n]
        found[name] = SIZES[name] * series / series.std() * (3 * rise**2 - 2 * rise**3)
    return found


def stored() -> tuple[list[Place], Responses]:
    """Gauges and what MYSTRAN says of them."""
    with np.load(DATA) as kept:
        rows = zip(*(kept[name] for name in ("element", "position", "normal", "direction")), strict=True)
        own = Responses(*(kept[name] for name in ("frequency", "force", "strain", "static")))
        return [Place(int(element), *vectors) for element, *vectors in rows], own


def main(mystran: Path) -> None:
    """Write data/wing.npz."""
    deck, places = deck_text(), []
    grid, quads = _read(deck)
    for element, up, angle in GAUGES:
        half, nodes = quads[element]
        x = np.array([grid[node] for node in nodes])
        n = np.cross(x[2] - x[0], x[3] - x[1])
        n *= (1 if n[2] > 0 else -1) * (1 if up else -1) / np.linalg.norm(n)
        span = np.array([0.0, 1.0, 0.0]) - n[1] * n
        d = np.cos(np.radians(angle)) * span + np.sin(np.radians(angle)) * np.cross(n, span)
        places.append(Place(element, x.mean(axis=0) + half * n, n, d / np.linalg.norm(d)))
    own = responses(deck, places, mystran)
    vectors = {
        name: np.array([getattr(place, name) for place in places]) for name in ("position", "normal", "direction")
    }
    np.savez_compressed(DATA, element=[place.element for place in places], **vectors, **vars(own))


def _read(deck: str) -> tuple[dict[int, np.ndarray], dict[int, tuple[float, list[int]]]]:
    """Nodes; elements with half their thickness."""
    rows = [line.split(",") for line in deck.splitlines()]
    grid = {int(row[1]): np.array(row[3:6], dtype=float) for row in rows if row[0] == "GRID"}
    layups = runpy.run_path(str(MESHES / "make_wing.py"))["LAYUPS"]
    half = {number: len(angles) * ply for number, (angles, ply) in layups.items()}
    return grid, {int(row[1]): (half[int(row[2])], [int(n) for n in row[3:7]]) for row in rows if row[0] == "CQUAD4"}


def _row(place: Place, grid: Mapping[int, np.ndarray], quad: tuple[float, list[int]]) -> tuple[list[int], np.ndarray]:
    """Nodes and what of their motions (4, 6) is strain: d·∇u·d of u = Σ N_a (u_a + θ_a × h n) at the gauge."""
    half, nodes = quad
    x = np.array([grid[node] for node in nodes])
    n = np.cross(x[2] - x[0], x[3] - x[1])
    n *= np.sign(n @ place.normal) / np.linalg.norm(n)
    arm = half * n
    one = (x[1] + x[2] - x[0] - x[3]) / 2
    one = (one - (one @ n) * n) / np.linalg.norm(one - (one @ n) * n)
    axes = np.stack([one, np.cross(n, one)])
    flat, at = (x + arm - place.position) @ axes.T, np.zeros(2)
    sign = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    for _ in range(20):
        N = (1 + sign[:, 0] * at[0]) * (1 + sign[:, 1] * at[1]) / 4
        slopes = sign * (1 + sign[:, ::-1] * at[::-1]) / 4
        J = slopes.T @ flat
        at = at - np.linalg.solve(J.T, N @ flat)
    assert np.abs(at).max() < 1.001, f"the gauge does not lie on element {place.element}"
    d = axes @ place.direction
    along = np.linalg.solve(J, slopes.T).T @ (d / np.linalg.norm(d))
    t = axes.T @ d / np.linalg.norm(d)
    # t · (θ × a) = θ · (a × t)
    return nodes, np.concatenate([along[:, None] * t, along[:, None] * np.cross(arm, t)], axis=1)


def _solved(mystran: Path, folder: Path, name: str, case: list[str], cards: list[str], bulk: str) -> str:
    first, rest = bulk.split("\n", 1)
    (folder / f"{name}.bdf").write_text("\n".join([*case, first, *cards, rest]))
    subprocess.run([mystran, f"{name}.bdf"], cwd=folder, check=True, capture_output=True, timeout=3600)
    return (folder / f"{name}.F06").read_text()


def _motions(said: str, seen: Sequence[int]) -> np.ndarray:
    """(modes or subcases, nodes, 6)."""
    number = r"\s+(-?\d\.\d+(?:E[+-]\d+)?)"
    rows = re.findall(rf"^\s+(\d+)\s+0{number * 6}\s*$", said, flags=re.MULTILINE)
    values = np.array([[float(value) for value in row[1:]] for row in rows if int(row[0]) in set(seen)])
    assert [int(row[0]) for row in rows][: len(seen)] == list(seen)
    return values.reshape(-1, len(seen), 6)


def _is_frequency(row: list[str]) -> bool:
    return len(row) == 7 and row[0].isdigit() and row[1].isdigit() and "E" in row[2]


def _wrapped(line: str) -> list[str]:
    """Case control in lines of eight entries."""
    parts = line.split(", ")
    rows = [", ".join(parts[i : i + 8]) for i in range(0, len(parts), 8)]
    return [row + ("," if i + 1 < len(rows) else "") for i, row in enumerate(rows)]


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
