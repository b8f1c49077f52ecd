"""Write the load of a blade root on the hub: `python make_blade_load.py`, which gives blade-load.csv beside this file.

A turbine whose hub has 0.5 m in radius turns about once a second: 1P = 1 Hz, and three blades give 3P = 3 Hz. The blade
hangs on the flange whose axis is x (`meshes/make_hub.py`); z is the axis of the main shaft. In the turning frame of the hub

    Fx = centrifugal pull        + weight along the blade, 1P              + turbulence
    Fy = driving force           + weight across the blade, 1P, 90° behind + turbulence
    Fz = thrust + wind shear, 1P + tower passage and its kind, 3P          + turbulence

    turbulence: white noise through 1 / (1 + s/ω_c)², ω_c = 2π · 2 Hz, scaled to the stated RMS: smooth, like a thrust that
    a whole blade has averaged over the turbulent wind.

Amplitudes are of the order of those of a blade of 100 kg and 6 m; they are no load case of a standard. Eight seconds
at 500 Hz, seed 1; everything starts from zero within the first quarter of a second, so that the start rings little.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

SEED, DURATION, RATE = 1, 8.0, 500.0
ROTOR, CORNER, RAMP = 1.0, 2.0, 0.25
"""[Hz], [Hz], [s]."""
STEADY = (8.0e3, 1.0e3, 4.0e3)
"""Centrifugal pull, driving force, thrust [N]."""
WEIGHT, SHEAR, PASSAGE = 1.0e3, 8.0e2, 6.0e2
"""1P of the weight, 1P of the wind shear, 3P [N]."""
TURBULENCE = (3.0e2, 4.0e2, 1.0e3)
"""RMS [N]."""


def turbulence(generator: np.random.Generator, size: int, rms: float) -> np.ndarray:
    """Noise through two first-order low passes one after the other, each exact from sample to sample, (size,) [N]."""
    keep = np.exp(-2 * np.pi * CORNER / RATE)
    value = generator.standard_normal(size)
    for _ in range(2):
        state = 0.0
        for i in range(size):
            state = keep * state + (1 - keep) * value[i]
            value[i] = state
    return rms * (value - value.mean()) / value.std()


def history() -> tuple[np.ndarray, np.ndarray]:
    """Time (s,) [s] and Fx, Fy, Fz (s, 3) [N]."""
    generator = np.random.default_rng(SEED)
    t = np.arange(round(DURATION * RATE) + 1) / RATE
    once, thrice = 2 * np.pi * ROTOR * t, 6 * np.pi * ROTOR * t
    periodic = (
        WEIGHT * np.cos(once),
        WEIGHT * np.sin(once),
        SHEAR * np.cos(once + 0.4) + PASSAGE * np.cos(thrice + 1.1),
    )
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.minimum(t / RAMP, 1.0))
    force = [
        ramp * (steady + wave + turbulence(generator, len(t), rms))
        for steady, wave, rms in zip(STEADY, periodic, TURBULENCE, strict=True)
    ]
    return t, np.column_stack(force)


if __name__ == "__main__":
    with (Path(__file__).parent / "blade-load.csv").open("w", newline="", encoding="ascii") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(["time", "Fx", "Fy", "Fz"])
        for moment, row in zip(*history(), strict=True):
            writer.writerow([f"{moment:.3f}", *(f"{value:.2f}" for value in row)])
