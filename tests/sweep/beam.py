"""A beam of 32 bricks in two materials, whose every stage takes a second: three batches of filters, samples off the reference."""

from __future__ import annotations

from pathlib import Path

from ..edges.beam import TIP, bricks

CONFIG = f"""
kind: placement
name: beam
seed: 1
mesh: {{file: beam.bdf, length_unit: m, mass_unit: kg}}
parameters:
  E: {{property: youngs_modulus, region: 1, guess: 1.9e+11, range: [1.6e+11, 2.4e+11], process_noise_scale: 0.05}}
  E2: {{property: youngs_modulus, region: 2, guess: 7.0e+10, range: [6.0e+10, 8.0e+10], process_noise_scale: 0.05}}
loads:
  tip: {{node: {TIP}, direction: [0, 0, 1], known: true, signal: {{type: sine, frequency: 20.0, amplitude: 1.0e+3}}}}
damping: {{type: modal, ratio: 0.01}}
rom: {{modes: 3, parameter_samples: 4, tolerance: 1.0e-8}}
train: {{duration: 0.05, time_step: 1.0e-3}}
gauges:
  direction: {{type: axis, axis: [1, 0, 0], angles: [0]}}
  noise_std: {{relative_to_strongest: 0.01}}
screen: {{keep: 20, minimum_spacing: 0.02}}
place: {{estimate: [E], keep: 3, instants: 3, parameter_samples: 2}}
validate:
  truth: {{model: modes, parameters: {{E: 2.1e+11}}, modes: 6}}
  time_step: 1.0e-3
  duration: 0.05
  initial_std: {{E: 0.1}}
  random_sets: 2
  repeats: 64
  sweeps: {{time_steps: [2.0e-3], process_noise: [0.1, 10.0]}}
"""


def write_project(folder: Path) -> Path:
    deck = bricks((8, 2, 2))
    for e in range(17, 33):
        deck = deck.replace(f"CHEXA,{e},1,", f"CHEXA,{e},2,")
    second = "PSOLID,1,1\nPSOLID,2,2\nMAT1,2,7.0+10,,0.33,2700."
    (folder / "beam.bdf").write_text(deck.replace("PSOLID,1,1", second), encoding="ascii")
    (folder / "beam.yaml").write_text(CONFIG, encoding="utf-8")
    return folder / "beam.yaml"
