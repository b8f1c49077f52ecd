"""Write the loads on the blade of configs/bench-full.yaml: `python make_bench_load.py`, which gives bench-load.csv beside it.

The bench stands still: its hub is bolted to the ground, its blade points along x. Fy and Fz act across the blade, Fx along
it, all at one point of it, and move slowly, as a test rig's actuators can (thesis figure 2.1 shows a history of that kind):

    F = mean + amplitude · sin(2π · 0.2 Hz · t + φ) + a third of it at 0.6 Hz + smooth noise below 0.5 Hz

0.2 Hz is a 3 MW turbine's rotor frequency (12 rpm) and 0.6 Hz its blade passage. The amplitudes are of the order of what
such a turbine's blade does at 15 m from its root; they are no load case of a standard. Sixty seconds at 100 Hz, seed 1.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

SEED, DURATION, RATE = 1, 60.0, 100.0
ROTOR, PASSAGE, CORNER = 0.2, 0.6, 0.5
"""[Hz]."""
MEAN = (3.0e4, 2.0e4, 4.0e4)
AMPLITUDE = (2.0e4, 1.5e4, 2.0e4)
NOISE = (3.0e3, 3.0e3, 5.0e3)
"""Of Fx, Fy, Fz [N]; the noise is an RMS."""


def smooth_noise(generator: np.random.Generator, t: np.ndarray, rms: float) -> np.ndarray:
    """Forty sines below the corner with random phases, (T,) [N]: as smooth as an actuator, and zero at t = 0."""
    frequency = np.linspace(0.02, CORNER, 40)
    phase = generator.uniform(0, 2 * np.pi, 40)
    lines = np.sin(2 * np.pi * frequency * t[:, None] + phase).sum(axis=1)
    lines -= lines[0]
    return np.asarray(rms * lines / lines.std())


def history() -> tuple[np.ndarray, np.ndarray]:
    """Time (T,) [s] and Fx, Fy, Fz (T, 3) [N]."""
    generator = np.random.default_rng(SEED)
    t = np.arange(round(DURATION * RATE) + 1) / RATE
    force = []
    for mean, amplitude, rms in zip(MEAN, AMPLITUDE, NOISE, strict=True):
        phase = generator.uniform(0, 2 * np.pi, 2)
        waves = np.sin(2 * np.pi * ROTOR * t + phase[0]) + np.sin(2 * np.pi * PASSAGE * t + phase[1]) / 3
        force.append(mean + amplitude * waves + smooth_noise(generator, t, rms))
    return t, np.column_stack(force)


if __name__ == "__main__":
    with (Path(__file__).parent / "bench-load.csv").open("w", newline="", encoding="ascii") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(["time", "Fx", "Fy", "Fz"])
        for moment, row in zip(*history(), strict=True):
            writer.writerow([f"{moment:.2f}", *(f"{value:.2f}" for value in row)])
