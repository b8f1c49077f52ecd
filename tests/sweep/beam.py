"""A beam of 32 bricks in two materials, whose every stage takes a second: three batches of filters, samples off the reference."""

from __future__ import annotations

from pathlib import Path

import numpy as np

COUNTS, SIZE, TIP = (8, 2, 2), (1.0, 0.1, 0.08), 1000
CONFIG = """
kind: placement
name: beam
seed: 1
mesh: {file: beam.bdf, length_unit: m, mass_unit: kg}
parameters:
  E: {property: youngs_modulus, region: 1, guess: 1.9e+11, range: [1.6e+11, 2.4e+11], process_noise_scale: 0.05}
  E2: {property: youngs_modulus, region: 2, guess: 7.0e+10, range: [6.0e+10, 8.0e+10], process_noise_scale: 0.05}
loads:
  tip: {node: 1000, direction: [0, 0, 1], known: true, signal: {type: sine, frequency: 20.0, amplitude: 1.0e+3}}
damping: {type: modal, ratio: 0.01}
rom: {modes: 3, parameter_samples: 4, tolerance: 1.0e-8}
train: {duration: 0.05, time_step: 1.0e-3}
gauges:
  direction: {type: axis, axis: [1, 0, 0], angles: [0]}
  noise_std: {relative_to_strongest: 0.01}
screen: {keep: 20, minimum_spacing: 0.02}
place: {estimate: [E], keep: 3, instants: 3, parameter_samples: 2}
validate:
  truth: {model: modes, parameters: {E: 2.1e+11}, modes: 6}
  time_step: 1.0e-3
  duration: 0.05
  initial_std: {E: 0.1}
  random_sets: 2
  repeats: 64
  sweeps: {time_steps: [2.0e-3], process_noise: [0.1, 10.0]}
"""


def write_project(folder: Path) -> Path:
    """The deck and its config, whose path is returned."""
    grid = np.stack(np.meshgrid(*(np.arange(c + 1) for c in COUNTS), indexing="ij"), axis=-1)
    number = 1 + np.arange(grid[..., 0].size).reshape(grid.shape[:3])
    place = grid.reshape(-1, 3) * np.array(SIZE) / np.array(COUNTS)
    cards = [["GRID", n, "", *(f"{x:.6f}" for x in at)] for n, at in enumerate(place, start=1)]
    cards.append(["GRID", TIP, "", SIZE[0], SIZE[1] / 2, SIZE[2] / 2])
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    for e, (i, j, k) in enumerate(np.ndindex(*COUNTS), start=1):
        cards.append(["CHEXA", e, 1 + i // 4, *(number[i + a, j + b, k + c] for a, b, c in corners)])
    cards += [["RBE2", 1, TIP, 123456, *number[-1].flat], ["SPC1", 1, 123, *number[0].flat]]
    cards += [
        ["PSOLID", 1, 1],
        ["PSOLID", 2, 2],
        ["MAT1", 1, 2.1e11, "", 0.3, 7850.0],
        ["MAT1", 2, 7.0e10, "", 0.33, 2700.0],
    ]
    lines = ["SOL 103", "CEND", "SPC = 1", "BEGIN BULK", *map(_written, cards), "ENDDATA", ""]
    (folder / "beam.bdf").write_text("\n".join(lines), encoding="ascii")
    (folder / "beam.yaml").write_text(CONFIG, encoding="utf-8")
    return folder / "beam.yaml"


def _written(card: list[object]) -> str:
    """Nastran's free format, eight fields a line after the first."""
    words = [str(word) for word in card]
    return "\n,".join([",".join(words[:9]), *(",".join(words[i : i + 8]) for i in range(9, len(words), 8))])
