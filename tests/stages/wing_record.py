"""The record of a composite wing that CalculiX made: `python -m benchmarks.wing_by_calculix CCX` writes data/wing.npz anew.

The wing of meshes/make_wing.py in plies without its store, E1 of them 5 % below that of the deck. CalculiX finds 30 modes, which
follow loads that are straight between samples exactly, with 1.7 % of damping where 2 % is stated, and what the others add is at
rest. No code of strainsight is used.

Three loads at the tip are unknown, up, back and a torque; a shaker at half span is known.
"""

from __future__ import annotations

import re
import runpy
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.linalg import eigh

MESHES = Path(__file__).parents[2] / "meshes"
DATA = Path(__file__).parent / "data" / "wing.npz"
DIVISIONS = (12, 48, 4)
"""Of the deck."""
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
"""Node, kind, direction."""
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
    """The deck without its store."""
    deck = str(runpy.run_path(str(MESHES / "make_wing.py"))["deck"](*divisions, composite=True))
    return re.sub(r"^(GRID,4,|RBE2,|CONM2,).*\n", "", deck, flags=re.MULTILINE)


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


def with_tip_mass(own: Responses, mass: float) -> Responses:
    """The wing with a point mass [t] at the tip that moves up and back: eigenvectors of I + m φφᵀ among the modes."""
    at_tip = own.force[:, :2]
    square, of_modes = eigh(np.diag(own.frequency**2), np.eye(len(at_tip)) + mass * at_tip @ at_tip.T)
    return replace(own, frequency=np.sqrt(square), force=of_modes.T @ own.force, strain=own.strain @ of_modes)


def stored() -> tuple[list[Place], Responses]:
    """Gauges and what CalculiX says of them."""
    with np.load(DATA) as kept:
        rows = zip(*(kept[name] for name in ("element", "position", "normal", "direction")), strict=True)
        own = Responses(*(kept[name] for name in ("frequency", "force", "strain", "static")))
        return [Place(int(element), *vectors) for element, *vectors in rows], own
