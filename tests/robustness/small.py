"""A beam of 32 bricks that goes through every stage of a placement and of a bench in seconds."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from ..edges.beam import TIP, bricks

COUNTS = (8, 2, 2)
PLACEMENT = """
kind: placement
name: beam
seed: 1
mesh: {file: beam.bdf, length_unit: m, mass_unit: kg}
parameters:
  E: {property: youngs_modulus, region: 1, guess: 1.9e+11, range: [1.6e+11, 2.4e+11], process_noise_scale: 0.05}
loads:
  tip: {node: 1000, direction: [0, 0, 1], known: true, signal: {type: sine, frequency: 20.0, amplitude: 1.0e+3}}
damping: {type: modal, ratio: 0.01}
rom: {modes: 4, parameter_samples: 3, tolerance: 1.0e-8}
train: {duration: 0.1, time_step: 1.0e-3}
gauges:
  surface: all
  direction: {type: axis, axis: [1, 0, 0], angles: [0]}
  clearance: none
  noise_std: {relative_to_strongest: 0.01}
screen: {keep: 20, minimum_spacing: 0.02}
place: {estimate: [E], keep: 3, instants: 2, aggregate: mean, certificate: true}
estimate:
  file: measured.csv
  as_placed: true
  accept_inconsistent: true  # the record is made up
  time: {channel: time}
  channels:
    - {gauge: G1, channel: G1, unit: um/m}
    - {gauge: G2, channel: G2, unit: um/m}
    - {gauge: G3, channel: G3, unit: um/m}
  inputs: {tip: {channel: tip, unit: N}}
validate:
  truth: {model: perturbed, parameters: {E: 2.1e+11}, modes: 8}
  time_step: 1.0e-3
  duration: 0.1
  initial_std: {E: 0.1}
  random_sets: 2
  noise_factors: [0.1, 5.0]
  repeats: 2
  sweeps: {process_noise: [0.1, 10.0]}
report: {format: html}
"""
BENCH = """
kind: bench
name: bench
bodies:
  beam: {type: flexible, mesh: {file: beam.bdf}, modes: 4, damping: {type: modal, ratio: 0.01}}
frames:
  tip: {body: beam, node: 1000}
forces:
  side: {type: force, frame: tip, direction: [0, 1, 0], signal: {type: sine, frequency: 2.0, amplitude: 100.0}}
  down: {type: force, frame: tip, direction: [0, 0, 1], signal: {type: sine, frequency: 3.0, amplitude: 50.0}}
sensors:
  gauges: {type: strain, body: beam, layout: place}
simulate: {duration: 0.2, time_step: 0.01}
estimate:
  sensors: {gauges: {noise: 1.0e-7}}
  inputs:
    side: {std: 1.0e+2, increment: 20.0}
    down: {std: 1.0e+2, increment: 10.0}
place:
  body: beam
  keep: 3
  noise: 1.0e-7
  pool: 10
  spacing: 0.05
  random: 2
  direction: {type: axis, axis: [1, 0, 0], angles: [0.0, 45.0]}
  exclude: [{normal_cone: {axis: [1, 0, 0], angle: 20}}]
field: {body: beam, instants: 3}
"""


def write_project(folder: Path) -> None:
    """The deck, a test's measurements and both configs."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "beam.bdf").write_text(bricks(COUNTS).replace(str(TIP), "1000"), encoding="ascii")
    (folder / "measured.csv").write_text(_measured(), encoding="ascii")
    (folder / "beam.yaml").write_text(PLACEMENT, encoding="utf-8")
    (folder / "bench.yaml").write_text(BENCH, encoding="utf-8")


def _measured() -> str:
    """Strains [µm/m] as the beam of 2.1e11 Pa has them at 0.19 m, above, below and above, with noise as stated: a record that
    contradicts the model has its grid filter laid again and again, which takes most of a run."""
    time = np.arange(101) * 1e-3
    wave = np.sin(2 * np.pi * 20.0 * time)
    noise = 0.3 * np.random.default_rng(0).standard_normal((3, len(time)))
    rows = np.column_stack([time, *(np.outer((-40.9, 40.9, -40.9), wave) + noise), 1e3 * wave])
    return "\n".join(["time,G1,G2,G3,tip", *(",".join(f"{x:.6g}" for x in row) for row in rows), ""])


def command(config: Path, results: Path, *more: str, stage: str = "run") -> list[str]:
    return [sys.executable, "-m", "strainsight_cli.main", stage, str(config), "--results", str(results), *more]
