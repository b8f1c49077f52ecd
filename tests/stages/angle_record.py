"""The test of an angle bracket that CalculiX made: `python -m benchmarks.angle_by_calculix` writes data/angle.npz anew.

CalculiX has 8544 C3D10 where the deck of the repository, meshes/angle.bdf.gz, has 356 hex20, a modulus 3 % below that of the
deck, and 1.2 % of damping where 1 % is stated. It finds 40 modes and follows them in time (*MODAL DYNAMIC, which is exact for
loads that are straight between samples). A gauge reads how much the distance of two nodes changes, over that distance: the mean
strain along its grid. No code of strainsight is used.

Two records: `alone`, an unknown load at a corner of the free end, and `shaken`, the same with a known shaker on the upright part.
"""

from __future__ import annotations

import runpy
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

MESHES = Path(__file__).parents[2] / "meshes"
DATA = Path(__file__).parent / "data" / "angle.npz"
GUESS, SOFTER, NU, DENSITY = 2.1e5, 0.97, 0.3, 7.85e-9
"""E [MPa] of the deck, what the truth has of it; ν; ρ [t/mm³]."""
DAMPING, MODES = 0.012, 40
RATE, DURATION = 1000.0, 1.2
"""Samples a second, length [s]."""
BAND, RMS = (2.0, 40.0), 150.0
"""Of the unknown random load [Hz, N]."""
SHOCK = (0.6, 0.012, 900.0)
"""Start [s], length [s], height [N] of the half sine on it."""
SHAKER = (70.0, 140.0, 60.0)
"""Band [Hz] and RMS [N] of the known load."""
DIRECTIONS = {"tip": (0.0, 0.0, -1.0), "shaker": (1.0, 0.0, 0.0)}
NODE_SETS = {"tip": 22, "shaker": 23}
STEP = 5e-9
"""Strain of the last digit that is kept, half a per cent of the noise."""

# s, y [mm] of the middle, face (1: outside), half steps of the fine mesh along s and y from the middle to the grid's ends
GAUGES = (
    (98.0, 0.0, 1, (1, 0)),
    (124.0, 12.5, -1, (1, 0)),
    (137.0, -12.5, -1, (1, 1)),
    (197.0, 18.75, 1, (1, 0)),
    (215.0, -6.25, 1, (1, 1)),
    (25.0, -30.0, 1, (1, 0)),
)
POINTS = (
    (14.6, 28.0, 1, (1, 0)),
    (14.6, -12.5, -1, (1, 0)),
    (20.4, 12.5, 1, (1, 0)),
    (20.4, 0.0, -1, (1, 1)),
    (60.0, 30.0, 1, (1, 0)),
    (60.0, -30.0, -1, (1, 0)),
    (50.0, 30.0, -1, (1, 0)),
    (95.0, 18.75, 1, (1, 0)),
    (95.0, -18.75, -1, (1, 0)),
    (101.0, 6.25, -1, (1, -1)),
    (111.0, -12.5, 1, (1, 0)),
    (111.0, 12.5, -1, (1, 1)),
    (118.0, 0.0, 1, (1, -1)),
    (131.0, 6.25, 1, (1, 0)),
    (137.0, 18.75, -1, (1, 0)),
    (193.0, -12.5, 1, (1, 0)),
    (203.0, 0.0, -1, (1, 0)),
    (209.0, 12.5, -1, (1, 1)),
    (221.0, 6.25, 1, (1, 0)),
    (227.0, -12.5, -1, (1, -1)),
)


@dataclass(frozen=True)
class Span:
    """A grid between two nodes: ends (2,) indices of the fine mesh, position (3,) of its middle, direction (3,), length [mm]."""

    ends: tuple[int, int]
    position: np.ndarray
    direction: np.ndarray
    length: float


@cache
def meshes() -> dict[str, Any]:
    return runpy.run_path(str(MESHES / "make_angle.py"))


@cache
def plate() -> Any:
    """The mesh of CalculiX, half the size of the deck's."""
    return meshes()["solids"](2)


def spans(places: tuple) -> list[Span]:
    """Grids about the nodes of the fine mesh nearest to these places."""
    fine, found = plate(), []
    for s, y, face, steps in places:
        block, (i, j) = min(
            ((b, np.unravel_index(k, b.shape)) for b in fine.faces for k in [np.argmin(_away(fine, b, s, y))]),
            key=lambda own: _away(fine, own[0], s, y)[own[1]],
        )
        ends = [int(_on_face(fine, block[i + sign * steps[0], j + sign * steps[1]], face)) for sign in (-1, 1)]
        first, last = fine.position[ends]
        length = float(np.linalg.norm(last - first))
        found.append(Span((ends[0], ends[1]), (first + last) / 2, (last - first) / length, length))
    return found


def _away(fine: Any, block: np.ndarray, s: float, y: float) -> np.ndarray:
    """Distance of the inner nodes of a lattice, infinite at its rim, where a neighbour is missing."""
    far = np.full(block.shape, np.inf)
    inner = block[1:-1, 1:-1]
    far[1:-1, 1:-1] = np.hypot(fine.flat[inner, 0] - s, fine.flat[inner, 1] - y)
    return far


def _on_face(fine: Any, node: np.ndarray, face: int) -> np.ndarray:
    """The node itself, or the one behind it on the other face."""
    if face > 0:
        return node
    other = fine.flat[node] * (1, 1, -1)
    return np.argmin(np.linalg.norm(fine.flat - other, axis=1))


def banded(low: float, high: float, rms: float, seed: int) -> np.ndarray:
    """Noise between two frequencies [Hz], with nothing in the first samples: (n,)."""
    n = round(RATE * DURATION) + 1
    rng = np.random.default_rng(seed)
    frequency = np.fft.rfftfreq(2 * n, 1 / RATE)
    inside = (frequency >= low) & (frequency <= high)
    spectrum = inside * (rng.standard_normal(len(frequency)) + 1j * rng.standard_normal(len(frequency)))
    series = np.fft.irfft(spectrum)[:n]
    # from rest: begins smoothly within 20 ms
    rise = np.clip(np.arange(n) / RATE / 0.02, 0, 1)
    return rms * series / series.std() * (3 * rise**2 - 2 * rise**3)


def loads() -> dict[str, np.ndarray]:
    """True histories [N] at the samples, the first of which is 0 s."""
    tip = banded(*BAND, RMS, seed=1)
    start, length, height = SHOCK
    time = np.arange(len(tip)) / RATE - start
    tip += height * np.sin(np.pi * np.clip(time / length, 0, 1))
    return {"tip": tip, "shaker": banded(*SHAKER, seed=2)}


def stored() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Frequencies [Hz], and of each record the strain (samples, gauges and points)."""
    with np.load(DATA) as kept:
        return kept["frequency"], {name: STEP * np.cumsum(kept[name].T, axis=0) for name in ("alone", "shaken")}
