"""A beam with a known and an unknown load, and files of its test as the simulator writes them."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from typer.testing import CliRunner

from strainsight.runner.artefact import Artefact
from strainsight_cli.main import app

from ..shared import made, without_hot_spots
from .conftest import ROOT

DECK = ROOT / "meshes" / "cantilever-coarse.bdf"
CONFIG = """
kind: placement
name: test
mesh: {file: MESH}
parameters:
  E: {property: youngs_modulus, region: 1, guess: 1.89e+11, range: [1.6e+11, 2.4e+11]}
loads:
  tip: {node: 2, direction: [0, 0, 1], known: true, signal: {type: sine, frequency: 20.0, amplitude: 1.0e+4}}
  side:
    node: 2
    direction: [0, 1, 0]
    known: false
    signal: {type: sine, frequency: 10.0, amplitude: 2.0e+3}
    process_noise: {model: integrated_random_walk}
damping: {type: modal, ratio: 0.01}
rom: {modes: 4}
train: {duration: 0.2, time_step: 1.0e-3}
gauges:
  direction: {type: axis, axis: [1, 0, 0]}
  noise_std: {relative_to_strongest: 0.01}
tolerances: {load_angle: 0, load_position: 0, frequency: 0, damping: 1}
screen: {keep: 8}
place: {estimate: [side, E], keep: 4, instants: 1, minimum_spacing: 0.1, certificate: false}
validate:
  truth: {model: modes, parameters: {E: 2.1e+11}, modes: 12}
  time_step: 1.0e-3
  duration: 0.2
  initial_std: {side: 0.1, E: 0.1}
  random_sets: 0
  repeats: 1
  noise_factors: []
estimate:
  as_placed: true
  time: {channel: time}
  channels:
    - {channel: G1, gauge: G1, unit: m/m}
    - {channel: G2, gauge: G2, unit: m/m}
    - {channel: G3, gauge: G3, unit: m/m}
    - {channel: G4, gauge: G4, unit: m/m}
  inputs: {tip: {channel: tip, unit: N}}
  virtual: [{position: [1.0, 0.02, 0.095], direction: [1, 0, 0]}]
"""
BLIND = {
    "name: test\n": "name: blind\n",
    "  tip: {node: 2, direction: [0, 0, 1], known: true, signal: {type: sine, frequency: 20.0, amplitude: 1.0e+4}}\n": "",
    "[side, E]": "[side]",
    "{side: 0.1, E: 0.1}": "{side: 0.1}",
    "  inputs: {tip: {channel: tip, unit: N}}\n": "",
}
"""The changes that leave the one unknown load."""
ALONE = {old: new for old, new in BLIND.items() if ", E" not in old} | {"name: test\n": "name: alone\n"}
"""Those that leave it with the modulus."""
KNOWN = {
    CONFIG[CONFIG.index("  side:") : CONFIG.index("damping:")]: "",
    "[side, E]": "[E]",
    "{side: 0.1, E: 0.1}": "{E: 0.1}",
}
"""Those that leave the known load and the modulus."""
STUDIED = {
    "  random_sets: 0\n  repeats: 1\n": "  random_sets: 9\n  repeats: 2\n"
    "  sweeps: {time_steps: [2.0e-3], process_noise: [10]}\n"
}
"""Those that rank the layout and sweep the filter."""
H = 1e-3
"""[s] between samples."""
FIELD = "estimate.field={every: 0.05}"
PLAIN, COMPARED = "filter.compare=false", "filter.compare=true"


def changed(folder: Path, name: str, changes: dict[str, str], alone: bool = False) -> Path:
    """Results of `validate` of the config with these changes, without other filters and hot spots, made once for all files of
    tests; alone: by the command in this folder, for a config that names files there."""
    text = CONFIG
    for old, new in changes.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    text = text.replace("MESH", str(DECK))
    config, results = folder / f"{name}.yaml", folder / "results"
    config.write_text(text)
    if alone:
        words = [str(config), "--results", str(results), "--set", PLAIN]
        done = CliRunner().invoke(app, ["validate", *words])
        assert done.exit_code == 0, done.output
        return results / name
    with TemporaryDirectory() as empty, without_hot_spots():
        shutil.copy(config, empty)
        found = made(Path(empty) / config.name, PLAIN, until="validate")["validate"].path.parent
    shutil.copytree(found, results / found.name)
    return results / name


def table(folder: Path, name: str = "test") -> tuple[list[str], np.ndarray]:
    with (folder / "results" / name / "measured.csv").open(encoding="utf-8") as lines:
        rows = list(csv.reader(lines))
    return rows[0], np.array([[float(cell or "nan") for cell in row] for row in rows[1:]])


def write(path: Path, head: list[str], values: np.ndarray) -> Path:
    lines = [",".join(head), *(",".join("" if np.isnan(x) else f"{x:.12g}" for x in row) for row in values)]
    path.write_text("\n".join(lines) + "\n")
    return path


def estimated(folder: Path, file: Path, *settings: str, config: str = "test.yaml") -> tuple[int, str]:
    """By the filter of the config alone; COMPARED has the others beside it. Settings with -- are flags."""
    flags = [text if text.startswith("--") else f"--set={text}" for text in (PLAIN, *settings)]
    words = [str(folder / config), "--results", str(folder / "results"), "--measurements", str(file), *flags]
    done = CliRunner().invoke(app, ["estimate", *words, *([] if "--page" in flags else ["--no-page"])])
    assert "Traceback" not in done.output
    return done.exit_code, done.output + (done.stderr or "")


def result(folder: Path) -> Artefact:
    return Artefact(folder / "results" / "test" / "estimate.h5")


def as_written(folder: Path) -> tuple[dict, dict[str, np.ndarray]]:
    """Estimate of the file as it was written, with the field of the surface: summary, arrays by name."""
    code, message = estimated(folder, folder / "results" / "test" / "measured.csv", FIELD)
    assert code == 0, message
    estimate = result(folder)
    return dict(estimate.summary), {path: estimate[path].copy() for path in ("/smoothed/side", "/smoothed/E", "/virtual/strain")}
